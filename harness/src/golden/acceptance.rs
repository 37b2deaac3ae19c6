//! Accepting: the only thing that writes a golden.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::compare::{Terms, compare};
use super::{FrameTolerance, Goldens, Pending, Profile, Provenance, variance};
use crate::diagnostic::shown;
use crate::image::{Image, ImageError};
use crate::metric::ExposureRange;
use crate::path::Adapter;

/// A golden larger than this, in bytes, is accepted with a warning: every clone of the project
/// holds each version of it for ever.
const LARGE: u64 = 128 << 10;
/// A golden larger than this isn't accepted.
const TOO_LARGE: u64 = 1 << 20;
/// Columns and rows of frames that are larger than they need be.
const WIDE: (u32, u32) = (640, 360);

/// The decision to accept.
#[derive(Clone, Debug, Default)]
pub struct Acceptance {
    /// Why the new image is right.
    pub because: String,
    /// Who accepts; `None`: Git's `user.name`, else the login name.
    pub by: Option<String>,
    /// Whether the frame may come from something else than lavapipe.
    pub any_adapter: bool,
    /// The profile whose own golden it becomes: that of the frame's adapter, where the golden for
    /// all fails. `None`: it becomes the golden for all.
    pub profile: Option<String>,
}

/// What accepting did.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Accepted {
    /// The golden.
    pub golden: PathBuf,
    /// Whether it was written: not if its pixels and facts are what they were.
    pub written: bool,
    /// What a reviewer should know.
    pub warnings: Vec<String>,
}

/// Why a pending frame isn't accepted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AcceptError {
    /// No such frame is pending.
    #[error("no frame `{case}` is pending{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    NotPending {
        /// What was asked for.
        case: String,
        /// The closest pending frame.
        nearest: Option<String>,
    },
    /// No reason was given.
    #[error("accepting `{0}` needs a reason that a reviewer can check: --because \"...\"")]
    NoReason(String),
    /// The frame was rendered on something else than the canonical rasteriser.
    #[error(
        "`{case}` was rendered on {adapter}; goldens are made on lavapipe (path vulkan), so that \
         any machine can check them: render it there, or say --any-adapter"
    )]
    Adapter {
        /// The golden.
        case: String,
        /// What rendered it.
        adapter: String,
    },
    /// The frame can't be matched by any other.
    #[error("`{0}` has NaN or infinite pixels; nothing could ever agree with it")]
    NonFinite(String),
    /// The golden is another one than the frame was compared with.
    #[error(
        "the golden of `{0}` has changed since the pending frame was rendered; run the test again"
    )]
    Stale(String),
    /// The file's pixels are others than it says.
    #[error(
        "the pending frame of `{0}` isn't the one that was looked at: its pixels are others than its \
         file says; run the test again"
    )]
    Altered(String),
    /// A pending file isn't where its own metadata says.
    #[error("`{path}` says that it is frame `{case}`; delete it and run its test again")]
    Misplaced {
        /// The file.
        path: String,
        /// The name in its metadata.
        case: String,
    },
    /// The frame comes from another profile.
    #[error("`{case}` was rendered on profile {found}, and can't be the golden of {asked}")]
    Profile {
        /// The golden.
        case: String,
        /// The frame's profile.
        found: Profile,
        /// The profile that was asked for.
        asked: String,
    },
    /// The frame was compared with its profile's own golden.
    #[error(
        "`{case}` was compared with the golden of profile {profile}; accept it there with \
         --profile {profile}"
    )]
    Own {
        /// The golden.
        case: String,
        /// The profile.
        profile: String,
    },
    /// The golden for all serves the profile, or there is none that could fail.
    #[error(
        "`{case}` needs no golden of profile {profile}: {}",
        if *missing {
            "there is no golden for all yet; accept one first"
        } else {
            "the golden for all passes there"
        }
    )]
    Needless {
        /// The golden.
        case: String,
        /// The profile.
        profile: Profile,
        /// Whether there is no golden for all.
        missing: bool,
    },
    /// The file would be too large.
    #[error(
        "the golden of `{case}` would be {} KiB, and at most {} are accepted: render it smaller, \
         or less noisy",
        bytes >> 10,
        TOO_LARGE >> 10
    )]
    TooLarge {
        /// The golden.
        case: String,
        /// Size of the file.
        bytes: u64,
    },
    /// A file can't be read or written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The pending file has no provenance.
    #[error("`{0}` wasn't written by Karat: it has no provenance")]
    Foreign(String),
}

