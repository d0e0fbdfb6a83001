//! Stories as bytes: a JSON head, then every curve as 16-bit numbers, deflated.
//!
//! A curve's values are spread over -32767..=32767 between its least and largest value, so what is
//! drawn is within 1/131068 of the curve's range of what was recorded; -32768 is a gap.

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde::Serialize;
use serde_json::{Value, json};
use traces::TRUCKS_MAX;

use super::bus_load::BUS_LOAD;
use super::envelope::Envelopes;
use super::latency::Bins;
use super::story::{ECU, OBSTACLE, Story, WORLD};
use super::timing_events::{PHASES, gallery};

/// A value that is no number.
const GAP: i16 = i16::MIN;

/// Where a curve is among the numbers, and what they stand for.
#[derive(Debug, Serialize)]
struct Curve {
    /// truck or obstacle.
    of: &'static str,
    index: usize,
    name: &'static str,
    at: usize,
    low: f32,
    high: f32,
}

/// Numbers behind the head.
#[derive(Default)]
struct Numbers(Vec<i16>);

impl Numbers {
    /// Adds a curve; none when it has no value.
    fn add(
        &mut self,
        values: &[f32],
        of: &'static str,
        index: usize,
        name: &'static str,
    ) -> Option<Curve> {
        let known = || values.iter().copied().filter(|value| value.is_finite());
        let (low, high) = (known().reduce(f32::min)?, known().reduce(f32::max)?);
        let at = self.0.len();
        let scale = 65_534.0 / f64::from(high - low).max(f64::MIN_POSITIVE);
        self.0.extend(values.iter().map(|value| match value.is_finite() {
            true => (f64::from(value - low) * scale - 32_767.0).round() as i16,
            false => GAP,
        }));
        Some(Curve { of, index, name, at, low, high })
    }
}

/// Packs stories.
///
/// # Errors
/// Never in memory; the encoder's error is passed on all the same.
pub fn pack(stories: &[Story]) -> std::io::Result<Vec<u8>> {
    let mut numbers = Numbers::default();
    let heads: Vec<Value> = stories.iter().map(|story| head(story, &mut numbers)).collect();
    let mut head = serde_json::to_vec(&json!({ "stories": heads }))?;
    // Numbers of two bytes begin at an even place.
    head.resize(head.len().next_multiple_of(2), b' ');
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
    packed.write_all(&(head.len() as u32).to_le_bytes())?;
    packed.write_all(&head)?;
    for number in numbers.0 {
        packed.write_all(&number.to_le_bytes())?;
    }
    packed.finish()
}

fn head(story: &Story, numbers: &mut Numbers) -> Value {
    let latencies: Vec<_> = story
        .times
        .iter()
        .enumerate()
        .flat_map(|(ecu, times)| times.latencies(ecu as u8))
        .collect();
    let obstacles: Vec<_> = story
        .obstacles
        .iter()
        .map(|obstacle| {
            json!({
                "number": obstacle.number,
                "kind": obstacle.kind,
                "length_m": obstacle.length_m,
                "width_m": obstacle.width_m,
            })
        })
        .collect();
    json!({
        "name": story.name,
        "version": env!("CARGO_PKG_VERSION"),
        "summary": story.summary,
        "metadata": story.metadata,
        "scenario": story.scenario,
        "start_wall_ms": story.start_wall_ns / 1_000_000,
        "end_s": story.end_s,
        "trucks": story.trucks,
        "obstacles": obstacles,
        "world": story.world.as_ref().map(|world| axis(world, world_curves(story, world, numbers))),
        "ecus": story.ecus.as_ref().map(|ecus| axis(ecus, ecu_curves(story, ecus, numbers))),
        "buses": story.buses.as_ref().map(|buses| axis(buses, bus_curves(buses, numbers))),
        "phases": PHASES,
        "bins": Bins::ALL,
        "latencies": latencies,
        "floor": story.floor,
        "events": gallery(&story.times),
        "loss": story.loss,
    })
}

fn axis(envelopes: &Envelopes, curves: Vec<Curve>) -> Value {
    json!({ "step_s": envelopes.step_s(), "points": envelopes.points(), "curves": curves })
}

fn world_curves(story: &Story, world: &Envelopes, numbers: &mut Numbers) -> Vec<Curve> {
    let mut curves = Vec::new();
    let mut kept = 0..;
    for truck in 0..story.trucks.len() {
        for ((name, _), curve) in WORLD.iter().zip(&mut kept) {
            curves.extend(numbers.add(&world.values(curve), "truck", truck, name));
        }
    }
    for obstacle in 0..story.obstacles.len() {
        for (name, curve) in OBSTACLE.iter().zip(&mut kept) {
            curves.extend(numbers.add(&world.values(curve), "obstacle", obstacle, name));
        }
    }
    curves
}

fn ecu_curves(story: &Story, ecus: &Envelopes, numbers: &mut Numbers) -> Vec<Curve> {
    let mut curves = Vec::new();
    for ecu in 0..story.times.len() {
        for (place, (name, _)) in ECU.iter().enumerate() {
            let values = ecus.values(ecu * ECU.len() + place);
            curves.extend(numbers.add(&values, "truck", ecu, name));
        }
    }
    curves
}

fn bus_curves(buses: &Envelopes, numbers: &mut Numbers) -> Vec<Curve> {
    let loads = (0..TRUCKS_MAX).map(|bus| (bus, buses.values(bus)));
    loads.filter_map(|(bus, load)| numbers.add(&load, "truck", bus, BUS_LOAD)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_for_values_within_half_a_step() {
        let mut numbers = Numbers::default();
        let values = [-2.0, f32::NAN, 0.5, 3.0];
        let curve = numbers.add(&values, "truck", 0, "x_m").expect("has values");
        assert_eq!(numbers.0[1], GAP);
        let step = (curve.high - curve.low) / 65_534.0;
        for (number, value) in numbers.0.iter().zip(values).filter(|(_, value)| value.is_finite()) {
            let back = curve.low + (f32::from(*number) + 32_767.0) * step;
            assert!((back - value).abs() <= step, "{back} for {value}");
        }
    }

    #[test]
    fn a_constant_is_kept_and_emptiness_is_left_out() {
        let mut numbers = Numbers::default();
        assert!(numbers.add(&[f32::NAN; 4], "truck", 0, "x_m").is_none());
        let curve = numbers.add(&[7.0; 4], "truck", 0, "x_m").expect("has values");
        assert_eq!((curve.low, curve.high, numbers.0.len()), (7.0, 7.0, 4));
    }

    #[test]
    fn a_story_without_a_trace_is_packed() {
        assert!(pack(&[Story::default()]).is_ok_and(|bytes| !bytes.is_empty()));
    }
}
