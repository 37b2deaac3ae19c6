//! The search for packages, and for their files with tests. Each command that runs, validates or lists shaders uses
//! this search.
//!
//! - If `--shaders`, `--crate` or a command's folder names a package, this is the only package.
//! - `metadata.karat.packages` of a Cargo.toml lists the packages in its folder and below. The workspace's list applies
//!   to all members, and a member's list applies only to this member.
//! - Without such a list, the packages are the folders `shaders` beside the Cargo.toml of the workspace and of its
//!   members, and the folders that recorded tests used.
//! - Without Cargo and without a named folder, the package is the folder `shaders`, or otherwise the innermost folder
//!   with all modules and tests. If a named folder contains a `shaders` with a karat.toml and all modules, this
//!   `shaders` is the package.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use karat::Package;
use karat::package::PackageError;
use karat::unstable::diagnostic::shown;
use karat::unstable::output::counted;
use karat::unstable::package::is_of_tools;
use karat::unstable::record::{Record, Subject};
use karat_suite::{Broken, Suite};

use super::PackageArgs;
use super::project::{MANIFEST, Project};
use super::table::{HEAD, KNOWN};
use super::test::subjects::Subjects;

/// The name of the folder of shaders beside a manifest.
pub(super) const SHADERS: &str = "shaders";

#[derive(Clone, Debug)]
pub(super) struct Found {
    pub(super) package: Package,
    /// `true` if a manifest or an option declares the package. An undeclared package has no settings: Karat knows its
    /// features only from tests.
    pub(super) stated: bool,
}

impl Found {
    pub(super) fn stated(package: Package) -> Self {
        Self { package, stated: true }
    }

    /// Returns the path of the package, with links resolved.
    pub(super) fn place(&self) -> Option<PathBuf> {
        self.package.root().canonicalize().ok()
    }
}

impl Project {
    /// Returns all packages: the declared packages, those beside a manifest, and those that recorded tests used.
    pub(super) fn search(&self, args: &PackageArgs) -> anyhow::Result<Vec<Found>> {
        self.search_with(args, &self.recorded())
    }

    /// Does the work of [`search`](Self::search), given the folders and files that tests used.
    pub(super) fn search_with(
        &self,
        args: &PackageArgs,
        used: &BTreeSet<PathBuf>,
    ) -> anyhow::Result<Vec<Found>> {
        let hint = "name the shader folder with --shaders DIR";
        let mut found: Vec<Found> = Vec::new();
        if let Some(name) = &args.krate {
            let (of_others, own): (Vec<&String>, Vec<&String>) =
                args.roots.iter().partition(|root| root.contains('='));
            if let [first, second, ..] = *own {
                bail!(
                    "you gave `--root {first}` and `--root {second}`, but a crate can have only one folder of modules: remove one, or for another crate write --root NAME=DIR"
                );
            }
            let own = own.first().map(|root| root.as_str());
            let mut package = Package::open_crate(self.root(), name, own)?;
            for (krate, root) in of_others.iter().filter_map(|root| root.split_once('=')) {
                package = package.with_root_of(krate, root)?;
            }
            found.push(Found::stated(package));
        } else if let Some(folder) = &args.package {
            let is_toml = folder.is_file() && folder.extension().is_some_and(|end| end == "toml");
            ensure!(
                !is_toml,
                "the file `{}` has no shaders: name a folder of WGSL modules, or one module; only `karat test` accepts files of tests",
                folder.display()
            );
            found.push(Found::stated(Package::open(folder)?));
        } else if !self.is_cargo() {
            // The path is relative to the working directory, for messages and replays.
            let folder = shown(&stands_for(self.root())?);
            found.push(Found::stated(Package::open(folder).context(hint)?));
        } else {
            for folder in self.declared() {
                found.push(Found::stated(Package::open(&folder).context(hint)?));
            }
            let beside = self.manifests().map(|folder| folder.join(SHADERS));
            let beside = beside.filter(|folder| folder.is_dir());
            let used = used.iter().filter(|folder| self.is_own(folder)).cloned();
            for folder in beside.chain(used).filter(|folder| !self.says(folder)) {
                let Ok(package) = Package::open(&folder) else { continue };
                found.push(Found { package, stated: false });
            }
        }
        let mut places = BTreeSet::new();
        found.retain(|one| one.place().is_none_or(|place| places.insert(place)));
        // A folder `shaders` may contain shaders in another language.
        found.retain(|one| one.stated || !is_empty(&one.package));
        let packages = found.iter().map(|one| one.package.clone()).collect();
        let packages = self.with_features(packages);
        for (one, package) in found.iter_mut().zip(packages) {
            one.package = args.featured(package);
        }
        Ok(found)
    }

    /// Returns the packages of a command, at least one. If there is no package, returns an error.
    pub(super) fn packages(&self, args: &PackageArgs) -> anyhow::Result<Vec<Package>> {
        let found = self.found(args)?;
        Ok(found.into_iter().map(|one| one.package).collect())
    }

