//! One line for each failure, in a form that editors read: `file:line:column: error: message`.

use std::io::Write;
use std::path::Path;

use karat::unstable::diagnostic::shown;
use karat::unstable::output::{headline as headline_of, one_line};
use karat::unstable::record::{ExpectationDetails, ModuleError, PathRecord, Record, Subject};
use karat::unstable::reflect::{Invalid, Opinion, ReflectError};

use super::{Place, Sum, failing, is_failure, located, wrong_place};

/// A failure or an error in one line, with its location.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::cli) struct Finding {
    pub(in crate::cli) place: Option<Place>,
    pub(in crate::cli) message: String,
}

/// Writes a line for each failure, each error of an invalid module and each remark, and then the last line of the run.
pub(in crate::cli) fn write(
    records: &[Record],
    (invalid, opinion): (&[(String, Invalid)], &Opinion),
    sum: &Sum,
    root: &Path,
    out: &mut dyn Write,
) -> std::io::Result<()> {
    let mut lines: Vec<String> = Vec::new();
    let failed: Vec<&Record> = records.iter().filter(|record| is_failure(record)).collect();
    for Finding { place, message } in failed.iter().flat_map(|record| of(record, root)) {
        let place = place.map(|Place { file, line, column }| {
            format!("{}:{line}:{column}: ", shown(&root.join(file)))
        });
        lines.push(format!("{}error: {message}", place.unwrap_or_default()));
    }
    for (package, invalid) in invalid {
        if !matches!(invalid, Invalid::Modules { .. }) {
            lines.push(format!("error: {package}: {}", headline_of(&invalid.to_string())));
        }
    }
    for ModuleError { place, message } in errors(invalid) {
        let place = if place.is_empty() { place } else { format!("{place}: ") };
        lines.push(format!("{place}error: {}", headline_of(&message)));
    }
    for remark in opinion.remarks() {
        let place = remark.location().map(|span| format!("{span}: ")).unwrap_or_default();
        lines.push(format!("{place}warning: {}", headline_of(&remark.message)));
    }
    lines.iter().try_for_each(|line| writeln!(out, "{}", one_line(line)))?;
    let more =
        if sum.outside().is_empty() { "" } else { "; to see the message, run without --short" };
    writeln!(out, "{}{}{more}", sum.line(), sum.remarks())
}

pub(in crate::cli) fn errors(invalid: &[(String, Invalid)]) -> Vec<ModuleError> {
    let of = |(_, invalid): &(String, Invalid)| match invalid {
        Invalid::Modules { errors, .. } => errors.iter().map(|(_, error)| one(error)).collect(),
        _ => Vec::new(),
    };
    fn one(error: &ReflectError) -> ModuleError {
        let found = error.diagnostic();
        let place = found.and_then(|found| found.location()).map(ToString::to_string);
        let message = found.map_or_else(|| error.to_string(), |found| found.message.clone());
        ModuleError { place: place.unwrap_or_default(), message }
    }
    invalid.iter().flat_map(of).collect()
}

/// Returns the lines of a failure: its failing expectations, or the hazards that the sanitizer found, or its headline.
pub(in crate::cli) fn of(record: &Record, root: &Path) -> Vec<Finding> {
    let expectations = expectations(record, root);
    if !expectations.is_empty() {
        return expectations;
    }
    let violations = record.details.iter().flat_map(|details| &details.violations);
    let violations: Vec<Finding> = violations
        .map(|violation| {
            let place =
                violation.accesses.first().and_then(|access| located(&access.place, root, root));
            Finding { place, message: violation.headline.clone() }
        })
        .collect();
    if !violations.is_empty() {
        return violations;
    }
    vec![Finding { place: wrong_place(record, root, root), message: headline(record) }]
}

/// Returns each failing expectation once, with its location, the values of the simplest case, and the paths on which
/// the expectation fails.
pub(super) fn expectations(record: &Record, root: &Path) -> Vec<Finding> {
    let Subject::Function { package, function, .. } = &record.subject else { return Vec::new() };
    let mut all: Vec<(&ExpectationDetails, Vec<&str>)> = Vec::new();
    for details in record.details.iter().flat_map(|details| &details.paths) {
        let cases = [&details.simplest, &details.worst, &details.first].into_iter().flatten();
        for expectation in cases.flat_map(|case| &case.expectations) {
            let path = &*details.adapter.path;
            match all.iter_mut().find(|(known, _)| known.place == expectation.place) {
                Some((_, paths)) if paths.contains(&path) => {}
                Some((_, paths)) => paths.push(path),
                None => all.push((expectation, vec![path])),
            }
        }
    }
    let finding = |(ExpectationDetails { place, seen }, paths): (&_, Vec<&str>)| {
        let place = located(place, Path::new(package), root)?;
        let message = format!("{seen}, in `{function}` on {}", paths.join(", "));
        Some(Finding { place: Some(place), message })
    };
    all.into_iter().filter_map(finding).collect()
}

/// Returns the headline of a failure, with the worst error and the path of that error.
fn headline(record: &Record) -> String {
    let (Subject::Function { function, check, .. }, Some(worst)) = (&record.subject, worst(record))
    else {
        let said = record.details.as_ref().map(|details| details.headline.clone());
        return said.unwrap_or_else(|| "the check fails without a message".to_owned());
    };
    let seen = match worst.asserted.is_empty() {
        true => worst.worst.clone(),
        false => format!("{} ({})", worst.worst, worst.asserted),
    };
    let path = &worst.adapter.path;
    format!("`{function}` fails {check}: {seen} on {path}, {}", failing(worst))
}

fn worst(record: &Record) -> Option<&PathRecord> {
    let failing =
        record.paths.iter().filter(|path| path.failures > 0 && path.known_issue.is_none());
    let ratio = |path: &PathRecord| path.ratio.unwrap_or(f64::INFINITY);
    failing.max_by(|a, b| ratio(a).total_cmp(&ratio(b)))
}
