//! Draws the results of a sweep as curves, in a file or in the terminal.

use std::io::Write;
use std::path::Path as FilePath;

use anyhow::{Context, ensure};
use karat::unstable::image::write_whole;
use karat::unstable::output::counted;
use plotters::prelude::*;

use crate::cli::terminal::{self, Size};

/// A curve with the values of one component of the results, on one path.
pub(super) struct Curve {
    pub(super) name: String,
    pub(super) points: Vec<(f64, f64)>,
}

/// The number of terminal columns that a plot needs for the numbers beside its curve.
const BESIDE: usize = 15;
const BELOW: usize = 6;
/// The width of a curve in characters, if the output doesn't go to a terminal.
const COLUMNS: usize = 65;
const ROWS: usize = 18;
/// The smallest number of columns or rows that can show a curve.
const LEAST: usize = 8;

/// The characters that draw the points of the first curve, of the second curve, and so on.
const MARKS: [char; 6] = ['*', 'o', '+', 'x', '#', '@'];

/// Returns the smallest and the largest value on the horizontal axis and on the vertical axis, or `None` if no point is
/// finite.
fn ends(curves: &[Curve]) -> Option<[(f64, f64); 2]> {
    let points = || {
        let all = curves.iter().flat_map(|curve| &curve.points);
        all.filter(|(x, y)| x.is_finite() && y.is_finite())
    };
    let of = |value: &dyn Fn(&(f64, f64)) -> f64| {
        let values = || points().map(value);
        let (lo, hi) = (values().reduce(f64::min)?, values().reduce(f64::max)?);
        // If the value is constant, the axis extends on both sides.
        let room = if lo < hi { 0.0 } else { 0.5 * lo.abs().max(1.0) };
        Some((lo - room, hi + room))
    };
    // The axis covers the whole sweep, including points with a result that isn't finite.
    let swept = || curves.iter().flat_map(|curve| &curve.points).map(|point| point.0);
    let swept = (swept().reduce(f64::min)?, swept().reduce(f64::max)?);
    let across = if swept.0 < swept.1 { swept } else { of(&|point| point.0)? };
    Some([across, of(&|point| point.1)?])
}

/// Formats a number at an axis, in few characters.
fn tick(value: f64) -> String {
    match value == 0.0 || (1e-3..1e6).contains(&value.abs()) {
        true => format!("{value:.4}"),
        false => format!("{value:.4e}"),
    }
}

/// Draws curves with characters.
pub(super) fn write_text(curves: &[Curve], axis: &str, out: &mut dyn Write) -> anyhow::Result<()> {
    let Some([(left, right), (bottom, top)]) = ends(curves) else {
        anyhow::bail!("no result of the sweep is finite, so Karat can't draw a curve");
    };
    let Size { columns, rows } = terminal::size();
    let wide = columns.map_or(COLUMNS, |columns| columns.saturating_sub(BESIDE).max(LEAST));
    let high = rows.saturating_sub(BELOW).clamp(LEAST, ROWS);
    let mut field = vec![vec![' '; wide]; high];
    let place = |value: f64, lo: f64, hi: f64, count: usize| {
        let share = (value - lo) / (hi - lo);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "it lies between the ends"
        )]
        let at = (share * (count - 1) as f64).round() as usize;
        at.min(count - 1)
    };
    // The first curve is drawn last, over the other curves.
    for (index, curve) in curves.iter().enumerate().rev() {
        let mark = MARKS[index % MARKS.len()];
        for (x, y) in curve.points.iter().filter(|(_, y)| y.is_finite()) {
            let column = place(*x, left, right, wide);
            field[high - 1 - place(*y, bottom, top, high)][column] = mark;
        }
    }
    for (row, marks) in field.iter().enumerate() {
        let label = match row {
            0 => tick(top),
            _ if row == high - 1 => tick(bottom),
            _ => String::new(),
        };
        let line: String = marks.iter().collect();
        writeln!(out, "{label:>12} |{}", line.trim_end())?;
    }
    writeln!(out, "{:>12} +{}", "", "-".repeat(wide))?;
    let (left, right) = (format!("{axis} = {}", tick(left)), tick(right));
    let gap = wide.saturating_sub(left.len() + right.len());
    writeln!(out, "{:>14}{left}{}{right}", "", " ".repeat(gap))?;
    for (curve, mark) in curves.iter().zip(MARKS.iter().cycle()) {
        let gone = curve.points.iter().filter(|(_, y)| !y.is_finite()).count();
        let hidden = !field.iter().flatten().any(|own| own == mark) && curves.len() <= MARKS.len();
        let gone = match gone {
            0 if hidden => " (behind the other curves)".to_owned(),
            0 => String::new(),
            count => format!(" (not finite: {})", counted(count, "point")),
        };
        writeln!(out, "{:>14}{mark} {}{gone}", "", curve.name)?;
    }
    Ok(())
}

/// Draws curves into an SVG file.
pub(super) fn write_svg(curves: &[Curve], axis: &str, file: &FilePath) -> anyhow::Result<()> {
    let ends = ends(curves);
    ensure!(ends.is_some(), "no result of the sweep is finite, so Karat can't draw a curve");
    let [(left, right), (bottom, top)] = ends.unwrap_or_default();
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (720, 440)).into_drawing_area();
        let drawn = || -> Result<(), Box<dyn std::error::Error>> {
            area.fill(&WHITE)?;
            let mut chart = ChartBuilder::on(&area)
                .margin(12)
                .x_label_area_size(36)
                .y_label_area_size(64)
                .build_cartesian_2d(left..right, bottom..top)?;
            chart.configure_mesh().x_desc(axis).draw()?;
            for (index, curve) in curves.iter().enumerate() {
                let colour = Palette99::pick(index).to_rgba();
                // A point that isn't finite splits its curve.
                for part in curve.points.split(|(_, y)| !y.is_finite()) {
                    chart.draw_series(LineSeries::new(part.iter().copied(), colour))?;
                }
                let first = curve.points.iter().take(1).copied();
                let label = chart.draw_series(LineSeries::new(first, colour))?;
                label
                    .label(&curve.name)
                    .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 14, y)], colour));
            }
            chart.configure_series_labels().border_style(BLACK.mix(0.3)).draw()?;
            area.present()?;
            Ok(())
        };
        drawn().map_err(|error| anyhow::anyhow!("can't draw the curve: {error}"))?;
    }
    write_whole(file, text.as_bytes()).with_context(|| format!("can't write `{}`", file.display()))
}
