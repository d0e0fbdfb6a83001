//! How the control law is run: the options that rehearse, bench and controller share.

use clap::{Args, ValueEnum};

use super::Word;
use crate::calibration;

/// How the control law is run.
#[derive(Debug, Clone, Args)]
pub struct LawArgs {
    /// Controller in the ECUs; the scenario's own, usually mcf, when left out.
    #[arg(long, value_enum)]
    pub controller: Option<ControllerKind>,
    /// QP solver of the motion layer.
    #[arg(long, value_enum, default_value_t = SolverKind::ActiveSet)]
    pub solver: SolverKind,
    /// How Eq. 4's delays are read.
    #[arg(long, value_enum)]
    pub delay_reading: Option<DelayReadingKind>,
    /// Law of the coordination layer; the scenario's own when left out.
    #[arg(long, value_enum)]
    pub ucl: Option<UclKind>,
    /// Gain of the coordination layer: a gain file, a name that `platoon gain list` shows, or a
    /// folder of gain files, of which the best for platoon and truck is taken.
    #[arg(long, value_name = "FILE|NAME|DIR")]
    pub gain: Option<String>,
    /// Drive even with a gain that is not certified for its lag and its delays.
    #[arg(long)]
    pub uncertified: bool,
    /// Let the law drive alone: the guard's emergency layer does not brake.
    #[arg(long)]
    pub no_emergency_braking: bool,
}

impl LawArgs {
    /// The calibration with what these options say about it.
    pub fn applied_to(&self, mut calibration: law::Calibration) -> law::Calibration {
        if let Some(controller) = self.controller {
            calibration.structure = controller.into();
        }
        if let Some(reading) = self.delay_reading {
            calibration.ucl.delay_reading = reading.into();
        }
        if let Some(ucl) = self.ucl {
            calibration::coordinate_by(&mut calibration, ucl.into());
        }
        calibration
    }

    /// The same options for another process.
    pub fn as_arguments(&self) -> Vec<String> {
        let options = [
            Some(("--solver", self.solver.word())),
            self.gain.as_ref().map(|gain| ("--gain", gain.clone())),
            self.controller.map(|controller| ("--controller", controller.word())),
            self.delay_reading.map(|reading| ("--delay-reading", reading.word())),
            self.ucl.map(|ucl| ("--ucl", ucl.word())),
        ];
        let pairs = options.into_iter().flatten();
        let flags = [
            self.no_emergency_braking.then_some("--no-emergency-braking"),
            self.uncertified.then_some("--uncertified"),
        ];
        let flags = flags.into_iter().flatten().map(str::to_owned);
        pairs.flat_map(|(flag, word)| [flag.to_owned(), word]).chain(flags).collect()
    }
}

/// Controllers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum ControllerKind {
    /// The paper's motion control framework: H-infinity coordination over potential-field MPC.
    Mcf,
    /// The paper's baseline: one potential-field MPC that tracks its slot itself.
    SingleMpc,
    /// Distributed MPC of Zheng et al., every truck listening to the one ahead.
    DmpcPf,
    /// The same, every truck listening to the one ahead and to the leader.
    DmpcPlf,
}

impl From<ControllerKind> for law::Structure {
    fn from(kind: ControllerKind) -> Self {
        match kind {
            ControllerKind::Mcf => Self::Mcf,
            ControllerKind::SingleMpc => Self::SingleMpc,
            ControllerKind::DmpcPf => Self::DmpcPf,
            ControllerKind::DmpcPlf => Self::DmpcPlf,
        }
    }
}

/// QP solvers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SolverKind {
    /// Our dense dual active-set method.
    ActiveSet,
    /// Clarabel, the interior-point reference.
    Clarabel,
}

/// Readings of Eq. 4's delays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DelayReadingKind {
    /// Both ends of every difference equally old: as printed.
    Eq4,
    /// Own state current, leader's position stale.
    LeaderStale,
    /// As leader-stale, in a frame at the set speed.
    FrameStale,
    /// Received states extrapolated to now.
    Compensated,
}

impl From<DelayReadingKind> for law::DelayReading {
    fn from(kind: DelayReadingKind) -> Self {
        match kind {
            DelayReadingKind::Eq4 => Self::Eq4,
            DelayReadingKind::LeaderStale => Self::LeaderStale,
            DelayReadingKind::FrameStale => Self::FrameStale,
            DelayReadingKind::Compensated => Self::Compensated,
        }
    }
}

/// Laws of the coordination layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum UclKind {
    /// The paper's H-infinity gain.
    Published,
    /// The same, with the leader's acceleration fed forward.
    Feedforward,
    /// A gain of the library, looked up by platoon size, what is driven, and delay bound.
    Synthesised,
    /// The constant-spacing law of the California PATH platoons.
    CaccPath,
    /// Ploeg's law with a constant time gap.
    Ploeg,
    /// No coordination: every truck holds the set speed.
    None,
}

impl From<UclKind> for law::CoordinationLaw {
    fn from(kind: UclKind) -> Self {
        match kind {
            UclKind::Published => Self::Published,
            UclKind::Feedforward => Self::Feedforward,
            UclKind::Synthesised => Self::Synthesised,
            UclKind::CaccPath => Self::CaccPath,
            UclKind::Ploeg => Self::Ploeg,
            UclKind::None => Self::None,
        }
    }
}
