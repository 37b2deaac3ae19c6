//! Checks that each published package has the fields that a registry needs, and contains the right files. `cargo ci
//! package` also builds and tests the packages in a separate workspace.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, bail, ensure};
use cargo_metadata::{Metadata, MetadataCommand, Package};

use crate::command;
use crate::step::Steps;

/// The licence files, of which each package has copies, because a registry shows only the package's own files. Symbolic
/// links wouldn't work on Windows, where git writes them as text files.
const LICENCES: [&str; 2] = ["LICENSE-APACHE", "LICENSE-MIT"];

/// The largest number of keywords that crates.io accepts.
const MOST_KEYWORDS: usize = 5;

const PRIVATE: [&str; 3] = ["ci", "shaders", "tests"];

/// Pieces of the paths of files that don't belong in a package, such as files that a test run writes.
const STRAY: [&str; 8] = [
    ".new.exr",
    ".new.csv",
    ".karat/",
    ".snap.new",
    ".pending-snap",
    "target/",
    ".orig.rs",
    ".DS_Store",
];

/// Reads the metadata of the workspace's packages, without their dependencies.
fn workspace() -> Result<Metadata> {
    let mut command = MetadataCommand::new();
    command.current_dir(command::root()).no_deps();
    command.exec().context("could not read the workspace")
}

/// Returns the packages whose manifests allow publishing.
fn published(metadata: &Metadata) -> Vec<&Package> {
    let may = |package: &&&Package| package.publish.as_ref().is_none_or(|to| !to.is_empty());
    metadata.workspace_packages().iter().filter(may).copied().collect()
}

/// Checks the manifest and the files of each published package, and prints the number of packages.
pub(crate) fn check() -> Result<()> {
    let metadata = workspace()?;
    let packages = published(&metadata);
    ensure!(!packages.is_empty(), "no package is published, so nothing was checked");
    let mut problems = Vec::new();
    for name in PRIVATE {
        if packages.iter().any(|package| package.name.as_str() == name) {
            problems.push(format!("`{name}` is of this repository alone; write `publish = false`"));
        }
    }
    for package in &packages {
        let name = &package.name;
        let mut missing = untold(package);
        missing.extend(unlike_ours(package)?);
        missing.extend(misplaced(&listed(name)?));
        problems.extend(missing.into_iter().map(|problem| format!("{name}: {problem}")));
    }
    problems.extend(extension()?);
    if !problems.is_empty() {
        bail!("{}", problems.join("\n   "));
    }
    eprintln!("{} packages", packages.len());
    Ok(())
}

/// Checks that the extension for VS Code has the same version as the program that it starts.
fn extension() -> Result<Vec<String>> {
    const FILES: [&str; 2] = ["package.json", "package-lock.json"];
    let mut problems = Vec::new();
    for name in FILES {
        let path = Path::new("harness/editors/vscode").join(name);
        let text = fs::read_to_string(command::root().join(&path))?;
        let value: serde_json::Value = serde_json::from_str(&text)?;
        if value["version"] != env!("CARGO_PKG_VERSION") {
            problems.push(format!("`{}` has the version {}", path.display(), value["version"]));
        }
    }
    Ok(problems)
}

/// Returns a message for each field that is missing in a package's manifest, or has too many values.
fn untold(package: &Package) -> Vec<String> {
    let is_library = package.targets.iter().any(|target| target.is_lib());
    let said = [
        ("description", package.description.is_some()),
        ("license", package.license.is_some()),
        ("repository", package.repository.is_some()),
        ("readme", package.readme.is_some()),
        ("rust-version", package.rust_version.is_some()),
        ("keywords", (1..=MOST_KEYWORDS).contains(&package.keywords.len())),
        ("categories", (1..=MOST_KEYWORDS).contains(&package.categories.len())),
        ("documentation", !is_library || package.documentation.is_some()),
        ("[package.metadata.docs.rs]", !is_library || package.metadata["docs"]["rs"].is_object()),
    ];
    let missing = said.into_iter().filter(|(_, said)| !said);
    missing.map(|(what, _)| format!("its manifest has no `{what}`, or too many")).collect()
}

/// Returns a message for each licence file that the package lacks, or that differs from the repository's file.
fn unlike_ours(package: &Package) -> Result<Vec<String>> {
    let folder = package.manifest_path.parent().context("a manifest has a folder")?;
    let mut problems = Vec::new();
    for name in LICENCES {
        let ours = fs::read(command::root().join(name)).with_context(|| format!("no {name}"))?;
        if fs::read(folder.join(name)).ok() != Some(ours) {
            problems.push(format!("copy {name} from the repository's root to `{folder}`"));
        }
    }
    Ok(problems)
}

/// Returns the files that Cargo would put into the package.
fn listed(name: &str) -> Result<Vec<String>> {
    let mut list = command::cargo(&["package", "--list", "--allow-dirty", "--package", name]);
    let output = list.output().context("`cargo package` doesn't start")?;
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    ensure!(output.status.success(), "`cargo package --list` fails: {told}");
    Ok(String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|line| line.replace('\\', "/"))
        .collect())
}

