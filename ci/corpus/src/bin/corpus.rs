//! Checks shaders of other projects: which modules open, link and validate, and which functions Karat can call.
//!
//! `cargo run --bin corpus -- LIST.toml [--json FILE]` reads the crates and folders of a list. Cargo fetches the crates
//! without compiling them. `cargo ci corpus` runs the program over `ci/corpus.toml`.
//!
//! ```toml
//! [[shaders]]
//! crate = "bevy_pbr@0.20.1"   # or folder = "shaders"
//! root = "src"                # if karat doesn't find it
//! [shaders.features]
//! MATERIAL_BIND_GROUP = 3
//! [shaders.with]              # more features, for modules that aren't valid without them
//! "ssr" = ["DEPTH_PREPASS"]
//! ```
//!
//! With `--verbose` the program prints, for each invalid module, the reason.
//!
//! If naga accepts a module's file as it is, Karat must also accept the module, and must not change a byte of its text.
//! For each function, Karat must report the line of the file that declares the function. The program prints each
//! violation as a fault of Karat. Panics, and modules that take longer than `SLOWEST`, are also faults.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io::Write as _;
use std::panic::catch_unwind;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use karat::Package;
use karat::unstable::package::FunctionItem;
use karat::unstable::probe::{ProbeError, Probed};
use karat::unstable::reflect::{Program, ReflectError};
use karat::unstable::value::Shape;
use naga::valid::{Capabilities, ValidationFlags, Validator};
use serde::Serialize;

#[path = "../list.rs"]
mod list;
#[path = "../reasons.rs"]
mod reasons;

use list::{List, Wanted};

#[derive(Default, Serialize)]
struct Row {
    name: String,
    modules: usize,
    /// The number of modules whose functions Karat can list.
    open: usize,
    /// The number of modules that are valid, including all their functions and entry points.
    whole: usize,
    functions: usize,
    callable: usize,
    /// For each reason, the number of functions that Karat can't call for this reason.
    reasons: BTreeMap<String, usize>,
    /// The time that the crate's slowest module took, in milliseconds.
    slowest_ms: u128,
}

/// The longest time that Karat may take for a module, even on a busy machine. A longer time is a fault of Karat.
const SLOWEST: Duration = Duration::from_secs(10);

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let (mut list, mut json, mut verbose) = (None, None, false);
    while let Some(argument) = arguments.next() {
        match &*argument {
            "--json" => json = arguments.next(),
            "--verbose" => verbose = true,
            _ => list = Some(argument),
        }
    }
    let Some(list) = list else {
        eprintln!("error: name a list of crates: `corpus ci/corpus.toml`");
        return ExitCode::from(2);
    };
    let wanted = match List::read(&list) {
        Ok(wanted) => wanted,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::from(2);
        }
    };
    let (mut rows, mut faults) = (Vec::new(), Vec::new());
    for wanted in &wanted {
        let row = Row::of(wanted, verbose, &mut faults);
        eprintln!("{}: {} of {} functions", row.name, row.callable, row.functions);
        rows.push(row);
    }
    let all = rows.iter().flat_map(|row| row.reasons.keys());
    let unknown: BTreeSet<&String> = all.filter(|reason| !reasons::is_argued(reason)).collect();
    faults
        .extend(unknown.iter().map(|reason| format!("`{reason}` is a reason without an argument")));
    let mut text = table(&rows);
    for fault in &faults {
        writeln!(text, "fault: {fault}").expect("text takes text");
    }
    if let Some(file) = json {
        let json = serde_json::to_string_pretty(&rows).expect("rows are plain data");
        if let Err(error) = std::fs::write(&file, json) {
            eprintln!("error: `{file}`: {error}");
            return ExitCode::from(2);
        }
    }
    let written = std::io::stdout().write_all(text.as_bytes());
    let empty = rows.is_empty() || rows.iter().any(|row| row.modules == 0);
    if written.is_ok() && faults.is_empty() && !empty {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// Returns a Markdown table with a row for each crate and a row for the total, and a second table that explains why
/// Karat refuses functions.
fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "| crate | modules | open | whole | functions | callable | refused because |\n\
         |---|---:|---:|---:|---:|---:|---|\n",
    );
    let mut all = Row { name: "all".to_owned(), ..Row::default() };
    for row in rows {
        all.modules += row.modules;
        all.open += row.open;
        all.whole += row.whole;
        all.functions += row.functions;
        all.callable += row.callable;
        for (reason, count) in &row.reasons {
            *all.reasons.entry(reason.clone()).or_default() += count;
        }
    }
    for row in rows.iter().chain([&all]) {
        let mut reasons: Vec<_> = row.reasons.iter().collect();
        reasons.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        let reasons: Vec<_> =
            reasons.into_iter().map(|(reason, count)| format!("{reason} {count}")).collect();
        let share = 100.0 * row.callable as f64 / row.functions.max(1) as f64;
        writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} ({share:.0} %) | {} |",
            row.name,
            row.modules,
            row.open,
            row.whole,
            row.functions,
            row.callable,
            reasons.join(", ")
        )
        .expect("text takes text");
    }
    text + &reasons::told(all.functions, all.callable, &all.reasons)
}

