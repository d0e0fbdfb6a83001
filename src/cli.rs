//! The command line: what can be asked, in the words users type.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use platoon_dbc::Profile;
use serde::{Deserialize, Serialize};

use crate::failure::Failure;
use crate::fault::Fault;
use crate::vcan::VcanArgs;

/// Rehearses a truck-platoon hardware-in-the-loop test over CAN, on this computer.
///
/// Without a verb it rehearses obstacle avoidance with V2V delay on the best bus there is.
#[derive(Debug, Parser)]
#[command(name = "platoon", version, args_conflicts_with_subcommands = true)]
pub struct Cli {
    /// What to do; `rehearse` when left out.
    #[command(subcommand)]
    pub verb: Option<Verb>,
    /// The options of `rehearse`.
    #[command(flatten)]
    pub rehearse: RehearseArgs,
}

/// The verbs.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Run rig and ECUs together and judge the outcome.
    Rehearse(RehearseArgs),
    /// Run one truck's ECU, for a target machine.
    Controller(ControllerArgs),
    /// Run the rig alone and wait for ECUs elsewhere.
    Bench(BenchArgs),
    /// List the scenarios, or print one with all its numbers.
    Scenarios(ScenariosArgs),
    /// Make this machine ready: virtual CAN interfaces, or a kernel that has CAN.
    Vcan(VcanArgs),
}

/// Options of `rehearse`.
#[derive(Debug, Clone, Args)]
pub struct RehearseArgs {
    /// Scenario: a built-in name (see `platoon scenarios`) or the path of a TOML file.
    #[arg(default_value = "obstacle-avoidance")]
    pub scenario: String,
    /// Bus between rig and ECUs.
    #[arg(long, value_enum, default_value_t = BusKind::Auto)]
    pub bus: BusKind,
    /// Where the bus is.
    #[command(flatten)]
    pub place: BusPlace,
    /// One process, loopback bus, as fast as the processor allows, bit-identical for a seed.
    #[arg(long)]
    pub virtual_time: bool,
    /// Which ECUs run as processes of their own: all, or one truck's; the others then run beside
    /// the rig, as in the paper's experiment.
    #[arg(long, value_name = "all|N", default_value = "all", value_parser = parse_ecu)]
    pub ecu: EcuChoice,
    /// How the law is run.
    #[command(flatten)]
    pub law_options: LawArgs,
    /// V2V delay LO-HI in milliseconds, or none.
    #[arg(long, value_name = "LO-HI|none", value_parser = parse_delay)]
    pub v2v_delay: Option<V2vDelay>,
    /// What to break, and when: `KIND@TIME[+DURATION][:key=value,...]`, for example
    /// kill-ecu@20:truck=2 or pause-ecu@30+0.5:truck=1. May be given more than once.
    #[arg(long, value_name = "SPEC")]
    pub fault: Vec<Fault>,
    /// Let python-can, SavvyCAN and other socketcand clients attach over TCP, on this machine only
    /// or, with ADDRESS:PORT, where that address is reached. Port 0 takes any that is free.
    #[arg(long, value_name = "[ADDRESS:]PORT", value_parser = parse_gateway)]
    pub socketcand: Option<SocketAddr>,
    /// Announce the socketcand gateway by UDP broadcast on port 42000; SavvyCAN finds it only so.
    #[arg(long, requires = "socketcand")]
    pub socketcand_beacon: bool,
    /// Folder for the run's files; it must not hold a run already
    /// (default: `runs/<time>-<scenario>`).
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Where to write the summary as JSON, beside summary.json in the run's folder.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// What rehearse and bench share.
    #[command(flatten)]
    pub run: RunArgs,
}

/// Where the socketcand gateway is and whether it says so.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GatewayPlace {
    /// Address and port it listens at.
    pub address: SocketAddr,
    /// Whether it announces itself.
    pub has_beacon: bool,
}

impl RehearseArgs {
    /// The gateway, if one is asked for.
    pub fn gateway(&self) -> Option<GatewayPlace> {
        let has_beacon = self.socketcand_beacon;
        self.socketcand.map(|address| GatewayPlace { address, has_beacon })
    }
}

