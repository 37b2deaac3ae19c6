//! Shaders that others wrote: Karat's verdict on each file beside naga's.
//!
//! `cargo run --example corpus -- FOLDER...` reads every `.wgsl` and `.wesl` file below the folders,
//! each as a package of one file. What naga accepts Karat must accept, and what it calls of such a
//! file must be the author's bytes. `cargo ci corpus NAME@VERSION...` fetches crates and runs it.

use std::collections::BTreeMap;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use karat::Package;
use karat::probe::{ProbeError, Probed};
use karat::reflect::{Program, ReflectError};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// What became of the files of a folder.
#[derive(Default)]
struct Row {
    files: usize,
    /// Accepted by naga as they are.
    naga: usize,
    /// Valid for Karat: imports and conditions of WESL's are linked.
    karat: usize,
    functions: usize,
    callable: usize,
    slowest: Duration,
}

fn main() -> ExitCode {
    let mut rows = BTreeMap::new();
    let mut faults = Vec::new();
    for folder in std::env::args().skip(1) {
        let mut files = Vec::new();
        collect(Path::new(&folder), &mut files);
        files.sort();
        let row: &mut Row = rows.entry(folder.clone()).or_default();
        for file in files {
            let began = Instant::now();
            match catch_unwind(|| read(&file)) {
                Ok(Ok(found)) => {
                    row.naga += usize::from(found.naga);
                    row.karat += usize::from(found.karat);
                    row.functions += found.functions;
                    row.callable += found.callable;
                }
                Ok(Err(fault)) => faults.push(format!("{}: {fault}", file.display())),
                Err(_) => faults.push(format!("{}: a panic", file.display())),
            }
            row.files += 1;
            row.slowest = row.slowest.max(began.elapsed());
        }
    }
    let text = rows.iter().map(|(folder, row)| {
        format!(
            "{:4} files  {:4} valid for naga  {:4} for Karat  {:5} functions  {:5} callable  \
             slowest {:4} ms  {folder}\n",
            row.files,
            row.naga,
            row.karat,
            row.functions,
            row.callable,
            row.slowest.as_millis()
        )
    });
    let mut text: String = text.collect();
    if rows.values().all(|row| row.files == 0) {
        faults.push("no shader was found".to_owned());
    }
    for fault in &faults {
        text.push_str(&format!("fault: {fault}\n"));
    }
    let written = std::io::Write::write_all(&mut std::io::stdout(), text.as_bytes());
    if written.is_ok() && faults.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

struct Found {
    naga: bool,
    karat: bool,
    functions: usize,
    callable: usize,
}

/// Both verdicts on a file, or how they contradict each other.
fn read(file: &Path) -> Result<Found, String> {
    let text = std::fs::read(file).map_err(|error| error.to_string())?;
    let Ok(text) = String::from_utf8(text) else {
        return Ok(Found { naga: false, karat: false, functions: 0, callable: 0 });
    };
    let module = naga::front::wgsl::parse_str(&text).ok();
    let naga = module.is_some_and(|module| {
        Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module).is_ok()
    });
    let package = Package::open(file).map_err(|error| error.to_string())?;
    let program = Program::of_module(&package, "");
    let mut found = Found { naga, karat: program.is_ok(), functions: 0, callable: 0 };
    match (&program, naga) {
        (Err(error), true) => return Err(format!("naga accepts it, Karat says: {error}")),
        (Err(_), false) => return Ok(found),
        (Ok(program), true) if program.text() != text => {
            return Err("naga accepts it, and Karat changes it".to_owned());
        }
        (Ok(_), _) => {}
    }
    let functions = package.functions().map_err(|error| error.to_string())?;
    for item in functions.into_iter().filter(|item| !item.entry_point) {
        found.functions += 1;
        match Probed::new(&package, &item.name) {
            Ok(probed) => {
                found.callable += 1;
                let span = &probed.function().span;
                let author = span.file.text.get(span.range.clone()).unwrap_or_default();
                if !author.contains(&format!("fn {}", item.name)) && !author.contains(&item.name) {
                    return Err(format!("`{}` isn't at {span}", item.name));
                }
                if naga && !probed.kernel().contains(author) {
                    return Err(format!("`{}` is linked with other bytes", item.name));
                }
            }
            Err(ProbeError::Reflect(ReflectError::Unprobeable(_))) => {}
            Err(error) => return Err(format!("`{}`: {error}", item.name)),
        }
    }
    Ok(found)
}

/// Shader files below a folder; links to folders aren't followed.
fn collect(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        if is_folder {
            collect(&path, found);
        } else if path.extension().is_some_and(|e| e == "wgsl" || e == "wesl") {
            found.push(path);
        }
    }
}
