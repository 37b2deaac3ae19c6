//! Reads Karat's settings from environment variables. Karat reads and checks all variables whose names begin with
//! `KARAT_`, once for each process.
//!
//! An unknown name or value is an error, with a suggestion. If Karat ignored a misspelt `KARAT_REQUIRE` or
//! `KARAT_CASE`, a run could pass although the required path is missing or the case didn't run. A variable with an
//! empty value counts as not set.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Duration;

use crate::diagnostic::nearest;

const PREFIX: &str = "KARAT_";

/// Every variable that Karat reads, with its purpose and its default.
const VARIABLES: [(&str, &str); 17] = [
    (
        PATHS,
        "paths on which checks run, such as `vulkan`, `vulkan,gl`, `gl@llvmpipe` or `all` (default: the first path that opens, or `cpu` if no driver opens)",
    ),
    (REQUIRE, "paths that must run, such as `vulkan,gl`, but not `all` (default: none)"),
    (
        EXECUTORS,
        "programs that run jobs: `NAME=PROGRAM ARGUMENTS`, with `;` between programs. Each program is a path, `process@NAME` (default: none)",
    ),
    (
        ADAPTER,
        "the adapter to use: a part of the adapter's name (default: hardware before software)",
    ),
    (
        DEADLINE,
        "seconds that a shader may take before Karat aborts the process (default: 60; in `watch` 10)",
    ),
    (
        FUEL,
        "largest number of loop iterations in a case on `cpu`; loops with a known bound don't count (default: 1048576)",
    ),
    (
        SCHEDULES,
        "number of orders of invocations in which `cpu` runs a compute pass if it can't try all orders; 0: only the usual order (default: 16)",
    ),
    (SEED, "seed of the selected check, or of all checks (default: made from the test's name)"),
    (CASE, "the only case to run: `function/check/index` from a failure's message (default: all)"),
    (
        INPUT,
        "arguments that replace the case's own arguments, as hexadecimal 32-bit numbers (default: none)",
    ),
    (FAILURES, "`off`: Karat neither stores failing inputs nor tries stored ones (default: on)"),
    (FRAMES, "`off`: Karat skips frames, as `karat test --no-frames` does (default: on)"),
    (OVERLAY, "folder whose files replace modules of the same name (default: none)"),
    (
        TINT,
        "the Tint to use: the path of a folder with the npm package `webgpu`, of the program `tint`, or of a Chromium; `off`: Karat doesn't use Tint (default: the first that Karat finds)",
    ),
    (RECORD, "folder for verdicts, as JSON lines (default: none; `karat test` sets it)"),
    (
        COVERAGE,
        "folder for counts of the statements that tests run on `cpu` (default: none; `karat coverage` sets it)",
    ),
    (BROWSER, "Chromium for Karat's own tests of the review page (default: the first found)"),
];

const NAMES: [&str; VARIABLES.len()] = {
    let mut names = [""; VARIABLES.len()];
    let mut index = 0;
    while index < names.len() {
        names[index] = VARIABLES[index].0;
        index += 1;
    }
    names
};

const PATHS: &str = "KARAT_PATHS";
const REQUIRE: &str = "KARAT_REQUIRE";
const EXECUTORS: &str = "KARAT_EXECUTORS";
const ADAPTER: &str = "KARAT_ADAPTER";
const DEADLINE: &str = "KARAT_TIMEOUT";
const FUEL: &str = "KARAT_FUEL";
const SCHEDULES: &str = "KARAT_SCHEDULES";
const SEED: &str = "KARAT_SEED";
const CASE: &str = "KARAT_CASE";
const INPUT: &str = "KARAT_INPUT";
const FAILURES: &str = "KARAT_FAILURES";
const FRAMES: &str = "KARAT_FRAMES";
const OVERLAY: &str = "KARAT_OVERLAY";
const RECORD: &str = "KARAT_RECORD";
const COVERAGE: &str = "KARAT_COVERAGE";
const TINT: &str = "KARAT_TINT";
const BROWSER: &str = "KARAT_BROWSER";

