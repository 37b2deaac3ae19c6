//! `karat doctor PACKAGE`: finds the lines that a package's `karat.toml` lacks, and lists the modules that have errors
//! even with these lines. In this file, a module is whole if it links and is valid.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use karat::Package;
use karat::package::PackageError;
use karat::unstable::diagnostic::{Mend, shown};
use karat::unstable::image::write_whole;
use karat::unstable::output::counted;
use karat::unstable::reflect::{Invalid, Program, ReflectError};
use serde::Serialize;

use super::super::project::Project;
use super::super::table::{BAD, DIM, GOOD, HEAD};
use super::super::{Ending, Outcome, write_json};

/// The largest number of rounds in which Karat validates the modules, and adds the lines that the errors ask for. One
/// round isn't enough, because the first error of a module hides its other errors.
const ROUNDS: usize = 32;

/// The largest number of modules that the output lists. More lines wouldn't fit on a screen.
const TOLD: usize = 12;

/// The comment that Karat writes after an invented value, if only the user's game engine knows the real value.
const MADE_UP: &str = "invented value: write the value that your game engine sets";

/// The number that Karat invents for a feature that needs a number. The number may be the length of an array, so it is
/// small.
const FEATURE: &str = "4";

/// The value that Karat invents for a placeholder in a shader, such as `{{SIZE}}`, or for an undeclared name in
/// capitals. Most placeholders are sizes of workgroups, and 64 is a usual size.
const VALUE: &str = "64";

/// The comment that Karat writes after an invented value for an undeclared name in capitals.
const UNDECLARED: &str =
    "invented value: no module declares this name; is the name a macro, or misspelt?";

/// The comment that Karat writes after a feature, if the shader declares a name only when this feature is on.
const VARIANT: &str = "a declaration needs this feature: your game engine may set other features";

/// The comment that Karat writes after an empty text, if only the user's game engine knows the real text.
const TEXT: &str = "empty: write the text that your game engine inserts";

