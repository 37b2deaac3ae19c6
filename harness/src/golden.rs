//! Golden images: what a frame should look like, in HDR.
//!
//! A golden is `<case>.exr` and `<case>.toml`, the same facts as text. A frame that differs, or
//! has no golden, fails and leaves `<case>.new.exr` beside it (with `CI` set, in the report's
//! folder instead). Only accepting writes a golden.

mod acceptance;
mod compare;
mod message;
mod pending;
mod profile;
mod tolerance;
mod variance;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

pub use acceptance::{AcceptError, Acceptance, Accepted};
pub use compare::{Deviation, FrameDifference, FrameMargin};
pub use pending::Pending;
pub(crate) use pending::build_output;
pub use profile::Profile;
pub use tolerance::{Criterion, CriterionMargin, FrameTolerance};
pub(crate) use tolerance::{MEAN_BOUND, TILE_BOUND};

use self::compare::Terms;
use crate::diagnostic::shown;
use crate::image::{Image, ImageError, Precision};
use crate::metric::{DEFAULT_RELATIVE, ExposureRange, Mask, MaskError};
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
#[macro_export]
macro_rules! goldens {
    ($folder:expr) => {
        $crate::Goldens::relative(env!("CARGO_MANIFEST_DIR"), $folder)
    };
}

/// What is known of a golden or a pending frame, stored in its EXR and beside it as TOML.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of this format.
    pub schema: u32,
    /// Name of the golden.
    pub case: String,
    /// blake3 of the linked WGSL.
    pub shader: String,
    /// blake3 of size and pixels, as stored.
    pub pixels: String,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Colour space of the values.
    pub color_space: String,
    /// How samples are stored.
    pub precision: Precision,
    /// What the frame may differ by: `1e-3`, a relative difference, or a tree of bounds.
    pub relative: String,
    /// What rendered it. The name of a software rasteriser holds its compiler's version and its
    /// vector width, which its results depend on.
    pub adapter: Adapter,
    /// Vendor and model of the processor: software rasterisers differ between them.
    pub processor: String,
    /// Pixels of the golden that this frame was compared with; empty if there was none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub compared_with: String,
    /// The profile whose golden this frame was compared with; empty if it was the one for all.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub compared_profile: String,
    /// What HDR-FLIP looks at, pinned when the golden was accepted: it doesn't change with the
    /// frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposures: Option<ExposureRange>,
    /// Who accepted it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub accepted_by: String,
    /// When, in UTC.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub accepted_at: String,
    /// Why.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub because: String,
}

/// Version of [`Provenance`].
const SCHEMA: u32 = 1;

/// A frame to be compared.
#[derive(Clone, Debug)]
pub(crate) struct Rendered<'a> {
    pub(crate) image: &'a Image,
    pub(crate) adapter: &'a Adapter,
    pub(crate) shader: String,
    /// `None`: the default for the golden and the adapter.
    pub(crate) tolerance: Option<&'a FrameTolerance>,
    pub(crate) mask: Option<&'a Mask>,
    /// Variance of each pixel, of a frame that is noisy.
    pub(crate) variance: Option<&'a Image>,
}

