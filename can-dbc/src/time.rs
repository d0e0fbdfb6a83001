//! The one way this code base is told the time.

/// A monotonic clock and the ability to wait for it.
///
/// Only a `main` reads the machine's clock. Everything below takes a `&dyn Clock`, so virtual time
/// is another implementation and no special case.
pub trait Clock {
    /// Nanoseconds since an arbitrary fixed instant; never decreases.
    fn now_ns(&self) -> u64;

    /// Returns at `deadline_ns` of [`now_ns`](Self::now_ns), or at once when that has passed.
    fn sleep_until_ns(&self, deadline_ns: u64);
}
