//! Collects validators' verdicts on translations, and determines statuses from them.

use std::collections::BTreeMap;
use std::sync::Arc;

use karat::package::Package;
use karat::unstable::tint::{Question, Tint};
use karat_translate::{Target, Tool, TranslateError, Translation, Validation, Verdict};
use serde::Serialize;

use super::column::Written;
use super::subject::{About, Ready, is_read_back};
use super::{Cell, Column, Status, Stop};

/// A validator's verdict on a translation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Said {
    /// The command line. The file `shader.*` contains the translation.
    pub command: String,
    /// The validator's version, as the validator prints it.
    pub version: String,
    /// The outcome.
    pub outcome: Outcome,
    /// `valid`, or the validator's message.
    pub verdict: String,
}

/// The kind of a validator's verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The validator accepts the translation.
    Valid,
    /// The validator rejects the translation.
    Invalid,
    /// No verdict, because the validator doesn't support a part of the language.
    Unable,
    /// No verdict, because the validator crashed, took too long, or didn't start.
    Broke,
}

/// The validators' verdicts on the rows' translations, by row and kind of text. Each list has the
/// order of `Tool::of`.
pub(super) struct Judged(BTreeMap<(usize, Written), Vec<Said>>);

impl Judged {
    /// Runs each validator once on all translations into a language.
    pub(super) fn of(rows: &[&Ready], columns: &[Column], package: &Package) -> Self {
        let mut judged = BTreeMap::new();
        let mut written: Vec<Written> = columns.iter().map(|column| column.written()).collect();
        written.sort_unstable();
        written.dedup();
        for written in written {
            let made: Vec<(usize, &Translation)> = rows
                .iter()
                .enumerate()
                .flat_map(|(row, ready)| ready.made.iter().map(move |made| (row, made)))
                .filter(|(_, made)| made.written == written)
                .filter_map(|(row, made)| Some((row, made.translation.as_ref().ok()?)))
                .collect();
            let translations: Vec<&Translation> = made.iter().map(|(_, one)| *one).collect();
            for (row, _) in &made {
                judged.insert((*row, written), Vec::new());
            }
            // The engine executes naga's module of the author's text, so only naga's verdict counts.
            let tools: Vec<&Tool> = match written {
                Written::ByAuthor => vec![Tool::naga()],
                Written::ByNaga(target) => Tool::of(target).collect(),
                Written::ForTint => {
                    let about: Vec<&About> =
                        made.iter().map(|(row, _)| &rows[*row].about).collect();
                    let answers = ask_tint(package, &translations, &about);
                    for ((row, _), said) in made.iter().zip(answers) {
                        judged.entry((*row, written)).or_default().push(said);
                    }
                    continue;
                }
            };
            for tool in tools {
                for ((row, _), said) in made.iter().zip(ask(tool, &translations)) {
                    judged.entry((*row, written)).or_default().push(said);
                }
            }
        }
        Self(judged)
    }

    pub(super) fn cell(&self, row: usize, ready: &Ready, column: Column) -> Cell {
        let nothing = Cell::default();
        let made = ready.of(column);
        let translation = match &made.translation {
            Ok(translation) => translation,
            Err(error) => {
                let stop = match error {
                    TranslateError::Panicked { .. } => Stop::Panicked,
                    _ => Stop::Unsupported,
                };
                return Cell { stopped: Some(stop(error.to_string())), ..nothing };
            }
        };
        let target = column.target;
        let own = self.0.get(&(row, made.written)).map_or(&[][..], Vec::as_slice);
        let mut validators: Vec<Said> = own.to_vec();
        let (status, stopped) = match rejection(own) {
            Some(said) => {
                let text = format!("`{}`: {}", said.command, said.verdict);
                let stop = match said.outcome {
                    Outcome::Broke => Stop::Broke(text),
                    Outcome::Unable => Stop::Unable(text),
                    _ => Stop::Rejected(text),
                };
                (Status::Translated, Some(stop))
            }
            None if own.is_empty() => {
                let why = match made.written {
                    Written::ForTint => {
                        "Tint isn't installed: `karat doctor` shows how to get it".to_owned()
                    }
                    _ => no_validator(target),
                };
                (Status::Translated, Some(Stop::NoValidator(why)))
            }
            // naga supports only a part of SPIR-V, so its rejection of its own output doesn't count.
            None if is_read_back(column) && !Tool::naga().targets().contains(&target) => {
                let said = said(Tool::naga(), Tool::naga().validate(translation));
                let text = format!("naga can't read its translation back: {}", said.verdict);
                let valid = said.outcome == Outcome::Valid;
                let stopped = (!valid).then_some(Stop::Unsupported(text));
                validators.push(said);
                (Status::Valid, stopped)
            }
            None => (Status::Valid, None),
        };
        let code = Some(Arc::new(translation.code.clone()));
        let options = translation.options.clone();
        Cell { status: Some(status), stopped, options, validators, code, ..nothing }
    }
}

