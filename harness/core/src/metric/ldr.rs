//! LDR-FLIP, the predecessor of HDR-FLIP, compares images as a display shows them (Andersson et al. 2020). Karat can
//! compute it for comparison with other tools, which report LDR-FLIP for PNGs. No tolerance of Karat uses LDR-FLIP,
//! because LDR-FLIP ignores differences above a display's white.

use flip_rs::{FlipError, ldr_flip};

use super::flip::{Flip, FlipFailure, crop};
use super::mask::Rect;
use super::pair::Pair;
use super::tiles::ErrorMap;
use crate::image::encode_srgb;

impl Flip {
    /// The LDR-FLIP errors in the rectangle that the differing pixels affect. Colours are clipped to 0..1 and encoded
    /// as sRGB. LDR-FLIP ignores alpha.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::metric::Flip;
    /// use karat::unstable::metric::Pair;
    ///
    /// // A display shows both values as white.
    /// let grey = |light: f32| Image::new(32, 32, vec![[light, light, light, 1.0]; 1024]);
    /// let (golden, actual) = (grey(2.0), grey(3.0));
    /// let map = Flip::MEAN.displayed(&Pair::new(&golden, &actual)?)?;
    /// assert_eq!(map.at(16, 16), 0.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if FLIP can't compute the errors.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn displayed(&self, pair: &Pair<'_>) -> Result<ErrorMap, FlipFailure> {
        let failed = |error: FlipError| FlipFailure::Parameters(error.to_string());
        let Some(bounds) = bounds(pair) else {
            return Ok(ErrorMap::new(Rect::new(0, 0, 0, 0), Vec::new()));
        };
        let (width, height) = (pair.golden().width(), pair.golden().height());
        // As in HDR-FLIP, only the pixels within reach affect a pixel's error. The results are equal bit for bit.
        let rect = bounds.grown(self.reach(), width, height);
        let read = rect.grown(self.reach(), width, height);
        let golden = crop(pair.golden(), read, displayed).map_err(failed)?;
        let actual = crop(pair.actual(), read, displayed).map_err(failed)?;
        let errors = ldr_flip(&golden, &actual, self.pixels_per_degree).map_err(failed)?;
        let (left, top) = ((rect.left - read.left) as usize, (rect.top - read.top) as usize);
        let rows = errors.pixels().chunks(read.width as usize).skip(top);
        let rows = rows.take(rect.height as usize);
        let values = rows.flat_map(|row| &row[left..left + rect.width as usize]).copied();
        Ok(ErrorMap::new(rect, values.collect()))
    }
}

/// The smallest rectangle that contains all pixels with any difference. `None` if the images are equal.
fn bounds(pair: &Pair<'_>) -> Option<Rect> {
    let mut bounds: Option<[u32; 4]> = None;
    for (start, golden, actual) in pair.different() {
        let pixels = golden.iter().zip(actual).enumerate();
        for (index, _) in pixels.filter(|(_, (golden, actual))| golden != actual) {
            let (x, y) = pair.place(start + index);
            let [left, top, right, bottom] = bounds.unwrap_or([x, y, x, y]);
            bounds = Some([left.min(x), top.min(y), right.max(x), bottom.max(y)]);
        }
    }
    bounds.map(Rect::spanning)
}

fn displayed(linear: f32) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "what FLIP computes with")]
    let encoded = encode_srgb(f64::from(linear).clamp(0.0, 1.0)) as f32;
    encoded
}
