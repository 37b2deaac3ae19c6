//! Acceptance of a pending frame. Only this module writes goldens.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::content::{Content, is_table};
use super::lock::lock;
use super::table::TableError;
use super::{Goldens, Pending, Profile, Provenance, ProvenanceError};
use crate::diagnostic::shown;
use crate::image::{ImageError, Staged};
use crate::lines;
use crate::output::visible;

/// A size in bytes. If an accepted golden is larger, Karat warns, because every clone of the project keeps every
/// version of the golden for ever.
const LARGE: u64 = 128 << 10;
/// The largest size in bytes of a golden that Karat accepts.
const TOO_LARGE: u64 = 1 << 20;
/// A width and a height in pixels. Accepting a frame that is wider or higher gives a warning, because smaller frames
/// usually suffice.
const WIDE: (u32, u32) = (640, 360);

/// The decision to accept a pending frame.
#[derive(Clone, Debug, Default)]
pub struct Acceptance {
    /// The reason why the new image is right.
    pub because: String,
    /// Name of the person who accepts. `None` selects Git's `user.name`, or else the login name.
    pub by: Option<String>,
    /// Allows a frame from an adapter other than lavapipe.
    pub any_adapter: bool,
    /// The profile that gets the frame as its own golden. The frame must come from this profile, and must fail with the
    /// golden for all profiles. `None` makes the frame the golden for all profiles.
    pub profile: Option<String>,
    /// Allows writing a golden although `CI` is set. Otherwise Karat writes no golden in CI.
    pub ci_may_write: bool,
}

/// The result of accepting a pending frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Accepted {
    /// The golden's file.
    pub golden: PathBuf,
    /// `true` if Karat wrote the golden, `false` if the golden already has the frame's pixels and provenance.
    pub written: bool,
    /// Warnings for a reviewer.
    pub warnings: Vec<String>,
}

