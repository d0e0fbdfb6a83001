//! `platoon play`: the frames of a recorded run back on a bus, with the times they had.
//!
//! A thread reads ahead, so that the one that sends only sleeps and sends; how late each frame was
//! against the recording is told at the end, beside how late the machine was by itself meanwhile.
//! The rig's frames alone drive ECUs as a run would, the ECUs' alone a rig.

mod timing;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use platoon_dbc::{Bus, Clock};
use traces::{FrameRecord, Record, Topic};
use vcan_setup::floor::{FloorOptions, Sentinel};
use vcan_setup::realtime::environment;

use crate::bus::BusChoice;
use crate::cli::{BusKind, PlayArgs, Side};
use crate::clock::HostClock;
use crate::failure::Failure;
use crate::process;
use crate::trace::{Trace, seconds};

use timing::Timing;

/// Frames read ahead at once, and how many such batches: half a minute of four trucks at 1 kHz.
const BATCH: usize = 1024;
const BATCHES_AHEAD: usize = 256;
/// Before the first frame: the time a reader gets to be ahead \[ns\].
const RUN_UP_NS: u64 = 200_000_000;
/// Longest sleep before Ctrl-C is looked at \[ns\].
const LOOK_NS: u64 = 100_000_000;
/// Time to the next frame from which on there is time for anything else \[ns\].
const SPARE_NS: u64 = 300_000;
/// Pause between the end and the next beginning of a loop, in bench time \[ns\].
const BETWEEN_LOOPS_NS: u64 = 1_000_000;
/// How often the machine is asked how late it is \[ns\].
const FLOOR_PERIOD_NS: u64 = 1_000_000;

/// Plays a run.
///
/// # Errors
/// When the trace cannot be read, the bus not be had, or nothing is left to play.
pub fn run(args: &PlayArgs) -> Result<(), Failure> {
    let is_sensible = args.speed.is_finite() && (0.001..=1000.0).contains(&args.speed);
    if !is_sensible {
        return Err(Failure::usage("--speed: give a factor between 0.001 and 1000"));
    }
    if args.bus == BusKind::Loopback {
        return Err(Failure::usage(
            "--bus loopback lives inside one process, nobody would hear it; use udp or socketcan",
        ));
    }
    if let Some(path) = &args.json {
        process::check_parent("--json", path)?;
    }
    let trace = Trace::open(&args.run)?;
    let choice = Selection::of(args)?;
    let bus = BusChoice::for_run(args.bus, &args.place, trace.buses())?;
    anstream::eprintln!(
        "playing {} on {} ({}){}",
        trace.path().display(),
        bus.backend(),
        bus.interfaces(trace.buses()).join(", "),
        if args.speed == 1.0 { String::new() } else { format!(", {} times as fast", args.speed) }
    );
    let stop = process::stop_flag()?;
    let timing = thread::scope(|scope| {
        let (sender, batches) = sync_channel(BATCHES_AHEAD);
        let (trace, choice) = (&trace, &choice);
        let reader = scope.spawn(move || read_ahead(trace, choice, args.repeats, &sender));
        let player = Player::new(&bus, args.speed, &stop);
        let timing = player.play(batches);
        let read = reader.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        read.and(timing)
    })?;
    if timing.frames == 0 {
        return Err(Failure::usage(
            "nothing to play: no frame of the trace is left by the options",
        ));
    }
    anstream::println!("{timing}");
    args.json.as_deref().map_or(Ok(()), |path| process::write_json(path, &timing))
}

/// Which frames are played.
struct Selection {
    times: std::ops::Range<u64>,
    from_tick: u32,
    sent_by: Side,
    only: Vec<u32>,
    truck: Option<u8>,
}

impl Selection {
    fn of(args: &PlayArgs) -> Result<Self, Failure> {
        let only = args.only.iter().map(|word| identifier(word)).collect::<Result<_, _>>()?;
        Ok(Self {
            times: seconds(None, args.until, "--until")?,
            from_tick: args.from_tick.unwrap_or(0),
            sent_by: args.sent_by,
            only,
            truck: args.truck,
        })
    }

    fn takes(&self, record: &FrameRecord) -> bool {
        record.tick >= self.from_tick
            && (self.only.is_empty() || self.only.contains(&record.frame.id()))
            && match self.sent_by {
                Side::All => true,
                Side::Rig => record.tx,
                Side::Ecu => !record.tx,
            }
    }
}

/// The identifier a word means: a message's name, or hexadecimal digits.
fn identifier(word: &str) -> Result<u32, Failure> {
    let known = platoon_dbc::Profile::Fd.messages().iter();
    let mut known = known.chain(platoon_dbc::Profile::J1939.messages());
    match known.find(|message| message.name == word) {
        Some(message) => Ok(message.id),
        None => u32::from_str_radix(word, 16).map_err(|_| {
            Failure::usage(format!("--only {word}: neither a message nor a hexadecimal identifier"))
        }),
    }
}

