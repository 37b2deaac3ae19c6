//! The measured difference between two images. Other programs read it as JSON, so add new fields, but don't change
//! existing fields.

use std::path::Path;

use karat::Image;
use karat::golden::FrameTolerance;
use karat::metric::{Flip, Rect};
use karat::unstable::metric::{
    DEFAULT_RELATIVE, ExposureRange, FlipFailure, Gate, Metric, Outliers, Pair,
};
use serde::{Serialize, Serializer};

/// The largest difference between the coordinates of equal primaries. Programs round coordinates differently: D65 is
/// 0.3127 or 0.31271. The coordinates of different primaries differ by more.
const SAME_PRIMARY: f32 = 5e-4;

/// The largest differences that `karat diff` accepts.
#[derive(Clone, Debug)]
pub(super) struct Bounds {
    gate: Gate,
    flip_tile: Option<f64>,
    flip_mean: Option<f64>,
    tolerance: FrameTolerance,
}

impl Bounds {
    /// Returns the bounds that the options set. Without options, returns the default bounds of frames. If `--rel` is
    /// the only option, no bounds apply to FLIP.
    pub(super) fn new(rel: Option<f64>, flip_tile: Option<f64>, flip_mean: Option<f64>) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "checked when it was parsed")]
        let relative = rel.map_or(DEFAULT_RELATIVE, |rel| rel as f32);
        let gate = Gate { relative, absolute: None };
        // If an option sets one bound of FLIP, the other bound keeps its default.
        let (flip_tile, flip_mean) = match rel {
            None => (flip_tile.or(Some(0.01)), flip_mean.or(Some(0.005))),
            Some(_) => (flip_tile, flip_mean),
        };
        let tiles = flip_tile.map(FrameTolerance::FlipTile);
        let flips: Vec<_> =
            tiles.into_iter().chain(flip_mean.map(FrameTolerance::FlipMean)).collect();
        let tolerance = if flips.is_empty() {
            gate.into()
        } else {
            FrameTolerance::Any(vec![gate.into(), FrameTolerance::All(flips)])
        };
        Self { gate, flip_tile, flip_mean, tolerance }
    }
}

#[derive(Clone, Debug, Serialize)]
pub(super) struct Comparison {
    pub(super) a: Side,
    pub(super) b: Side,
    pub(super) verdict: Ending,
    pub(super) reason: Option<Reason>,
    /// The tolerance in words, for users.
    pub(super) tolerance: String,
    /// The number of compared pixels.
    pub(super) compared: usize,
    /// `true` if the mask in the second file selected the compared pixels.
    pub(super) own_mask: bool,
    /// The result of the gate, or `None` if the images can't be compared, for example because their sizes differ.
    pub(super) gate: Option<GateResult>,
    pub(super) flip: Option<FlipResult>,
    /// LDR-FLIP, if both files are PNGs. No bound applies to LDR-FLIP.
    pub(super) ldr_flip: Option<LdrResult>,
    pub(super) heatmap: Option<String>,
    /// The error that the last colour of the heatmap's legend stands for, or `None` if the heatmap is an EXR image,
    /// which contains the errors as numbers.
    pub(super) heatmap_full: Option<f32>,
}

