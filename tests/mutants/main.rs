//! Plants faults in the shader library, and checks that the library's own tests detect each fault.
//!
//! Each fault is one change in one module. `KARAT_OVERLAY` gives the changed module to the library's tests, and an
//! ordinary check must fail. The table `target/karat/mutants.md` lists the checks that failed.
//!
//! The faults in `faults.rs` are written by hand. `cargo ci mutants` generates other faults.

mod faults;
mod library;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path as FilePath, PathBuf};
use std::time::Instant;

use faults::{FAULTS, Fault, SURVIVORS};
use library::{Caught, Library, Outcome};
use rayon::prelude::*;

/// The modules with functions that tests call. `FAULTS` must have a fault for each of these modules.
const MODULES: [&str; 15] = [
    "brdf",
    "camera",
    "compensation",
    "distribution",
    "environment",
    "fresnel",
    "geometry",
    "irradiance",
    "layering",
    "materials",
    "math",
    "radiometry",
    "sampling",
    "sensor",
    "specular",
];

#[test]
fn the_table_is_well_formed() {
    let mut seen = BTreeSet::new();
    for fault in FAULTS.iter().chain(SURVIVORS.iter().map(|(fault, _)| fault)) {
        let Fault { module, original, replacement, .. } = fault;
        assert!(seen.insert((module, original, replacement)), "twice: {fault}");
        let found = library::text(module).matches(original).count();
        assert_eq!(found, 1, "`{original}` stands {found} times in {module}.wgsl");
        assert_ne!(original, replacement, "{module}");
    }
    for module in MODULES {
        assert!(FAULTS.iter().any(|fault| fault.module == module), "{module} has no fault");
    }
    assert!(FAULTS.len() >= 50, "{} faults", FAULTS.len());
}

/// The faults to try: all of them with `SUITES=whole`. Otherwise, the first fault of each module and every fourth
/// fault.
fn tried() -> Vec<&'static Fault> {
    const APART: usize = 4;
    let whole = frames::are_suites_whole();
    let mut modules = BTreeSet::new();
    let is_tried = |(at, fault): &(usize, &Fault)| {
        // Inserts the module of every fault.
        let is_first = modules.insert(fault.module);
        whole || is_first || at % APART == 0
    };
    FAULTS.iter().enumerate().filter(is_tried).map(|(_, fault)| fault).collect()
}

/// Each fault fails the test that `FAULTS` names for it. Each survivor passes all tests of its module. Without a fault,
/// all these tests pass.
// Lesson 28: faults picked by hand
#[test]
fn every_fault_is_caught_by_an_ordinary_check() {
    let start = Instant::now();
    let library = Library::built();
    let mut problems = Vec::new();
    let faults = tried();
    problems.extend(library.control(&faults).err());
    let outcomes: Vec<Outcome> = faults.par_iter().map(|fault| library.run(fault)).collect();
    let mut table = String::from(
        "| module | fault | kind | test | caught by | failing | worst error | asserted |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for (fault, outcome) in faults.iter().zip(&outcomes) {
        match outcome {
            Outcome::Caught(checks) => table.push_str(&row(fault, checks)),
            Outcome::Survived => {
                problems.push(format!("{fault}: no check of {} fails", fault.test))
            }
            Outcome::Broken(why) => problems.push(format!("{fault}: {why}")),
        }
    }
    let survivors: Vec<Outcome> =
        SURVIVORS.par_iter().map(|(fault, _)| library.run_module(fault)).collect();
    for ((fault, reason), outcome) in SURVIVORS.iter().zip(&survivors) {
        match outcome {
            Outcome::Survived => {
                table.push_str(&format!(
                    "| {} | {} | {} | all | survives: {reason} | | | |\n",
                    fault.module,
                    change(fault),
                    fault.kind
                ));
            }
            Outcome::Caught(checks) => problems.push(format!(
                "{fault}: a declared survivor, but \
                {} of test {} fails",
                checks[0].check, checks[0].test
            )),
            Outcome::Broken(why) => problems.push(format!("{fault}: {why}")),
        }
    }
    let caught = outcomes.iter().filter(|outcome| matches!(outcome, Outcome::Caught(_))).count();
    let summary = format!(
        "{caught} of {} faults caught, of {} that there are; {} declared survivors, {:.0} s\n",
        faults.len(),
        FAULTS.len(),
        SURVIVORS.len(),
        start.elapsed().as_secs_f64()
    );
    publish(&table, &summary);
    assert!(problems.is_empty(), "\n{}", problems.join("\n"));
}

/// A row of the table, with the worst error of the first check that failed.
fn row(fault: &Fault, checks: &[Caught]) -> String {
    let names: Vec<String> = checks.iter().map(|caught| format!("`{}`", caught.check)).collect();
    let Caught { failing, worst, asserted, test, .. } = &checks[0];
    let target = fault.test.split("::").next().unwrap_or_default();
    format!(
        "| {} | {} | {} | {target}::{test} | {} | {failing} | {worst} | {} |\n",
        fault.module,
        change(fault),
        fault.kind,
        names.join(", "),
        asserted.replace('|', "\\|"),
    )
}

fn change(fault: &Fault) -> String {
    let code = |text: &str| {
        let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
        format!("`{}`", line.replace('|', "\\|"))
    };
    format!("{} → {}", code(fault.original), code(fault.replacement))
}

/// Writes the table to `target/karat/mutants.md` and prints it, even if the test passes.
fn publish(table: &str, summary: &str) {
    let path = output().join("karat/mutants.md");
    let text = format!("# Faults and the checks that catch them\n\n{table}\n{summary}");
    std::fs::create_dir_all(path.parent().expect("in a folder")).expect("a folder for output");
    std::fs::write(&path, text).expect("the table is written");
    let shown = format!("{table}{summary}{}\n", path.display());
    std::io::stdout().write_all(shown.as_bytes()).expect("the table is shown");
}

/// Cargo's output folder, such as `target`.
fn output() -> PathBuf {
    FilePath::new(env!("CARGO_TARGET_TMPDIR")).parent().expect("in the output").to_owned()
}
