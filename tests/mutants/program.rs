//! The mutants that a program makes of the library: all of them, or a sample.

use std::collections::BTreeSet;
use std::fmt;

use karat::Package;
use karat::unstable::reflect::Program;

use crate::library;
use karat_mutate::{Mutant, mutants};

/// Modules, and the tests that judge their mutants: their own, those of functions that have none,
/// and for entry points the frames.
pub(crate) const JUDGES: [(&str, &[&str]); 19] = [
    ("brdf", &["brdf"]),
    ("camera", &["camera"]),
    ("compensation", &["compensation"]),
    ("distribution", &["distribution"]),
    ("environment", &["environment"]),
    ("fresnel", &["fresnel"]),
    ("geometry", &["geometry"]),
    ("irradiance", &["irradiance"]),
    ("layering", &["layering"]),
    ("maps", &["maps", "golden"]),
    ("materials", &["materials"]),
    ("math", &["sampling"]),
    ("overdraw", &["overdraw"]),
    ("probe_room", &["probe_room", "golden"]),
    ("radiometry", &["radiometry"]),
    ("sampling", &["sampling"]),
    ("scene", &["scene", "golden"]),
    ("sensor", &["sensor"]),
    ("specular", &["specular"]),
];

/// The tests of a file that can see a mutant of a module; none: all of them. Other frames don't link
/// the module.
pub(crate) fn frames(module: &str, target: &str) -> &'static [&'static str] {
    match (module, target) {
        ("probe_room", "golden") => &["lambert", "lambert_parallax"],
        _ => &[],
    }
}

/// A mutant of a module of the library.
pub(crate) struct Candidate {
    pub(crate) module: &'static str,
    pub(crate) judges: &'static [&'static str],
    pub(crate) mutant: Mutant,
    /// The lines that change, before and after.
    pub(crate) lines: [String; 2],
}

impl Candidate {
    /// The module with the slip.
    pub(crate) fn text(&self) -> String {
        self.mutant.applied(&library::text(self.module))
    }

    /// Whether a filter names it: `brdf`, `brdf:31` or `brdf:31:12`.
    fn is_named(&self, filter: &str) -> bool {
        let Mutant { line, column, .. } = self.mutant;
        let mut parts = filter.split(':');
        parts.next() == Some(self.module)
            && parts.next().is_none_or(|part| part == line.to_string())
            && parts.next().is_none_or(|part| part == column.to_string())
    }

    /// Why naga doesn't accept it: such a mutant shows nothing of the tests.
    pub(crate) fn invalid(&self) -> Option<String> {
        let texts = JUDGES.iter().map(|(module, _)| {
            let text = if *module == self.module { self.text() } else { library::text(module) };
            (*module, text)
        });
        let package = Package::from_modules("mutant", texts);
        // A constant is seen by what uses it: each function of the module is linked.
        let functions = match package.functions_in(self.module) {
            Ok(functions) => functions,
            Err(error) => return Some(error.to_string()),
        };
        let own = format!("{}::{}", self.module, self.mutant.item);
        let in_function = functions.iter().any(|function| function.name == own);
        let touched = functions.iter().filter(|function| !in_function || function.name == own);
        touched
            .map(|function| Program::of_function(&package, &function.name))
            .find_map(|program| program.err().map(|error| error.to_string()))
    }
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { module, mutant, .. } = self;
        write!(f, "{module}:{mutant} in `{}` ({})", mutant.item, mutant.rule)
    }
}