/// The largest allowed value of `KARAT_SCHEDULES`. With so many orders for each pass, a run takes hours.
const MOST_SCHEDULES: u64 = 1 << 16;

/// The default limit for the loop iterations of a case: far more than a fast shader needs for a pixel. The engine runs
/// this many iterations in at most a few seconds, so endless loops are detected soon.
const FUEL_ROUNDS: u64 = 1 << 20;

/// The default time limit of a shader, in seconds: long enough for the shader of any test on a software rasteriser.
#[doc(hidden)]
pub const DEADLINE_SECONDS: f64 = 60.0;

/// The settings in the environment.
#[derive(Clone, Debug, PartialEq)]
#[doc(hidden)]
pub struct Settings {
    /// The paths on which checks run, such as `vulkan,gl`, or `all`. `None` selects the first path that opens.
    #[doc(hidden)]
    pub paths: Option<String>,
    /// The paths that must open, such as `vulkan,gl`.
    #[doc(hidden)]
    pub require: Option<String>,
    /// The programs that run jobs: for each executor its name, and its command with arguments.
    #[doc(hidden)]
    pub executors: Vec<(String, Vec<String>)>,
    /// A part of the name of the adapter to use.
    #[doc(hidden)]
    pub adapter: Option<String>,
    /// The time limit of a shader.
    #[doc(hidden)]
    pub deadline: Duration,
    /// The largest number of loop iterations that a case may run in the engine, over all loops. Loops don't count if
    /// naga's IR shows a bound for their iterations.
    #[doc(hidden)]
    pub fuel: u64,
    /// The number of orders in which the engine runs the invocations of a pass.
    #[doc(hidden)]
    pub schedules: Option<u64>,
    /// The seed of the selected check, or of all checks if no check is selected.
    #[doc(hidden)]
    pub seed: Option<u64>,
    /// The only case that a replay runs.
    #[doc(hidden)]
    pub case: Option<SelectedCase>,
    /// `true` if Karat stores failing inputs and tries them again.
    #[doc(hidden)]
    pub failures: bool,
    /// `true` if Karat draws and compares frames.
    #[doc(hidden)]
    pub frames: bool,
}

/// The case that a replay runs. If the replay command names no check, every check runs its case with the index `case`.
#[derive(Clone, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub struct SelectedCase {
    /// `function/check`
    #[doc(hidden)]
    pub check: Option<String>,
    #[doc(hidden)]
    pub case: u64,
    /// The steps from the case's own value to a simpler value. Each step is an index in the list of values that are
    /// simpler than the current value.
    #[doc(hidden)]
    pub steps: Vec<usize>,
    /// The words of the arguments that replace the case's own arguments.
    #[doc(hidden)]
    pub input: Option<Vec<u32>>,
}

/// The reason why a setting can't be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// There is no setting with this name.
    #[error("the environment sets `{name}`, which Karat doesn't know{}",
        nearest.map_or_else(
            || format!("; Karat reads {}", NAMES.join(", ")),
            |nearest| format!("; did you mean `{nearest}`?"),
        ))]
    Unknown {
        /// The name of the variable.
        name: String,
        /// The known variable with the most similar name.
        nearest: Option<&'static str>,
    },
    /// The setting can't have this value.
    #[error("{name}={value} isn't {expected}{}",
        nearest.map_or_else(String::new, |nearest| format!("; did you mean `{nearest}`?")))]
    Value {
        /// The name of the variable.
        name: &'static str,
        /// The variable's value.
        value: String,
        /// The possible values.
        expected: &'static str,
        /// The most similar possible value.
        nearest: Option<&'static str>,
    },
    /// The variable `KARAT_INPUT` is set, but `KARAT_CASE` isn't.
    #[error("KARAT_INPUT needs KARAT_CASE, which selects the check")]
    InputWithoutCase,
}

/// The settings of this process, from its environment.
///
/// # Errors
/// Returns an error if a variable is unknown, or has an invalid value.
#[doc(hidden)]
pub fn current() -> Result<&'static Settings, SettingsError> {
    static SETTINGS: OnceLock<Result<Settings, SettingsError>> = OnceLock::new();
    SETTINGS.get_or_init(|| Settings::read(std::env::vars_os())).as_ref().map_err(Clone::clone)
}

