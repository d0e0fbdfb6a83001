//! The comparison as Markdown, for `docs/results.md`.

use std::fmt::Write;

use super::claim::Claim;
use super::comparison::Comparison;
use super::improvement::{Improvement, Placement};
use super::requirement::{Judged, Requirement};
use super::spread::fixed;
use crate::summary::Verdict;

/// The page.
pub fn page(comparison: &Comparison) -> String {
    let mut page = String::new();
    // Writing to a string cannot fail.
    let _ = head(&mut page, comparison);
    let _ = claims(&mut page, comparison);
    let _ = table_iii(&mut page, comparison);
    let _ = improvements(&mut page, comparison);
    let _ = placements(&mut page, comparison);
    let _ = requirements(&mut page, comparison);
    let _ = uniformity(&mut page, comparison);
    let _ = loop_rates(&mut page, comparison);
    let _ = scenarios(&mut page, comparison);
    let _ = figures(&mut page, comparison);
    let _ = errata(&mut page, comparison);
    page
}

fn head(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    let Comparison { first_seed, seeds, rate_hz, runs, .. } = comparison;
    let last_seed = first_seed + *seeds as u64 - 1;
    let verdict = match comparison.verdict {
        Verdict::Pass => "everything that we hold ourselves to holds",
        Verdict::Fail => "not everything that we hold ourselves to holds",
    };
    writeln!(
        page,
        "# Results: the paper beside ours\n\n\
         Written by `platoon compare --seeds {seeds} --markdown docs/results.md`, not by hand; \
         [compare.md](compare.md)\nsays how. {runs} runs in virtual time, seeds {first_seed} to \
         {last_seed}, loop at {rate_hz} Hz: {verdict}.\n\n\
         Numbers are medians over the seeds with the 5-95 % band in brackets. sᵢ or ŝᵢ is the \
         position error of truck i\nto the leader, s̄ᵢ that to the truck ahead, as in the paper."
    )
}

fn claims(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    writeln!(page, "\n## Every claim\n")?;
    header(page, &["paper", "about", "published", "ours", "", "why"])?;
    for claim in &comparison.claims {
        let Claim { source, what, published, ours, agreement, why, .. } = claim;
        row(page, &[source, what, published, ours, agreement.word(), why])?;
    }
    Ok(())
}

fn table_iii(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.table_iii.is_empty() {
        return Ok(());
    }
    writeln!(page, "\n## Table III\n")?;
    writeln!(
        page,
        "Scenario `platooning`, delays of 50 to 150 ms. The published DMPC is of passenger cars \
         without delay;\n[dmpc.md](dmpc.md) reproduces it on those. The tuned single-structure MPC \
         extrapolates what it receives and has a\nposition weight of {}, the result of `platoon \
         compare --tune` on seeds 1 to 20.\n",
        comparison.tuned_position_weight
    )?;
    header(page, &["controller", "s̄₂/s̄₁", "s̄₃/s̄₂", "max s̄ m", "published"])?;
    for line in &comparison.table_iii {
        let published = line
            .published
            .map_or("-".into(), |[two, three, max_m]| format!("{two}, {three}, {max_m} m"));
        let numbers = [&line.ratio_2_1, &line.ratio_3_2, &line.max_m].map(|s| s.text(2));
        let [two, three, max] = &numbers;
        row(page, &[&line.controller, two, three, max, &published])?;
    }
    Ok(())
}

fn improvements(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.improvements.is_empty() {
        return Ok(());
    }
    writeln!(page, "\n## Improvement of MCF over the single-structure MPC\n")?;
    writeln!(
        page,
        "In the largest s̄, the error to the truck ahead, of any truck, as in Fig. 17. Raw: \
         position weight 80 on states\nas received. Compensated: the same on states extrapolated \
         to now. Negative: the baseline is better.\n"
    )?;
    header(
        page,
        &["situation", "baseline", "MCF m", "baseline m", "improvement %", "published %"],
    )?;
    for line in &comparison.improvements {
        let Improvement { situation, baseline, published, mcf_m, baseline_m, percent } = line;
        let numbers = [mcf_m.text(2), baseline_m.text(2), percent.text(0)];
        let [mcf, other, percent] = &numbers;
        row(page, &[situation, baseline, mcf, other, percent, published])?;
    }
    Ok(())
}

fn placements(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.placements.is_empty() {
        return Ok(());
    }
    writeln!(page, "\n## Obstacle avoidance: where obstacle 2 is placed\n")?;
    writeln!(
        page,
        "Metres that obstacle 2 is further ahead than usual. The peak is set by how long truck 2 \
         is blocked. At +12 m\nobstacle 2 would appear on top of a truck that lags, which is the \
         scenario's fault and not a controller's.\n"
    )?;
    let names = [
        "obstacle 2",
        "controller",
        "max s̄ m",
        "clearance m",
        "at speed after s",
        "at its appearance m",
    ];
    header(page, &names)?;
    for line in &comparison.placements {
        let Placement { obstacle_2_further_m, contender, .. } = line;
        let numbers = [
            format!("{obstacle_2_further_m:+} m"),
            line.largest_error_m.text(2),
            fixed(line.clearance_m.min, 2),
            line.settled_speed_s.map_or("never".into(), |spread| spread.text(1)),
            fixed(line.spawn_clearance_m.min, 1),
        ];
        let [place, error, clearance, settled, spawn] = &numbers;
        row(page, &[place, contender, error, clearance, settled, spawn])?;
    }
    Ok(())
}