/// Returns advice to the author on an error that Karat can't correct by adding a line to `karat.toml`.
fn advice(mend: &Mend) -> Option<String> {
    match mend {
        Mend::Elsewhere(sentence) => Some(sentence.clone()),
        Mend::Preprocess => Some("name a program that expands WGSL: preprocess = [..]".to_owned()),
        Mend::Dependency(name) => Some(format!(
            "write the package's location: [dependencies] {name} = {{ path = \"../{name}\" }}, or {{ crate = \"{name}@1.2.3\" }}"
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

#[derive(Clone, Debug, Serialize)]
struct Left {
    module: String,
    location: Option<String>,
    message: String,
    /// The advice on the error, if only the author can correct it.
    advice: Option<String>,
}

#[derive(Serialize)]
struct Report {
    package: String,
    modules: usize,
    /// The number of modules that link and are valid without the new lines.
    whole: usize,
    lines: Vec<Line>,
    /// The number of modules that link and are valid with the new lines.
    then_whole: usize,
    /// The lines that errors ask for, but that Karat doesn't write: the file already sets the line's key, or the line
    /// makes no module valid.
    not_enough: Vec<Line>,
    left: Vec<Left>,
    /// The error with which `karat check` refuses the whole package, if there is such an error.
    refused: Option<String>,
    written: bool,
}

/// A package, its `karat.toml`, and the lines that Karat found for this file.
struct Trial<'p> {
    package: &'p Package,
    file: PathBuf,
    text: String,
    table: toml::Table,
    modules: Vec<String>,
    lines: Vec<Line>,
}

pub(super) fn run(folder: &Path, write: bool, json: bool, out: &mut dyn Write) -> Outcome {
    let package = Package::open(folder)?;
    let mut trial = Trial::of(&package)?;
    let began = trial.judged();
    let mut not_enough = trial.mend();
    not_enough.extend(trial.sift());
    let left = trial.judged();
    let writes = write && !trial.lines.is_empty();
    if writes {
        let known = std::fs::metadata(&trial.file);
        let is_kept = known.is_ok_and(|known| known.permissions().readonly());
        ensure!(!is_kept, "`{}` is read-only: make this file writable", shown(&trial.file));
        write_whole(&trial.file, trial.with(&trial.lines).as_bytes())
            .with_context(|| format!("can't write `{}`", shown(&trial.file)))?;
    }
    let modules = trial.modules.len();
    let report = Report {
        package: package.name(),
        modules,
        whole: modules - began.len(),
        then_whole: modules - left.len(),
        refused: if left.is_empty() { trial.refused() } else { None },
        not_enough,
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
    let good = whole == modules && report.refused.is_none();
    Ok(if good { Ending::Good } else { Ending::Bad })
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
        // Other commands report the errors of the file.
        let modules = package.modules()?;
        let table = text.parse().with_context(|| format!("`{}`", shown(&file)))?;
        Ok(Self { package, file, text, table, modules, lines: Vec::new() })
    }

    /// Returns the text of `karat.toml` with the given lines added. The added lines have the same line ends (LF or
    /// CRLF) as the file.
    fn with(&self, lines: &[Line]) -> String {
        let is_windows = self.text.contains("\r\n");
        let mut text = self.text.replace("\r\n", "\n");
        for line in lines {
            let head = format!("[{}]", line.section);
            let own = line.text();
            let is_head = |known: &str| {
                let plain = known.split('#').next().unwrap_or_default();
                plain.trim_start_matches('\u{feff}').trim() == head
            };
            let place = text.lines().position(is_head);
            text = match place {
                Some(at) => {
                    let mut all: Vec<&str> = text.lines().collect();
                    all.insert(at + 1, &own);
                    all.join("\n") + "\n"
                }
                None => {
                    let gap = if text.is_empty() { "" } else { "\n" };
                    let end = if text.is_empty() || text.ends_with('\n') { "" } else { "\n" };
                    format!("{text}{end}{gap}{head}\n{own}\n")
                }
            };
        }
        if is_windows { text.replace('\n', "\r\n") } else { text }
    }

    /// Checks if `karat.toml` can be parsed with a line added. For example, it can't be parsed if the file already sets
    /// the line's key.
    fn fits(&self, line: &Line) -> bool {
        self.with(std::slice::from_ref(line))
            .trim_start_matches('\u{feff}')
            .parse::<toml::Table>()
            .is_ok()
    }

    /// Removes each line that doesn't reduce the number of modules with errors, and returns the removed lines.
    fn sift(&mut self) -> Vec<Line> {
        let all = self.errors(&self.lines).len();
        let without = |at: usize| {
            let lines = self.lines.iter().enumerate().filter(|(other, _)| *other != at);
            lines.map(|(_, line)| line.clone()).collect::<Vec<_>>()
        };
        let is_needed: Vec<bool> =
            (0..self.lines.len()).map(|at| self.errors(&without(at)).len() > all).collect();
        let mut needed = is_needed.iter();
        let (lines, others) = std::mem::take(&mut self.lines)
            .into_iter()
            .partition(|_| *needed.next().unwrap_or(&true));
        self.lines = lines;
        others
    }

    /// Returns the error with which `karat check` refuses the whole package even if `karat.toml` has the found lines.
    /// Returns `None` if there is no error, or if only single modules have errors.
    fn refused(&self) -> Option<String> {
        let package = self.package.unsaved(&self.file, &self.with(&self.lines));
        match package.try_is_valid() {
            Err(Invalid::Package(error)) => Some(error.to_string()),
            _ => None,
        }
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

    /// Adds the lines that errors ask for, until the errors ask for no new lines. Returns the lines that don't fit into
    /// the file.
    fn mend(&mut self) -> Vec<Line> {
        let mut tried: BTreeSet<String> = BTreeSet::new();
        let mut by_hand = Vec::new();
        for _ in 0..ROUNDS {
            let errors = self.errors(&self.lines);
            let mut found: Vec<Line> = Vec::new();
            let mut conditions: Vec<Line> = Vec::new();
            for (_, error) in &errors {
                let mend = error.diagnostic().and_then(|diagnostic| diagnostic.mend.clone());
                for (line, condition) in self.lines_of(error, mend) {
                    if !tried.insert(format!("{}.{}", line.section, line.key)) {
                        continue;
                    }
                    match (self.fits(&line), condition) {
                        (false, _) => by_hand.push(line),
                        (true, true) => conditions.push(line),
                        (true, false) => found.push(line),
                    }
                }
            }
            // One feature may exclude another. A feature stays unless it breaks more modules than it makes whole.
            for line in &conditions {
                let plain = [&*self.lines, &found].concat();
                let with = [&*plain, std::slice::from_ref(line)].concat();
                if self.errors(&with).len() <= self.errors(&plain).len() {
                    found.push(line.clone());
                }
            }
            if found.is_empty() {
                break;
            }
            self.lines.extend(found);
        }
        by_hand
    }

    /// Returns the lines that an error asks for, each with a flag. The flag is `true` if the line sets a feature that
    /// switches declarations on or off.
    fn lines_of(&self, error: &ReflectError, mend: Option<Mend>) -> Vec<(Line, bool)> {
        let line = |section, key: &str, value: &str, about| {
            let (key, value) = (key.to_owned(), value.to_owned());
            Line { section, key, value, about }
        };
        if let ReflectError::Package(PackageError::UnknownFeature { unknown, .. }) = error {
            let names: Vec<String> = unknown.iter().map(|(name, _)| format!("{name:?}")).collect();
            let listed =
                self.table.get("features").is_some_and(|own| own.get("set_by_engine").is_some());
            // A name close to a known one is misspelt: the error message says that already.
            let has = listed || unknown.iter().any(|(_, near)| near.is_some());
            let list = line("features", "set_by_engine", &format!("[{}]", names.join(", ")), "");
            return if has { Vec::new() } else { vec![(list, false)] };
        }
        match mend {
            Some(Mend::Feature(name)) => vec![(line("features", &name, FEATURE, MADE_UP), false)],
            Some(Mend::Condition(name)) => vec![(line("features", &name, "true", VARIANT), true)],
            Some(Mend::Text(name)) => vec![(line("values", &name, "\"\"", TEXT), false)],
            Some(Mend::Value(name)) => vec![(line("values", &name, VALUE, MADE_UP), false)],
            Some(Mend::Undeclared(name)) => {
                vec![(line("values", &name, VALUE, UNDECLARED), false)]
            }
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

    /// Returns the location of an imported package for `[dependencies]`: a folder beside this package, or a crate that
    /// the project builds.
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
    let Report { package, modules, whole, lines, then_whole, not_enough, left, refused, written } =
        report;
    let all = counted(*modules, "module");
    let refused =
        refused.as_ref().map_or_else(String::new, |why| format!("\n{BAD}but{BAD:#} {why}"));
    if whole == modules {
        return writeln!(out, "{GOOD}{package}: {all}, all valid{GOOD:#}{refused}");
    }
    writeln!(out, "{HEAD}{package}{HEAD:#}: {whole} of {all} valid")?;
    if !lines.is_empty() {
        match written {
            true => writeln!(out, "\nKarat wrote these lines into {file}:\n")?,
            false => writeln!(out, "\nwrite these lines into {file}, or add --write:\n")?,
        }
        write_lines(lines, out)?;
        writeln!(out, "\nwith these lines, {then_whole} of {all} are valid{refused}")?;
    }
    if !not_enough.is_empty() {
        writeln!(
            out,
            "\n{file} may also need these lines. Karat didn't add these lines, because no module becomes valid with them, or because you must choose their place:\n"
        )?;
        write_lines(not_enough, out)?;
        writeln!(out)?;
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
        more => format!(", {more} of which aren't listed here: `karat check` lists all modules"),
    };
    let with = if lines.is_empty() { "" } else { " with these lines" };
    let first = "; Karat shows only the first error of each module";
    writeln!(out, "\n{} not valid{with}{rest}{first}", counted(left.len(), "module"))
}

/// Prints lines of `karat.toml`, below the headers of their sections.
fn write_lines(lines: &[Line], out: &mut dyn Write) -> std::io::Result<()> {
    let mut sections: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for line in lines {
        sections.entry(line.section).or_default().push(line.text());
    }
    for (section, lines) in sections {
        writeln!(out, "[{section}]\n{}", lines.join("\n"))?;
    }
    Ok(())
}
