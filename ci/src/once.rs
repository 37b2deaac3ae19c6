//! Checks that Cargo compiles each dependency and each library only once, into one file.
//!
//! Cargo compiles a crate once for each set of the crate's features, and again if Cargo compiles one of the crate's
//! dependencies again. The features depend on the packages and targets that a command names. [`COMMANDS`] lists the
//! commands that people run, and those that `cargo ci demo` and `cargo ci test` start. Each command must reuse the
//! libraries that the earlier commands compiled.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, bail};
use cargo_metadata::camino::Utf8PathBuf;
use cargo_metadata::{Artifact, Message, Metadata, MetadataCommand, PackageId};

use crate::command;

/// The commands to check, in the order in which they run. With `--no-run`, Cargo compiles the tests and doesn't run
/// them.
const COMMANDS: [&[&str]; 6] = [
    // `cargo ci` itself, and `cargo karat`, as their aliases do.
    &["build", "--bin", "ci"],
    &["build", "--bin", "karat"],
    crate::demo::BUILD,
    &["test", "--workspace", "--test", "library", "--test", "golden", "--no-run"],
    crate::suite::BUILD,
    &["test", "--workspace", "--locked", "--no-run"],
];

/// For each package, the files into which Cargo compiled its library, each with the features that were turned on.
type Compiled = BTreeMap<String, BTreeMap<Utf8PathBuf, Vec<String>>>;

/// Runs each command, and returns an error that lists the libraries that Cargo compiled more than once.
pub(crate) fn check() -> Result<()> {
    let metadata = MetadataCommand::new().current_dir(command::root()).exec();
    let hosts = hosts(&metadata.context("can't read the workspace")?);
    let mut compiled = Compiled::new();
    for arguments in COMMANDS {
        let mut cargo = command::cargo(arguments);
        cargo.arg("--message-format=json");
        let output = cargo.stderr(std::process::Stdio::inherit()).output();
        let output = output.context("cargo doesn't run")?;
        if !output.status.success() {
            bail!("`cargo {}` failed", arguments.join(" "));
        }
        note(&output.stdout[..], &hosts, &mut compiled)?;
    }
    if compiled.is_empty() {
        bail!("Cargo's build messages name no library");
    }
    let twice = twice(&compiled);
    if !twice.is_empty() {
        bail!("compiled twice:\n{}", twice.join("\n"));
    }
    eprintln!("{} libraries, each compiled once", compiled.len());
    Ok(())
}

/// Returns the packages that build scripts and macros use. Cargo builds these packages for the build machine, and
/// chooses their features separately.
fn hosts(metadata: &Metadata) -> BTreeSet<PackageId> {
    use cargo_metadata::DependencyKind;
    let Some(resolve) = &metadata.resolve else { return BTreeSet::new() };
    let node = |id: &PackageId| resolve.nodes.iter().find(|node| node.id == *id);
    let is_macro = |id: &PackageId| {
        let package = metadata.packages.iter().find(|package| package.id == *id);
        package.is_some_and(|package| package.targets.iter().any(|target| target.is_proc_macro()))
    };
    let mut open: Vec<PackageId> = Vec::new();
    for one in &resolve.nodes {
        for dependency in &one.deps {
            let build = dependency.dep_kinds.iter().any(|kind| kind.kind == DependencyKind::Build);
            if build || is_macro(&dependency.pkg) {
                open.push(dependency.pkg.clone());
            }
        }
    }
    let mut hosts = BTreeSet::new();
    while let Some(id) = open.pop() {
        if !hosts.insert(id.clone()) {
            continue;
        }
        let own = node(&id).into_iter().flat_map(|node| &node.deps);
        let normal = own.filter(|dependency| {
            dependency.dep_kinds.iter().any(|kind| kind.kind != DependencyKind::Development)
        });
        open.extend(normal.map(|dependency| dependency.pkg.clone()));
    }
    hosts
}

