//! Frames that wait to be accepted or rejected.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::{Goldens, Provenance, Rendered, SCHEMA};
use crate::diagnostic::{nearest, shown};
use crate::image::{Image, ImageError, Precision};

/// A frame that differs from its golden, or has none.
#[derive(Clone, Debug)]
pub struct Pending {
    /// Name of the golden.
    pub case: String,
    /// The frame's file.
    pub path: PathBuf,
    /// What rendered it.
    pub provenance: Provenance,
}

/// The decision to accept.
#[derive(Clone, Debug, Default)]
pub struct Acceptance {
    /// Why the new image is right.
    pub because: String,
    /// Who accepts; `None`: Git's `user.name`, else the login name.
    pub by: Option<String>,
    /// Whether the frame may come from something else than lavapipe.
    pub any_adapter: bool,
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
    /// A file can't be read or written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The pending file has no provenance.
    #[error("`{0}` wasn't written by Karat: it has no provenance")]
    Foreign(String),
}

impl Goldens {
    /// Where pending frames are written: beside their goldens or, with `CI` set, in the folder of
    /// build output, as nothing may change the sources there. There, too, under an overlay: its
    /// frames are to be looked at and not to be accepted.
    fn pending_folder(&self) -> PathBuf {
        let ci = std::env::var_os("CI").is_some_and(|value| !value.is_empty());
        if ci || crate::package::overlay().is_some() {
            build_output().join("karat/pending")
        } else {
            self.folder()
        }
    }

    pub(super) fn write_pending(
        &self,
        case: &str,
        frame: &Rendered<'_>,
        compared_with: &str,
        precision: Precision,
    ) -> Result<String, ImageError> {
        let stored = frame.image.rounded_to(precision);
        let provenance = Provenance {
            schema: SCHEMA,
            case: case.to_owned(),
            shader: frame.shader.clone(),
            pixels: stored.hash(),
            width: stored.width(),
            height: stored.height(),
            color_space: "linear sRGB (BT.709 primaries, D65)".to_owned(),
            precision,
            relative: format!("{:e}", frame.relative),
            adapter: frame.adapter.clone(),
            processor: processor(),
            compared_with: compared_with.to_owned(),
            accepted_by: String::new(),
            accepted_at: String::new(),
            because: String::new(),
        };
        let path = self.pending_folder().join(format!("{case}.new.exr"));
        let metadata = serde_json::to_string(&provenance).expect("provenance is plain data");
        stored.write_exr(&path, precision, Some(&metadata))?;
        Ok(shown(&path))
    }

    pub(super) fn remove_pending(&self, case: &str) {
        // A frame that agrees again has nothing to review. That there was none is no error.
        drop(std::fs::remove_file(self.pending_folder().join(format!("{case}.new.exr"))));
    }

    /// All pending frames of a folder, by name.
    ///
    /// # Errors
    /// If a pending file can't be read, or isn't Karat's.
    pub fn pending(&self) -> Result<Vec<Pending>, AcceptError> {
        let mut found = Vec::new();
        let pattern = self.folder().join("**/*.new.exr");
        let files = glob::glob(&pattern.to_string_lossy()).into_iter().flatten();
        for path in files.filter_map(Result::ok) {
            let (_, metadata) = Image::read_exr(&path)?;
            let provenance: Provenance = metadata
                .and_then(|metadata| serde_json::from_str(&metadata).ok())
                .ok_or_else(|| AcceptError::Foreign(shown(&path)))?;
            found.push(Pending { case: provenance.case.clone(), path, provenance });
        }
        found.sort_by(|a, b| a.case.cmp(&b.case));
        Ok(found)
    }

    /// The pending frames that a name or a glob selects.
    ///
    /// # Errors
    /// If none is.
    pub fn select(&self, pattern: &str) -> Result<Vec<Pending>, AcceptError> {
        let all = self.pending()?;
        let glob = glob::Pattern::new(pattern).ok();
        let matches =
            |case: &str| case == pattern || glob.as_ref().is_some_and(|glob| glob.matches(case));
        let selected: Vec<_> = all.iter().filter(|p| matches(&p.case)).cloned().collect();
        if selected.is_empty() {
            let names = all.iter().map(|pending| pending.case.as_str());
            let nearest = nearest(pattern, names).map(str::to_owned);
            return Err(AcceptError::NotPending { case: pattern.to_owned(), nearest });
        }
        Ok(selected)
    }

