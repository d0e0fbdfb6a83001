//! The paper's result figures from our runs, and two of our own.

use super::arm::{Contender, PLACEMENTS_M, Plant, Situation};
use super::design::{Design, Runs, drivers};
use super::figure::{Axis, Bar, BarGroup, Bars, Body, Curve, Curves, Figure, Ink, Panel};
use super::measure;
use super::road;
use super::spread::{Spread, quantile};
use super::uniformity::Uniformity;
use crate::campaign::{Outcome, TruckMoment};

/// Every figure whose runs were made, in the paper's order.
pub fn figures(design: &Design, runs: &Runs, uniformity: Option<&Uniformity>) -> Vec<Figure> {
    let see = |situation| runs.of(design.arm(situation, Contender::MCF, Plant::SingleTrack));
    let platooning = see(Situation::Platooning);
    let alone = see(Situation::PlatooningWithoutDelay);
    let (merging, avoidance) = (see(Situation::Merging), see(Situation::Avoidance(0)));
    let hil = see(Situation::Hil);
    let mut figures = vec![
        delays(platooning),
        errors("Fig. 5a", "fig05a", "Platooning without delay: position errors", alone),
        errors("Fig. 5b", "fig05b", "Platooning with delay: position errors", platooning),
        speeds("Fig. 6a", "fig06a", "Platooning without delay: speeds", alone),
        speeds("Fig. 6b", "fig06b", "Platooning with delay: speeds", platooning),
        road::movement("Fig. 8", "fig08", "Merging: movement", merging, &road::MERGING_S),
        errors("Fig. 9", "fig09", "Merging: position errors", merging),
        speeds("Fig. 10", "fig10", "Merging: speeds", merging),
        road::movement(
            "Fig. 12",
            "fig12",
            "Obstacle avoidance: movement",
            avoidance,
            &road::AVOIDANCE_S,
        ),
        errors("Fig. 13", "fig13", "Obstacle avoidance: position errors", avoidance),
        speeds("Fig. 14", "fig14", "Obstacle avoidance: speeds", avoidance),
        commands(avoidance),
        weight(avoidance, see(Situation::AvoidancePrintedWeight)),
        bars(design, runs),
        road::movement("Fig. 19", "fig19", "HIL: movement", hil, &road::AVOIDANCE_S),
        errors("Fig. 20", "fig20", "HIL: position errors", hil),
    ];
    figures.push(uniformity.map(Uniformity::figure));
    figures.push(placements(design, runs));
    figures.into_iter().flatten().collect()
}

/// The V2V delays of the links from the leader.
fn delays(outcomes: &[Outcome]) -> Option<Figure> {
    let first = outcomes.first()?;
    let link = |truck| Curve {
        name: format!("to truck {truck}"),
        ink: Ink::of_truck(truck),
        points: course(first, truck, |moment| 1e3 * moment.leader_delay_s),
        band: Vec::new(),
    };
    Some(Figure {
        of: "Fig. 4".into(),
        file: "fig04".into(),
        title: "Time-varying V2V delay".into(),
        caption: "Transport delay of the links from the leader, one seed. Every link and every \
                  seed has its own course between the bounds of 50 and 150 ms."
            .into(),
        panels: vec![Panel {
            title: String::new(),
            body: over_time("Delay", "ms", (1..trucks(first)).map(link).collect()),
        }],
    })
}

/// Position errors to the leader and to the truck ahead.
fn errors(of: &str, file: &str, title: &str, outcomes: &[Outcome]) -> Option<Figure> {
    let first = outcomes.first()?;
    let curves = |value: fn(&TruckMoment) -> f64| {
        (1..trucks(first)).map(|truck| curve(outcomes, truck, value)).collect()
    };
    let leader = curves(|moment| moment.leader_error_m);
    let ahead = curves(|moment| moment.predecessor_error_m);
    Some(Figure {
        of: of.into(),
        file: file.into(),
        title: title.into(),
        caption: caption(outcomes),
        panels: vec![
            Panel {
                title: "to the leader".into(),
                body: over_time("Error to leader", "m", leader),
            },
            Panel {
                title: "to the truck ahead".into(),
                body: over_time("Error to truck ahead", "m", ahead),
            },
        ],
    })
}

