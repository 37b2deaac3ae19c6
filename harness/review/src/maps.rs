//! Maps of the difference between golden and frame.

use super::Map;
use karat::Image;
use karat::metric::Flip;
use karat::unstable::metric::ErrorMap;
use karat::unstable::metric::Pair;

/// Returns the maps of a golden and a frame, or none if FLIP can't compare the images.
pub(super) fn maps(pair: &Pair<'_>) -> Vec<Map> {
    let errors = Flip::LARGEST_TILE.map(pair).ok().map(|map| Map {
        name: "HDR-FLIP".to_owned(),
        about: "the difference (0 to 1) that a person sees at the worst exposure".to_owned(),
        image: scalars(pair, |x, y| Some(map.at(x, y))),
        range: [0.0, ErrorMap::scale(map.values())],
    });
    errors.into_iter().chain(worst_exposures(pair)).collect()
}

/// Returns the exposure at which each pixel differs most. Dark exposures show errors in highlights, and bright
/// exposures show errors in shadows.
fn worst_exposures(pair: &Pair<'_>) -> Option<Map> {
    let exposures = Flip::LARGEST_TILE.exposures(pair).ok()?;
    let (start, stop) = exposures.range()?.into_inner();
    Some(Map {
        name: "worst exposure in stops".to_owned(),
        about: "the exposure at which HDR-FLIP sees the largest difference; black where HDR-FLIP sees no difference"
            .to_owned(),
        image: scalars(pair, |x, y| exposures.at(x, y)),
        // With a single exposure, the whole map would have one colour.
        range: [start.floor(), stop.ceil().max(start.floor() + 1.0)],
    })
}

/// Returns a grey image of the pair's size, with `value` at each pixel. Alpha is 0 for pixels without a value.
fn scalars(pair: &Pair<'_>, value: impl Fn(u32, u32) -> Option<f32>) -> Image {
    let (width, height) = (pair.actual().width(), pair.actual().height());
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let pixel = |(x, y)| value(x, y).map_or([0.0; 4], |value| [value, value, value, 1.0]);
    Image::new(width, height, pixels.map(pixel).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_is_mapped() {
        let golden = Image::new(40, 20, vec![[0.5, 0.5, 0.5, 1.0]; 800]);
        let mut actual = golden.clone();
        for index in [410, 411, 450, 451] {
            actual.pixels_mut()[index][1] = 0.75;
        }
        let pair = Pair::new(&golden, &actual).expect("finite");
        let maps = maps(&pair);
        let value = |map: usize, x: usize, y: usize| maps[map].image.pixels()[40 * y + x];
        assert!(value(0, 10, 10)[0] > 0.1 && value(0, 39, 19)[0] < 0.01);
        let [start, stop] = maps[1].range;
        assert!(start < stop && (start..=stop).contains(&value(1, 10, 10)[0]), "{start} {stop}");
        assert_eq!((value(1, 10, 10)[3], value(1, 39, 19)[3]), (1.0, 0.0));
    }
}
