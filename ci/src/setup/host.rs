//! The machine that setup examines: environment variables, folders and shared libraries.
//!
//! The files of a machine are below a root folder: `/`, or a temporary folder in which a test simulates a machine.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A machine, real or simulated by a test.
pub(crate) struct Host {
    root: PathBuf,
    variables: BTreeMap<OsString, OsString>,
    /// The output of `ldconfig -p`. This output includes libraries in folders that only `/etc/ld.so.conf.d` names.
    ldconfig: String,
}

impl Host {
    /// Returns the machine that this program runs on.
    pub(crate) fn current() -> Self {
        // Debian keeps /sbin out of the PATH of ordinary users.
        let ldconfig = ["ldconfig", "/sbin/ldconfig"].into_iter().find_map(|program| {
            let output = Command::new(program).arg("-p").output().ok()?;
            output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
        });
        Self {
            root: PathBuf::from("/"),
            variables: std::env::vars_os().collect(),
            // musl has no `ldconfig`. The usual folders are searched anyway.
            ldconfig: ldconfig.unwrap_or_default(),
        }
    }

    /// Returns the path of this machine's file `absolute`, below the root folder.
    pub(crate) fn path(&self, absolute: impl AsRef<Path>) -> PathBuf {
        let absolute = absolute.as_ref();
        self.root.join(absolute.strip_prefix("/").unwrap_or(absolute))
    }

    /// Returns the folders or files that an environment variable lists, or `None` if the variable is unset or empty.
    pub(crate) fn listed(&self, variable: &str) -> Option<Vec<PathBuf>> {
        let value = self.variables.get(&OsString::from(variable))?;
        let paths: Vec<PathBuf> = std::env::split_paths(value)
            .filter(|path| !path.as_os_str().is_empty())
            .map(|path| self.path(path))
            .collect();
        (!paths.is_empty()).then_some(paths)
    }

    /// Returns the path of `name` in each data folder: first in XDG's folders, then in the system's folders.
    pub(crate) fn data_folders(&self, name: &str) -> Vec<PathBuf> {
        let home = self.listed("XDG_DATA_HOME").or_else(|| {
            let homes = self.listed("HOME")?;
            Some(homes.into_iter().map(|home| home.join(".local/share")).collect())
        });
        let system = ["/etc", "/usr/local/share", "/usr/share", "/run/opengl-driver/share"];
        home.into_iter()
            .chain(self.listed("XDG_DATA_DIRS"))
            .flatten()
            .chain(system.into_iter().map(|folder| self.path(folder)))
            .map(|folder| folder.join(name))
            .collect()
    }

    /// Returns the folders that the dynamic linker is likely to search.
    pub(crate) fn library_folders(&self) -> Vec<PathBuf> {
        let multiarch = format!("{}-linux-gnu", std::env::consts::ARCH);
        let system = [
            format!("/usr/lib/{multiarch}"),
            format!("/lib/{multiarch}"),
            "/usr/lib64".to_owned(),
            "/lib64".to_owned(),
            "/usr/lib".to_owned(),
            "/lib".to_owned(),
            "/usr/local/lib".to_owned(),
            "/run/opengl-driver/lib".to_owned(),
        ];
        let listed = self.listed("LD_LIBRARY_PATH").unwrap_or_default();
        listed.into_iter().chain(system.iter().map(|folder| self.path(folder))).collect()
    }

    /// Finds the file of a shared library by its name, such as `libEGL.so.1`, as the dynamic linker would.
    pub(crate) fn library(&self, name: &str) -> Option<PathBuf> {
        let cached = cached_libraries(&self.ldconfig, name, std::env::consts::ARCH);
        let usual = self.library_folders().into_iter().map(|folder| folder.join(name));
        cached.map(|path| self.path(path)).chain(usual).find(|path| path.is_file())
    }

    /// Checks if there is a GPU that a hardware driver could open. An installed driver doesn't prove that there is a
    /// GPU, because distributions install the drivers of all GPU makers.
    pub(crate) fn has_gpu(&self) -> bool {
        let nodes = ["/dev/nvidiactl", "/dev/dxg", "/dev/kgsl-3d0", "/dev/mali0"];
        nodes.iter().any(|node| self.path(node).exists())
            || files(&self.path("/dev/dri")).iter().any(|node| name(node).starts_with("renderD"))
    }
}

