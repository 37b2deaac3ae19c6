//! Goldens: what a frame should look like, in HDR, and which values a function or a buffer should have.
//!
//! The golden of a frame is two files: `<case>.exr`, and `<case>.toml` with the same facts as text. That
//! of values is one, `<case>.csv`, a [`Table`] with its facts as comments. What differs or has no golden
//! fails, and leaves `<case>.new.exr` or `<case>.new.csv` beside the golden (if `CI` is set, in the folder
//! of build output instead). Only accepting writes a golden.

mod acceptance;
mod changes;
mod compare;
mod content;
mod lock;
mod message;
mod number;
mod parts;
mod pending;
mod place;
mod profile;
mod provenance;
mod reference;
mod table;
mod tolerance;
mod values;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use half::f16;

pub use crate::metric::MASK;
pub use acceptance::{AcceptError, Acceptance, Accepted};
pub use changes::ChangedRow;
pub use compare::{Deviation, FrameDifference, FrameMargin};
pub use parts::COLOR;
pub(crate) use parts::VARIANCE;
pub use pending::{Pending, PendingFrames, Unusable};
pub use place::{build_output, in_ci};
pub(crate) use place::{leave_in, output};
pub use profile::Profile;
pub use provenance::{FrameFinding, Provenance, ProvenanceError};
pub use table::{Column, Table, TableError, TableFacts};
pub use tolerance::{Criterion, CriterionMargin, FrameTolerance};
pub use values::ValuesError;
pub(crate) use values::{Made, other_columns};

use self::compare::Terms;
use self::pending::Against;
use self::reference::{Reference, ReferenceError};
use crate::diagnostic::{FileRead, shown};
use crate::image::{Image, ImageError, Part, Precision};
use crate::metric::{Gate, Mask, MaskError};
use crate::package::LinkedModule;
use crate::path::Adapter;

/// A folder of goldens.
///
/// ```
/// static GOLDEN: karat::Goldens = karat::goldens!("golden"); // relative to Cargo.toml
/// # let _ = &GOLDEN;
/// ```
#[derive(Clone, Debug)]
pub struct Goldens {
    base: std::borrow::Cow<'static, str>,
    folder: std::borrow::Cow<'static, str>,
    /// Whether pending frames lie beside their goldens whatever the environment says.
    beside: bool,
}

/// Declares a folder of [`Goldens`], relative to the manifest of the crate that calls it.
///
/// ```
/// // The folder `golden` beside Cargo.toml.
/// static GOLDENS: karat::Goldens = karat::goldens!("golden");
/// assert!(GOLDENS.folder().ends_with("golden"));
/// ```
#[macro_export]
macro_rules! goldens {
    ($folder:expr) => {
        $crate::Goldens::relative(env!("CARGO_MANIFEST_DIR"), $folder)
    };
}

/// A frame to be compared.
#[derive(Clone)]
pub(crate) struct Rendered<'a> {
    pub(crate) image: &'a Image,
    pub(crate) adapter: &'a Adapter,
    pub(crate) shader: String,
    pub(crate) modules: Vec<LinkedModule>,
    /// `None`: the default for the golden and the adapter.
    pub(crate) tolerance: Option<&'a FrameTolerance>,
    pub(crate) mask: Option<&'a Mask>,
    /// Variance of each pixel, of a frame that is noisy.
    pub(crate) variance: Option<&'a Image>,
    /// What its author says of it.
    pub(crate) facts: &'a BTreeMap<String, String>,
    /// What else is kept of its pixels; rendered where the frame is, and only if it is kept.
    pub(crate) aovs: &'a dyn Fn() -> Vec<Part>,
    /// Whether it is known to differ: there is nothing to review then.
    pub(crate) known_issue: bool,
    /// True if the frame of another path waits already: one is looked at, decided about, and the test runs
    /// again.
    pub(crate) other_waits: bool,
}