impl Row {
    fn of(wanted: &Wanted, verbose: bool, faults: &mut Vec<String>) -> Self {
        let name = wanted.name();
        let mut row = Self { name: name.clone(), ..Row::default() };
        let package = match wanted.open() {
            Ok(package) => package,
            Err(error) => {
                faults.push(format!("{name}: {error}"));
                return row;
            }
        };
        let modules = match package.modules() {
            Ok(modules) => modules,
            Err(error) => {
                faults.push(format!("{name}: {error}"));
                return row;
            }
        };
        for module in modules {
            let began = Instant::now();
            let of_module = || format!("{name}, module `{module}`");
            let more = wanted.with.get(&module).into_iter().flatten();
            let package = more.fold(package.clone(), |package, name| package.feature(name, true));
            match catch_unwind(|| of(&package, &module, wanted.karat.is_none(), verbose)) {
                Ok((found, wrong)) => {
                    row.add(found);
                    faults
                        .extend(wrong.into_iter().map(|fault| format!("{}: {fault}", of_module())));
                }
                Err(_) => faults.push(format!("{}: a panic", of_module())),
            }
            let took = began.elapsed();
            row.slowest_ms = row.slowest_ms.max(took.as_millis());
            if took > SLOWEST {
                faults.push(format!("{}: it takes {} ms", of_module(), took.as_millis()));
            }
        }
        row
    }
}

impl Row {
    fn add(&mut self, other: Self) {
        self.modules += other.modules;
        self.open += other.open;
        self.whole += other.whole;
        self.functions += other.functions;
        self.callable += other.callable;
        for (reason, count) in other.reasons {
            *self.reasons.entry(reason).or_default() += count;
        }
    }

    fn refuse(&mut self, reason: &str, count: usize) {
        *self.reasons.entry(reason.to_owned()).or_default() += count;
    }
}

/// Returns a row with the counts of one module, and a message for each fault of Karat in this module.
fn of(package: &Package, module: &str, as_it_is: bool, verbose: bool) -> (Row, Vec<String>) {
    let (mut row, mut faults) = (Row { modules: 1, ..Row::default() }, Vec::new());
    let Some(text) = text_of(package, module) else {
        return (row, vec!["its file can't be read".to_owned()]);
    };
    let plain = as_it_is
        && naga::front::wgsl::parse_str(&text).ok().is_some_and(|module| {
            Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module).is_ok()
        });
    let whole = Program::of_module(package, module);
    row.whole = usize::from(whole.is_ok());
    if let (Err(error), true) = (&whole, verbose) {
        eprintln!("\n{module}: {error}");
    }
    match &whole {
        Err(error) if plain => faults.push(format!("naga accepts it, Karat says: {error}")),
        Ok(program) if plain && program.text() != text => {
            faults.push("naga accepts it, and Karat changes it".to_owned());
        }
        _ => {}
    }
    let items = match package.functions_in(module) {
        Ok(items) => items,
        Err(error) => {
            // If a module doesn't open, the program counts the functions in its text, so that no function is left out.
            row.functions = seeming_functions(&text);
            let reason = match reason(&error.to_string(), INVALID) {
                "syntax" if is_of_2021(&text) => "WGSL of 2021",
                reason => reason,
            };
            row.refuse(reason, row.functions);
            return (row, faults);
        }
    };
    row.open = 1;
    for item in items.into_iter().filter(|item| item.entry_point.is_none()) {
        row.functions += 1;
        faults.extend(misplaced(&text, &item).filter(|_| as_it_is));
        match Probed::new(package, &item.name) {
            Ok(probed) => {
                row.callable += 1;
                let span = &probed.function().span;
                let author = span.file.text.get(span.range.clone()).unwrap_or_default();
                // If the function may discard, the kernel says whether it did.
                let discards = matches!(&probed.function().result, Shape::Struct { members, .. }
                    if members.last().is_some_and(|(name, _)| name == "discarded"));
                if plain && !discards && !probed.kernel().contains(author) {
                    faults.push(format!("`{}` is linked with other bytes", item.name));
                }
            }
            Err(ProbeError::Reflect(ReflectError::Unprobeable(refusal))) => {
                row.refuse(reason(&refusal.to_string(), BY_NATURE), 1);
            }
            Err(error) => row.refuse(reason(&error.to_string(), INVALID), 1),
        }
    }
    (row, faults)
}

