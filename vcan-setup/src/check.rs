//! What a rehearsal finds on this machine: CAN, and how ready it is for real time.
//!
//! Everything is read, nothing is changed: whether an interface could be made is told from the
//! process's rights and the kernel's list of modules, not by making one.

use std::fmt;
use std::fs;
use std::path::Path;
use std::time::Duration;

use rustix::fs::{Access, access};
use serde::Serialize;

use crate::can::{self, CanSupport};
use crate::host::{Host, Lack};
use crate::kernel::{Kernel, KernelError};
use crate::link::Link;
use crate::realtime::{CAP_IPC_LOCK, CAP_NET_ADMIN, CAP_SYS_NICE, Environment, has_capability};

/// Real-time priority from which a rehearsal's processes get what they ask for.
const RTPRIO_WANTED: u64 = 81;
/// Locked memory \[bytes\] from which a rehearsal's processes lock theirs.
const MEMLOCK_WANTED: u64 = 1 << 30;
/// Clock sources that cost a function call to read; the others cost a trip to a device.
const QUICK_CLOCKS: [&str; 5] = ["tsc", "kvm-clock", "arch_sys_counter", "hyperv", "xen"];

/// How good a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// As it should be.
    Ok,
    /// A rehearsal runs all the same, but less well, or not without help.
    Warn,
    /// A rehearsal over vcan cannot run.
    Missing,
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Ok => "ok",
            Self::Warn => "warn",
            Self::Missing => "missing",
        })
    }
}

/// One thing looked at.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub subject: String,
    /// How good it is.
    pub state: State,
    /// What was found.
    pub found: String,
    /// What makes it better; none when nothing needs to.
    pub remedy: Option<String>,
}

impl Finding {
    fn ok(subject: &str, found: impl Into<String>) -> Self {
        Self { subject: subject.into(), state: State::Ok, found: found.into(), remedy: None }
    }

    fn bad(
        state: State,
        subject: &str,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let remedy = Some(remedy.into());
        Self { subject: subject.into(), state, found: found.into(), remedy }
    }

    fn warn(subject: &str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::bad(State::Warn, subject, found, remedy)
    }
}

/// Everything found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Findings {
    /// The machine in words.
    pub host: String,
    /// Whether a rehearsal over these interfaces can run here.
    pub can_rehearse: bool,
    /// CAN, in the order in which one thing needs the other.
    pub can: Vec<Finding>,
    /// Readiness for real time.
    pub real_time: Vec<Finding>,
}

/// Looks at everything; `kernel` is what was found to boot instead of this machine's kernel. The
/// traffic on the interfaces is counted during `watch`.
#[must_use]
pub fn look(
    names: &[&str],
    kernel: &Result<Kernel, KernelError>,
    environment: &Environment,
    watch: Duration,
) -> Findings {
    let host = Host::detect();
    let mut can = vec![can_sockets(&host)];
    let driver = driver(&environment.kernel, &host);
    let admin = has_capability(CAP_NET_ADMIN);
    let makeable = driver.state == State::Ok && can[0].state == State::Ok && admin;
    let interfaces = interfaces(names, makeable, watch);
    let all_there = interfaces.iter().all(|finding| finding.state == State::Ok);
    can.push(driver);
    can.push(net_admin(admin, all_there, &host));
    can.extend(interfaces);
    // An interface that is there proves that its driver is.
    if all_there && !names.is_empty() {
        can[1] = Finding::ok(DRIVER, "makes interfaces");
    }
    let backlog = fs::read_to_string("/proc/net/softnet_stat").unwrap_or_default();
    can.push(dropped(dropped_frames(&backlog)));
    let can_rehearse = can.iter().all(|finding| finding.state < State::Missing);
    can.push(way_out(kernel, &host));
    Findings {
        host: host.name.clone(),
        can_rehearse,
        can,
        real_time: real_time(environment, &host),
    }
}

const DRIVER: &str = "vcan driver";

fn can_sockets(host: &Host) -> Finding {
    let subject = "CAN sockets";
    match can::kernel_support() {
        CanSupport::Available => Finding::ok(subject, "AF_CAN and its raw protocol open"),
        CanSupport::NoAddressFamily => Finding::bad(
            State::Missing,
            subject,
            "the kernel has no AF_CAN (EAFNOSUPPORT)",
            host.remedy(Lack::Can),
        ),
        CanSupport::NoRawProtocol => Finding::bad(
            State::Missing,
            subject,
            "the kernel has AF_CAN without its raw protocol",
            host.remedy(Lack::Can),
        ),
        CanSupport::NotPermitted => Finding::bad(
            State::Missing,
            subject,
            "this process may not open them",
            "allow AF_CAN in its seccomp profile",
        ),
        CanSupport::Refused(errno) => Finding::bad(
            State::Missing,
            subject,
            std::io::Error::from_raw_os_error(errno).to_string(),
            "see dmesg",
        ),
    }
}