/// One of Karat's variables, and its value in the environment.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Variable {
    /// The variable's name, such as `KARAT_PATHS`.
    pub name: &'static str,
    /// The variable's purpose, with its default in brackets.
    pub about: &'static str,
    /// The variable's value. `None` if the variable isn't set, or is empty.
    pub value: Option<String>,
}

/// Every variable that Karat reads.
#[must_use]
pub fn variables() -> Vec<Variable> {
    let value = |name| Some(set(name)?.to_string_lossy().into_owned());
    VARIABLES.map(|(name, about)| Variable { name, about, value: value(name) }).to_vec()
}

/// The value of a variable, unless the value is empty.
fn set(name: &str) -> Option<OsString> {
    std::env::var_os(name).filter(|value| !value.is_empty())
}

/// The folder with files that Karat uses instead of the package's modules of the same names.
#[doc(hidden)]
pub fn overlay() -> Option<PathBuf> {
    set(OVERLAY).map(PathBuf::from)
}

/// The path of the Tint that Karat uses, or `off`.
#[doc(hidden)]
pub fn tint() -> Option<PathBuf> {
    set(TINT).map(PathBuf::from)
}

/// The folder for records of verdicts. Karat writes into this folder even if another setting is invalid.
#[doc(hidden)]
pub fn record() -> Option<PathBuf> {
    set(RECORD).map(PathBuf::from)
}

/// The folder into which tests write how often each statement ran.
#[doc(hidden)]
pub fn coverage() -> Option<PathBuf> {
    set(COVERAGE).map(PathBuf::from)
}

/// The largest number of loop iterations that a case may run in the engine. If a setting is invalid, the function
/// returns the default, because [`check`] reports the error.
#[doc(hidden)]
pub fn fuel() -> u64 {
    current().map_or(FUEL_ROUNDS, |settings| settings.fuel)
}

/// The number of orders in which the engine runs the invocations of a pass. `None` if `KARAT_SCHEDULES` isn't set.
#[doc(hidden)]
pub fn schedules() -> Option<u64> {
    current().ok()?.schedules
}

/// The time limit of a shader.
#[doc(hidden)]
pub fn deadline() -> Duration {
    let usual = Duration::from_secs_f64(DEADLINE_SECONDS);
    current().map_or(usual, |settings| settings.deadline)
}

/// Checks if Karat skips frames. Returns `false` if a setting is invalid, because [`check`] reports the error.
#[doc(hidden)]
pub fn leaves_frames_out() -> bool {
    current().is_ok_and(|settings| !settings.frames)
}

/// The text of `KARAT_CASE`.
#[doc(hidden)]
pub fn case_as_typed() -> String {
    set(CASE).unwrap_or_default().to_string_lossy().into_owned()
}

/// Checks the settings in the environment.
///
/// # Errors
/// Returns an error if a variable is unknown, or has an invalid value.
pub fn check() -> Result<(), SettingsError> {
    current().map(|_| ())
}

/// The old names of settings, with the new names.
const RENAMED: [(&str, &str); 1] = [("KARAT_DEADLINE", DEADLINE)];

