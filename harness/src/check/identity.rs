//! Which test is running: its name seeds its cases and leads the replay command.

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::Path as FilePath;
use std::sync::Once;

use crate::path::Path;
use crate::probe::Inputs;

/// The running test and the case selection of the environment.
#[derive(Clone, Debug)]
pub(crate) struct Identity {
    /// The test's name: its module path inside the test binary.
    pub(crate) test: String,
    /// The verb of the check; of a function's second check by the same verb `agrees_with#2`. It
    /// names the check in seeds, replay commands and the file of failures.
    pub(crate) check: String,
    /// `KARAT_SEED`, which replaces the seed of the selected check, or of all.
    seed: Option<u64>,
    /// `KARAT_CASE`, which selects one case.
    selection: Option<Selection>,
}

/// One case: of the check that a replay command names, or of every check.
#[derive(Clone, Debug)]
struct Selection {
    /// `function/check`
    check: Option<String>,
    case: u64,
    /// Which of the simpler values to take, again and again, from the case's own.
    steps: Vec<usize>,
    /// `KARAT_INPUT`: the lanes of the arguments that the case has in place of its own.
    input: Option<Vec<u32>>,
}

/// A case to be replayed, or what is to be in its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Replayed<'a> {
    pub(crate) case: u64,
    pub(crate) steps: &'a [usize],
    pub(crate) input: Option<&'a [u32]>,
}

impl Identity {
    /// Reads the thread's name and the environment.
    ///
    /// # Panics
    /// If `KARAT_SEED` or `KARAT_CASE` isn't a number, `KARAT_INPUT` isn't a list of words, or
    /// it is set without `KARAT_CASE`.
    pub(crate) fn current() -> Self {
        let variable = |name| std::env::var(name).ok().filter(|text| !text.is_empty());
        let input = variable("KARAT_INPUT").map(|text| {
            let words = read_words(&text);
            words.unwrap_or_else(|| panic!("KARAT_INPUT={text} isn't a list of hexadecimal words"))
        });
        let selection = variable("KARAT_CASE").map(|text| {
            let (check, case) = match text.rsplit_once('/') {
                Some((check, case)) => (Some(check.to_owned()), case),
                None => (None, &*text),
            };
            let (case, steps) = case.split_once(':').unwrap_or((case, ""));
            let steps = read_steps(steps).unwrap_or_else(|| {
                panic!("KARAT_CASE={text} has steps that aren't numbers with points between them")
            });
            Selection { check, case: number("KARAT_CASE", case), steps, input: input.clone() }
        });
        let stray = input.is_some() && selection.is_none();
        assert!(!stray, "KARAT_INPUT needs KARAT_CASE, which says for which check it is");
        let seed = variable("KARAT_SEED").map(|text| number("KARAT_SEED", &text));
        // The test runner names each test's thread. A program that isn't a test runs on `main`.
        let test = std::thread::current().name().unwrap_or("main").to_owned();
        Self { test, check: String::new(), seed, selection }
    }

    /// The same for one check. Checks of a function by one verb are told apart by their order in
    /// the test.
    pub(crate) fn of(function: &str, verb: &str) -> Self {
        thread_local! {
            static SEEN: RefCell<HashMap<String, u32>> = RefCell::default();
        }
        let identity = Self::current();
        let count = SEEN.with_borrow_mut(|seen| {
            let count = seen.entry(format!("{}\n{function}\n{verb}", identity.test)).or_default();
            *count += 1;
            *count
        });
        let check = if count == 1 { verb.to_owned() } else { format!("{verb}#{count}") };
        let identity = Self { check, ..identity };
        identity.note_other(function);
        identity
    }