/// Everybody's speed.
fn speeds(of: &str, file: &str, title: &str, outcomes: &[Outcome]) -> Option<Figure> {
    let first = outcomes.first()?;
    let speed = |truck| curve(outcomes, truck, |moment| moment.speed_mps);
    Some(Figure {
        of: of.into(),
        file: file.into(),
        title: title.into(),
        caption: caption(outcomes),
        panels: vec![Panel {
            title: String::new(),
            body: over_time("Speed", "m/s", (0..trucks(first)).map(speed).collect()),
        }],
    })
}

/// Forces and steering angles asked for.
fn commands(outcomes: &[Outcome]) -> Option<Figure> {
    let first = outcomes.first()?;
    // One run only: bands of commands that differ in time by a second would hide the commands.
    let one = &outcomes[..1];
    let curves = |value: fn(&TruckMoment) -> f64| {
        (0..trucks(first)).map(|truck| curve(one, truck, value)).collect()
    };
    let force = curves(|moment| 1e-3 * moment.force_n);
    let steering = curves(|moment| moment.steering_rad.to_degrees());
    Some(Figure {
        of: "Fig. 15".into(),
        file: "fig15".into(),
        title: "Obstacle avoidance: commands".into(),
        caption: "Longitudinal force and steering angle asked for by every ECU, one seed.".into(),
        panels: vec![
            Panel { title: "force".into(), body: over_time("Force", "kN", force) },
            Panel { title: "steering".into(), body: over_time("Steering angle", "°", steering) },
        ],
    })
}

/// Q_ref of truck 2, in our unit of the potential and as printed.
fn weight(ours: &[Outcome], printed: &[Outcome]) -> Option<Figure> {
    let (ours, printed) = (ours.first()?, printed.first()?);
    let curve = |name: &str, ink, outcome| Curve {
        name: name.into(),
        ink,
        points: course(outcome, 2, |moment| moment.q_ref),
        band: Vec::new(),
    };
    let curves =
        vec![curve("U / 1000", Ink::Vermilion, ours), curve("as printed", Ink::Grey, printed)];
    Some(Figure {
        of: "Fig. 16".into(),
        file: "fig16".into(),
        title: "Obstacle avoidance: weight of truck 2's reference speed".into(),
        caption: "Q_ref of truck 2, one seed. As printed, Eq. 22 knows near obstacles and none; a \
                  unit of 1000 for the potential makes the weight fall with it, as the text says."
            .into(),
        panels: vec![Panel { title: String::new(), body: over_time("Q_ref", "s²/m²", curves) }],
    })
}

/// The largest errors to the truck ahead, every truck, MCF beside the single-structure MPC.
fn bars(design: &Design, runs: &Runs) -> Option<Figure> {
    let situations = [
        ("platooning", Situation::Platooning),
        ("merging", Situation::Merging),
        ("obstacle avoidance", Situation::Avoidance(0)),
    ];
    let panel = |(name, situation): (&str, Situation)| {
        let bar = |(place, contender): (usize, Contender), truck| {
            let arm = design.arm(situation, contender, Plant::SingleTrack);
            let spread = runs.spread(arm, |o| measure::predecessor_error_m(o, truck))?;
            Some(Bar {
                name: contender.name(),
                ink: Ink::nth(place),
                value: spread.median,
                band: (spread.p5, spread.p95),
            })
        };
        let group = |truck| {
            let bars: Vec<Bar> =
                drivers().into_iter().enumerate().filter_map(|who| bar(who, truck)).collect();
            BarGroup { name: format!("s̄{}", subscript(truck)), bars }
        };
        let groups: Vec<BarGroup> = (1..4).map(group).filter(|g| !g.bars.is_empty()).collect();
        let y = Axis::new("Largest error", "m");
        (!groups.is_empty())
            .then(|| Panel { title: name.into(), body: Body::Bars(Bars { y, groups }) })
    };
    let panels: Vec<Panel> = situations.into_iter().filter_map(panel).collect();
    (!panels.is_empty()).then(|| Figure {
        of: "Fig. 17".into(),
        file: "fig17".into(),
        title: "Largest error to the truck ahead".into(),
        caption:
            "Medians over the seeds with their 5-95 % bands. s̄ᵢ is the position error between \
                  truck i and the truck ahead of it."
                .into(),
        panels,
    })
}