/// The driver, as far as that can be known without an interface.
fn driver(release: &str, host: &Host) -> Finding {
    if Path::new("/sys/module/vcan").exists() {
        return Finding::ok(DRIVER, "loaded");
    }
    let list = |name| {
        let path = format!("/lib/modules/{release}/{name}");
        fs::read_to_string(path).unwrap_or_default().contains("/vcan.ko")
    };
    if list("modules.builtin") {
        Finding::ok(DRIVER, "built into the kernel")
    } else if list("modules.dep") {
        Finding::ok(DRIVER, "not loaded; the kernel loads it with the first interface")
    } else {
        let found = format!("no module for kernel {release}");
        Finding::bad(State::Missing, DRIVER, found, host.remedy(Lack::Can))
    }
}

fn net_admin(admin: bool, all_there: bool, host: &Host) -> Finding {
    let subject = "CAP_NET_ADMIN";
    if admin {
        Finding::ok(subject, "this process may make interfaces")
    } else if all_there {
        Finding::ok(subject, "not held; the interfaces are there already")
    } else {
        let found = "this process may not make interfaces";
        Finding::bad(State::Missing, subject, found, host.remedy(Lack::NetAdmin))
    }
}

/// The interfaces, with what passes them.
fn interfaces(names: &[&str], makeable: bool, watch: Duration) -> Vec<Finding> {
    let before: Vec<_> = names.iter().map(|name| Link::find(name)).collect();
    if before.iter().any(|link| matches!(link, Ok(Some(_)))) {
        std::thread::sleep(watch);
    }
    let packets = |name: &str, before: &Link| {
        let now = Link::find(name).ok().flatten();
        now.map_or(0, |now| now.packets.saturating_sub(before.packets))
    };
    let look = |(name, before): (&&str, std::io::Result<Option<Link>>)| match before {
        Ok(Some(link)) => interface(name, &link, packets(name, &link), watch),
        Ok(None) if makeable => {
            Finding::warn(name, "not there; a run makes it and removes it", "platoon vcan up")
        }
        Ok(None) => Finding::bad(State::Missing, name, "not there", "platoon vcan up, as root"),
        Err(error) => Finding::bad(State::Missing, name, error.to_string(), "see ip link"),
    };
    names.iter().zip(before).map(look).collect()
}

/// One interface that is there.
fn interface(name: &str, link: &Link, packets: u64, watch: Duration) -> Finding {
    let kind = link.kind.as_deref().unwrap_or("hardware");
    let state = if link.is_up { "up" } else { "down" };
    let traffic = match packets {
        0 => "quiet".to_owned(),
        packets => format!("{packets} frames in {} ms", watch.as_millis()),
    };
    let found = format!("{kind}, MTU {}, {state}, {traffic}", link.mtu);
    let remedy = match can::fitness(name, link) {
        Err(error) => Some((State::Missing, error.to_string())),
        Ok(()) if packets > 0 => {
            Some((State::Missing, "end the program that sends, or run with --share".to_owned()))
        }
        Ok(()) if !link.is_up => Some((State::Warn, "platoon vcan up".to_owned())),
        Ok(()) => None,
    };
    match remedy {
        None => Finding::ok(name, found),
        Some((state, remedy)) => Finding::bad(state, name, found, remedy),
    }
}

/// Frames and packets that this machine has dropped since boot because the backlog of a CPU was
/// full: the second column of /proc/net/softnet_stat, hexadecimal, a line for each CPU.
fn dropped_frames(softnet: &str) -> u64 {
    let column = |line: &str| u64::from_str_radix(line.split_whitespace().nth(1)?, 16).ok();
    softnet.lines().filter_map(column).sum()
}

fn dropped(frames: u64) -> Finding {
    let subject = "kernel backlog";
    if frames == 0 {
        return Finding::ok(subject, "nothing dropped since boot");
    }
    let found = format!("{frames} frames or packets dropped since boot");
    Finding::warn(subject, found, "sudo sysctl net.core.netdev_max_backlog=100000")
}