/// Returns a message for each file that a package lacks, and for each file that doesn't belong in a package.
fn misplaced(files: &[String]) -> Vec<String> {
    let wanted = LICENCES.iter().chain(&["README.md", "Cargo.toml"]);
    let lacks = wanted.filter(|name| !files.iter().any(|file| file == *name));
    let lacks = lacks.map(|name| format!("the package lacks {name}"));
    let is_stray = |file: &&String| STRAY.iter().any(|part| file.contains(part));
    let stray = files.iter().filter(is_stray);
    lacks.chain(stray.map(|file| format!("`{file}` doesn't belong into the package"))).collect()
}

/// Packs the published packages, unpacks them into a separate workspace, and runs their tests there.
pub(crate) fn run() -> ExitCode {
    let mut steps = Steps::new("cargo ci package");
    let _ = steps.run("packages", check)
        && steps.run("pack", pack)
        && steps.run("unpack", unpack)
        && steps.run("tests", test);
    steps.finish()
}

fn names() -> Result<Vec<(String, String)>> {
    let metadata = workspace()?;
    let of = |package: &&Package| (package.name.to_string(), package.version.to_string());
    Ok(published(&metadata).iter().map(of).collect())
}

fn pack() -> Result<()> {
    let mut package = command::cargo(&["package", "--no-verify", "--allow-dirty"]);
    for (name, _) in names()? {
        package.args(["--package", &name]);
    }
    command::run(&mut package)
}

fn target() -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
    command::root().join(target)
}

/// Returns the folder for the unpacked packages. A package in this folder can't read the repository's other files by a
/// relative path such as `../README.md`.
fn unpacked() -> PathBuf {
    target().join("package").join("unpacked")
}

/// Unpacks the packages into a workspace of their own. Dependencies between the packages use the unpacked packages,
/// instead of packages from the registry.
fn unpack() -> Result<()> {
    let folder = unpacked();
    if folder.exists() {
        fs::remove_dir_all(&folder).context("the folder of the last run is in the way")?;
    }
    fs::create_dir_all(&folder)?;
    let mut members = Vec::new();
    let mut patches = String::new();
    for (name, version) in names()? {
        let member = format!("{name}-{version}");
        let file = target().join("package").join(format!("{member}.crate"));
        // `m` gives files the current time. In the archive all files have the same date, so Cargo would mistake a new
        // package for the package of the last run.
        command::run(Command::new("tar").arg("-xzmf").arg(&file).arg("-C").arg(&folder))?;
        patches.push_str(&format!("{name} = {{ path = \"{member}\" }}\n"));
        members.push(member);
    }
    let manifest = fs::read_to_string(command::root().join("Cargo.toml"))?;
    let text = format!(
        "[workspace]\nresolver = \"3\"\nmembers = {members:?}\n\n[patch.crates-io]\n{patches}\n{}",
        profiles(&manifest)
    );
    fs::write(folder.join("Cargo.toml"), text)?;
    let lock = Path::new("Cargo.lock");
    fs::copy(command::root().join(lock), folder.join(lock)).context("the lock file")?;
    Ok(())
}

/// Returns the profiles in the text of a manifest. The workspace of the unpacked packages gets the repository's
/// profiles, so that its build reuses crates that the repository's build compiled.
fn profiles(manifest: &str) -> String {
    let mut found = String::new();
    let mut within = false;
    for line in manifest.lines() {
        if line.starts_with('[') {
            within = line.starts_with("[profile.");
        }
        if within {
            found.push_str(line);
            found.push('\n');
        }
    }
    found
}

fn test() -> Result<()> {
    // The examples of `karat-core` use `karat`, which itself depends on `karat-core`.
    const CORE: &str = "karat-core";
    let all = ["test", "--workspace", "--no-fail-fast", "--exclude", CORE];
    let core = ["test", "--package", CORE, "--lib"];
    for arguments in [&all[..], &core[..]] {
        let mut test = command::cargo(arguments);
        test.current_dir(unpacked()).env("CARGO_TARGET_DIR", target());
        command::run(&mut test)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 139
    #[test]
    fn the_packages_of_this_workspace_have_all_their_files() {
        check().expect("each is");
    }

    // Lesson 139
    #[test]
    fn missing_and_misplaced_files_are_named() {
        let files =
            |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let whole =
            files(&["Cargo.toml", "LICENSE-APACHE", "LICENSE-MIT", "README.md", "src/lib.rs"]);
        assert!(misplaced(&whole).is_empty());
        assert_eq!(
            misplaced(&whole[..2]),
            ["the package lacks LICENSE-MIT", "the package lacks README.md"]
        );
        let with = |stray: &str| misplaced(&[&*whole, &files(&[stray])].concat());
        for stray in ["golden/a.new.exr", ".karat/failures/a.txt", "tests/a.snap.new", "target/x"] {
            assert_eq!(with(stray), [format!("`{stray}` doesn't belong into the package")]);
        }
    }

    #[test]
    fn only_profiles_are_copied_from_a_manifest() {
        let text = "[a]\nx = 1\n[profile.dev]\nopt-level = 1\n# why\n[b]\ny = 2\n[profile.dev.package.c]\nz = 3\n";
        let expected = "[profile.dev]\nopt-level = 1\n# why\n[profile.dev.package.c]\nz = 3\n";
        assert_eq!(profiles(text), expected);
    }
}
