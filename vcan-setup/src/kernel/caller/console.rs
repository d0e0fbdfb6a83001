//! The kernel's console: what it says when it does not boot, or dies.

use std::collections::VecDeque;
use std::fmt;
use std::io::{BufRead, BufReader, PipeReader};
use std::sync::{Arc, Mutex};
use std::thread;

/// Lines kept, and those quoted in an error message.
const LINES: usize = 200;
const LINES_SHOWN: usize = 8;

/// The last lines of the kernel's console.
#[derive(Debug, Default)]
pub(super) struct Console(VecDeque<String>);

impl Console {
    /// Reads the console until it is closed.
    pub(super) fn collect(console: PipeReader) -> Arc<Mutex<Self>> {
        let collected = Arc::new(Mutex::new(Self::default()));
        let shared = Arc::clone(&collected);
        thread::spawn(move || {
            for line in BufReader::new(console).split(b'\n').map_while(Result::ok) {
                let Ok(mut console) = shared.lock() else {
                    return;
                };
                console.add(&String::from_utf8_lossy(&line));
            }
        });
        collected
    }

    fn add(&mut self, line: &str) {
        let line = line.trim_end();
        if !line.is_empty() {
            self.0.push_back(line.into());
            self.0.drain(..self.0.len().saturating_sub(LINES));
        }
    }
}

impl fmt::Display for Console {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // A panic says why in its first line and then goes on at length.
        let panic = self.0.iter().rposition(|line| line.contains("Kernel panic"));
        let first = panic.unwrap_or_else(|| self.0.len().saturating_sub(LINES_SHOWN));
        for line in self.0.iter().skip(first).take(LINES_SHOWN) {
            write!(f, "\n  {line}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_quoted_from_the_panic_on_and_never_at_length() {
        let mut console = Console::default();
        for number in 0..1000 {
            console.add(&format!("line {number}"));
        }
        assert!(console.to_string().ends_with("line 999"));
        assert_eq!(console.to_string().lines().count(), 1 + LINES_SHOWN);
        console.add("Kernel panic - not syncing: No working init found.");
        for _ in 0..20 {
            console.add("Call Trace:");
            console.add("");
        }
        assert!(console.to_string().starts_with("\n  Kernel panic"), "{console}");
        assert_eq!(console.to_string().lines().count(), 1 + LINES_SHOWN);
    }
}