impl Settings {
    #[doc(hidden)]
    pub fn read(
        environment: impl IntoIterator<Item = (OsString, OsString)>,
    ) -> Result<Self, SettingsError> {
        let mut set = BTreeMap::new();
        for (name, value) in environment {
            let name = name.to_string_lossy().into_owned();
            if !name.starts_with(PREFIX) || value.is_empty() {
                continue;
            }
            let Some(name) = NAMES.into_iter().find(|known| *known == name) else {
                let renamed = RENAMED.iter().find(|(old, _)| *old == name).map(|(_, new)| *new);
                let nearest = renamed.or_else(|| nearest(&name, NAMES));
                return Err(SettingsError::Unknown { name, nearest });
            };
            set.insert(name, value);
        }
        let text = |name: &'static str| -> Result<Option<String>, SettingsError> {
            let Some(value) = set.get(name) else { return Ok(None) };
            let text = value
                .to_str()
                .ok_or_else(|| refused(name, &value.to_string_lossy(), "text in UTF-8"))?;
            Ok(Some(text.trim().to_owned()).filter(|text| !text.is_empty()))
        };
        let parsed = |name: &'static str, expected: &'static str| {
            move |value: Option<String>| Parsed { name, expected, value }
        };
        let number = "a number: write decimal digits, or 0x and hexadecimal digits";
        let words = "a list of hexadecimal 32-bit numbers with commas between them";
        let seed = text(SEED).map(parsed(SEED, number))?.by(integer)?;
        let input = text(INPUT).map(parsed(INPUT, words))?.by(read_words)?;
        let case = "a case, `function/check/index`, as in a replay command";
        let case = text(CASE).map(parsed(CASE, case))?.by(SelectedCase::parse)?;
        if input.is_some() && case.is_none() {
            return Err(SettingsError::InputWithoutCase);
        }
        let seconds = "a number of seconds above 0";
        let deadline = text(DEADLINE).map(parsed(DEADLINE, seconds))?.by(duration)?;
        let rounds = "a number of loop iterations above 0";
        let above_zero = |text: &str| integer(text).filter(|rounds| *rounds > 0);
        let fuel = text(FUEL).map(parsed(FUEL, rounds))?.by(above_zero)?;
        let count = "a number of orders from 0 to 65536";
        let orders = |text: &str| integer(text).filter(|count| *count <= MOST_SCHEDULES);
        let schedules = text(SCHEDULES).map(parsed(SCHEDULES, count))?.by(orders)?;
        let programs = "a list of NAME=PROGRAM ARGUMENTS with `;` between the programs: write each name once, in \
                        lower-case letters and digits";
        let executors = text(EXECUTORS).map(parsed(EXECUTORS, programs))?.by(read_programs)?;
        Ok(Self {
            paths: text(PATHS)?,
            require: text(REQUIRE)?,
            executors: executors.unwrap_or_default(),
            adapter: text(ADAPTER)?,
            deadline: deadline.unwrap_or(Duration::from_secs_f64(DEADLINE_SECONDS)),
            fuel: fuel.unwrap_or(FUEL_ROUNDS),
            schedules,
            seed,
            case: case.map(|case| SelectedCase { input, ..case }),
            failures: switch(FAILURES, text(FAILURES)?)?,
            frames: switch(FRAMES, text(FRAMES)?)?,
        })
    }
}

/// Reads a setting with the value `on` (the default) or `off`.
fn switch(name: &'static str, value: Option<String>) -> Result<bool, SettingsError> {
    match value.as_deref() {
        None | Some("on") => Ok(true),
        Some("off") => Ok(false),
        Some(value) => {
            let nearest = nearest(value, ["on", "off"]);
            let (value, expected) = (value.to_owned(), "`on` or `off`");
            Err(SettingsError::Value { name, value, expected, nearest })
        }
    }
}

struct Parsed {
    name: &'static str,
    expected: &'static str,
    value: Option<String>,
}

impl Parsed {
    fn by<T>(self, parse: impl FnOnce(&str) -> Option<T>) -> Result<Option<T>, SettingsError> {
        let Self { name, expected, value } = self;
        let parse = |value: String| parse(&value).ok_or_else(|| refused(name, &value, expected));
        value.map(parse).transpose()
    }
}

fn refused(name: &'static str, value: &str, expected: &'static str) -> SettingsError {
    SettingsError::Value { name, value: value.to_owned(), expected, nearest: None }
}

impl SelectedCase {
    /// Reads `function/check/index` or `index`. A colon and the steps of a simplification may follow: `f/near/12:3.0`.
    fn parse(text: &str) -> Option<Self> {
        let (check, case) = match text.rsplit_once('/') {
            Some((check, case)) => (Some(check.to_owned()), case),
            None => (None, text),
        };
        let (case, steps) = case.split_once(':').unwrap_or((case, ""));
        Some(Self { check, case: integer(case)?, steps: read_steps(steps)?, input: None })
    }
}

