//! `karat manual`

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use serde::Deserialize;

use super::{Ending, Outcome};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Prints the path of the manual, and opens no browser
    #[arg(long)]
    no_open: bool,
}

/// The part of the output of `cargo metadata` that this command reads.
#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
    target_directory: PathBuf,
    workspace_root: PathBuf,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    manifest_path: PathBuf,
}

/// Builds the manual of the karat version that the project tests with. Cargo 1.95 panics when it documents a
/// dev-dependency, so Karat makes a temporary package with a normal dependency on karat.
pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut asked = Command::new(&cargo);
    let asked = asked.args(["metadata", "--format-version", "1"]).stderr(Stdio::inherit());
    let output =
        asked.output().context("can't run `cargo`, which builds the manual from karat's sources: install Rust, or read `docs/guide` in karat's repository")?;
    ensure!(
        output.status.success(),
        "`cargo metadata` fails: run `karat manual` in a Cargo project that uses karat"
    );
    let Metadata { packages, target_directory, workspace_root } =
        serde_json::from_slice(&output.stdout)?;
    let karat = packages.iter().find(|package| package.name == "karat");
    let karat = karat
        .context("this project doesn't use karat: run `cargo add --dev karat` or `karat init`")?;
    let folder = target_directory.join("karat-manual");
    let own = karat.manifest_path.parent().context("karat's Cargo.toml has no parent folder")?;
    write_package(&folder, own, &workspace_root)?;
    let mut document = Command::new(&cargo);
    document
        .args(["doc", "--no-deps", "--package", "karat", "--manifest-path"])
        .arg(folder.join("Cargo.toml"));
    document.arg("--target-dir").arg(&target_directory).stdout(Stdio::null());
    ensure!(document.status()?.success(), "`cargo doc` fails");
    let page = target_directory.join("doc/karat/index.html");
    ensure!(page.is_file(), "`cargo doc` didn't write the page `{}`", page.display());
    writeln!(out, "{}", page.display())?;
    if !args.no_open {
        open(&page);
    }
    Ok(Ending::Good)
}

/// Writes a package that depends only on karat, and copies the project's `Cargo.lock` into it.
fn write_package(folder: &Path, karat: &Path, workspace: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder.join("src"))?;
    let manifest = format!(
        "[package]\nname = \"karat-manual\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n[workspace]\n\n\
         [dependencies]\nkarat = {{ path = {karat:?} }}\n"
    );
    std::fs::write(folder.join("Cargo.toml"), manifest)?;
    std::fs::write(folder.join("src/lib.rs"), "")?;
    let lock = workspace.join("Cargo.lock");
    if lock.is_file() {
        std::fs::copy(lock, folder.join("Cargo.lock"))?;
    }
    Ok(())
}

/// Shows a page in the default browser. If the system has no browser, the printed path is enough.
fn open(page: &Path) {
    let (program, arguments): (&str, &[&str]) = match std::env::consts::OS {
        "macos" => ("open", &[]),
        "windows" => ("cmd", &["/C", "start", ""]),
        _ => ("xdg-open", &[]),
    };
    let mut browser = Command::new(program);
    let browser = browser.args(arguments).arg(page).stdout(Stdio::null()).stderr(Stdio::null());
    if browser.status().is_err() {
        eprintln!("can't open the page with `{program}`: open the page in your browser");
    }
}