/// What every run has.
#[derive(Debug, Clone, Args)]
pub struct RunArgs {
    /// How the buses carry messages: fd (CAN FD, a frame per message) or j1939 (classic CAN,
    /// standard parameter groups, at most 100 Hz).
    #[arg(long, value_name = "fd|j1939", default_value_t = Profile::Fd)]
    pub profile: Profile,
    /// Rate of the control loop in Hz (default: 1000, or 100 with --profile j1939).
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(10..=10_000))]
    pub rate_hz: Option<u32>,
    /// Whether frames arrive at once, or take the time of a real bus with the profile's bit rates,
    /// in the order of arbitration.
    #[arg(long, value_enum, default_value_t = BusTimingKind::Ideal)]
    pub bus_timing: BusTimingKind,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// End after this many seconds of bench time instead of the scenario's own.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub duration_s: Option<f64>,
    /// Override a number of the scenario; may be given more than once.
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, String)>,
}

impl RunArgs {
    /// Loop rate when none is asked for \[Hz\].
    const RATE_DEFAULT_HZ: u32 = 1000;

    /// Rate of the control loop \[Hz\].
    ///
    /// # Errors
    /// When the profile cannot carry it.
    pub fn rate_hz(&self) -> Result<u32, Failure> {
        let most_hz = self.profile.loop_rate_max_hz();
        match self.rate_hz {
            None => Ok(Self::RATE_DEFAULT_HZ.min(most_hz)),
            Some(rate_hz) if rate_hz <= most_hz => Ok(rate_hz),
            Some(rate_hz) => Err(Failure::usage(format!(
                "--rate-hz {rate_hz}: the profile {} carries at most {most_hz} Hz; ask for less, \
                 or for another --profile",
                self.profile
            ))),
        }
    }
}

/// How the control law is run.
#[derive(Debug, Clone, Copy, Args)]
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
            calibration.ucl.law = ucl.into();
        }
        calibration
    }

    /// The same options for another process.
    pub fn as_arguments(&self) -> Vec<String> {
        let reading = self.delay_reading.map(|reading| ["--delay-reading", reading.word()]);
        let ucl = self.ucl.map(|ucl| ["--ucl", ucl.word()]);
        let controller = self.controller.map(|controller| ["--controller", controller.word()]);
        ["--solver", self.solver.word()]
            .into_iter()
            .chain(controller.into_iter().chain(reading).chain(ucl).flatten())
            .map(str::to_owned)
            .collect()
    }
}

/// Where a bus is and what may be done with it.
#[derive(Debug, Clone, Default, Args)]
pub struct BusPlace {
    /// CAN interfaces, one per truck, instead of truck0, truck1, ...
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub interfaces: Vec<String>,
    /// Use interfaces that carry other traffic already.
    #[arg(long)]
    pub share: bool,
    /// Allow commands on a physical CAN interface: real actuators may move.
    #[arg(long)]
    pub arm: bool,
    /// UDP port of the udp bus; without it the first free one from 43113 on.
    #[arg(long, value_name = "PORT")]
    pub port: Option<u16>,
}

/// Options of `controller`.
#[derive(Debug, Clone, Args)]
pub struct ControllerArgs {
    /// The truck this ECU drives; 0 is the leader.
    #[arg(long, value_name = "N")]
    pub truck: u8,
    /// Bus to the rig.
    #[arg(long, value_enum, default_value_t = BusKind::Auto)]
    pub bus: BusKind,
    /// Where the bus is.
    #[command(flatten)]
    pub place: BusPlace,
    /// How the bus carries messages: fd or j1939, as the rig does.
    #[arg(long, value_name = "fd|j1939", default_value_t = Profile::Fd)]
    pub profile: Profile,
    /// Calibration of the law: a TOML file with the keys a scenario has under `law`.
    #[arg(long, value_name = "FILE")]
    pub law: Option<PathBuf>,
    /// How the law is run.
    #[command(flatten)]
    pub law_options: LawArgs,
    /// Folder for this ECU's recording and report.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
    /// CPU to run on.
    #[arg(long, value_name = "CPU")]
    pub cpu: Option<usize>,
    /// Started by another process of this program, which listens and supervises.
    #[arg(long, hide = true)]
    pub supervised: bool,
}

