//! A figure as data: what is drawn and what is written as CSV come from the same numbers.

use std::fmt::Write;

use super::spread::fixed;

/// One figure of the paper, or one of ours beside them.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// What the paper calls it, such as `Fig. 5a`; ours have a word.
    pub of: String,
    /// Name of its files, without extension.
    pub file: String,
    /// What it shows.
    pub title: String,
    /// What to look at, and what is drawn how; a sentence or two.
    pub caption: String,
    /// Its panels, from top to bottom.
    pub panels: Vec<Panel>,
}

/// One panel of a figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Heading, when there are several.
    pub title: String,
    /// What is in it.
    pub body: Body,
}

/// Kinds of panels.
#[derive(Debug, Clone, PartialEq)]
pub enum Body {
    /// Curves over a common axis.
    Curves(Curves),
    /// The road from above, at some instants.
    Road(Vec<Strip>),
    /// Groups of bars.
    Bars(Bars),
}

/// Curves over a common axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Curves {
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// The curves.
    pub curves: Vec<Curve>,
}

/// An axis: what it is, and its unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// What is on it.
    pub name: String,
    /// Unit, as printed; empty for none.
    pub unit: String,
}

impl Axis {
    /// An axis.
    pub fn new(name: &str, unit: &str) -> Self {
        Self { name: name.into(), unit: unit.into() }
    }

    /// Its title.
    pub fn title(&self) -> String {
        if self.unit.is_empty() {
            self.name.clone()
        } else {
            format!("{} / {}", self.name, self.unit)
        }
    }
}

/// One curve: the run of one seed, and the band of all.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Its label.
    pub name: String,
    /// Which colour of the palette.
    pub ink: Ink,
    /// The curve.
    pub points: Vec<(f64, f64)>,
    /// 5 % and 95 % of the seeds at the curve's own places; empty when there is one seed.
    pub band: Vec<(f64, f64)>,
}

/// Colours that a colour-blind eye tells apart (Okabe and Ito 2008).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// The leader, and what is nobody's.
    Black,
    /// Truck 1.
    Blue,
    /// Truck 2.
    Vermilion,
    /// Truck 3.
    Green,
    /// A fourth thing.
    Orange,
    /// A fifth thing.
    Purple,
    /// Obstacles, and what is in the background.
    Grey,
}

impl Ink {
    /// The colour of a truck, wherever it appears.
    pub fn of_truck(truck: usize) -> Self {
        [Self::Black, Self::Blue, Self::Vermilion, Self::Green][truck % 4]
    }

    /// The colour of the n-th of several things that are not trucks.
    pub fn nth(place: usize) -> Self {
        [Self::Blue, Self::Vermilion, Self::Green, Self::Orange, Self::Purple, Self::Black]
            [place % 6]
    }

    /// Red, green, blue.
    pub fn rgb(self) -> (u8, u8, u8) {
        match self {
            Self::Black => (0x22, 0x22, 0x22),
            Self::Blue => (0x00, 0x72, 0xB2),
            Self::Vermilion => (0xD5, 0x5E, 0x00),
            Self::Green => (0x00, 0x9E, 0x73),
            Self::Orange => (0xE6, 0x9F, 0x00),
            Self::Purple => (0xCC, 0x79, 0xA7),
            Self::Grey => (0x77, 0x77, 0x77),
        }
    }
}

/// The road from above at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Strip {
    /// Bench time \[s\].
    pub time_s: f64,
    /// The vehicles.
    pub vehicles: Vec<Vehicle>,
}

/// A vehicle seen from above.
#[derive(Debug, Clone, PartialEq)]
pub struct Vehicle {
    /// What to write on it.
    pub name: String,
    /// Its colour.
    pub ink: Ink,
    /// Rear end, along the road from the strip's origin \[m\].
    pub rear_m: f64,
    /// Front end, likewise \[m\].
    pub front_m: f64,
    /// Its centre across the road \[m\].
    pub y_m: f64,
    /// Width \[m\].
    pub width_m: f64,
}

/// Groups of bars.
#[derive(Debug, Clone, PartialEq)]
pub struct Bars {
    /// The vertical axis.
    pub y: Axis,
    /// The groups, from left to right.
    pub groups: Vec<BarGroup>,
}

/// Bars that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct BarGroup {
    /// What to write below.
    pub name: String,
    /// The bars.
    pub bars: Vec<Bar>,
}

/// One bar with its band.
#[derive(Debug, Clone, PartialEq)]
pub struct Bar {
    /// Its label.
    pub name: String,
    /// Its colour.
    pub ink: Ink,
    /// Height.
    pub value: f64,
    /// 5 % and 95 % of the seeds.
    pub band: (f64, f64),
}