    /// Says once that a replay is of another check: a name that none has would go unnoticed.
    fn note_other(&self, function: &str) {
        static NOTED: Once = Once::new();
        let named = self.selection.as_ref().and_then(|selection| selection.check.as_ref());
        let Some(named) = named else { return };
        if !self.selects(function, &self.check) && self.inputs(function, &self.check).is_none() {
            NOTED.call_once(|| {
                let check = &self.check;
                eprintln!(
                    "note: KARAT_CASE is of `{named}`; all cases of `{function}/{check}` run"
                );
            });
        }
    }

    /// Whether the environment speaks of this check: it names it, or names none.
    fn selects(&self, function: &str, check: &str) -> bool {
        let named = self.selection.as_ref().and_then(|selection| selection.check.as_ref());
        named.is_none_or(|named| *named == format!("{function}/{check}"))
    }

    /// The seed of a check: from the names of test, function and check, so that it stays the same
    /// wherever and in whatever order the tests run.
    pub(crate) fn seed(&self, function: &str, check: &str) -> u64 {
        // All sources of arguments have the same cases.
        let selected = self.inputs(function, check).is_some() || self.selects(function, check);
        self.seed.filter(|_| selected).unwrap_or_else(|| {
            let hash = blake3::hash(format!("{}\n{function}\n{check}", self.test).as_bytes());
            hash.as_bytes().iter().take(8).fold(0, |seed, byte| seed << 8 | u64::from(*byte))
        })
    }

    /// The one case of a check that is to run; `None`: all of them.
    pub(crate) fn case(&self, function: &str, check: &str) -> Option<u64> {
        let selection = self.selection.as_ref().filter(|_| self.selects(function, check))?;
        Some(selection.case)
    }

    /// The source of arguments that the environment names for this check, if it names the check.
    pub(crate) fn inputs(&self, function: &str, check: &str) -> Option<Inputs> {
        let named = self.selection.as_ref().and_then(|selection| selection.check.as_ref())?;
        Inputs::ALL
            .into_iter()
            .find(|inputs| *named == format!("{function}/{}", with_inputs(check, *inputs)))
    }

    /// Whether the environment asks for one case.
    pub(crate) fn replays(&self) -> bool {
        self.selection.is_some()
    }

    /// The arguments that the selected case of a check has in place of its own.
    pub(crate) fn input(&self, function: &str, check: &str) -> Option<&[u32]> {
        let selection = self.selection.as_ref().filter(|_| self.selects(function, check))?;
        selection.input.as_deref()
    }

    /// The steps to a simpler value from that of the selected case of a check.
    pub(crate) fn steps(&self, function: &str, check: &str) -> &[usize] {
        let selection = self.selection.as_ref().filter(|_| self.selects(function, check));
        selection.map_or(&[], |selection| &selection.steps)
    }

    /// The command that runs a check again, on one path and one case.
    pub(crate) fn replay(
        &self,
        path: Path,
        seed: u64,
        function: &str,
        check: &str,
        replayed: Replayed<'_>,
    ) -> String {
        let Replayed { case, steps, input } = replayed;
        let mut environment =
            format!("KARAT_PATHS={path} KARAT_SEED={seed:#x} KARAT_CASE={function}/{check}/{case}");
        if !steps.is_empty() {
            environment = format!("{environment}:{}", write_steps(steps));
        }
        if let Some(input) = input {
            environment = format!("{environment} KARAT_INPUT={}", write_words(input));
        }
        if let Some(folder) = crate::package::overlay() {
            environment = format!("KARAT_OVERLAY={} {environment}", folder.display());
        }
        let exe = std::env::current_exe().unwrap_or_default();
        // Cargo tells a test which package it belongs to; a test's thread has the test's name.
        let package = std::env::var("CARGO_PKG_NAME").ok().filter(|_| self.test != "main");
        match package {
            None => format!("{environment} {}", exe.display()),
            Some(package) => {
                let target = target(&exe, &package);
                format!("{environment} cargo test -p {package} {target} -- --exact {}", self.test)
            }
        }
    }
}

