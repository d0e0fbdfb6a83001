//! Pauses of the machine that a sentinel noticed, for others to read while it goes on watching.
//!
//! The log lies in memory without a file system behind it, has a fixed size and is written and read
//! by position, so neither side ever waits for the other or for a disk.

use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use rustix::fs::{MemfdFlags, memfd_create};

/// Pauses kept per CPU; older ones are overwritten.
const PAUSES: usize = 64;
/// Bytes of one pause: its begin and its end.
const PAUSE_BYTES: usize = 16;
/// Bytes of one CPU's pauses.
const CPU_BYTES: usize = PAUSES * PAUSE_BYTES;

/// A log of pauses, to be written.
#[derive(Debug)]
pub struct PauseLog {
    memory: File,
}

/// One CPU's part of a log.
#[derive(Debug)]
pub struct PauseWriter {
    memory: File,
    cpu: usize,
    written: usize,
}

/// A log of pauses, to be read.
#[derive(Debug)]
pub struct PauseReader {
    memory: File,
}

impl PauseLog {
    /// An empty log.
    ///
    /// # Errors
    /// When the kernel has no memory for it.
    pub fn new() -> io::Result<Self> {
        Ok(Self { memory: memfd_create("platoon-pauses", MemfdFlags::CLOEXEC)?.into() })
    }

    /// Where other processes of this user find it, as long as it lives.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        format!("/proc/{}/fd/{}", std::process::id(), self.memory.as_raw_fd()).into()
    }

    /// The part that one CPU's sentinel writes.
    ///
    /// # Errors
    /// When the process may open no more files.
    pub fn writer(&self, cpu: usize) -> io::Result<PauseWriter> {
        Ok(PauseWriter { memory: self.memory.try_clone()?, cpu, written: 0 })
    }
}

impl PauseWriter {
    /// Notes that nothing ran on the CPU between these two readings of CLOCK_MONOTONIC \[ns\].
    pub fn note(&mut self, from_ns: u64, to_ns: u64) {
        let mut pause = [0; PAUSE_BYTES];
        pause[..8].copy_from_slice(&from_ns.to_le_bytes());
        pause[8..].copy_from_slice(&to_ns.to_le_bytes());
        let place = self.cpu * CPU_BYTES + self.written % PAUSES * PAUSE_BYTES;
        // A pause that cannot be noted is one less to explain misses by.
        let _ = self.memory.write_all_at(&pause, place as u64);
        self.written += 1;
    }
}

impl PauseReader {
    /// Opens the log at [`PauseLog::path`].
    ///
    /// # Errors
    /// When it is not there or not this user's.
    pub fn open(path: &Path) -> io::Result<Self> {
        Ok(Self { memory: File::open(path)? })
    }

    /// For how much of the time between two readings of CLOCK_MONOTONIC \[ns\] a CPU stood still.
    #[must_use]
    pub fn standstill_ns(&self, cpu: usize, from_ns: u64, to_ns: u64) -> u64 {
        let mut bytes = [0; CPU_BYTES];
        // What was never written reads short and stays zero.
        if self.memory.read_at(&mut bytes, (cpu * CPU_BYTES) as u64).is_err() {
            return 0;
        }
        let (pauses, _) = bytes.as_chunks::<8>();
        let overlap_ns = |pause: &[[u8; 8]]| {
            let (begin_ns, end_ns) = (u64::from_le_bytes(pause[0]), u64::from_le_bytes(pause[1]));
            end_ns.min(to_ns).saturating_sub(begin_ns.max(from_ns))
        };
        pauses.chunks_exact(2).map(overlap_ns).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_sees_how_much_of_its_time_was_lost() {
        let log = PauseLog::new().expect("memory");
        let mut writer = log.writer(1).expect("a file");
        let reader = PauseReader::open(&log.path()).expect("ours");
        assert_eq!(reader.standstill_ns(1, 0, u64::MAX), 0, "nothing noted");
        writer.note(1_000, 3_000);
        writer.note(10_000, 11_000);
        assert_eq!(reader.standstill_ns(1, 0, 20_000), 3_000);
        assert_eq!(reader.standstill_ns(1, 2_500, 10_250), 750);
        assert_eq!(reader.standstill_ns(1, 4_000, 9_000), 0);
        assert_eq!(reader.standstill_ns(0, 0, 20_000), 0, "another CPU");
    }

    #[test]
    fn old_pauses_give_way_to_new_ones() {
        let log = PauseLog::new().expect("memory");
        let mut writer = log.writer(0).expect("a file");
        for n in 0..1_000 {
            writer.note(100 * n, 100 * n + 1);
        }
        let reader = PauseReader::open(&log.path()).expect("ours");
        assert_eq!(reader.standstill_ns(0, 0, u64::MAX), PAUSES as u64);
        assert_eq!(reader.standstill_ns(0, 100 * 999, u64::MAX), 1);
    }
}
