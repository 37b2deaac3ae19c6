//! Compares a frame with its golden on each path, by what the frame declares, and records it.

use std::sync::LazyLock;

use super::{Frame, FrameAgreement, FrameError};
use crate::diagnostic::FileRead;
use crate::draw::Source;
use crate::executor::{self, Executor};
use crate::golden::{
    COLOR, FrameDifference, FrameTolerance, GoldenError, Goldens, MASK, Rendered, VARIANCE,
};
use crate::image::{Image, Part};
use crate::metric::{Gate, Mask};
use crate::output::visible;
use crate::path::{Adapter, Path};
use crate::record::{PathRecord, Subject};
use crate::run::{Reporter, Seen, leave_frame_out, or_panic, replay};
use crate::settings;

impl Frame<'_> {
    /// Draws the frame on each selected path and compares it with a golden. With `KARAT_FRAMES=off`
    /// it does neither, and the agreement has no path.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS.frame("sky", 256, 128).fragment("fragment").matches(&GOLDENS, "sky");
    /// ```
    ///
    /// # Panics
    /// With the [`FrameError`], if it differs or there is nothing to compare with.
    #[track_caller]
    pub fn matches(&self, goldens: &Goldens, case: &str) -> FrameAgreement {
        if settings::leaves_frames_out() {
            leave_frame_out();
            let (case, paths, known_issues) = (case.to_owned(), Vec::new(), Vec::new());
            return FrameAgreement { case, paths, known_issues };
        }
        let reporter = Reporter::start();
        let location = self.place(std::panic::Location::caller());
        let (mut records, mut read) = (Vec::new(), Vec::new());
        let result = self.compare(goldens, case, &mut records, &mut read);
        let (golden, folder) = (case.to_owned(), goldens.folder().display().to_string());
        reporter.record(Subject::Frame { golden, folder, location }, records, read, &result);
        or_panic(result)
    }

    /// [`matches`](Self::matches) without the panic. The verdict is left to the caller and isn't
    /// recorded.
    ///
    /// # Errors
    /// If it differs or there is nothing to compare with.
    pub fn try_matches(&self, goldens: &Goldens, case: &str) -> Result<FrameAgreement, FrameError> {
        self.compare(goldens, case, &mut Vec::new(), &mut Vec::new())
    }

    fn compare(
        &self,
        goldens: &Goldens,
        case: &str,
        records: &mut Vec<PathRecord>,
        read: &mut Vec<FileRead>,
    ) -> Result<FrameAgreement, FrameError> {
        replay::begin_frame(case)?;
        let (mut paths, mut known) = (Vec::new(), Vec::new());
        self.expect_reasons()?;
        self.check_tolerances()?;
        if let Some((name, reason)) = self.unusable_aov() {
            return Err(FrameError::Aov(name.to_owned(), reason));
        }
        let executors = self.executors()?;
        read.extend(self.variance.as_ref().and_then(Image::origin).cloned());
        read.extend(self.mask.as_ref().and_then(Mask::origin).cloned());
        for executor in executors {
            let (adapter, path) = (executor::adapter(executor), executor.path());
            let drawing = self.drawing_on(executor)?;
            let image = super::drawn(executor, &drawing)?;
            read.extend(drawing.read());
            read.extend(goldens.files(case, &adapter));
            let tolerance = self.tolerance_of(path, &adapter);
            let known_issue = self.known_issues.on(path, &adapter).map(str::to_owned);
            let frame = Rendered {
                image: &image,
                adapter: &adapter,
                shader: drawing.shader(),
                modules: drawing.modules(),
                tolerance,
                mask: self.mask.as_ref(),
                variance: self.variance.as_ref(),
                facts: &self.facts,
                aovs: &|| self.aovs_on(executor),
                known_issue: known_issue.is_some(),
            };
            let compared = goldens.check(case, &frame);
            let asserted = match tolerance {
                Some(tolerance) => tolerance.to_string(),
                None => FrameTolerance::default().to_string(),
            };
            let mut entry = PathRecord {
                adapter: adapter.clone(),
                cases: u64::from(self.scene.width) * u64::from(self.scene.height),
                failures: 0,
                worst: String::new(),
                ratio: None,
                asserted,
                known_issue,
                granted: None,
                errors: None,
                plot: None,
                histogram: None,
                configurations: None,
            };
            match compared {
                Ok(margin) => {
                    entry.cases = margin.pixels;
                    entry.ratio = Some(margin.ratio);
                    entry.worst = margin.to_string();
                    entry.asserted = match &margin.profile {
                        Some(profile) => format!("{}, golden of @{profile}", margin.tolerance),
                        None => margin.tolerance.clone(),
                    };
                    match entry.known_issue {
                        Some(_) => known.push(seen(&entry, path)),
                        None => paths.push((adapter.clone(), margin)),
                    }
                    records.push(entry);
                }
                // A frame with NaN or of another size is another bug than the one that is known.
                Err(GoldenError::Differs { difference, .. })
                    if entry.known_issue.is_some()
                        && matches!(*difference, FrameDifference::Values(_)) =>
                {
                    entry.failures = outliers(&difference);
                    known.push(seen(&entry, path));
                    records.push(entry);
                }
                Err(source) => {
                    entry.failures = failures(&source);
                    if let GoldenError::Differs { difference, .. } = &source
                        && let FrameDifference::Values(deviation) = &**difference
                    {
                        (entry.worst, entry.ratio) = deviation.worst_margin();
                    }
                    records.push(entry);
                    return Err(FrameError::Golden {
                        adapter: Box::new(adapter.clone()),
                        source: Box::new(source),
                    });
                }
            }
        }
        let known_issues = self.known_issues.judge(known, false);
        let known_issues = known_issues.map_err(|passes| FrameError::passes(case, passes))?;
        Ok(FrameAgreement { case: case.to_owned(), paths, known_issues })
    }
}