/// A check's name with the source of its arguments, unless that is a storage buffer.
pub(super) fn with_inputs(check: &str, inputs: Inputs) -> String {
    match inputs {
        Inputs::Storage => check.to_owned(),
        other => format!("{check}@{other}"),
    }
}

/// Lanes as the environment and files have them: `3f800000,00000000`.
pub(crate) fn write_words(words: &[u32]) -> String {
    let words: Vec<String> = words.iter().map(|word| format!("{word:08x}")).collect();
    words.join(",")
}

pub(crate) fn read_words(text: &str) -> Option<Vec<u32>> {
    text.split(',').map(|word| u32::from_str_radix(word.trim(), 16).ok()).collect()
}

/// Steps as the environment and files have them: `3.0`.
pub(crate) fn write_steps(steps: &[usize]) -> String {
    let steps: Vec<String> = steps.iter().map(ToString::to_string).collect();
    steps.join(".")
}

pub(crate) fn read_steps(text: &str) -> Option<Vec<usize>> {
    text.split('.').filter(|step| !step.is_empty()).map(|step| step.parse().ok()).collect()
}

fn number(name: &str, text: &str) -> u64 {
    let digits = text.trim().replace('_', "").to_lowercase();
    let number = match digits.strip_prefix("0x") {
        Some(hexadecimal) => u64::from_str_radix(hexadecimal, 16),
        None => digits.parse(),
    };
    number.unwrap_or_else(|error| panic!("{name}={text} isn't a number: {error}"))
}

/// Cargo's option for the target that a test binary was built from, by where it lies and what it
/// is called: `target/debug/deps/fresnel-1a2b...`.
fn target(exe: &FilePath, package: &str) -> String {
    let stem = exe.file_stem().unwrap_or_default().to_string_lossy();
    let name = stem.rsplit_once('-').map_or(&*stem, |(name, _)| name);
    let folder = exe.parent().and_then(FilePath::file_name).unwrap_or_default();
    if folder == "examples" {
        format!("--example {name}")
    } else if name == package.replace('-', "_") {
        "--lib --bins".to_owned()
    } else {
        format!("--test {name}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_told_by_their_place_and_name() {
        let of = |exe: &str| target(FilePath::new(exe), "my-crate");
        assert_eq!(of("/t/debug/deps/fresnel-0a1b"), "--test fresnel");
        assert_eq!(of("/t/debug/examples/srgb-0a1b"), "--example srgb");
        assert_eq!(of("/t/debug/deps/my_crate-0a1b"), "--lib --bins");
    }

    #[test]
    fn a_named_case_selects_one_check() {
        let named = Selection {
            check: Some("a::f/agrees_with".to_owned()),
            case: 7,
            steps: vec![],
            input: None,
        };
        let identity = |selection| {
            let (test, check) = ("t".to_owned(), String::new());
            Identity { test, check, seed: Some(1), selection }
        };
        let one = identity(Some(named));
        assert_eq!(one.case("a::f", "agrees_with"), Some(7));
        assert_eq!(one.case("a::f", "agrees_with#2"), None);
        assert_eq!(one.case("a::f", "satisfies"), None);
        assert_eq!(one.seed("a::f", "agrees_with"), 1);
        assert_ne!(one.seed("a::f", "satisfies"), 1);
        let any =
            identity(Some(Selection { check: None, case: 7, steps: vec![3, 0], input: None }));
        assert_eq!(any.case("b::g", "satisfies"), Some(7));
        assert_eq!(any.steps("b::g", "satisfies"), [3, 0]);
    }

    #[test]
    fn checks_of_one_function_are_told_apart() {
        let label = |function: &str| Identity::of(function, "satisfies").check;
        assert_eq!((label("a::f"), label("a::g")), ("satisfies".into(), "satisfies".into()));
        assert_eq!((label("a::f"), label("a::f")), ("satisfies#2".into(), "satisfies#3".into()));
    }
}
