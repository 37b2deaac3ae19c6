//! Goldens: accepted HDR frames, and accepted values of functions and buffers.
//!
//! The golden of a frame has two files: `<case>.exr`, and `<case>.toml` with the golden's facts as text. The golden of
//! values has one file, `<case>.csv`: a [`Table`] with the facts in its comments. A frame fails if it has no golden or
//! differs from its golden. Karat then writes `<case>.new.exr` or `<case>.new.csv` beside the golden, or into a folder
//! of build output if `CI` is set. Karat writes a golden only if you accept a pending frame or pending values.

pub(crate) mod acceptance;
pub(crate) mod changes;
pub(crate) mod compare;
mod content;
mod lock;
mod message;
mod number;
mod parts;
pub(crate) mod pending;
pub(crate) mod place;
pub(crate) mod profile;
pub(crate) mod provenance;
mod reference;
pub(crate) mod table;
pub(crate) mod tolerance;
mod values;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use half::f16;

pub(crate) use crate::metric::MASK;
pub(crate) use acceptance::AcceptError;
pub(crate) use compare::{FrameDifference, FrameMargin};
pub use parts::COLOR;
pub(crate) use parts::VARIANCE;
pub(crate) use pending::Pending;
pub(crate) use place::in_ci;
pub(crate) use place::{leave_in, output};
pub(crate) use profile::Profile;
pub use provenance::ProvenanceError;
pub(crate) use provenance::{FrameFinding, Provenance};
pub use table::TableError;
pub(crate) use table::{Column, Table};
pub use tolerance::FrameTolerance;
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
    /// `true` if Karat writes pending frames beside their goldens even if `CI` is set.
    beside: bool,
}

/// Declares a folder of [`Goldens`], relative to the folder of your crate's Cargo.toml.
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

#[derive(Clone)]
pub(crate) struct Rendered<'a> {
    pub(crate) image: &'a Image,
    pub(crate) adapter: &'a Adapter,
    pub(crate) shader: String,
    pub(crate) modules: Vec<LinkedModule>,
    pub(crate) tolerance: Option<&'a FrameTolerance>,
    pub(crate) mask: Option<&'a Mask>,
    pub(crate) variance: Option<&'a Image>,
    /// Facts that the author of the test adds, by name.
    pub(crate) facts: &'a BTreeMap<String, String>,
    /// Draws further images for the pending frame's EXR file, such as AOVs. Karat calls this function only if it writes
    /// the file.
    pub(crate) aovs: &'a dyn Fn() -> Vec<Part>,
    /// `true` if the test declares a known issue for the frame. If the frame then differs from its golden, Karat writes
    /// no pending frame.
    pub(crate) known_issue: bool,
    /// `true` if the frame of another path is pending. Karat then writes no pending frame for this path: you accept or
    /// reject the other frame first, and run the test again.
    pub(crate) other_waits: bool,
}

impl Rendered<'_> {
    fn gate(&self) -> Gate {
        self.tolerance.and_then(FrameTolerance::first_gate).unwrap_or_default()
    }

    /// The format in which the frame's file stores numbers: half floats, or 32-bit floats if rounding to half floats
    /// could exceed the tolerance.
    fn precision(&self) -> Precision {
        self.gate().precision_for(self.image, self.mask)
    }

    /// Checks if the tolerance needs 32-bit floats although the golden has half floats. Karat examines the pixels only
    /// if the tolerance is very small, because rounding changes an ordinary frame by less than the usual tolerance.
    fn asks_for_floats(&self) -> bool {
        self.gate().relative < f16::EPSILON.to_f32() && self.precision() == Precision::Float
    }
}

