//! Frames that wait to be accepted or rejected.

use std::path::{Path, PathBuf};

use super::{AcceptError, FrameTolerance, Goldens, Provenance, Rendered, SCHEMA};
use crate::diagnostic::{nearest, shown};
use crate::image::{Image, ImageError, Precision};

/// The folder of frames that were rendered under an overlay. No golden's name has an `@`.
const OVERLAID: &str = "@overlay";

/// What a frame was compared with.
pub(super) struct Against {
    /// Of the golden's pixels; empty if there was none.
    pub(super) hash: String,
    /// Whose golden it was; empty: that of all.
    pub(super) profile: String,
    /// How the frame is stored.
    pub(super) precision: Precision,
}

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

impl Goldens {
    /// Where pending frames are written: beside their goldens or, with `CI` set, in the folder of
    /// build output, as nothing may change the sources there. There, too, under an overlay: its
    /// frames are to be looked at and not to be accepted.
    fn pending_folder(&self) -> PathBuf {
        let ci = std::env::var_os("CI").is_some_and(|value| !value.is_empty());
        if self.beside {
            self.folder()
        } else if crate::package::overlay().is_some() {
            // In what a CI run leaves, too, they aren't found among those that may be accepted.
            build_output().join("karat").join(OVERLAID)
        } else if ci {
            build_output().join("karat/pending")
        } else {
            self.folder()
        }
    }

    pub(super) fn write_pending(
        &self,
        case: &str,
        frame: &Rendered<'_>,
        against: &Against,
    ) -> Result<String, ImageError> {
        let precision = against.precision;
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
            relative: relative(frame.tolerance),
            adapter: frame.adapter.clone(),
            processor: processor(),
            compared_with: against.hash.clone(),
            compared_profile: against.profile.clone(),
            exposures: None,
            accepted_by: String::new(),
            accepted_at: String::new(),
            because: String::new(),
        };
        let path = self.pending_folder().join(format!("{case}.new.exr"));
        let metadata = serde_json::to_string(&provenance).expect("provenance is plain data");
        stored.write_exr(&path, precision, Some(&metadata))?;
        if let Some(variance) = frame.variance {
            super::variance::write(&path, variance)?;
        }
        Ok(shown(&path))
    }

    pub(super) fn remove_pending(&self, case: &str) {
        // A frame that agrees again has nothing to review. That there was none is no error.
        let path = self.pending_folder().join(format!("{case}.new.exr"));
        drop(std::fs::remove_file(super::variance::file(&path)));
        drop(std::fs::remove_file(path));
    }

    /// All pending frames of a folder, by name.
    ///
    /// # Errors
    /// If a pending file can't be read, or isn't Karat's.
    pub fn pending(&self) -> Result<Vec<Pending>, AcceptError> {
        let mut found = Vec::new();
        // The folder's name is no pattern, whatever it holds.
        let folder = glob::Pattern::escape(&self.folder().to_string_lossy());
        let pattern = Path::new(&folder).join("**/*.new.exr");
        let files = glob::glob(&pattern.to_string_lossy()).into_iter().flatten();
        let overlaid = |path: &PathBuf| {
            let below = path.strip_prefix(self.folder()).unwrap_or(path);
            below.iter().any(|part| part == OVERLAID)
        };
        for path in files.filter_map(Result::ok).filter(|path| !overlaid(path)) {
            let (_, metadata) = Image::read_exr(&path)?;
            let provenance: Provenance = metadata
                .and_then(|metadata| serde_json::from_str(&metadata).ok())
                .ok_or_else(|| AcceptError::Foreign(shown(&path)))?;
            // Its name becomes a file's.
            let case = &provenance.case;
            let own = path.to_string_lossy().replace('\\', "/");
            if !super::is_name(case) || !own.ends_with(&format!("/{case}.new.exr")) {
                let (path, case) = (shown(&path), case.clone());
                return Err(AcceptError::Misplaced { path, case });
            }
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

    /// Deletes a pending frame.
    ///
    /// # Errors
    /// If the file can't be deleted.
    pub fn reject(&self, pending: &Pending) -> Result<(), AcceptError> {
        // Most have no variance.
        drop(std::fs::remove_file(super::variance::file(&pending.path)));
        std::fs::remove_file(&pending.path).map_err(|source| {
            AcceptError::Image(ImageError::Write { path: shown(&pending.path), source })
        })
    }
}

/// How a tolerance is kept with a golden.
fn relative(tolerance: Option<&FrameTolerance>) -> String {
    let standard = FrameTolerance::default();
    match tolerance.unwrap_or(&standard) {
        FrameTolerance::Gate(gate) if gate.absolute.is_none() => format!("{:e}", gate.relative),
        tree => tree.to_string(),
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
