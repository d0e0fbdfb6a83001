//! The tables and pictures of runs that nobody made: what is written, not what it says.

use std::path::Path;

use bench_sim::{Results, TruckResult};

use super::comparison::Comparison;
use super::design::{Design, Runs};
use super::figure::Figure;
use super::{markdown, page, picture};
use crate::campaign::{Moment, ObstacleMoment, Outcome, TruckMoment};

/// Largest picture [bytes].
const PICTURE_BYTES_MAX: usize = 60_000;

/// A run in which every truck swings a little more than the one before.
fn outcome(seed: u64) -> Outcome {
    let truck = |index| TruckResult {
        index,
        max_abs_leader_error_m: 0.5 + 0.01 * seed as f64,
        max_abs_predecessor_error_m: (0.5 + 0.01 * seed as f64) / (index + 1) as f64,
        settled_position_s: Some(2.0),
        settled_speed_s: Some(3.0),
        min_obstacle_clearance_m: Some(1.2),
        lane_crossings: 2,
        ..TruckResult::default()
    };
    let results = Results { trucks: (0..4).map(truck).collect(), ..Results::default() };
    Outcome { results, ecus: Vec::new(), trajectory: trajectory(), spawn_clearance_m: Some(9.0) }
}

fn trajectory() -> Vec<Moment> {
    let truck = |index: usize, time_s: f64| TruckMoment {
        x_m: 20.0 * time_s - 50.0 * index as f64,
        y_m: if time_s > 2.0 + index as f64 { 3.0 } else { 0.0 },
        speed_mps: 20.0 + (time_s + index as f64).sin(),
        force_n: 1e3 * time_s.cos(),
        steering_rad: 0.01 * time_s.sin(),
        leader_error_m: 0.1 * (time_s - 0.1 * index as f64).sin(),
        predecessor_error_m: 0.05 * time_s.sin(),
        leader_delay_s: 0.1,
        q_ref: 187.5 - time_s,
    };
    let moment = |step: u32| {
        let time_s = 0.25 * f64::from(step);
        let van = ObstacleMoment { x_m: 15.0 * time_s, y_m: 0.0, length_m: 6.0, width_m: 2.2 };
        Moment {
            time_s,
            trucks: (0..4).map(|index| truck(index, time_s)).collect(),
            obstacles: vec![Some(van), None],
        }
    };
    (0..440).map(moment).collect()
}

/// The comparison of every arm's invented runs.
fn comparison() -> (Comparison, Vec<Figure>) {
    let design = Design { seeds: 4, rate_hz: 50, parts: Vec::new() };
    let arms = design.arms();
    let outcomes = arms.values().flat_map(|&seeds| (0..seeds as u64).map(outcome)).collect();
    Comparison::new(&design, &Runs::new(&arms, outcomes))
}

/// Headings, tables' headers and pictures of a Markdown page, without its numbers.
fn skeleton(page: &str) -> Vec<&str> {
    let lines: Vec<&str> = page.lines().collect();
    let is_header =
        |index: usize| lines.get(index + 1).is_some_and(|next| next.starts_with("|---"));
    let kept = |(index, line): (usize, &&str)| {
        line.starts_with('#') || line.starts_with("![") || is_header(index)
    };
    let numbered = lines.iter().enumerate();
    numbered.filter(|&(index, line)| kept((index, line))).map(|(_, line)| *line).collect()
}

fn committed(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

#[test]
fn the_committed_results_are_of_this_program() {
    let committed = committed("docs/results.md");
    let (comparison, _) = comparison();
    let ours = markdown::page(&comparison);
    assert_eq!(
        skeleton(&committed),
        skeleton(&ours),
        "write it again: platoon compare --markdown docs/results.md"
    );
}

#[test]
fn the_committed_pictures_are_there_and_small() {
    let (comparison, _) = comparison();
    for figure in &comparison.figures {
        let text = committed(&format!("docs/{}", figure.picture));
        assert!(text.len() < PICTURE_BYTES_MAX, "{}: {} bytes", figure.picture, text.len());
        assert!(text.contains("<title>"), "{}", figure.picture);
    }
}

#[test]
fn every_result_figure_of_the_paper_is_made() {
    let (comparison, _) = comparison();
    for number in [
        "4", "5a", "5b", "6a", "6b", "8", "9", "10", "12", "13", "14", "15", "16", "17", "19", "20",
    ] {
        let of = format!("Fig. {number}");
        assert!(comparison.figures.iter().any(|figure| figure.of == of), "{of}");
    }
}

#[test]
fn a_picture_is_one_svg_with_a_title_and_text_that_stays_text() {
    let (_, figures) = comparison();
    for figure in &figures {
        let svg = picture::svg(figure);
        assert!(svg.starts_with("<svg role=\"img\" viewBox="), "{}", &svg[..80]);
        assert!(svg.trim_end().ends_with("</svg>"), "{}", figure.file);
        assert_eq!(svg.matches("<svg").count(), 1, "{}", figure.file);
        assert_eq!(svg.matches("<title>").count(), 1, "{}", figure.file);
        assert!(svg.contains("font-family=\"sans-serif\""), "{}", figure.file);
        assert!(svg.len() < PICTURE_BYTES_MAX, "{}: {} bytes", figure.file, svg.len());
    }
}

#[test]
fn every_figure_has_its_numbers_in_rows_of_equal_length() {
    let (_, figures) = comparison();
    for (name, text) in figures.iter().flat_map(Figure::tables) {
        let mut lines = text.lines();
        let header = lines.next().unwrap_or_default();
        let columns = header.split(',').count();
        assert!(header.is_ascii() && columns >= 5, "{name}: {header}");
        let rows =
            lines.inspect(|row| assert_eq!(row.split(',').count(), columns, "{name}: {row}"));
        assert!(rows.count() > 1, "{name}");
    }
}

#[test]
fn the_page_is_at_most_100_columns_wide_and_has_every_claim() {
    let (comparison, _) = comparison();
    let page = anstream::adapter::strip_str(&page::page(&comparison)).to_string();
    // The bar of s̄ stands above its letter and takes no column.
    let takes_room = |c: &char| !('\u{300}'..='\u{36f}').contains(c);
    for line in page.lines() {
        let columns = line.chars().filter(takes_room).count();
        assert!(columns <= 100, "{columns} columns: {line}");
    }
    assert!(comparison.claims.len() > 25, "{} claims", comparison.claims.len());
    for claim in &comparison.claims {
        assert!(!claim.ours.is_empty() && !claim.published.is_empty(), "{claim:?}");
    }
}

#[test]
fn every_field_of_the_json_is_documented() {
    let (comparison, _) = comparison();
    let json = serde_json::to_value(&comparison).expect("a comparison is JSON");
    let docs = committed("docs/compare.md");
    for key in json.as_object().expect("an object").keys() {
        assert!(docs.contains(&format!("| `{key}` |")), "docs/compare.md has no row for {key}");
    }
}

#[test]
fn the_same_runs_give_the_same_bytes() {
    let (one, figures) = comparison();
    let (other, others) = comparison();
    assert_eq!(markdown::page(&one), markdown::page(&other));
    assert_eq!(figures, others);
}
