//! What the page says of a difference: the gate of relative differences, and where it is worst.

use super::Gate;
use crate::golden::{DEFAULT_RELATIVE, FrameDifference, Provenance};
use crate::image::Image;

/// What is darker than this share of the golden's key is compared as if it were that bright, as
/// in the comparison of frames.
const DARK: f32 = 1e-4;

/// The verdict in words, and the gates behind it.
pub(super) fn judge(
    golden: Option<&Image>,
    actual: &Image,
    provenance: &Provenance,
) -> (String, Vec<Gate>) {
    let census = actual.non_finite();
    if let Some((x, y)) = census.first {
        let gate = Gate {
            name: "pixels with NaN or infinity".to_owned(),
            value: (census.nan + census.infinite) as f64,
            bound: 0.0,
            place: Some([x, y, x, y]),
        };
        return (FrameDifference::NonFinite(census).to_string(), vec![gate]);
    }
    let Some(golden) = golden else { return ("there is no golden yet".to_owned(), Vec::new()) };
    let size = |image: &Image| (image.width(), image.height());
    if size(golden) != size(actual) {
        let (golden, actual) = (size(golden), size(actual));
        return (FrameDifference::Size { golden, actual }.to_string(), Vec::new());
    }
    let census = golden.non_finite();
    if census.first.is_some() {
        return (FrameDifference::GoldenNonFinite(census).to_string(), Vec::new());
    }
    let bound = provenance.relative.parse().unwrap_or(DEFAULT_RELATIVE);
    let worst = Worst::of(golden, actual, bound);
    let pixels = golden.pixels().len();
    let verdict = match worst.outliers {
        0 => format!("no pixel is off by more than rel {bound:e}"),
        outliers => format!("{outliers} of {pixels} pixels are off by more than rel {bound:e}"),
    };
    let (x, y) = worst.at;
    let gate = Gate {
        name: "largest relative difference".to_owned(),
        value: f64::from(worst.relative),
        bound: f64::from(bound),
        place: Some([x, y, x, y]),
    };
    (verdict, vec![gate])
}

/// The pixel that differs most, and how many differ too much.
struct Worst {
    relative: f32,
    at: (u32, u32),
    outliers: usize,
}

impl Worst {
    /// Of two images of the same size and finite values.
    fn of(golden: &Image, actual: &Image, bound: f32) -> Self {
        let dark = golden.key() * DARK;
        let mut worst = Self { relative: 0.0, at: (0, 0), outliers: 0 };
        for (index, (g, a)) in (0..).zip(golden.pixels().iter().zip(actual.pixels())) {
            let relative = (0..4).map(|channel| {
                // Alpha has no dark end.
                let least = if channel == 3 { f32::MIN_POSITIVE } else { dark };
                (a[channel] - g[channel]).abs() / g[channel].abs().max(least)
            });
            let relative = relative.fold(0.0, f32::max);
            worst.outliers += usize::from(relative > bound);
            if relative > worst.relative {
                worst.relative = relative;
                worst.at = (index % golden.width(), index / golden.width());
            }
        }
        worst
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_pixel_is_placed_and_the_dark_is_not_the_worst() {
        let golden = Image::new(3, 2, vec![[1.0, 1.0, 1.0, 1.0]; 6]);
        let mut actual = golden.clone();
        actual.pixels_mut()[4][1] = 1.5;
        let worst = Worst::of(&golden, &actual, 1e-3);
        assert_eq!((worst.relative, worst.at, worst.outliers), (0.5, (1, 1), 1));

        let mut golden = golden;
        golden.pixels_mut()[0][0] = 0.0;
        actual.pixels_mut()[0][0] = 1e-6;
        assert_eq!(Worst::of(&golden, &actual, 1e-3).at, (1, 1));
    }
}
