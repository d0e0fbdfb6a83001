//! Loads: work that competes with a run for processor, memory, disk and the kernel.
//!
//! Each is a process of this program at ordinary priority, as anything else on the machine would
//! be, and ends with the one that started it.

use std::fs::{self, File};
use std::hint::black_box;
use std::io::{Seek, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use crate::cli::{LoadArgs, Word};
use crate::failure::Failure;
use crate::process;

/// Memory that the memory hog walks through \[bytes\]: more than any cache holds.
const HOG_BYTES: usize = 256 << 20;
/// What the disk writer writes before it asks for it to be on the disk \[bytes\].
const WRITE_BYTES: usize = 4 << 20;
/// How much it writes before it begins again in the same place \[bytes\].
const FILE_BYTES: usize = 128 << 20;
/// Memory that the page-faulter asks for and gives back, again and again \[bytes\]. From 32 MiB on
/// the allocator takes it from the kernel each time.
const FAULT_BYTES: usize = 64 << 20;
/// Bytes of a page, or of a part of one.
const PAGE_BYTES: usize = 4096;
/// How long loads get to be under way.
const WARM_UP: Duration = Duration::from_millis(300);

/// What else a machine has to do.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, ValueEnum, Serialize, Deserialize,
)]
#[serde(rename_all = "lowercase")]
pub enum Load {
    /// Nothing.
    Idle,
    /// A busy process for every CPU.
    Cpu,
    /// A process that walks through more memory than caches hold.
    Memory,
    /// A process that writes and waits for the disk.
    Disk,
    /// A process that makes the kernel find and clear pages all the time.
    Faults,
    /// All of these at once.
    All,
}

impl Load {
    /// The processes it is made of, on a machine with so many CPUs.
    pub fn processes(self, cpus: usize) -> Vec<Self> {
        match self {
            Self::Idle => Vec::new(),
            Self::Cpu => vec![Self::Cpu; cpus],
            Self::Memory | Self::Disk | Self::Faults => vec![self],
            Self::All => {
                let single = [Self::Memory, Self::Disk, Self::Faults];
                Self::Cpu.processes(cpus).into_iter().chain(single).collect()
            }
        }
    }

    /// The command line of one of its processes.
    pub fn arguments(self, folder: &Path) -> [String; 4] {
        ["load".into(), self.word(), "--out".into(), folder.display().to_string()]
    }
}

/// The processes of a load that is going on; dropping it ends them.
#[derive(Debug)]
pub struct Generators {
    children: Vec<Child>,
}

impl Generators {
    /// Starts a load and lets it get under way.
    ///
    /// # Errors
    /// When a process cannot be started.
    pub fn start(load: Load, cpus: usize, folder: &Path) -> Result<Self, Failure> {
        let mut started = Self { children: Vec::new() };
        let program = std::env::current_exe();
        for kind in load.processes(cpus) {
            let program = program.as_ref().map_err(|error| cannot_start(kind, error))?;
            let child = Command::new(program)
                .args(kind.arguments(folder))
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .spawn()
                .map_err(|error| cannot_start(kind, &error))?;
            started.children.push(child);
        }
        if load != Load::Idle {
            thread::sleep(WARM_UP);
        }
        Ok(started)
    }

    /// The loads that ended although nobody told them to: a machine without room for them.
    pub fn casualties(&mut self) -> usize {
        let ended = |child: &mut Child| !matches!(child.try_wait(), Ok(None));
        self.children.iter_mut().map(ended).filter(|ended| *ended).count()
    }
}

impl Drop for Generators {
    fn drop(&mut self) {
        for child in &mut self.children {
            // It may have ended by itself.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn cannot_start(load: Load, error: &std::io::Error) -> Failure {
    Failure::cannot_start(format!("load {}: {error}; leave it out of --loads", load.word()))
}

/// The process of one load: works until it is ended, or the process that started it is gone.
///
/// # Errors
/// When it has no room, or there is no such process.
pub fn run(args: &LoadArgs) -> Result<(), Failure> {
    process::die_with_parent();
    match args.kind {
        Load::Cpu => burn(),
        Load::Memory => walk_through_memory(),
        Load::Faults => fault_pages(),
        Load::Disk => write_to_disk(&args.out).map_err(|error| cannot_start(Load::Disk, &error)),
        Load::Idle | Load::All => {
            Err(Failure::usage("load: give one of cpu, memory, disk, faults"))
        }
    }
}

fn burn() -> ! {
    let mut number: u64 = 1;
    loop {
        // Marsaglia's xorshift: work that no compiler removes and no memory is needed for.
        number ^= number << 13;
        number ^= number >> 7;
        number ^= number << 17;
        black_box(number);
    }
}

fn walk_through_memory() -> ! {
    let mut memory = vec![1_u64; HOG_BYTES / size_of::<u64>()];
    loop {
        for word in &mut memory {
            *word = word.wrapping_add(1);
        }
        black_box(&mut memory);
    }
}

fn fault_pages() -> ! {
    loop {
        let mut memory = vec![0_u8; FAULT_BYTES];
        for byte in memory.iter_mut().step_by(PAGE_BYTES) {
            *byte = 1;
        }
        black_box(&mut memory);
    }
}

fn write_to_disk(folder: &Path) -> std::io::Result<()> {
    let path = folder.join(format!(".load-{}", std::process::id()));
    let mut file = File::options().create_new(true).write(true).open(&path)?;
    // Without a name it is gone with the process, however that ends.
    fs::remove_file(&path)?;
    let block = vec![0xA5; WRITE_BYTES];
    loop {
        for _ in 0..FILE_BYTES / WRITE_BYTES {
            file.write_all(&block)?;
            file.sync_data()?;
        }
        file.rewind()?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_load_is_made_of_processes_of_this_program() {
        let words = |load: Load| -> Vec<String> {
            load.processes(2).iter().map(|kind| kind.arguments(Path::new("x"))[1].clone()).collect()
        };
        assert_eq!(words(Load::Idle), Vec::<String>::new());
        assert_eq!(words(Load::Cpu), ["cpu", "cpu"]);
        assert_eq!(words(Load::Disk), ["disk"]);
        assert_eq!(words(Load::All), ["cpu", "cpu", "memory", "disk", "faults"]);
        assert_eq!(
            Load::Faults.arguments(Path::new("runs/x")),
            ["load", "faults", "--out", "runs/x"]
        );
    }
}