/// The verdict that stops a translation: a rejection, or else a missing verdict. A validator that doesn't support a
/// part of the language counts only if no other validator accepts the translation. `spirv-cross` writes source text
/// from SPIR-V and doesn't support all valid SPIR-V, so it doesn't count if `spirv-val` accepts.
fn rejection(said: &[Said]) -> Option<&Said> {
    let of = |said: &Said, tool: &str| said.command.starts_with(tool);
    let accepted = said.iter().any(|said| of(said, "spirv-val") && said.outcome == Outcome::Valid);
    let counts = |said: &&Said| !(accepted && of(said, "spirv-cross"));
    let first = |outcome| said.iter().filter(counts).find(|said| said.outcome == outcome);
    let valid = first(Outcome::Valid).is_some();
    let unable = || first(Outcome::Unable).filter(|_| !valid);
    first(Outcome::Invalid).or_else(|| first(Outcome::Broke)).or_else(unable)
}

/// A tool's verdicts on translations, computed on all cores.
fn ask(tool: &Tool, translations: &[&Translation]) -> Vec<Said> {
    use rayon::prelude::*;
    let size = translations.len().div_ceil(rayon::current_num_threads()).max(1);
    let parts = translations.par_chunks(size).map(|part| tool.validate_all(part));
    let all = parts.collect::<Vec<_>>().into_iter().flatten();
    all.map(|answer| said(tool, answer)).collect()
}

/// Tint's verdicts on the author's texts; none if Tint isn't installed.
fn ask_tint(package: &Package, translations: &[&Translation], about: &[&About]) -> Vec<Said> {
    let Ok(tint) = Tint::beside(&package.root(), false) else { return Vec::new() };
    let question = |(translation, about): (&&Translation, &&About)| {
        let pipelines = match about {
            About::EntryPoint { program, name } => {
                let mut all = program.pipelines();
                all.retain(|pipeline| pipeline.entry_point == *name);
                all
            }
            About::Function(_) => Vec::new(),
        };
        let text = translation.code.text().expect("Tint checks WGSL").to_owned();
        Question { text, pipelines, ..Question::default() }
    };
    let questions: Vec<Question> = translations.iter().zip(about).map(question).collect();
    // A Tint that reports no version gives no verdicts, either.
    let version = tint.version().unwrap_or_default();
    let answers = tint.ask(&questions).into_iter();
    let said = answers.map(|answer| {
        let (outcome, verdict) = match answer {
            Ok(answer) => match answer.reason() {
                None => (Outcome::Valid, "valid".to_owned()),
                Some(reason) => (Outcome::Invalid, format!("invalid: {reason}")),
            },
            Err(error) => (Outcome::Broke, format!("no verdict: {error}")),
        };
        Said { command: "tint shader.wgsl".to_owned(), version: version.clone(), outcome, verdict }
    });
    said.collect()
}

fn said(tool: &Tool, answer: std::io::Result<Validation>) -> Said {
    let (name, version) = (tool.name().to_owned(), tool.version().to_owned());
    let (command, (outcome, verdict)) = match answer {
        Ok(said) => (
            said.command,
            match said.verdict {
                Verdict::Valid => (Outcome::Valid, "valid".to_owned()),
                Verdict::Invalid(message) => (Outcome::Invalid, format!("invalid: {message}")),
                Verdict::Unable(what) => (Outcome::Unable, format!("no verdict, because {what}")),
                Verdict::Broke(how) => {
                    (Outcome::Broke, format!("no verdict, because the validator {how}"))
                }
            },
        ),
        Err(error) => (
            name,
            (Outcome::Broke, format!("no verdict, because the validator doesn't start: {error}")),
        ),
    };
    Said { command, version, outcome, verdict }
}

fn no_validator(target: Target) -> String {
    let missing = Tool::all().iter().filter_map(|tool| tool.as_ref().err());
    let names: Vec<_> = missing.filter(|m| m.targets.contains(&target)).map(|m| m.name).collect();
    format!("no validator of {target} is installed: install one of {}", names.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spirv_cross_rejects_nothing_that_spirv_val_accepts() {
        let said = |command: &str, outcome| Said {
            command: command.to_owned(),
            version: String::new(),
            outcome,
            verdict: String::new(),
        };
        let (good, bad) = (
            said("spirv-val shader.spv", Outcome::Valid),
            said("spirv-cross shader.spv", Outcome::Invalid),
        );
        assert_eq!(rejection(&[good.clone(), bad.clone()]), None);
        assert_eq!(rejection(std::slice::from_ref(&bad)), Some(&bad));
        let val = said("spirv-val shader.spv", Outcome::Invalid);
        assert_eq!(rejection(&[val.clone(), bad.clone()]), Some(&val));
        assert_eq!(rejection(std::slice::from_ref(&good)), None);
        let broke = said("glslangValidator shader.glsl", Outcome::Broke);
        assert_eq!(
            rejection(&[good.clone(), broke.clone()]),
            Some(&broke),
            "a missing verdict isn't valid"
        );
        let unable = said("glslangValidator shader.hlsl", Outcome::Unable);
        assert_eq!(rejection(std::slice::from_ref(&unable)), Some(&unable));
        assert_eq!(
            rejection(&[unable.clone(), good.clone()]),
            None,
            "another validator accepts it"
        );
        assert_eq!(rejection(&[unable, broke.clone()]), Some(&broke));
        assert_eq!(
            rejection(&[broke, good, val.clone()]),
            Some(&val),
            "a rejection precedes a missing verdict"
        );
    }
}
