//! What validators say of translations, and how far a row gets by that.

use std::collections::BTreeMap;
use std::sync::Arc;

use karat_translate::{Target, Tool, Translation, Validation, Verdict};

use super::subject::{Ready, is_read_back};
use super::{Cell, Column, Said, Status, Stop};

/// What the validators say of each translation of some rows: by row and language, in the tools' order.
pub(super) struct Judged(BTreeMap<(usize, Target), Vec<Said>>);

const VALID: &str = "valid";

impl Judged {
    /// Asks each validator about all translations of a language together.
    pub(super) fn of(rows: &[&Ready], columns: &[Column]) -> Self {
        let mut judged = BTreeMap::new();
        let mut targets: Vec<Target> = columns.iter().map(|column| column.target).collect();
        targets.sort_unstable();
        targets.dedup();
        for target in targets {
            let made: Vec<(usize, &Translation)> = rows
                .iter()
                .enumerate()
                .flat_map(|(row, ready)| ready.made.iter().map(move |made| (row, made)))
                .filter(|(_, made)| made.target == target)
                .filter_map(|(row, made)| Some((row, made.translation.as_ref().ok()?)))
                .collect();
            let translations: Vec<&Translation> = made.iter().map(|(_, one)| *one).collect();
            for (row, _) in &made {
                judged.insert((*row, target), Vec::new());
            }
            for tool in Tool::of(target) {
                for ((row, _), said) in made.iter().zip(ask(tool, &translations)) {
                    judged.entry((*row, target)).or_default().push(said);
                }
            }
        }
        Self(judged)
    }

    /// How far translation and validation of a row get on a column.
    pub(super) fn cell(&self, row: usize, ready: &Ready, column: Column) -> Cell {
        let nothing = Cell::default();
        let made = ready.of(column);
        let translation = match &made.translation {
            Ok(translation) => translation,
            Err(error) => {
                let stopped = Some(Stop::Unsupported(error.to_string()));
                return Cell { stopped, ..nothing };
            }
        };
        let own = self.0.get(&(row, made.target)).map_or(&[][..], Vec::as_slice);
        let mut validators = own.to_vec();
        let (status, stopped) = match rejection(own) {
            Some(said) => {
                let text = format!("`{}`: {}", said.command, said.verdict);
                (Status::Translated, Some(Stop::Rejected(text)))
            }
            None if own.is_empty() => {
                (Status::Translated, Some(Stop::NoValidator(no_validator(made.target))))
            }
            // naga reads a part of SPIR-V only: what it says is no verdict on what it wrote.
            None if is_read_back(column) && !Tool::naga().targets().contains(&made.target) => {
                let said = said(Tool::naga(), Tool::naga().validate(translation));
                let text = format!("naga doesn't read it back: {}", said.verdict);
                let stopped = (said.verdict != VALID).then_some(Stop::Unsupported(text));
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

/// The validator that rejects a translation. `spirv-cross` writes source text of it, and doesn't know
/// all that is valid: where `spirv-val` accepts, it isn't asked.
fn rejection(said: &[Said]) -> Option<&Said> {
    let of = |said: &Said, tool: &str| said.command.starts_with(tool);
    let accepted = said.iter().any(|said| of(said, "spirv-val") && said.verdict == VALID);
    let counts = |said: &&Said| !(accepted && of(said, "spirv-cross"));
    said.iter().filter(counts).find(|said| said.verdict != VALID)
}

/// What a tool says of each translation, a part of them on each core.
fn ask(tool: &Tool, translations: &[&Translation]) -> Vec<Said> {
    use rayon::prelude::*;
    let size = translations.len().div_ceil(rayon::current_num_threads()).max(1);
    let parts = translations.par_chunks(size).map(|part| tool.validate_all(part));
    let all = parts.collect::<Vec<_>>().into_iter().flatten();
    all.map(|answer| said(tool, answer)).collect()
}

fn said(tool: &Tool, answer: std::io::Result<Validation>) -> Said {
    match answer {
        Ok(said) => Said {
            command: said.command,
            version: said.version,
            verdict: match said.verdict {
                Verdict::Valid => VALID.to_owned(),
                Verdict::Invalid(message) => format!("invalid: {message}"),
                Verdict::Crashed(message) => format!("the validator crashes: {message}"),
                Verdict::TimedOut => "the validator doesn't end".to_owned(),
            },
        },
        Err(error) => Said {
            command: tool.name().to_owned(),
            version: tool.version().to_owned(),
            verdict: format!("it can't be run: {error}"),
        },
    }
}

fn no_validator(target: Target) -> String {
    let missing = Tool::all().iter().filter_map(|tool| tool.as_ref().err());
    let names: Vec<_> = missing.filter(|m| m.targets.contains(&target)).map(|m| m.name).collect();
    format!("none of the validators of {target} is here: {}", names.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spirv_cross_rejects_nothing_that_spirv_val_accepts() {
        let said = |command: &str, verdict: &str| Said {
            command: command.to_owned(),
            version: String::new(),
            verdict: verdict.to_owned(),
        };
        let (good, bad) =
            (said("spirv-val shader.spv", VALID), said("spirv-cross shader.spv", "no"));
        assert_eq!(rejection(&[good.clone(), bad.clone()]), None);
        assert_eq!(rejection(std::slice::from_ref(&bad)), Some(&bad));
        let val = said("spirv-val shader.spv", "invalid");
        assert_eq!(rejection(&[val.clone(), bad]), Some(&val));
        assert_eq!(rejection(&[good]), None);
    }
}
