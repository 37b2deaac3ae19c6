//! `karat doctor`

mod executor;
mod package;
pub(super) mod profile;

use std::io::Write;

use karat::Path;
use karat::unstable::golden::Profile;
use karat::unstable::path::{Adapter, Api, Via};
use karat::unstable::settings::{Variable, variables};
use karat::unstable::tint::{self, Tint};
use karat_translate::{Missing, Target, Tool};
use serde::Serialize;

use super::project::Project;
use super::table::{BAD, DIM, GOOD, HEAD, KNOWN};
use super::{Ending, Outcome, write_json};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Folder of modules: `doctor` says what its modules lack, such as imports or features, and which lines its
    /// karat.toml needs. Without a folder it lists the paths and tools of this machine
    #[arg(value_name = "PACKAGE")]
    package: Option<std::path::PathBuf>,
    /// Writes the missing lines into the package's karat.toml
    #[arg(long, requires = "package")]
    write: bool,
    /// Fails unless these paths open
    #[arg(long, value_name = "PATHS", value_delimiter = ',', env = "KARAT_REQUIRE")]
    require: Vec<String>,
    /// Sends jobs with known results to a program that KARAT_EXECUTORS names, or to another path, and fails if a
    /// result is wrong
    #[arg(long, value_name = "NAME", conflicts_with_all = ["package", "write"])]
    executor: Option<String>,
    /// Prints JSON
    #[arg(long)]
    json: bool,
}

/// The libraries whose versions affect results. A test compares these versions with Cargo.lock.
pub(super) const LIBRARIES: [(&str, &str); 2] = [("wgpu", "30.0.1"), ("naga", "30.0.1")];

#[derive(Serialize)]
struct Report {
    karat: &'static str,
    libraries: Vec<(&'static str, &'static str)>,
    system: String,
    paths: Vec<PathReport>,
    /// The paths on which checks run with the current settings.
    selected: Vec<&'static str>,
    /// The error, if no path can run checks with the current settings.
    unusable: Option<String>,
    /// The WGSL compilers besides naga.
    compilers: Vec<CompilerReport>,
    tools: Vec<ToolReport>,
    settings: Vec<SettingReport>,
    /// The crates that the project compiles with less optimisation than recommended.
    unoptimised: Vec<profile::Unoptimised>,
}

#[derive(Serialize)]
struct ToolReport {
    name: &'static str,
    /// The languages that the tool validates.
    judges: Vec<&'static str>,
    version: Option<String>,
    missing: Option<String>,
    remedy: Option<String>,
}

fn tools() -> Vec<ToolReport> {
    let names = |targets: &[Target]| targets.iter().map(|target| target.name()).collect();
    let report = |tool: &Result<Tool, Missing>| match tool {
        Ok(tool) => ToolReport {
            name: tool.name(),
            judges: names(tool.targets()),
            version: Some(tool.version().to_owned()),
            missing: None,
            remedy: None,
        },
        Err(missing) => ToolReport {
            name: missing.name,
            judges: names(missing.targets),
            version: None,
            missing: Some(missing.reason.clone()),
            remedy: Some(missing.remedy.to_owned()),
        },
    };
    Tool::all().iter().map(report).collect()
}

/// A WGSL compiler, besides naga, that can check modules.
#[derive(Serialize)]
struct CompilerReport {
    name: &'static str,
    /// The compiler's file and version, if it is installed.
    here: Option<(String, String)>,
    missing: Option<String>,
    remedy: Option<String>,
}

fn compilers() -> Vec<CompilerReport> {
    let here = std::env::current_dir().unwrap_or_default();
    let name = "tint";
    let found = Tint::beside(&here, false).and_then(|tint| {
        let version = tint.version().map_err(|reason| tint::Missing {
            reason: format!("{tint} doesn't run: {reason}"),
            remedy: "install Tint again, or name another Tint in KARAT_TINT".to_owned(),
        });
        Ok((tint.to_string(), version?))
    });
    vec![match found {
        Ok(here) => CompilerReport { name, here: Some(here), missing: None, remedy: None },
        Err(tint::Missing { reason, remedy, .. }) => {
            CompilerReport { name, here: None, missing: Some(reason), remedy: Some(remedy) }
        }
    }]
}

fn names(paths: &[Path]) -> Vec<&'static str> {
    paths.iter().map(|path| path.name()).collect()
}

/// An environment variable.
#[derive(Serialize)]
struct SettingReport {
    name: &'static str,
    value: Option<String>,
    about: &'static str,
}

