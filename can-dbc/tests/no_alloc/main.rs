//! Encoding, decoding, sending and receiving take no memory from the heap.

use platoon_dbc::{
    Bus, EgoState, Loopback, Message, PortLease, Udp, UdpOptions, decode_signals, e2e,
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