/// Reads Cargo's build messages for one command, and adds each compiled library to `compiled`, except libraries for
/// build scripts and macros.
fn note(
    messages: impl std::io::BufRead,
    hosts: &BTreeSet<PackageId>,
    compiled: &mut Compiled,
) -> Result<()> {
    for message in Message::parse_stream(messages) {
        let Message::CompilerArtifact(artifact) = message.context("cargo's messages")? else {
            continue;
        };
        if artifact.profile.test || is_for_host(&artifact, hosts) {
            continue;
        }
        let library = artifact.filenames.into_iter().find(|name| name.extension() == Some("rlib"));
        if let Some(library) = library {
            let mut features = artifact.features;
            features.sort();
            let files = compiled.entry(artifact.package_id.to_string()).or_default();
            files.insert(library, features);
        }
    }
    Ok(())
}

/// Checks if a library was compiled for build scripts and macros. Such libraries have the optimisation level 0, which
/// `[profile.dev.build-override]` sets.
fn is_for_host(artifact: &Artifact, hosts: &BTreeSet<PackageId>) -> bool {
    hosts.contains(&artifact.package_id) && artifact.profile.opt_level == "0"
}

/// Returns a line for each library that Cargo compiled into several files, with the features that differ between the
/// files.
fn twice(compiled: &Compiled) -> Vec<String> {
    let several = compiled.iter().filter(|(_, files)| files.len() > 1);
    let line = |(package, files): (&String, &BTreeMap<Utf8PathBuf, Vec<String>>)| {
        let all: BTreeSet<&String> = files.values().flatten().collect();
        let differs = all.into_iter().filter(|one| !files.values().all(|set| set.contains(one)));
        let differs: Vec<&str> = differs.map(String::as_str).collect();
        match differs.is_empty() {
            true => format!("  {package}: with the same features, over another crate"),
            false => format!("  {package}: not always with {}", differs.join(", ")),
        }
    };
    several.map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn artifact(
        package: &str,
        kind: &str,
        file: &str,
        features: &[&str],
        level: &str,
        test: bool,
    ) -> String {
        serde_json::json!({
            "reason": "compiler-artifact",
            "package_id": package,
            "manifest_path": "/p/Cargo.toml",
            "target": {
                "kind": [kind], "crate_types": [kind], "name": "p", "src_path": "/p/src/lib.rs",
                "edition": "2024", "doc": true, "doctest": true, "test": true
            },
            "profile": {
                "opt_level": level, "debuginfo": 0, "debug_assertions": true,
                "overflow_checks": true, "test": test
            },
            "features": features,
            "filenames": [file],
            "executable": null,
            "fresh": true
        })
        .to_string()
    }

    // Lesson 196
    #[test]
    fn a_library_in_two_files_is_named() {
        let messages = [
            artifact("wgpu", "lib", "/t/libwgpu-1.rlib", &["vulkan"], "1", false),
            artifact("wgpu", "lib", "/t/libwgpu-2.rlib", &["vulkan", "gles"], "1", false),
            artifact("naga", "lib", "/t/libnaga-1.rlib", &["wgsl-in"], "1", false),
            artifact("naga", "lib", "/t/libnaga-1.rlib", &["wgsl-in"], "1", false),
            // This occurs, for example, if the graph has two versions of `serde`.
            artifact("toml", "lib", "/t/libtoml-1.rlib", &["parse"], "1", false),
            artifact("toml", "lib", "/t/libtoml-2.rlib", &["parse"], "1", false),
            // These are only metadata, a test harness, and code for the host.
            artifact("naga", "lib", "/t/libnaga-3.rmeta", &[], "1", false),
            artifact("naga", "lib", "/t/naga-4.rlib", &[], "1", true),
            artifact("syn", "lib", "/t/libsyn-1.rlib", &["full"], "0", false),
            artifact("syn", "lib", "/t/libsyn-2.rlib", &["full", "visit"], "1", false),
        ];
        let hosts = BTreeSet::from([PackageId { repr: "syn".to_owned() }]);
        let mut compiled = Compiled::new();
        note(messages.join("\n").as_bytes(), &hosts, &mut compiled).expect("they are messages");
        let told =
            ["  toml: with the same features, over another crate", "  wgpu: not always with gles"];
        assert_eq!(twice(&compiled), told);
        assert_eq!(compiled.len(), 4);
    }
}
