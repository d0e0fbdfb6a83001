//! How the dashboard looks.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Gauge, Paragraph, Row, Table};
use traces::TruthRecord;

use super::state::{Ecu, State};

/// Road shown ahead of the first truck and behind the last one \[m\].
const MARGIN_M: f64 = 35.0;
/// Colours of the trucks, leader first.
const INKS: [Color; 6] =
    [Color::White, Color::LightBlue, Color::Yellow, Color::Green, Color::Magenta, Color::Cyan];

fn ink(truck: usize) -> Color {
    INKS[truck % INKS.len()]
}

/// Draws everything.
pub fn draw(frame: &mut Frame<'_>, state: &State) {
    let rows = state.run.trucks as u16 + 3;
    let [top, road, trucks, ecus, bottom] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(state.run.lanes as u16 + 2),
        Constraint::Length(rows),
        Constraint::Length(rows),
        Constraint::Min(2),
    ])
    .areas(frame.area());
    draw_progress(frame, top, state);
    frame.render_widget(Paragraph::new(lanes(state, road.width)).block(titled("road")), road);
    frame.render_widget(truck_table(state), trucks);
    frame.render_widget(ecu_table(state), ecus);
    let rates: Vec<String> = state.frame_rates().map(|rate| rate.to_string()).collect();
    let buses = format!("frames/s by bus: {}", rates.join("  "));
    let keys = Line::from("q or Ctrl-C ends the run cleanly").dim();
    frame.render_widget(Paragraph::new(vec![Line::from(buses), keys]), bottom);
}

fn titled(title: &str) -> Block<'_> {
    Block::bordered().title(title).border_style(Style::new().dim())
}

fn draw_progress(frame: &mut Frame<'_>, area: Rect, state: &State) {
    let time_s = 1e-9 * state.time_ns() as f64;
    let (run, label) = (
        &state.run,
        match state.truth {
            Some(_) => {
                format!("{}  {time_s:.1} of {:.0} s", state.run.scenario, state.run.duration_s)
            }
            None => format!("{}  preparing", state.run.scenario),
        },
    );
    let share = (time_s / run.duration_s.max(1e-9)).clamp(0.0, 1.0);
    frame.render_widget(Gauge::default().ratio(share).label(label).cyan(), area);
}

/// The lanes as lines of text, the leftmost first.
fn lanes(state: &State, width: u16) -> Vec<Line<'static>> {
    let columns = usize::from(width.saturating_sub(2));
    let lane = |number: usize| match &state.truth {
        Some(truth) => lane_line(state, truth, number, columns),
        None => Line::default(),
    };
    (0..state.run.lanes).rev().map(lane).collect()
}

fn lane_line(state: &State, truth: &TruthRecord, lane: usize, columns: usize) -> Line<'static> {
    let places = || truth.trucks.iter().map(|truck| truck.x_m);
    let from_m = places().fold(f64::INFINITY, f64::min) - MARGIN_M;
    let to_m = places().fold(f64::NEG_INFINITY, f64::max) + MARGIN_M;
    let mut cells = vec![Span::from("·").dim(); columns];
    let is_here = |y_m: f64| {
        let number = (y_m - state.run.right_edge_y_m) / state.run.lane_width_m.max(0.1);
        number.clamp(0.0, state.run.lanes.saturating_sub(1) as f64 + 0.5) as usize == lane
    };
    let mut put = |x_m: f64, y_m: f64, sign: String, style: Style| {
        let place = (x_m - from_m) / (to_m - from_m) * columns as f64;
        if is_here(y_m) && (0.0..columns as f64).contains(&place) {
            cells[place as usize] = Span::styled(sign, style);
        }
    };
    for obstacle in truth.obstacles.iter().filter(|obstacle| obstacle.present) {
        put(obstacle.x_m, obstacle.y_m, "▒".into(), Style::new().red());
    }
    for (index, truck) in truth.trucks.iter().enumerate() {
        let sign = if index == 0 { "L".into() } else { (index % 10).to_string() };
        put(truck.x_m, truck.y_m, sign, Style::new().fg(ink(index)).reversed());
    }
    Line::from(cells)
}