/// The kernel that can be booted instead.
fn way_out(kernel: &Result<Kernel, KernelError>, host: &Host) -> Finding {
    let subject = "kernel to boot";
    match kernel {
        Ok(kernel) => {
            let found = format!(
                "{} {}: `platoon vcan shell -- CMD` runs CMD in it",
                kernel.path.display(),
                kernel.release
            );
            Finding::ok(subject, found)
        }
        Err(KernelError::NotInstalled) => {
            Finding::warn(subject, "no linux.uml on the PATH", host.remedy(Lack::UserModeLinux))
        }
        Err(error) => Finding::warn(subject, error.to_string(), "platoon vcan shell --help"),
    }
}

/// What makes deadlines hold, from the machine's facts.
fn real_time(environment: &Environment, host: &Host) -> Vec<Finding> {
    vec![
        preempt_rt(environment, host),
        priority(environment.rtprio_limit, has_capability(CAP_SYS_NICE)),
        locked_memory(environment.memlock_limit_bytes, has_capability(CAP_IPC_LOCK)),
        governor(&environment.governors),
        isolated_cpus(environment),
        timers(environment.timer_resolution_ns),
        clock_source(environment.clocksource.as_deref()),
        idle_states(Path::new("/dev/cpu_dma_latency")),
        machine(environment.virtual_machine),
    ]
}

fn preempt_rt(environment: &Environment, host: &Host) -> Finding {
    let subject = "PREEMPT_RT";
    if environment.preempt_rt {
        Finding::ok(subject, environment.kernel.as_str())
    } else {
        let found = format!("not a real-time kernel: {}", environment.kernel);
        Finding::warn(subject, found, host.remedy(Lack::PreemptRt))
    }
}

fn priority(limit: Option<u64>, privileged: bool) -> Finding {
    let subject = "rtprio limit";
    match limit {
        _ if privileged => Finding::ok(subject, "any priority (CAP_SYS_NICE)"),
        None => Finding::ok(subject, "unlimited"),
        Some(limit) if limit >= RTPRIO_WANTED => Finding::ok(subject, limit.to_string()),
        Some(limit) => Finding::warn(
            subject,
            format!("{limit}, a rehearsal asks for {RTPRIO_WANTED}"),
            limits_line("rtprio", "95"),
        ),
    }
}

fn locked_memory(limit_bytes: Option<u64>, privileged: bool) -> Finding {
    let subject = "memlock limit";
    match limit_bytes {
        _ if privileged => Finding::ok(subject, "any amount (CAP_IPC_LOCK)"),
        None => Finding::ok(subject, "unlimited"),
        Some(bytes) if bytes >= MEMLOCK_WANTED => {
            Finding::ok(subject, format!("{} MiB", bytes >> 20))
        }
        Some(bytes) => Finding::warn(
            subject,
            format!("{} KiB, too little to lock a process", bytes >> 10),
            limits_line("memlock", "unlimited"),
        ),
    }
}

fn limits_line(item: &str, value: &str) -> String {
    format!(
        "echo \"$USER - {item} {value}\" | sudo tee -a /etc/security/limits.d/platoon.conf, and \
         log in again"
    )
}

fn governor(governors: &[String]) -> Finding {
    let subject = "CPU governor";
    if governors.is_empty() {
        Finding::ok(subject, "no frequency control here")
    } else if governors.iter().all(|governor| governor == "performance") {
        Finding::ok(subject, "performance")
    } else {
        Finding::warn(
            subject,
            governors.join(", "),
            "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
        )
    }
}

fn isolated_cpus(environment: &Environment) -> Finding {
    let subject = "isolated CPUs";
    let (isolated, online) = (&environment.isolated_cpus, environment.online_cpus.len());
    if isolated.is_empty() {
        let found = format!("none of {online}");
        let remedy = match online {
            4.. => format!("boot with isolcpus=2-{} and rehearse on these", online - 1),
            _ => "a machine with 4 CPUs or more has some to spare".into(),
        };
        Finding::warn(subject, found, remedy)
    } else {
        Finding::ok(subject, format!("{} of {online}", isolated.len()))
    }
}

fn timers(resolution_ns: u64) -> Finding {
    let subject = "timer resolution";
    let found = format!("{resolution_ns} ns");
    if resolution_ns == 1 {
        Finding::ok(subject, found)
    } else {
        Finding::warn(subject, found, "boot with highres=on, a kernel with CONFIG_HIGH_RES_TIMERS")
    }
}

fn clock_source(source: Option<&str>) -> Finding {
    let subject = "clock source";
    let found = source.unwrap_or("unknown");
    if QUICK_CLOCKS.iter().any(|quick| found.starts_with(quick)) {
        Finding::ok(subject, found)
    } else {
        Finding::warn(subject, found, "boot with clocksource=tsc tsc=reliable where that is true")
    }
}

