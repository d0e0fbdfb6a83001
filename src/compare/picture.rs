//! A figure as an SVG picture: one style for all, legible on a phone, told apart without colour
//! vision.
//!
//! Text stays text, so a screen reader reads it and nobody needs our fonts. Curves are labelled
//! where they end, in their colour and in the order in which they end.

mod labels;
mod outline;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::{
    BLACK, Cartesian2d, ChartBuilder, ChartContext, Color, DrawingArea, FontStyle, IntoDrawingArea,
    IntoFont, IntoTextStyle, PathElement, Polygon, RGBColor, Rectangle, SVGBackend, Text,
    TextStyle, WHITE,
};
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::figure::{Axis, Bars, Body, Curves, Figure, Ink, Panel, Strip};
use super::spread::fixed;

/// Width of a picture [units]; pages scale it to theirs.
const WIDTH: u32 = 1600;
/// Height of the figure's title.
const TITLE: u32 = 90;
/// Height of a panel with curves or bars.
const PANEL: u32 = 600;
/// Height of one strip of road.
const STRIP: u32 = 132;
/// Room for the labels on the right.
const RIGHT: u32 = 330;
/// Room for the numbers on the left.
const LEFT: u32 = 150;
/// Size of text.
const TEXT: u32 = 46;
/// Size of titles.
const HEADING: u32 = 54;
/// Width of a curve.
const STROKE: u32 = 6;
const AXIS: RGBColor = RGBColor(0x55, 0x55, 0x55);
const GRID: RGBColor = RGBColor(0xDD, 0xDD, 0xDD);
const ROAD: RGBColor = RGBColor(0xF0, 0xF0, 0xF0);

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn = Result<(), Box<dyn std::error::Error>>;

/// The figure as the text of an SVG file.
pub fn svg(figure: &Figure) -> String {
    let heights: Vec<u32> = figure.panels.iter().map(height).collect();
    let size = (WIDTH, TITLE + heights.iter().sum::<u32>());
    let mut text = String::new();
    let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
    draw(figure, &heights, &root).expect("drawing into a string cannot fail");
    drop(root);
    finished(&text, figure, size)
}

fn draw(figure: &Figure, heights: &[u32], root: &Area<'_>) -> Drawn {
    root.fill(&WHITE)?;
    let (head, mut rest) = root.split_vertically(TITLE);
    head.draw(&Text::new(figure.title.clone(), (20, 20), style(HEADING, &BLACK, true)))?;
    for (panel, &height) in figure.panels.iter().zip(heights) {
        let (area, below) = rest.split_vertically(height);
        draw_panel(panel, &area)?;
        rest = below;
    }
    root.present()?;
    Ok(())
}

fn height(panel: &Panel) -> u32 {
    match &panel.body {
        Body::Road(strips) => 70 + STRIP * strips.len() as u32 + 110,
        Body::Curves(_) | Body::Bars(_) => PANEL,
    }
}

fn draw_panel(panel: &Panel, area: &Area<'_>) -> Drawn {
    if !panel.title.is_empty() {
        area.draw(&Text::new(panel.title.clone(), (LEFT as i32, 8), style(TEXT, &BLACK, true)))?;
    }
    match &panel.body {
        Body::Curves(curves) => draw_curves(curves, area),
        Body::Road(strips) => draw_road(strips, area),
        Body::Bars(bars) => draw_bars(bars, area),
    }
}

fn draw_curves(curves: &Curves, area: &Area<'_>) -> Drawn {
    let points = || curves.curves.iter().flat_map(|curve| &curve.points);
    let bands = curves.curves.iter().flat_map(|curve| &curve.band);
    let x = range(points().map(|(x, _)| *x), 0.0);
    let heights = points().map(|(_, y)| *y).chain(bands.flat_map(|(low, high)| [*low, *high]));
    let y = range(heights, 0.06);
    let mut chart = chart(area, (x.0, x.1), (y.0, y.1), RIGHT)?;
    mesh(&mut chart, Some(&curves.x), &curves.y)?;
    let unit = ((x.1 - x.0) / f64::from(WIDTH), (y.1 - y.0) / f64::from(PANEL));
    for curve in &curves.curves {
        let colour = rgb(curve.ink);
        if !curve.band.is_empty() {
            let outline = outline::of_band(&curve.points, &curve.band, unit);
            chart.draw_series([Polygon::new(outline, colour.mix(0.22))])?;
        }
    }
    for curve in &curves.curves {
        let line = outline::simplified(&curve.points, unit);
        let stroke = rgb(curve.ink).stroke_width(STROKE);
        chart.draw_series([PathElement::new(line, stroke)])?;
    }
    let ends: Vec<labels::End> = curves.curves.iter().filter_map(labels::End::of).collect();
    let plane = chart.plotting_area();
    let (right, _) = plane.map_coordinate(&(x.1, y.0));
    let (_, top) = area.get_base_pixel();
    for (end, place) in labels::spread(ends, |y_value| plane.map_coordinate(&(x.1, y_value)).1) {
        let colour = rgb(end.ink);
        let (from, place) = ((right + 6, place - top), place - top);
        let start = (from.0 + 14, place);
        area.draw(&PathElement::new([from, start], colour.stroke_width(STROKE)))?;
        let label = style(TEXT, &colour, false).pos(Pos::new(HPos::Left, VPos::Center));
        area.draw(&Text::new(end.name, (start.0 + 12, place), label))?;
    }
    Ok(())
}

