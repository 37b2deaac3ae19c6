//! Collects the verdicts on a package from sources other than naga: Tint, WebGPU's limits, and the rules of
//! applications that load the package's files.

use std::path::PathBuf;
use std::sync::Arc;

use super::message::to_author;
use super::{Invalid, Program, ReflectError, native};
use crate::diagnostic::{Diagnostic, nearest};
use crate::output::counted;
use crate::package::{Compilers, Package, PackageError, unknown_to_naga};
use crate::tint::{Answer, Message, Missing, NoVerdict, Question, Reason, Severity, Tint};

/// The verdicts on a package from sources other than naga.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Opinion {
    /// The number of modules that Tint accepts.
    pub accepted: usize,
    /// Modules that Tint rejects.
    pub refused: Vec<Refused>,
    /// The names of the modules that Tint accepts and naga rejects.
    pub tint_alone: Vec<String>,
    /// Modules without a verdict, each with the reason: Tint crashed, hung, or printed something that Karat can't read.
    pub broke: Vec<(String, String)>,
    /// Modules that Tint didn't check, because they use native features of wgpu that `karat.toml` lists.
    pub native: Vec<String>,
    /// The reason why Karat didn't ask Tint at all; `None` if Karat asked Tint.
    pub unasked: Option<Missing>,
    /// Modules that exceed WebGPU's limits.
    pub limits: Vec<(String, Diagnostic)>,
    /// Modules, each with a warning: the module contains tests, but an application may load the module's file.
    pub shipped: Vec<(String, Diagnostic)>,
    /// Tint's warnings.
    pub warnings: Vec<(String, Diagnostic)>,
}

/// A module that Tint rejects.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Refused {
    /// The module.
    pub module: String,
    /// The kind of the first error.
    pub reason: Reason,
    /// Native features of wgpu that the module uses, by naga's names.
    pub native: Vec<String>,
    /// The message, with source locations.
    pub diagnostic: Diagnostic,
}

impl std::fmt::Display for Opinion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut parts = Vec::new();
        if let Some(missing) = &self.unasked {
            parts.push(format!("Tint wasn't asked: {missing}"));
        }
        for (count, verb) in [
            (self.accepted, "Tint accepts"),
            (self.refused.len(), "Tint rejects"),
            (self.broke.len(), "Tint has no verdict on"),
            (self.native.len(), "Tint skipped"),
            (self.limits_of(), "WebGPU's limits are exceeded in"),
            (self.shipped.len(), "test functions are in"),
        ] {
            if count > 0 {
                parts.push(format!("{verb} {}", counted(count, "module")));
            }
        }
        f.write_str(&parts.join("; "))
    }
}

impl Opinion {
    /// One line about the package: the number of modules that Tint rejects, the number of exceeded limits, and the
    /// number of modules without a verdict. `None` if all of these numbers are 0.
    #[must_use]
    pub fn remark(&self) -> Option<String> {
        let Self { refused, broke, unasked, limits, .. } = self.clone();
        let against = Self { refused, broke, unasked, limits, ..Self::default() };
        Some(against.to_string()).filter(|text| !text.is_empty())
    }

    fn limits_of(&self) -> usize {
        let mut modules: Vec<&str> = self.limits.iter().map(|(module, _)| &**module).collect();
        modules.dedup();
        modules.len()
    }

    /// All remarks, each only once. An error in a module also occurs in each module that imports the faulty module.
    #[must_use]
    pub fn remarks(&self) -> Vec<&Diagnostic> {
        let refused = self.refused.iter().map(|refused| &refused.diagnostic);
        let others = [&self.limits, &self.warnings, &self.shipped].into_iter().flatten();
        let mut all: Vec<&Diagnostic> = Vec::new();
        for diagnostic in refused.chain(others.map(|(_, diagnostic)| diagnostic)) {
            if !all.contains(&diagnostic) {
                all.push(diagnostic);
            }
        }
        all
    }

    /// Checks if there are no rejections and no exceeded limits. If `required`, each module must also have a verdict of
    /// Tint.
    #[must_use]
    pub fn is_good(&self, required: bool) -> bool {
        let all = self.unasked.is_none() && self.broke.is_empty();
        self.refused.is_empty() && self.limits.is_empty() && (all || !required)
    }

