//! Snapshots of the law's memory, so that a replay can start anywhere.

use core::fmt;

use crate::schema::message;

/// Most bytes a snapshot of the law's memory takes.
pub const SNAPSHOT_BYTES_MAX: usize = 4096;

/// Opaque bytes of bounded length, `Copy` so that they fit a ring slot.
#[derive(Clone, Copy)]
pub struct Snapshot<const N: usize = SNAPSHOT_BYTES_MAX> {
    len: u16,
    bytes: [u8; N],
}

impl<const N: usize> Snapshot<N> {
    /// A snapshot of these bytes; `None` when they are more than `N`.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Option<Self> {
        const { assert!(N <= u16::MAX as usize) };
        let mut snapshot = Self { len: bytes.len() as u16, bytes: [0; N] };
        snapshot.bytes.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(snapshot)
    }

    /// The bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..usize::from(self.len)]
    }
}

impl<const N: usize> Default for Snapshot<N> {
    fn default() -> Self {
        Self { len: 0, bytes: [0; N] }
    }
}

impl<const N: usize> PartialEq for Snapshot<N> {
    fn eq(&self, other: &Self) -> bool {
        self.as_bytes() == other.as_bytes()
    }
}

impl<const N: usize> fmt::Debug for Snapshot<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Snapshot({} bytes)", self.len)
    }
}

message! {
    /// The law's memory after one tick. The bytes are the ECU's own encoding of it.
    #[derive(Debug, Clone, Copy, PartialEq, Default)]
    pub struct MemoryRecord = "platoon.Memory" {
        /// Bench time of the tick after which the snapshot was taken \[ns\].
        1 time_ns: u64,
        /// Number of that tick.
        2 tick: u32,
        /// The memory, encoded by the ECU.
        3 snapshot: Snapshot,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schema::Message;

    #[test]
    fn a_snapshot_survives_encoding() {
        let snapshot = Snapshot::new(&[7; 1000]).expect("fits");
        let record = MemoryRecord { time_ns: 1, tick: 2, snapshot };
        let mut bytes = Vec::new();
        record.encode(&mut bytes);
        assert_eq!(MemoryRecord::decode(&bytes), Ok(record));
    }

    #[test]
    fn a_snapshot_that_does_not_fit_is_refused() {
        assert!(Snapshot::<8>::new(&[0; 9]).is_none());
    }
}