/// The reason why a frame fails, or why Karat can't compare it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GoldenError {
    /// The name is empty, has two `/` in a row, begins or ends with `/`, or has a character that isn't allowed.
    #[error("`{0}` can't name a golden: use letters, digits, `-`, `_` and `/`")]
    Name(String),
    /// There is no golden yet.
    #[error(
        "frame `{case}` has no golden; look at `{pending}` and accept it with \
         `karat accept {case}{arguments} --because \"...\"`"
    )]
    Missing {
        /// The golden's name.
        case: String,
        /// The file of the rendered frame.
        pending: String,
        /// Further arguments that `karat accept` needs, such as `--any-adapter`.
        arguments: String,
    },
    /// The golden can't be read. Karat doesn't overwrite it.
    #[error("the golden of frame `{case}` can't be used: {cause}{}",
        if matches!(cause, ImageError::Corrupt { .. }) { "; restore the golden from version control" } else { "" })]
    Unreadable {
        /// The golden's name.
        case: String,
        /// The reason.
        cause: ImageError,
    },
    /// The golden's metadata can't be used.
    #[error("the golden of frame `{case}` can't be used: {cause}")]
    Provenance {
        /// The golden's name.
        case: String,
        /// The reason.
        cause: ProvenanceError,
    },
    /// The frame differs from its golden.
    #[error(
        "frame `{case}` differs from its golden `{golden}`: {difference}\n  look at `{pending}`, {advice}"
    )]
    Differs {
        /// The golden's name.
        case: String,
        /// The golden's file.
        golden: String,
        /// The difference.
        difference: Box<FrameDifference>,
        /// The file of the rendered frame.
        pending: String,
        /// Advice on the next step, after you have looked at the frame.
        advice: String,
    },
    /// There is no golden yet, and this frame can't become a golden.
    #[error(
        "frame `{case}` has no golden and can't become one: {difference}\n  look at `{pending}`, and \
         fix the shader"
    )]
    Unacceptable {
        /// The golden's name.
        case: String,
        /// The reason why the frame can't become a golden, such as a NaN.
        difference: Box<FrameDifference>,
        /// The file of the rendered frame.
        pending: String,
    },
    /// The mask can't be used.
    #[error("frame `{case}` can't be compared: {cause}")]
    Mask {
        /// The golden's name.
        case: String,
        /// The reason.
        cause: MaskError,
    },
    /// Karat can't write the pending frame.
    #[error("frame `{case}` fails ({failure}), and its pending image can't be written: {cause}")]
    Pending {
        /// The golden's name.
        case: String,
        /// The reason why the frame failed before Karat tried to write the file.
        failure: String,
        /// The reason.
        cause: ImageError,
    },
}

impl GoldenError {
    /// Adds the command `karat trace` to the message, for the worst pixel, or for the first pixel with NaN or infinity.
    pub(crate) fn point_at_worst(&mut self) {
        let Self::Differs { case, difference, advice, .. } = self else { return };
        let (what, at) = match &**difference {
            FrameDifference::Values(found) => {
                ("the worst pixel", found.worst.as_ref().map(|worst| (worst.x, worst.y)))
            }
            FrameDifference::NonFinite(found) => {
                ("the first pixel with NaN or infinity", found.first)
            }
            _ => return,
        };
        if let Some((x, y)) = at {
            *advice += &format!("\n  `karat trace {case} {x},{y}` shows how {what} gets its value");
        }
    }
}

impl Goldens {
    /// Goldens in a folder relative to `base`. [`goldens!`](crate::goldens) passes the folder of the crate's manifest
    /// as `base`.
    ///
    /// ```
    /// use karat::Goldens;
    ///
    /// // What `karat::goldens!("golden")` makes.
    /// static GOLDENS: Goldens = Goldens::relative(env!("CARGO_MANIFEST_DIR"), "golden");
    /// assert!(GOLDENS.folder().ends_with("golden"));
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub const fn relative(base: &'static str, folder: &'static str) -> Self {
        use std::borrow::Cow;
        Self { base: Cow::Borrowed(base), folder: Cow::Borrowed(folder), beside: false }
    }

    /// Goldens in the folder `folder`.
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
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn folder(&self) -> PathBuf {
        Path::new(self.base.as_ref()).join(self.folder.as_ref())
    }

    fn golden(&self, case: &str) -> PathBuf {
        self.folder().join(format!("{case}.exr"))
    }

    fn golden_of(&self, case: &str, profile: &Profile) -> PathBuf {
        self.folder().join(format!("@{profile}/{case}.exr"))
    }

    /// Returns the path of the golden with which Karat compares a frame of a profile, and `true` if this is the
    /// profile's own golden. A profile without its own golden uses the golden for all profiles, and never another
    /// profile's golden.
    fn used(&self, case: &str, profile: &Profile) -> (PathBuf, bool) {
        let own = self.golden_of(case, profile);
        // A broken link counts as the profile's own golden, because an author made that link.
        if own.symlink_metadata().is_ok() { (own, true) } else { (self.golden(case), false) }
    }

