//! What the machine is: the facts a reader of timing figures needs beside them.
//!
//! Everything is read, nothing is changed, and whatever cannot be read is `None` or empty.

use std::fs;
use std::path::Path;

use rustix::process::{Resource, getrlimit};
use rustix::time::{ClockId, clock_getres};

/// Ticks per second of the times in /proc/stat (USER_HZ, the same on all Linux ports of Rust).
const STAT_TICKS_PER_S: u64 = 100;
/// Nanoseconds in a tick of /proc/stat.
const NS_PER_STAT_TICK: u64 = 1_000_000_000 / STAT_TICKS_PER_S;

/// The machine as found, at one instant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Environment {
    /// Kernel release, for example `6.1.0-30-rt-amd64`.
    pub kernel: String,
    /// Kernel version line: build number, SMP and preemption words.
    pub kernel_version: String,
    /// Whether this is a PREEMPT_RT kernel.
    pub preempt_rt: bool,
    /// Periodic tick rate \[Hz\] the kernel was built with, where its configuration is readable.
    pub tick_hz: Option<u32>,
    /// Resolution \[ns\] of CLOCK_MONOTONIC timers; 1 with high-resolution timers.
    pub timer_resolution_ns: u64,
    /// Clock source in use, for example `tsc`.
    pub clocksource: Option<String>,
    /// Distinct frequency governors of the online CPUs; empty when there is no frequency control.
    pub governors: Vec<String>,
    /// CPUs taken from the general scheduler with `isolcpus`.
    pub isolated_cpus: Vec<usize>,
    /// CPUs online.
    pub online_cpus: Vec<usize>,
    /// Highest real-time priority this process may ask for without privilege.
    pub rtprio_limit: Option<u64>,
    /// Bytes this process may lock without privilege; `None` means no limit.
    pub memlock_limit_bytes: Option<u64>,
    /// Real-time share \[µs\] of the kernel's throttling second; `None` means not throttled.
    pub rt_runtime_us: Option<u64>,
    /// CPU time \[ns\] the hypervisor took from all CPUs since boot; subtract two for a run's.
    pub steal_ns: u64,
    /// Whether the machine is a guest of a hypervisor.
    pub virtual_machine: bool,
}

/// Reads the machine's facts.
#[must_use]
pub fn environment() -> Environment {
    let kernel = text("/proc/sys/kernel/osrelease").unwrap_or_default();
    let kernel_version = text("/proc/sys/kernel/version").unwrap_or_default();
    let online_cpus = cpu_list(&text("/sys/devices/system/cpu/online").unwrap_or_default());
    let resolution = clock_getres(ClockId::Monotonic);
    let config = fs::read_to_string(format!("/boot/config-{kernel}")).unwrap_or_default();
    let rt_runtime = text("/proc/sys/kernel/sched_rt_runtime_us");
    let cpuinfo = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    Environment {
        preempt_rt: text("/sys/kernel/realtime").as_deref() == Some("1")
            || is_preempt_rt(&kernel_version),
        tick_hz: config_hz(&config),
        timer_resolution_ns: resolution.tv_sec.unsigned_abs() * 1_000_000_000
            + resolution.tv_nsec.unsigned_abs(),
        clocksource: text("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        governors: governors(&online_cpus),
        isolated_cpus: cpu_list(&text("/sys/devices/system/cpu/isolated").unwrap_or_default()),
        rtprio_limit: getrlimit(Resource::Rtprio).current,
        memlock_limit_bytes: getrlimit(Resource::Memlock).current,
        rt_runtime_us: rt_runtime.and_then(|value| value.parse().ok()),
        steal_ns: steal_ns(&fs::read_to_string("/proc/stat").unwrap_or_default()),
        virtual_machine: is_guest(&cpuinfo),
        online_cpus,
        kernel_version,
        kernel,
    }
}

/// The trimmed text of a small file, unless it is missing or empty.
fn text(path: impl AsRef<Path>) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}

