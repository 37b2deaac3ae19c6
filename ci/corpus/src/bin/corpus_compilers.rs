//! Checks shaders of other projects with both WGSL compilers, naga and Tint, and counts the reasons for rejections.
//!
//! `cargo run --bin corpus_compilers -- LIST.toml` reads the modules of each crate and folder of a list (see
//! `corpus.rs`), and prints tables. `cargo ci corpus --compilers` runs the program over `ci/corpus.toml`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::process::ExitCode;

use karat::unstable::reflect::{Invalid, Opinion};
use karat::unstable::tint::Tint;

#[path = "../list.rs"]
mod list;

use list::{List, Wanted};

#[derive(Default)]
struct Sum {
    modules: usize,
    both: usize,
    /// The number of modules that naga accepts and Tint rejects because they use features that only wgpu has.
    native: usize,
    naga_alone: usize,
    tint_alone: usize,
    /// The number of modules that neither compiler accepts, for example because the crate's own program must process
    /// them first.
    neither: usize,
}

impl Sum {
    fn row(&self, name: &str) -> String {
        let Self { modules, both, native, naga_alone, tint_alone, neither } = self;
        format!(
            "| {name} | {modules} | {both} | {native} | {naga_alone} | {tint_alone} | {neither} |\n"
        )
    }

    fn add(&mut self, other: &Self) {
        self.modules += other.modules;
        self.both += other.both;
        self.native += other.native;
        self.naga_alone += other.naga_alone;
        self.tint_alone += other.tint_alone;
        self.neither += other.neither;
    }
}

/// A module that naga accepts and Tint rejects.
struct Difference {
    module: String,
    reason: &'static str,
    /// The first line of Tint's message.
    message: String,
    /// The place of the error in the author's file: `fog.wgsl:12:5`.
    place: String,
    native: Vec<String>,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [list] = &*arguments else {
        eprintln!("error: name a list of crates: `corpus_compilers ci/corpus.toml`");
        return ExitCode::from(2);
    };
    match List::read(list).and_then(|wanted| tables(&wanted)) {
        Ok(text) => match std::io::stdout().write_all(text.as_bytes()) {
            Ok(()) => ExitCode::SUCCESS,
            Err(_) => ExitCode::FAILURE,
        },
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn tables(wanted: &[Wanted]) -> Result<String, String> {
    let here = std::env::current_dir().map_err(|error| error.to_string())?;
    let version = match Tint::beside(&here, true) {
        Ok(tint) => tint.version()?,
        Err(missing) => return Err(format!("Tint isn't installed: {missing}; {}", missing.remedy)),
    };
    let mut text =
        format!("The tables have the verdicts of Karat's naga, and of the Tint in {version}.\n\n");
    text += "| crate | modules | both | naga alone, on purpose | naga alone | Tint alone | neither |\n\
             |---|---:|---:|---:|---:|---:|---:|\n";
    let (mut all, mut differences) = (Sum::default(), Vec::new());
    for wanted in wanted {
        let (sum, own) = read(wanted)?;
        let row = sum.row(&wanted.name());
        eprint!("{row}");
        text += &row;
        all.add(&sum);
        differences.extend(own);
    }
    if all.both == 0 {
        return Err("Tint accepted nothing, so nothing was compared".to_owned());
    }
    text += &all.row("all");
    let mut reasons: BTreeMap<(bool, &str), usize> = BTreeMap::new();
    for difference in &differences {
        *reasons.entry((!difference.native.is_empty(), difference.reason)).or_default() += 1;
    }
    text += "\n| reason | modules | on purpose |\n|---|---:|---|\n";
    for ((native, reason), count) in reasons {
        let purpose = if native { "yes" } else { "no" };
        writeln!(text, "| {reason} | {count} | {purpose} |").expect("a text");
    }
    text += "\n| module that naga alone accepts | place | Tint says |\n|---|---|---|\n";
    for Difference { module, message, place, native, .. } in &differences {
        let native = match native.is_empty() {
            true => String::new(),
            false => format!(" (uses {})", native.join(", ")),
        };
        let message = message.replace('|', "\\|").replace('<', "\\<");
        writeln!(text, "| {module} | {place} | {message}{native} |").expect("a text");
    }
    Ok(text)
}

/// Compiles all modules of a crate with naga and with Tint. Returns the counts, and the modules that naga accepts and
/// Tint rejects.
fn read(wanted: &Wanted) -> Result<(Sum, Vec<Difference>), String> {
    let name = wanted.name();
    let package = wanted.open().map_err(|error| format!("{name}: {error}"))?;
    let with = wanted.with.iter().fold(package, |package, (module, features)| {
        let features: Vec<&str> = features.iter().map(String::as_str).collect();
        package.module_features(module, &features)
    });
    let (modules, rejected, opinion) = match with.try_is_valid() {
        Ok(found) => (found.modules, 0, found.opinion),
        Err(Invalid::Modules { modules, errors, opinion, .. }) => (modules, errors.len(), *opinion),
        Err(Invalid::Nothing { .. }) => (0, 0, Opinion::default()),
        Err(error) => return Err(format!("{name}: {error}")),
    };
    if let Some((module, how)) = opinion.broke.first() {
        return Err(format!("{name}: Tint has no verdict on `{module}`: {how}"));
    }
    let native = opinion.refused.iter().filter(|refused| !refused.native.is_empty()).count();
    let sum = Sum {
        modules,
        both: opinion.accepted,
        native,
        naga_alone: opinion.refused.len() - native,
        tint_alone: opinion.tint_alone.len(),
        neither: rejected - opinion.tint_alone.len(),
    };
    let differences = opinion.refused.into_iter().map(|refused| {
        let place = refused.diagnostic.location().map_or_else(String::new, |span| {
            let (line, column) = span.file.line_column(span.range.start);
            let file = std::path::Path::new(&span.file.name).file_name().unwrap_or_default();
            format!("{}:{line}:{column}", file.to_string_lossy())
        });
        let message = refused.diagnostic.message;
        let said = message.split_once(": ").map_or(&*message, |(_, said)| said).to_owned();
        let module = format!("{name} `{}`", refused.module);
        let (reason, native) = (refused.reason.name(), refused.native);
        Difference { module, reason, message: said, place, native }
    });
    Ok((sum, differences.collect()))
}