fn requirements(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.requirements.is_empty() {
        return Ok(());
    }
    writeln!(page, "\n## What we hold ourselves to\n")?;
    writeln!(
        page,
        "Least to largest of all seeds, every one of which must keep the limit; with brackets, the \
         median must, and the band is\n5-95 %. Two-track: the verified plant of \
         [plant.md](plant.md).\n"
    )?;
    header(page, &["situation", "what", "limit", "single-track", "two-track", ""])?;
    for line in &comparison.requirements {
        let Requirement { situation, what, unit, digits, single_track, two_track } = line;
        let value =
            |judged: &Option<Judged>| judged.map_or("-".into(), |judged| judged.text(*digits));
        let limit = line.limits();
        let what = if unit.is_empty() { what.clone() } else { format!("{what}, {unit}") };
        let holds = if line.holds() { "holds" } else { "**fails**" };
        row(page, &[situation, &what, &limit, &value(single_track), &value(two_track), holds])?;
    }
    Ok(())
}

fn uniformity(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    let Some(uniformity) = &comparison.uniformity else {
        return Ok(());
    };
    writeln!(page, "\n## Lemma 1: the same disturbance at another time\n")?;
    writeln!(
        page,
        "The envelope is the largest |ŝᵢ| of every truck and seed at a time after the leader's \
         manoeuvre began.\nThey coincide when none is further than {} m from the first.\n",
        uniformity.band_m
    )?;
    header(page, &["begins s", "peak m", "below 0.1 m after s", "furthest from the first m"])?;
    for line in &uniformity.beginnings {
        let numbers = [
            fixed(line.begins_s, 0),
            fixed(line.peak_m, 3),
            fixed(line.settled_s, 2),
            fixed(line.difference_m, 3),
        ];
        row(page, &numbers.each_ref().map(String::as_str))?;
    }
    Ok(())
}

fn loop_rates(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.loop_rates.is_empty() {
        return Ok(());
    }
    writeln!(page, "\n## Loop rates\n")?;
    writeln!(
        page,
        "The real bench runs at 1000 Hz. A slower loop gives the same result within 10 % or 5 cm.\n"
    )?;
    header(page, &["situation", "rate Hz", "max s̄ m", "clearance m", "off %", ""])?;
    for line in &comparison.loop_rates {
        let numbers = [
            line.rate_hz.to_string(),
            fixed(line.largest_error_m, 3),
            line.clearance_m.map_or("-".into(), |clearance_m| fixed(clearance_m, 2)),
            fixed(line.off_percent, 1),
        ];
        let [rate, error, clearance, off] = &numbers;
        let holds = if line.holds { "holds" } else { "**fails**" };
        row(page, &[&line.situation, rate, error, clearance, off, holds])?;
    }
    Ok(())
}

fn scenarios(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.scenarios.is_empty() {
        return Ok(());
    }
    writeln!(page, "\n## Every scenario against its own criteria\n")?;
    header(page, &["scenario", "what happens", "passed", "fails"])?;
    for line in &comparison.scenarios {
        let passed = format!("{} of {}", line.passed, line.runs);
        row(
            page,
            &[&format!("`{}`", line.name), &line.description, &passed, &line.failed.join(", ")],
        )?;
    }
    Ok(())
}

fn figures(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    if comparison.figures.is_empty() {
        return Ok(());
    }
    writeln!(page, "\n## Figures\n")?;
    writeln!(page, "Their numbers as CSV: `platoon compare --out DIR`, in `DIR/data/`.")?;
    for figure in &comparison.figures {
        let (of, title) = (&figure.of, &figure.title);
        writeln!(
            page,
            "\n### {of}: {title}\n\n![{of}: {title}]({})\n\n{}",
            figure.picture, figure.caption
        )?;
    }
    Ok(())
}

fn errata(page: &mut String, comparison: &Comparison) -> std::fmt::Result {
    writeln!(page, "\n## Where the paper contradicts itself or cannot be meant as printed\n")?;
    header(page, &["place", "what", "here"])?;
    for erratum in &comparison.errata {
        row(page, &[erratum.place, erratum.what, erratum.here])?;
    }
    writeln!(page, "\n## What of the paper is not here\n")?;
    header(page, &["place", "what", "why"])?;
    for left_out in &comparison.out_of_scope {
        row(page, &[left_out.place, left_out.what, left_out.why])?;
    }
    Ok(())
}

fn header(page: &mut String, names: &[&str]) -> std::fmt::Result {
    row(page, names)?;
    writeln!(page, "|{}", "---|".repeat(names.len()))
}

fn row(page: &mut String, cells: &[&str]) -> std::fmt::Result {
    let escaped: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
    writeln!(page, "| {} |", escaped.join(" | "))
}
