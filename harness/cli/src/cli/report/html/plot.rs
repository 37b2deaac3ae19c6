//! Plots of a failing check's errors, over each argument, and over the two arguments with the largest influence.

use karat::unstable::record::Plot;
use maud::{Markup, PreEscaped, html};
use plotters::prelude::*;

/// The largest number of arguments with a plot. Arguments with more influence come first.
const MOST: usize = 6;

/// The number of fields along each side of a map. A plot has up to about 500 cases, so a field has 3 or 4 cases on
/// average.
const FIELDS: usize = 12;

/// The number of groups into which Karat splits the cases, to find the variance that an argument explains.
const PARTS: usize = 8;

/// The share of the errors' variance that an argument must explain to appear in the map of two arguments.
const MATTERS: f64 = 0.1;

/// The placeholder for the text colour. The page replaces it.
const INK: RGBColor = RGBColor(1, 2, 3);
const INK_TEXT: &str = "#010203";
const BAD: RGBColor = RGBColor(201, 48, 56);
const GOOD: RGBColor = RGBColor(64, 120, 190);

/// The smallest ratio on the axis. Ratios that aren't finite are at [`TOP`].
const LEAST: f64 = 1e-3;
const TOP: f64 = 1e6;

/// Returns the plots of one path. If a plot can't be drawn, it is left out, because the failure's message also shows
/// the errors.
pub(super) fn figures(plot: &Plot, path: &str, asserted: &str) -> Markup {
    let arguments = by_weight(plot);
    let drawn = arguments.iter().take(MOST).filter_map(|(at, _)| scatter(plot, *at));
    let map = match arguments.as_slice() {
        [(a, first), (b, second), ..] if *first > MATTERS && *second > MATTERS => map(plot, *a, *b),
        _ => None,
    };
    let drawn: Vec<String> = drawn.chain(map).collect();
    html! {
        // With one case, or with only constant arguments, there is nothing to plot.
        @if !drawn.is_empty() {
            figure {
                figcaption {
                    "On " (path) ", each error divided by its bound (" (asserted) "). Each of the " (plot.rows.len())
                    " dots is a case. The line at 1 is the bound, and dots above the line are red. Blank fields of the \
                     map contain no case."
                }
                @for svg in drawn { (PreEscaped(svg)) }
            }
        }
    }
}

fn ratio(row: &[f64]) -> f64 {
    let ratio = row.last().copied().unwrap_or(f64::NAN);
    if ratio.is_finite() { ratio.clamp(LEAST, TOP) } else { TOP }
}

/// Returns the arguments, each with the share of the errors' variance that it explains. The largest share comes first.
/// The variance is computed from the errors' logarithms.
fn by_weight(plot: &Plot) -> Vec<(usize, f64)> {
    let errors: Vec<f64> = plot.rows.iter().map(|row| ratio(row).ln()).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let spread = |values: &[f64]| {
        let middle = mean(values);
        values.iter().map(|value| (value - middle).powi(2)).sum::<f64>()
    };
    let total = spread(&errors);
    let explained = |argument: usize| {
        let mut order: Vec<usize> = (0..errors.len()).collect();
        order.sort_by(|a, b| plot.rows[*a][argument].total_cmp(&plot.rows[*b][argument]));
        let part = errors.len().div_ceil(PARTS).max(1);
        let within: f64 = order
            .chunks(part)
            .map(|part| spread(&part.iter().map(|row| errors[*row]).collect::<Vec<_>>()))
            .sum();
        if total > 0.0 { 1.0 - within / total } else { 0.0 }
    };
    let varies = |argument: &usize| range(plot, *argument).is_some();
    let mut all: Vec<(usize, f64)> =
        (0..plot.arguments.len()).filter(varies).map(|at| (at, explained(at))).collect();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all
}