impl Rendered<'_> {
    fn gate(&self) -> Gate {
        self.tolerance.and_then(FrameTolerance::first_gate).unwrap_or_default()
    }

    /// How it is stored: half floats, unless their rounding could be taken for a difference.
    fn precision(&self) -> Precision {
        self.gate().precision_for(self.image, self.mask)
    }

    /// Whether half floats hide what its tolerance wouldn't, whatever the golden is stored in. Only
    /// then it is worth a look at all pixels: by what is above, an ordinary frame is rounded by
    /// less.
    fn asks_for_floats(&self) -> bool {
        self.gate().relative < f16::EPSILON.to_f32() && self.precision() == Precision::Float
    }
}

/// Why a frame fails, or can't be judged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GoldenError {
    /// A name that isn't one path component or several joined by `/`.
    #[error("`{0}` can't name a golden: use letters, digits, `-`, `_` and `/`")]
    Name(String),
    /// There is no golden yet.
    #[error(
        "frame `{case}` has no golden; look at `{pending}` and accept it with \
         `karat accept {case}{arguments} --because \"...\"`"
    )]
    Missing {
        /// The golden.
        case: String,
        /// The frame that was rendered.
        pending: String,
        /// What accepting needs besides: `--any-adapter`.
        arguments: String,
    },
    /// The golden can't be read. It isn't overwritten.
    #[error("the golden of frame `{case}` can't be used: {source}{}",
        if matches!(source, ImageError::Corrupt { .. }) { "; restore it from version control" } else { "" })]
    Unreadable {
        /// The golden.
        case: String,
        /// Why.
        source: ImageError,
    },
    /// The golden's metadata can't be used.
    #[error("the golden of frame `{case}` can't be used: {source}")]
    Provenance {
        /// The golden.
        case: String,
        /// Why.
        source: ProvenanceError,
    },
    /// The frame differs.
    #[error(
        "frame `{case}` differs from its golden `{golden}`: {difference}\n  look at `{pending}`, {advice}"
    )]
    Differs {
        /// The golden.
        case: String,
        /// The golden's file.
        golden: String,
        /// How.
        difference: Box<FrameDifference>,
        /// The frame that was rendered.
        pending: String,
        /// What to do after looking at it.
        advice: String,
    },
    /// There is no golden yet, and the frame can't become one.
    #[error(
        "frame `{case}` has no golden and can't become one: {difference}\n  look at `{pending}`, and \
         mend the shader"
    )]
    Unacceptable {
        /// The golden.
        case: String,
        /// What is wrong.
        difference: Box<FrameDifference>,
        /// The frame that was rendered.
        pending: String,
    },
    /// The mask can't be used.
    #[error("frame `{case}` can't be compared: {source}")]
    Mask {
        /// The golden.
        case: String,
        /// Why.
        source: MaskError,
    },
    /// The pending frame can't be written.
    #[error("frame `{case}` fails ({failure}), and its pending image can't be written: {source}")]
    Pending {
        /// The golden.
        case: String,
        /// The failure that it would have shown.
        failure: String,
        /// Why.
        source: ImageError,
    },
}

impl Goldens {
    /// A folder relative to `base`. [`goldens!`](crate::goldens) fills in the manifest's folder.
    ///
    /// ```
    /// use karat::Goldens;
    ///
    /// // What `karat::goldens!("golden")` makes.
    /// static GOLDENS: Goldens = Goldens::relative(env!("CARGO_MANIFEST_DIR"), "golden");
    /// assert!(GOLDENS.folder().ends_with("golden"));
    /// ```
    #[must_use]
    pub const fn relative(base: &'static str, folder: &'static str) -> Self {
        use std::borrow::Cow;
        Self { base: Cow::Borrowed(base), folder: Cow::Borrowed(folder), beside: false }
    }

    /// A folder.
    ///
    /// ```
    /// use karat::Goldens;
    ///
    /// let goldens = Goldens::open("golden".as_ref());
    /// assert!(goldens.folder().ends_with("golden"));
    /// ```
    #[must_use]
    pub fn open(folder: &Path) -> Self {
        let folder = folder.to_string_lossy().into_owned().into();
        Self { base: std::borrow::Cow::Borrowed(""), folder, beside: false }
    }

