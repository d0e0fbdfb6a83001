//! The command lines of the processes of a rehearsal.

use std::path::Path;

use super::super::Plan;
use super::separate_ecus;
use crate::bus::BusChoice;
use crate::cli::Word;
use crate::fault::{Fault, FaultKind};
use crate::run_folder::RunFolder;

/// What the command lines are made from.
pub(super) struct CommandLines<'a> {
    pub(super) plan: &'a Plan<'a>,
    pub(super) folder: &'a RunFolder,
    pub(super) bus: &'a BusChoice,
    /// Where the sentinel notes the pauses of the machine.
    pub(super) pauses: &'a Path,
}

impl CommandLines<'_> {
    /// The words that start the rig, with the ECUs that it hosts.
    pub(super) fn rig(&self, cpu: Option<usize>) -> Vec<String> {
        let plan = self.plan;
        let run = &plan.args.run;
        // The scenario as written has every override in it.
        let mut words = vec!["bench".into(), path_word(&self.folder.scenario())];
        words.extend(["--rate-hz".into(), plan.rate_hz.to_string()]);
        words.extend(["--seed".into(), run.seed.to_string()]);
        words.extend(["--bus-timing".into(), run.bus_timing.word()]);
        let separate: Vec<u8> = separate_ecus(plan).collect();
        let hosted = plan.ecus().filter(|truck| !separate.contains(truck));
        words.extend(hosted.flat_map(|truck| ["--host".into(), truck.to_string()]));
        words.extend(self.common(cpu));
        words
    }

    /// The words that start the ECU of a truck.
    pub(super) fn ecu(&self, truck: u8, cpu: Option<usize>) -> Vec<String> {
        let Self { plan, folder, .. } = self;
        let mut words = vec!["controller".into(), "--truck".into(), truck.to_string()];
        let law = if plan.is_told(truck) { folder.law_of(truck) } else { folder.law() };
        words.extend(["--law".into(), path_word(&law)]);
        words.extend(["--trucks".into(), plan.trucks().to_string()]);
        words.extend(self.common(cpu));
        words
    }

    fn common(&self, cpu: Option<usize>) -> Vec<String> {
        let plan = self.plan;
        let mut words = self.bus.as_arguments();
        words.extend(["--profile".into(), plan.args.run.profile.to_string()]);
        words.extend(["--supervised".into(), "--out".into(), path_word(self.folder.path())]);
        words.extend(["--pauses".into(), path_word(self.pauses)]);
        words.extend(plan.args.law_options.as_arguments());
        words.extend(plan.args.timing.overrun.as_arguments());
        let stalls = plan.args.fault.iter().filter(|fault| is_stall(fault));
        words.extend(stalls.flat_map(|fault| ["--fault".into(), fault.to_string()]));
        words.extend(cpu.into_iter().flat_map(|cpu| ["--cpu".into(), cpu.to_string()]));
        words
    }
}

/// Whether a fault strikes inside an ECU's process.
pub(super) fn is_stall(fault: &Fault) -> bool {
    matches!(fault.kind, FaultKind::Stall { .. })
}

fn path_word(path: &Path) -> String {
    path.display().to_string()
}
