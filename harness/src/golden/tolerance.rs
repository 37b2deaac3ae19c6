//! The tolerance of a frame.

use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::number;
use crate::metric::{DEFAULT_RELATIVE, Flip, Gate, Measured, Metric, Pair, Rect};
use crate::tolerance::{power, significant};

/// The largest mean FLIP error that a tile may have on the profile that made the golden. Measured errors: rounding to
/// half floats gives 0.004, twenty changed pixels at edges give 0.02, and faults of shaders give 0.09 and more.
const TILE_BOUND: f64 = 0.01;
/// The largest mean FLIP error that a tile may have on a profile that didn't make the golden. The rasteriser of another
/// profile may fill other pixels at edges.
const FOREIGN_TILE_BOUND: f64 = 0.03;
/// The largest mean FLIP error that a frame may have.
const MEAN_BOUND: f64 = 0.005;

/// The tolerance of a frame: bounds of metrics, and combinations of bounds.
///
/// The default is [`FrameTolerance::standard`].
///
/// ```
/// use karat::golden::FrameTolerance;
///
/// let tolerance = FrameTolerance::Any(vec![FrameTolerance::gate(1e-3), FrameTolerance::FlipMean(0.01)]);
/// assert_eq!(tolerance.to_string(), "rel 1e-3 or mean FLIP 0.01");
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum FrameTolerance {
    /// A bound for each channel of each pixel. See [`Gate`].
    Gate(Gate),
    /// The largest mean HDR-FLIP error that a tile of 16 x 16 pixels may have.
    FlipTile(f64),
    /// The largest mean HDR-FLIP error that the frame may have.
    FlipMean(f64),
    /// A metric, and the largest value that passes.
    Metric(Arc<dyn Metric>, f64),
    /// Passes if all tolerances in the list pass.
    All(Vec<Self>),
    /// Passes if any tolerance in the list passes. The first tolerance that passes decides the verdict.
    Any(Vec<Self>),
}

impl FrameTolerance {
    /// A bound for the relative difference of each channel of each pixel. See [`Gate`].
    ///
    /// ```
    /// use karat::golden::FrameTolerance;
    ///
    /// assert_eq!(FrameTolerance::gate(1e-2).to_string(), "rel 1e-2");
    /// ```
    #[must_use]
    pub fn gate(relative: f32) -> Self {
        Self::Gate(Gate { relative, absolute: None })
    }

    /// A metric of your own, and the largest value that passes.
    ///
    /// ```
    /// use karat::golden::FrameTolerance;
    /// use karat::metric::Flip;
    ///
    /// let tolerance = FrameTolerance::metric(Flip::MEAN, 0.02);
    /// # let _ = tolerance;
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn metric(metric: impl Metric + 'static, bound: f64) -> Self {
        Self::Metric(Arc::new(metric), bound)
    }

    /// The default tolerance. A frame passes if the relative difference of each channel of each pixel is at most 1e-3.
    /// The frame also passes if its HDR-FLIP errors are small: a mean of at most 0.01 in each tile, and of at most
    /// 0.005 in the whole frame. If another profile made the golden (`foreign`), the mean in each tile may be up to
    /// 0.03.
    ///
    /// ```
    /// use karat::golden::FrameTolerance;
    ///
    /// let text = FrameTolerance::standard(false).to_string();
    /// assert_eq!(text, "rel 1e-3 or (FLIP tile 0.01 and mean FLIP 0.005)");
    /// ```
    #[must_use]
    pub fn standard(foreign: bool) -> Self {
        let tile = if foreign { FOREIGN_TILE_BOUND } else { TILE_BOUND };
        let flip = Self::All(vec![Self::FlipTile(tile), Self::FlipMean(MEAN_BOUND)]);
        Self::Any(vec![Self::gate(DEFAULT_RELATIVE), flip])
    }

    /// Describes the first useless bound, which every frame or no frame would pass; `None` if all bounds are useful.
    pub(crate) fn unusable(&self) -> Option<String> {
        let number = |bound: f64| !(bound >= 0.0 && bound.is_finite());
        // A black frame passes a relative bound of 1, and every frame passes a FLIP bound of 1.
        let share = |bound: f64| !(0.0..1.0).contains(&bound);
        match self {
            Self::Gate(Gate { relative, .. }) if share(f64::from(*relative)) => {
                Some(format!("{relative}; a relative difference must be at least 0 and below 1"))
            }
            Self::Gate(Gate { absolute: Some(absolute), .. }) if number(f64::from(*absolute)) => {
                Some(format!("{absolute}; an absolute difference must be at least 0"))
            }
            Self::Gate(_) => None,
            Self::FlipTile(bound) | Self::FlipMean(bound) if share(*bound) => {
                Some(format!("{bound}; FLIP errors are from 0 to 1, so a bound must be below 1"))
            }
            Self::FlipTile(_) | Self::FlipMean(_) => None,
            Self::Metric(metric, bound) if *bound >= metric.most() && bound.is_finite() => {
                let (name, most) = (metric.name(), metric.most());
                Some(format!("{bound}; the {name} is {most} at most, so a bound must be smaller"))
            }
            Self::Metric(_, bound) => {
                let no_bound = format!("{bound}; a bound must be a number of at least 0");
                number(*bound).then_some(no_bound)
            }
            Self::All(parts) | Self::Any(parts) if parts.is_empty() => {
                Some("an empty list of bounds; add at least one bound".to_owned())
            }
            Self::All(parts) | Self::Any(parts) => parts.iter().find_map(Self::unusable),
        }
    }

