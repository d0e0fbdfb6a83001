//! What a comparison of two runs found.

use std::fmt;

use serde::Serialize;

use super::upstream::Upstream;
use super::visible::Visible;
use crate::trace::Difference;

/// Settings shown at most; a comparison of controllers has many.
const SETTINGS_SHOWN: usize = 12;

/// A quantity that is not the same.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Apart {
    /// Its name.
    pub quantity: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// How far apart \[unit\]; none where it is no number.
    pub by: Option<f64>,
    /// How many representable numbers apart.
    pub ulps: Option<u64>,
    /// All that in words, first run against second.
    pub words: String,
}

impl Apart {
    /// A difference, first run against second.
    pub fn of(difference: &Difference) -> Self {
        let Difference { quantity, here, there } = difference;
        let by = here.number().zip(there.number()).map(|(a, b)| (a - b).abs());
        Self {
            quantity: quantity.name,
            unit: quantity.unit,
            by,
            ulps: here.ulps(*there),
            words: difference.to_string(),
        }
    }
}

/// What is not the same about a tick.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// These quantities.
    Apart(Vec<Apart>),
}

/// The first tick that came to something else.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct First {
    /// Its number in the first run.
    pub tick: u32,
    /// Its bench time \[s\].
    pub time_s: f64,
    /// What is not the same.
    pub what: What,
    /// The first frame consumed by then that differs; none when all were the same.
    pub upstream: Option<Upstream>,
}

/// One ECU in both runs.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Ecu {
    /// Truck it drives.
    pub truck: u8,
    /// Ticks of the same bench time that both ran.
    pub ticks: u64,
    /// Those of them that came to something else.
    pub differing: u64,
    /// Ticks that only the first, or only the second ran.
    pub only_in: [u64; 2],
    /// Bench time of the first such tick \[s\].
    pub first_only: Option<f64>,
    /// Largest distance of the force commands \[N\].
    pub force_n: f64,
    /// Largest distance of the steering commands \[rad\].
    pub steering_rad: f64,
    /// The first tick that came to something else.
    pub first: Option<First>,
}

/// Two runs held together.
#[derive(Debug, Serialize)]
pub struct Finding {
    /// ECU by ECU.
    pub ecus: Vec<Ecu>,
    /// What it did to the distances between the trucks.
    pub spacing: Visible,
    /// Settings that differ.
    pub settings: Vec<String>,
    /// What of each file could not be read.
    pub damage: [Option<String>; 2],
}

impl Finding {
    /// Whether both runs came to the same.
    pub fn is_same(&self) -> bool {
        self.ecus.iter().all(|ecu| ecu.differing == 0 && ecu.only_in == [0, 0])
            && self.spacing.furthest_m == 0.0
    }

    fn first(&self) -> Option<(&Ecu, &First)> {
        let firsts = self.ecus.iter().filter_map(|ecu| Some((ecu, ecu.first.as_ref()?)));
        firsts.min_by(|(_, a), (_, b)| a.time_s.total_cmp(&b.time_s))
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for ecu in &self.ecus {
            show(ecu, f)?;
        }
        if let Some((ecu, first)) = self.first() {
            show_first(ecu, first, f)?;
        }
        let Visible { since_s, truck, furthest_m, furthest_s, furthest_truck } = self.spacing;
        match since_s {
            Some(since_s) => writeln!(
                f,
                "spacing errors apart by more than 1 cm from {since_s:.3} s on (truck {truck}); at \
                 most {furthest_m:.3} m at {furthest_s:.3} s (truck {furthest_truck})"
            )?,
            None => writeln!(f, "spacing errors never apart by more than 1 cm: {furthest_m:e} m")?,
        }
        for setting in self.settings.iter().take(SETTINGS_SHOWN) {
            writeln!(f, "set up differently: {setting}")?;
        }
        if let Some(more) = self.settings.len().checked_sub(SETTINGS_SHOWN + 1) {
            writeln!(f, "set up differently: and {} more", more + 1)?;
        }
        for (which, damage) in ["first", "second"].iter().zip(&self.damage) {
            if let Some(damage) = damage {
                writeln!(f, "the {which} file is damaged: {damage}")?;
            }
        }
        writeln!(f, "{}", if self.is_same() { "identical" } else { "DIFFERENT" })
    }
}

fn show(ecu: &Ecu, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let Ecu { truck, ticks, differing, only_in: [a, b], force_n, steering_rad, .. } = ecu;
    write!(f, "ECU {truck}: {differing} of {ticks} common ticks differ")?;
    if *differing > 0 {
        write!(f, ", commands by at most {force_n} N and {steering_rad} rad")?;
    }
    if let Some(first_s) = ecu.first_only {
        write!(f, "; ran by one only: {a} and {b} ticks, the first at {first_s:.3} s")?;
    }
    writeln!(f)
}

fn show_first(ecu: &Ecu, first: &First, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let First { tick, time_s, what: What::Apart(apart), upstream } = first;
    writeln!(f, "first at tick {tick} ({time_s:.3} s) of ECU {}:", ecu.truck)?;
    apart.iter().try_for_each(|apart| writeln!(f, "  {}", apart.words))?;
    match upstream {
        Some(Upstream { time_s, message, how }) => {
            writeln!(f, "  explained by {message} consumed at {time_s:.3} s: {how}")
        }
        None => writeln!(
            f,
            "  every frame it had consumed was the same: law, settings or version differ"
        ),
    }
}
