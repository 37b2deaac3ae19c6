//! Identifies the running test. The seeds of the test's cases, and the replay commands, depend on the test's name.

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::Path as FilePath;

use super::{NotReplayed, host, replay};
use crate::output;
use crate::path::Path;
use crate::probe::Inputs;
use crate::record::Replay;
use crate::settings::{self, SelectedCase, Settings, SettingsError};

/// The reason why a check can't begin.
#[derive(Clone, Debug, thiserror::Error)]
pub enum NotBegun {
    /// An environment variable has a value that can't be used.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The check runs in a thread without a name, and isn't the check that `KARAT_CASE` selects.
    #[error(transparent)]
    NotReplayed(#[from] NotReplayed),
}

/// The running check, and the settings from environment variables.
#[derive(Clone, Debug)]
pub(crate) struct Identity {
    /// The test's name, with its module path inside the test binary.
    pub(crate) test: String,
    /// The name of the check: its verb, or `agrees_with#2` if it is the test's second check of a function with this
    /// verb. Seeds, replay commands and the file of failing inputs use this name.
    pub(crate) check: String,
    settings: &'static Settings,
}

/// A case for a replay command, and the arguments that replace the case's own arguments.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Replayed<'a> {
    pub(crate) case: u64,
    pub(crate) steps: &'a [usize],
    pub(crate) input: Option<&'a [u32]>,
}

impl Identity {
    /// Begins a check of the running test. A second check of the same function with the same verb gets a number:
    /// `agrees_with#2`.
    pub(crate) fn of(function: &str, verb: &str) -> Result<Self, NotBegun> {
        thread_local! {
            static SEEN: RefCell<HashMap<String, u32>> = RefCell::default();
        }
        let (test, settings) = (test(), settings::current()?);
        let count = SEEN.with_borrow_mut(|seen| {
            let count = seen.entry(format!("{test}\n{function}\n{verb}")).or_default();
            *count += 1;
            *count
        });
        let check = if count == 1 { verb.to_owned() } else { format!("{verb}#{count}") };
        replay::begin(settings, &label(function, &check))?;
        Ok(Self { test, check, settings })
    }

    /// The case that `KARAT_CASE` selects. `None` if `KARAT_CASE` isn't set, or names another check.
    fn selected(&self, function: &str, check: &str) -> Option<&SelectedCase> {
        self.settings.case.as_ref().filter(|selected| match &selected.check {
            Some(named) => *named == label(function, check),
            None => true,
        })
    }

    /// The seed of a check: a hash of the names of the test, the function and the check. Such a seed is the same on all
    /// machines, and for any order of the tests. `KARAT_SEED` replaces the seed.
    pub(crate) fn seed(&self, function: &str, check: &str) -> u64 {
        let Settings { seed, case, .. } = self.settings;
        // All ways to pass arguments use the same seed, and so the same cases.
        let speaks = self.inputs(function, check).is_some()
            || case.is_none()
            || self.selected(function, check).is_some();
        seed.filter(|_| speaks).unwrap_or_else(|| {
            let hash = blake3::hash(format!("{}\n{function}\n{check}", self.test).as_bytes());
            hash.as_bytes().iter().take(8).fold(0, |seed, byte| seed << 8 | u64::from(*byte))
        })
    }

    /// The index of the only case to run, if `KARAT_CASE` selects a case of this check.
    pub(crate) fn case(&self, function: &str, check: &str) -> Option<u64> {
        Some(self.selected(function, check)?.case)
    }

    /// Reads from `KARAT_CASE` how this check passes its arguments: in a storage buffer, for example. `None` if
    /// `KARAT_CASE` doesn't name this check.
    pub(crate) fn inputs(&self, function: &str, check: &str) -> Option<Inputs> {
        let named = self.settings.case.as_ref()?.check.as_ref()?;
        Inputs::ALL
            .into_iter()
            .find(|inputs| *named == label(function, &with_inputs(check, *inputs)))
    }

    /// Checks if the test remembers failing inputs: the setting is on, and no replay selects a single case.
    pub(super) fn remembers(&self) -> bool {
        self.settings.case.is_none() && self.settings.failures
    }

    /// The arguments that `KARAT_INPUT` gives in place of the selected case's own arguments.
    pub(crate) fn input(&self, function: &str, check: &str) -> Option<&[u32]> {
        self.selected(function, check)?.input.as_deref()
    }