fn truck_table(state: &State) -> Table<'static> {
    // Ten columns are to fit a terminal of 80.
    let header =
        ["truck", "m/s", "err m", "lead m", "y m", "kN", "mrad", "clear m", "Q_ref", "APF"];
    let trucks = state.truth.iter().flat_map(|truth| truth.trucks.iter().enumerate());
    let rows = trucks.map(|(index, truck)| {
        let tick = state.ecus.get(index).and_then(|ecu| ecu.tick);
        let of_law = |value: Option<f32>| value.map_or("-".into(), |value| format!("{value:.1}"));
        let name = if index == 0 { "leader".into() } else { index.to_string() };
        let clear_m = truck.obstacle_clearance_m;
        row([
            name,
            format!("{:.2}", truck.forward_mps),
            format!("{:+.2}", truck.predecessor_error_m),
            format!("{:+.2}", truck.leader_error_m),
            format!("{:+.2}", truck.y_m),
            format!("{:+.2}", 1e-3 * truck.force_command_n),
            format!("{:+.1}", 1e3 * truck.steering_command_rad),
            if clear_m.is_finite() { format!("{clear_m:.1}") } else { "-".into() },
            of_law(tick.map(|tick| tick.adaptive_weight)),
            of_law(tick.map(|tick| tick.potential)),
        ])
        .fg(ink(index))
    });
    table(header, rows.collect(), "trucks")
}

fn ecu_table(state: &State) -> Table<'static> {
    let header =
        ["ECU", "ticks", "p50 µs", "p99 µs", "max µs", "QP", "passed", "late", "", "cause"];
    let rows = state.ecus.iter().enumerate().map(|(index, ecu)| ecu_row(state, index, ecu));
    table(header, rows.collect(), "ECUs, latencies of the last second")
}

fn ecu_row(state: &State, index: usize, ecu: &Ecu) -> Row<'static> {
    let [p50, p99, max] = match ecu.percentiles_us() {
        Some(percentiles_us) => percentiles_us.map(|us| format!("{us:.0}")),
        None => ["-", "-", "-"].map(str::to_owned),
    };
    let is_late = ecu.tick.is_some_and(|tick| u64::from(tick.total_ns) > state.run.period_ns);
    let cells = [
        index.to_string(),
        ecu.ticks.to_string(),
        p50,
        p99,
        max,
        ecu.tick.map_or("-".into(), |tick| tick.qp_iterations.to_string()),
        ecu.skipped.to_string(),
        ecu.late.to_string(),
        if is_late { "LATE".into() } else { String::new() },
        ecu.cause.map_or("-".into(), |cause| cause.word().into()),
    ];
    row(cells).fg(if is_late { Color::Red } else { ink(index) })
}

/// A name, and numbers below each other.
fn row(cells: [impl Into<String>; 10]) -> Row<'static> {
    let cells = cells.into_iter().map(Into::<String>::into).enumerate();
    Row::new(cells.map(|(column, text)| match column {
        0 => Line::from(text),
        _ => Line::from(text).right_aligned(),
    }))
}

fn table(
    header: [&'static str; 10],
    rows: Vec<Row<'static>>,
    title: &'static str,
) -> Table<'static> {
    Table::new(rows, [Constraint::Fill(1); 10]).header(row(header).dim()).block(titled(title))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dashboard::Run;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use traces::{ObstacleTruth, TruckTruth};

    fn drawn(state: &State) -> String {
        let mut terminal = Terminal::new(TestBackend::new(80, 24)).expect("a screen");
        terminal.draw(|frame| draw(frame, state)).expect("draws");
        terminal.backend().to_string()
    }

    #[test]
    fn a_run_is_seen_before_and_after_it_began() {
        let run = Run {
            scenario: "merging".into(),
            duration_s: 60.0,
            trucks: 2,
            right_edge_y_m: -1.875,
            lane_width_m: 3.75,
            lanes: 2,
            ..Run::default()
        };
        let mut state = State::new(run);
        assert!(drawn(&state).contains("merging  preparing"));
        let mut truth = TruthRecord { time_ns: 12_300_000_000, ..TruthRecord::default() };
        for (x_m, y_m) in [(100.0, 0.0), (50.0, 3.75)] {
            let truck = TruckTruth { x_m, y_m, forward_mps: 18.25, ..TruckTruth::default() };
            truth.trucks.push(truck).expect("room");
        }
        let obstacle = ObstacleTruth { x_m: 75.0, present: true, ..ObstacleTruth::default() };
        truth.obstacles.push(obstacle).expect("room");
        state.truth = Some(Box::new(truth));
        let screen = drawn(&state);
        assert!(screen.contains("12.3 of 60 s") && screen.contains("18.25"), "{screen}");
        for word in ["lead m", "mrad", "clear m", "APF", "max µs", "passed", "cause", "q or"] {
            assert!(screen.contains(word), "{word} is cut\n{screen}");
        }
        let line_of = |sign: char| {
            let is_road = |line: &&str| line.contains('·') && line.contains(sign);
            screen.lines().position(|line| is_road(&line))
        };
        let (left, right) = (line_of('1').expect("truck 1"), line_of('L').expect("leader"));
        assert_eq!(right, left + 1, "the leader drives in the lane to the right\n{screen}");
        assert_eq!(line_of('▒'), Some(right), "{screen}");
    }
}