/// A frame and when it is due, from the first frame on, in recorded time \[ns\].
type Due = (u64, FrameRecord);

/// Hands the frames on in order, again and again when they are to repeat.
fn read_ahead(
    trace: &Trace,
    choice: &Selection,
    repeats: bool,
    sender: &std::sync::mpsc::SyncSender<Vec<Due>>,
) -> Result<(), Failure> {
    let truck = choice.truck;
    let is_asked = move |topic| match topic {
        Topic::Frames(bus) => truck.is_none_or(|truck| truck == bus),
        _ => false,
    };
    let (mut begins_ns, mut ends_ns) = (0, 0);
    loop {
        let mut first_ns = None;
        let mut batch = Vec::with_capacity(BATCH);
        for event in trace.events(is_asked, choice.times.clone())? {
            let Record::Frame(record) = event.record else { continue };
            if !choice.takes(&record) {
                continue;
            }
            let time_ns = if record.stamp_ns == 0 { record.time_ns } else { record.stamp_ns };
            let since_ns = time_ns.saturating_sub(*first_ns.get_or_insert(time_ns));
            // Stamps of several buses may be a little out of order.
            ends_ns = ends_ns.max(begins_ns + since_ns);
            batch.push((ends_ns, record));
            if batch.len() == BATCH {
                let full = std::mem::replace(&mut batch, Vec::with_capacity(BATCH));
                if sender.send(full).is_err() {
                    return Ok(()); // Somebody stopped the player.
                }
            }
        }
        if sender.send(batch).is_err() || !repeats || first_ns.is_none() {
            return Ok(());
        }
        begins_ns = ends_ns + BETWEEN_LOOPS_NS;
    }
}

/// How the machine's floor is measured while frames are played: the player cannot make it late.
fn sentinel_options() -> FloorOptions {
    FloorOptions {
        cpus: environment().online_cpus,
        period_ns: FLOOR_PERIOD_NS,
        priority: Some(process::RIG_PRIORITY + 1),
    }
}

/// Sends frames when they are due.
struct Player<'a> {
    choice: &'a BusChoice,
    buses: BTreeMap<u8, Box<dyn Bus>>,
    speed: f64,
    stop: &'a AtomicBool,
    clock: HostClock,
    timing: Timing,
}

impl<'a> Player<'a> {
    fn new(choice: &'a BusChoice, speed: f64, stop: &'a AtomicBool) -> Self {
        let (buses, clock) = (BTreeMap::new(), HostClock::default());
        Self { choice, buses, speed, stop, clock, timing: Timing::default() }
    }

    /// Plays until the end or until somebody stops it.
    fn play(mut self, batches: Receiver<Vec<Due>>) -> Result<Timing, Failure> {
        let first = batches.recv().unwrap_or_default();
        let sentinel = Sentinel::start(&sentinel_options()).map_err(Failure::cannot_start)?;
        let obtained = process::become_realtime(process::RIG_PRIORITY, None);
        for refusal in &obtained.refused {
            anstream::eprintln!("playing without it: {refusal}");
        }
        let played = self.send_all(first, &batches);
        self.timing.set_beside(&sentinel.stop());
        played.map(|()| self.timing)
    }

    fn send_all(&mut self, first: Vec<Due>, batches: &Receiver<Vec<Due>>) -> Result<(), Failure> {
        let start_ns = self.clock.now_ns() + RUN_UP_NS;
        for batch in std::iter::once(first).chain(batches.iter()) {
            for (time_ns, record) in batch {
                let due_ns = start_ns + (time_ns as f64 / self.speed) as u64;
                let Some(sent_ns) = self.wait_until(due_ns) else { return Ok(()) };
                self.send(due_ns, sent_ns, &record)?;
            }
        }
        Ok(())
    }

    /// The time once it has come; none when somebody stopped it.
    fn wait_until(&mut self, due_ns: u64) -> Option<u64> {
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return None;
            }
            let now_ns = self.clock.now_ns();
            if now_ns >= due_ns {
                return Some(now_ns);
            }
            if due_ns - now_ns > SPARE_NS {
                self.discard_received();
            }
            self.clock.sleep_until_ns(due_ns.min(now_ns + LOOK_NS));
        }
    }

    /// Nobody reads this end; what others send is not to fill its buffers.
    fn discard_received(&mut self) {
        for bus in self.buses.values_mut() {
            while let Ok(Some(_)) = bus.receive() {}
        }
    }

    fn send(&mut self, due_ns: u64, sent_ns: u64, record: &FrameRecord) -> Result<(), Failure> {
        if !self.buses.contains_key(&record.bus) {
            self.buses.insert(record.bus, self.choice.open(record.bus)?);
        }
        let Some(bus) = self.buses.get_mut(&record.bus) else { return Ok(()) };
        let is_refused = bus.send(&record.frame).is_err();
        self.timing.note(record.bus, due_ns, sent_ns, is_refused);
        Ok(())
    }
}
