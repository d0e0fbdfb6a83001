//! `platoon diff`: where two runs part, why, and when it shows.
//!
//! Aligned on ticks, by their bench time: runs of other machines, back-ends, controllers, seeds,
//! rates and versions can be held against each other. Told is the first tick of any ECU that came
//! to something else, the frame that ECU had consumed by then that explains it, and when the
//! distances between the trucks themselves were apart by more than a centimetre.

mod alignment;
mod finding;
mod upstream;
mod visible;

use traces::{Record, Topic};

use crate::cli::DiffArgs;
use crate::failure::Failure;
use crate::process;
use crate::summary::Verdict;
use crate::trace::{Events, Trace};

use alignment::Alignment;
use finding::Finding;
use visible::Spacing;

/// Events read of one run before it is looked which of the two is behind.
const AT_ONCE: usize = 512;

/// Compares two runs.
///
/// # Errors
/// When one of them cannot be read.
pub fn run(args: &DiffArgs) -> Result<Verdict, Failure> {
    if let Some(path) = &args.json {
        process::check_parent("--json", path)?;
    }
    let traces = [Trace::open(&args.a)?, Trace::open(&args.b)?];
    let finding = compare(&traces, args.ecu)?;
    if finding.ecus.is_empty() {
        return Err(Failure::usage(format!(
            "{} and {} have no ECU in common",
            args.a.display(),
            args.b.display()
        )));
    }
    anstream::print!("{finding}");
    if let Some(path) = &args.json {
        process::write_json(path, &finding)?;
    }
    Ok(if finding.is_same() { Verdict::Pass } else { Verdict::Fail })
}

/// Reads both runs side by side, so that neither has to be held in memory.
fn compare(traces: &[Trace; 2], ecu: Option<u8>) -> Result<Finding, Failure> {
    let is_about = move |topic| match topic {
        Topic::Rx(truck) | Topic::Tick(truck) => ecu.is_none_or(|ecu| ecu == truck),
        // Their numbers are needed to see where records are missing.
        Topic::Memory(truck) => ecu.is_none_or(|ecu| ecu == truck),
        Topic::Truth => true,
        Topic::Frames(_) | Topic::Dropped(_) => false,
    };
    let [a, b] = traces;
    let mut events = [a.events(is_about, 0..u64::MAX)?, b.events(is_about, 0..u64::MAX)?];
    let (mut alignment, mut spacing) = (Alignment::default(), Spacing::default());
    let mut reached_ns = [Some(0), Some(0)];
    loop {
        // Whoever is behind reads on; who has ended is behind no more.
        let side = match reached_ns {
            [Some(a), Some(b)] => usize::from(b < a),
            [Some(_), None] => 0,
            [None, Some(_)] => 1,
            [None, None] => break,
        };
        reached_ns[side] = read_on(&mut events[side], side, &mut alignment, &mut spacing);
    }
    let settings = upstream::settings_apart(traces);
    let damage = events.each_ref().map(Events::damage);
    Ok(Finding { ecus: alignment.finish(), spacing: spacing.finish(), settings, damage })
}

/// Reads some events of one run; the bench time reached \[ns\], `None` at its end.
fn read_on(
    events: &mut Events,
    side: usize,
    alignment: &mut Alignment,
    spacing: &mut Spacing,
) -> Option<u64> {
    let mut reached_ns = None;
    for event in events.by_ref().take(AT_ONCE) {
        reached_ns = Some(event.time_ns);
        match (event.topic, &event.record) {
            (Topic::Truth, Record::Truth(truth)) => spacing.add(side, truth),
            (Topic::Rx(truck) | Topic::Tick(truck) | Topic::Memory(truck), _) => {
                alignment.add(side, truck, event);
            }
            _ => {}
        }
    }
    reached_ns
}
