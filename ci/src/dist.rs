//! `cargo ci dist`: builds packages for people without Rust, and tests them without Rust.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};

use crate::{command, setup, suite};

/// The oldest glibc on which the program runs: the version of Debian 10 and RHEL 8. A statically linked program would
/// need no glibc, but couldn't open Vulkan.
const GLIBC: &str = "2.28";

/// The largest sizes of the program and of the archive, in bytes. Files up to these sizes download within seconds.
const MOST_BYTES: [u64; 2] = [28_000_000, 11_000_000];

/// The shells for which the packages have completions, with the names of the completion files.
const SHELLS: [(&str, &str); 4] = [
    ("bash", "karat.bash"),
    ("zsh", "_karat"),
    ("fish", "karat.fish"),
    ("powershell", "karat.ps1"),
];

/// Builds the packages for a target.
pub(crate) fn run(target: Option<&str>) -> Result<()> {
    let host = host()?;
    let target = target.unwrap_or(&host);
    expect_library(target)?;
    let folder = command::root().join("target/dist");
    let binary = build(target, &folder)?;
    let completions = folder.join("completions");
    fs::create_dir_all(&completions)?;
    // Completions and manual pages are equal on each target. This machine may not be able to run the program of another
    // target.
    let program = if target == host { binary.clone() } else { own()? };
    for (shell, file) in SHELLS {
        let said = Command::new(&program).args(["completions", shell]).output()?;
        ensure!(said.status.success(), "`karat completions {shell}` fails");
        fs::write(completions.join(file), said.stdout)?;
    }
    let packages = folder.join("packages");
    if packages.exists() {
        fs::remove_dir_all(&packages)?;
    }
    let version = env!("CARGO_PKG_VERSION");
    let mut pack = Command::new("python3");
    pack.arg(command::root().join("ci/dist/pack.py")).arg("--binary").arg(&binary);
    pack.arg("--root").arg(command::root()).arg("--completions").arg(&completions);
    pack.args(["--target", target, "--version", version]).arg("--out").arg(&packages);
    command::run(&mut pack)?;
    let archive = archive_of(&packages)?;
    for (file, most) in [&binary, &archive].into_iter().zip(MOST_BYTES) {
        let bytes = fs::metadata(file)?.len();
        ensure!(bytes <= most, "`{}` has {bytes} bytes, more than {most}", file.display());
    }
    // On Windows the programs of npm and Python have other names, and these commands have never run there.
    if target == host && cfg!(unix) { walk(&packages) } else { Ok(()) }
}

/// Returns the target that this machine's Rust compiles for by default.
fn host() -> Result<String> {
    let said = Command::new("rustc").arg("-vV").output().context("`rustc` doesn't run")?;
    let text = String::from_utf8_lossy(&said.stdout).into_owned();
    let host = text.lines().find_map(|line| line.strip_prefix("host: "));
    host.map(str::to_owned).context("rustc names no host")
}

fn expect_library(target: &str) -> Result<()> {
    let said =
        Command::new("rustc").args(["--print", "target-libdir", "--target", target]).output()?;
    let library = PathBuf::from(String::from_utf8_lossy(&said.stdout).trim());
    if !said.status.success() {
        bail!("rustc knows no target `{target}`: `rustc --print target-list` has all");
    }
    ensure!(
        library.is_dir(),
        "the standard library of `{target}` isn't installed: `rustup target add {target}`, or run this on that system"
    );
    Ok(())
}

/// Builds the program `karat` in the profile `dist`.
fn build(target: &str, folder: &Path) -> Result<PathBuf> {
    let linux = target.contains("-linux-");
    let mut cargo = if linux { zigbuild(folder)? } else { command::cargo(&["build"]) };
    let wanted = if linux { format!("{target}.{GLIBC}") } else { target.to_owned() };
    cargo.args(["--locked", "--profile", "dist", "--package", "karat-cli", "--bins"]);
    command::run(cargo.args(["--target", &wanted]))?;
    let name = if target.contains("-windows-") { "karat.exe" } else { "karat" };
    Ok(command::root().join("target").join(target).join("dist").join(name))
}

