//! Faults planted in the shader library, and which of its own tests sees each.
//!
//! A test suite is worth what it catches. Here each fault is one change of one module, given to the
//! library's tests as an overlay (`KARAT_OVERLAY`), and an ordinary check has to fail: the record
//! says which. The table is written to `target/karat/mutants.md`.
//!
//! Some faults are picked by hand (`faults.rs`). The others are made by a program (`maker.rs`), a
//! few of them here and all by `cargo ci mutants`; what became of them is written to
//! `target/karat/mutants-made.md`.

mod faults;
mod hunt;
mod library;

mod program;

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path as FilePath, PathBuf};
use std::time::Instant;

use faults::{FAULTS, Fault, SURVIVORS};
use hunt::Hunt;
use library::{Caught, Library, Outcome};
use program::Selection;
use rayon::prelude::*;

/// Modules with functions that tests call, each of which needs a fault that is seen.
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

/// The faults that are tried: in a sample the first of each module, and each fourth one.
fn tried() -> Vec<&'static Fault> {
    const APART: usize = 4;
    let whole = frames::are_suites_whole();
    let mut modules = BTreeSet::new();
    let is_tried = |(at, fault): &(usize, &Fault)| {
        // Of each fault the module is noted.
        let is_first = modules.insert(fault.module);
        whole || is_first || at % APART == 0
    };
    FAULTS.iter().enumerate().filter(is_tried).map(|(_, fault)| fault).collect()
}

/// Every fault is seen by the test that the table names, every survivor survives all tests of its
/// module, and without a fault all of these tests pass.
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

/// The list of survivors has reasons, and names mutants that there are; each module has judges.
#[test]
fn the_list_of_survivors_is_well_formed() {
    let all = program::candidates();
    let complaints = program::complaints(&program::listed(), &all);
    assert!(complaints.is_empty(), "\n{}", complaints.join("\n"));
    let judged: BTreeSet<String> =
        program::JUDGES.iter().map(|(module, _)| (*module).to_owned()).collect();
    let modules = shaders::PBR.modules().expect("the library is readable").into_iter();
    let own: BTreeSet<String> = modules.filter(|name| !name.starts_with("as_written")).collect();
    assert_eq!(judged, own);
    assert!(all.len() > 2000, "{} mutants", all.len());
}

/// Mutants that the program makes, each killed by a test of its module, or listed with a reason. By
/// default a sample; `cargo ci mutants` takes all of them.
#[test]
fn mutants_made_by_a_program_are_killed() {
    let sample = if frames::are_suites_whole() { 48 } else { 12 };
    let selection = Selection::from_environment("mutants_made_by_a_program_are_killed");
    let candidates = selection.of(program::candidates());
    let listed = program::listed();
    let mut hunt = Hunt::default();
    if let Selection::Sample(seed) = selection {
        println!("{sample} mutants; the same again: MUTANTS_SEED={seed}");
        let library = hunt::judges(&candidates);
        hunt.run(&library, candidates, &listed, sample);
    } else {
        let library = hunt::judges(&candidates);
        hunt.control(&library, &candidates);
        let mut waiting = candidates.into_iter().peekable();
        while let Some(module) = waiting.peek().map(|candidate| candidate.module) {
            let of_module = std::iter::from_fn(|| waiting.next_if(|one| one.module == module));
            hunt.run(&library, of_module.collect(), &listed, usize::MAX);
            publish_made(&hunt); // all of them take hours: what is done is told
        }
    }
    publish_made(&hunt);
    let problems = hunt.problems();
    assert!(
        problems.is_empty(),
        "\n{}\nto try one again: MUTANTS=module:line:column",
        problems.join("\n")
    );
}

fn publish_made(hunt: &Hunt) {
    let report = hunt.report();
    let path = output().join("karat/mutants-made.md");
    std::fs::create_dir_all(path.parent().expect("in a folder")).expect("a folder for output");
    std::fs::write(&path, &report).expect("the report is written");
    let numbers = report.split("\n## ").next().unwrap_or_default();
    let shown = format!("{numbers}\n{}\n", path.display());
    std::io::stdout().write_all(shown.as_bytes()).expect("the report is shown");
}

/// A row of the table: the check whose worst error is shown is the first that failed.
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

/// Writes the table where the records of `karat test` are, and shows it, also if the test passes.
fn publish(table: &str, summary: &str) {
    let path = output().join("karat/mutants.md");
    let text = format!("# Faults and the checks that catch them\n\n{table}\n{summary}");
    std::fs::create_dir_all(path.parent().expect("in a folder")).expect("a folder for output");
    std::fs::write(&path, text).expect("the table is written");
    let shown = format!("{table}{summary}{}\n", path.display());
    std::io::stdout().write_all(shown.as_bytes()).expect("the table is shown");
}

/// Cargo's folder of output.
fn output() -> PathBuf {
    FilePath::new(env!("CARGO_TARGET_TMPDIR")).parent().expect("in the output").to_owned()
}
