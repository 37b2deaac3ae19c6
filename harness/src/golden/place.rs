//! The folders and files of goldens and of pending frames.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use super::Goldens;
use crate::diagnostic::shown;
use crate::image::remove_leftover;
use crate::package::LinkedModule;

/// The folder of frames that were rendered under an overlay. An overlay (`KARAT_OVERLAY`) is a folder of files that
/// replace modules of the package. No golden's name contains `@`, so no golden can have the name of this folder.
pub(super) const OVERLAID: &str = "@overlay";

impl Goldens {
    /// The folder into which tests write pending frames: usually the folder of goldens. In CI, pending frames go into
    /// build output, because nothing may change the sources there. Frames under an overlay go into build output, too,
    /// because you must not accept these frames. In build output, each folder of goldens has its own pending folder.
    pub(super) fn pending_folder(&self) -> PathBuf {
        if self.beside {
            self.folder()
        } else if crate::settings::overlay().is_some() {
            // This folder is outside of `pending`, so that `karat accept --from` doesn't find these frames in
            // CI's output.
            output().join(OVERLAID).join(self.key())
        } else if in_ci() {
            output().join("pending").join(self.key())
        } else {
            self.folder()
        }
    }

    /// The folder's path from the project's root, with `/` as separator. This path is the same on all machines. It is
    /// empty if the folder is in no project.
    pub(crate) fn key(&self) -> String {
        let Some(folder) = resolved(&self.folder()) else { return String::new() };
        let below = root(&folder).and_then(|root| folder.strip_prefix(root).ok());
        below.map_or_else(String::new, with_slashes)
    }

    /// The name of the Cargo package that contains the folder, from the nearest `Cargo.toml` with a `[package]`. The
    /// name is empty if there is no such `Cargo.toml`. The folder of goldens needn't exist yet.
    ///
    /// ```
    /// let goldens = karat::goldens!("golden");
    /// assert_eq!(goldens.cargo_package(), env!("CARGO_PKG_NAME"));
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn cargo_package(&self) -> String {
        let Some(folder) = resolved(&self.folder()) else { return String::new() };
        let name = |folder: &Path| {
            let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).ok()?;
            let manifest: toml::Table = manifest.parse().ok()?;
            Some(manifest.get("package")?.get("name")?.as_str()?.to_owned())
        };
        folder.ancestors().find_map(name).unwrap_or_default()
    }

    /// The root of the project that contains the goldens: the folder with the `Cargo.lock`, or if there is no
    /// `Cargo.lock`, the root of the repository. `None` if there is no such root. The folder of goldens needn't exist
    /// yet.
    ///
    /// ```
    /// use karat::Goldens;
    ///
    /// // This package's own lock file, or that of its workspace, says where the project is.
    /// let goldens = Goldens::open(env!("CARGO_MANIFEST_DIR").as_ref());
    /// assert!(goldens.project().is_some_and(|project| goldens.folder().starts_with(project)));
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn project(&self) -> Option<PathBuf> {
        root(&resolved(&self.folder())?).map(Path::to_path_buf)
    }

    /// Hashes of modules, by the paths of their files from the project's root. The key of a module outside of the
    /// project is the module's name. These keys are the same on all machines.
    pub(super) fn module_hashes(&self, modules: &[LinkedModule]) -> BTreeMap<String, String> {
        let project = self.project();
        let name = |module: &LinkedModule| {
            let file = module.file.as_ref().and_then(|file| file.canonicalize().ok());
            let below = file.as_deref().and_then(|file| file.strip_prefix(project.as_ref()?).ok());
            below.map_or_else(|| module.name.clone(), with_slashes)
        };
        modules.iter().map(|module| (name(module), module.hash.clone())).collect()
    }

    /// Checks if commands such as `karat accept` find the folder without an argument. Commands look for a folder
    /// `golden` in Cargo packages and in the working directory.
    fn is_usual(&self) -> bool {
        let folder = self.folder();
        let Some(folder) = resolved(&folder) else { return false };
        let here = std::env::current_dir().ok().and_then(|here| here.canonicalize().ok());
        let above = folder.parent();
        folder.ends_with("golden")
            && above.is_some_and(|above| {
                above.join("Cargo.toml").is_file() || here.as_deref() == Some(above)
            })
    }

    /// Removes temporary files from the folder and its subfolders. Tests and `karat accept` leave such files if they
    /// are killed. Files of running processes stay.
    ///
    /// ```no_run
    /// karat::Goldens::open("golden".as_ref()).tidy();
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn tidy(&self) {
        tidy(&self.folder());
    }

    /// The arguments that tell `karat accept` and other commands where pending frames and goldens are: ` --from
    /// target/karat --goldens golden`. Empty if both are in the usual folder.
    pub(super) fn arguments(&self) -> String {
        if self.beside {
            return String::new();
        }
        let golden = match self.is_usual() {
            true => String::new(),
            false => format!(" --goldens {}", shown(&self.folder())),
        };
        if !in_ci() {
            return golden;
        }
        let output = output();
        if HOSTED.get().is_some() {
            return format!(" --from {}{golden}", shown(&output));
        }
        let root = self.project();
        let below = root.as_ref().and_then(|root| output.strip_prefix(root).ok());
        let output = below.unwrap_or(&output);
        let output = output.display().to_string().replace('\\', "/");
        match self.key() {
            key if key.is_empty() => format!(" --from {output}{golden}"),
            key => format!(" --from {output} --goldens {key}"),
        }
    }
}

