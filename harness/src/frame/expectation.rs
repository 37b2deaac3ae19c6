//! Compares the mean colour of a rectangle in a frame with an expected colour.

use super::{Frame, FrameError};
use crate::executor::Executor;
use crate::image::Image;
use crate::metric::{MaskError, Rect};
use crate::path::Adapter;
use crate::record::PathRecord;
use crate::run::{Judged, KnownIssue, Report, or_panic, replay};
use crate::tolerance::{LaneError, Tolerance};

/// The mean colours of a rectangle on the paths that passed.
///
/// ```
/// # use karat::metric::Rect;
/// # use karat::prelude::*;
/// # let text = "@fragment fn fragment() -> @location(0) vec4f { return vec4f(0.5, 0.25, 0.0, 1.0); }";
/// # let package = Package::from_source("m", text);
/// let frame = package.frame("", 8, 8).fragment("fragment");
/// let mean = frame.has_mean(Rect::new(0, 0, 8, 8), [0.5, 0.25, 0.0], Abs(1e-6));
/// for (adapter, [red, green, blue]) in &mean.paths {
///     assert!((red - 0.5).abs() <= 1e-6, "on {adapter}: {red} {green} {blue}");
/// }
/// ```
#[derive(Clone, Debug)]
pub struct FrameMean {
    /// Each path with the mean of red, green and blue.
    pub paths: Vec<(Adapter, [f64; 3])>,
    /// The paths on which the check fails, as the test declared with `fails_on`. `paths` doesn't contain them.
    pub known_issues: Vec<KnownIssue>,
}

impl Frame<'_> {
    /// Draws the frame on each selected path, and compares the mean colour of a rectangle with the expected colour. The
    /// check fails if a value in the rectangle isn't finite. With `KARAT_FRAMES=off`, this method draws nothing.
    ///
    /// ```
    /// use karat::metric::Rect;
    /// # use karat::prelude::*;
    ///
    /// let text = "@fragment fn fragment() -> @location(0) vec4f { return vec4f(0.5, 0.25, 0.0, 1.0); }";
    /// let package = Package::from_source("m", text);
    /// let frame = package.frame("", 8, 8).fragment("fragment");
    /// frame.has_mean(Rect::new(0, 0, 8, 8), [0.5, 0.25, 0.0], Abs(1e-6));
    /// ```
    ///
    /// # Panics
    /// Panics with the [`FrameError`] if a mean differs, or if Karat can't compute it.
    #[track_caller]
    pub fn has_mean(
        &self,
        rect: Rect,
        expected: [f64; 3],
        tolerance: impl Into<Tolerance>,
    ) -> FrameMean {
        or_panic(self.try_has_mean(rect, expected, tolerance))
    }

    /// Like [`has_mean`](Self::has_mean), but returns an error instead of panicking. With `KARAT_FRAMES=off`, this
    /// method draws only an [unrecorded](Self::unrecorded) frame.
    ///
    /// # Errors
    /// Returns an error if a mean differs, or if Karat can't compute it.
    #[track_caller]
    pub fn try_has_mean(
        &self,
        rect: Rect,
        expected: [f64; 3],
        tolerance: impl Into<Tolerance>,
    ) -> Result<FrameMean, FrameError> {
        if self.is_left_out() {
            return Ok(FrameMean { paths: Vec::new(), known_issues: Vec::new() });
        }
        let tolerance = tolerance.into();
        let name = format!("mean of {rect}");
        self.reported((name.clone(), String::new()), |report| {
            self.mean(&name, rect, expected, &tolerance, report)
        })
    }

    fn mean(
        &self,
        name: &str,
        rect: Rect,
        expected: [f64; 3],
        tolerance: &Tolerance,
        Report { paths: records, read, watched, .. }: &mut Report,
    ) -> Result<FrameMean, FrameError> {
        if let Some(bound) = tolerance.unusable() {
            return Err(FrameError::Tolerance(format!(
                "{bound}: use a finite number of at least 0"
            )));
        }
        replay::begin_frame(name)?;
        self.known_issues.expect_sound::<FrameError>(name)?;
        let (width, height) = (self.scene.width, self.scene.height);
        if !rect.fits(width, height) {
            return Err(FrameError::Rectangle(MaskError::Outside { rect, width, height }));
        }
        let executors = self.executors()?;
        let on_path = &mut |executor: &dyn Executor, adapter: &Adapter| {
            let drawing = self.drawing_on(executor)?;
            let image = super::drawn(executor, &drawing)?;
            super::tap::expect_asserted(&drawing, executor.path())?;
            read.extend(drawing.read());
            *watched = super::unwatched(&drawing);
            let mean = mean(&image, rect);
            let lanes = (0..).zip(mean.iter().zip(expected));
            let measured = lanes.map(|(lane, (m, e))| tolerance.measure_sum(lane, *m, e));
            let worst = measured.fold(LaneError::ZERO, |worst, measure| {
                if measure.ratio <= worst.ratio { worst } else { measure }
            });
            let record = PathRecord {
                cases: u64::from(rect.width) * u64::from(rect.height),
                failures: u64::from(!worst.passes()),
                worst: worst.to_string(),
                ratio: worst.ratio.is_finite().then_some(worst.ratio),
                asserted: tolerance.to_string(),
                ..PathRecord::of(adapter.clone())
            };
            Ok::<_, FrameError>(Judged { record, values: (mean, worst) })
        };
        let all = self.known_issues.conclude(name, &executors, false, records, on_path);
        let differ = |differing: Vec<(Adapter, Mean)>, _: &[(Adapter, Mean)]| {
            let off = |(adapter, (mean, worst)): (Adapter, Mean)| FrameError::Mean {
                adapter: Box::new(adapter),
                rect,
                expected,
                mean,
                worst,
            };
            differing.into_iter().map(off).collect()
        };
        let (agreeing, known_issues) = all.verdict(differ)?;
        let paths = agreeing.into_iter().map(|(adapter, (mean, _))| (adapter, mean)).collect();
        Ok(FrameMean { paths, known_issues })
    }
}

type Mean = ([f64; 3], LaneError);

/// The mean of red, green and blue. If a value isn't finite, the channel's mean isn't finite.
fn mean(image: &Image, rect: Rect) -> [f64; 3] {
    let rows = image.pixels().chunks(image.width() as usize).skip(rect.top as usize);
    let columns = rect.left as usize..(rect.left + rect.width) as usize;
    let mut sums = [0.0_f64; 3];
    for pixel in rows.take(rect.height as usize).flat_map(|row| &row[columns.clone()]) {
        for (sum, value) in sums.iter_mut().zip(pixel) {
            *sum += f64::from(*value);
        }
    }
    let pixels = f64::from(rect.width) * f64::from(rect.height);
    sums.map(|sum| sum / pixels)
}