    /// The steps by which a replay simplifies the selected case.
    pub(crate) fn steps(&self, function: &str, check: &str) -> &[usize] {
        self.selected(function, check).map_or(&[], |selected| &selected.steps)
    }

    /// Makes the command that runs one case of a check again on one path.
    pub(crate) fn replay(
        &self,
        path: Option<Path>,
        seed: u64,
        function: &str,
        check: &str,
        replayed: Replayed<'_>,
    ) -> Replay {
        let Replayed { case, steps, input } = replayed;
        let mut selected = format!("{}/{case}", label(function, check));
        if !steps.is_empty() {
            selected = format!("{selected}:{}", write_steps(steps));
        }
        let overlay = settings::overlay().map(|folder| folder.display().to_string());
        let variables = [
            ("KARAT_OVERLAY", overlay),
            ("KARAT_PATHS", path.map(|path| path.to_string())),
            ("KARAT_SEED", Some(format!("{seed:#x}"))),
            ("KARAT_CASE", Some(selected)),
            ("KARAT_INPUT", input.map(write_words)),
        ];
        let set = |(name, value): (&str, Option<String>)| Some((name.to_owned(), value?));
        let variables = variables.into_iter().filter_map(set).collect();
        let (program, arguments) = self.program();
        Replay { variables, program, arguments }
    }

    fn program(&self) -> (String, Vec<String>) {
        if let Some(host) = host::current() {
            return host.command(&self.test);
        }
        let exe = std::env::current_exe().unwrap_or_default();
        // Cargo passes the package's name to the test. Test runners name a test's thread after the test.
        let package = std::env::var("CARGO_PKG_NAME").ok().filter(|_| self.test != "main");
        let Some(package) = package else { return (exe.display().to_string(), Vec::new()) };
        let mut arguments = vec!["test".to_owned(), "-p".to_owned(), package.clone()];
        arguments.extend(target(&exe, &package));
        arguments.push("--".to_owned());
        arguments.extend(selecting(&test_as_named()));
        ("cargo".to_owned(), arguments)
    }
}

/// The name of a function's check in replay commands.
fn label(function: &str, check: &str) -> String {
    format!("{}/{check}", output::name(function))
}

/// Returns the arguments with which a test program runs only this test. If the test's name contains characters
/// that don't belong in a command line, selects the test by a part of its name.
fn selecting(test: &str) -> Vec<String> {
    if output::name(test) == test {
        return vec!["--exact".to_owned(), test.to_owned()];
    }
    let is_plain = |c: char| c.is_alphanumeric() || matches!(c, '_' | ':' | ' ');
    let parts = test.split(|c| !is_plain(c)).map(str::trim);
    let longest = parts.max_by_key(|part| part.len()).unwrap_or_default();
    vec![longest[..longest.floor_char_boundary(PART)].to_owned()]
}

/// The largest number of bytes in the part of a name that selects a test.
const PART: usize = 100;

/// The name of a check and the way to pass arguments, such as `agrees_with@uniform`. A storage buffer is the default,
/// and adds nothing to the name.
pub(crate) fn with_inputs(check: &str, inputs: Inputs) -> String {
    match inputs {
        Inputs::Storage => check.to_owned(),
        other => format!("{check}@{other}"),
    }
}

/// Writes words as text, for environment variables and files: `3f800000,00000000`.
pub(super) fn write_words(words: &[u32]) -> String {
    let words: Vec<String> = words.iter().map(|word| format!("{word:08x}")).collect();
    words.join(",")
}

/// Writes the steps of a simplification as text, for environment variables and files: `[3, 0]` becomes `3.0`.
pub(super) fn write_steps(steps: &[usize]) -> String {
    let steps: Vec<String> = steps.iter().map(ToString::to_string).collect();
    steps.join(".")
}

/// The Cargo package of the running test. Empty if Cargo doesn't run the test.
pub(crate) fn cargo_package() -> String {
    match host::current() {
        None => std::env::var("CARGO_PKG_NAME").unwrap_or_default(),
        Some(_) => String::new(),
    }
}

/// Records that the running test skips a frame.
pub(crate) fn leave_frame_out() {
    crate::record::leave_out(&test());
}

/// The name of the running test. Test runners name a test's thread after the test. In a program without
/// tests, the name is `main`.
pub(crate) fn test() -> String {
    output::name(&test_as_named()).into_owned()
}