/// The reason why Karat doesn't accept a pending frame.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AcceptError {
    /// No pending frame has this name.
    #[error("`{case}` isn't pending{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    NotPending {
        /// The name that you gave, for example to `karat accept`.
        case: String,
        /// The pending frame with the most similar name.
        nearest: Option<String>,
    },
    /// No reason was given.
    #[error("accepting `{0}` needs a reason that a reviewer can check: add --because \"...\"")]
    NoReason(String),
    /// `CI` is set, so Karat writes no golden.
    #[error(
        "`{0}` isn't accepted: `CI` is set, and Karat writes nothing into your sources in CI; accept the golden on your own \
         machine, with --from and the downloaded artefact of this run, or pass --ci-may-write"
    )]
    InCi(String),
    /// An adapter other than lavapipe rendered the frame. Goldens come from lavapipe.
    #[error(
        "`{case}` was rendered on {adapter}; goldens are made on lavapipe (path vulkan), so that \
         any machine can check them: render the frame on lavapipe, or pass --any-adapter"
    )]
    Adapter {
        /// The golden's name.
        case: String,
        /// The adapter that rendered the frame.
        adapter: String,
    },
    /// The frame has NaN or infinite pixels. If this frame became the golden, no frame could agree with it.
    #[error(
        "`{0}` has NaN or infinite pixels, and no frame could agree with such a golden: fix the shader"
    )]
    NonFinite(String),
    /// The golden has changed since Karat compared the frame with the golden.
    #[error(
        "the golden of `{0}` has changed since the pending frame was rendered; run the test again"
    )]
    Stale(String),
    /// The hash in the file's metadata differs from the hash of the file's pixels.
    #[error(
        "the pixels of the pending frame of `{0}` don't match the hash in its file, so the file was changed \
         later; run the test again"
    )]
    Altered(String),
    /// Two files have the same frame name in their metadata.
    #[error(
        "frame `{case}` is pending twice, as `{first}` and as `{second}`: delete one file, or accept one \
         CI job's artefact at a time"
    )]
    Twice {
        /// The golden's name.
        case: String,
        /// One of the files.
        first: String,
        /// The other file.
        second: String,
    },
    /// A file's metadata can't be used.
    #[error("`{path}` can't be used: {cause}")]
    Provenance {
        /// The file.
        path: String,
        /// The reason.
        cause: ProvenanceError,
    },
    /// The frame belongs to another folder of goldens.
    #[error("`{case}` was compared with the goldens in `{folder}`: pass --goldens {folder}")]
    Elsewhere {
        /// The golden's name.
        case: String,
        /// The folder to which the frame belongs, as a path from the project's root.
        folder: String,
    },
    /// The frame's metadata names a folder that isn't in this project.
    #[error(
        "the file of `{case}` says that its goldens are in `{folder}`, which isn't a folder of this project: name the \
         folder with --goldens DIR"
    )]
    Nowhere {
        /// The golden's name.
        case: String,
        /// The folder that the frame's metadata names.
        folder: String,
    },
    /// The path of a pending file contradicts the name in its metadata.
    #[error(
        "the metadata of `{path}` says that the file is frame `{case}`, but the path names another frame; delete the file and run its test again"
    )]
    Misplaced {
        /// The file.
        path: String,
        /// The frame's name in the file's metadata.
        case: String,
    },
    /// The acceptance names a profile that didn't draw the frame.
    #[error("`{case}` was rendered on profile {found}, and can't be the golden of profile {asked}")]
    Profile {
        /// The golden's name.
        case: String,
        /// The frame's profile.
        found: Profile,
        /// The profile that the acceptance names.
        asked: String,
    },
    /// The acceptance names no profile, but Karat compared the frame with its profile's own golden.
    #[error(
        "`{case}` was compared with the golden of profile {profile}; accept the frame for this profile with \
         --profile {profile}"
    )]
    Own {
        /// The golden's name.
        case: String,
        /// The profile.
        profile: String,
    },
    /// The profile needs no golden of its own: the frame passes with the golden for all profiles, or that golden
    /// doesn't exist yet.
    #[error(
        "`{case}` needs no golden for profile {profile}: {}",
        if *missing {
            "no golden applies to all profiles yet; first accept the frame without --profile"
        } else {
            "the frame passes with the golden that applies to all profiles"
        }
    )]
    Needless {
        /// The golden's name.
        case: String,
        /// The profile.
        profile: Profile,
        /// `true` if the golden for all profiles doesn't exist yet.
        missing: bool,
    },
    /// The golden's file would be too large.
    #[error(
        "the golden of `{case}` would be {} KiB, and Karat accepts at most {} KiB: draw fewer pixels, \
         keep fewer rows, or reduce noise",
        bytes >> 10,
        TOO_LARGE >> 10
    )]
    TooLarge {
        /// The golden's name.
        case: String,
        /// Size of the file in bytes.
        bytes: u64,
    },
    /// The acceptance names a profile, but the pending file contains values instead of a frame. Values have one golden
    /// for all profiles.
    #[error(
        "the values `{0}` have one golden for all profiles: instead of --profile, give a path its own tolerance in the test (`.tolerance_on(...)`)"
    )]
    OneForAll(String),
    /// A table can't be read.
    #[error(transparent)]
    Table(#[from] TableError),
    /// A file can't be read or written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The pending file has no provenance, so Karat didn't write the file.
    #[error("`{0}` has no provenance, so Karat didn't write this file")]
    Foreign(String),
}