/// What a path gave that is declared to fail.
fn seen(entry: &PathRecord, path: Path) -> Seen {
    let PathRecord { adapter, cases, failures, .. } = entry;
    Seen { adapter: adapter.clone(), path, cases: *cases, failures: *failures }
}

impl Frame<'_> {
    /// Wants paths that can be, and a reason for each that is declared to fail.
    pub(super) fn expect_reasons(&self) -> Result<(), FrameError> {
        self.known_issues.expect_sound()?;
        let unexplained = self.known_issues.unexplained();
        unexplained.map_or(Ok(()), |on| Err(FrameError::UnexplainedIssue(on.clone())))
    }

    /// Each bounds something, on paths that can be.
    fn check_tolerances(&self) -> Result<(), FrameError> {
        self.tolerance_on.expect_sound()?;
        let on_paths = self.tolerance_on.iter().map(|(_, tolerance)| tolerance);
        let mut all = on_paths.chain(&self.tolerance);
        all.find_map(FrameTolerance::unusable).map_or(Ok(()), |why| Err(FrameError::Tolerance(why)))
    }

    /// The most particular: of the path, or else of the frame, or else of what its image holds if that
    /// isn't a colour, which HDR-FLIP judges as an eye would. Integers are equal or not. Depths differ by
    /// rounding: what is far has depths close to 1, where 1e-3 would be a multiple of the distance.
    fn tolerance_of(&self, path: Path, adapter: &Adapter) -> Option<&FrameTolerance> {
        // Images hold integers up to 2^24, of which two differ by 6e-8 at least.
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

    /// The first name of an AOV that its file can't have, and why.
    fn unusable_aov(&self) -> Option<(&str, &'static str)> {
        let sound = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
        self.aovs.iter().enumerate().find_map(|(index, (name, _))| {
            let reason = if name.is_empty() || name.len() > 255 || !name.chars().all(sound) {
                "use 1 to 255 letters, digits, `-`, `_` and `.`"
            } else if [COLOR, VARIANCE, MASK].contains(&name.as_str()) {
                "it is the name of another part of a golden"
            } else if self.aovs[..index].iter().any(|(other, _)| other == name) {
                "another one has it"
            } else {
                return None;
            };
            Some((name.as_str(), reason))
        })
    }

    /// What else is kept of the pixels. What can't be drawn is missed by no verdict.
    fn aovs_on(&self, executor: &dyn Executor) -> Vec<Part> {
        let draw = |frame: &Self| super::drawn(executor, &frame.drawing_on(executor)?);
        let drawn = self.aovs.iter().filter_map(|(name, frame)| match draw(frame) {
            Ok(image) => Some(Part::new(name, Gate::default().precision_for(&image, None), image)),
            Err(error) => {
                eprintln!("note: the AOV `{name}` isn't kept: {}", visible(&error.to_string()));
                None
            }
        });
        drawn.collect()
    }
}

fn failures(error: &GoldenError) -> u64 {
    match error {
        GoldenError::Differs { difference, .. } => outliers(difference),
        _ => 1,
    }
}

/// Pixels that are off; 1 of a frame that can't be compared at all.
fn outliers(difference: &FrameDifference) -> u64 {
    match difference {
        FrameDifference::Values(deviation) => deviation.outliers as u64,
        _ => 1,
    }
}