fn test_as_named() -> String {
    std::thread::current().name().unwrap_or("main").to_owned()
}

/// Returns Cargo's options that select the target of a test binary. The binary's path contains the
/// target's name: for `target/debug/deps/fresnel-1a2b...`, the options are `--test fresnel`.
fn target(exe: &FilePath, package: &str) -> Vec<String> {
    let stem = exe.file_stem().unwrap_or_default().to_string_lossy();
    let name = stem.rsplit_once('-').map_or(&*stem, |(name, _)| name);
    let folder = exe.parent().and_then(FilePath::file_name).unwrap_or_default();
    let options = if folder == "examples" {
        ["--example", name]
    } else if name == package.replace('-', "_") {
        ["--lib", "--bins"]
    } else {
        ["--test", name]
    };
    options.map(str::to_owned).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_found_by_their_place_and_name() {
        let of = |exe: &str| target(FilePath::new(exe), "my-crate");
        assert_eq!(of("/t/debug/deps/fresnel-0a1b"), ["--test", "fresnel"]);
        assert_eq!(of("/t/debug/examples/srgb-0a1b"), ["--example", "srgb"]);
        assert_eq!(of("/t/debug/deps/my_crate-0a1b"), ["--lib", "--bins"]);
    }

    // Lesson 182
    #[test]
    fn a_test_that_no_line_can_name_is_selected_by_a_part() {
        assert_eq!(selecting("brdf::grazing"), ["--exact", "brdf::grazing"]);
        assert_eq!(selecting("it's 1"), ["--exact", "it's 1"]);
        assert_eq!(selecting("a\n::error file=x::"), ["::error file"]);
        let long = "a".repeat(1 << 20);
        assert_eq!(selecting(&long), ["a".repeat(PART)]);
        let label = label(&long, "agrees_with");
        assert!(label.len() < 1024 && label.ends_with("/agrees_with"), "{label}");
    }

    #[test]
    fn a_named_case_selects_one_check() {
        let identity = |case: Option<&str>| {
            let (test, check) = ("t".to_owned(), String::new());
            let mut set = vec![("KARAT_SEED", "1")];
            set.extend(case.map(|case| ("KARAT_CASE", case)));
            let set = set.into_iter().map(|(name, value)| (name.into(), value.into()));
            let settings = Settings::read(set).expect("right settings");
            Identity { test, check, settings: Box::leak(Box::new(settings)) }
        };
        let one = identity(Some("a::f/agrees_with/7"));
        assert_eq!(one.case("a::f", "agrees_with"), Some(7));
        assert_eq!(one.case("a::f", "agrees_with#2"), None);
        assert_eq!(one.case("a::f", "satisfies"), None);
        assert_eq!(one.seed("a::f", "agrees_with"), 1);
        assert_ne!(one.seed("a::f", "satisfies"), 1);
        let any = identity(Some("7:3.0"));
        assert_eq!(any.case("b::g", "satisfies"), Some(7));
        assert_eq!(any.steps("b::g", "satisfies"), [3, 0]);
        let none = identity(None);
        assert_eq!((none.case("a::f", "satisfies"), none.seed("a::f", "satisfies")), (None, 1));
    }

    /// Different tests, functions and checks have different seeds.
    // Lesson 74
    #[test]
    fn each_check_has_a_seed_of_its_own() {
        let settings = Box::leak(Box::new(Settings::read([]).expect("nothing is set")));
        let seed = |test: &str, function: &str, check: &str| {
            let (test, settings) = (test.to_owned(), &*settings);
            Identity { test, check: check.to_owned(), settings }.seed(function, check)
        };
        let first = seed("t", "a::f", "agrees_with");
        assert_eq!(first, seed("t", "a::f", "agrees_with"));
        for other in [
            seed("u", "a::f", "agrees_with"),
            seed("t", "a::g", "agrees_with"),
            seed("t", "a::f", "agrees_with#2"),
        ] {
            assert_ne!(first, other);
        }
    }

    #[test]
    fn checks_of_one_function_have_different_names() {
        let label = |function: &str| {
            Identity::of(function, "satisfies").expect("nothing is replayed").check
        };
        assert_eq!((label("a::f"), label("a::g")), ("satisfies".into(), "satisfies".into()));
        assert_eq!((label("a::f"), label("a::f")), ("satisfies#2".into(), "satisfies#3".into()));
    }
}
