//! The command line: what can be asked, in the words users type.

mod blame_options;
mod compare_options;
mod deadline_options;
mod law_options;
mod miss_budget_options;
mod report_options;
mod step_cost_options;
mod sweep_options;
mod timing_options;
mod trace_options;
mod values;

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use platoon_dbc::Profile;
use serde::{Deserialize, Serialize};

use crate::failure::Failure;
use crate::fault::Fault;
use crate::gain::GainArgs;
use crate::live;
use crate::vcan::VcanArgs;

pub use blame_options::BlameArgs;
pub use compare_options::{CompareArgs, Part};
pub use deadline_options::{DeadlineArgs, FloorArgs, LoadArgs};
pub use law_options::{ControllerKind, LawArgs, SolverKind, UclKind};
pub use miss_budget_options::MissBudgetArgs;
pub use report_options::ReportArgs;
pub use step_cost_options::StepCostArgs;
pub use sweep_options::SweepArgs;
pub use timing_options::{OverrunArgs, SupervisedArgs, TimingArgs};
pub use trace_options::{
    CaptureArgs, DiffArgs, ExportArgs, ExportFormat, ExtractArgs, ImportArgs, PlayArgs, ReplayArgs,
    Side,
};
pub use values::{EcuChoice, V2vDelay};

use values::{parse_delay, parse_ecu, parse_gateway, parse_set};

/// What a choice is called on the command line.
pub trait Word: ValueEnum {
    /// The word users type for it.
    fn word(&self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

impl<T: ValueEnum> Word for T {}

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
    /// Measure gain and lag from the coordination layer's command to the truck's acceleration.
    Identify(IdentifyArgs),
    /// Test at which rates and under which loads this machine keeps the deadlines.
    Deadline(DeadlineArgs),
    /// Measure how late this machine wakes a thread that does nothing else, as cyclictest does.
    Floor(FloorArgs),
    /// Put a load on this machine, for `deadline`.
    #[command(hide = true)]
    Load(LoadArgs),
    /// Find how many deadlines in a row an ECU may miss, and what that costs in metres.
    MissBudget(MissBudgetArgs),
    /// Measure the CPU time of every step of the law over a whole run.
    StepCost(StepCostArgs),
    /// Inject faults of known kinds into a real loop and count the causes that it finds.
    Blame(BlameArgs),
    /// Run scenarios over many seeds and say how far from its limit every criterion stays.
    Sweep(SweepArgs),
    /// List the scenarios, or print one with all its numbers.
    Scenarios(ScenariosArgs),
    /// Design gains of the coordination layer and check what they claim.
    Gain(GainArgs),
    /// Hold the paper's claims, tables and figures against our own runs.
    Compare(CompareArgs),
    /// Make one page of a run, or of two over each other, that opens without a network.
    Report(ReportArgs),
    /// Recompute every command of a recorded run and compare bit for bit.
    Replay(ReplayArgs),
    /// Say where two recorded runs part, why, and when it shows.
    Diff(DiffArgs),
    /// Put the frames of a recorded run back on a bus, with their timing.
    Play(PlayArgs),
    /// Write a recorded run in the formats of other tools.
    Export(ExportArgs),
    /// Read a log of another tool.
    Import(ImportArgs),
    /// Cut a moment out of a recorded run, as a small trace that is a regression test.
    Extract(ExtractArgs),
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
    /// How deadlines are kept and judged.
    #[command(flatten)]
    pub timing: TimingArgs,
    /// What to break, and when: `KIND@TIME[+DURATION][:key=value,...]`, for example
    /// kill-ecu@20:truck=2, pause-ecu@30+0.5:truck=1 or stall@5+0.003:truck=1,every=1000 (the law
    /// computes 3 ms longer in one tick of 1000). May be given more than once.
    #[arg(long, value_name = "SPEC")]
    pub fault: Vec<Fault>,
    /// Let python-can, SavvyCAN and other socketcand clients attach over TCP, on this machine only
    /// or, with ADDRESS:PORT, where that address is reached. Port 0 takes any that is free.
    #[arg(long, value_name = "[ADDRESS:]PORT", value_parser = parse_gateway)]
    pub socketcand: Option<SocketAddr>,
    /// Announce the socketcand gateway by UDP broadcast on port 42000; SavvyCAN finds it only so.
    #[arg(long, requires = "socketcand")]
    pub socketcand_beacon: bool,
    /// Serve the run to Foxglove and Lichtblick while it lasts, at ws://127.0.0.1:PORT; port 0
    /// takes any that is free.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true,
        default_missing_value = live::PORT_DEFAULT)]
    pub live: Option<u16>,
    /// Show the run in the terminal while it lasts; without a terminal the progress line stays.
    #[arg(long)]
    pub tui: bool,
    /// What of the run is kept at full rate.
    #[command(flatten)]
    pub capture: CaptureArgs,
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
    /// Trucks in the platoon at most, by which --ucl synthesised and --gain DIR look the gain up;
    /// what the first mission says when left out.
    #[arg(long, value_name = "N")]
    pub trucks: Option<usize>,
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
    /// What is done about ticks that come too late.
    #[command(flatten)]
    pub overrun: OverrunArgs,
    /// A part of a run in virtual time: the ECU is given what it received there, instead of a bus.
    #[arg(long, value_name = "FILE", hide = true)]
    pub feed: Option<PathBuf>,
    /// Started by another process of this program, which listens and supervises.
    #[arg(long, hide = true)]
    pub supervised: bool,
    /// What such a process is told.
    #[command(flatten)]
    pub told: SupervisedArgs,
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
    /// What is done about ticks that come too late.
    #[command(flatten)]
    pub overrun: OverrunArgs,
    /// Started by another process of this program, which listens and supervises.
    #[arg(long, hide = true)]
    pub supervised: bool,
    /// What such a process is told.
    #[command(flatten)]
    pub told: SupervisedArgs,
    /// What rehearse and bench share.
    #[command(flatten)]
    pub run: RunArgs,
}

/// Options of `identify`.
#[derive(Debug, Clone, Args)]
pub struct IdentifyArgs {
    /// Plants, as `plant.model` names them.
    #[arg(long, value_name = "NAMES", value_delimiter = ',',
        default_values = ["single-track", "two-track"])]
    pub plant: Vec<String>,
    /// Rates of the control loop in Hz.
    #[arg(long, value_name = "HZ", value_delimiter = ',', default_values = ["50", "100", "200",
        "500", "1000"], value_parser = clap::value_parser!(u32).range(10..=10_000))]
    pub rate_hz: Vec<u32>,
    /// Override a number of plant or law, such as law.ucl.lead_time_s=1.5.
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, String)>,
    /// Where to write every figure as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
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
}