impl Goldens {
    /// Makes a pending frame the golden.
    ///
    /// # Errors
    /// - If the acceptance gives no reason.
    /// - If `CI` is set and [`ci_may_write`](Acceptance::ci_may_write) is false.
    /// - If the golden changed after the comparison of the frame.
    /// - If an adapter other than lavapipe rendered the frame, and the acceptance doesn't allow other adapters.
    /// - If the acceptance names a profile that doesn't need its own golden.
    /// - If the file is too large or can't be written.
    ///
    /// After an error, the golden is unchanged.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn accept(
        &self,
        pending: &Pending,
        acceptance: &Acceptance,
    ) -> Result<Accepted, AcceptError> {
        let (case, because) = (pending.case.clone(), acceptance.because.trim());
        if because.is_empty() {
            return Err(AcceptError::NoReason(case));
        }
        if super::in_ci() && !self.beside && !acceptance.ci_may_write {
            return Err(AcceptError::InCi(case));
        }
        if !pending.is_of(self) {
            let folder = pending.provenance.folder.clone();
            return Err(AcceptError::Elsewhere { case, folder });
        }
        // The lock keeps other processes from replacing the golden between the check and the write.
        let _lock = lock(&self.folder())?;
        self.tidy();
        let (content, _) = match Content::read(&pending.path) {
            // Another process accepted or rejected the frame while this one waited.
            Err(AcceptError::Image(ImageError::Missing { .. })) => {
                return Err(AcceptError::NotPending { case, nearest: None });
            }
            read => read?,
        };
        if content.hash() != pending.provenance.pixels {
            return Err(AcceptError::Altered(case));
        }
        let path = match &acceptance.profile {
            None => {
                let profile = pending.provenance.compared_profile.clone();
                if !profile.is_empty() {
                    return Err(AcceptError::Own { case, profile });
                }
                if !pending.is_canonical() && !acceptance.any_adapter {
                    let adapter = pending.provenance.adapter.to_string();
                    return Err(AcceptError::Adapter { case, adapter });
                }
                if pending.is_table() { self.values(&case) } else { self.golden(&case) }
            }
            Some(_) if pending.is_table() => return Err(AcceptError::OneForAll(case)),
            Some(profile) => self.needed(pending, profile)?,
        };
        if content.non_finite() {
            return Err(AcceptError::NonFinite(case));
        }
        let provenance = Provenance {
            folder: String::new(),
            cargo_package: String::new(),
            compared_with: String::new(),
            compared_profile: String::new(),
            finding: None,
            exposures: content.exposures(),
            // Provenance with control characters can't be read again.
            accepted_by: visible(&acceptance.by.clone().unwrap_or_else(person)).into_owned(),
            accepted_at: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            because: visible(because).into_owned(),
            ..pending.provenance.clone()
        };
        let accepted = if is_there(&path, &content, &provenance) {
            // An interrupted acceptance may have written this golden without removing the pending frame. Then the
            // golden may differ from the golden of the comparison.
            let warnings = vec![format!(
                "the golden `{}` already has the accepted content and provenance",
                shown(&path)
            )];
            Accepted { golden: path, written: false, warnings }
        } else {
            self.unchanged(pending, &path)?;
            write_golden(&path, content, &provenance)?
        };
        self.remove(pending)?;
        Ok(accepted)
    }

    /// Fails if the golden has changed since Karat compared the frame with the golden. `written` is the file that
    /// the acceptance will write. Also fails if `written` is the profile's own golden, and this file was created after
    /// the comparison.
    fn unchanged(&self, pending: &Pending, written: &Path) -> Result<(), AcceptError> {
        let known = &pending.provenance;
        let own = self.golden_of(&pending.case, &pending.profile());
        if written == own && known.compared_profile.is_empty() && own.exists() {
            return Err(AcceptError::Stale(pending.case.clone()));
        }
        let current = match Content::read(&self.compared(pending)) {
            Ok((golden, _)) => golden.hash(),
            Err(AcceptError::Image(ImageError::Missing { .. })) => String::new(),
            // Accepting may replace a damaged golden, because its content is lost already. A golden that Git LFS
            // hasn't fetched isn't lost.
            Err(
                AcceptError::Image(ImageError::Corrupt { .. })
                | AcceptError::Provenance { .. }
                | AcceptError::Table(_),
            ) => known.compared_with.clone(),
            Err(error) => return Err(error),
        };
        if current == known.compared_with {
            Ok(())
        } else {
            Err(AcceptError::Stale(pending.case.clone()))
        }
    }

    /// Returns the path of the golden that only the profile `asked` uses. Fails if the frame comes from another
    /// profile, or passes with the golden for all profiles.
    fn needed(&self, pending: &Pending, asked: &str) -> Result<PathBuf, AcceptError> {
        let (case, known) = (pending.case.clone(), &pending.provenance);
        let profile = pending.profile();
        if profile.to_string() != asked {
            return Err(AcceptError::Profile { case, found: profile, asked: asked.to_owned() });
        }
        let needless = |missing| Err(AcceptError::Needless { case, profile, missing });
        if !self.golden(&pending.case).is_file() {
            return needless(true);
        }
        // Only the test knows its tolerance. So the finding that the test stored decides.
        if known.finding.as_ref().is_some_and(|finding| finding.base_passes) {
            return needless(false);
        }
        Ok(self.golden_of(&pending.case, &pending.profile()))
    }
}