    /// The files on which a comparison depends: the golden of the adapter's profile, and the golden for all
    /// profiles. A file that doesn't exist is listed as missing.
    pub(crate) fn files(&self, case: &str, adapter: &Adapter) -> Vec<FileRead> {
        if !is_name(case) {
            return Vec::new();
        }
        let own = self.golden_of(case, &Profile::of(adapter));
        [own, self.golden(case)].iter().map(|file| FileRead::now(file)).collect()
    }

    /// The golden with which Karat compared a pending frame.
    ///
    /// ```no_run
    /// use karat::Goldens;
    ///
    /// let goldens = Goldens::open("golden".as_ref());
    /// for pending in goldens.pending().frames {
    ///     println!("{} and {}", goldens.compared(&pending).display(), pending.path.display());
    /// }
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
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

    /// Compares an image from another program with a golden. The default tolerance of frames applies. If the image
    /// differs from the golden, or there is no golden yet, Karat writes the image as a pending frame.
    ///
    /// ```no_run
    /// use karat::unstable::path::Adapter;
    /// use karat::{Goldens, Image};
    ///
    /// let image = Image::read("screenshot.png".as_ref())?;
    /// let (path, name, driver) = ("image".into(), "Chrome 156".into(), String::new());
    /// let adapter = Adapter { path, name, driver, software: false };
    /// let margin = Goldens::open("golden".as_ref()).check_image("menu", &image, &adapter)?;
    /// println!("{margin}");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the image differs from the golden, or there is no golden.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn check_image(
        &self,
        case: &str,
        image: &Image,
        adapter: &Adapter,
    ) -> Result<FrameMargin, GoldenError> {
        let (shader, modules, facts) = (String::new(), Vec::new(), BTreeMap::new());
        let (tolerance, mask, variance) = (None, None, None);
        let (known_issue, other_waits) = (false, false);
        let (facts, aovs) = (&facts, &Vec::new);
        self.check(
            case,
            &Rendered {
                image,
                adapter,
                shader,
                modules,
                tolerance,
                mask,
                variance,
                facts,
                aovs,
                known_issue,
                other_waits,
            },
        )
    }

    /// Compares a frame with its golden, and writes or removes the pending frame.
    pub(crate) fn check(
        &self,
        case: &str,
        frame: &Rendered<'_>,
    ) -> Result<FrameMargin, GoldenError> {
        let loaded = self.load(case, frame)?;
        let compared = loaded.compare(frame);
        self.settle(case, frame, &loaded, compared)
    }

    fn load(&self, case: &str, frame: &Rendered<'_>) -> Result<Loaded, GoldenError> {
        if !is_name(case) {
            return Err(GoldenError::Name(case.to_owned()));
        }
        let profile = Profile::of(frame.adapter);
        let (file, own) = self.used(case, &profile);
        let case = || case.to_owned();
        let golden = match Reference::read(&file, frame.variance.is_some()) {
            Ok(golden) => Some(golden),
            Err(ReferenceError::Image(ImageError::Missing { .. })) => None,
            Err(ReferenceError::Image(cause)) => {
                return Err(GoldenError::Unreadable { case: case(), cause });
            }
            Err(ReferenceError::Provenance(cause)) => {
                return Err(GoldenError::Provenance { case: case(), cause });
            }
        };
        let profile = (own && golden.is_some()).then_some(profile);
        Ok(Loaded { file, golden, profile })
    }

    /// Removes the pending frame if the frame agrees with its golden. Otherwise writes the frame as pending.
    fn settle(
        &self,
        case: &str,
        frame: &Rendered<'_>,
        loaded: &Loaded,
        compared: Result<FrameMargin, FrameDifference>,
    ) -> Result<FrameMargin, GoldenError> {
        let (golden, profile) = (shown(&loaded.file), loaded.profile.clone());
        let name = || case.to_owned();
        let difference = match compared {
            Err(FrameDifference::Mask(cause)) => {
                return Err(GoldenError::Mask { case: name(), cause });
            }
            Ok(margin) if loaded.golden.is_some() => {
                if !frame.other_waits {
                    self.remove_pending(case, &Profile::of(frame.adapter));
                }
                return Ok(FrameMargin { golden, profile, ..margin });
            }
            compared => compared.err(),
        };
        // Nobody has to decide about a known issue, so Karat writes no pending frame.
        let is_known = loaded.golden.is_some()
            && frame.known_issue
            && difference.as_ref().is_some_and(FrameDifference::is_of_values);
        let pending = if is_known {
            None
        } else {
            let base_passes = loaded.profile.is_some() && self.base_passes(case, frame);
            let finding = difference
                .as_ref()
                .map(|difference| FrameFinding { base_passes, ..FrameFinding::from(difference) });
            let against = loaded.against(frame, finding);
            let unwritten = |cause| GoldenError::Pending {
                case: name(),
                failure: difference
                    .as_ref()
                    .map_or("it has no golden".to_owned(), FrameDifference::to_string),
                cause,
            };
            Some(self.write_pending(case, frame, &against).map_err(unwritten)?)
        };
        let file = pending.as_ref().map_or_else(String::new, |pending| shown(&pending.path));
        Err(match difference.map(Box::new) {
            Some(difference) if loaded.golden.is_some() => {
                let advice = match &pending {
                    None => String::new(),
                    Some(_) if frame.other_waits => {
                        "a frame of another path: accept or reject that frame, then run the test again"
                            .to_owned()
                    }
                    Some(pending) => self.advice(pending, &difference, &loaded.file),
                };
                GoldenError::Differs { case: name(), golden, difference, pending: file, advice }
            }
            Some(difference) => {
                GoldenError::Unacceptable { case: name(), difference, pending: file }
            }
            None => {
                let pending = pending.expect("without a golden no difference is known");
                let arguments = pending.accept_arguments() + &self.arguments();
                GoldenError::Missing { case: name(), pending: file, arguments }
            }
        })
    }

    /// For a profile with its own golden, checks if the frame would also pass with the golden for all profiles.
    fn base_passes(&self, case: &str, frame: &Rendered<'_>) -> bool {
        let base = Reference::read(&self.golden(case), frame.variance.is_some());
        base.is_ok_and(|base| base.compare(frame).is_ok())
    }

    fn advice(&self, pending: &Pending, difference: &FrameDifference, golden: &Path) -> String {
        if matches!(difference, FrameDifference::NonFinite(_)) {
            return "and fix the shader: a frame with NaN or infinity never agrees with a golden"
                .to_owned();
        }
        let Pending { case, provenance, .. } = pending;
        if provenance.finding.as_ref().is_some_and(|finding| finding.base_passes) {
            return format!(
                "then delete the profile's own golden `{}` and its `.toml`, and run the test again: the frame passes with the golden that applies to all profiles",
                shown(golden)
            );
        }
        let (arguments, place) = (pending.accept_arguments(), self.arguments());
        format!(
            "then `karat accept {case}{arguments}{place} --because \"...\"` or `karat reject {case}{place}`"
        )
    }
}