/// All mutants of the library, valid or not.
pub(crate) fn candidates() -> Vec<Candidate> {
    let of_module = |(module, judges): (&'static str, &'static [&'static str])| {
        let text = library::text(module);
        let mutants = mutants(&text).into_iter();
        let candidates = mutants.map(|mutant| {
            let lines = mutant.lines(&text);
            Candidate { module, judges, mutant, lines }
        });
        candidates.collect::<Vec<_>>()
    };
    JUDGES.into_iter().flat_map(of_module).collect()
}

/// Which mutants a run takes.
pub(crate) enum Selection {
    /// Some, by a seed.
    Sample(u64),
    All,
    /// Those of modules, lines or places.
    Named(Vec<String>),
}

impl Selection {
    /// From `MUTANTS`, which is `all` or a list such as `brdf,geometry:26`, and `MUTANTS_SEED`.
    /// Names that begin with `KARAT_` are the harness's.
    pub(crate) fn from_environment(test: &str) -> Self {
        match std::env::var("MUTANTS") {
            Ok(all) if all == "all" => Self::All,
            Ok(names) => Self::Named(names.split(',').map(str::to_owned).collect()),
            Err(_) => Self::Sample(match std::env::var("MUTANTS_SEED") {
                Ok(seed) => {
                    seed.parse().unwrap_or_else(|_| panic!("MUTANTS_SEED={seed}: no number"))
                }
                Err(_) => hash(test),
            }),
        }
    }

    /// Those that it takes, in the order in which they are to be tried.
    ///
    /// # Panics
    ///
    /// If a name is that of no mutant.
    pub(crate) fn of(&self, mut all: Vec<Candidate>) -> Vec<Candidate> {
        match self {
            Self::All => all,
            Self::Named(filters) => {
                for filter in filters {
                    let known = all.iter().any(|candidate| candidate.is_named(filter));
                    assert!(known, "MUTANTS={filter}: there is no such mutant");
                }
                all.retain(|candidate| filters.iter().any(|filter| candidate.is_named(filter)));
                all
            }
            Self::Sample(seed) => {
                all.retain(|candidate| candidate.judges.len() == 1); // frames take minutes
                // Each module has its share, whatever its length: the least hash of each, then the
                // second of each, and so on.
                // By what changes and not by where: a line more above is no other sample.
                all.sort_by_cached_key(|Candidate { module, mutant, lines, .. }| {
                    let [before, after] = lines;
                    hash(&format!("{seed} {module} {} {before} {after}", mutant.item))
                });
                let mut rounds: Vec<(usize, Candidate)> = Vec::new();
                for candidate in all {
                    let earlier =
                        rounds.iter().filter(|(_, other)| other.module == candidate.module).count();
                    rounds.push((earlier, candidate));
                }
                rounds.sort_by_key(|(round, _)| *round);
                rounds.into_iter().map(|(_, candidate)| candidate).collect()
            }
        }
    }
}

/// FNV-1a.
fn hash(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// A mutant that no test can see, with the reason.
pub(crate) struct Listed {
    pub(crate) module: String,
    /// The function or constant.
    pub(crate) item: String,
    /// The lines before and after.
    pub(crate) lines: [String; 2],
    pub(crate) reason: String,
}

impl Listed {
    pub(crate) fn is(&self, candidate: &Candidate) -> bool {
        self.module == candidate.module
            && self.item == candidate.mutant.item
            && self.lines == candidate.lines
    }
}

/// `survivors.toml`.
pub(crate) fn listed() -> Vec<Listed> {
    let table: toml::Table =
        include_str!("survivors.toml").parse().expect("`survivors.toml` is TOML");
    let entries = table["survivor"].as_array().expect("a list of survivors");
    let field = |entry: &toml::Value, name: &str| {
        let text = entry.get(name).and_then(toml::Value::as_str);
        text.unwrap_or_else(|| panic!("{entry}: no `{name}`")).to_owned()
    };
    let mut found = Vec::new();
    for entry in entries {
        let [module, item, from, reason] =
            ["module", "item", "line", "reason"].map(|name| field(entry, name));
        let becomes = entry["becomes"].as_array().expect("a list of lines");
        for to in becomes.iter().map(|line| line.as_str().expect("a line").to_owned()) {
            let lines = [from.clone(), to];
            let (module, item, reason) = (module.clone(), item.clone(), reason.clone());
            found.push(Listed { module, item, lines, reason });
        }
    }
    found
}

/// What is wrong with the list itself.
pub(crate) fn complaints(listed: &[Listed], all: &[Candidate]) -> Vec<String> {
    let mut seen = BTreeSet::new();
    let mut complaints = Vec::new();
    for entry in listed {
        let Listed { module, item, lines, reason } = entry;
        let name = format!("survivors.toml: {module}::{item}: `{}` -> `{}`", lines[0], lines[1]);
        if !seen.insert((module, item, lines)) {
            complaints.push(format!("{name} stands there twice"));
        }
        if reason.trim().is_empty() {
            complaints.push(format!("{name} has no reason"));
        }
        if !all.iter().any(|candidate| entry.is(candidate)) {
            complaints.push(format!("{name} is no mutant any more"));
        }
    }
    complaints
}
