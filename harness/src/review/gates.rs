//! What the page says of a difference: what was measured against what, and the map of FLIP.

use super::{Gate, Map};
use crate::golden::{MEAN_BOUND, Provenance, TILE_BOUND};
use crate::image::Image;
use crate::metric::{
    self, DEFAULT_RELATIVE, ErrorMap, Flip, Measured, Metric, Outlier, Outliers, Pair, PairError,
    Rect,
};

/// A difference, for people.
pub(super) struct Judged {
    /// In words.
    pub(super) verdict: String,
    pub(super) gates: Vec<Gate>,
    pub(super) maps: Vec<Map>,
}

impl Judged {
    /// There is nothing to measure.
    fn words(verdict: String) -> Self {
        Self { verdict, gates: Vec::new(), maps: Vec::new() }
    }

    /// Compares a frame with its golden, by the bound that it was compared with.
    pub(super) fn of(
        golden: Option<(&Image, Option<&Provenance>)>,
        actual: &Image,
        provenance: &Provenance,
    ) -> Self {
        let census = actual.non_finite();
        if let Some((x, y)) = census.first {
            let gate = Gate {
                name: "pixels with NaN or infinity".to_owned(),
                value: (census.nan + census.infinite) as f64,
                bound: 0.0,
                place: Some([x, y, x, y]),
            };
            let verdict = PairError::NonFinite(census).to_string();
            return Self { gates: vec![gate], ..Self::words(verdict) };
        }
        let Some((golden, made)) = golden else {
            return Self::words("there is no golden yet".to_owned());
        };
        match Pair::new(golden, actual) {
            Ok(pair) => {
                let pinned = made.and_then(|made| made.exposures);
                let pair = match pinned {
                    Some(exposures) => pair.with_exposures(exposures),
                    None => pair,
                };
                Self::measured(&pair, provenance.relative.parse().unwrap_or(DEFAULT_RELATIVE))
            }
            Err(error) => Self::words(error.to_string()),
        }
    }

    fn measured(pair: &Pair<'_>, relative: f32) -> Self {
        let gate = metric::Gate { relative, ..metric::Gate::default() };
        let pixels = pair.compared();
        let Some(Outliers { count, worst, .. }) = gate.outliers(pair) else {
            return Self::words(format!("no pixel is off by more than rel {relative:e}"));
        };
        let verdict = format!("{count} of {pixels} pixels are off by more than rel {relative:e}");
        let Outlier { x, y, ratio, .. } = worst;
        let mut gates = vec![Gate {
            name: "largest relative difference".to_owned(),
            value: f64::from(ratio) * f64::from(relative),
            bound: f64::from(relative),
            place: Some([x, y, x, y]),
        }];
        for (flip, bound) in [(Flip::LARGEST_TILE, TILE_BOUND), (Flip::MEAN, MEAN_BOUND)] {
            let Measured { value, place, .. } = flip.measure(pair);
            gates.push(Gate { name: flip.name(), value, bound, place: place.map(inclusive) });
        }
        let maps = Flip::LARGEST_TILE.map(pair).ok().map(|map| Map {
            name: "HDR-FLIP".to_owned(),
            about: "what an eye sees of the difference, from 0 to 1, of the worst exposure"
                .to_owned(),
            image: grey(&map, actual_size(pair)),
            full: 1.0,
        });
        Self { verdict, gates, maps: maps.into_iter().collect() }
    }
}

fn actual_size(pair: &Pair<'_>) -> (u32, u32) {
    (pair.actual().width(), pair.actual().height())
}

fn inclusive(Rect { left, top, width, height }: Rect) -> [u32; 4] {
    [left, top, left + width.max(1) - 1, top + height.max(1) - 1]
}

/// A map as an image, with the same value in all colours.
fn grey(map: &ErrorMap, (width, height): (u32, u32)) -> Image {
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let pixel = |(x, y)| {
        let value = map.at(x, y);
        [value, value, value, 1.0]
    };
    Image::new(width, height, pixels.map(pixel).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_is_placed_and_mapped() {
        let golden = Image::new(40, 20, vec![[0.5, 0.5, 0.5, 1.0]; 800]);
        let mut actual = golden.clone();
        for index in [410, 411, 450, 451] {
            actual.pixels_mut()[index][1] = 0.75;
        }
        let pair = Pair::new(&golden, &actual).expect("finite");
        let Judged { verdict, gates, maps } = Judged::measured(&pair, 1e-3);
        assert_eq!(verdict, "4 of 800 pixels are off by more than rel 1e-3");
        assert!((gates[0].value - 0.5).abs() < 1e-6, "{gates:?}");
        assert_eq!(gates[0].place, Some([10, 10, 10, 10]));
        let tile = gates[1].place.expect("the largest tile is somewhere");
        assert!(tile[0] <= 10 && tile[2] >= 11 && !gates[1].passes(), "{gates:?}");
        let [map] = &*maps else { panic!("{maps:?}") };
        let value = |x: usize, y: usize| map.image.pixels()[40 * y + x][0];
        assert!(value(10, 10) > 0.1 && value(39, 19) < 0.01);
        assert!(Judged::measured(&pair, 0.6).gates.is_empty());
    }
}