static HOSTED: OnceLock<PathBuf> = OnceLock::new();

/// Sets this program's output folder. Only the first call has an effect.
pub(crate) fn leave_in(folder: PathBuf) {
    drop(HOSTED.set(folder));
}

pub(crate) fn output() -> PathBuf {
    HOSTED.get().cloned().unwrap_or_else(|| build_output().join("karat"))
}

fn tidy(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        // A link may lead to any folder, so Karat doesn't follow links to folders.
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            tidy(&entry.path());
        } else {
            remove_leftover(&entry.path());
        }
    }
}

/// Checks if this is a CI run: `CI` is set, and its value isn't empty, `false` or `0`.
///
/// ```
/// if karat::unstable::golden::in_ci() {
///     println!("the folder of goldens stays as it is");
/// }
/// ```
#[must_use]
pub fn in_ci() -> bool {
    let value = std::env::var_os("CI").unwrap_or_default();
    !["", "0", "false"].iter().any(|no| value.eq_ignore_ascii_case(no))
}

fn with_slashes(path: &Path) -> String {
    path.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/")
}

/// A folder's absolute path, in which each link is replaced by the folder to which the link leads. The folder needn't
/// exist: a package has no golden folder before its first golden.
fn resolved(folder: &Path) -> Option<PathBuf> {
    let folder = std::path::absolute(folder).ok()?;
    let whole = |above: &Path| {
        let rest = folder.strip_prefix(above).ok()?;
        Some(above.canonicalize().ok()?.components().chain(rest.components()).collect())
    };
    folder.ancestors().find_map(whole)
}

pub(super) fn root(folder: &Path) -> Option<&Path> {
    let with = |name: &str| folder.ancestors().find(|above| above.join(name).exists());
    with("Cargo.lock").or_else(|| with(".git"))
}

/// Cargo's target folder. Karat recognises the folder by its file `CACHEDIR.TAG`. A folder that existed before Cargo
/// used it may lack this file. If `CACHEDIR.TAG` is missing, Karat uses the parent of the Cargo profile's folder
/// (`debug` or `release`). If Cargo didn't build the test, the path is empty, which means the working directory.
///
/// ```
/// let leftovers = karat::unstable::golden::build_output().join("karat");
/// println!("frames may wait in {}", leftovers.display());
/// ```
pub fn build_output() -> PathBuf {
    let exe = std::env::current_exe().unwrap_or_default();
    let marked = exe.ancestors().find(|folder| folder.join("CACHEDIR.TAG").is_file());
    let profile = || exe.ancestors().find(|folder| folder.join("deps").is_dir());
    marked.or_else(|| profile()?.parent()).map_or_else(PathBuf::new, Path::to_path_buf)
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 179
    #[test]
    fn folders_are_named_from_the_root() {
        let project = tempfile::tempdir().expect("a temporary folder");
        let golden = project.path().join("crates/a/golden");
        std::fs::create_dir_all(&golden).expect("a folder");
        let key = || Goldens::open(&golden).key();
        assert_eq!(key(), "", "nobody says where the root is");
        std::fs::create_dir(project.path().join("crates/a/.git")).expect("a folder");
        assert_eq!(key(), "golden");
        std::fs::write(project.path().join("Cargo.lock"), "").expect("written");
        assert_eq!(key(), "crates/a/golden", "a lock file lies at the root of a workspace");
        let first = Goldens::open(&project.path().join("crates/b/golden"));
        assert_eq!(first.key(), "crates/b/golden", "a crate has no folder before its first golden");
    }

    // Lesson 179
    #[test]
    fn the_package_of_a_folder_is_the_nearest() {
        let project = tempfile::tempdir().expect("a temporary folder");
        let manifest = |file: &str, text: &str| {
            let file = project.path().join(file);
            std::fs::create_dir_all(file.parent().expect("a folder")).expect("a folder");
            std::fs::write(file, text).expect("written");
        };
        manifest("Cargo.toml", "[package]\nname = \"all\"\n[workspace]\nmembers = [\"a\"]\n");
        manifest("a/Cargo.toml", "[package]\nname = \"one\"\n");
        let of = |folder: &str| Goldens::open(&project.path().join(folder)).cargo_package();
        assert_eq!([of("a/tests/golden"), of("golden")], ["one", "all"]);
        manifest("a/Cargo.toml", "[workspace]\n");
        assert_eq!(of("a/golden"), "all", "a workspace alone is no package");
    }
}