/// Writes a golden and its provenance: a frame's two files (both or neither), or a table's single file.
fn write_golden(
    path: &Path,
    content: Content,
    provenance: &Provenance,
) -> Result<Accepted, AcceptError> {
    let bytes = content.bytes(path, provenance)?;
    let size = bytes.len() as u64;
    if size > TOO_LARGE {
        return Err(AcceptError::TooLarge { case: provenance.case.clone(), bytes: size });
    }
    let failed = |path: &Path, cause| ImageError::Write { path: shown(path), cause };
    let facts = (!is_table(path))
        .then(|| toml::to_string(provenance).expect("provenance is plain data").into_bytes());
    let sidecar = path.with_extension("toml");
    let before = match std::fs::read(&sidecar) {
        Ok(before) => Some(before),
        Err(error) if error.kind() == ErrorKind::NotFound => None,
        Err(cause) => return Err(ImageError::Read { path: shown(&sidecar), cause }.into()),
    };
    // Both temporary files are complete before Karat renames the first one.
    let facts = facts.map(|facts| Staged::new(&sidecar, &facts)).transpose();
    let facts = facts.map_err(|error| failed(&sidecar, error))?;
    let golden = Staged::new(path, &bytes).map_err(|error| failed(path, error))?;
    let beside = facts.is_some();
    facts.map_or(Ok(()), Staged::commit).map_err(|error| failed(&sidecar, error))?;
    if let Err(error) = golden.commit() {
        // The function reports the first error and ignores errors of the cleanup.
        drop(match before {
            _ if !beside => Ok(()),
            Some(before) => crate::image::write_whole(&sidecar, &before),
            None => std::fs::remove_file(&sidecar),
        });
        return Err(failed(path, error).into());
    }
    let warnings = warnings(path, size, provenance);
    Ok(Accepted { golden: path.to_owned(), written: true, warnings })
}

/// Checks if the golden already has this content and this provenance. The provenance of a frame's golden is in two
/// files, and both must agree.
fn is_there(path: &Path, content: &Content, provenance: &Provenance) -> bool {
    let decision_aside = |known: &Provenance| {
        let (accepted_by, accepted_at, because) = Default::default();
        Provenance { accepted_by, accepted_at, because, ..known.clone() }
    };
    let Ok((golden, Some(known))) = Content::read(path) else { return false };
    let beside = || {
        let text = std::fs::read_to_string(path.with_extension("toml")).ok()?;
        toml::from_str::<Provenance>(&text).ok()
    };
    (is_table(path) || beside().as_ref() == Some(&known))
        && decision_aside(&known) == decision_aside(provenance)
        && golden.is(content)
}

fn warnings(path: &Path, bytes: u64, provenance: &Provenance) -> Vec<String> {
    let mut warnings = Vec::new();
    if bytes > LARGE {
        let (size, limit) = (bytes >> 10, LARGE >> 10);
        warnings.push(format!(
            "`{}` is {size} KiB; consider a smaller frame, below {limit} KiB",
            shown(path)
        ));
    }
    let Provenance { width, height, .. } = *provenance;
    if provenance.table.is_none() && (width > WIDE.0 || height > WIDE.1) {
        warnings.push(format!(
            "`{}` has {width} x {height} pixels; a frame of {} x {} pixels shows most faults",
            shown(path),
            WIDE.0,
            WIDE.1
        ));
    }
    warnings
}

fn person() -> String {
    let mut git = std::process::Command::new("git");
    let git = lines::output(git.args(["config", "user.name"]), lines::LOOK_UP, u64::MAX);
    let name = git.ok().map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    name.filter(|name| !name.is_empty())
        .or_else(|| std::env::var("USER").or_else(|_| std::env::var("USERNAME")).ok())
        .unwrap_or_else(|| "unknown".to_owned())
}