fn draw_road(strips: &[Strip], area: &Area<'_>) -> Drawn {
    let vehicles = || strips.iter().flat_map(|strip| &strip.vehicles);
    let ends = vehicles().flat_map(|vehicle| [vehicle.rear_m, vehicle.front_m]);
    // What is far away of the platoon would make the platoon small.
    let x = range(ends.map(|metres| metres.clamp(-230.0, 90.0)), 0.02);
    let rows = strips.len() as f64;
    // One unit of y per strip; lanes in its lower four fifths.
    let mut chart = chart(area, x, (0.0, rows), 30)?;
    let axis = Axis::new("Position from the leader", "m");
    chart
        .configure_mesh()
        .disable_y_mesh()
        .disable_y_axis()
        .y_labels(0)
        .light_line_style(WHITE.mix(0.0))
        .bold_line_style(GRID.mix(0.0))
        .axis_style(AXIS.stroke_width(2))
        .label_style(style(TEXT, &AXIS, false))
        .x_label_formatter(&|x| fixed(*x, 0))
        .x_desc(axis.title())
        .draw()?;
    for (row, strip) in strips.iter().enumerate() {
        let base = rows - 1.0 - row as f64;
        let across = |y_m: f64| base + 0.12 + 0.72 * (y_m + 1.875) / 7.5;
        let lanes = [(x.0, across(-1.875)), (x.1, across(5.625))];
        chart.draw_series([Rectangle::new(lanes, ROAD.filled())])?;
        let line = [(x.0, across(1.875)), (x.1, across(1.875))];
        chart.draw_series([PathElement::new(line, WHITE.stroke_width(4))])?;
        for vehicle in strip.vehicles.iter().filter(|v| v.rear_m >= x.0 && v.front_m <= x.1) {
            let half_m = 0.5 * vehicle.width_m;
            let corners = [
                (vehicle.rear_m, across(vehicle.y_m - half_m)),
                (vehicle.front_m, across(vehicle.y_m + half_m)),
            ];
            chart.draw_series([Rectangle::new(corners, rgb(vehicle.ink).filled())])?;
            let label = style(TEXT * 4 / 5, &rgb(vehicle.ink), true);
            let at = (vehicle.rear_m, across(vehicle.y_m));
            let label = label.pos(Pos::new(HPos::Right, VPos::Center));
            chart.draw_series([Text::new(format!("{} ", vehicle.name), at, label)])?;
        }
        let label = style(TEXT, &AXIS, false).pos(Pos::new(HPos::Right, VPos::Center));
        let (left, middle) = chart.plotting_area().map_coordinate(&(x.0, across(1.875)));
        let (_, top) = area.get_base_pixel();
        let time = format!("{} s", fixed(strip.time_s, 0));
        area.draw(&Text::new(time, (left - 12, middle - top), label))?;
    }
    Ok(())
}