    /// The folder.
    ///
    /// ```
    /// use karat::Goldens;
    ///
    /// assert!(Goldens::open("golden".as_ref()).folder().ends_with("golden"));
    /// ```
    #[must_use]
    pub fn folder(&self) -> PathBuf {
        Path::new(self.base.as_ref()).join(self.folder.as_ref())
    }

    /// The golden of all profiles.
    fn golden(&self, case: &str) -> PathBuf {
        self.folder().join(format!("{case}.exr"))
    }

    /// The golden of one profile.
    fn golden_of(&self, case: &str, profile: &Profile) -> PathBuf {
        self.folder().join(format!("@{profile}/{case}.exr"))
    }

    /// The golden that a profile is compared with, and whether it is its own: that of the profile
    /// where there is one, or else the one for all. No other file ever stands in.
    fn used(&self, case: &str, profile: &Profile) -> (PathBuf, bool) {
        let own = self.golden_of(case, profile);
        // A link to nothing is a golden that is missing, and not one that was never made.
        if own.symlink_metadata().is_ok() { (own, true) } else { (self.golden(case), false) }
    }

    /// The files that a comparison depends on: the golden of the adapter's profile, and the one for
    /// all, whichever is there.
    pub(crate) fn files(&self, case: &str, adapter: &Adapter) -> Vec<FileRead> {
        if !is_name(case) {
            return Vec::new();
        }
        let own = self.golden_of(case, &Profile::of(adapter));
        [own, self.golden(case)].iter().map(|file| FileRead::now(file)).collect()
    }

    /// The golden that a pending frame was compared with.
    ///
    /// ```no_run
    /// use karat::Goldens;
    ///
    /// let goldens = Goldens::open("golden".as_ref());
    /// for pending in goldens.pending().frames {
    ///     println!("{} and {}", goldens.compared(&pending).display(), pending.path.display());
    /// }
    /// ```
    #[must_use]
    pub fn compared(&self, pending: &Pending) -> PathBuf {
        if pending.is_table() {
            return self.values(&pending.case);
        }
        match pending.provenance.compared_profile.as_str() {
            "" => self.golden(&pending.case),
            _ => self.golden_of(&pending.case, &pending.profile()),
        }
    }

    /// Compares a frame with its golden.
    pub(crate) fn check(
        &self,
        case: &str,
        frame: &Rendered<'_>,
    ) -> Result<FrameMargin, GoldenError> {
        if !is_name(case) {
            return Err(GoldenError::Name(case.to_owned()));
        }
        let profile = Profile::of(frame.adapter);
        let (file, own) = self.used(case, &profile);
        let golden = match Reference::read(&file, frame.variance.is_some()) {
            Ok(golden) => golden,
            Err(ReferenceError::Image(ImageError::Missing { .. })) => {
                return Err(self.missing(case, frame));
            }
            Err(ReferenceError::Image(source)) => {
                return Err(GoldenError::Unreadable { case: case.to_owned(), source });
            }
            Err(ReferenceError::Provenance(source)) => {
                return Err(GoldenError::Provenance { case: case.to_owned(), source });
            }
        };
        match golden.compare(frame) {
            Ok(margin) => {
                if !frame.other_waits {
                    self.remove_pending(case, &profile);
                }
                let profile = own.then_some(profile);
                Ok(FrameMargin { golden: shown(&file), profile, ..margin })
            }
            Err(difference) => {
                let base_passes = own && self.base_passes(case, frame);
                let against = Against {
                    hash: golden.hash(),
                    profile: if own { profile.to_string() } else { String::new() },
                    tolerance: golden.tolerance(frame).to_string(),
                    finding: Some(FrameFinding { base_passes, ..FrameFinding::from(&difference) }),
                };
                Err(self.differs(case, frame, &file, &against, difference))
            }
        }
    }

