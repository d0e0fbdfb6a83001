//! What a replay found.

use std::fmt;

use serde::Serialize;

use super::audit::Audit;
use super::wire::Strays;

/// Ticks that could not be recomputed because records before them are missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Hole {
    /// The last tick before it; none when the recording begins with it.
    pub after_tick: Option<u32>,
    /// Records missing.
    pub records: u64,
    /// Recorded ticks that were not recomputed.
    pub ticks: u64,
    /// The tick whose snapshot ended it; none when it lasts to the end.
    pub resumed_after_tick: Option<u32>,
}

/// The first tick that came out otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Divergence {
    /// Its number.
    pub tick: u32,
    /// Its bench time \[s\].
    pub time_s: f64,
    /// The quantity that differs first.
    pub quantity: &'static str,
    /// All that differs, recomputed against recorded, in words.
    pub differences: Vec<String>,
}

/// How far a command is from the recorded one at most, and when.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Furthest {
    /// How far, in the command's unit.
    pub by: f64,
    /// Bench time \[s\].
    pub at_s: f64,
}

impl Furthest {
    /// Takes one more distance into account.
    pub fn note(&mut self, by: f64, time_ns: u64) {
        if by > self.by {
            *self = Self { by, at_s: time_ns as f64 * 1e-9 };
        }
    }
}

/// What the replay of one ECU found.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Account {
    /// Truck it drives.
    pub truck: u8,
    /// Ticks recomputed and compared.
    pub ticks: u64,
    /// Those of them that had missed their deadline.
    pub late: u64,
    /// Grid points its loop had passed over.
    pub skipped: u64,
    /// Those of them whose QP was capped or infeasible, or whose command the guard replaced.
    pub fallbacks: u64,
    /// Those of them that came out otherwise.
    pub differing: u64,
    /// The first of these.
    pub first: Option<Divergence>,
    /// Largest distance of the force command \[N\].
    pub force_n: Furthest,
    /// Largest distance of the steering command \[rad\].
    pub steering_rad: Furthest,
    /// What could not be recomputed.
    pub holes: Vec<Hole>,
    /// Snapshots that are damaged or of another version.
    pub snapshots_refused: u64,
    /// Frames it consumed that were not on its bus; none told when the bus's recording has gaps.
    pub strays: Option<Strays>,
    /// Commands on its bus that it does not send when recomputed; none told when it has gaps.
    pub foreign_commands: Option<Strays>,
    /// What the other solver made of its QPs.
    pub audit: Option<Audit>,
}

impl Account {
    /// The account where the recording of the bus can or cannot be believed to be whole.
    pub fn trusting_the_tap(mut self, is_whole: bool) -> Self {
        self.strays = self.strays.filter(|_| is_whole);
        self
    }

    fn is_same(&self) -> bool {
        self.differing == 0
            && self.strays.is_none()
            && self.foreign_commands.is_none()
            && self.audit.as_ref().is_none_or(Audit::is_passed)
    }
}

/// What the replay of a run found.
#[derive(Debug, Serialize)]
pub struct Outcome {
    /// Whether something was changed on purpose.
    pub is_what_if: bool,
    /// ECU by ECU.
    pub ecus: Vec<Account>,
    /// What of the file could not be read.
    pub damage: Option<String>,
}

impl Outcome {
    /// Whether everything recomputed is as recorded, or was not meant to be.
    pub fn is_passed(&self) -> bool {
        self.is_what_if || self.ecus.iter().all(Account::is_same)
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for ecu in &self.ecus {
            show(ecu, f)?;
        }
        if let Some(damage) = &self.damage {
            writeln!(f, "the file is damaged: {damage}")?;
        }
        let ticks: u64 = self.ecus.iter().map(|ecu| ecu.ticks).sum();
        let differing: u64 = self.ecus.iter().map(|ecu| ecu.differing).sum();
        match (differing, self.is_what_if) {
            (0, _) if self.is_passed() => writeln!(f, "identical: all {ticks} ticks recomputed"),
            (0, _) => writeln!(f, "NOT as recorded: see above"),
            (_, true) => writeln!(f, "what if: {differing} of {ticks} ticks come out otherwise"),
            (_, false) => writeln!(f, "DIFFERENT: {differing} of {ticks} ticks recomputed"),
        }
    }
}

fn show(ecu: &Account, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let Account { truck, ticks, late, skipped, fallbacks, differing, .. } = ecu;
    writeln!(
        f,
        "ECU {truck}: {ticks} ticks recomputed ({late} late, {skipped} skipped before them, \
         {fallbacks} with fallback), {differing} differ"
    )?;
    if let Some(first) = &ecu.first {
        writeln!(
            f,
            "  first at tick {} ({:.3} s), now against recorded:",
            first.tick, first.time_s
        )?;
        for difference in &first.differences {
            writeln!(f, "    {difference}")?;
        }
        let (force, steering) = (ecu.force_n, ecu.steering_rad);
        writeln!(
            f,
            "  commands apart by at most {} N (at {:.3} s) and {} rad (at {:.3} s)",
            force.by, force.at_s, steering.by, steering.at_s
        )?;
    }
    for hole in &ecu.holes {
        show_hole(hole, f)?;
    }
    if ecu.snapshots_refused > 0 {
        let count = ecu.snapshots_refused;
        writeln!(f, "  {count} snapshots are damaged or of another version of this program")?;
    }
    if let Some(Strays { frames, first_tick, first }) = &ecu.strays {
        writeln!(
            f,
            "  {frames} frames consumed were not on the bus, the first at tick {first_tick}: \
             {first}"
        )?;
    }
    if let Some(Strays { frames, first_tick, first }) = &ecu.foreign_commands {
        writeln!(
            f,
            "  {frames} commands on its bus are not what it sends, the first at tick {first_tick}: \
             {first}"
        )?;
    }
    ecu.audit.iter().try_for_each(|audit| writeln!(f, "  {audit}"))
}

fn show_hole(hole: &Hole, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let Hole { after_tick, records, ticks, resumed_after_tick } = hole;
    let place = after_tick.map_or("at the start".to_owned(), |tick| format!("after tick {tick}"));
    write!(f, "  gap {place}: {records} records missing, {ticks} ticks not recomputed, ")?;
    match resumed_after_tick {
        Some(tick) => writeln!(f, "resumed by the snapshot of tick {tick}"),
        None => writeln!(f, "no snapshot behind it"),
    }
}