/// Returns the command `cargo zigbuild`, and installs cargo-zigbuild below `folder` if it is missing.
fn zigbuild(folder: &Path) -> Result<Command> {
    let tools = folder.join("tools");
    let bin = tools.join("bin");
    if !command::succeeds(Command::new(bin.join("cargo-zigbuild")).arg("--version")) {
        let mut make = Command::new("python3");
        command::run(make.args(["-m", "venv"]).arg(&tools))
            .context("python3's `venv` makes the folder of the tools: on Debian it is the package python3-venv")?;
        let wanted = command::root().join("ci/dist/requirements.txt");
        let mut pip = Command::new(bin.join("python3"));
        pip.args(["-m", "pip", "install", "--quiet", "--require-hashes", "--only-binary", ":all:"]);
        command::run(pip.arg("--requirement").arg(wanted))?;
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    let all = std::iter::once(bin).chain(std::env::split_paths(&path));
    let mut cargo = command::cargo(&["zigbuild"]);
    cargo.env("PATH", std::env::join_paths(all)?);
    Ok(cargo)
}

/// Builds the program `karat` for this machine.
fn own() -> Result<PathBuf> {
    command::run(&mut command::cargo(&[
        "build",
        "--locked",
        "--package",
        "karat-cli",
        "--bin",
        "karat",
    ]))?;
    Ok(command::root().join("target/debug").join(format!("karat{}", std::env::consts::EXE_SUFFIX)))
}

fn files(packages: &Path, is_one: impl Fn(&str) -> bool) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(packages)? {
        let path = entry?.path();
        if path.file_name().is_some_and(|name| is_one(&name.to_string_lossy())) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn archive_of(packages: &Path) -> Result<PathBuf> {
    let all = files(packages, |name| name.ends_with(".tar.gz") || name.ends_with(".zip"))?;
    all.into_iter().next().context("no archive was made")
}

/// Returns `PATH` without the folders that contain the program cargo.
fn without_rust() -> Result<std::ffi::OsString> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let has = |folder: &PathBuf| folder.join("cargo").exists() || folder.join("cargo.exe").exists();
    let all = std::env::split_paths(&path).filter(|folder| !has(folder));
    Ok(std::env::join_paths(all)?)
}

/// Runs, in an empty folder and without cargo in `PATH`, the commands that a user of npm or Python types to install
/// `karat` and run a first test.
fn walk(packages: &Path) -> Result<()> {
    let path = without_rust()?;
    let all = files(packages, |name| name.ends_with(".tgz"))?;
    ensure!(all.len() == 4, "there are {} npm packages, not four", all.len());
    let is_plugin = |file: &PathBuf| {
        ["vitest", "playwright"].iter().any(|name| file.to_string_lossy().contains(name))
    };
    let (plugins, tgz): (Vec<PathBuf>, Vec<PathBuf>) = all.into_iter().partition(is_plugin);
    let wheel = files(packages, |name| name.ends_with(".whl"))?;
    let wheel = wheel.first().context("no wheel was made")?;
    // The folder is outside this repository. Inside, Cargo would treat it as part of the workspace.
    let place = std::env::temp_dir().join(format!("karat-dist-{}", std::process::id()));
    for way in ["npm", "python"] {
        let folder = place.join(way);
        fs::create_dir_all(&folder)?;
        let began = Instant::now();
        let step = |line: &str, command: &mut Command| {
            let own = Instant::now();
            command.current_dir(&folder).env("PATH", &path).env_remove("CARGO");
            // Authors write a first test on their own machine, without `CI`.
            command.env_remove("CI");
            command::run(command).with_context(|| format!("`{line}` fails"))?;
            eprintln!("{way}: {line}: {:.1} s", own.elapsed().as_secs_f32());
            Ok::<(), anyhow::Error>(())
        };
        let run: PathBuf = match way {
            "npm" => {
                fs::write(folder.join("package.json"), "{ \"private\": true }\n")?;
                let mut npm = Command::new("npm");
                npm.args(["install", "--no-audit", "--no-fund", "--offline"]).args(&tgz);
                step("npm install", &mut npm)?;
                folder.join("node_modules/.bin/karat")
            }
            _ => {
                step("python3 -m venv", Command::new("python3").args(["-m", "venv", "own"]))?;
                let mut pip = Command::new(folder.join("own/bin/python3"));
                pip.args(["-m", "pip", "install", "--quiet", "--no-index"]).arg(wheel);
                step("pip install", &mut pip)?;
                folder.join("own/bin/karat")
            }
        };
        fs::create_dir(folder.join("shaders"))?;
        fs::write(folder.join("shaders/tone.wgsl"), SHADER)?;
        step("karat init shaders", Command::new(&run).args(["init", "shaders"]))?;
        step("karat test shaders", Command::new(&run).args(["test", "shaders"]))?;
        eprintln!("{way}: {:.1} s in all", began.elapsed().as_secs_f32());
    }
    web(&place.join("web"), &[tgz, plugins].concat(), &path)?;
    fs::remove_dir_all(place).context("can't remove the folders of the walk")
}

/// Runs the commands of `docs/guide/web.md`: from an empty folder to a test that passes and a test that fails.
fn web(folder: &Path, packages: &[PathBuf], path: &std::ffi::OsStr) -> Result<()> {
    let page = fs::read_to_string(command::root().join("docs/guide/web.md"))?;
    let files = [
        ("vitest.config.ts", block(&page, "ts")?),
        ("shaders/tone.wgsl", block(&page, "wgsl")?),
        (
            "shaders/tone_test.wgsl",
            block(&page[page.find("Put a test beside this shader").unwrap_or(0)..], "wgsl")?,
        ),
        ("package.json", "{ \"private\": true, \"type\": \"module\" }\n"),
    ];
    fs::create_dir_all(folder.join("shaders"))?;
    for (name, text) in files {
        fs::write(folder.join(name), text)?;
    }
    let began = Instant::now();
    let here = |program: &str, words: &[&str]| {
        let mut command = Command::new(program);
        command
            .args(words)
            .current_dir(folder)
            .env("PATH", path)
            .env_remove("CARGO")
            .env_remove("CI");
        command
    };
    // Uses the current vitest or the version before it, depending on this machine's Node.
    let node = PathBuf::from("node");
    let is_new = setup::node_version(&node).is_some_and(|version| version >= suite::VITEST_NODE);
    let vitest = if is_new { "vitest@5" } else { "vitest@4" };
    let mut npm = here("npm", &["install", "--no-audit", "--no-fund", "--save-dev", vitest]);
    command::run(npm.args(packages)).context("npm doesn't install the packages")?;
    eprintln!("web: npm install: {:.1} s", began.elapsed().as_secs_f32());
    let run = || here("npx", &["vitest", "run"]).output().context("npx doesn't run");
    let green = run()?;
    let said = String::from_utf8_lossy(&green.stdout).into_owned();
    ensure!(green.status.success() && said.contains("2 passed"), "vitest isn't green:\n{said}");
    let test = folder.join("shaders/tone_test.wgsl");
    fs::write(&test, fs::read_to_string(&test)?.replace("0.5", "0.6"))?;
    let red = run()?;
    let said = String::from_utf8_lossy(&red.stderr).into_owned();
    ensure!(
        red.status.code() == Some(1) && said.contains("shaders/tone_test.wgsl:6:5"),
        "vitest isn't red:\n{said}"
    );
    eprintln!("web: {:.1} s in all", began.elapsed().as_secs_f32());
    Ok(())
}

/// Returns the first code block of a language on a page.
fn block<'p>(page: &'p str, language: &str) -> Result<&'p str> {
    let found =
        page.split_once(&format!("```{language}\n")).and_then(|(_, rest)| rest.split_once("```"));
    found.map(|(text, _)| text).with_context(|| format!("the page has no block of {language}"))
}

/// A shader to test, as a web developer could write it.
const SHADER: &str = "/// Reinhard's curve.\nfn reinhard(luminance: f32) -> f32 {\n    \
                      return luminance / (1.0 + luminance);\n}\n";
