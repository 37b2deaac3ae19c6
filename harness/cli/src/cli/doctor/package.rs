//! `karat doctor PACKAGE`: what keeps modules from being whole, and the lines of `karat.toml` that mend it.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use karat::Package;
use karat::package::PackageError;
use karat::unstable::diagnostic::{Mend, shown};
use karat::unstable::image::write_whole;
use karat::unstable::output::counted;
use karat::unstable::reflect::{Program, ReflectError};
use serde::Serialize;

use super::super::project::Project;
use super::super::table::{BAD, DIM, GOOD, HEAD};
use super::super::{Ending, Outcome, write_json};

/// Rounds of lines: one error of a module hides the next.
const ROUNDS: usize = 32;

/// Modules that are told by name: a screen has no more.
const TOLD: usize = 12;

/// What a value is where only the engine knows it.
const MADE_UP: &str = "made up: write what your engine gives";

/// What a feature is that decides what there is.
const VARIANT: &str = "a name needs it: your engine may set another variant";

/// What a text is that only the engine knows.
const TEXT: &str = "empty: write what your engine puts there";

/// What a line can't say by itself.
fn advice(mend: &Mend) -> Option<String> {
    match mend {
        Mend::Preprocess => Some("name a program that expands it: preprocess = [..]".to_owned()),
        Mend::Dependency(name) => Some(format!(
            "say where it is: [dependencies] {name} = {{ path = \"../{name}\" }}, or {{ crate = \"{name}@1.2.3\" }}"
        )),
        _ => None,
    }
}

/// A line of `karat.toml`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
struct Line {
    section: &'static str,
    key: String,
    value: String,
    about: &'static str,
}

impl Line {
    fn text(&self) -> String {
        match self.about {
            "" => format!("{} = {}", self.key, self.value),
            about => format!("{} = {} # {about}", self.key, self.value),
        }
    }
}

/// What isn't whole.
#[derive(Clone, Debug, Serialize)]
struct Left {
    module: String,
    location: Option<String>,
    message: String,
    /// What only its author can write into karat.toml.
    advice: Option<String>,
}

#[derive(Serialize)]
struct Report {
    package: String,
    modules: usize,
    /// Modules that are whole as the package is.
    whole: usize,
    lines: Vec<Line>,
    /// Modules that are whole with these lines.
    then_whole: usize,
    left: Vec<Left>,
    written: bool,
}

/// A package with the lines that were found for it.
struct Trial<'p> {
    package: &'p Package,
    file: PathBuf,
    /// What the file has already.
    text: String,
    table: toml::Table,
    modules: Vec<String>,
    lines: Vec<Line>,
}

pub(super) fn run(folder: &Path, write: bool, json: bool, out: &mut dyn Write) -> Outcome {
    let package = Package::open(folder)?;
    let mut trial = Trial::of(&package)?;
    let began = trial.judged();
    trial.mend();
    let left = trial.judged();
    // Lines that break what is whole are no advice.
    let is_worse = left.len() > began.len();
    if is_worse {
        trial.lines.clear();
    }
    let left = if is_worse { began.clone() } else { left };
    let writes = write && !trial.lines.is_empty();
    if writes {
        write_whole(&trial.file, trial.with(&trial.lines).as_bytes())
            .with_context(|| format!("can't write `{}`", shown(&trial.file)))?;
    }
    let modules = trial.modules.len();
    let report = Report {
        package: package.name(),
        modules,
        whole: modules - began.len(),
        then_whole: modules - left.len(),
        left,
        written: writes,
        lines: trial.lines,
    };
    if json {
        write_json(&report, out)?;
    } else {
        write_text(&report, &shown(&trial.file), out)?;
    }
    let whole = if writes { report.then_whole } else { report.whole };
    Ok(if whole == modules { Ending::Good } else { Ending::Bad })
}

impl<'p> Trial<'p> {
    fn of(package: &'p Package) -> anyhow::Result<Self> {
        let root = package.root();
        let file =
            if root.is_dir() { root.join("karat.toml") } else { root.with_file_name("karat.toml") };
        let text = match std::fs::read_to_string(&file) {
            Ok(text) => text,
            Err(none) if none.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => {
                return Err(error).with_context(|| format!("can't read `{}`", shown(&file)));
            }
        };
        // What is wrong with the file itself is told as other commands tell it.
        let modules = package.modules()?;
        let table = text.parse().with_context(|| format!("`{}`", shown(&file)))?;
        Ok(Self { package, file, text, table, modules, lines: Vec::new() })
    }

    /// The text of the file with some lines.
    fn with(&self, lines: &[Line]) -> String {
        let mut text = self.text.clone();
        for line in lines {
            let head = format!("[{}]", line.section);
            let own = line.text();
            let is_head = |known: &str| known.split('#').next().unwrap_or_default().trim() == head;
            let place = text.lines().position(is_head);
            text = match place {
                Some(at) => {
                    let mut all: Vec<&str> = text.lines().collect();
                    all.insert(at + 1, &own);
                    all.join("\n") + "\n"
                }
                None => {
                    let gap = if text.is_empty() { "" } else { "\n" };
                    format!("{text}{gap}{head}\n{own}\n")
                }
            };
        }
        text
    }

    fn errors(&self, lines: &[Line]) -> Vec<(String, ReflectError)> {
        let package = self.package.unsaved(&self.file, &self.with(lines));
        let error = |module: &String| {
            let whole = Program::of_module(&package, module);
            whole.err().map(|error| (module.clone(), error))
        };
        self.modules.iter().filter_map(error).collect()
    }

