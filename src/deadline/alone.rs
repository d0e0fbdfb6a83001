//! Cells in which one ECU runs alone, fed from memory.

use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use vcan_setup::floor::{FloorOptions, Sentinel};
use vcan_setup::pauses::PauseLog;
use vcan_setup::realtime::environment;

use super::plan::Cell;
use super::remove;
use crate::cli::RehearseArgs;
use crate::failure::Failure;
use crate::process;
use crate::rehearse::{self, Timed};
use crate::run_folder::RunFolder;

/// The truck whose ECU it is where it has one: the first that hears another by radio.
const TRUCK: u8 = 1;
/// How long an ECU may take beyond its bench time before it counts as hung.
const GRACE: Duration = Duration::from_secs(10);
/// How often its end is looked for.
const LOOK: Duration = Duration::from_millis(20);

/// Runs in virtual time, of which ECUs are given what they received; one for each rate.
#[derive(Default)]
pub struct Feeds {
    recorded: BTreeMap<u32, RunFolder>,
}

impl Feeds {
    /// The one for this rehearsal's rate, made when there is none yet.
    ///
    /// # Errors
    /// When it cannot be run.
    pub fn of(&mut self, args: &RehearseArgs, folder: &RunFolder) -> Result<RunFolder, Failure> {
        let rate_hz = args.run.rate_hz()?;
        if let Some(feed) = self.recorded.get(&rate_hz) {
            return Ok(feed.clone());
        }
        let feed = RunFolder::open(&folder.path().join(format!("feed-{rate_hz}")))?;
        let mut args = RehearseArgs { virtual_time: true, fault: Vec::new(), ..args.clone() };
        args.bus = crate::cli::BusKind::Auto;
        rehearse::record(&args, &feed)?;
        self.recorded.insert(rate_hz, feed.clone());
        Ok(feed)
    }

    /// Removes what was recorded.
    pub fn remove(self) {
        self.recorded.values().for_each(|folder| remove(folder.path()));
    }
}

/// Times one ECU that is given what it received in a run in virtual time.
///
/// # Errors
/// When it cannot start or leaves no report.
pub fn time(
    args: &RehearseArgs,
    cell: &Cell,
    ecus: &[u8],
    (feed, folder): (&RunFolder, &RunFolder),
    stop: &AtomicBool,
) -> Result<Timed, Failure> {
    let truck = if ecus.contains(&TRUCK) { TRUCK } else { ecus.first().copied().unwrap_or(TRUCK) };
    let online = environment().online_cpus;
    let cpu = args.timing.cpus.of_ecu(&online, truck);
    let pauses = PauseLog::new()
        .map_err(|error| Failure::cannot_start(format!("cannot log pauses: {error}")))?;
    let watched = cpu.map_or(online, |cpu| vec![cpu]);
    let period_ns = 1_000_000_000 / u64::from(cell.rate_hz);
    let options = FloorOptions::beside(period_ns, watched, process::RIG_PRIORITY + 1);
    let sentinel =
        Sentinel::start_noting(&options, Some(&pauses)).map_err(Failure::cannot_start)?;
    let mut words = arguments(args, truck, ecus, (feed, folder));
    words.extend(["--pauses".into(), pauses.path().display().to_string()]);
    words.extend(cpu.into_iter().flat_map(|cpu| ["--cpu".into(), cpu.to_string()]));
    let limit = Duration::from_secs_f64(cell.duration_s) + GRACE;
    let ended = start(&words, truck, folder).and_then(|child| wait(child, limit, stop));
    let floor = sentinel.stop();
    let interrupted = stop.load(Ordering::Relaxed);
    let report = ended.map(|()| process::ecu_report(folder, truck))?;
    let log = folder.log(&process::ecu_name(truck));
    let words = || std::fs::read_to_string(&log).unwrap_or_default().trim().replace('\n', "; ");
    if report.is_none() && !interrupted {
        return Err(Failure::cannot_start(format!("the ECU left no report: {}", words())));
    }
    let ecus = report.into_iter().collect();
    Ok(Timed { ecus, floor, backend: "loopback".into(), notes: Vec::new(), interrupted })
}

