//! `cargo ci bench`: runs the harness's benchmarks.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};

use crate::command;

/// The page that `cargo ci bench --page` writes.
const PAGE: &str = "docs/speed.md";

/// Runs the benchmarks, and passes `arguments` to them.
pub(crate) fn run(arguments: &[String], page: bool) -> Result<()> {
    // Some benchmarks run the program `karat`, as `karat watch`.
    command::run(&mut command::cargo(&["build", "--workspace", "--locked", "--bin", "karat"]))?;
    // Uses the profile of `cargo test`, because authors wait for such a build. The benchmark itself contains the loops
    // with which the harness is compared. These loops are optimised in the same way as the library.
    const OPTIMISED: &str = "profile.dev.package.tests.opt-level=2";
    let karat = ["bench", "--workspace", "--locked", "--profile", "dev", "--bench", "karat"];
    let mut bench = command::cargo(&karat);
    bench.args(["--config", OPTIMISED]);
    // With this variable, wgpu in this profile takes a backtrace at each lock.
    bench.env_remove("RUST_BACKTRACE");
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
    bench.env("MESA_SHADER_CACHE_DIR", empty_cache(&command::root().join(target))?);
    if !arguments.is_empty() {
        bench.arg("--").args(arguments);
    }
    if !page {
        return command::run(&mut bench);
    }
    let mut child = bench.stdout(Stdio::piped()).spawn().context("can't run `cargo`")?;
    let stdout = child.stdout.take().context("it is piped")?;
    let mut measured = String::new();
    for line in BufReader::new(stdout).lines() {
        let line = line.context("the benchmark's output ended early")?;
        // Measuring takes minutes, so print each line at once.
        writeln!(std::io::stdout(), "{line}").context("nobody reads the output any more")?;
        measured += &line;
        measured.push('\n');
    }
    ensure!(child.wait()?.success(), "the benchmark failed: `{PAGE}` is as it was");
    let page = format!(
        "# Speed\n\n\
         `cargo ci bench --page` built the measured programs with Cargo's profile `dev`, as `cargo test` does. \
         Each figure is a median, with the least and\nthe largest measurement in parentheses. \
         Compare only figures of the same run, because other machines and busy machines give other figures.\n\n\
         {}\n\n```text\n{}\n```\n",
        machine(),
        measured.trim()
    );
    std::fs::write(command::root().join(PAGE), page)
        .with_context(|| format!("can't write `{PAGE}`"))
}

/// Returns an empty folder in which drivers cache compiled shaders. The user's own cache would already contain shaders
/// of earlier runs, so the benchmark would miss the time to compile them.
fn empty_cache(target: &Path) -> Result<PathBuf> {
    let folder = target.join("bench-driver-cache");
    let shown = folder.display();
    if folder.exists() {
        std::fs::remove_dir_all(&folder).with_context(|| format!("can't empty `{shown}`"))?;
    }
    std::fs::create_dir_all(&folder).with_context(|| format!("can't make `{shown}`"))?;
    Ok(folder)
}

/// Describes the machine as a Markdown list: processor, memory, system, Rust and Vulkan driver.
fn machine() -> String {
    let read = |file: &str, name: &str| {
        let text = std::fs::read_to_string(file).ok()?;
        let line = text.lines().find(|line| line.starts_with(name))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    let said = |command: &mut Command| {
        let output = command.stderr(Stdio::null()).output().ok()?;
        Some(String::from_utf8_lossy(&output.stdout).into_owned())
    };
    let processor = read("/proc/cpuinfo", "model name");
    let memory = read("/proc/meminfo", "MemTotal");
    let rust = said(Command::new("rustc").arg("--version"));
    let doctor = command::karat(&["doctor"]).ok().and_then(|mut karat| said(&mut karat));
    let vulkan = doctor
        .as_deref()
        .into_iter()
        .flat_map(str::lines)
        .skip_while(|line| !line.starts_with("vulkan "));
    let vulkan: Vec<&str> =
        vulkan.take(2).map(|line| line.trim_start_matches("vulkan").trim()).collect();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let facts = [
        ("Processor", processor.map(|name| format!("{name}, {cores} cores"))),
        ("Memory", memory),
        ("System", Some(format!("{} {}", std::env::consts::OS, std::env::consts::ARCH))),
        ("Rust", rust),
        ("Vulkan", Some(vulkan.join("; "))),
        ("Driver cache", Some("a folder that is empty when the benchmark begins".to_owned())),
    ];
    let known = facts.into_iter().filter_map(|(name, fact)| {
        let fact = fact.filter(|fact| !fact.trim().is_empty())?;
        Some(format!("- {name}: {}", fact.trim()))
    });
    known.collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 167
    #[test]
    fn a_benchmark_begins_with_an_empty_driver_cache_of_its_own() {
        let target = tempfile::tempdir().expect("a folder");
        let cache = empty_cache(target.path()).expect("it is made");
        assert!(cache.starts_with(target.path()), "{}", cache.display());
        std::fs::write(cache.join("of an earlier run"), "a shader").expect("written");
        assert_eq!(empty_cache(target.path()).expect("again"), cache);
        assert_eq!(std::fs::read_dir(&cache).expect("it is there").count(), 0);
    }
}