/// Returns the text of a module's file, before Karat processes it.
fn text_of(package: &Package, module: &str) -> Option<String> {
    let stem = package.root().join(module.replace("::", "/"));
    let file = |extension| std::path::PathBuf::from(format!("{}.{extension}", stem.display()));
    ["wgsl", "wesl"].into_iter().find_map(|extension| std::fs::read_to_string(file(extension)).ok())
}

/// Returns a message if the line that Karat reports for a function doesn't declare this function. Doesn't use Karat's
/// lexer, because the lexer itself may be wrong.
fn misplaced(text: &str, item: &FunctionItem) -> Option<String> {
    let (line, column) = item.span.file.line_column(item.span.range.start);
    let name = item.name.rsplit("::").next().unwrap_or_default();
    let author = text.lines().nth(line - 1).unwrap_or_default();
    let before: String = author.chars().take(column - 1).collect();
    let after: String = author.chars().skip(column - 1).collect();
    let sound = before.trim_end().ends_with("fn") && after.starts_with(name);
    (!sound).then(|| format!("`{}` isn't at line {line}: {author}", item.name))
}

/// Checks if a text has WGSL's syntax of 2021: `[[block]]`, or `;` between the members of a structure.
fn is_of_2021(text: &str) -> bool {
    let bodies = text.split("struct ").skip(1);
    let mut bodies = bodies.map(|body| body.split('}').next().unwrap_or_default());
    text.contains("[[") || bodies.any(|body| body.contains(';'))
}

fn seeming_functions(text: &str) -> usize {
    text.lines().filter(|line| line.trim_start().starts_with("fn ")).count()
}

/// The reasons why Karat can't call a valid function. Each entry has a piece of text to find in Karat's error message,
/// and the reason that the table shows for such a message.
const BY_NATURE: &[(&str, &str)] = &[
    ("a pointer", "pointer"),
    ("returns nothing", "no result"),
    ("may discard", "discards"),
    ("texture or sampler", "texture as argument"),
    ("64-bit", "64 bits"),
    ("without a fixed size", "runtime array"),
    ("", "not probed otherwise"),
];

/// The reasons why a module or function doesn't link or isn't valid, in the form of [`BY_NATURE`].
const INVALID: &[(&str, &str)] = &[
    ("template's placeholder", "template"),
    ("isn't WGSL: a preprocessor", "unknown preprocessor"),
    ("asset's path", "asset path"),
    ("has no value", "value of a feature"),
    ("`constants` has no", "value of a feature"),
    ("is false here", "under a condition"),
    ("to include", "included by others"),
    ("no dependency", "import not found"),
    ("no module declares `#define", "import not found"),
    ("unresolved", "import not found"),
    ("no definition in scope", "names of another file"),
    ("syntax error", "syntax"),
    ("", "invalid for naga"),
];

/// Returns the reason of the first entry of `reasons` whose piece of text occurs in `message`.
fn reason(message: &str, reasons: &[(&str, &'static str)]) -> &'static str {
    let found = reasons.iter().find(|(part, _)| message.contains(part));
    found.map_or("", |(_, reason)| reason)
}
