//! Times of calls, and the table every benchmark of the project prints them in.

use std::hint::black_box;
use std::time::Instant;

/// Calls that are timed as one where a call is too short for the clock.
#[allow(dead_code, reason = "not everybody's calls are that short")]
pub const AT_ONCE: u32 = 64;

/// Times one call \[ns\].
#[allow(dead_code, reason = "not everybody's calls are that long")]
pub fn timed<T>(times: &mut Vec<u64>, call: impl FnOnce() -> T) -> T {
    let began = Instant::now();
    let result = black_box(call());
    times.push(began.elapsed().as_nanos() as u64);
    result
}

/// Times [`AT_ONCE`] calls and notes the mean of them \[ns\].
#[allow(dead_code, reason = "not everybody's calls are that short")]
pub fn timed_together<T>(times: &mut Vec<u64>, mut call: impl FnMut() -> T) {
    let began = Instant::now();
    for _ in 0..AT_ONCE {
        black_box(call());
    }
    times.push(began.elapsed().as_nanos() as u64 / u64::from(AT_ONCE));
}

/// Prints the table's head.
pub fn head() {
    println!(
        "{:18} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8}",
        "ns a call", "least", "median", "mean", "p99", "p99.9", "max"
    );
}

/// Prints a row.
pub fn row(name: &str, times: &mut [u64]) {
    times.sort_unstable();
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    let mean = times.iter().sum::<u64>() / times.len() as u64;
    let (least, p99, p999, max) = (times[0], at(0.99), at(0.999), times[times.len() - 1]);
    println!("{name:18} {least:8} {:8} {mean:8} {p99:8} {p999:8} {max:8}", at(0.5));
}