impl Figure {
    /// Its numbers as CSV files: name and text of each.
    pub fn tables(&self) -> Vec<(String, String)> {
        let alone = self.panels.len() == 1;
        let name = |number: usize| {
            let file = &self.file;
            if alone { format!("{file}.csv") } else { format!("{file}-{number}.csv") }
        };
        (1..).zip(&self.panels).map(|(number, panel)| (name(number), panel.body.table())).collect()
    }
}

impl Body {
    /// The numbers as CSV, a header line first.
    fn table(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = match self {
            Self::Curves(curves) => curves.write(&mut text),
            Self::Road(strips) => write_road(&mut text, strips),
            Self::Bars(bars) => bars.write(&mut text),
        };
        text
    }
}

impl Curves {
    /// One row per point; curves over the same places would fit in one row, but not all are.
    fn write(&self, text: &mut String) -> std::fmt::Result {
        let [x, y] = [&self.x, &self.y].map(column);
        writeln!(text, "curve,{x},{y},{y}_p5,{y}_p95")?;
        for curve in &self.curves {
            for (index, (x, y)) in curve.points.iter().enumerate() {
                let (low, high) = curve.band.get(index).copied().unwrap_or((*y, *y));
                let [y, low, high] = [*y, low, high].map(|value| fixed(value, 5));
                writeln!(text, "{},{},{y},{low},{high}", plain(&curve.name), fixed(*x, 3))?;
            }
        }
        Ok(())
    }
}

fn write_road(text: &mut String, strips: &[Strip]) -> std::fmt::Result {
    writeln!(text, "time_s,vehicle,rear_m,front_m,y_m,width_m")?;
    for strip in strips {
        for vehicle in &strip.vehicles {
            let Vehicle { name, rear_m, front_m, y_m, width_m, .. } = vehicle;
            let [rear_m, front_m, y_m] = [rear_m, front_m, y_m].map(|metres| fixed(*metres, 3));
            writeln!(text, "{:.2},{name},{rear_m},{front_m},{y_m},{width_m}", strip.time_s)?;
        }
    }
    Ok(())
}

impl Bars {
    fn write(&self, text: &mut String) -> std::fmt::Result {
        let y = column(&self.y);
        writeln!(text, "group,bar,{y},{y}_p5,{y}_p95")?;
        for group in &self.groups {
            for bar in &group.bars {
                let [y, low, high] = [bar.value, bar.band.0, bar.band.1].map(|v| fixed(v, 5));
                let (group, bar) = (plain(&group.name), plain(&bar.name));
                writeln!(text, "{group},{bar},{y},{low},{high}")?;
            }
        }
        Ok(())
    }
}

/// A name without what separates columns.
fn plain(name: &str) -> String {
    name.replace(',', "")
}

/// A column's name: words and unit, as this project writes names.
fn column(axis: &Axis) -> String {
    let words = axis.name.to_lowercase().replace([' ', '-'], "_");
    let unit = axis.unit.replace("m/s", "mps").replace('°', "deg").replace("s²/m²", "s2_per_m2");
    let kept = |c: &char| c.is_ascii_alphanumeric() || *c == '_';
    let name: String = words.chars().filter(kept).collect();
    if unit.is_empty() { name } else { format!("{name}_{}", unit.to_lowercase()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_without_a_band_is_its_own_band_in_the_table() {
        let curve = |points, band| Curve { name: "truck 1".into(), ink: Ink::Blue, points, band };
        let curves = Curves {
            x: Axis::new("Time", "s"),
            y: Axis::new("Error to leader", "m"),
            curves: vec![
                curve(vec![(0.0, 0.5)], Vec::new()),
                curve(vec![(1.0, 0.25)], vec![(0.2, 0.3)]),
            ],
        };
        let rows = "curve,time_s,error_to_leader_m,error_to_leader_m_p5,error_to_leader_m_p95\n\
                    truck 1,0.000,0.50000,0.50000,0.50000\n\
                    truck 1,1.000,0.25000,0.20000,0.30000\n";
        assert_eq!(Body::Curves(curves).table(), rows);
    }

    #[test]
    fn trucks_have_colours_of_their_own() {
        let inks: Vec<(u8, u8, u8)> = (0..4).map(|truck| Ink::of_truck(truck).rgb()).collect();
        for (index, ink) in inks.iter().enumerate() {
            assert!(!inks[..index].contains(ink), "truck {index}");
        }
    }
}
