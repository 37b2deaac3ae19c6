//! Stryker's report of mutants, by version 2 of its schema (`mutation-testing-report-schema`).

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context;
use karat::Package;
use karat::unstable::diagnostic::shown;
use karat::unstable::image::write_whole;
use karat_mutate::{Fate, Hunted, Lived, Tried};
use serde_json::{Value, json};

/// Scores that viewers show as high and as low, in per cent: those of Stryker.
const THRESHOLDS: [u32; 2] = [80, 60];

/// Writes it.
pub(super) fn write<'h>(
    all: impl Iterator<Item = (&'h Package, &'h Hunted)>,
    path: &Path,
) -> anyhow::Result<()> {
    let mut files: BTreeMap<String, Value> = BTreeMap::new();
    for (_, hunted) in all {
        for one in &hunted.tried {
            let name = shown(&one.file);
            if !files.contains_key(&name) {
                let source = std::fs::read_to_string(&one.file)
                    .with_context(|| format!("can't read `{name}`"))?;
                let file = json!({ "language": "wgsl", "source": source, "mutants": [] });
                files.insert(name.clone(), file);
            }
            let mutants = files.get_mut(&name).and_then(|file| file["mutants"].as_array_mut());
            mutants.expect("it was made above").push(mutant(one));
        }
    }
    let [high, low] = THRESHOLDS;
    let report = json!({
        "schemaVersion": "2", "thresholds": { "high": high, "low": low }, "files": files,
        "framework": { "name": "karat", "version": env!("CARGO_PKG_VERSION") },
    });
    write_whole(path, report.to_string().as_bytes())
        .with_context(|| format!("can't write `{}`", path.display()))
}

fn mutant(one: &Tried) -> Value {
    let Tried { id, mutant, fate, .. } = one;
    let (status, reason) = match fate {
        Fate::Killed { test } => ("Killed", format!("killed by {test}")),
        // It has no word for a mutant that is the same shader; one that is left out of the score is ignored.
        Fate::Lived { why: Lived::Equal, .. } | Fate::Untested { why: Lived::Equal } => {
            ("Ignored", "it is the same shader".to_owned())
        }
        Fate::Lived { .. } => ("Survived", String::new()),
        Fate::Untested { .. } => ("NoCoverage", String::new()),
        Fate::Invalid { reason } => ("CompileError", reason.clone()),
        Fate::Idle => ("Ignored", "it changes nothing that is linked".to_owned()),
        Fate::Stopped { reason, .. } => ("Timeout", reason.clone()),
    };
    let lines: Vec<&str> = mutant.original.split('\n').collect();
    let last = lines.last().map_or(0, |line| line.chars().count());
    let end = match lines.len() {
        1 => json!({ "line": mutant.line, "column": mutant.column + last }),
        many => json!({ "line": mutant.line + many - 1, "column": last + 1 }),
    };
    let mut all = json!({
        "id": id, "mutatorName": mutant.rule.to_string(), "replacement": mutant.replacement, "status": status,
        "location": { "start": { "line": mutant.line, "column": mutant.column }, "end": end },
    });
    if !reason.is_empty() {
        all["statusReason"] = Value::String(reason);
    }
    all
}
