//! `platoon controller`: one truck's ECU as a process of its own.

use std::sync::atomic::AtomicBool;

use controller_rt::{Config, Ecu};
use law::Calibration;
use platoon_dbc::{Bus, Decoder};
use traces::{Overflow, Source};

use crate::bus::BusChoice;
use crate::calibration;
use crate::cli::ControllerArgs;
use crate::clock::HostClock;
use crate::failure::Failure;
use crate::feed::Feed;
use crate::gain::{self, Settled};
use crate::process;
use crate::run_folder::RunFolder;
use crate::stall::stalling;
use crate::witness::HostWitness;

/// Runs the ECU until its mission ends, its rig falls silent, or somebody stops it.
///
/// # Errors
/// When it cannot start.
pub fn run(args: &ControllerArgs) -> Result<(), Failure> {
    if args.supervised {
        process::die_with_parent();
    }
    let stop = process::stop_flag()?;
    let calibration: Calibration = calibration::from_file(args.law.as_deref())?;
    let calibration = calibration::asked_for(calibration, &args.law_options, args.profile)?;
    let mut bus = match &args.feed {
        Some(recording) => Box::new(Feed::open(recording, args.truck, HostClock::default())?),
        None => BusChoice::joining(args.bus, &args.place)?.open(args.truck)?,
    };
    let mut trucks = args.trucks;
    if trucks.is_none() && gain::is_looked_up(&calibration, &args.law_options) {
        trucks = platoon_size(args, &calibration, &mut *bus, &stop);
        if trucks.is_none() {
            return Ok(());
        }
    }
    let Settled { calibration, gain_id, note } =
        gain::settled(calibration, &args.law_options, trucks)?;
    let law = calibration::controller(calibration, args.law_options.solver);
    let controller = stalling(law, &args.told.fault, args.truck);
    let folder = RunFolder::open(&args.out)?;
    let source = Source::Ecu(args.truck);
    process::reserve_json(&folder.process_report(&source.to_string()))?;
    let interfaces = vec![bus.name().to_owned()];
    // The recorder's thread starts first, so that it does not inherit the loop's priority.
    let recorder = process::recorder(&folder, source, Overflow::DropNewest, interfaces)?;
    if !args.supervised {
        anstream::eprintln!("ECU {} waits for a mission on {}", args.truck, bus.name());
        if let Some(note) = &note {
            anstream::eprintln!("ECU {}: {note}", args.truck);
        }
    }

    let obtained = process::become_realtime(process::ECU_PRIORITY, args.cpu);
    for refusal in &obtained.refused {
        anstream::eprintln!("ECU {}: running without it: {refusal}", args.truck);
    }
    let config = Config {
        truck: args.truck,
        gain_id,
        profile: args.profile,
        vehicle: calibration::vehicle(&calibration),
        realtime: Some(process::as_reported(&obtained)),
        without_emergency_braking: args.law_options.no_emergency_braking,
        overruns: args.overrun.overruns(),
    };
    let witness = HostWitness::of_this_thread(&obtained.cpus, args.told.pauses.as_deref());
    let ecu = Ecu::new(config, bus, controller, Some(recorder)).witnessed_by(Box::new(witness));
    let report = controller_rt::run(ecu, &HostClock::default(), &stop);
    process::write_json(&folder.process_report(&source.to_string()), &report)?;
    if !args.supervised {
        anstream::eprintln!(
            "ECU {}: {} ticks, {} late, {} skipped ({}); recording and report in {}",
            args.truck,
            report.ticks,
            report.misses,
            report.skipped,
            report.on_overrun,
            folder.path().display()
        );
    }
    Ok(())
}

/// How many trucks the platoon has, from the first mission that comes; `None` when somebody stops
/// the wait. The rig repeats it until the ECU is ready.
fn platoon_size(
    args: &ControllerArgs,
    calibration: &Calibration,
    bus: &mut dyn Bus,
    stop: &AtomicBool,
) -> Option<usize> {
    if !args.supervised {
        let name = bus.name();
        anstream::eprintln!("ECU {} looks its gain up when a mission comes on {name}", args.truck);
    }
    let decoder = Decoder::new(args.profile, calibration::vehicle(calibration));
    let clock = HostClock::default();
    let mission = controller_rt::first_mission(args.truck, bus, decoder, &clock, stop)?;
    Some(usize::from(mission.platoon_size))
}