fn idle_states(file: &Path) -> Finding {
    let subject = "CPU idle states";
    if access(file, Access::WRITE_OK).is_ok() {
        return Finding::ok(subject, format!("{} may be held", file.display()));
    }
    let found = match file.exists() {
        true => format!("{} is not ours to hold", file.display()),
        false => format!("no {}: CPUs may idle deeply", file.display()),
    };
    let remedy = "echo 'KERNEL==\"cpu_dma_latency\", MODE=\"0666\"' | sudo tee \
                  /etc/udev/rules.d/99-cpu-dma-latency.rules, and reboot";
    Finding::warn(subject, found, remedy)
}

fn machine(is_virtual: bool) -> Finding {
    let subject = "machine";
    if is_virtual {
        Finding::warn(
            subject,
            "a guest of a hypervisor, which takes CPU time as it likes",
            "judge deadlines on the target, or on bare metal",
        )
    } else {
        Finding::ok(subject, "no hypervisor")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::realtime::environment;

    fn link(kind: &str, mtu: u32, is_up: bool) -> Link {
        Link { index: 7, kind: Some(kind.into()), mtu, is_up, packets: 0 }
    }

    #[test]
    fn an_interface_is_judged_by_kind_size_state_and_traffic() {
        let watch = Duration::from_millis(250);
        let state = |link: &Link, packets| interface("truck0", link, packets, watch).state;
        assert_eq!(state(&link("vcan", 72, true), 0), State::Ok);
        assert_eq!(state(&link("vcan", 72, true), 9), State::Missing);
        assert_eq!(state(&link("vcan", 72, false), 0), State::Warn);
        assert_eq!(state(&link("vcan", 16, true), 0), State::Missing);
        assert_eq!(state(&link("dummy", 1500, true), 0), State::Missing);
        let found = interface("truck0", &link("vcan", 72, true), 9, watch).found;
        assert_eq!(found, "vcan, MTU 72, up, 9 frames in 250 ms");
    }

    #[test]
    fn an_interface_that_can_be_made_is_no_obstacle() {
        let state = |makeable| interfaces(&["no-such-link"], makeable, Duration::ZERO)[0].state;
        assert_eq!((state(true), state(false)), (State::Warn, State::Missing));
    }

    #[test]
    fn whatever_is_not_ok_has_a_remedy_and_whatever_is_has_none() {
        let findings = look(
            &["lo", "no-such-link"],
            &Err(KernelError::NotInstalled),
            &environment(),
            Duration::ZERO,
        );
        for finding in findings.can.iter().chain(&findings.real_time) {
            assert_eq!(finding.state == State::Ok, finding.remedy.is_none(), "{finding:?}");
            assert!(!finding.found.is_empty(), "{finding:?}");
        }
        assert!(!findings.can_rehearse, "lo is no vcan");
    }

    #[test]
    fn what_the_backlogs_dropped_is_summed_over_the_cpus() {
        let softnet = "00004109 000008f1 00000000\n00000010 00000001 00000000\n";
        assert_eq!(dropped_frames(softnet), 0x8f2);
        assert_eq!(dropped_frames(""), 0);
        assert_eq!((dropped(0).state, dropped(1).state), (State::Ok, State::Warn));
    }

    #[test]
    fn limits_count_only_for_those_without_privilege() {
        assert_eq!(priority(Some(0), true).state, State::Ok);
        assert_eq!(priority(Some(80), false).state, State::Warn);
        assert_eq!(priority(Some(99), false).state, State::Ok);
        assert_eq!(locked_memory(Some(8 << 20), false).state, State::Warn);
        assert_eq!(locked_memory(Some(8 << 20), true).state, State::Ok);
        assert_eq!(locked_memory(None, false).state, State::Ok);
    }

    #[test]
    fn the_clocks_and_governors_that_are_good_are_told_from_the_others() {
        assert_eq!(clock_source(Some("tsc")).state, State::Ok);
        assert_eq!(clock_source(Some("hpet")).state, State::Warn);
        assert_eq!(clock_source(None).state, State::Warn);
        assert_eq!(timers(1).state, State::Ok);
        assert_eq!(timers(4_000_000).state, State::Warn);
        assert_eq!(governor(&[]).state, State::Ok);
        assert_eq!(governor(&["performance".into(), "powersave".into()]).state, State::Warn);
        assert_eq!(idle_states(Path::new("/nosuch")).state, State::Warn);
    }
}
