//! Compares a frame with its golden on each path, and records the verdict.

use std::sync::LazyLock;

use super::{Frame, FrameAgreement, FrameError};
use crate::draw::Source;
use crate::executor::Executor;
use crate::golden::{
    COLOR, FrameDifference, FrameMargin, FrameTolerance, GoldenError, Goldens, MASK, Rendered,
    VARIANCE,
};
use crate::image::{Image, Part};
use crate::interpret::unmeasured;
use crate::metric::{Gate, Mask};
use crate::output::visible;
use crate::path::{Adapter, Path};
use crate::record::{PathRecord, Subject};
use crate::run::sound_paths;
use crate::run::{Judged, Passed, Report, leave_frame_out, or_panic, replay, reported};
use crate::settings;

impl Frame<'_> {
    /// Draws the frame on each selected path, and compares it with a golden. With `KARAT_FRAMES=off`, this method draws
    /// nothing and returns an agreement without paths.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS.frame("sky", 256, 128).fragment("fragment").matches(&GOLDENS, "sky");
    /// ```
    ///
    /// # Panics
    /// Panics with the [`FrameError`] if the frame differs from its golden, or if the golden doesn't exist.
    #[track_caller]
    pub fn matches(&self, goldens: &Goldens, case: &str) -> FrameAgreement {
        or_panic(self.try_matches(goldens, case))
    }

    /// Like [`matches`](Self::matches), but returns an error instead of panicking. With `KARAT_FRAMES=off`, this method
    /// draws only an [unrecorded](Self::unrecorded) frame.
    ///
    /// # Errors
    /// Returns an error if the frame differs from its golden, or if the golden doesn't exist.
    #[track_caller]
    pub fn try_matches(&self, goldens: &Goldens, case: &str) -> Result<FrameAgreement, FrameError> {
        if self.is_left_out() {
            let (case, paths, known_issues) = (case.to_owned(), Vec::new(), Vec::new());
            return Ok(FrameAgreement { case, paths, known_issues });
        }
        let folder = goldens.folder().display().to_string();
        self.reported((case.to_owned(), folder), |report| self.compare(goldens, case, report))
    }

    /// Checks if `KARAT_FRAMES=off` leaves the frame out. If so, records that the test skips a frame.
    pub(super) fn is_left_out(&self) -> bool {
        let left_out = self.recorded && settings::leaves_frames_out();
        if left_out {
            leave_frame_out();
            if let Ok(drawing) = self.scene.drawing() {
                unmeasured(drawing.program());
            }
        }
        left_out
    }

    /// Runs `judge`, and records its verdict with the golden's name and folder.
    #[track_caller]
    pub(super) fn reported<T: Passed>(
        &self,
        (golden, folder): (String, String),
        judge: impl FnOnce(&mut Report) -> Result<T, FrameError>,
    ) -> Result<T, FrameError> {
        let location = self.place(std::panic::Location::caller());
        reported(Subject::Frame { golden, folder, location }, &|| self.recorded, judge)
    }

    fn compare(
        &self,
        goldens: &Goldens,
        case: &str,
        Report { paths: records, read, watched, .. }: &mut Report,
    ) -> Result<FrameAgreement, FrameError> {
        replay::begin_frame(case)?;
        self.known_issues.expect_sound::<FrameError>(case)?;
        self.check_tolerances()?;
        if let Some((name, reason)) = self.unusable_aov() {
            return Err(FrameError::Aov(name.to_owned(), reason));
        }
        let executors = self.executors()?;
        read.extend(self.variance.as_ref().and_then(Image::origin).cloned());
        read.extend(self.mask.as_ref().and_then(Mask::origin).cloned());
        let mut other_waits = false;
        let on_path = &mut |executor: &dyn Executor, adapter: &Adapter| {
            let path = executor.path();
            let drawing = self.drawing_on(executor)?;
            let image = super::drawn(executor, &drawing)?;
            super::tap::expect_asserted(&drawing, executor.path())?;
            read.extend(drawing.read());
            *watched = super::unwatched(&drawing);
            read.extend(goldens.files(case, adapter));
            let tolerance = self.tolerance_of(path, adapter);
            let frame = Rendered {
                image: &image,
                adapter,
                shader: drawing.shader(),
                modules: drawing.modules(),
                tolerance,
                mask: self.mask.as_ref(),
                variance: self.variance.as_ref(),
                facts: &self.facts,
                aovs: &|| self.aovs_on(executor),
                known_issue: self.known_issues.names(path, adapter),
                other_waits,
            };
            let known_issue = frame.known_issue;
            let compared = goldens.check(case, &frame);
            // Any other error of the golden is more useful than "no draw touches a pixel".
            let passes = matches!(compared, Ok(_) | Err(GoldenError::Missing { .. }));
            if let Some(clear) = self.scene.untouched(&image).filter(|_| passes) {
                return Err(FrameError::Untouched { clear });
            }
            let record = PathRecord {
                cases: u64::from(self.scene.width) * u64::from(self.scene.height),
                asserted: match tolerance {
                    Some(tolerance) => tolerance.to_string(),
                    None => FrameTolerance::default().to_string(),
                },
                ..PathRecord::of(adapter.clone())
            };
            let cause = match compared {
                Ok(margin) => {
                    let asserted = match &margin.profile {
                        Some(profile) => format!("{}, golden of @{profile}", margin.tolerance),
                        None => margin.tolerance.clone(),
                    };
                    let (cases, ratio) = (margin.pixels, Some(margin.ratio));
                    let worst = margin.to_string();
                    let record = PathRecord { cases, ratio, worst, asserted, ..record };
                    return Ok(Judged { record, values: Ok(margin) });
                }
                Err(mut cause) => {
                    // `karat trace` finds a frame by this name if a file declares the frame.
                    if self.declared_at.is_some() {
                        cause.point_at_worst();
                    }
                    Box::new(cause)
                }
            };
            other_waits |= !known_issue;
            match &*cause {
                GoldenError::Differs { difference, .. } if difference.is_of_values() => {
                    let (worst, ratio) = match &**difference {
                        FrameDifference::Values(deviation) => deviation.worst_margin(),
                        _ => (String::new(), None),
                    };
                    let failures = outliers(difference);
                    let record = PathRecord { failures, worst, ratio, ..record };
                    Ok(Judged { record, values: Err(cause) })
                }
                // There are no values to compare: the frame's size differs, or the golden is missing or unusable.
                _ => Err(FrameError::Golden { adapter: Box::new(adapter.clone()), cause }),
            }
        };
        let all = self.known_issues.conclude(case, &executors, false, records, on_path);
        let differ = |differing: Vec<(Adapter, Compared)>, _: &[(Adapter, Compared)]| {
            let differing = differing.into_iter().filter_map(|(adapter, compared)| {
                let adapter = Box::new(adapter);
                Some(FrameError::Golden { adapter, cause: compared.err()? })
            });
            differing.collect()
        };
        let (agreeing, known_issues) = all.verdict(differ)?;
        let agreeing = agreeing.into_iter();
        let paths = agreeing.filter_map(|(adapter, compared)| Some((adapter, compared.ok()?)));
        Ok(FrameAgreement { case: case.to_owned(), paths: paths.collect(), known_issues })
    }
}

