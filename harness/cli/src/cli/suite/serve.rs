//! Runs tests on request. `karat watch` starts this process.

use std::collections::{BTreeSet, HashMap};
use std::io::{BufRead, Write};
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};

use karat::Package;
use karat::unstable::record::FileRead;
use karat::unstable::reflect::{Dependence, Invalid, Validated};
use karat_suite::{Suite, Test, Wrong};

use super::super::project::Project;
use super::super::search::Found;
use super::super::watch::{Reads, Request, Said};
use super::super::{Ending, Outcome, PackageArgs, check, resolved};
use super::latest::Latest;
use super::{each, host};

/// The text of the shaders that each test linked and of the files that it read, or `None` if the text is unknown.
type Known = HashMap<String, Option<String>>;

pub(super) fn run(folder: &Path, out: &mut dyn Write) -> Outcome {
    std::panic::set_hook(Box::new(|_| {}));
    Dependence::unwanted();
    let whole = Whole::of(folder)?;
    let (mut known, mut latest) = (Known::new(), Latest::default());
    for request in requests(|| {}) {
        karat::unstable::workspace::refresh();
        // This must come before the tests are read: the tests don't judge a file that is saved later.
        let files = latest.files(&request.changed);
        let done = match Suite::open(folder) {
            Ok(suite) if request.report.is_some() => {
                let is_there = |name: &str| suite.tests.iter().any(|test| test.name == name);
                latest.write(&request.report.unwrap_or_default(), is_there)
            }
            Ok(mut suite) => {
                if !whole.is_judged(&suite) {
                    suite.broken.retain(|broken| broken.is_file);
                }
                let validates = request.validate && whole.is_judged(&suite);
                // Another compiler runs in parallel, because it takes as long as the tests.
                std::thread::scope(|scope| {
                    let package = &whole.found.package;
                    let validity = validates.then(|| scope.spawn(|| package.try_is_valid()));
                    let (known, latest) = (&mut known, &mut latest);
                    let mut said = answer(&suite, folder, &request, &files, known, latest, out)?;
                    if let (Some(validity), Said::Done { broken, invalid, remarks, .. }) =
                        (validity, &mut said)
                    {
                        let found = validity.join().unwrap_or_else(|panic| resume_unwind(panic));
                        (*invalid, *remarks) = whole.validity(found, broken);
                    }
                    Ok::<_, anyhow::Error>(said)
                })?
            }
            Err(error) => {
                known.clear();
                Said::failed(error.to_string())
            }
        };
        say(&done, out)?;
    }
    Ok(Ending::Good)
}

/// Receives the requests. At the end of standard input, ends this process and its programs, even if a shader hangs.
pub(super) fn requests(at_end: impl FnOnce() + Send + 'static) -> Receiver<Request> {
    let (sender, requests) = channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            if let Ok(request) = serde_json::from_str(&line)
                && sender.send(request).is_err()
            {
                return;
            }
        }
        at_end();
        std::process::exit(0);
    });
    requests
}