    fn judged(&self) -> Vec<Left> {
        let errors = self.errors(&self.lines).into_iter();
        errors
            .map(|(module, error)| {
                let diagnostic = error.diagnostic();
                let message = match diagnostic {
                    Some(diagnostic) => diagnostic.message.clone(),
                    None => error.to_string(),
                };
                Left {
                    module,
                    location: diagnostic.and_then(|d| d.location()).map(ToString::to_string),
                    message: message.lines().next().unwrap_or_default().to_owned(),
                    advice: diagnostic.and_then(|d| advice(d.mend.as_ref()?)),
                }
            })
            .collect()
    }

    /// Adds lines for as long as errors name new ones.
    fn mend(&mut self) {
        let mut tried: BTreeSet<String> = BTreeSet::new();
        for _ in 0..ROUNDS {
            let errors = self.errors(&self.lines);
            let mut found: Vec<Line> = Vec::new();
            let mut conditions: Vec<Line> = Vec::new();
            for (_, error) in &errors {
                let mend = error.diagnostic().and_then(|diagnostic| diagnostic.mend.clone());
                for (line, condition) in self.lines_of(error, mend) {
                    if tried.insert(format!("{}.{}", line.section, line.key)) {
                        if condition { conditions.push(line) } else { found.push(line) }
                    }
                }
            }
            // One feature may exclude another: each is kept if it makes more modules whole than it breaks.
            for line in &conditions {
                let with = [&*self.lines, &found, std::slice::from_ref(line)].concat();
                if self.errors(&with).len() <= errors.len() {
                    found.push(line.clone());
                }
            }
            if found.is_empty() {
                return;
            }
            self.lines.extend(found);
        }
    }

    /// The lines that an error asks for; true of a feature that decides what there is.
    fn lines_of(&self, error: &ReflectError, mend: Option<Mend>) -> Vec<(Line, bool)> {
        let line = |section, key: &str, value: &str, about| {
            let (key, value) = (key.to_owned(), value.to_owned());
            Line { section, key, value, about }
        };
        if let ReflectError::Package(PackageError::UnknownFeature { unknown, .. }) = error {
            let names: Vec<String> = unknown.iter().map(|(name, _)| format!("{name:?}")).collect();
            let has =
                self.table.get("features").is_some_and(|own| own.get("set_by_engine").is_some());
            let list = line("features", "set_by_engine", &format!("[{}]", names.join(", ")), "");
            return if has { Vec::new() } else { vec![(list, false)] };
        }
        match mend {
            Some(Mend::Feature(name)) => vec![(line("features", &name, "4", MADE_UP), false)],
            Some(Mend::Condition(name)) => vec![(line("features", &name, "true", VARIANT), true)],
            Some(Mend::Text(name)) => vec![(line("values", &name, "\"\"", TEXT), false)],
            Some(Mend::Value(name)) => vec![(line("values", &name, "64", MADE_UP), false)],
            Some(Mend::Dependency(name)) => {
                let place = self.dependency(&name);
                place
                    .map(|place| (line("dependencies", &name, &place, ""), false))
                    .into_iter()
                    .collect()
            }
            _ => Vec::new(),
        }
    }

    /// Where a package lies that modules import from: beside this one, or in a crate that the project builds.
    fn dependency(&self, name: &str) -> Option<String> {
        let root = self.package.root();
        let beside = root.parent().map(|above| above.join(name));
        if beside.is_some_and(|folder| Package::open(&folder).is_ok()) {
            return Some(format!("{{ path = \"../{name}\" }}"));
        }
        let project = Project::find().ok()?;
        Package::open_crate(project.root(), name, None).ok()?;
        Some(format!("{{ crate = \"{name}\" }}"))
    }
}

fn write_text(report: &Report, file: &str, out: &mut dyn Write) -> std::io::Result<()> {
    let Report { package, modules, whole, lines, then_whole, left, written } = report;
    let all = counted(*modules, "module");
    if whole == modules {
        return writeln!(out, "{GOOD}{package}: {all}, all whole{GOOD:#}");
    }
    writeln!(out, "{HEAD}{package}{HEAD:#}: {whole} of {all} whole")?;
    if !lines.is_empty() {
        match written {
            true => writeln!(out, "\nwritten into {file}:\n")?,
            false => writeln!(out, "\nwrite into {file}, or run this with --write:\n")?,
        }
        let mut sections: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for line in lines {
            sections.entry(line.section).or_default().push(line.text());
        }
        for (section, lines) in sections {
            writeln!(out, "[{section}]\n{}", lines.join("\n"))?;
        }
        writeln!(out, "\nthen {then_whole} of {all} are whole")?;
    }
    let mut advised: BTreeSet<&str> = BTreeSet::new();
    for Left { module, location, message, advice } in left.iter().take(TOLD) {
        let place = location.as_deref().unwrap_or_default();
        writeln!(out, "{BAD}{module}{BAD:#} {message}\n  {DIM}{place}{DIM:#}")?;
        if let Some(advice) = advice.as_deref().filter(|advice| advised.insert(advice)) {
            writeln!(out, "  {advice}")?;
        }
    }
    if left.is_empty() {
        return Ok(());
    }
    let rest = match left.len().saturating_sub(TOLD) {
        0 => String::new(),
        more => format!(", {more} of them not listed here: `karat check` has all"),
    };
    writeln!(out, "\n{} not whole with these lines{rest}", counted(left.len(), "module"))
}