/// Returns the entries of a folder, sorted by name, or no entries if the folder can't be read.
pub(crate) fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.sort();
    files
}

/// Returns the file name in a path, or an empty text.
pub(crate) fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Returns the paths that the output of `ldconfig -p` has for a library and an architecture.
fn cached_libraries<'a>(
    ldconfig: &'a str,
    name: &'a str,
    architecture: &'a str,
) -> impl Iterator<Item = &'a str> {
    // The line has the form `\tlibEGL.so.1 (libc6,x86-64) => /lib/x86_64-linux-gnu/libEGL.so.1`. An entry for 32 bits
    // has another tag or no tag.
    let tag = match architecture {
        "x86_64" => "x86-64",
        "aarch64" => "AArch64",
        _ => "",
    };
    ldconfig.lines().filter_map(move |line| {
        let (entry, path) = line.split_once(" => ")?;
        let (library, kind) = entry.trim().split_once(' ')?;
        (library == name && kind.contains(tag)).then_some(path)
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A simulated machine in a temporary folder, with only the files that the test adds.
    pub(crate) struct Machine {
        folder: tempfile::TempDir,
        variables: BTreeMap<OsString, OsString>,
    }

    impl Machine {
        pub(crate) fn new() -> Self {
            let folder = tempfile::tempdir().expect("a temporary folder can be made");
            Self { folder, variables: BTreeMap::new() }
        }

        pub(crate) fn file(self, path: &str, text: &str) -> Self {
            let path = self.folder.path().join(path.trim_start_matches('/'));
            std::fs::create_dir_all(path.parent().expect("it is below the folder"))
                .expect("folders can be made");
            std::fs::write(path, text).expect("files can be written");
            self
        }

        /// Adds a driver's manifest for the Vulkan loader or GLVND.
        pub(crate) fn manifest(self, path: &str, library: &str) -> Self {
            self.file(path, &format!(r#"{{ "ICD": {{ "library_path": "{library}" }} }}"#))
        }

        pub(crate) fn variable(mut self, name: &str, value: &str) -> Self {
            self.variables.insert(name.into(), value.into());
            self
        }

        pub(crate) fn host(&self) -> Host {
            Host {
                root: self.folder.path().to_owned(),
                variables: self.variables.clone(),
                ldconfig: String::new(),
            }
        }
    }

    #[test]
    fn cache_lines_of_another_architecture_are_skipped() {
        let cache = "2 libs found in cache `/etc/ld.so.cache'\n\
            \tlibEGL.so.1 (libc6) => /lib/i386-linux-gnu/libEGL.so.1\n\
            \tlibEGL.so.1 (libc6,x86-64) => /lib/x86_64-linux-gnu/libEGL.so.1\n";
        let found: Vec<&str> = cached_libraries(cache, "libEGL.so.1", "x86_64").collect();
        assert_eq!(found, ["/lib/x86_64-linux-gnu/libEGL.so.1"]);
        assert_eq!(cached_libraries(cache, "libEGL.so", "x86_64").count(), 0);
    }

    #[test]
    fn libraries_are_found_in_usual_and_in_listed_folders() {
        let machine = Machine::new()
            .file("/usr/lib/libusual.so.1", "")
            .file("/opt/mesa/liblisted.so.1", "")
            .variable("LD_LIBRARY_PATH", "/opt/mesa");
        let host = machine.host();
        assert!(host.library("libusual.so.1").is_some());
        assert!(host.library("liblisted.so.1").is_some());
        assert!(host.library("libother.so.1").is_none());
    }

    #[test]
    fn unset_and_empty_variables_list_nothing() {
        let host = Machine::new().variable("HOME", "").host();
        assert_eq!(host.listed("HOME"), None);
        assert_eq!(host.listed("XDG_DATA_HOME"), None);
        assert!(
            host.data_folders("vulkan/icd.d").iter().all(|folder| folder.starts_with(&host.root))
        );
    }
}