impl Goldens {
    /// Makes a pending frame the golden.
    ///
    /// # Errors
    /// Without a reason; if the golden changed since the frame was compared; if the frame wasn't
    /// rendered on lavapipe and any adapter isn't allowed; if a profile doesn't need its own
    /// golden; if the file is too large or can't be written.
    pub fn accept(
        &self,
        pending: &Pending,
        acceptance: &Acceptance,
    ) -> Result<Accepted, AcceptError> {
        let (case, because) = (pending.case.clone(), acceptance.because.trim());
        if because.is_empty() {
            return Err(AcceptError::NoReason(case));
        }
        let (image, _) = Image::read_exr(&pending.path)?;
        if image.hash() != pending.provenance.pixels {
            return Err(AcceptError::Altered(case));
        }
        let path = match &acceptance.profile {
            None => {
                let profile = pending.provenance.compared_profile.clone();
                if !profile.is_empty() {
                    return Err(AcceptError::Own { case, profile });
                }
                let adapter = &pending.provenance.adapter;
                if !is_canonical(adapter) && !acceptance.any_adapter {
                    return Err(AcceptError::Adapter { case, adapter: adapter.to_string() });
                }
                self.golden(&case)
            }
            Some(profile) => self.needed(pending, &image, profile)?,
        };
        if image.non_finite().first.is_some() {
            return Err(AcceptError::NonFinite(case));
        }
        // The file that the frame was compared with, which needn't be the one that is written.
        let compared = match pending.provenance.compared_profile.as_str() {
            "" => self.golden(&case),
            _ => self.golden_of(&case, &Profile::of(&pending.provenance.adapter)),
        };
        let current = match Image::read_exr(&compared) {
            Ok((golden, _)) => golden.hash(),
            Err(ImageError::Missing { .. }) => String::new(),
            // A golden that is damaged is replaced by accepting; it can't be lost twice. One that
            // Git has not fetched isn't lost.
            Err(ImageError::Corrupt { .. }) => pending.provenance.compared_with.clone(),
            Err(error) => return Err(error.into()),
        };
        if current != pending.provenance.compared_with {
            return Err(AcceptError::Stale(case));
        }
        let provenance = Provenance {
            compared_with: String::new(),
            compared_profile: String::new(),
            exposures: Some(ExposureRange::of(&image)),
            accepted_by: acceptance.by.clone().unwrap_or_else(person),
            accepted_at: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            because: because.to_owned(),
            ..pending.provenance.clone()
        };
        // Read before anything is written, so that a damaged one leaves the golden as it was.
        let variance = variance::read(&pending.path)?;
        let accepted = write_golden(&path, &image, &provenance)?;
        match variance {
            Some(variance) => variance::write(&path, &variance)?,
            // That of another image says nothing of this one. Most have none.
            None => drop(std::fs::remove_file(variance::file(&path))),
        }
        self.reject(pending)?;
        Ok(accepted)
    }

