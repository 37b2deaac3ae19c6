//! Metrics: numbers that measure the difference between a frame and its golden.
//!
//! A [`Pair`] is a golden and a frame of the same size. All compared pixels of both images are finite. Outside a
//! [`Mask`], the pair replaces the frame's pixels with the golden's. A [`Metric`] computes one number for the pair. The
//! frame's tolerance has a bound for this number. NaN fails under every bound.
//!
//! [`Gate`] measures the difference of each channel, and allows no outliers. [`Flip`] measures the difference that a
//! person would see. [`Noise`] compares the difference with the noise of the two images.

mod exposure;
mod exposure_map;
mod flip;
mod gate;
mod ldr;
mod mask;
mod noise;
mod pair;
mod relative;
mod tiles;

use std::fmt;

pub use exposure::ExposureRange;
pub use exposure_map::ExposureMap;
pub use flip::{Flip, FlipFailure, Pool};
pub use gate::{DEFAULT_RELATIVE, Gate, Outliers, WorstPixel};
pub use mask::{MASK, Mask, MaskError, Rect};
pub use noise::Noise;
pub use pair::{Pair, PairError};
pub use tiles::{ErrorMap, TILE};

/// A measure of the difference between a golden and a frame.
///
/// ```
/// use karat::Image;
/// use karat::unstable::metric::{Measured, Metric, Pair};
///
/// /// The largest difference of a green channel.
/// #[derive(Debug)]
/// struct Green;
///
/// impl Metric for Green {
///     fn name(&self) -> String {
///         "green".to_owned()
///     }
///     fn measure(&self, pair: &Pair<'_>) -> Measured {
///         let pixels = pair.golden().pixels().iter().zip(pair.actual().pixels());
///         let largest = pixels.map(|(a, b)| (a[1] - b[1]).abs()).fold(0.0, f32::max);
///         Measured::of(largest.into())
///     }
/// }
///
/// let golden = Image::new(2, 1, vec![[1.0; 4]; 2]);
/// let actual = Image::new(2, 1, vec![[1.0; 4], [0.5; 4]]);
/// assert_eq!(Green.measure(&Pair::new(&golden, &actual).unwrap()).value, 0.5);
/// ```
pub trait Metric: fmt::Debug + Send + Sync {
    /// The metric's name in messages: `largest FLIP tile`.
    fn name(&self) -> String;

    /// Measures the difference of the pair. Outside the mask, the pair has replaced the frame's pixels with the
    /// golden's. A metric that computes a mean must leave these pixels out (see [`Pair::is_compared`]).
    fn measure(&self, pair: &Pair<'_>) -> Measured;

    /// The largest difference that the metric can measure. A tolerance with a bound of at least this size would pass
    /// every frame. The default is infinity.
    fn most(&self) -> f64 {
        f64::INFINITY
    }
}

/// The result of a metric.
///
/// ```
/// use karat::unstable::metric::Measured;
///
/// assert_eq!(Measured::of(0.25).value, 0.25);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// The difference. It is 0 if the images are equal. NaN and infinity fail under every bound.
    pub value: f64,
    /// The rectangle in which the difference is largest.
    pub place: Option<Rect>,
    /// The difference of each pixel, if the metric computes a difference for each pixel.
    pub map: Option<ErrorMap>,
    /// A remark about the difference, for messages.
    pub note: Option<String>,
}

impl Measured {
    /// A difference without a rectangle, a map or a note.
    ///
    /// ```
    /// use karat::unstable::metric::Measured;
    ///
    /// let largest = Measured::of(0.25);
    /// # let _ = largest;
    /// ```
    #[must_use]
    pub fn of(value: f64) -> Self {
        Self { value, place: None, map: None, note: None }
    }
}
