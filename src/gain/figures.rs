//! Pictures of gains: where the trade-off lies, and how much delay a gain bears at which lag.

use certificate::{GainFile, margin};

use crate::compare::figure::{Axis, Body, Curve, Curves, Figure, Ink, Panel};

use super::scan::Merit;

/// Largest commands for which the trade-off is drawn \[m/s²\].
const COMMANDS_MPS2: [f64; 4] = [3.0, 3.5, 4.0, 4.5];
/// Margins for which it is drawn \[s\]: first, last and step.
const MARGINS_S: (f64, f64, f64) = (0.3, 0.7, 0.01);
/// Lags at which margins are drawn \[s\]: first, last and step.
const LAGS_S: (f64, f64, f64) = (0.05, 1.0, 0.025);

fn steps((from, to, step): (f64, f64, f64)) -> impl Iterator<Item = f64> {
    let count = ((to - from) / step).round() as usize;
    (0..=count).map(move |i| from + step * i as f64)
}

/// The least peak over frequency that a gain of the grid has with at least so much margin, one
/// curve per limit of the command; and the published gain, as a mark.
pub fn trade_off(merits: &[Merit], published: &Merit, delay_s: f64) -> Figure {
    let curve = |(place, command): (usize, &f64)| {
        let least = |margin_s: f64| {
            let kept = merits.iter().filter(|m| m.margin_s >= margin_s);
            let kept = kept.filter(|merit| merit.command_mps2 <= *command);
            kept.map(|merit| merit.peak).min_by(f64::total_cmp)
        };
        let points = steps(MARGINS_S).filter_map(|m| Some((1e3 * m, least(m)?))).collect();
        Curve {
            name: format!("to {command} m/s²"), ink: Ink::nth(place), points, band: Vec::new()
        }
    };
    let mut curves: Vec<Curve> = COMMANDS_MPS2.iter().enumerate().map(curve).collect();
    curves.retain(|curve| curve.points.len() > 1);
    curves.push(mark("published", 1e3 * published.margin_s, published.peak));
    Figure {
        of: "Gains".into(),
        file: "gain-trade-off".into(),
        title: "How small an error can be against how long a delay".into(),
        caption: format!(
            "Least peak from disturbance to error at {delay_s} s of delay among all gains of the \
             grid that are stable for a constant delay of at least so much, and command no more \
             than so much in the paper's platooning manoeuvre. The cross is the published gain."
        ),
        panels: vec![Panel {
            title: String::new(),
            body: Body::Curves(Curves {
                x: Axis::new("Stable for constant delays up to", "ms"),
                y: Axis::new("Peak, w to error", "m per m/s²"),
                curves,
            }),
        }],
    }
}

/// A small cross.
fn mark(name: &str, x: f64, y: f64) -> Curve {
    let (dx, dy) = (6.0, 0.015);
    let at = [(-1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.0, 0.0), (1.0, 0.0)];
    Curve {
        name: name.into(),
        ink: Ink::Black,
        points: at.map(|(right, up)| (x + right * dx, y + up * dy)).into(),
        band: Vec::new(),
    }
}

/// The longest delay of every gain at every lag: constant, and at any rate by small gain.
pub fn margins(gains: &[GainFile]) -> Figure {
    let panel = |title: &str, of: fn(&certificate::Gain, f64) -> f64| {
        let curve = |(place, file): (usize, &GainFile)| Curve {
            name: file.name.clone(),
            ink: Ink::nth(place),
            points: steps(LAGS_S).map(|lag_s| (lag_s, 1e3 * of(&file.gain, lag_s))).collect(),
            band: Vec::new(),
        };
        Panel {
            title: title.into(),
            body: Body::Curves(Curves {
                x: Axis::new("Lag of the truck", "s"),
                y: Axis::new("Stable for delays up to", "ms"),
                curves: gains.iter().enumerate().map(curve).collect(),
            }),
        }
    };
    Figure {
        of: "Gains".into(),
        file: "gain-margins".into(),
        title: "How much delay a gain bears".into(),
        caption: "Gains of the library on trucks with gain 1 and any lag. Constant delays: closed \
                  form. Delays of any rate: small gain, which Jensen's inequality equals; \
                  Wirtinger's proves more."
            .into(),
        panels: vec![
            panel("Constant delays", margin::delay_margin_s),
            panel("Delays of any rate, by small gain", margin::any_rate_small_gain_s),
        ],
    }
}