/// The largest error over where obstacle 2 is placed.
fn placements(design: &Design, runs: &Runs) -> Option<Figure> {
    let curve = |(place, contender): (usize, Contender)| {
        let spread = |metres: i8| {
            let situation = Situation::Avoidance(metres);
            let arm = design.arm(situation, contender, Plant::SingleTrack);
            Some((f64::from(metres), runs.spread(arm, measure::largest_predecessor_error_m)?))
        };
        let spreads: Vec<(f64, Spread)> = PLACEMENTS_M.into_iter().filter_map(spread).collect();
        let points: Vec<_> =
            spreads.iter().map(|(metres, spread)| (*metres, spread.median)).collect();
        let band = spreads.iter().map(|(_, spread)| (spread.p5, spread.p95)).collect();
        (points.len() > 1).then(|| Curve {
            name: contender.name(),
            ink: Ink::nth(place),
            points,
            band,
        })
    };
    let curves: Vec<Curve> = drivers().into_iter().enumerate().filter_map(curve).collect();
    (!curves.is_empty()).then(|| Figure {
        of: "placement".into(),
        file: "placement".into(),
        title: "Obstacle avoidance: where obstacle 2 is placed".into(),
        caption:
            "Largest error to the truck ahead over the place of obstacle 2, against its usual \
                  place. The peak is set by how long truck 2 is blocked, not by who controls it."
                .into(),
        panels: vec![Panel {
            title: String::new(),
            body: Body::Curves(Curves {
                x: Axis::new("Obstacle 2 further ahead", "m"),
                y: Axis::new("Largest error", "m"),
                curves,
            }),
        }],
    })
}

/// A panel over time.
pub fn over_time(name: &str, unit: &str, curves: Vec<Curve>) -> Body {
    Body::Curves(Curves { x: Axis::new("Time", "s"), y: Axis::new(name, unit), curves })
}

/// A truck's number over time: the run of the first seed, and the band of all.
pub fn curve(outcomes: &[Outcome], truck: usize, value: fn(&TruckMoment) -> f64) -> Curve {
    Curve {
        name: if truck == 0 { "leader".into() } else { format!("truck {truck}") },
        ink: Ink::of_truck(truck),
        points: course(&outcomes[0], truck, value),
        band: if outcomes.len() > 1 { band(outcomes, truck, value) } else { Vec::new() },
    }
}

fn course(outcome: &Outcome, truck: usize, value: fn(&TruckMoment) -> f64) -> Vec<(f64, f64)> {
    let moments = outcome.trajectory.iter();
    let points = moments.map(|moment| (moment.time_s, value(&moment.trucks[truck])));
    points.filter(|(_, y)| y.is_finite()).collect()
}

/// 5 % and 95 % of the runs at every moment.
fn band(outcomes: &[Outcome], truck: usize, value: fn(&TruckMoment) -> f64) -> Vec<(f64, f64)> {
    let moments = outcomes.iter().map(|outcome| outcome.trajectory.len()).min().unwrap_or(0);
    let at = |index: usize| {
        let value = |outcome: &Outcome| value(&outcome.trajectory[index].trucks[truck]);
        let mut values: Vec<f64> = outcomes.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        (quantile(&values, 0.05), quantile(&values, 0.95))
    };
    (0..moments).map(at).collect()
}

fn trucks(outcome: &Outcome) -> usize {
    outcome.trajectory.first().map_or(0, |moment| moment.trucks.len())
}

fn caption(outcomes: &[Outcome]) -> String {
    match outcomes.len() {
        1 => "One run.".into(),
        many => format!("Lines: the first seed. Shades: 5 to 95 % of {many} seeds."),
    }
}

fn subscript(truck: usize) -> char {
    char::from_u32('₀' as u32 + truck as u32).unwrap_or('?')
}
