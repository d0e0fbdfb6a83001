//! How long the frames of one identifier took, from queueing to arrival.

/// Width of a class of times \[ns\].
const CLASS_NS: u64 = 20_000;
/// Classes; the last one holds all that is longer than 20 ms.
const CLASSES: usize = 1024;

/// Times from queueing to arrival of the frames with one identifier.
#[derive(Clone, Debug)]
pub struct Queueing {
    /// The identifier.
    pub id: u32,
    /// Whether it has 29 bits.
    pub is_extended: bool,
    frames: u64,
    max_ns: u64,
    classes: [u32; CLASSES],
}

impl Queueing {
    pub(super) const fn new(id: u32, is_extended: bool) -> Self {
        Self { id, is_extended, frames: 0, max_ns: 0, classes: [0; CLASSES] }
    }

    pub(super) fn note(&mut self, response_ns: u64) {
        self.frames += 1;
        self.max_ns = self.max_ns.max(response_ns);
        self.classes[((response_ns / CLASS_NS) as usize).min(CLASSES - 1)] += 1;
    }

    /// Frames counted.
    pub const fn frames(&self) -> u64 {
        self.frames
    }

    /// The longest time \[ns\].
    pub const fn max_ns(&self) -> u64 {
        self.max_ns
    }

    /// A time that 99 % of the frames keep \[ns\], rounded up by at most 20 µs; the longest when
    /// that is beyond 20 ms.
    pub fn p99_ns(&self) -> u64 {
        let mut beyond = self.frames / 100;
        for (class, &frames) in self.classes.iter().enumerate().skip(1).rev() {
            if u64::from(frames) > beyond {
                let is_last = class == CLASSES - 1;
                let upper_ns = (class as u64 + 1) * CLASS_NS;
                return if is_last { self.max_ns } else { upper_ns.min(self.max_ns) };
            }
            beyond -= u64::from(frames);
        }
        CLASS_NS.min(self.max_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundredth_of_the_frames_may_take_longer() {
        let mut queueing = Queueing::new(1, true);
        assert_eq!((queueing.max_ns(), queueing.p99_ns()), (0, 0));
        for number in 0..1000 {
            queueing.note(if number < 990 { 250_000 } else { 7_000_000 });
        }
        assert_eq!((queueing.frames(), queueing.max_ns()), (1000, 7_000_000));
        assert_eq!(queueing.p99_ns(), 260_000);
        queueing.note(30_000_000);
        assert_eq!(queueing.p99_ns(), 7_020_000);
    }

    #[test]
    fn what_is_off_the_scale_is_told_by_its_longest() {
        let mut queueing = Queueing::new(1, true);
        (0..10).for_each(|_| queueing.note(90_000_000));
        assert_eq!(queueing.p99_ns(), 90_000_000);
    }
}