fn answer(
    suite: &Suite,
    folder: &Path,
    request: &Request,
    files: &HashMap<PathBuf, FileRead>,
    known: &mut Known,
    latest: &mut Latest,
    out: &mut dyn Write,
) -> anyhow::Result<Said> {
    karat::unstable::run::host(host(suite, folder, &[]));
    let no_frames = std::env::var("KARAT_FRAMES").is_ok_and(|frames| frames == "off");
    let wanted = suite.tests.iter().filter(|test| test.is_about(&request.filter));
    let left_out = |test: &&Test| no_frames && test.is_frame();
    let (idle, mut tests): (Vec<&Test>, Vec<&Test>) = wanted.partition(left_out);
    // Failed tests run first.
    tests.sort_by_key(|test| !request.first.contains(&test.name));
    let all: BTreeSet<String> = tests.iter().map(|test| test.name.clone()).collect();
    // The watching process drops the verdict of a removed test. If the test comes back, it runs.
    known.retain(|name, _| all.contains(name));
    let is_asked = |test: &&Test| request.only.as_ref().is_none_or(|only| test.name == *only);
    let mut concerned = Vec::new();
    for test in tests.into_iter().filter(is_asked) {
        let normalized_text = suite.normalized_text(test);
        let same = normalized_text.is_some() && known.get(&test.name) == Some(&normalized_text);
        if same && !request.all && latest.renew(&test.name, files) {
            continue;
        }
        known.insert(test.name.clone(), normalized_text);
        concerned.push(test);
    }
    let asked: Vec<&str> = concerned.iter().map(|test| &*test.name).collect();
    let (concerned, unsound) = suite.sound(concerned);
    // A test that can't run has no verdict. It is tried again after each edit.
    let runs = |name: &&str| concerned.iter().any(|test| test.name == **name);
    asked.into_iter().filter(|name| !runs(name)).for_each(|name| drop(known.remove(name)));
    // The reply about a single test has the reason why the test can't run.
    if let (Some(only), Some(broken)) = (&request.only, unsound.first())
        && concerned.is_empty()
    {
        say(&Said::Test { name: only.clone(), wrong: Some(broken.wrong.clone()) }, out)?;
    }
    each(suite, &concerned, &mut |test, verdict| {
        say(&Said::Test { name: test.name.clone(), wrong: verdict.err() }, out)
    })?;
    latest.take_own(concerned.iter().map(|test| &*test.name));
    let broken = suite.broken.iter().chain(&unsound).map(|broken| broken.wrong.clone()).collect();
    let reads = match suite.package.is_printed() {
        true => Reads::Any,
        false => Reads::These(suite.reads().iter().map(|file| resolved(file)).collect()),
    };
    let (idle, invalid, remarks) = (idle.len(), None, None);
    let records = request.only.as_ref().map_or(Vec::new(), |only| latest.of(only).to_vec());
    Ok(Said::Done { tests: all, broken, idle, invalid, remarks, reads, records })
}

/// The whole package with the settings of its project. As in `karat test`, modules that no test links must be valid,
/// too.
struct Whole {
    project: Project,
    found: Found,
}

impl Whole {
    fn of(folder: &Path) -> anyhow::Result<Self> {
        let place = folder.canonicalize()?;
        let around = if place.is_file() { place.parent().unwrap_or(&place) } else { &place };
        let project = Project::around(around)?;
        let known = match project.is_cargo() {
            true => project.search(&PackageArgs::default())?,
            false => Vec::new(),
        };
        let known = known.into_iter().find(|one| one.place().as_ref() == Some(&place));
        let found = match known {
            Some(found) => found,
            None => Found::stated(Package::open(&place)?),
        };
        Ok(Self { project, found })
    }

    /// Checks if invalid modules make a run fail. Returns `false` for a folder that no manifest declares and no test
    /// uses.
    fn is_judged(&self, suite: &Suite) -> bool {
        let is_used =
            || self.found.place().is_some_and(|place| self.project.recorded().contains(&place));
        self.found.stated || !suite.tests.is_empty() || is_used()
    }

    /// Returns the errors in modules, without the errors in `told`. Also returns the remarks of compilers other than
    /// naga.
    fn validity(
        &self,
        found: Result<Validated, Invalid>,
        told: &[Wrong],
    ) -> (Option<String>, Option<String>) {
        match found {
            Ok(found) => (None, check::remarks(&found.opinion)),
            Err(invalid) => {
                let remarks = invalid.opinion().and_then(check::remarks);
                (self.invalid(invalid, told), remarks)
            }
        }
    }

    fn invalid(&self, mut invalid: Invalid, told: &[Wrong]) -> Option<String> {
        let Found { package, stated } = &self.found;
        if !stated {
            let uses = check::recorded_uses(&self.project).unwrap_or_default();
            invalid = check::as_used(invalid, package, &uses)?;
        }
        let Invalid::Modules { errors, .. } = invalid else { return Some(invalid.to_string()) };
        let mut texts: Vec<String> = errors.iter().map(|(_, error)| error.to_string()).collect();
        texts.retain(|text| !told.iter().any(|wrong| wrong.message == *text));
        texts.dedup();
        (!texts.is_empty()).then(|| texts.join("\n"))
    }
}

pub(super) fn say(said: &Said, out: &mut dyn Write) -> std::io::Result<()> {
    let line = serde_json::to_string(said).expect("it is plain data");
    // A driver may have printed text without a line end.
    write!(out, "\n{line}\n")?;
    out.flush()
}