fn draw_bars(bars: &Bars, area: &Area<'_>) -> Drawn {
    let all = || bars.groups.iter().flat_map(|group| &group.bars);
    let top = all().map(|bar| bar.band.1).fold(0.0, f64::max);
    let groups = bars.groups.len() as f64;
    let mut chart = chart(area, (0.0, groups), (0.0, 1.08 * top), RIGHT + 160)?;
    mesh(&mut chart, None, &bars.y)?;
    for (place, group) in bars.groups.iter().enumerate() {
        let width = 0.8 / group.bars.len() as f64;
        for (number, bar) in group.bars.iter().enumerate() {
            let left = place as f64 + 0.1 + width * number as f64;
            let corners = [(left + 0.06 * width, 0.0), (left + 0.94 * width, bar.value)];
            chart.draw_series([Rectangle::new(corners, rgb(bar.ink).filled())])?;
            let middle = left + 0.5 * width;
            let whisker = [(middle, bar.band.0), (middle, bar.band.1)];
            chart.draw_series([PathElement::new(whisker, BLACK.stroke_width(4))])?;
        }
    }
    let (_, top) = area.get_base_pixel();
    for (place, group) in bars.groups.iter().enumerate() {
        let (x, y) = chart.plotting_area().map_coordinate(&(place as f64 + 0.5, 0.0));
        let label = style(TEXT, &AXIS, false).pos(Pos::new(HPos::Center, VPos::Top));
        area.draw(&Text::new(group.name.clone(), (x, y - top + 14), label))?;
    }
    let (right, base) = chart.plotting_area().map_coordinate(&(groups, 0.0));
    let names = bars.groups.iter().take(1).flat_map(|group| group.bars.iter().rev());
    for (number, bar) in names.enumerate() {
        let y = base - top - 60 * (number as i32 + 1);
        let square = [(right + 10, y - 16), (right + 42, y + 16)];
        area.draw(&Rectangle::new(square, rgb(bar.ink).filled()))?;
        let label = style(TEXT * 4 / 5, &rgb(bar.ink), false);
        let label = label.pos(Pos::new(HPos::Left, VPos::Center));
        area.draw(&Text::new(bar.name.clone(), (right + 54, y), label))?;
    }
    Ok(())
}

fn chart<'a, 'b>(
    area: &'a Area<'b>,
    x: (f64, f64),
    y: (f64, f64),
    right: u32,
) -> Result<Chart<'a, 'b>, Box<dyn std::error::Error>> {
    let chart = ChartBuilder::on(area)
        .margin_top(70)
        .margin_right(right)
        .x_label_area_size(110)
        .y_label_area_size(LEFT)
        .build_cartesian_2d(x.0..x.1, y.0..y.1)?;
    Ok(chart)
}

/// Axes, numbers and a grid of hair lines; without a horizontal axis, bars stand on it.
fn mesh(chart: &mut Chart<'_, '_>, x: Option<&Axis>, y: &Axis) -> Drawn {
    let mut mesh = chart.configure_mesh();
    mesh.disable_x_mesh()
        .light_line_style(WHITE.mix(0.0))
        .bold_line_style(GRID.stroke_width(2))
        .axis_style(AXIS.stroke_width(2))
        .label_style(style(TEXT, &AXIS, false))
        .axis_desc_style(style(TEXT, &BLACK, false))
        .x_labels(8)
        .y_labels(6)
        .x_label_formatter(&|x| short(*x))
        .y_label_formatter(&|y| short(*y))
        .y_desc(y.title());
    match x {
        Some(axis) => mesh.x_desc(axis.title()).draw()?,
        None => mesh.x_labels(0).draw()?,
    }
    Ok(())
}

/// A number without digits that say nothing.
fn short(value: f64) -> String {
    let text = fixed(value, 3);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// From the least to the largest, and a share of that on either side; never empty.
fn range(values: impl Iterator<Item = f64>, share: f64) -> (f64, f64) {
    let (least, most) = values
        .filter(|value| value.is_finite())
        .fold((f64::MAX, f64::MIN), |(least, most), v| (least.min(v), most.max(v)));
    if least > most {
        return (0.0, 1.0);
    }
    let margin = (share * (most - least)).max(if most == least { 0.5 } else { 0.0 });
    (least - margin, most + margin)
}

fn rgb(ink: Ink) -> RGBColor {
    let (red, green, blue) = ink.rgb();
    RGBColor(red, green, blue)
}

fn style(size: u32, colour: &RGBColor, is_bold: bool) -> TextStyle<'static> {
    let weight = if is_bold { FontStyle::Bold } else { FontStyle::Normal };
    ("sans-serif", f64::from(size), weight).into_font().color(colour).into_text_style(&(0, 0))
}

/// The file with a title for those who cannot see it, and no size of its own.
fn finished(text: &str, figure: &Figure, (width, height): (u32, u32)) -> String {
    let own = format!("<svg width=\"{width}\" height=\"{height}\" ");
    let title = format!("<title>{}: {}</title>", figure.of, figure.title);
    text.replacen(&own, "<svg role=\"img\" ", 1)
        .replacen(">\n", &format!(">\n{title}\n"), 1)
        .replace(" opacity=\"1\"", "")
        .replace(" \"/>", "\"/>")
}
