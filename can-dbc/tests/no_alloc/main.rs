//! Encoding, decoding, sending and receiving take no memory from the heap.

use platoon_dbc::{
    Actuation, Bus, BusTiming, Decoder, EcuStatus, EgoState, Emulated, Encoder, Loopback, Message,
    Mission, Obstacle, PortLease, Profile, Udp, UdpOptions, V2vOut, V2vState, Vehicle,
    decode_signals, e2e,
};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::time::Duration;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, counting what each thread asks of it.
struct Counting;

#[expect(unsafe_code, reason = "an allocator is unsafe by its nature")]
// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(work: impl FnOnce()) -> u64 {
    let before = ALLOCATIONS.with(Cell::get);
    work();
    ALLOCATIONS.with(Cell::get) - before
}

fn exchange(here: &mut dyn Bus, there: &mut dyn Bus) {
    let mut supervisor = e2e::Supervisor::new();
    for counter in 0..100 {
        let state = EgoState { tick: u32::from(counter), ..EgoState::default() };
        here.send(&state.encode(counter).expect("in range")).expect("room");
        assert_eq!(there.wait(Duration::from_secs(5)), Ok(true));
        let received = there.receive().expect("up").expect("waiting");
        let (message, counter) = Message::decode(&received.frame).expect("undamaged");
        assert_eq!(message, Message::EgoState(state));
        supervisor.see(counter);
        decode_signals(&received.frame, &mut |_, _, _| {}).expect("known");
    }
    assert_eq!(here.receive(), Ok(None));
    assert_eq!(supervisor.counts().lost, 0);
}

#[test]
fn the_counter_counts() {
    assert_eq!(allocations(|| drop(std::hint::black_box(Box::new(1)))), 1);
}

#[test]
fn a_cycle_over_loopback_allocates_nothing() {
    let (mut here, mut there) = Loopback::pair("loopback0", 16);
    assert_eq!(allocations(|| exchange(&mut here, &mut there)), 0);
}

#[test]
fn a_cycle_over_udp_allocates_nothing() {
    let lease = PortLease::acquire(46_500).expect("a free port");
    let [mut here, mut there] = [(); 2].map(|()| {
        let options = UdpOptions { group: Udp::group_of_bus(0), port: lease.port(), tag: "truck0" };
        Udp::join(options).expect("multicast on the loopback interface")
    });
    assert_eq!(allocations(|| exchange(&mut here, &mut there)), 0);
}

#[test]
fn encoders_and_decoders_of_every_profile_allocate_nothing() {
    let messages = [
        Message::EgoState(EgoState::default()),
        Message::Actuation(Actuation::default()),
        Message::V2vState(V2vState::default()),
        Message::V2vOut(V2vOut::default()),
        Message::Obstacle(Obstacle::default()),
        Message::Mission(Mission::default()),
        Message::EcuStatus(EcuStatus::default()),
    ];
    for profile in Profile::ALL {
        let mut encoder = Encoder::new(profile, Vehicle::default());
        let mut decoder = Decoder::new(profile, Vehicle::default());
        let mut heard = 0;
        let allocated = allocations(|| {
            for time_ns in (0..1_000_000_000).step_by(10_000_000) {
                encoder.note_actuators(-1500.0, 0.01);
                for message in &messages {
                    let mut hear = |frame: &_| {
                        heard += usize::from(decoder.take(frame).expect("sound").message.is_some());
                    };
                    encoder.encode(message, time_ns, &mut hear).expect("in range");
                }
            }
        });
        assert_eq!((allocated, heard), (0, 100 * messages.len()), "{profile}");
    }
}

#[test]
fn a_cycle_over_an_emulated_bus_allocates_nothing() {
    let (here, mut there) = Loopback::pair("loopback0", 16);
    let mut here = Emulated::new(here, BusTiming::default());
    here.begin();
    let frame = EgoState::default().encode(0).expect("in range");
    let run = || {
        for step in 1..100 {
            here.send(&frame).expect("room");
            there.send(&frame).expect("room");
            here.set_bench_time(1_000_000 * step);
            here.set_bench_time(1_000_000 * step + 900_000);
            let heard = [here.receive(), here.receive(), there.receive()];
            assert!(heard.iter().all(|heard| heard.is_ok_and(|heard| heard.is_some())));
        }
    };
    assert_eq!(allocations(run), 0);
}