    pub(super) fn first_gate(&self) -> Option<Gate> {
        match self {
            Self::Gate(gate) => Some(*gate),
            Self::All(parts) | Self::Any(parts) => parts.iter().find_map(Self::first_gate),
            _ => None,
        }
    }

    /// Measures the criteria of the tolerance in order, and stops at the first criterion of [`Any`](Self::Any) that
    /// passes.
    pub(super) fn judge(&self, pair: &Pair<'_>) -> Judgement {
        let leaf = |criterion: FrameCriterion, metric: &dyn Metric, bound: f64| {
            let Measured { value, place, note, .. } = metric.measure(pair);
            let margin =
                CriterionMargin { criterion, name: metric.name(), value, bound, place, note };
            Judgement { passes: margin.passes(), decisive: 0, margins: vec![margin] }
        };
        match self {
            Self::Gate(gate) => leaf(FrameCriterion::Gate, gate, 1.0),
            Self::FlipTile(bound) => leaf(FrameCriterion::Flip, &Flip::LARGEST_TILE, *bound),
            Self::FlipMean(bound) => leaf(FrameCriterion::Flip, &Flip::MEAN, *bound),
            Self::Metric(metric, bound) => leaf(FrameCriterion::Metric, metric.as_ref(), *bound),
            Self::All(parts) => {
                let mut all = Judgement { passes: true, decisive: 0, margins: Vec::new() };
                for judged in parts.iter().map(|part| part.judge(pair)) {
                    // A part that fails decides. If all parts pass, the part with the largest ratio decides.
                    let tighter = all.margins.get(all.decisive).is_none_or(|so_far| {
                        let new = judged.margins[judged.decisive].ratio();
                        (all.passes && !judged.passes)
                            || (all.passes == judged.passes && new > so_far.ratio())
                    });
                    if tighter {
                        all.decisive = all.margins.len() + judged.decisive;
                    }
                    all.passes &= judged.passes;
                    all.margins.extend(judged.margins);
                }
                all
            }
            Self::Any(parts) => {
                let mut any = Judgement { passes: false, decisive: 0, margins: Vec::new() };
                for judged in parts.iter().map(|part| part.judge(pair)) {
                    let before = any.margins.len();
                    any.margins.extend(judged.margins);
                    if judged.passes {
                        (any.passes, any.decisive) = (true, before + judged.decisive);
                        break;
                    }
                }
                any
            }
        }
    }
}

impl Default for FrameTolerance {
    fn default() -> Self {
        Self::standard(false)
    }
}

impl From<f32> for FrameTolerance {
    fn from(relative: f32) -> Self {
        Self::gate(relative)
    }
}

impl From<Gate> for FrameTolerance {
    fn from(gate: Gate) -> Self {
        Self::Gate(gate)
    }
}

/// `rel 1e-3 or (FLIP tile 0.01 and mean FLIP 0.005)`
impl fmt::Display for FrameTolerance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (parts, word) = match self {
            Self::Gate(Gate { relative, absolute: None }) => {
                return write!(f, "rel {}", power(*relative));
            }
            Self::Gate(Gate { relative, absolute: Some(absolute) }) => {
                return write!(f, "rel {} or abs {}", power(*relative), power(*absolute));
            }
            Self::FlipTile(bound) => return write!(f, "FLIP tile {bound}"),
            Self::FlipMean(bound) => return write!(f, "mean FLIP {bound}"),
            Self::Metric(metric, bound) => return write!(f, "{} {bound}", metric.name()),
            Self::All(parts) => (parts, " and "),
            Self::Any(parts) => (parts, " or "),
        };
        for (index, part) in parts.iter().enumerate() {
            f.write_str(if index == 0 { "" } else { word })?;
            match part {
                Self::All(_) | Self::Any(_) => write!(f, "({part})")?,
                part => write!(f, "{part}")?,
            }
        }
        Ok(())
    }
}