#[derive(Serialize)]
struct PathReport {
    path: &'static str,
    /// The profile of this path and driver, such as `gl-llvmpipe`.
    profile: Option<String>,
    /// The driver's name, as it appears after the `@` in a path's name: `vulkan@lavapipe`.
    family: Option<String>,
    adapter: Option<Adapter>,
    missing: Option<String>,
    remedy: Option<String>,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    if let Some(name) = &args.executor {
        return executor::run(name, args.json, out);
    }
    let required: Vec<Path> = args
        .require
        .iter()
        .map(|name| name.trim())
        .filter(|name| !name.is_empty())
        .map(str::parse)
        .collect::<Result<_, _>>()?;
    if let Some(folder) = &args.package {
        for path in &required {
            karat::unstable::path::adapter(*path)?;
        }
        return package::run(folder, args.write, args.json, out);
    }
    // Required paths, and paths that name a driver, are tried even if the platform doesn't support them.
    let usual = Path::ALL.into_iter().filter(|path| path.is_supported() || required.contains(path));
    let mut all: Vec<Path> =
        usual.chain([Path::CPU]).chain(karat::unstable::path::programs()?).collect();
    for path in &required {
        if !all.contains(path) {
            all.push(*path);
        }
    }
    let paths: Vec<PathReport> = all
        .into_iter()
        .map(|path| match karat::unstable::path::adapter(path) {
            Ok(adapter) => PathReport {
                path: path.name(),
                profile: Some(Profile::of(&adapter).to_string()),
                family: Some(adapter.family()),
                adapter: Some(adapter),
                missing: None,
                remedy: None,
            },
            Err(error) => PathReport {
                path: path.name(),
                profile: None,
                family: None,
                adapter: None,
                missing: Some(error.to_string()),
                remedy: Some(remedy(path).to_owned()),
            },
        })
        .collect();
    let opens = |path: &Path| {
        paths.iter().any(|report| report.path == path.name() && report.adapter.is_some())
    };
    let selected = karat::unstable::path::selected();
    let good = selected.is_ok() && required.iter().all(opens);
    let report = Report {
        karat: env!("CARGO_PKG_VERSION"),
        libraries: LIBRARIES.to_vec(),
        system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        paths,
        selected: selected.as_ref().map_or_else(|_| Vec::new(), |paths| names(paths)),
        unusable: selected.err().map(|error| error.to_string()),
        compilers: compilers(),
        tools: tools(),
        settings: variables()
            .into_iter()
            .map(|Variable { name, value, about, .. }| SettingReport { name, value, about })
            .collect(),
        unoptimised: Project::find()
            .map(|project| profile::unoptimised(project.root()))
            .unwrap_or_default(),
    };
    if args.json {
        write_json(&report, out)?;
    } else {
        write_text(&report, out)?;
    }
    Ok(if good { Ending::Good } else { Ending::Bad })
}

