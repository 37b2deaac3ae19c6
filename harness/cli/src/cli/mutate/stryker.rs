//! Stryker's mutation report, in version 2 of its schema (`mutation-testing-report-schema`).

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context;
use karat::unstable::diagnostic::shown;
use karat::unstable::image::write_whole;
use karat_mutate::{Candidate, Fate, Tried};
use serde_json::{Value, json};

/// The thresholds in the report, in per cent. Viewers call a score of at least 80 high, and a score below 60 low. Both
/// thresholds are Stryker's defaults.
const THRESHOLDS: [u32; 2] = [80, 60];

pub(super) fn write<'h>(all: impl Iterator<Item = &'h Tried>, path: &Path) -> anyhow::Result<()> {
    let mut files: BTreeMap<String, (&str, Vec<Value>)> = BTreeMap::new();
    for one in all {
        let file = files.entry(shown(&one.candidate.file));
        file.or_insert((&one.candidate.text, Vec::new())).1.push(mutant(one));
    }
    let files = files.into_iter().map(|(name, (source, mutants))| {
        (name, json!({ "language": "wgsl", "source": source, "mutants": mutants }))
    });
    let files: serde_json::Map<String, Value> = files.collect();
    let [high, low] = THRESHOLDS;
    let report = json!({
        "schemaVersion": "2", "thresholds": { "high": high, "low": low }, "files": files,
        "framework": { "name": "karat", "version": env!("CARGO_PKG_VERSION") },
    });
    write_whole(path, report.to_string().as_bytes())
        .with_context(|| format!("can't write `{}`", path.display()))
}

fn mutant(one: &Tried) -> Value {
    let Candidate { id, mutant, .. } = &one.candidate;
    let (status, reason) = match &one.fate {
        Fate::Killed { test } => ("Killed", format!("killed by {test}")),
        // The schema has no status for an equal mutant. `Ignored` excludes it from the score.
        Fate::Equal { by } => ("Ignored", by.to_string()),
        Fate::Accepted { reason } => ("Ignored", reason.clone()),
        Fate::Lived { .. } => ("Survived", String::new()),
        Fate::Untested { .. } => ("NoCoverage", String::new()),
        Fate::Invalid { reason } => ("CompileError", reason.clone()),
        Fate::Idle => ("Ignored", "no linked code changes".to_owned()),
        // Viewers count a `Timeout` as detected, but no test killed this mutant.
        Fate::Stopped { reason, .. } | Fate::Unknown { reason } => ("RuntimeError", reason.clone()),
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
    if let Fate::Killed { test } = &one.fate {
        all["killedBy"] = json!([test]);
    }
    all
}