fn arguments(
    args: &RehearseArgs,
    truck: u8,
    ecus: &[u8],
    (feed, folder): (&RunFolder, &RunFolder),
) -> Vec<String> {
    let told = feed.law_of(truck);
    let law = if told.exists() { told } else { feed.law() };
    let trucks = ecus.last().map_or(1, |last| u32::from(*last) + 1);
    let path = |path: &std::path::Path| path.display().to_string();
    let pairs = [
        ("--truck", truck.to_string()),
        ("--trucks", trucks.to_string()),
        ("--law", path(&law)),
        ("--feed", path(&feed.part(&process::ecu_name(truck)))),
        ("--out", path(folder.path())),
    ];
    let pairs = pairs.into_iter().flat_map(|(flag, word)| [flag.to_owned(), word]);
    let mut words = vec!["controller".to_owned(), "--supervised".to_owned()];
    words.extend(pairs);
    words.extend(args.law_options.as_arguments());
    words.extend(args.timing.overrun.as_arguments());
    words.extend(args.fault.iter().flat_map(|fault| ["--fault".into(), fault.to_string()]));
    words
}

fn start(words: &[String], truck: u8, folder: &RunFolder) -> Result<Child, Failure> {
    let failed = |error| Failure::cannot_start(format!("cannot start an ECU: {error}"));
    let program = std::env::current_exe().map_err(failed)?;
    let log = File::create(folder.log(&process::ecu_name(truck))).map_err(failed)?;
    Command::new(program)
        .args(words)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(log)
        // Ctrl-C is for this process alone; it ends the others in order.
        .process_group(0)
        .spawn()
        .map_err(failed)
}

/// Waits for its end; ends it when somebody stops the test or it hangs.
fn wait(mut child: Child, limit: Duration, stop: &AtomicBool) -> Result<(), Failure> {
    let deadline = Instant::now() + limit;
    loop {
        let failed = |error| Failure::cannot_start(format!("cannot wait for an ECU: {error}"));
        if child.try_wait().map_err(failed)?.is_some() {
            return Ok(());
        }
        if stop.load(Ordering::Relaxed) || Instant::now() > deadline {
            // It may end this instant.
            let _ = child.kill();
            let _ = child.wait();
            return Ok(());
        }
        thread::sleep(LOOK);
    }
}

#[cfg(test)]
mod tests {

    use crate::clock::SleptClock;
    use clap::Parser;
    use controller_rt::{Config, Ecu, Ending};

    use super::*;
    use crate::calibration;
    use crate::cli::{Cli, SolverKind, Verb};
    use crate::deadline::load::Load;
    use crate::deadline::plan::Subject;
    use crate::feed::Feed;

    /// What a cell of one second at 100 Hz runs.
    fn rehearsal() -> RehearseArgs {
        let cli = Cli::parse_from(["platoon", "deadline", "--rates", "none"]);
        let Some(Verb::Deadline(args)) = cli.verb else { panic!("another verb") };
        let cell = Cell { subject: Subject::Ecu, rate_hz: 100, load: Load::Idle, duration_s: 1.0 };
        super::super::rehearsal(&args, &cell).expect("well formed")
    }

    #[test]
    fn an_ecu_that_is_fed_drives_as_it_did_and_solves_its_problems() {
        let place = std::env::temp_dir().join(format!("platoon-feed-{}", std::process::id()));
        let folder = RunFolder::open(&place).expect("a folder");
        let args = rehearsal();
        let feed = Feeds::default().of(&args, &folder).expect("a run in virtual time");
        let clock = SleptClock::default();
        let part = feed.part(&process::ecu_name(TRUCK));
        let bus = Feed::open(&part, TRUCK, clock.clone()).expect("a recording");
        let law = calibration::from_file(Some(&feed.law())).expect("the law as run");
        let controller = calibration::controller(law, SolverKind::ActiveSet);
        let config = Config { truck: TRUCK, ..Config::default() };
        let ecu = Ecu::new(config, Box::new(bus), controller, None);
        let report = controller_rt::run(ecu, &clock, &AtomicBool::new(false));
        remove(&place);
        assert_eq!(report.ending, Ending::MissionEnded);
        assert_eq!((report.misses, report.skipped, report.stale_ticks), (0, 0, 0));
        assert!((100..=102).contains(&report.ticks), "{} ticks", report.ticks);
        // Every tick but the first few has all it needs to decide.
        assert!(report.qp.solves >= 95, "{:?}", report.qp);
        assert_eq!(report.qp.failures, 0);
        assert_eq!(report.guard.get("ego_stale"), None);
    }

    #[test]
    fn the_process_of_an_ecu_is_told_all_it_needs() {
        let (args, [feed, own]) = (rehearsal(), ["feed", "cell"].map(RunFolder::named));
        let words = arguments(&args, 1, &[0, 1, 2], (&feed, &own)).join(" ");
        for told in [
            "controller --supervised --truck 1 --trucks 3",
            "--law feed/law.toml",
            "--feed feed/ecu1.part.mcap",
            "--out cell",
            "--startup-grace-s 0.5",
        ] {
            assert!(words.contains(told), "no {told:?} in {words}");
        }
    }
}