#[derive(Clone, Debug, Serialize)]
pub(super) struct Side {
    pub(super) file: String,
    pub(super) width: u32,
    pub(super) height: u32,
    /// The number of pixels with a NaN.
    pub(super) nan: usize,
    /// The number of pixels that have an infinity, but no NaN.
    pub(super) infinite: usize,
    /// The column and row of the first pixel with a NaN or an infinity.
    pub(super) first_non_finite: Option<(u32, u32)>,
    /// The names of the file's parts with colours, if the file has several. Karat compares the first part.
    pub(super) parts: Vec<String>,
    /// The CIE coordinates x and y of red, green, blue and white, in this order, from the file.
    pub(super) chromaticities: [f32; 8],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Ending {
    /// All compared pixels have equal bits in both images.
    Equal,
    Within,
    Differs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Reason {
    Size,
    NonFinite,
    Values,
}

#[derive(Clone, Debug, Serialize)]
pub(super) struct GateResult {
    pub(super) relative: f32,
    /// The number of pixels whose relative difference is above the bound.
    pub(super) off: usize,
    #[serde(serialize_with = "rect")]
    pub(super) bounds: Option<Rect>,
    pub(super) worst: Option<Worst>,
    /// The percentages of pixels whose difference is above 1, 10, 100 and 1000 times the bound.
    pub(super) sweep: [f32; 4],
}

#[derive(Clone, Debug, Serialize)]
pub(super) struct Worst {
    pub(super) x: u32,
    pub(super) y: u32,
    pub(super) channel: &'static str,
    pub(super) a: f32,
    pub(super) b: f32,
    /// The difference divided by the bound. This ratio is infinite if the bound is 0, and then it is `null` in JSON.
    pub(super) ratio: f32,
}

#[derive(Clone, Debug, Serialize)]
pub(super) struct FlipResult {
    /// The largest mean error of a tile. It is NaN, and `null` in JSON, if FLIP can't measure the difference.
    pub(super) largest_tile: f64,
    #[serde(serialize_with = "rect")]
    pub(super) tile: Option<Rect>,
    pub(super) mean: f64,
    /// The bound for the mean error of each tile, or `None` if there is no such bound.
    pub(super) tile_bound: Option<f64>,
    pub(super) mean_bound: Option<f64>,
    pub(super) exposures: ExposureRange,
    pub(super) note: Option<String>,
}

/// The result of LDR-FLIP, the metric that other tools compute for images made for a display.
#[derive(Clone, Debug, Serialize)]
pub(super) struct LdrResult {
    pub(super) largest_tile: f64,
    #[serde(serialize_with = "rect")]
    pub(super) tile: Option<Rect>,
    pub(super) mean: f64,
}

impl LdrResult {
    pub(super) fn of(pair: &Pair<'_>) -> Result<Self, FlipFailure> {
        let map = Flip::MEAN.displayed(pair)?;
        let (largest_tile, tile) = map.largest_tile(pair);
        let tile = (largest_tile > 0.0).then_some(tile);
        Ok(Self { largest_tile, tile, mean: map.mean(pair) })
    }
}

impl Side {
    pub(super) fn of(
        file: &Path,
        image: &Image,
        parts: Vec<String>,
        chromaticities: [f32; 8],
    ) -> Self {
        let census = image.non_finite();
        Self {
            file: file.display().to_string(),
            width: image.width(),
            height: image.height(),
            nan: census.nan,
            infinite: census.infinite,
            first_non_finite: census.first,
            parts: if parts.len() > 1 { parts } else { Vec::new() },
            chromaticities,
        }
    }
}

impl Comparison {
    /// Returns the comparison of two images whose difference Karat can't measure.
    pub(super) fn impossible([a, b]: [Side; 2], bounds: &Bounds, reason: Reason) -> Self {
        let (verdict, reason) = (Ending::Differs, Some(reason));
        let tolerance = bounds.tolerance.to_string();
        Self {
            a,
            b,
            verdict,
            reason,
            tolerance,
            compared: 0,
            own_mask: false,
            gate: None,
            flip: None,
            ldr_flip: None,
            heatmap: None,
            heatmap_full: None,
        }
    }

    pub(super) fn measure([a, b]: [Side; 2], pair: &Pair<'_>, bounds: &Bounds) -> Self {
        let gate = GateResult::of(bounds.gate, pair);
        let flip = FlipResult::of(bounds, pair);
        let verdict = if pair.is_identical() {
            Ending::Equal
        } else if gate.off == 0 || flip.passes() {
            Ending::Within
        } else {
            Ending::Differs
        };
        Self {
            a,
            b,
            verdict,
            reason: (verdict == Ending::Differs).then_some(Reason::Values),
            tolerance: bounds.tolerance.to_string(),
            compared: pair.compared_count(),
            own_mask: false,
            gate: Some(gate),
            flip: Some(flip),
            ldr_flip: None,
            heatmap: None,
            heatmap_full: None,
        }
    }

    /// Checks if the files have different primaries. Then equal values in the two files are different colours.
    pub(super) fn of_other_primaries(&self) -> bool {
        let mut pairs = self.a.chromaticities.iter().zip(&self.b.chromaticities);
        !pairs.all(|(a, b)| (a - b).abs() <= SAME_PRIMARY)
    }

    pub(super) fn passes(&self) -> bool {
        self.verdict != Ending::Differs
    }
}

impl GateResult {
    fn of(gate: Gate, pair: &Pair<'_>) -> Self {
        let relative = gate.relative;
        match gate.outliers(pair) {
            None => Self { relative, off: 0, bounds: None, worst: None, sweep: [0.0; 4] },
            Some(Outliers { count, rect, worst, sweep }) => {
                let channel = ["red", "green", "blue", "alpha"].get(worst.channel).unwrap_or(&"");
                let worst = Worst {
                    x: worst.x,
                    y: worst.y,
                    channel,
                    a: worst.golden,
                    b: worst.actual,
                    ratio: worst.ratio,
                };
                Self { relative, off: count, bounds: Some(rect), worst: Some(worst), sweep }
            }
        }
    }
}

impl FlipResult {
    fn of(bounds: &Bounds, pair: &Pair<'_>) -> Self {
        let (tile, mean) = (Flip::LARGEST_TILE.measure(pair), Flip::MEAN.measure(pair));
        Self {
            largest_tile: tile.value,
            tile: tile.place,
            mean: mean.value,
            tile_bound: bounds.flip_tile,
            mean_bound: bounds.flip_mean,
            exposures: pair.exposures(),
            note: tile.note,
        }
    }

    /// Checks if at least one bound applies to FLIP, and FLIP exceeds no bound. NaN exceeds any bound.
    fn passes(&self) -> bool {
        let within = |value: f64, bound: Option<f64>| bound.is_none_or(|bound| value <= bound);
        (self.tile_bound.is_some() || self.mean_bound.is_some())
            && within(self.largest_tile, self.tile_bound)
            && within(self.mean, self.mean_bound)
    }
}

#[expect(clippy::ref_option, reason = "serde calls this function with this type")]
fn rect<S: Serializer>(rect: &Option<Rect>, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Corners {
        left: u32,
        top: u32,
        width: u32,
        height: u32,
    }
    rect.map(|Rect { left, top, width, height }| Corners { left, top, width, height })
        .serialize(serializer)
}
