//! Writes the coverage in the format of LCOV's tracefiles, which `geninfo(1)` describes.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

use super::union::{File, Seen, Union};

/// Formats a tracefile. For each file, the tracefile has one record that lists all lines with the count 0, and one
/// record for each test that ran lines of the file, with the counts of this test.
pub(super) fn written(union: &Union) -> String {
    let mut text = String::new();
    for (file, own) in union.files() {
        record(&mut text, file, own, None);
        let tests: BTreeSet<&String> =
            own.statements.values().flat_map(|seen| seen.tests.keys()).collect();
        for test in tests {
            record(&mut text, file, own, Some(test));
        }
    }
    text
}

/// Adds a record of one file to `text`, with the counts of one test, or with counts of 0 if `test` is `None`.
fn record(text: &mut String, file: &Path, own: &File, test: Option<&String>) {
    let count = |seen: &Seen| test.and_then(|test| seen.tests.get(test)).map_or(0, |own| own.count);
    // LCOV allows only letters, digits and `_` in the name of a test.
    let name = |test: &str| test.replace(|c: char| !c.is_ascii_alphanumeric(), "_");
    let mut line = |line: std::fmt::Arguments<'_>| writeln!(text, "{line}").expect("memory");
    line(format_args!("TN:{}", test.map_or(String::new(), |test| name(test))));
    line(format_args!("SF:{}", file.display()));
    let mut functions: BTreeMap<&str, (usize, u64)> = own.functions();
    functions.values_mut().for_each(|(_, count)| *count = 0);
    for seen in own.statements.values() {
        if let Some((_, called)) = functions.get_mut(&*seen.sum.function) {
            *called = (*called).max(count(seen));
        }
    }
    for (name, (first, _)) in &functions {
        line(format_args!("FN:{first},{name}"));
    }
    for (name, (_, called)) in &functions {
        line(format_args!("FNDA:{called},{name}"));
    }
    line(format_args!("FNF:{}", functions.len()));
    line(format_args!("FNH:{}", functions.values().filter(|(_, called)| *called > 0).count()));
    let (mut ways, mut taken) = (0, 0);
    for (block, seen) in own.branches().enumerate() {
        let came = test.and_then(|test| seen.tests.get(test));
        for (way, _) in seen.sum.ways().enumerate() {
            let count = came.map(|came| came.taken.get(way).copied().unwrap_or_default());
            ways += 1;
            taken += usize::from(count.is_some_and(|count| count > 0));
            // A branch that no test reached has no count.
            let count = count.map_or_else(|| "-".to_owned(), |count| count.to_string());
            line(format_args!("BRDA:{},{block},{way},{count}", seen.sum.lines[0]));
        }
    }
    line(format_args!("BRF:{ways}"));
    line(format_args!("BRH:{taken}"));
    let lines = own.lines();
    let lines: Vec<(usize, u64)> = lines
        .iter()
        .filter(|(_, line)| line.measured)
        .map(|(number, line)| {
            (*number, line.seen.iter().map(|seen| count(seen)).max().unwrap_or_default())
        })
        .collect();
    for (number, count) in &lines {
        line(format_args!("DA:{number},{count}"));
    }
    line(format_args!("LF:{}", lines.len()));
    line(format_args!("LH:{}", lines.iter().filter(|(_, count)| *count > 0).count()));
    line(format_args!("end_of_record"));
}