    /// Where the golden of a profile goes, if the profile is the frame's and the golden for all
    /// fails there.
    fn needed(
        &self,
        pending: &Pending,
        image: &Image,
        asked: &str,
    ) -> Result<PathBuf, AcceptError> {
        let (case, known) = (pending.case.clone(), &pending.provenance);
        let profile = Profile::of(&known.adapter);
        if profile.to_string() != asked {
            return Err(AcceptError::Profile { case, found: profile, asked: asked.to_owned() });
        }
        let (base, metadata) = match Image::read_exr(&self.golden(&case)) {
            Ok(read) => read,
            Err(ImageError::Missing { .. }) => {
                return Err(AcceptError::Needless { case, profile, missing: true });
            }
            Err(error) => return Err(error.into()),
        };
        // A frame that was compared with the golden for all has failed there, by its own tolerance
        // and mask.
        let failed = known.compared_profile.is_empty() && known.compared_with == base.hash();
        let base_known = metadata.and_then(|text| serde_json::from_str::<Provenance>(&text).ok());
        let tolerance = known
            .relative
            .parse()
            .map_or_else(|_| FrameTolerance::standard(true), FrameTolerance::gate);
        let exposures = base_known.and_then(|known| known.exposures);
        let terms = Terms { exposures, ..Terms::of(&tolerance) };
        if !failed && compare(&base, image, &terms).is_ok() {
            return Err(AcceptError::Needless { case, profile, missing: false });
        }
        let own = self.golden_of(&case, &profile);
        if known.compared_profile.is_empty() && own.exists() {
            return Err(AcceptError::Stale(case));
        }
        Ok(own)
    }
}

/// Whether goldens for all profiles are made on it: any machine can have lavapipe.
pub(super) fn is_canonical(adapter: &Adapter) -> bool {
    adapter.path == "vulkan" && adapter.name.contains("llvmpipe")
}

/// Writes a golden and its facts, unless both are there already.
fn write_golden(
    path: &Path,
    image: &Image,
    provenance: &Provenance,
) -> Result<Accepted, AcceptError> {
    let golden = path.to_owned();
    let facts = |known: &Provenance| {
        let (accepted_by, accepted_at, because) = Default::default();
        Provenance { accepted_by, accepted_at, because, ..known.clone() }
    };
    if let Ok((current, Some(metadata))) = Image::read_exr(path) {
        let known: Option<Provenance> = serde_json::from_str(&metadata).ok();
        let same = known.is_some_and(|known| facts(&known) == facts(provenance));
        if same && current.hash() == image.hash() && path.with_extension("toml").is_file() {
            let warnings = vec![format!("`{}` has these pixels and facts already", shown(path))];
            return Ok(Accepted { golden, written: false, warnings });
        }
    }
    let metadata = serde_json::to_string(provenance).expect("provenance is plain data");
    let beside = path.with_extension("exr.new");
    image.write_exr(&beside, provenance.precision, Some(&metadata))?;
    let failed = |source| ImageError::Write { path: shown(path), source };
    let bytes = std::fs::metadata(&beside).map_err(failed)?.len();
    if bytes > TOO_LARGE {
        std::fs::remove_file(&beside).map_err(failed)?;
        return Err(AcceptError::TooLarge { case: provenance.case.clone(), bytes });
    }
    std::fs::rename(&beside, path).map_err(failed)?;
    let mut warnings = Vec::new();
    if bytes > LARGE {
        let (size, limit) = (bytes >> 10, LARGE >> 10);
        warnings.push(format!(
            "`{}` is {size} KiB; above {limit} KiB, a smaller frame is worth a thought",
            shown(path)
        ));
    }
    let (width, height) = (image.width(), image.height());
    if width > WIDE.0 || height > WIDE.1 {
        warnings.push(format!(
            "`{}` is {width} x {height}; {} x {} shows most faults",
            shown(path),
            WIDE.0,
            WIDE.1
        ));
    }
    let facts = toml::to_string(provenance).expect("provenance is plain data");
    let sidecar = path.with_extension("toml");
    crate::image::write_whole(&sidecar, facts.as_bytes())
        .map_err(|source| ImageError::Write { path: shown(&sidecar), source })?;
    Ok(Accepted { golden, written: true, warnings })
}

/// Who accepts: the name that Git signs commits with, or the login name.
fn person() -> String {
    let git = std::process::Command::new("git").args(["config", "user.name"]).output();
    let name = git.ok().map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    name.filter(|name| !name.is_empty())
        .or_else(|| std::env::var("USER").or_else(|_| std::env::var("USERNAME")).ok())
        .unwrap_or_else(|| "unknown".to_owned())
}