/// Checks if a golden can have this name: letters, digits, `-`, `_` and `/` only, so that no name leads out of
/// the folder.
fn is_name(case: &str) -> bool {
    let sound = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    case.split('/').all(|part| !part.is_empty() && part.chars().all(sound))
}

struct Loaded {
    file: PathBuf,
    /// `None` if there is no golden yet.
    golden: Option<Reference>,
    profile: Option<Profile>,
}

impl Loaded {
    /// Compares a frame with its golden. If there is no golden, compares the frame with itself, because this comparison
    /// fails for NaN and infinities.
    fn compare(&self, frame: &Rendered<'_>) -> Result<FrameMargin, FrameDifference> {
        match &self.golden {
            Some(golden) => golden.compare(frame),
            None => {
                let tolerance = self.tolerance(frame);
                let terms = Terms { mask: frame.mask, ..Terms::of(&tolerance) };
                compare::compare(frame.image, frame.image, &terms)
            }
        }
    }

    fn tolerance(&self, frame: &Rendered<'_>) -> FrameTolerance {
        match &self.golden {
            Some(golden) => golden.tolerance(frame),
            None => frame.tolerance.cloned().unwrap_or_default(),
        }
    }

    fn against(&self, frame: &Rendered<'_>, finding: Option<FrameFinding>) -> Against {
        Against {
            hash: self.golden.as_ref().map_or_else(String::new, Reference::hash),
            profile: self.profile.as_ref().map_or_else(String::new, Profile::to_string),
            tolerance: self.tolerance(frame).to_string(),
            finding,
        }
    }
}

#[cfg(test)]
mod tests;