/// Options of `bench`.
#[derive(Debug, Clone, Args)]
pub struct BenchArgs {
    /// Scenario: a built-in name or the path of a TOML file.
    #[arg(default_value = "obstacle-avoidance")]
    pub scenario: String,
    /// Bus to the ECUs.
    #[arg(long, value_enum, default_value_t = BusKind::Auto)]
    pub bus: BusKind,
    /// Where the bus is.
    #[command(flatten)]
    pub place: BusPlace,
    /// Trucks whose ECUs this process runs itself, beside the rig.
    #[arg(long, value_name = "N,N,...", value_delimiter = ',')]
    pub host: Vec<u8>,
    /// How the law is run in the ECUs hosted here.
    #[command(flatten)]
    pub law_options: LawArgs,
    /// V2V delay LO-HI in milliseconds, or none.
    #[arg(long, value_name = "LO-HI|none", value_parser = parse_delay)]
    pub v2v_delay: Option<V2vDelay>,
    /// Folder for the rig's recording and results.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
    /// CPU to run on.
    #[arg(long, value_name = "CPU")]
    pub cpu: Option<usize>,
    /// Started by another process of this program, which listens and supervises.
    #[arg(long, hide = true)]
    pub supervised: bool,
    /// What rehearse and bench share.
    #[command(flatten)]
    pub run: RunArgs,
}

/// Options of `scenarios`.
#[derive(Debug, Clone, Args)]
pub struct ScenariosArgs {
    /// Scenario to print; all are listed when left out.
    pub name: Option<String>,
}

/// Kinds of bus one may ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BusKind {
    /// vcan when the kernel has it, else udp.
    Auto,
    /// CAN interfaces of the kernel.
    Socketcan,
    /// UDP multicast on the loopback interface, python-can's format.
    Udp,
    /// In memory, virtual time only.
    Loopback,
}

/// How long frames take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BusTimingKind {
    /// No time but what the machine takes.
    Ideal,
    /// What a real bus with the profile's bit rates would make them wait and take.
    Emulate,
}

impl BusTimingKind {
    /// The word on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::Ideal => "ideal",
            Self::Emulate => "emulate",
        }
    }
}

/// Controllers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ControllerKind {
    /// The paper's motion control framework: H-infinity coordination over potential-field MPC.
    Mcf,
    /// The paper's baseline: one potential-field MPC that tracks its slot itself.
    SingleMpc,
}

impl ControllerKind {
    /// The word on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::Mcf => "mcf",
            Self::SingleMpc => "single-mpc",
        }
    }
}

impl From<ControllerKind> for law::Structure {
    fn from(kind: ControllerKind) -> Self {
        match kind {
            ControllerKind::Mcf => Self::Mcf,
            ControllerKind::SingleMpc => Self::SingleMpc,
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

impl SolverKind {
    /// The word on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::ActiveSet => "active-set",
            Self::Clarabel => "clarabel",
        }
    }
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

impl DelayReadingKind {
    /// The word on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::Eq4 => "eq4",
            Self::LeaderStale => "leader-stale",
            Self::FrameStale => "frame-stale",
            Self::Compensated => "compensated",
        }
    }
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
    /// The constant-spacing law of the California PATH platoons.
    CaccPath,
    /// Ploeg's law with a constant time gap.
    Ploeg,
    /// No coordination: every truck holds the set speed.
    None,
}

impl UclKind {
    /// The word on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::Published => "published",
            Self::Feedforward => "feedforward",
            Self::CaccPath => "cacc-path",
            Self::Ploeg => "ploeg",
            Self::None => "none",
        }
    }
}

impl From<UclKind> for law::CoordinationLaw {
    fn from(kind: UclKind) -> Self {
        match kind {
            UclKind::Published => Self::Published,
            UclKind::Feedforward => Self::Feedforward,
            UclKind::CaccPath => Self::CaccPath,
            UclKind::Ploeg => Self::Ploeg,
            UclKind::None => Self::None,
        }
    }
}

/// Which ECUs are processes under test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EcuChoice {
    /// Every truck's.
    All,
    /// One truck's; the rest run beside the rig.
    One(u8),
}

/// Bounds of the V2V transport delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct V2vDelay {
    /// Least delay \[s\].
    pub min_s: f64,
    /// Largest delay \[s\].
    pub max_s: f64,
}

