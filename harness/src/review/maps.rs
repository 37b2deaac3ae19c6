//! Maps of what differs.

use super::Map;
use crate::image::Image;
use crate::metric::{Flip, Pair};

/// What can be computed of golden and frame. Of images that FLIP can't compare there is nothing.
pub(super) fn maps(pair: &Pair<'_>) -> Vec<Map> {
    let errors = Flip::LARGEST_TILE.map(pair).ok().map(|map| Map {
        name: "HDR-FLIP".to_owned(),
        about: "what an eye sees of the difference, from 0 to 1, of the worst exposure".to_owned(),
        image: grey(pair, |x, y| map.at(x, y)),
        range: [0.0, 1.0],
    });
    errors.into_iter().collect()
}

/// An image of the pair's size, with the same value in all colours.
fn grey(pair: &Pair<'_>, value: impl Fn(u32, u32) -> f32) -> Image {
    let (width, height) = (pair.actual().width(), pair.actual().height());
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let pixel = |(x, y)| {
        let value = value(x, y);
        [value, value, value, 1.0]
    };
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
        let value = |x: usize, y: usize| maps[0].image.pixels()[40 * y + x][0];
        assert!(value(10, 10) > 0.1 && value(39, 19) < 0.01);
    }
}