    /// Makes a pending frame the golden.
    ///
    /// # Errors
    /// Without a reason; if the golden changed since the frame was compared; if the frame wasn't
    /// rendered on lavapipe and any adapter isn't allowed; if a file can't be written.
    pub fn accept(&self, pending: &Pending, acceptance: &Acceptance) -> Result<(), AcceptError> {
        let case = pending.case.clone();
        let because = acceptance.because.trim();
        if because.is_empty() {
            return Err(AcceptError::NoReason(case));
        }
        let adapter = &pending.provenance.adapter;
        let canonical = adapter.path == "vulkan" && adapter.name.contains("llvmpipe");
        if !canonical && !acceptance.any_adapter {
            return Err(AcceptError::Adapter { case, adapter: adapter.to_string() });
        }
        let path = self.golden(&case);
        let current = match Image::read_exr(&path) {
            Ok((golden, _)) => golden.hash(),
            Err(ImageError::Missing { .. }) => String::new(),
            // A golden that can't be read is replaced by accepting; it can't be lost twice.
            Err(ImageError::Corrupt { .. } | ImageError::LfsPointer { .. }) => {
                pending.provenance.compared_with.clone()
            }
            Err(error) => return Err(error.into()),
        };
        if current != pending.provenance.compared_with {
            return Err(AcceptError::Stale(case));
        }
        let (image, _) = Image::read_exr(&pending.path)?;
        if image.non_finite().first.is_some() {
            return Err(AcceptError::NonFinite(case));
        }
        let provenance = Provenance {
            compared_with: String::new(),
            accepted_by: acceptance.by.clone().unwrap_or_else(person),
            accepted_at: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            because: because.to_owned(),
            ..pending.provenance.clone()
        };
        let metadata = serde_json::to_string(&provenance).expect("provenance is plain data");
        image.write_exr(&path, provenance.precision, Some(&metadata))?;
        let facts = toml::to_string(&provenance).expect("provenance is plain data");
        let sidecar = path.with_extension("toml");
        crate::image::write_whole(&sidecar, facts.as_bytes())
            .map_err(|source| ImageError::Write { path: shown(&sidecar), source })?;
        self.reject(pending)
    }

    /// Deletes a pending frame.
    ///
    /// # Errors
    /// If the file can't be deleted.
    pub fn reject(&self, pending: &Pending) -> Result<(), AcceptError> {
        std::fs::remove_file(&pending.path).map_err(|source| {
            AcceptError::Image(ImageError::Write { path: shown(&pending.path), source })
        })
    }
}

/// Cargo's target folder, which it marks for backup programs; the folder above the profile's in
/// one that Cargo didn't make, and so doesn't mark; the working directory if the test wasn't built by Cargo.
pub(crate) fn build_output() -> PathBuf {
    let exe = std::env::current_exe().unwrap_or_default();
    let marked = exe.ancestors().find(|folder| folder.join("CACHEDIR.TAG").is_file());
    let profile = || exe.ancestors().find(|folder| folder.join("deps").is_dir());
    marked.or_else(|| profile()?.parent()).map_or_else(PathBuf::new, Path::to_path_buf)
}

/// Who accepts: the name that Git signs commits with, or the login name.
fn person() -> String {
    let git = std::process::Command::new("git").args(["config", "user.name"]).output();
    let name = git.ok().map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    name.filter(|name| !name.is_empty())
        .or_else(|| std::env::var("USER").or_else(|_| std::env::var("USERNAME")).ok())
        .unwrap_or_else(|| "unknown".to_owned())
}

/// Vendor and model of the processor, where the system tells.
fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let field = |name: &str| {
        let line = info.lines().find(|line| line.starts_with(name))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    match (field("vendor_id"), field("model name")) {
        (Some(vendor), Some(model)) => format!("{vendor}, {model}"),
        _ => std::env::consts::ARCH.to_owned(),
    }
}
