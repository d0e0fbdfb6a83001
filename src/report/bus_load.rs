//! How full each bus was over time, by the bits of its frames.

use platoon_dbc::{BusTiming, Frame};
use traces::TRUCKS_MAX;

use super::envelope::Envelopes;

/// What a bus shows.
pub const BUS_LOAD: &str = "bus_load_percent";
/// Span over which a load is taken \[ns\].
const WINDOW_NS: u64 = 100_000_000;

/// The window of a bus that is being filled.
#[derive(Debug, Clone, Copy, Default)]
struct Window {
    number: u64,
    busy_ns: u64,
}

/// The loads of all buses of a run.
#[derive(Debug, Clone)]
pub struct BusLoad {
    timing: BusTiming,
    windows: [Window; TRUCKS_MAX],
    curves: Envelopes,
}

impl BusLoad {
    /// Nothing was on buses of these bit rates yet.
    pub fn new(timing: BusTiming) -> Self {
        let curves = Envelopes::new(TRUCKS_MAX, WINDOW_NS);
        Self { timing, windows: [Window::default(); TRUCKS_MAX], curves }
    }

    /// Takes a frame at its bench time \[ns\]. What was there before the start is no load.
    pub fn add(&mut self, bus: u8, time_ns: u64, frame: &Frame) {
        let number = time_ns / WINDOW_NS;
        let Some(window) = self.windows.get_mut(usize::from(bus)).filter(|_| time_ns > 0) else {
            return;
        };
        if window.number != number {
            let full = std::mem::replace(window, Window { number, busy_ns: 0 });
            self.close(bus, full);
        }
        self.windows[usize::from(bus)].busy_ns += self.timing.frame_time_ns(frame);
    }

    fn close(&mut self, bus: u8, Window { number, busy_ns }: Window) {
        if busy_ns > 0 {
            let percent = 100.0 * busy_ns as f64 / WINDOW_NS as f64;
            self.curves.add(usize::from(bus), number * WINDOW_NS, percent);
        }
    }

    /// A curve for every bus; the last window, which the end of the run cut, is left out.
    pub fn into_curves(self) -> Envelopes {
        self.curves
    }
}

#[cfg(test)]
mod tests {
    use platoon_dbc::{EgoState, Profile};

    use super::*;

    #[test]
    fn a_frame_per_millisecond_fills_its_share_of_the_bus() {
        let timing = Profile::Fd.timing();
        let frame = EgoState::default().encode(0).expect("in range");
        let mut load = BusLoad::new(timing);
        for ms in 1..=400 {
            load.add(2, ms * 1_000_000, &frame);
        }
        let curves = load.into_curves();
        let expected = 1e-4 * timing.frame_time_ns(&frame) as f64;
        let values = curves.values(2);
        let last = values.iter().rev().find(|value| value.is_finite()).expect("a load");
        assert!((f64::from(*last) - expected).abs() < 1e-3, "{values:?} {expected}");
        assert!(curves.values(1).iter().all(|value| value.is_nan()), "nothing on other buses");
    }
}