    /// Does the work of [`search`](Self::search), and returns an error if there is no package.
    pub(super) fn found(&self, args: &PackageArgs) -> anyhow::Result<Vec<Found>> {
        let found = self.search(args)?;
        if !found.is_empty() {
            return Ok(found);
        }
        let none = match self.lists_packages() {
            true => "the list of shader packages in `metadata.karat` is empty: add a package in Cargo.toml".to_owned(),
            false => format!(
                "there is no shader package: no Cargo.toml of the project names a package in `metadata.karat`, \
                 there is no folder `{SHADERS}` beside a Cargo.toml, and no recorded test used a package; name the shader \
                 folder with --shaders DIR, or run `karat test` first"
            ),
        };
        anyhow::bail!(none)
    }

    /// Returns the packages that these records mention, and the packages that Karat finds without records.
    pub(super) fn tested(&self, records: &[Record]) -> anyhow::Result<Vec<Package>> {
        let used = self.used_by(records, &[]);
        let found = self.search_with(&PackageArgs::default(), &used)?;
        Ok(found.into_iter().map(|one| one.package).collect())
    }

    /// Returns the package that contains a function. If no package has the function, returns the first package: the
    /// caller then reports that this package lacks the function.
    pub(super) fn package_of(&self, args: &PackageArgs, path: &str) -> anyhow::Result<Package> {
        let mut packages = self.packages(args)?;
        let holds = |package: &Package| {
            package.functions().is_ok_and(|known| known.iter().any(|item| item.name == path))
        };
        let index = packages.iter().position(holds).unwrap_or(0);
        Ok(packages.swap_remove(index))
    }

    /// Returns the folders and files of shaders that recorded tests used, or none if a manifest lists all packages.
    pub(super) fn recorded(&self) -> BTreeSet<PathBuf> {
        // If all packages are declared, no other folder is a package.
        if self.says(self.root()) {
            return BTreeSet::new();
        }
        let last = self.last_run();
        self.used_by(&last.map(|last| last.records).unwrap_or_default(), &[])
    }

    /// Returns the project's folders and files of shaders that tests used: in earlier runs, or according to `records`
    /// and `linked`.
    pub(super) fn used_by(&self, records: &[Record], linked: &[PathBuf]) -> BTreeSet<PathBuf> {
        let mut used = Subjects::read(&self.record()).packages().clone();
        used.extend(self.used_in(records, linked));
        used
    }

    /// Returns the folders and files that the tests of one run used.
    pub(super) fn used_in(&self, records: &[Record], linked: &[PathBuf]) -> BTreeSet<PathBuf> {
        let named = records.iter().filter_map(|record| match &record.subject {
            Subject::Function { package, .. } => Some(PathBuf::from(package)),
            Subject::Frame { .. } => None,
        });
        // Text in memory has no path, and the path `.` is relative to the folder of the tests.
        let all = named.chain(linked.iter().cloned());
        let all = all.filter(|place| !place.as_os_str().is_empty() && place != Path::new("."));
        let all = all.filter_map(|place| self.root().join(place).canonicalize().ok());
        all.filter(|place| self.is_own(place)).collect()
    }

    /// Checks if a path is in the project, and isn't output of runs.
    fn is_own(&self, place: &Path) -> bool {
        let (root, output) = (self.root().canonicalize(), self.output().canonicalize());
        root.is_ok_and(|root| place.starts_with(root))
            && output.map_or(true, |output| !place.starts_with(output))
    }
}

/// Checks if a folder has no module, no `karat.toml` and no file of tests.
fn is_empty(package: &Package) -> bool {
    let is_for_karat = |file: &PathBuf| file.ends_with(MANIFEST) || karat_suite::is_meant(file);
    matches!(package.modules(), Err(PackageError::Empty(_)))
        && !package.files_beside().unwrap_or_default().iter().any(is_for_karat)
}

/// Returns the folder of the package that Karat tests if the user names `folder`. If the subfolder `shaders` has a
/// karat.toml and all modules, this is `shaders`. Otherwise, it is `folder` itself.
pub(super) fn stands_for(folder: &Path) -> anyhow::Result<PathBuf> {
    let shaders = folder.join(SHADERS);
    let declares = |folder: &Path| folder.join(MANIFEST).is_file();
    let stands = declares(&shaders) && !declares(folder) && outside(folder)?.packages.is_empty();
    Ok(if stands { shaders } else { folder.to_owned() })
}

/// The packages and tests of a folder, without those in its subfolder `shaders`.
#[derive(Default)]
struct Outside {
    /// The packages outside of `shaders`: single modules, and folders with modules.
    packages: Vec<Package>,
    /// The files of tests that are beside no module.
    files: Vec<PathBuf>,
}