impl V2vDelay {
    /// The scenario overrides that say the same.
    pub fn as_sets(self) -> [(String, String); 2] {
        [("v2v.delay_min_s", self.min_s), ("v2v.delay_max_s", self.max_s)]
            .map(|(key, value)| (key.to_owned(), format!("{value:?}")))
    }
}

fn parse_ecu(text: &str) -> Result<EcuChoice, String> {
    match text {
        "all" => Ok(EcuChoice::All),
        number => number
            .parse()
            .map(EcuChoice::One)
            .map_err(|_| "give all, or the number of a truck from 0 (the leader) on".to_owned()),
    }
}

fn parse_delay(text: &str) -> Result<V2vDelay, String> {
    const FORM: &str = "give LO-HI in milliseconds, such as 15-150, or none";
    if text == "none" {
        return Ok(V2vDelay { min_s: 0.0, max_s: 0.0 });
    }
    let (low, high) = text.split_once('-').ok_or(FORM)?;
    let number =
        |part: &str| part.trim().parse::<f64>().ok().filter(|x| x.is_finite() && *x >= 0.0);
    match (number(low), number(high)) {
        (Some(low), Some(high)) if low <= high => {
            Ok(V2vDelay { min_s: 1e-3 * low, max_s: 1e-3 * high })
        }
        (Some(_), Some(_)) => Err(format!("the lower delay is above the upper; {FORM}")),
        _ => Err(FORM.to_owned()),
    }
}

fn parse_gateway(text: &str) -> Result<SocketAddr, String> {
    let port = text.parse().map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    port.or_else(|_| text.parse()).map_err(|_| {
        "give a port, such as 29536, or ADDRESS:PORT, such as 192.168.0.7:29536".to_owned()
    })
}

fn parse_set(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => {
            Ok((key.trim().to_owned(), value.trim().to_owned()))
        }
        _ => Err("give KEY=VALUE, such as v2v.loss=0.1".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn no_arguments_mean_the_main_rehearsal() {
        let cli = Cli::parse_from(["platoon"]);
        assert!(cli.verb.is_none());
        assert_eq!(cli.rehearse.scenario, "obstacle-avoidance");
        assert_eq!(cli.rehearse.run.rate_hz().ok(), Some(1000));
    }

    #[test]
    fn a_profile_brings_its_rate_and_refuses_a_faster_one() {
        let rate = |words: &[&str]| {
            Cli::parse_from([&["platoon"], words].concat()).rehearse.run.rate_hz().ok()
        };
        assert_eq!(rate(&["--profile", "j1939"]), Some(100));
        assert_eq!(rate(&["--profile", "j1939", "--rate-hz", "50"]), Some(50));
        assert_eq!(rate(&["--profile", "j1939", "--rate-hz", "101"]), None);
        assert_eq!(rate(&["--rate-hz", "2000"]), Some(2000));
    }

    #[test]
    fn a_gateway_is_on_this_machine_unless_an_address_is_given() {
        let gateway = |words: &[&str]| {
            Cli::try_parse_from([&["platoon", "--socketcand"], words].concat())
                .map(|cli| cli.rehearse.gateway().map(|place| place.address.to_string()))
        };
        assert_eq!(gateway(&["29536"]).ok(), Some(Some("127.0.0.1:29536".into())));
        assert_eq!(gateway(&["0.0.0.0:1"]).ok(), Some(Some("0.0.0.0:1".into())));
        assert_eq!(gateway(&["[::1]:1"]).ok(), Some(Some("[::1]:1".into())));
        for nonsense in ["70000", "here", "127.0.0.1", "127.0.0.1:"] {
            assert!(gateway(&[nonsense]).is_err(), "{nonsense}");
        }
    }

    #[test]
    fn delays_are_read_in_milliseconds_and_nonsense_is_refused() {
        let delay = parse_delay("15-150").expect("well formed");
        assert!((delay.min_s - 0.015).abs() < 1e-12 && (delay.max_s - 0.15).abs() < 1e-12);
        assert_eq!(parse_delay("none"), Ok(V2vDelay { min_s: 0.0, max_s: 0.0 }));
        for nonsense in ["", "15", "150-15", "a-b", "-5-10", "NaN-1", "1-inf"] {
            assert!(parse_delay(nonsense).is_err(), "{nonsense}");
        }
    }
}
