//! What a part of a frame should be on average, without a golden.

use super::{Frame, FrameError};
use crate::check::{self, replay};
use crate::image::Image;
use crate::metric::{MaskError, Rect};
use crate::output::visible;
use crate::path::{self, Adapter};
use crate::record::{self, PathRecord, Record, Stopwatch, Subject, Verdict};
use crate::settings;
use crate::tolerance::{Measure, Tolerance};

/// What the mean of a rectangle is on each path.
#[derive(Clone, Debug)]
pub struct FrameMean {
    /// Each path with the mean of red, green and blue.
    pub paths: Vec<(Adapter, [f64; 3])>,
}

impl Frame<'_> {
    /// Draws the frame on each selected path and compares the mean colour of a rectangle with what
    /// is expected. A value that isn't finite fails.
    ///
    /// # Panics
    /// With the [`FrameError`], if a mean is off or can't be taken.
    #[track_caller]
    pub fn expect_mean(
        &self,
        rect: Rect,
        expected: [f64; 3],
        tolerance: impl Into<Tolerance>,
    ) -> FrameMean {
        let stopwatch = Stopwatch::start();
        let location = std::panic::Location::caller().to_string();
        let mut records = Vec::new();
        let result = self.mean(rect, expected, &tolerance.into(), &mut records);
        let verdict = match &result {
            Ok(_) => Verdict::Pass,
            Err(FrameError::Mean { .. }) => Verdict::Fail,
            Err(_) => Verdict::Error,
        };
        record::write(&Record {
            schema: record::SCHEMA,
            test: check::test(),
            subject: Subject::Frame {
                golden: format!("mean of {rect}"),
                folder: String::new(),
                location,
            },
            verdict,
            paths: records,
            message: result.as_ref().err().map(ToString::to_string),
            overlay: record::overlay(),
            time: Some(stopwatch.time()),
        });
        match result {
            Ok(mean) => mean,
            Err(error) => {
                replay::done();
                panic!("{}", visible(&error.to_string()))
            }
        }
    }

    /// [`expect_mean`](Self::expect_mean) without the panic. The verdict is left to the caller and
    /// isn't recorded.
    ///
    /// # Errors
    /// If a mean is off or can't be taken.
    pub fn try_expect_mean(
        &self,
        rect: Rect,
        expected: [f64; 3],
        tolerance: impl Into<Tolerance>,
    ) -> Result<FrameMean, FrameError> {
        self.mean(rect, expected, &tolerance.into(), &mut Vec::new())
    }

    fn mean(
        &self,
        rect: Rect,
        expected: [f64; 3],
        tolerance: &Tolerance,
        records: &mut Vec<PathRecord>,
    ) -> Result<FrameMean, FrameError> {
        if let Some(bound) = tolerance.unusable() {
            return Err(FrameError::Tolerance(format!(
                "{bound}; a bound is a number of at least 0"
            )));
        }
        replay::begin(settings::current()?, &format!("frame mean of {rect}"))?;
        let (width, height) = (self.width, self.height);
        if !rect.fits(width, height) {
            return Err(FrameError::Rectangle(MaskError::Outside { rect, width, height }));
        }
        let mut paths = Vec::new();
        for device in path::selected()? {
            let adapter = device.adapter();
            let (image, _) = self.render_on(device)?;
            let mean = mean(&image, rect);
            let lanes = (0..).zip(mean.iter().zip(expected));
            let measured = lanes.map(|(lane, (m, e))| tolerance.measure_sum(lane, *m, e));
            let worst = measured.fold(Measure::ZERO, |worst, measure| {
                if measure.ratio <= worst.ratio { worst } else { measure }
            });
            records.push(PathRecord {
                adapter: adapter.clone(),
                cases: u64::from(rect.width) * u64::from(rect.height),
                failures: u64::from(!worst.passes()),
                worst: worst.to_string(),
                ratio: worst.ratio.is_finite().then_some(worst.ratio),
                asserted: tolerance.to_string(),
                known_issue: None,
            });
            if !worst.passes() {
                let adapter = Box::new(adapter.clone());
                return Err(FrameError::Mean { adapter, rect, expected, mean, worst });
            }
            paths.push((adapter.clone(), mean));
        }
        Ok(FrameMean { paths })
    }
}

/// Mean of red, green and blue; NaN if a value isn't finite.
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
