//!
//! `karat suite`: runs the tests of a folder of shaders. `karat test` runs this command as a separate process.
//!
//! If a shader hangs or crashes a driver, only the separate process ends, as with a test program of Cargo. The process
//! prints verdicts in the format of Rust's test runner.

use std::collections::HashMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::channel;

use karat::Package;
use karat::package::Feature;
use karat::unstable::output::counted;
use karat::unstable::run::Host;
use karat_suite::{Broken, Suite, Test, Wrong};

use super::{Ending, Outcome, featured};

pub(super) mod cargo;
mod latest;
mod serve;

#[derive(clap::Args)]
pub(super) struct Args {
    /// Folder of shaders, or one file
    folder: PathBuf,
    /// Runs only tests whose name contains this text, or that call a function whose name contains it
    filter: Option<String>,
    /// Runs only the test with exactly this name
    #[arg(long)]
    exact: bool,
    /// Leaves frames out
    #[arg(long, alias = "functions")]
    no_frames: bool,
    /// Runs tests whenever a line of standard input asks for it, and prints verdicts as lines of JSON
    #[arg(long, hide = true)]
    serve: bool,
    /// With `--serve`, runs the Rust tests of the Cargo project in the folder
    #[arg(long, hide = true)]
    cargo: bool,
    /// Ends when standard input ends, because then the program that waits for the verdicts has ended
    #[arg(long, hide = true)]
    attended: bool,
    /// Prints the names, and runs nothing
    #[arg(long)]
    list: bool,
    /// Turns a feature on (`@if(NAME)`, `#ifdef NAME`), or sets the feature's value (`NAME=3`, `NAME=false`); may be
    /// repeated
    #[arg(long = "feature", value_name = "NAME[=VALUE]", value_parser = super::feature)]
    features: Vec<(String, Feature)>,
}

/// Returns the [`Host`] of a suite's tests, with the command that runs a test again, and the folder for failing inputs.
pub(super) fn host(suite: &Suite, folder: &Path, features: &[(String, Feature)]) -> Host {
    Host { folder: suite.folder.clone(), ..host_of(folder, features) }
}

/// Returns the [`Host`] of the tests in a folder of shaders. Failing inputs are stored in this folder, too.
pub(super) fn host_of(folder: &Path, features: &[(String, Feature)]) -> Host {
    let folder_name = karat::unstable::diagnostic::shown(folder);
    let features = written(features).flat_map(|feature| ["--feature".to_owned(), feature]);
    let words = ["karat", "test", &folder_name].map(str::to_owned).into_iter();
    Host {
        command: words.chain(features).chain(["--exact".to_owned()]).collect(),
        folder: folder.to_owned(),
        target: "suite".to_owned(),
        output: folder.join(".karat").join("run"),
    }
}

/// Formats features as arguments of a program: `foo=true`.
pub(super) fn written(features: &[(String, Feature)]) -> impl Iterator<Item = String> {
    features.iter().map(|(name, value)| format!("{name}={value}"))
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    if args.cargo {
        return cargo::run(&args.folder, out);
    }
    if args.serve {
        return serve::run(&args.folder, out);
    }
    if args.attended {
        std::thread::spawn(|| {
            drop(std::io::copy(&mut std::io::stdin(), &mut std::io::sink()));
            std::process::exit(1);
        });
    }
    // The message of a panic is printed later, with the name of the test.
    std::panic::set_hook(Box::new(|_| {}));
    let suite = Suite::of(featured(Package::open(&args.folder)?, &args.features))?;
    let wanted = |test: &Test| match &args.filter {
        Some(filter) if args.exact => test.name == *filter,
        Some(filter) => test.is_about(filter),
        None => true,
    };
    let frames = !args.no_frames;
    let tests: Vec<&Test> =
        suite.tests.iter().filter(|test| wanted(test) && (frames || !test.is_frame())).collect();
    if args.list {
        for test in &tests {
            writeln!(out, "{}: test", test.name)?;
        }
        return Ok(Ending::Good);
    }
    karat::unstable::run::host(host(&suite, &args.folder, &args.features));
    let (tests, unsound) = suite.sound(tests);
    // Unreadable files count under every filter, because their tests are unknown.
    let broken: Vec<&Broken> = suite.broken.iter().chain(&unsound).collect();
    writeln!(out, "running {}", counted(tests.len() + broken.len(), "test"))?;
    let mut failures: Vec<(String, Wrong)> = Vec::new();
    for broken in &broken {
        suite.record_broken(broken);
        writeln!(out, "test {} ... FAILED", broken.name)?;
        failures.push((broken.name.clone(), broken.wrong.clone()));
    }
    each(&suite, &tests, &mut |test, verdict| {
        let word = if verdict.is_ok() { "ok" } else { "FAILED" };
        writeln!(out, "test {} ... {word}", test.name)?;
        out.flush()?;
        failures.extend(verdict.err().map(|wrong| (test.name.clone(), wrong)));
        Ok(())
    })?;
    let passed = tests.len() + broken.len() - failures.len();
    if !failures.is_empty() {
        failures.sort_by(|(one, _), (other, _)| one.cmp(other));
        writeln!(out, "\nfailures:\n")?;
        // A race, or a path that doesn't open, makes many tests fail with the same message. Karat prints this message
        // once.
        let mut told: HashMap<String, &str> = HashMap::new();
        for (name, wrong) in &failures {
            writeln!(out, "---- {name} ----")?;
            let first = wrong.common().map(|common| *told.entry(common).or_insert(name));
            match first.filter(|first| *first != name) {
                Some(first) => {
                    let place = wrong.place.iter().map(|place| format!("  --> {place}\n"));
                    let place: String = place.collect();
                    writeln!(
                        out,
                        "error: {}\n{place}  the test `{first}` fails with the same error\n",
                        wrong.headline
                    )?;
                }
                None => writeln!(out, "{}\n", wrong.message.trim_end())?,
            }
        }
    }
    let word = if failures.is_empty() { "ok" } else { "FAILED" };
    writeln!(out, "test result: {word}. {passed} passed; {} failed", failures.len())?;
    Ok(if failures.is_empty() { Ending::Good } else { Ending::Bad })
}

/// The function that receives each verdict.
type Heard<'h> = &'h mut dyn FnMut(&Test, Result<(), Wrong>) -> std::io::Result<()>;

/// Runs tests on all cores, and passes each verdict to `heard` as soon as the test ends.
fn each(suite: &Suite, tests: &[&Test], heard: Heard<'_>) -> std::io::Result<()> {
    let next = AtomicUsize::new(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let groups = &Suite::groups(tests);
    // If there is only one test, starting threads would take noticeable time.
    if let [test] = tests {
        return heard(test, suite.run_with(test, groups));
    }
    let (sender, verdicts) = channel();
    std::thread::scope(|scope| {
        for _ in 0..threads.min(tests.len()) {
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || {
                while let Some(test) = tests.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if sender.send((*test, suite.run_with(test, groups))).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        verdicts.into_iter().try_for_each(|(test, verdict)| heard(test, verdict))
    })
}