    /// The [`remarks`](Self::remarks), without the errors that `invalid` already contains.
    #[must_use]
    pub fn remarks_beside(&self, invalid: &Invalid) -> Vec<&Diagnostic> {
        let mut all = self.remarks();
        if let Invalid::Modules { errors, .. } = invalid {
            let told = |one: &&Diagnostic| errors.iter().any(|(_, e)| e.diagnostic() == Some(*one));
            all.retain(|one| !told(one));
        }
        all
    }

    /// The rejections and exceeded limits that are errors because of `karat.toml`, each with its module.
    pub(super) fn faults(&self, compilers: &Compilers) -> Vec<(String, ReflectError)> {
        let fault = |module: &str, diagnostic: &Diagnostic| {
            (module.to_owned(), ReflectError::Refused(Box::new(diagnostic.clone())))
        };
        let refused = self.refused.iter().map(|one| fault(&one.module, &one.diagnostic));
        let refused = refused.filter(|_| compilers.require_tint);
        let limits = self.limits.iter().map(|(module, diagnostic)| fault(module, diagnostic));
        let limits = limits.filter(|_| compilers.require_tint || compilers.limits.stated);
        refused.chain(limits).collect()
    }

    /// The reason why Tint has no verdict on at least one module, and a remedy; `None` if each module has a verdict.
    pub(super) fn no_verdict(&self) -> Option<(String, String)> {
        if let Some(Missing { reason, remedy }) = &self.unasked {
            return Some((reason.clone(), remedy.clone()));
        }
        let (module, how) = self.broke.first()?;
        let remedy = "run the command again; `karat doctor` shows which Tint Karat uses".to_owned();
        Some((format!("Tint failed on module `{module}`: {how}"), remedy))
    }

    /// Adds the verdicts on another package.
    pub fn add(&mut self, other: &Self) {
        let other = other.clone();
        self.accepted += other.accepted;
        self.refused.extend(other.refused);
        self.tint_alone.extend(other.tint_alone);
        self.broke.extend(other.broke);
        self.native.extend(other.native);
        self.unasked = self.unasked.take().or(other.unasked);
        self.limits.extend(other.limits);
        self.shipped.extend(other.shipped);
        self.warnings.extend(other.warnings);
    }
}

/// The warning for a module that wgpu and Firefox reject. naga doesn't know some tokens of the module. wgpu and Firefox
/// pass these tokens to naga, but Karat removes them, and so accepts the module.
fn not_for_wgpu(program: &Program) -> Option<Diagnostic> {
    let first = unknown_to_naga(program.text()).into_iter().next()?;
    let message =
        "wgpu and Firefox reject this text, because naga doesn't know this line".to_owned();
    let note = "Karat removes the line for naga, which supports subgroups without the line. Chrome needs the line";
    let label = std::iter::once((Some(first), String::new()));
    Some(to_author(&program.linked, message, label, vec![note.to_owned()]))
}