    /// A frame that has no golden. One with NaN is wrong with and without.
    fn missing(&self, case: &str, frame: &Rendered<'_>) -> GoldenError {
        let tolerance = frame.tolerance.cloned().unwrap_or_default();
        let against = Against { tolerance: tolerance.to_string(), ..Against::default() };
        let terms = Terms { mask: frame.mask, ..Terms::of(&tolerance) };
        if let Err(difference) = compare::compare(frame.image, frame.image, &terms) {
            let case = case.to_owned();
            if let FrameDifference::Mask(source) = difference {
                return GoldenError::Mask { case, source };
            }
            let finding = Some(FrameFinding::from(&difference));
            return match self.write_pending(&case, frame, &Against { finding, ..against }) {
                Ok(pending) => {
                    let (difference, pending) = (Box::new(difference), shown(&pending.path));
                    GoldenError::Unacceptable { case, difference, pending }
                }
                Err(source) => unwritten(&case, &difference.to_string(), source),
            };
        }
        match self.write_pending(case, frame, &against) {
            Ok(pending) => GoldenError::Missing {
                case: case.to_owned(),
                pending: shown(&pending.path),
                arguments: pending.accept_arguments() + &self.arguments(),
            },
            Err(source) => unwritten(case, "it has no golden", source),
        }
    }

    /// Whether the golden for all serves a profile that has one of its own.
    fn base_passes(&self, case: &str, frame: &Rendered<'_>) -> bool {
        let base = Reference::read(&self.golden(case), frame.variance.is_some());
        base.is_ok_and(|base| base.compare(frame).is_ok())
    }

    /// Leaves the frame to be looked at.
    fn differs(
        &self,
        case: &str,
        frame: &Rendered<'_>,
        golden: &Path,
        against: &Against,
        difference: FrameDifference,
    ) -> GoldenError {
        if let FrameDifference::Mask(source) = difference {
            return GoldenError::Mask { case: case.to_owned(), source };
        }
        let known = frame.known_issue && difference.is_of_values();
        let (advice, pending) = if known {
            // What is known to differ isn't to be decided about.
            (String::new(), None)
        } else {
            match self.write_pending(case, frame, against) {
                Ok(pending) if frame.other_waits => {
                    let of_another =
                        "which is the frame of another path: decide about that one first";
                    (of_another.to_owned(), Some(pending))
                }
                Ok(pending) => (self.advice(&pending, &difference, golden), Some(pending)),
                Err(source) => return unwritten(case, &difference.to_string(), source),
            }
        };
        let pending = pending.map_or_else(String::new, |pending| shown(&pending.path));
        let (case, golden, difference) = (case.to_owned(), shown(golden), Box::new(difference));
        GoldenError::Differs { case, golden, difference, pending, advice }
    }

    /// What to do with a frame that differs.
    fn advice(&self, pending: &Pending, difference: &FrameDifference, golden: &Path) -> String {
        if matches!(difference, FrameDifference::NonFinite(_)) {
            return "and mend the shader: nothing could ever agree with such a frame".to_owned();
        }
        let Pending { case, provenance, .. } = pending;
        if provenance.finding.as_ref().is_some_and(|finding| finding.base_passes) {
            return format!(
                "then delete `{}` with its `.toml` and run the test again: the golden for all passes",
                shown(golden)
            );
        }
        let (arguments, place) = (pending.accept_arguments(), self.arguments());
        format!(
            "then `karat accept {case}{arguments}{place} --because \"...\"` or `karat reject {case}{place}`"
        )
    }
}

/// Whether this can name a golden: it leaves no folder, on any system.
fn is_name(case: &str) -> bool {
    let sound = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    case.split('/').all(|part| !part.is_empty() && part.chars().all(sound))
}

fn unwritten(case: &str, failure: &str, source: ImageError) -> GoldenError {
    GoldenError::Pending { case: case.to_owned(), failure: failure.to_owned(), source }
}

#[cfg(test)]
mod tests;