/// Returns the smallest and the largest finite value of an argument, if they differ.
fn range(plot: &Plot, argument: usize) -> Option<(f64, f64)> {
    let finite = || plot.rows.iter().map(|row| row[argument]).filter(|x| x.is_finite());
    let (lo, hi) = (finite().reduce(f64::min)?, finite().reduce(f64::max)?);
    (lo < hi).then_some((lo, hi))
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

fn titled<'a, 'b>(area: &'a Area<'b>, title: &str) -> ChartBuilder<'a, 'b, SVGBackend<'b>> {
    let mut chart = ChartBuilder::on(area);
    chart.margin(6).x_label_area_size(24).y_label_area_size(52);
    chart.caption(title, ("sans-serif", 13).into_font().color(&INK));
    chart
}

fn svg(size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Option<()>) -> Option<String> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        draw(&area)?;
        area.present().ok()?;
    }
    Some(text.replace(INK_TEXT, "currentColor"))
}

fn scatter(plot: &Plot, argument: usize) -> Option<String> {
    let (lo, hi) = range(plot, argument)?;
    let top = plot.rows.iter().map(|row| ratio(row)).fold(10.0, f64::max) * 2.0;
    svg((360, 220), |area| {
        let text = ("sans-serif", 12).into_font().color(&INK);
        let mut chart = titled(area, &plot.arguments[argument])
            .build_cartesian_2d(lo..hi, (LEAST..top).log_scale())
            .ok()?;
        chart
            .configure_mesh()
            .disable_mesh()
            .axis_style(INK.mix(0.6))
            .label_style(text)
            .y_label_formatter(&|y| format!("{y:.0e}"))
            .draw()
            .ok()?;
        chart.draw_series(LineSeries::new([(lo, 1.0), (hi, 1.0)], INK.mix(0.5))).ok()?;
        let points = plot.rows.iter().filter(|row| row[argument].is_finite()).map(|row| {
            let y = ratio(row);
            let colour = if y > 1.0 { BAD } else { GOOD };
            Circle::new((row[argument], y), 2, colour.mix(0.7).filled())
        });
        chart.draw_series(points).ok()?;
        Some(())
    })
}

/// Plots the largest error in each field of a map over two arguments.
fn map(plot: &Plot, across: usize, up: usize) -> Option<String> {
    let ((x0, x1), (y0, y1)) = (range(plot, across)?, range(plot, up)?);
    let place = |value: f64, lo: f64, hi: f64| {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "it is in range"
        )]
        let at = ((value - lo) / (hi - lo) * FIELDS as f64) as usize;
        at.min(FIELDS - 1)
    };
    let mut fields = [[f64::NAN; FIELDS]; FIELDS];
    for row in plot.rows.iter().filter(|row| row[across].is_finite() && row[up].is_finite()) {
        let field = &mut fields[place(row[up], y0, y1)][place(row[across], x0, x1)];
        *field = field.max(ratio(row));
    }
    let most = plot.rows.iter().map(|row| ratio(row)).fold(10.0, f64::max).ln();
    svg((360, 260), |area| {
        let text = ("sans-serif", 12).into_font().color(&INK);
        let title = format!(
            "x: {}, y: {}, colour: largest error (yellow: {:.0e} x bound)",
            plot.arguments[across],
            plot.arguments[up],
            most.exp()
        );
        let mut chart = titled(area, &title).build_cartesian_2d(x0..x1, y0..y1).ok()?;
        chart
            .configure_mesh()
            .disable_mesh()
            .axis_style(INK.mix(0.6))
            .label_style(text)
            .draw()
            .ok()?;
        let (width, height) = ((x1 - x0) / FIELDS as f64, (y1 - y0) / FIELDS as f64);
        let cells = fields.iter().enumerate().flat_map(|(row, fields)| {
            fields.iter().enumerate().filter(|(_, error)| !error.is_nan()).map(
                move |(column, error)| {
                    let share = (error.ln() - LEAST.ln()) / (most - LEAST.ln());
                    let (x, y) = (x0 + column as f64 * width, y0 + row as f64 * height);
                    let colour = ViridisRGB.get_color(share);
                    Rectangle::new([(x, y), (x + width, y + height)], colour.filled())
                },
            )
        });
        chart.draw_series(cells).ok()?;
        Some(())
    })
}