/// The criteria that decide the verdict on a frame, the cheapest first.
///
/// ```
/// use karat::Image;
/// use karat::golden::FrameTolerance;
/// use karat::unstable::golden::FrameCriterion;
///
/// let (golden, actual) = (Image::new(1, 1, vec![[0.5; 4]]), Image::new(1, 1, vec![[0.5001; 4]]));
/// let margin = FrameTolerance::gate(1e-3).compare(&golden, &actual, None)?;
/// assert_eq!(margin.decided_by, FrameCriterion::Gate);
/// # Ok::<(), karat::unstable::golden::FrameDifference>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum FrameCriterion {
    /// Every value is a finite number.
    Finite,
    /// Every bit is equal.
    Bits,
    /// Each channel of each pixel is within the gate: see [`Gate`].
    Gate,
    /// HDR-FLIP errors are small: see [`Flip`].
    Flip,
    /// A metric of your own.
    Metric,
    /// The noise of frame and golden explains every difference: see
    /// [`Frame::noise`](crate::Frame::noise).
    Noise,
}

/// The value of a metric, and its bound.
///
/// ```
/// # use karat::Image;
/// # use karat::golden::FrameTolerance;
/// # let (golden, actual) = (Image::new(1, 1, vec![[0.5; 4]]), Image::new(1, 1, vec![[0.5001; 4]]));
/// let margin = FrameTolerance::gate(1e-3).compare(&golden, &actual, None)?;
/// for one in &margin.margins {
///     println!("{}: {} of {}", one.name, one.value, one.bound);
/// }
/// # Ok::<(), karat::unstable::golden::FrameDifference>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CriterionMargin {
    /// The kind of metric.
    pub criterion: FrameCriterion,
    /// The metric's name.
    pub name: String,
    /// The measured value.
    #[serde(with = "number")]
    pub value: f64,
    /// The largest value that passes.
    pub bound: f64,
    /// The rectangle of pixels for which Karat measured the value; `None` if the value belongs to the whole frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<Rect>,
    /// A remark on the measurement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

impl CriterionMargin {
    /// Checks if the value is within the bound. NaN never passes.
    ///
    /// ```
    /// # use karat::Image;
    /// # use karat::golden::FrameTolerance;
    /// # let (golden, actual) = (Image::new(1, 1, vec![[0.5; 4]]), Image::new(1, 1, vec![[0.5001; 4]]));
    /// let margin = FrameTolerance::gate(1e-3).compare(&golden, &actual, None)?;
    /// assert!(margin.margins[0].passes());
    /// # Ok::<(), karat::unstable::golden::FrameDifference>(())
    /// ```
    #[must_use]
    pub fn passes(&self) -> bool {
        self.value <= self.bound
    }

    /// The value divided by its bound.
    ///
    /// ```
    /// # use karat::Image;
    /// # use karat::golden::FrameTolerance;
    /// # let (golden, actual) = (Image::new(1, 1, vec![[0.5; 4]]), Image::new(1, 1, vec![[0.5001; 4]]));
    /// let margin = FrameTolerance::gate(1e-3).compare(&golden, &actual, None)?;
    /// assert!(margin.margins[0].ratio() < 0.5); // less than half of what is allowed
    /// # Ok::<(), karat::unstable::golden::FrameDifference>(())
    /// ```
    #[must_use]
    pub fn ratio(&self) -> f64 {
        let ratio = if self.value == 0.0 { 0.0 } else { self.value / self.bound };
        if ratio >= 0.0 { ratio } else { f64::INFINITY }
    }
}

/// `largest FLIP tile 0.019 of 0.01, (16, 32) to (31, 47)`
impl fmt::Display for CriterionMargin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (value, bound) = (significant(self.value), significant(self.bound));
        match self.criterion {
            FrameCriterion::Finite => write!(f, "{value} {}", self.name)?,
            FrameCriterion::Gate if self.value.is_infinite() => {
                write!(f, "{}: nothing is allowed", self.name)?;
            }
            FrameCriterion::Gate => write!(f, "{}: {value} times what is allowed", self.name)?,
            _ => write!(f, "{} {value} of {bound}", self.name)?,
        }
        match self.place {
            Some(Rect { left, top, width: 1, height: 1 }) => write!(f, ", at ({left}, {top})")?,
            Some(rect) => write!(f, ", in {rect}")?,
            None => {}
        }
        self.note.as_ref().map_or(Ok(()), |note| write!(f, " ({note})"))
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Judgement {
    pub(super) passes: bool,
    pub(super) margins: Vec<CriterionMargin>,
    /// The index of the measurement that decided the verdict.
    pub(super) decisive: usize,
}
