//! What a real bus would make of the traffic: how long frames hold it, who waits for whom.
//!
//! A virtual bus has no bit rate and hides overload, so it must be computed. [`BusTiming`] gives
//! the time of a frame from its exact bits, [`Arbiter`] plays a bus frame by frame,
//! [`worst_responses`] bounds how long each identifier can wait.
//!
//! Bits are counted as ISO 11898-1:2015 lays them out. Retransmissions and error frames are not
//! modelled. Every node is taken to offer its most urgent frame to arbitration, as the analysis
//! does; a controller that sends its queue in order of arrival delays urgent frames further.

mod arbiter;
mod frame_bits;
mod response;

pub use arbiter::{Arbiter, QueueFull, Request, Transfer, Urgency};
pub use frame_bits::FrameBits;
pub use response::{Stream, load, worst_responses};

use core::fmt;

use crate::frame::{Frame, FrameFlags};

const NS_PER_S: u64 = 1_000_000_000;

/// Bit rates of a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusTiming {
    /// Bit rate of arbitration, bit/s.
    pub nominal_hz: u64,
    /// Bit rate of the data phase of frames with bit rate switch, bit/s.
    pub data_hz: u64,
}

impl Default for BusTiming {
    /// 500 kbit/s and 2 Mbit/s, the usual pair of J1939-17 and J1939-22 and that of `platoon.dbc`.
    fn default() -> Self {
        Self { nominal_hz: 500_000, data_hz: 2_000_000 }
    }
}

impl BusTiming {
    /// Rates that are common on buses of classic frames, slowest first.
    pub const CLASSIC: [Self; 4] = [
        Self::classic(125_000),
        Self::classic(250_000),
        Self::classic(500_000),
        Self::classic(1_000_000),
    ];

    /// Pairs of rates that are common on buses of FD frames, slowest first.
    pub const FD: [Self; 5] = [
        Self::fd(500_000, 1_000_000),
        Self::fd(500_000, 2_000_000),
        Self::fd(500_000, 5_000_000),
        Self::fd(1_000_000, 5_000_000),
        Self::fd(1_000_000, 8_000_000),
    ];

    /// A bus of classic frames.
    pub const fn classic(rate_hz: u64) -> Self {
        Self::fd(rate_hz, rate_hz)
    }

    /// A bus of FD frames, whose data phase has a rate of its own.
    pub const fn fd(nominal_hz: u64, data_hz: u64) -> Self {
        Self { nominal_hz, data_hz }
    }

    /// Time on the bus of a frame including the intermission after it, nanoseconds.
    ///
    /// Error frames count as 0: they are reports of the driver and not traffic.
    ///
    /// # Panics
    /// If a bit rate is 0.
    pub fn frame_time_ns(&self, frame: &Frame) -> u64 {
        self.time_ns(FrameBits::of(frame))
    }

    /// The longest that any frame with these flags and `length` data bytes takes, nanoseconds.
    ///
    /// # Panics
    /// If a bit rate is 0.
    pub fn frame_time_ns_max(&self, flags: FrameFlags, length: usize) -> u64 {
        self.time_ns(FrameBits::most(flags, length))
    }

    /// One bit of arbitration, nanoseconds.
    ///
    /// # Panics
    /// If the bit rate is 0.
    pub fn bit_time_ns(&self) -> u64 {
        NS_PER_S.div_ceil(self.nominal_hz)
    }

    /// How long these bits take, nanoseconds.
    ///
    /// # Panics
    /// If a bit rate is 0.
    pub fn time_ns(&self, bits: FrameBits) -> u64 {
        bits.nominal * NS_PER_S / self.nominal_hz + bits.fast * NS_PER_S / self.data_hz
    }
}

impl fmt::Display for BusTiming {
    /// `500k` for a classic bus, `500k/2M` for an FD bus.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_rate(f, self.nominal_hz)?;
        if self.data_hz == self.nominal_hz {
            return Ok(());
        }
        f.write_str("/")?;
        write_rate(f, self.data_hz)
    }
}

fn write_rate(f: &mut fmt::Formatter<'_>, rate_hz: u64) -> fmt::Result {
    if rate_hz.is_multiple_of(1_000_000) {
        write!(f, "{}M", rate_hz / 1_000_000)
    } else if rate_hz.is_multiple_of(1000) {
        write!(f, "{}k", rate_hz / 1000)
    } else {
        write!(f, "{rate_hz}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_takes_its_bits_at_their_rates() {
        let bits = FrameBits { nominal: 48, fast: 294 };
        assert_eq!(BusTiming::default().time_ns(bits), 96_000 + 147_000);
        assert_eq!(BusTiming::classic(1_000_000).time_ns(bits), 342_000);
    }

    #[test]
    fn rates_are_written_as_can_people_do() {
        let words = |rates: &[BusTiming]| {
            rates.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(words(&BusTiming::CLASSIC), "125k 250k 500k 1M");
        assert_eq!(words(&BusTiming::FD), "500k/1M 500k/2M 500k/5M 1M/5M 1M/8M");
        assert_eq!(BusTiming::fd(83_333, 2_500_000).to_string(), "83333/2500k");
    }

    #[test]
    fn the_traffic_of_one_truck_fits_at_1_khz_and_not_at_2_khz() {
        use crate::{Actuation, EcuStatus, EgoState, Mission, Obstacle, V2vOut, V2vState};
        let timing = BusTiming::default();
        let cost = |frame: Result<Frame, _>| timing.frame_time_ns(&frame.expect("in range"));
        let load_percent = |loop_hz: u64| {
            let looped = cost(EgoState::default().encode(1)) + cost(Actuation::default().encode(1));
            let radio = 2 * cost(V2vState::default().encode(1)) + cost(V2vOut::default().encode(1));
            let obstacles = 8 * cost(Obstacle::default().encode(1));
            let slow =
                10 * cost(EcuStatus::default().encode(1)) + cost(Mission::default().encode(1));
            let ns = looped * loop_hz + radio * 50 + obstacles * 20 + slow;
            ns as f64 * 100.0 / NS_PER_S as f64
        };
        assert!((50.0..65.0).contains(&load_percent(1000)));
        assert!(load_percent(2000) > 90.0);
    }
}