/// Why a frame has no verdict, or a bad one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GoldenError {
    /// A name that isn't one path component or several joined by `/`.
    #[error("`{0}` can't name a golden: use letters, digits, `-`, `_` and `/`")]
    Name(String),
    /// There is no golden yet.
    #[error(
        "frame `{case}` has no golden; look at `{pending}` and accept it with \
         `karat accept {case} --because \"...\"`"
    )]
    Missing {
        /// The golden.
        case: String,
        /// The frame that was rendered.
        pending: String,
    },
    /// The golden can't be read. It isn't overwritten.
    #[error(
        "the golden of frame `{case}` can't be used: {source}; restore it from version control"
    )]
    Unreadable {
        /// The golden.
        case: String,
        /// Why.
        source: ImageError,
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
        /// What to do when one has looked at it.
        advice: String,
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
    #[must_use]
    pub const fn relative(base: &'static str, folder: &'static str) -> Self {
        use std::borrow::Cow;
        Self { base: Cow::Borrowed(base), folder: Cow::Borrowed(folder), beside: false }
    }

    /// A folder.
    #[must_use]
    pub fn open(folder: &Path) -> Self {
        let folder = folder.to_string_lossy().into_owned().into();
        Self { base: std::borrow::Cow::Borrowed(""), folder, beside: false }
    }

    /// The folder.
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
        let against = pending::Against {
            hash: String::new(),
            profile: if own { profile.to_string() } else { String::new() },
            precision: Precision::Half,
        };
        let (golden, metadata) = match Image::read_exr(&file) {
            Ok(read) => read,
            Err(ImageError::Missing { .. }) => {
                // A frame with NaN is wrong with and without a golden.
                let tolerance = &FrameTolerance::gate(0.0);
                let terms = Terms { mask: frame.mask, ..Terms::of(tolerance) };
                if let Err(difference) = compare::compare(frame.image, frame.image, &terms) {
                    return Err(self.differs(case, frame, &file, against, difference));
                }
                let pending = self
                    .write_pending(case, frame, &against)
                    .map_err(|source| unwritten(case, "it has no golden", source))?;
                return Err(GoldenError::Missing { case: case.to_owned(), pending });
            }
            Err(source) => return Err(GoldenError::Unreadable { case: case.to_owned(), source }),
        };
        // A golden made by another tool has no provenance of ours; it is float to be on the safe
        // side.
        let provenance: Option<Provenance> =
            metadata.and_then(|metadata| serde_json::from_str(&metadata).ok());
        let precision = provenance.as_ref().map_or(Precision::Float, |known| known.precision);
        let made_on = provenance.as_ref().map(|known| Profile::of(&known.adapter));
        let standard = match frame.variance {
            // Of an unknown origin it is held to the bounds of its own profile.
            None => FrameTolerance::standard(made_on.is_some_and(|made_on| made_on != profile)),
            // FLIP would see the noise, and let pass what is fainter.
            Some(_) => FrameTolerance::gate(DEFAULT_RELATIVE),
        };
        let unreadable = |source| GoldenError::Unreadable { case: case.to_owned(), source };
        let golden_variance = match frame.variance {
            None => None,
            Some(_) => variance::read(&file).map_err(unreadable)?,
        };
        let terms = Terms {
            mask: frame.mask,
            exposures: provenance.and_then(|known| known.exposures),
            noise: frame.variance.map(|actual| (golden_variance.as_ref(), actual)),
            ..Terms::of(frame.tolerance.unwrap_or(&standard))
        };
        let actual = frame.image.rounded_to(precision);
        match compare::compare(&golden, &actual, &terms) {
            Ok(margin) => {
                self.remove_pending(case);
                let profile = own.then_some(profile);
                Ok(FrameMargin { golden: shown(&file), profile, ..margin })
            }
            Err(difference) => {
                let against = pending::Against { hash: golden.hash(), precision, ..against };
                Err(self.differs(case, frame, &file, against, difference))
            }
        }
    }

    /// Leaves the frame to be looked at.
    fn differs(
        &self,
        case: &str,
        frame: &Rendered<'_>,
        golden: &Path,
        mut against: pending::Against,
        difference: FrameDifference,
    ) -> GoldenError {
        if let FrameDifference::Mask(source) = difference {
            return GoldenError::Mask { case: case.to_owned(), source };
        }
        // NaN and infinities are to be looked at as they are.
        if matches!(difference, FrameDifference::NonFinite(_)) {
            against.precision = Precision::Float;
        }
        let pending = match self.write_pending(case, frame, &against) {
            Ok(pending) => pending,
            Err(source) => return unwritten(case, &difference.to_string(), source),
        };
        let advice = self.advice(case, frame, &against, &difference);
        let (case, golden, difference) = (case.to_owned(), shown(golden), Box::new(difference));
        GoldenError::Differs { case, golden, difference, pending, advice }
    }
}

impl Goldens {
    /// What to do with a frame that differs.
    fn advice(
        &self,
        case: &str,
        frame: &Rendered<'_>,
        against: &pending::Against,
        difference: &FrameDifference,
    ) -> String {
        if matches!(difference, FrameDifference::NonFinite(_)) {
            return "and mend the shader: nothing could ever agree with such a frame".to_owned();
        }
        let profile = Profile::of(frame.adapter);
        let accept = if acceptance::is_canonical(frame.adapter) && against.profile.is_empty() {
            String::new()
        } else {
            format!(" --profile {profile}")
        };
        format!("then `karat accept {case}{accept} --because \"...\"` or `karat reject {case}`")
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