/// Reads 32-bit words from the hexadecimal form that environment variables and files use: `3f800000,00000000`.
#[doc(hidden)]
pub fn read_words(text: &str) -> Option<Vec<u32>> {
    text.split(',').map(|word| u32::from_str_radix(word.trim(), 16).ok()).collect()
}

/// Reads the steps of a simplification, as environment variables and files contain them: `3.0` is step 3, then step 0.
#[doc(hidden)]
pub fn read_steps(text: &str) -> Option<Vec<usize>> {
    text.split('.').filter(|step| !step.is_empty()).map(|step| step.parse().ok()).collect()
}

/// Reads programs with their names: `dawn=node dawn.mjs; mine=target/debug/mine`.
fn read_programs(text: &str) -> Option<Vec<(String, Vec<String>)>> {
    let mut programs: Vec<(String, Vec<String>)> = Vec::new();
    for one in text.split(';').filter(|one| !one.trim().is_empty()) {
        let (name, command) = one.split_once('=')?;
        let name = name.trim();
        let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit();
        let command: Vec<String> = command.split_whitespace().map(str::to_owned).collect();
        let is_new = programs.iter().all(|(known, _)| known != name);
        if name.is_empty() || !name.chars().all(plain) || command.is_empty() || !is_new {
            return None;
        }
        programs.push((name.to_owned(), command));
    }
    Some(programs)
}

fn integer(text: &str) -> Option<u64> {
    let digits = text.trim().replace('_', "").to_lowercase();
    match digits.strip_prefix("0x") {
        Some(hexadecimal) => u64::from_str_radix(hexadecimal, 16).ok(),
        None => digits.parse().ok(),
    }
}

fn duration(text: &str) -> Option<Duration> {
    let duration = Duration::try_from_secs_f64(text.parse().ok()?).ok()?;
    (!duration.is_zero()).then_some(duration)
}