pub(super) enum Judged<'p> {
    Valid(&'p Program),
    Rejected(&'p mut ReflectError),
}

pub(super) fn of(
    package: &Package,
    compilers: &Compilers,
    modules: &mut [(String, Judged<'_>)],
) -> Result<Opinion, Invalid> {
    let mut opinion = Opinion::default();
    let unusable = |reason: String| {
        let file = compilers.file.clone();
        Invalid::Package(PackageError::Manifest { file, reason })
    };
    let names = native::names();
    if let Some(unknown) = compilers.native.iter().find(|name| !names.contains(name)) {
        let near = nearest(unknown, names.iter().map(String::as_str));
        let near = match near {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("the native features are {}", names.join(", ")),
        };
        return Err(unusable(format!("wgpu has no native feature `{unknown}`; {near}")));
    }
    let mut unused: Vec<&String> = compilers.native.iter().collect();
    let tint = Tint::beside(&package.folder(), compilers.require_tint);
    let (mut asked, mut questions) = (Vec::new(), Vec::new());
    for (index, (module, judged)) in modules.iter().enumerate() {
        if let Some(diagnostic) = package.shipped_tests(module) {
            opinion.shipped.push((module.clone(), diagnostic));
        }
        let (text, pipelines) = match judged {
            Judged::Valid(program) => {
                let over = program.over_limits(&compilers.limits);
                let mut pipelines = program.pipelines();
                // A device with default limits can't make these pipelines. Karat reports exceeded limits itself,
                // and knows the package's own limits.
                let beyond = program.beyond_default(compilers.limits.compatibility);
                pipelines.retain(|pipeline| !beyond.contains(&pipeline.entry_point));
                opinion.limits.extend(over.into_iter().map(|one| (module.clone(), one)));
                opinion.warnings.extend(not_for_wgpu(program).map(|one| (module.clone(), one)));
                if !compilers.native.is_empty() {
                    let used = program.native_features();
                    unused.retain(|name| !used.contains(name));
                    if used.iter().any(|name| compilers.native.contains(name)) {
                        opinion.native.push(module.clone());
                        continue;
                    }
                }
                (program.text().to_owned(), pipelines)
            }
            // Tint may accept a module that naga rejects, and the author should know this.
            Judged::Rejected(ReflectError::Invalid(_)) => {
                match package.for_validating(module).link_module(module) {
                    Ok(linked) => (linked.text().to_owned(), Vec::new()),
                    Err(_) => continue,
                }
            }
            Judged::Rejected(_) => continue,
        };
        let compatibility = compilers.limits.compatibility;
        asked.push(index);
        questions.push(Question { text, compatibility, pipelines });
    }
    if let Some(name) = unused.first() {
        let all_valid = modules.iter().all(|(_, judged)| matches!(judged, Judged::Valid(_)));
        if all_valid {
            return Err(unusable(format!(
                "`native` lists `{name}`, but no module uses this feature"
            )));
        }
    }
    let answers = match tint {
        Ok(tint) => tint.ask(&questions),
        Err(missing) => {
            opinion.unasked = Some(missing);
            for (module, judged) in modules.iter() {
                if let Judged::Valid(program) = judged {
                    let found = program.written_by_vertices().into_iter();
                    opinion.limits.extend(found.map(|one| (module.clone(), one)));
                }
            }
            return Ok(opinion);
        }
    };
    for (index, answer) in asked.into_iter().zip(answers) {
        let (module, judged) = &mut modules[index];
        match judged {
            Judged::Valid(program) => opinion.take(module, program, answer),
            Judged::Rejected(ReflectError::Invalid(diagnostic)) => {
                if answer.is_ok_and(|answer| !answer.rejects()) {
                    let note =
                        "Tint accepts this module: Chrome can run it, but wgpu and Firefox can't";
                    diagnostic.notes.push(note.to_owned());
                    opinion.tint_alone.push(module.clone());
                }
            }
            Judged::Rejected(_) => {}
        }
    }
    Ok(opinion)
}

impl Opinion {
    fn take(&mut self, module: &str, program: &Program, answer: Result<Answer, NoVerdict>) {
        let answer = match answer {
            Ok(answer) => answer,
            Err(error) => {
                self.broke.push((module.to_owned(), error.to_string()));
                return;
            }
        };
        let linked = &program.linked;
        let mut refused = Vec::new();
        let mut messages = answer.messages.iter().peekable();
        while let Some(message) = messages.next() {
            let mut labels = vec![(message.range.clone(), String::new())];
            let mut notes = Vec::new();
            while let Some(note) = messages.next_if(|next| next.severity == Severity::Info) {
                let resolved = note.range.clone().and_then(|range| linked.spliced.resolve(range));
                match resolved {
                    Some(_) => labels.push((note.range.clone(), note.text.clone())),
                    None => notes.push(note.text.clone()),
                }
            }
            let reason = Reason::of(&message.text);
            let mut lines = message.text.lines();
            let head = lines.next().unwrap_or_default();
            // Lists of overloads and of all known names would fill the screen.
            let rest = lines.find(|line| line.starts_with("Did you mean"));
            notes.extend(rest.map(str::to_owned));
            let verb = match message.severity {
                Severity::Error => {
                    notes.push(reason.remedy().to_owned());
                    "rejects this"
                }
                _ => "warns",
            };
            let text = format!("Tint {verb}: {head}");
            let diagnostic = to_author(linked, text, labels.into_iter(), notes);
            match message.severity {
                Severity::Error => refused.push((reason, diagnostic)),
                _ => self.warnings.push((module.to_owned(), diagnostic)),
            }
        }
        for (entry_point, error) in &answer.pipelines {
            // Dawn appends lines with the names of its own functions.
            let lines = error.lines().take_while(|line| !line.trim_start().starts_with("- While"));
            let text = lines.collect::<Vec<_>>().join(" ");
            let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
            let path = linked.names.get(entry_point).unwrap_or(entry_point);
            let name = path.rsplit("::").next().unwrap_or(path);
            let message = format!("Tint can't make a pipeline from entry point `{name}`: {text}");
            let mut diagnostic = Diagnostic::new(message).note(Reason::Pipeline.remedy());
            let place = program.entry_point_span(entry_point).or_else(|| {
                Some(crate::diagnostic::Span { file: Arc::clone(&linked.file), range: 0..0 })
            });
            diagnostic.labels.extend(place.map(|span| (span, String::new())));
            let reason = match Reason::of(&text) {
                Reason::Other => Reason::Pipeline,
                reason => reason,
            };
            refused.push((reason, diagnostic));
        }
        // Each module counts once. Its further errors become notes.
        let mut refused = refused.into_iter();
        let Some((reason, mut diagnostic)) = refused.next() else {
            self.accepted += 1;
            return;
        };
        for (_, other) in refused {
            let place = other.location().map_or_else(String::new, |span| format!("{span}: "));
            diagnostic.notes.push(format!("{place}{}", other.message));
        }
        let native = program.native_features();
        if !native.is_empty() {
            let (names, quoted) = (native.join("`, `"), native.join("\", \""));
            diagnostic.notes.push(format!(
                "the module uses `{names}`, which only wgpu has: if you intend this, write native = [\"{quoted}\"] in \
                 `[compilers]` of karat.toml"
            ));
        }
        self.refused.push(Refused { module: module.to_owned(), reason, native, diagnostic });
    }
}

impl Package {
    /// A note with Tint's verdict on uniform control flow at the given lines (`file:line:column`) of a program of this
    /// package. `None` if Tint isn't installed, has no verdict, or reports another error.
    pub(crate) fn uniformity_by_tint(&self, program: &Program, at: &[&str]) -> Option<String> {
        let tint = Tint::beside(&self.folder(), false).ok()?;
        let question = Question { text: program.text().to_owned(), ..Question::default() };
        let answer = tint.ask(&[question]).into_iter().next()?.ok()?;
        let is_own = |message: &&Message| message.severity != Severity::Info;
        let line = |place: &str| place.rsplit_once(':').map(|(line, _)| line.to_owned());
        let lines: Vec<_> = at.iter().map(|place| line(place)).collect();
        for message in answer.messages.iter().filter(is_own) {
            let place = message.range.clone();
            let place = place.and_then(|range| program.linked.spliced.resolve(range))?.to_string();
            if Reason::of(&message.text) == Reason::Uniformity && lines.contains(&line(&place)) {
                let head = message.text.lines().next().unwrap_or_default();
                return Some(format!("Tint's compiler reports the same error: {place}: {head}"));
            }
        }
        // After an error of another kind, Tint stops without checking uniformity.
        let looked = answer.messages.iter().all(|message| !is_own(&message));
        looked
            .then(|| "Tint doesn't report this error: only a run of the shader shows it".to_owned())
    }

    fn folder(&self) -> PathBuf {
        match self.root() {
            root if root.as_os_str().is_empty() => std::env::current_dir().unwrap_or_default(),
            root => root,
        }
    }

    /// A warning about tests in a module that applications may load. Other compilers don't know `@test`.
    fn shipped_tests(&self, module: &str) -> Option<Diagnostic> {
        if module.ends_with("_test") {
            return None;
        }
        let (span, count) = self.for_validating(module).first_test(module)?;
        let tests = counted(count, "test");
        let message = format!(
            "this file has {tests}, and a program that loads the file doesn't know `@test`"
        );
        let name = module.rsplit("::").next().unwrap_or(module);
        let note = format!(
            "move the tests to `{name}_test.wgsl`, or ship the output of `karat show --plain {module}`"
        );
        Some(Diagnostic::new(message).at(span, "").note(note.trim_end()))
    }
}