fn write_text(report: &Report, out: &mut dyn Write) -> std::io::Result<()> {
    write!(out, "{HEAD}karat {}{HEAD:#} on {}", report.karat, report.system)?;
    for (library, version) in &report.libraries {
        write!(out, ", {library} {version}")?;
    }
    writeln!(out, "\n")?;
    for PathReport { path, profile, family, adapter, missing, remedy } in &report.paths {
        match adapter {
            Some(adapter) => {
                let kind = if adapter.software { "software" } else { "hardware" };
                writeln!(out, "{GOOD}{path:<8}{GOOD:#} {} ({kind})", adapter.name)?;
                let profile = profile.as_deref().unwrap_or_default();
                let family = family.as_deref().unwrap_or_default();
                let driver = &adapter.driver;
                writeln!(out, "{DIM}         {driver}, family {family}, profile {profile}{DIM:#}")?;
            }
            None => {
                let missing = missing.as_deref().unwrap_or_default();
                let remedy = remedy.as_deref().unwrap_or_default();
                writeln!(out, "{BAD}{path:<8}{BAD:#} {missing}\n         {remedy}")?;
            }
        }
    }
    match &report.unusable {
        Some(error) => writeln!(out, "\n{BAD}no path can run checks:{BAD:#} {error}")?,
        None => writeln!(out, "\nchecks run on {}", report.selected.join(", "))?,
    }
    if !report.unoptimised.is_empty() {
        writeln!(
            out,
            "\n{KNOWN}some crates have too little optimisation{KNOWN:#}; write in Cargo.toml:"
        )?;
        writeln!(out, "[profile.dev.package]")?;
    }
    for profile::Unoptimised { name, level, recommended, about } in &report.unoptimised {
        writeln!(out, "{name}.opt-level = {recommended} {DIM}# at {level}, {about}{DIM:#}")?;
    }
    writeln!(out, "\n{HEAD}compilers of WGSL besides naga{HEAD:#}")?;
    for CompilerReport { name, here, missing, remedy } in &report.compilers {
        match here {
            Some((place, version)) => {
                writeln!(
                    out,
                    "{GOOD}{name:<16}{GOOD:#} {version}\n{DIM}                 {place}{DIM:#}"
                )?;
            }
            None => {
                let missing = missing.as_deref().unwrap_or_default();
                let remedy = remedy.as_deref().unwrap_or_default();
                writeln!(out, "{name:<16} {missing}\n{DIM}                 {remedy}{DIM:#}")?;
            }
        }
    }
    writeln!(out, "\n{HEAD}validators of translations{HEAD:#}")?;
    for ToolReport { name, judges, version, missing, remedy } in &report.tools {
        let judges = judges.join(", ");
        match (version, missing) {
            (Some(version), _) => {
                writeln!(
                    out,
                    "{GOOD}{name:<16}{GOOD:#} {judges}\n{DIM}                 {version}{DIM:#}"
                )?;
            }
            (None, missing) => {
                let missing = missing.as_deref().unwrap_or_default();
                let remedy = remedy.as_deref().unwrap_or_default();
                writeln!(
                    out,
                    "{name:<16} {judges}\n{DIM}                 not installed: {missing}; {remedy}{DIM:#}"
                )?;
            }
        }
    }
    writeln!(out, "\n{HEAD}settings{HEAD:#}")?;
    for SettingReport { name, value, about } in &report.settings {
        let shown = value.as_deref().map_or_else(|| "not set".to_owned(), |v| format!("= {v}"));
        writeln!(out, "{name:<16} {shown}\n{DIM}                 {about}{DIM:#}")?;
    }
    Ok(())
}

/// Returns instructions to make a path available on this platform.
fn remedy(path: Path) -> &'static str {
    match path.via() {
        _ if path.api() == Api::Cpu => {
            return "the engine's paths are `cpu`, `cpu:fma` and `cpu:ftz`";
        }
        _ if path.api() == Api::Process => {
            return "to write a program for this path, read docs/guide/executors.md";
        }
        Via::Glsl | Via::Hlsl if path.api() == Api::Vulkan => {
            return "install glslang (Debian: glslang-tools; Fedora, Arch and Homebrew: glslang)";
        }
        Via::HlslDxc if path.api() == Api::Vulkan => {
            return "install dxc, from GitHub (microsoft/DirectXShaderCompiler) or Vulkan's SDK";
        }
        Via::Glsl | Via::Hlsl | Via::HlslDxc => return "Karat can't run this path yet",
        _ => {}
    }
    let usual = Path::ALL.into_iter().find(|usual| usual.api() == path.api());
    match usual.unwrap_or(path) {
        Path::VULKAN if cfg!(target_os = "linux") => {
            "install your GPU's Vulkan driver, or Mesa's software driver and the Vulkan loader \
             (Debian: mesa-vulkan-drivers libvulkan1; Fedora: mesa-vulkan-drivers vulkan-loader; \
             Arch: vulkan-swrast vulkan-icd-loader)"
        }
        Path::GL if cfg!(target_os = "linux") => {
            "install your GPU's OpenGL driver, or Mesa's driver (Debian: libegl1 libgl1-mesa-dri; \
             Fedora: mesa-libEGL mesa-dri-drivers; Arch: mesa)"
        }
        Path::VULKAN | Path::GL => "install the driver of your GPU's vendor",
        Path::METAL => "only macOS has Metal",
        Path::DX12 => "only Windows has Direct3D 12",
        _ => "Karat doesn't know how to get this path",
    }
}

/// Reads a file of the repository's root, or the copy of this file in a published package.
#[cfg(test)]
fn beside(file: &str) -> String {
    let package = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |folder: &str| std::fs::read_to_string(package.join(folder).join(file)).ok();
    read("../..").or_else(|| read("")).expect("it is there")
}

#[cfg(test)]
mod tests {
    #[test]
    fn doctor_prints_the_versions_of_the_lock_file() {
        let lock = super::beside("Cargo.lock");
        for (library, version) in super::LIBRARIES {
            let entry = format!("name = \"{library}\"\nversion = \"{version}\"\n");
            assert!(lock.contains(&entry), "{library} isn't {version} in Cargo.lock");
        }
    }
}