/// Distinct frequency governors of `cpus`, sorted.
fn governors(cpus: &[usize]) -> Vec<String> {
    let of = |cpu| text(format!("/sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor"));
    let mut governors: Vec<String> = cpus.iter().filter_map(of).collect();
    governors.sort();
    governors.dedup();
    governors
}

/// The word a real-time kernel has in its version line, as a whole word: PREEMPT_DYNAMIC is not it.
fn is_preempt_rt(version: &str) -> bool {
    version.split_whitespace().any(|word| word == "PREEMPT_RT")
}

/// `CONFIG_HZ` of a kernel configuration.
fn config_hz(config: &str) -> Option<u32> {
    config.lines().find_map(|line| line.strip_prefix("CONFIG_HZ="))?.trim().parse().ok()
}

/// CPUs of a kernel list such as `0-3,6`. A malformed part is left out.
fn cpu_list(list: &str) -> Vec<usize> {
    list.split(',').filter_map(cpu_range).flatten().collect()
}

/// One part of a kernel CPU list: `6` or `0-3`.
fn cpu_range(part: &str) -> Option<std::ops::RangeInclusive<usize>> {
    let (first, last) = part.trim().split_once('-').unwrap_or((part.trim(), part.trim()));
    let range = first.parse().ok()?..=last.parse().ok()?;
    // No kernel has more CPUs; a broken file must not make us count to the end of usize.
    (*range.end() <= 1 << 16).then_some(range)
}

/// Stolen time of all CPUs, the eighth number of the first line of /proc/stat (proc(5)).
fn steal_ns(stat: &str) -> u64 {
    let total = stat.lines().find_map(|line| line.strip_prefix("cpu "));
    let ticks = total.and_then(|line| line.split_whitespace().nth(7)?.parse::<u64>().ok());
    ticks.unwrap_or(0).saturating_mul(NS_PER_STAT_TICK)
}

/// Whether the CPU flags name a hypervisor.
fn is_guest(cpuinfo: &str) -> bool {
    cpuinfo
        .lines()
        .find(|line| line.starts_with("flags"))
        .is_some_and(|flags| flags.split_whitespace().any(|flag| flag == "hypervisor"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_has_a_kernel_and_a_cpu() {
        let environment = environment();
        assert!(environment.kernel.contains('.'));
        assert!(!environment.online_cpus.is_empty());
        assert!(environment.timer_resolution_ns > 0);
    }

    #[test]
    fn cpu_lists_are_read_as_the_kernel_writes_them() {
        assert_eq!(cpu_list("0-3,6\n"), [0, 1, 2, 3, 6]);
        assert_eq!(cpu_list("5"), [5]);
        assert!(cpu_list("").is_empty());
    }

    #[test]
    fn a_broken_cpu_list_yields_what_can_be_read() {
        assert_eq!(cpu_list("x,2,3-,0-99999999999"), [2]);
    }

    #[test]
    fn only_a_real_time_kernel_is_called_one() {
        assert!(is_preempt_rt("#1 SMP PREEMPT_RT Debian 6.1.123-1"));
        assert!(!is_preempt_rt("#1 SMP PREEMPT_DYNAMIC Debian 6.1.123-1"));
    }

    #[test]
    fn the_tick_rate_is_not_confused_with_its_relatives() {
        assert_eq!(
            config_hz("# CONFIG_HZ_100 is not set\nCONFIG_HZ_250=y\nCONFIG_HZ=250\n"),
            Some(250)
        );
        assert_eq!(config_hz(""), None);
    }

    #[test]
    fn steal_is_the_eighth_number_of_the_total() {
        let stat = "cpu  7395 0 3619 244572 1539 0 82 948 0 0\ncpu0 1 2 3 4 5 6 7 8\n";
        assert_eq!(steal_ns(stat), 9_480_000_000);
        assert_eq!(steal_ns("cpu  1 2 3\n"), 0);
    }

    #[test]
    fn a_hypervisor_flag_makes_a_guest() {
        assert!(is_guest("model name : x\nflags : fpu hypervisor avx\n"));
        assert!(!is_guest("flags : fpu avx\nhypervisor : no\n"));
    }
}
