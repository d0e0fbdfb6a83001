//! Where user-mode Linux keeps the guest's memory: a deleted file, best on a file system in memory.

use std::path::{Path, PathBuf};

use rustix::fs::{statfs, statvfs};

use super::super::KernelError;

/// TMPFS_MAGIC of linux/magic.h.
const TMPFS: i64 = 0x0102_1994;
/// Where the kernel looks by itself, in this order.
const PLACES: [&str; 2] = ["/dev/shm", "/tmp"];

/// A folder with room for the memory, to be named to the kernel by TMPDIR.
///
/// It takes a folder named so only when that is in memory, and otherwise prefers any of its own
/// places that is; a file on a disk is its last resort.
pub(super) fn place(asked_mib: u32, temporary: &Path) -> Result<PathBuf, KernelError> {
    let mut places: Vec<&Path> = PLACES.iter().map(Path::new).collect();
    places.push(temporary);
    let in_memory: Vec<&Path> =
        places.iter().copied().filter(|place| is_in_memory(place)).collect();
    let candidates = if in_memory.is_empty() { vec![Path::new("/tmp")] } else { in_memory };
    let asked_bytes = u64::from(asked_mib) << 20;
    let room = |place: &&Path| free_bytes(place);
    let best = candidates.iter().copied().max_by_key(room).expect("there is always one");
    let fitting = candidates.into_iter().find(|place| free_bytes(place) >= asked_bytes);
    fitting.map(Into::into).ok_or_else(|| KernelError::NoMemory {
        asked_mib,
        free_mib: free_bytes(best) >> 20,
        place: best.into(),
    })
}

fn is_in_memory(place: &Path) -> bool {
    statfs(place).is_ok_and(|facts| facts.f_type == TMPFS)
}

fn free_bytes(place: &Path) -> u64 {
    statvfs(place).map_or(0, |facts| facts.f_bavail.saturating_mul(facts.f_frsize))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_little_memory_has_a_place_and_far_too_much_has_none() {
        assert!(place(1, Path::new("/tmp")).expect("a megabyte").is_dir());
        let error = place(u32::MAX, Path::new("/tmp")).expect_err("four petabytes").to_string();
        assert!(error.contains("--memory-mb") && error.contains("4294967295 MiB"), "{error}");
    }
}