/// The path of a cached file in cargo's home, which outlives the `target` folder of a project. Karat can make the file
/// again if it is lost.
#[doc(hidden)]
pub fn kept(file: &str) -> Option<PathBuf> {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| Some(std::env::home_dir()?.join(".cargo")))?;
    Some(home.join("karat").join(file))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(environment: &[(&str, &str)]) -> Result<Settings, String> {
        let environment = environment.iter().map(|(name, value)| (name.into(), value.into()));
        Settings::read(environment).map_err(|error| error.to_string())
    }

    #[test]
    fn settings_without_variables_are_the_defaults() {
        let none = read(&[]).expect("no variable");
        assert_eq!((none.deadline, none.failures), (Duration::from_secs(60), true));
        assert_eq!((none.paths.clone(), none.seed, none.case.clone()), (None, None, None));
        let others = [("PATH", "/bin"), ("KARAT_SEED", ""), ("KARAT_CASE", " "), ("CI", "true")];
        assert_eq!(read(&others), Ok(none));
    }

    #[test]
    fn values_are_read() {
        let read = read(&[
            ("KARAT_PATHS", " vulkan,gl "),
            ("KARAT_SEED", "0xff"),
            ("KARAT_CASE", "a::f/agrees_with#2@uniform/7:3.0"),
            ("KARAT_INPUT", "3f800000,00000000"),
            ("KARAT_TIMEOUT", "1.5"),
            ("KARAT_FAILURES", "off"),
            ("KARAT_OVERLAY", "faults"),
            ("KARAT_EXECUTORS", "dawn=node dawn.mjs; mine = ./mine;"),
        ]);
        let read = read.expect("each of them is right");
        assert_eq!((read.paths.as_deref(), read.seed), (Some("vulkan,gl"), Some(255)));
        assert_eq!((read.deadline, read.failures), (Duration::from_millis(1500), false));
        let case = SelectedCase {
            check: Some("a::f/agrees_with#2@uniform".to_owned()),
            case: 7,
            steps: vec![3, 0],
            input: Some(vec![0x3f80_0000, 0]),
        };
        assert_eq!(read.case, Some(case));
        let command = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect();
        let dawn = ("dawn".to_owned(), command(&["node", "dawn.mjs"]));
        assert_eq!(read.executors, [dawn, ("mine".to_owned(), command(&["./mine"]))]);
    }

    // Lesson 66
    #[test]
    fn slips_are_errors_that_name_the_nearest() {
        for (name, value, message) in [
            (
                "KARAT_REQUIER",
                "gl",
                "the environment sets `KARAT_REQUIER`, which Karat doesn't know; did you mean \
                 `KARAT_REQUIRE`?",
            ),
            (
                "KARAT_DEADLINE",
                "9",
                "the environment sets `KARAT_DEADLINE`, which Karat doesn't know; did you mean \
                 `KARAT_TIMEOUT`?",
            ),
            ("KARAT_FAILURES", "of", "KARAT_FAILURES=of isn't `on` or `off`; did you mean `off`?"),
            ("KARAT_FAILURES", "banana", "KARAT_FAILURES=banana isn't `on` or `off`"),
            (
                "KARAT_SEED",
                "0xfg",
                "KARAT_SEED=0xfg isn't a number: write decimal digits, or 0x and hexadecimal digits",
            ),
            ("KARAT_SEED", "-1", "KARAT_SEED=-1 isn't a number"),
            ("KARAT_TIMEOUT", "a minute", "KARAT_TIMEOUT=a minute isn't a number of seconds"),
            ("KARAT_TIMEOUT", "0", "KARAT_TIMEOUT=0 isn't a number of seconds above 0"),
            ("KARAT_TIMEOUT", "NaN", "KARAT_TIMEOUT=NaN isn't a number of seconds above 0"),
            ("KARAT_SCHEDULES", "few", "KARAT_SCHEDULES=few isn't a number of orders from 0 to"),
            ("KARAT_SCHEDULES", "65537", "KARAT_SCHEDULES=65537 isn't a number of orders"),
            ("KARAT_FUEL", "0", "KARAT_FUEL=0 isn't a number of loop iterations above 0"),
            (
                "KARAT_CASE",
                "fresnel::schlick",
                "KARAT_CASE=fresnel::schlick isn't a case, `function/check/index`, as in a \
                 replay command",
            ),
            ("KARAT_CASE", "f/agrees_with/", "KARAT_CASE=f/agrees_with/ isn't a case"),
            ("KARAT_CASE", "f/agrees_with/7:x", "KARAT_CASE=f/agrees_with/7:x isn't a case"),
            ("KARAT_INPUT", "3f800000", "KARAT_INPUT needs KARAT_CASE"),
            ("KARAT_EXECUTORS", "node", "KARAT_EXECUTORS=node isn't a list of NAME=PROGRAM"),
            ("KARAT_EXECUTORS", "a=", "KARAT_EXECUTORS=a= isn't a list of NAME=PROGRAM"),
            ("KARAT_EXECUTORS", "A=b", "KARAT_EXECUTORS=A=b isn't a list of NAME=PROGRAM"),
            ("KARAT_EXECUTORS", "a=b;a=c", "KARAT_EXECUTORS=a=b;a=c isn't a list of NAME=PROGRAM"),
            ("KARAT_INPUT", "1.0", "KARAT_INPUT=1.0 isn't a list of hexadecimal 32-bit numbers"),
        ] {
            let error = read(&[(name, value)]).expect_err(value);
            assert!(error.starts_with(message), "{error}");
        }
        let error = read(&[("KARAT_BANANA_SPLIT", "1")]).expect_err("unknown");
        assert!(
            error.ends_with(
                "Karat reads KARAT_PATHS, KARAT_REQUIRE, KARAT_EXECUTORS, KARAT_ADAPTER, \
             KARAT_TIMEOUT, KARAT_FUEL, KARAT_SCHEDULES, KARAT_SEED, KARAT_CASE, KARAT_INPUT, KARAT_FAILURES, KARAT_FRAMES, \
             KARAT_OVERLAY, KARAT_TINT, KARAT_RECORD, KARAT_COVERAGE, KARAT_BROWSER"
            ),
            "{error}"
        );
    }
}
