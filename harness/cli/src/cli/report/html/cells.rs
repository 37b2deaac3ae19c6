//! A map that compares the observed and expected counts of a rejected sampler.

use karat::unstable::record::Histogram;
use maud::{Markup, html};

const WIDTH: f64 = 360.0;
const HEIGHT: f64 = 180.0;

/// The smallest difference, in standard deviations, that has the strongest colour.
const MOST: f64 = 4.0;

/// Draws the difference between each cell's count and its expected count, in standard deviations. In the map, all rows
/// have the same height, and all cells of a row have the same width, so even the small cells of a narrow lobe are
/// visible.
pub(super) fn map(histogram: &Histogram, path: &str) -> Markup {
    let Histogram { axes: [first, second], rows, observed, expected } = histogram;
    let is_line = rows.iter().all(|cells| *cells == 1);
    let rows = if is_line { vec![rows.len()] } else { rows.clone() };
    let height = HEIGHT / rows.len().max(1) as f64;
    let cells = rows.iter().enumerate().flat_map(|(row, cells)| {
        let width = WIDTH / (*cells).max(1) as f64;
        (0..*cells).map(move |column| (column as f64 * width, row as f64 * height, width))
    });
    let numbers = observed.iter().zip(expected);
    let (down, across) = if is_line { ("", first) } else { (first.as_str(), second) };
    html! {
        figure {
            figcaption {
                "Samples in each of " (expected.len()) " cells on " (path) ", compared with the expected number. A cell is red \
                 if it has too many samples, and blue if it has too few. The colour is strongest at " (MOST) " standard deviations. "
                (across) " increases to the right" @if !down.is_empty() { ", " (down) " downwards" }
                ". All cells have the same size in this map."
            }
            svg width=(WIDTH) height=(HEIGHT) role="img" aria-label="counts compared with expected counts" {
                @for ((x, y, width), (observed, expected)) in cells.zip(numbers) {
                    @let sigma = deviation(*observed, *expected);
                    rect x=(number(x)) y=(number(y)) width=(number(width)) height=(number(height))
                        fill=(if sigma > 0.0 { "#c93038" } else { "#4078be" })
                        fill-opacity=(number((sigma.abs() / MOST).min(1.0))) {
                        title { (observed) ", expected " (number(*expected)) " (" (format!("{sigma:+.1}")) " sigma)" }
                    }
                }
                rect class="frame" x="0" y="0" width=(WIDTH) height=(HEIGHT) fill="none" stroke="currentColor" {}
            }
        }
    }
}

fn deviation(observed: u64, expected: f64) -> f64 {
    let observed = observed as f64;
    match () {
        () if observed == expected => 0.0,
        () if expected > 0.0 => (observed - expected) / expected.sqrt(),
        () => f64::INFINITY,
    }
}

fn number(value: f64) -> String {
    format!("{value:.2}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: Vec<usize>, observed: Vec<u64>, expected: Vec<f64>) -> String {
        let axes = ["theta", "phi"].map(str::to_owned);
        map(&Histogram { axes, rows, observed, expected }, "cpu").into_string()
    }

    #[test]
    fn each_cell_of_a_histogram_is_drawn_at_its_place() {
        let map = of(vec![1, 2], vec![100, 80, 0], vec![100.0, 100.0, 0.0]);
        assert_eq!(map.matches("<rect").count(), 4, "{map}");
        assert!(
            map.contains("x=\"180.00\" y=\"90.00\" width=\"180.00\" height=\"90.00\""),
            "{map}"
        );
        assert!(
            map.contains("80, expected 100.00 (-2.0 sigma)")
                && map.contains("fill-opacity=\"0.50\""),
            "{map}"
        );
        // A one-dimensional histogram is one row.
        let line = of(vec![1, 1], vec![1, 9], vec![5.0, 5.0]);
        assert!(
            line.contains("height=\"180.00\" fill")
                && line.contains("theta increases to the right"),
            "{line}"
        );
        // The sample lies in a cell with probability 0.
        assert!(of(vec![1], vec![1], vec![0.0]).contains("+inf sigma"));
    }
}
