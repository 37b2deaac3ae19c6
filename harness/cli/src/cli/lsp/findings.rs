//! Errors and failures as diagnostics.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use karat::unstable::diagnostic as karats;
use karat::unstable::record::Record;
use karat::unstable::reflect::{Invalid, Opinion};
use lsp_types::{
    Diagnostic, DiagnosticRelatedInformation, DiagnosticSeverity, Location, NumberOrString, Range,
};

use super::super::replay;
use super::super::report::short::{self, Finding};
use super::super::report::{Names, Place, is_failure};
use super::documents::Documents;
use super::place;

/// The diagnostics of each file.
pub(super) type Findings = BTreeMap<PathBuf, Vec<Diagnostic>>;

fn error(range: Range, message: String) -> Diagnostic {
    Diagnostic {
        range,
        severity: Some(DiagnosticSeverity::ERROR),
        source: Some("karat".to_owned()),
        message,
        ..Diagnostic::default()
    }
}

/// Adds the errors of invalid modules. Returns the messages of the errors that have no location in a file.
pub(super) fn of_invalid(invalid: &Invalid, findings: &mut Findings) -> Vec<String> {
    let Invalid::Modules { errors, .. } = invalid else { return vec![invalid.to_string()] };
    let mut placeless = Vec::new();
    for (_, error) in errors {
        let found = error.diagnostic();
        let placed = found.and_then(|found| Some((found, placed(found)?)));
        match placed {
            Some((_, (file, diagnostic))) => insert(file, diagnostic, findings),
            None => placeless.push(error.to_string()),
        }
    }
    placeless
}

/// Adds the remarks of other compilers, such as Tint, as warnings. If `karat.toml` turns a remark into an error,
/// `findings` already has the error, and gets no warning.
pub(super) fn of_opinion(opinion: &Opinion, findings: &mut Findings) {
    for (file, mut diagnostic) in opinion.remarks().into_iter().filter_map(placed) {
        let own = findings.get(&file).map_or(&[][..], Vec::as_slice);
        if !own.contains(&diagnostic) {
            diagnostic.severity = Some(DiagnosticSeverity::WARNING);
            insert(file, diagnostic, findings);
        }
    }
}

/// Adds a finding, unless the file already has it. Each module that imports an invalid module reports the same error.
fn insert(file: PathBuf, diagnostic: Diagnostic, findings: &mut Findings) {
    let own = findings.entry(file).or_default();
    if !own.contains(&diagnostic) {
        own.push(diagnostic);
    }
}

fn placed(found: &karats::Diagnostic) -> Option<(PathBuf, Diagnostic)> {
    let (span, remark) = found.labels.first()?;
    let file = file_of(span)?;
    let mut message = found.message.clone();
    for more in [remark].into_iter().chain(&found.notes) {
        if !message.contains(&**more) {
            message = format!("{message}\n{more}");
        }
    }
    let related = found.labels[1..].iter().filter_map(|(span, remark)| {
        let range = place::of(span);
        let location = Location { uri: place::uri(&file_of(span)?)?, range };
        Some(DiagnosticRelatedInformation { location, message: remark.clone() })
    });
    let related: Vec<_> = related.collect();
    let mut diagnostic = error(place::of(span), message);
    diagnostic.related_information = (!related.is_empty()).then_some(related);
    Some((file, diagnostic))
}

/// Returns the file of a span, or `None` if the span's text is in memory.
pub(super) fn file_of(span: &karats::Span) -> Option<PathBuf> {
    let name = &span.file.name;
    (!name.starts_with('<')).then(|| place::resolved(Path::new(name)))
}

/// Adds the failures in `records`. A failure that is also in `last`, the records of the last run, gets its name for
/// `karat replay`.
pub(super) fn of_records(
    records: &[Record],
    last: &[Record],
    root: &Path,
    documents: &Documents,
    findings: &mut Findings,
) {
    let names = replay::names(last);
    let (called, known_as) = (Names::of(records), Names::of(last));
    for record in records.iter().filter(|record| is_failure(record)) {
        let same = |known: &Record| {
            let same = known_as.subject(known) == called.subject(record);
            same && known.test == record.test && known.cargo_package == record.cargo_package
        };
        let name = names.iter().find(|(_, known)| same(known)).map(|(name, _)| name.clone());
        for finding in short::of(record, root) {
            add(finding, name.clone(), root, documents, findings);
        }
    }
}

/// Adds a finding, or does nothing if the finding has no location.
pub(super) fn add(
    finding: Finding,
    name: Option<String>,
    root: &Path,
    documents: &Documents,
    findings: &mut Findings,
) {
    let Finding { place: Some(Place { file, line, column }), message } = finding else { return };
    let file = place::resolved(&root.join(file));
    let range = place::rest_of_line(&documents.text(&file), line, column);
    let mut diagnostic = error(range, message);
    diagnostic.code = name.map(NumberOrString::String);
    insert(file, diagnostic, findings);
}