fn outside(folder: &Path) -> anyhow::Result<Outside> {
    let mut all = Outside::default();
    let unread = || format!("can't read `{}`", folder.display());
    for entry in std::fs::read_dir(folder).with_context(unread)? {
        let entry = entry.with_context(unread)?;
        let (path, name) = (entry.path(), entry.file_name());
        if name == SHADERS || name.to_string_lossy().starts_with('.') {
            continue;
        }
        let ending = path.extension().unwrap_or_default();
        match path.is_dir() {
            true if path.is_symlink() || is_of_tools(&path) => {}
            false if ending != "wgsl" && ending != "wesl" => {
                all.files.extend(Some(path).filter(|file| karat_suite::is_meant(file)));
            }
            _ => {
                let package = Package::open(&path)?;
                match package.modules() {
                    Ok(_) => all.packages.push(package),
                    Err(_) => {
                        let beside = package.files_beside().unwrap_or_default().into_iter();
                        all.files.extend(beside.filter(|file| karat_suite::is_meant(file)));
                    }
                }
            }
        }
    }
    // Tests beside a module belong to the module's package.
    let modules: Vec<PathBuf> = all.packages.iter().map(Package::root).collect();
    all.files.retain(|file| {
        let stem = file.file_name().unwrap_or_default().to_string_lossy();
        let stem = stem.split('.').next().unwrap_or_default();
        !modules.iter().any(|module| module.is_file() && module.file_stem() == Some(stem.as_ref()))
    });
    all.files.sort();
    Ok(all)
}

/// Lists the tests that don't run because Karat tests only the folder's `shaders`. The folder is `named`, or otherwise
/// the working directory. If the folder has a Cargo.toml, lists nothing.
pub(super) fn write_outside(named: Option<&Path>, out: &mut dyn Write) -> anyhow::Result<()> {
    let folder = named.unwrap_or(Path::new("."));
    let is_alone = match named {
        Some(folder) => folder.is_dir() && stands_for(folder)? != *folder,
        None => folder.join(SHADERS).is_dir(),
    };
    if !is_alone || folder.join("Cargo.toml").is_file() {
        return Ok(());
    }
    let Outside { packages, files } = outside(folder)?;
    let (mut beside, mut places) = (0, Vec::new());
    for package in packages {
        let place = shown(&package.root());
        let suite = Suite::of(package)?;
        let count = suite.tests.len() + suite.broken.len();
        beside += count;
        places.extend((count > 0).then_some(place));
    }
    // A folder with a karat.toml is a separate package.
    let is_package = folder.join(SHADERS).join(MANIFEST).is_file();
    let all = "`karat test .` runs all tests".to_owned();
    let some = |places: &[String]| {
        super::test::some(&places.iter().map(String::as_str).collect::<Vec<_>>())
    };
    if beside > 0 {
        let tests = counted(beside, "test");
        let how = if is_package {
            format!("to run these tests, name {}", some(&places))
        } else {
            all.clone()
        };
        writeln!(out, "{KNOWN}Karat didn't run {tests} outside of `{SHADERS}`; {how}{KNOWN:#}")?;
    }
    if !files.is_empty() {
        let count = counted(files.len(), "file");
        let files: Vec<String> = files.iter().map(|file| shown(file)).collect();
        let how = match is_package {
            true => format!("move the files into `{SHADERS}`, beside the modules that they test"),
            false => all,
        };
        writeln!(
            out,
            "{KNOWN}Karat didn't run {count} of tests outside of `{SHADERS}`, {}; {how}{KNOWN:#}",
            some(&files)
        )?;
    }
    Ok(())
}

/// Returns an error if the second argument is an existing folder or file, and not a filter. As a filter, the folder's
/// name could match tests by chance: `t` is in `expect_true`.
pub(super) fn expect_filter(folder: &Path, filter: Option<&str>) -> anyhow::Result<()> {
    let second = filter.filter(|second| Path::new(second).exists()).unwrap_or_default();
    ensure!(
        second.is_empty(),
        "`{second}` is an existing folder or file, but the second argument must be a filter: name only one folder, `{}` or \
         `{second}`",
        folder.display()
    );
    Ok(())
}

/// Checks if the name of a test contains `word` as a whole word.
pub(super) fn has_word(test: &karat_suite::Test, word: &str) -> bool {
    test.name.split(|c: char| !c.is_alphanumeric()).any(|part| part == word)
}

/// Returns the unreadable files of tests in these packages.
pub(super) fn broken_files<'p>(
    packages: impl IntoIterator<Item = &'p Package>,
) -> anyhow::Result<Vec<Broken>> {
    let mut all = Vec::new();
    for package in packages {
        all.extend(Suite::of(package.clone())?.broken.into_iter().filter(|broken| broken.is_file));
    }
    Ok(all)
}

/// Prints the unreadable files.
pub(super) fn write_broken(broken: &[Broken], out: &mut dyn Write) -> std::io::Result<()> {
    broken.iter().try_for_each(|broken| {
        writeln!(out, "\n{HEAD}{}{HEAD:#}: {}", broken.name, broken.wrong.message.trim_end())
    })
}