type Compared = Result<FrameMargin, Box<GoldenError>>;

impl Frame<'_> {
    /// Checks that each tolerance has usable bounds and a selector that can match a path.
    fn check_tolerances(&self) -> Result<(), FrameError> {
        sound_paths("tolerance_on", &self.tolerance_on)?;
        let on_paths = self.tolerance_on.iter().map(|(_, tolerance)| tolerance);
        let mut all = on_paths.chain(&self.tolerance);
        all.find_map(FrameTolerance::unusable).map_or(Ok(()), |why| Err(FrameError::Tolerance(why)))
    }

    /// The tolerance for a path. The path's own tolerance comes first, and the frame's tolerance second. If neither is
    /// set, integers and depths have a default, because HDR-FLIP can't judge them: integers must be equal, and depths
    /// must be within 1e-5. Depths of far surfaces are close to 1, so the standard gate of 1e-3 would allow large
    /// differences in distance.
    fn tolerance_of(&self, path: Path, adapter: &Adapter) -> Option<&FrameTolerance> {
        // Images store integers up to 2^24 as floats. Two different integers differ by at least 6e-8 of their value.
        static EXACT: LazyLock<FrameTolerance> = LazyLock::new(|| FrameTolerance::from(1e-8));
        static DEPTH: LazyLock<FrameTolerance> = LazyLock::new(|| FrameTolerance::from(1e-5));
        let of_content = || match self.scene.result {
            Source::Depth => Some(&*DEPTH),
            Source::Target(target) => {
                let format = self.scene.formats.get(target);
                format.filter(|format| format.is_of_integers()).map(|_| &*EXACT)
            }
        };
        self.tolerance_on.on(path, adapter).or(self.tolerance.as_ref()).or_else(of_content)
    }

    /// The first AOV name that Karat can't store in the golden's file, and the reason.
    fn unusable_aov(&self) -> Option<(&str, &'static str)> {
        let sound = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
        self.aovs.iter().enumerate().find_map(|(index, (name, _))| {
            let reason = if name.is_empty() || name.len() > 255 || !name.chars().all(sound) {
                "use 1 to 255 letters, digits, `-`, `_` and `.`"
            } else if [COLOR, VARIANCE, MASK].contains(&name.as_str()) {
                "Karat stores another part of the golden under that name"
            } else if self.aovs[..index].iter().any(|(other, _)| other == name) {
                "another AOV has that name"
            } else {
                return None;
            };
            Some((name.as_str(), reason))
        })
    }

    /// The AOVs that the executor can draw. A missing AOV affects no verdict.
    fn aovs_on(&self, executor: &dyn Executor) -> Vec<Part> {
        let draw = |frame: &Self| super::drawn(executor, &frame.drawing_on(executor)?);
        let drawn = self.aovs.iter().filter_map(|(name, frame)| match draw(frame) {
            Ok(image) => Some(Part::new(name, Gate::default().precision_for(&image, None), image)),
            Err(error) => {
                eprintln!(
                    "note: Karat can't draw the AOV `{name}`, so the golden won't have this AOV: {}",
                    visible(&error.to_string())
                );
                None
            }
        });
        drawn.collect()
    }
}

fn outliers(difference: &FrameDifference) -> u64 {
    match difference {
        FrameDifference::Values(deviation) => deviation.outliers as u64,
        FrameDifference::NonFinite(census) => (census.nan + census.infinite) as u64,
        _ => 1,
    }
}
