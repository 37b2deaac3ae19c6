//! Declarations of failures on paths, and the combined verdict of all paths.
//!
//! If you declare that a path fails, the path must fail. If the path passes, the check fails, so that you
//! remove the declaration after the bug is fixed. The same rules apply to functions, frames and compute passes.

use std::collections::BTreeSet;
use std::fmt::{self, Display};

use super::Fails;
use crate::diagnostic::{At, Blame, Blamed};
use crate::executor::{self, Executor};
use crate::path::{Adapter, Path, PathError, Selected, Selector};
use crate::record::{Details, PathDetails, PathRecord};

/// A failure that the test declares with `fails_on` or `refused_on`, and that occurred.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownIssue {
    /// The path's name, its adapter and its driver.
    pub adapter: Adapter,
    /// The reason in the declaration.
    pub reason: String,
    /// The number of cases or pixels that Karat compared. 0 if the path refuses the program.
    pub cases: u64,
    /// The number of cases or pixels that failed. 1 if the path refuses the program.
    pub failures: u64,
}

/// The failures on several paths, for a message that contains more than one failure.
#[derive(Debug)]
pub struct PathFailures<E> {
    /// The failures of paths with wrong values, and the errors about wrong declarations.
    pub failures: Vec<E>,
    /// The paths that returned no values, each with the reason.
    pub stopped: Vec<(Adapter, E)>,
    /// The paths on which the check passes.
    pub agreeing: Vec<Adapter>,
}

impl<E: Display> PathFailures<E> {
    /// The failures as data for a record. The headline comes from the first failure.
    pub(crate) fn details(&self, of: impl Fn(&E) -> Details) -> Details {
        let mut all = self.failures.iter().map(&of);
        let mut details = all.next();
        for other in all {
            details.get_or_insert_default().paths.extend(other.paths);
        }
        for (adapter, error) in &self.stopped {
            let own = of(error);
            let stopped =
                PathDetails { stopped: Some(own.headline.clone()), ..PathDetails::on(adapter) };
            let details = details.get_or_insert_with(|| Details { paths: Vec::new(), ..own });
            details.paths.push(stopped);
        }
        details.unwrap_or_default()
    }
}

impl<E> PathFailures<E> {
    pub(crate) fn all(&self) -> impl Iterator<Item = &E> {
        self.failures.iter().chain(self.stopped.iter().map(|(_, error)| error))
    }
}

impl<E: Display> Display for PathFailures<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let failures = self.failures.iter().map(|failure| format!("{failure}"));
        let stopped = self
            .stopped
            .iter()
            .map(|(adapter, error)| format!("on {adapter} there is no verdict\n{error}"));
        let agreeing =
            self.agreeing.iter().map(|adapter| format!("on {adapter}\n  all results agree"));
        let all: Vec<String> = failures.chain(stopped).chain(agreeing).collect();
        let all: Vec<&str> = all.iter().map(|one| one.trim_end_matches('\n')).collect();
        f.write_str(&all.join("\n"))
    }
}

/// An error in a test's `fails_on`, `refused_on` or `tolerance_on`.
#[derive(Clone, Debug, thiserror::Error)]
pub enum WrongDeclaration {
    /// A path passes, although it is declared to fail.
    #[error(
        "`{subject}` passes on {path}, where it is declared to fail: {reason}\n\
         the bug is fixed, or hidden: remove the `fails_on`"
    )]
    UnexpectedPass {
        /// The name of the function, the golden or the variable.
        subject: String,
        /// The path.
        path: Path,
        /// The reason in the declaration.
        reason: String,
    },
    /// A path runs a program, although it is declared to refuse the program.
    #[error(
        "{path} runs `{subject}`, but is declared to refuse it: {reason}\n\
         the bug is fixed, or hidden: remove the `refused_on`"
    )]
    NotRefused {
        /// The name of the function, the golden or the variable.
        subject: String,
        /// The path.
        path: Path,
        /// The reason in the declaration.
        reason: String,
    },
    /// A declaration has no reason.
    #[error("the `{setting}` of `{subject}` on {on} has no reason: name the bug")]
    Unexplained {
        /// The name of the declaration: `fails_on` or `refused_on`.
        setting: &'static str,
        /// The name of the function, the golden or the variable.
        subject: String,
        /// The paths in the declaration.
        on: Selector,
    },
    /// A declaration names an unknown path.
    #[error("{error}")]
    Path {
        /// The name of the declaration: `fails_on`, `refused_on` or `tolerance_on`.
        setting: &'static str,
        /// The error about the path's name.
        error: PathError,
    },
}

/// Returns an error if a declaration contains an unknown path's name.
pub(crate) fn sound_paths<T>(
    setting: &'static str,
    declared: &Selected<T>,
) -> Result<(), WrongDeclaration> {
    declared.expect_sound().map_err(|error| WrongDeclaration::Path { setting, error })
}

impl WrongDeclaration {
    /// Checks if a declared bug no longer occurs. The record then has the verdict `fail`; for all other wrong
    /// declarations, it has the verdict `error`.
    pub(crate) fn is_verdict(&self) -> bool {
        matches!(self, Self::UnexpectedPass { .. } | Self::NotRefused { .. })
    }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct KnownIssues {
    /// The paths in `fails_on`, each with the reason.
    values: Selected<String>,
    /// The paths in `refused_on`, each with the reason.
    refusals: Selected<String>,
}

impl KnownIssues {
    pub(crate) fn declare(&mut self, on: Selector, reason: &str) {
        declare(&mut self.values, on, reason);
    }

    pub(crate) fn declare_refusal(&mut self, on: Selector, reason: &str) {
        declare(&mut self.refusals, on, reason);
    }

    /// Returns an error if a declaration names an unknown path, or has no reason.
    pub(crate) fn expect_sound<E>(&self, subject: &str) -> Result<(), E>
    where
        E: From<WrongDeclaration>,
    {
        for (setting, declared) in [("fails_on", &self.values), ("refused_on", &self.refusals)] {
            sound_paths(setting, declared)?;
            if let Some((on, _)) = declared.iter().find(|(_, reason)| reason.is_empty()) {
                let (subject, on) = (subject.to_owned(), on.clone());
                return Err(WrongDeclaration::Unexplained { setting, subject, on }.into());
            }
        }
        Ok(())
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.values.is_empty() && self.refusals.is_empty()
    }

    /// Checks if a `fails_on` or a `refused_on` names this path.
    pub(crate) fn names(&self, path: Path, adapter: &Adapter) -> bool {
        self.values.on(path, adapter).or_else(|| self.refusals.on(path, adapter)).is_some()
    }

    /// Judges each path, and combines the verdict with the path's declaration. A failure on one path doesn't
    /// stop the other paths. Functions, frames and compute passes have the same rules:
    ///
    /// - `fails_on` declares wrong values. At least one value on the path must be wrong, unless a replay selects a
    ///   single case. NaN and infinities count as values.
    /// - `refused_on` declares that a path refuses the program before any part of the program runs.
    /// - If a path stops for a reason other than a refusal, the check fails even if the path has a declaration.
    ///
    /// Adds the record of each path to `records`.
    pub(crate) fn conclude<V, E: Stop>(
        &self,
        subject: &str,
        executors: &[&dyn Executor],
        replays: bool,
        records: &mut Vec<PathRecord>,
        judge: JudgePath<'_, V, E>,
    ) -> Conclusion<V, E> {
        let mut all = Conclusion::default();
        for executor in executors {
            let (path, adapter) = (executor.path(), executor::adapter(*executor));
            let [fails, refuses] =
                [&self.values, &self.refusals].map(|of| of.on(path, &adapter).cloned());
            let judged = judge(*executor, &adapter);
            all.asked += 1;
            let Judged { mut record, values } = match (judged, &refuses) {
                (Err(error), Some(reason)) if error.is_refusal() => {
                    let (cases, failures) = (0, 1);
                    let reason = reason.clone();
                    let known_issue = Some(reason.clone());
                    records.push(PathRecord {
                        known_issue,
                        ..without_values(adapter.clone(), "refused")
                    });
                    all.known.push(KnownIssue { adapter, reason, cases, failures });
                    continue;
                }
                (Err(error), _) => {
                    all.stopped.push((adapter, error));
                    continue;
                }
                (Ok(judged), _) => judged,
            };
            record.known_issue = refuses.clone().or_else(|| fails.clone());
            let cases = record.configurations.unwrap_or(record.cases);
            let failures = record.failures;
            records.push(record);
            match (refuses, fails) {
                (Some(reason), _) => {
                    let subject = subject.to_owned();
                    all.wrong.push(WrongDeclaration::NotRefused { subject, path, reason });
                }
                (None, Some(reason)) if failures > 0 || replays => {
                    all.known.push(KnownIssue { adapter, reason, cases, failures });
                }
                (None, Some(reason)) => {
                    let subject = subject.to_owned();
                    all.wrong.push(WrongDeclaration::UnexpectedPass { subject, path, reason });
                }
                (None, None) if failures > 0 => all.differing.push((adapter, values)),
                (None, None) => all.agreeing.push((adapter, values)),
            }
        }
        if !all.all_stop_alike() {
            let stopped = all.stopped.iter();
            records.extend(stopped.map(|(adapter, _)| without_values(adapter.clone(), "stopped")));
        }
        all
    }
}

fn declare(all: &mut Selected<String>, on: Selector, reason: &str) {
    let reason = reason.trim();
    match all.get_mut(&on) {
        Some(known) if known.is_empty() || reason.is_empty() => known.clear(),
        Some(known) => *known = format!("{known}; {reason}"),
        None => all.declare(on, reason.to_owned()),
    }
}

fn without_values(adapter: Adapter, worst: &str) -> PathRecord {
    PathRecord { failures: 1, worst: worst.to_owned(), ..PathRecord::of(adapter) }
}

/// The results of a path, after Karat compared them with the expected values.
pub(crate) struct Judged<V> {
    /// The record of the path. `conclude` adds the declared reason to the record.
    pub(crate) record: PathRecord,
    pub(crate) values: V,
}

pub(crate) type JudgePath<'j, V, E> =
    &'j mut dyn FnMut(&dyn Executor, &Adapter) -> Result<Judged<V>, E>;

/// The failure of a check of a function, a frame or compute passes.
pub(crate) trait Stop: Fails + From<WrongDeclaration> {
    /// Checks if a path refused the program before any part of the program ran.
    fn is_refusal(&self) -> bool;

    /// The cause of the failure, as text. If all paths stop with the same cause, the report has one error.
    fn cause(&self) -> String {
        self.to_string()
    }

    fn of_paths(failures: PathFailures<Self>) -> Self
    where
        Self: Sized;
}

/// The verdicts of the paths.
pub(crate) struct Conclusion<V, E> {
    asked: usize,
    pub(crate) agreeing: Vec<(Adapter, V)>,
    differing: Vec<(Adapter, V)>,
    wrong: Vec<WrongDeclaration>,
    stopped: Vec<(Adapter, E)>,
    known: Vec<KnownIssue>,
}

impl<V, E> Default for Conclusion<V, E> {
    fn default() -> Self {
        let (agreeing, differing) = (Vec::new(), Vec::new());
        let (wrong, stopped, known) = (Vec::new(), Vec::new(), Vec::new());
        Self { asked: 0, agreeing, differing, wrong, stopped, known }
    }
}

/// The paths that agree, and the known issues of the paths that fail as declared.
pub(crate) type Agreed<V> = (Vec<(Adapter, V)>, Vec<KnownIssue>);

impl<V, E: Stop> Conclusion<V, E> {
    /// Checks if every path stops with the same error. Such an error isn't the fault of a single path.
    fn all_stop_alike(&self) -> bool {
        let Some(((_, first), others)) = self.stopped.split_first() else { return false };
        let first = first.cause();
        self.stopped.len() == self.asked && others.iter().all(|(_, error)| error.cause() == first)
    }

    /// Adds the results of other paths, or of the same paths with another way to pass arguments.
    pub(crate) fn extend(&mut self, other: Self) {
        self.asked += other.asked;
        self.agreeing.extend(other.agreeing);
        self.differing.extend(other.differing);
        self.wrong.extend(other.wrong);
        self.stopped.extend(other.stopped);
        self.known.extend(other.known);
    }

    /// Returns the paths that agree, or all failures. `differ` receives the paths with wrong values and the paths that
    /// agree, and makes the failures.
    pub(crate) fn verdict(
        mut self,
        differ: impl FnOnce(Vec<(Adapter, V)>, &[(Adapter, V)]) -> Vec<E>,
    ) -> Result<Agreed<V>, E> {
        if self.all_stop_alike() {
            return Err(self.stopped.swap_remove(0).1);
        }
        let Self { agreeing, differing, wrong, mut stopped, known, .. } = self;
        let without = differing.iter().map(|(adapter, _)| &adapter.path);
        let without = without.chain(stopped.iter().map(|(adapter, _)| &adapter.path));
        let without: BTreeSet<String> = without.cloned().collect();
        let mut failures = match differing.is_empty() {
            true => Vec::new(),
            false => differ(differing, &agreeing),
        };
        failures.extend(wrong.into_iter().map(E::from));
        match (failures.len(), stopped.len()) {
            (0, 0) => Ok((agreeing, known)),
            (1, 0) => Err(failures.swap_remove(0)),
            _ => {
                // Karat may judge a path once for each way to pass arguments. The path agrees if it agrees each
                // time.
                let mut seen = BTreeSet::new();
                stopped.retain(|(adapter, error)| {
                    seen.insert((adapter.path.clone(), error.to_string()))
                });
                let mut agrees = BTreeSet::new();
                let agreeing = agreeing.into_iter().map(|(adapter, _)| adapter);
                let agreeing = agreeing.filter(|adapter| {
                    !without.contains(&adapter.path) && agrees.insert(adapter.path.clone())
                });
                let agreeing = agreeing.collect();
                Err(E::of_paths(PathFailures { failures, stopped, agreeing }))
            }
        }
    }
}

impl Blamed for WrongDeclaration {
    fn blame(&self) -> Blame<'_> {
        Blame::setting(match self {
            Self::UnexpectedPass { .. } => &["fails_on"],
            Self::NotRefused { .. } => &["refused_on"],
            Self::Unexplained { setting, .. } | Self::Path { setting, .. } => {
                std::slice::from_ref(setting)
            }
        })
    }
}

/// Blames the shader's text if one of the failures blames the text. Otherwise blames the setting or the entry point
/// that the first such failure blames.
impl<E: Blamed> Blamed for PathFailures<E> {
    fn blame(&self) -> Blame<'_> {
        let all = || self.all().map(Blamed::blame);
        if all().any(|one| one.at == At::Text) {
            return Blame::VALUES;
        }
        let named = all().find(|one| one.at != At::Setting(&[]));
        Blame { message: None, ..named.unwrap_or(Blame::TEST) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug)]
    enum Error {
        Late,
        /// The error of a path that returns no values, with its reason.
        Other(&'static str),
        Refused,
        Declaration,
        Paths(PathFailures<Error>),
    }

    impl Display for Error {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            match self {
                Self::Late | Self::Declaration => f.write_str("late"),
                Self::Refused => f.write_str("refused"),
                Self::Other(reason) => f.write_str(reason),
                Self::Paths(paths) => write!(f, "{paths}"),
            }
        }
    }

    impl From<WrongDeclaration> for Error {
        fn from(_: WrongDeclaration) -> Self {
            Self::Declaration
        }
    }

    impl Blamed for Error {
        fn blame(&self) -> Blame<'_> {
            Blame::TEST
        }
    }

    impl Fails for Error {
        fn is_verdict(&self) -> bool {
            false
        }
    }

    impl Stop for Error {
        fn is_refusal(&self) -> bool {
            matches!(self, Self::Refused)
        }

        fn of_paths(failures: PathFailures<Self>) -> Self {
            Self::Paths(failures)
        }
    }

    fn adapter(path: &str) -> Adapter {
        let (path, name) = (path.to_owned(), path.to_owned());
        Adapter { path, name, driver: String::new(), software: true }
    }

    /// The headline comes from the first failure. The other paths keep their own failures.
    #[test]
    fn the_fault_of_each_path_is_kept() {
        let of = |failures: Vec<Error>, stopped: Vec<(Adapter, Error)>| {
            let paths = PathFailures { failures, stopped, agreeing: vec![adapter("z")] };
            let details = paths.details(|error| {
                let headline = error.to_string();
                let paths = vec![PathDetails::on(&adapter(&headline))];
                Details { headline, paths, ..Details::default() }
            });
            let one = |one: &PathDetails| (one.adapter.path.clone(), one.stopped.clone());
            (details.headline, details.paths.iter().map(one).collect::<Vec<_>>())
        };
        let stopped = || vec![(adapter("c"), Error::Other("lost")), (adapter("d"), Error::Late)];
        let [a, b] = ["a", "b"].map(|path| (path.to_owned(), None));
        let [c, d] =
            [("c", "lost"), ("d", "late")].map(|(path, why)| (path.into(), Some(why.into())));
        let failures = || vec![Error::Other("a"), Error::Other("b")];
        assert_eq!(of(failures(), Vec::new()), ("a".to_owned(), vec![a.clone(), b.clone()]));
        assert_eq!(of(failures(), stopped()), ("a".to_owned(), vec![a, b, c.clone(), d.clone()]));
        assert_eq!(of(Vec::new(), stopped()), ("lost".to_owned(), vec![c, d]));
    }

    /// If all paths stop for the same reason, there is one error. Otherwise the message lists each path.
    #[test]
    fn paths_that_stop_for_the_same_reason_give_one_error() {
        let of = |asked: usize, reasons: &[&'static str]| {
            let stopped = reasons.iter().enumerate();
            let stopped =
                stopped.map(|(at, reason)| (adapter(&format!("{at}")), Error::Other(reason)));
            let all = Conclusion::<(), Error> {
                asked,
                stopped: stopped.collect(),
                ..Conclusion::default()
            };
            match all.verdict(|_, _| Vec::new()) {
                Err(Error::Other(reason)) => reason.to_owned(),
                Err(Error::Paths(paths)) => paths.to_string(),
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(of(2, &["lost", "lost"]), "lost");
        assert_eq!(of(1, &["lost"]), "lost");
        let told = "on 0: 0 there is no verdict\nlost\non 1: 1 there is no verdict\n";
        assert_eq!(of(2, &["lost", "late"]), format!("{told}late"));
        assert_eq!(of(3, &["lost", "lost"]), format!("{told}lost"), "another one did not stop");
        let third = "\non 2: 2 there is no verdict\nlate";
        assert_eq!(of(3, &["lost", "lost", "late"]), format!("{told}lost{third}"));
    }

    /// If two declarations name the same path, Karat joins their reasons. If one of the two reasons is empty,
    /// the joined reason is empty.
    #[test]
    fn reasons_of_a_path_declared_twice_are_joined() {
        let of = |declared: &[(&'static str, &str)]| {
            let mut all = KnownIssues::default();
            declared.iter().for_each(|(on, reason)| all.declare((*on).into(), reason));
            let reasons = all.values.iter().map(|(_, reason)| reason.clone());
            (reasons.collect::<Vec<_>>(), all.expect_sound::<Unsound>("f").is_ok())
        };
        let told = |reasons: &[&str], sound| {
            (reasons.iter().map(|one| (*one).to_owned()).collect::<Vec<_>>(), sound)
        };
        assert_eq!(of(&[("gl", " bug 1 ")]), told(&["bug 1"], true));
        assert_eq!(of(&[("gl", "bug 1"), ("gl", "bug 2")]), told(&["bug 1; bug 2"], true));
        let apart = [("gl", "bug 1"), ("vulkan", "bug 2"), ("gl", "bug 3")];
        assert_eq!(of(&apart), told(&["bug 1; bug 3", "bug 2"], true));
        assert_eq!(of(&[("gl", "bug 1"), ("gl", "")]), told(&[""], false));
        assert_eq!(of(&[("gl", " "), ("gl", "bug 1")]), told(&[""], false));
        assert_eq!(of(&[("gll", "bug 1")]), told(&["bug 1"], false), "no path is called so");
        let refused = |on: &'static str, reason| {
            let mut all = KnownIssues::default();
            all.declare_refusal(on.into(), reason);
            assert!(all.names(Path::GL, &adapter("gl")) == (on == "gl"), "{on}");
            all.expect_sound::<Unsound>("f").is_ok()
        };
        assert_eq!(
            [refused("gl", "bug"), refused("gl", ""), refused("gll", "bug")],
            [true, false, false]
        );
    }

    /// A path for which the test chooses the verdict.
    #[derive(Debug)]
    struct Judge(&'static str);

    impl Executor for Judge {
        fn path(&self) -> Path {
            self.0.parse().expect("a name")
        }

        fn adapter(&self) -> Adapter {
            adapter(self.0)
        }
    }

    /// The outcome for a path depends on its verdict and its declaration. The declarations say that
    /// `gl` fails, and that `vulkan` refuses.
    #[test]
    fn each_verdict_has_a_meaning_by_what_is_declared() {
        let mut declared = KnownIssues::default();
        declared.declare("gl".into(), "wrong");
        declared.declare("dx12".into(), "wrong too");
        declared.declare_refusal("vulkan".into(), "too large");
        declared.declare_refusal("dx12".into(), "too deep");
        let of = |path: &'static str, verdict: fn() -> Result<u64, Error>, replays: bool| {
            let mut records = Vec::new();
            let judge = &mut |_: &dyn Executor, adapter: &Adapter| -> Result<_, Error> {
                let record = PathRecord { failures: verdict()?, ..PathRecord::of(adapter.clone()) };
                Ok(Judged { record, values: () })
            };
            let own = Judge(path);
            let all =
                declared.conclude("f", &[&own, &Judge("metal")], replays, &mut records, judge);
            let records: Vec<_> = records.iter().filter(|one| one.adapter.path == path).collect();
            let known = all.known.iter().find(|one| one.adapter.path == path);
            let record = records.first().map_or("none".to_owned(), |record| {
                format!("{} {}", record.worst, record.known_issue.as_deref().unwrap_or("-"))
            });
            let is = match () {
                () if known.is_some() => "known",
                () if !all.wrong.is_empty() => "wrong",
                () if all.stopped.iter().any(|(one, _)| one.path == path) => "stopped",
                () if all.differing.iter().any(|(one, ())| one.path == path) => "differs",
                () => "agrees",
            };
            format!("{is}, {}", record.trim_start())
        };
        for (path, verdict, replays, expected) in [
            ("gl", (|| Ok(3)) as fn() -> Result<u64, Error>, false, "known, wrong"),
            ("gl", || Ok(0), false, "wrong, wrong"),
            ("gl", || Ok(0), true, "known, wrong"),
            ("gl", || Err(Error::Late), false, "stopped, none"),
            ("gl", || Err(Error::Refused), false, "stopped, none"),
            ("vulkan", || Err(Error::Refused), false, "known, refused too large"),
            ("vulkan", || Err(Error::Late), false, "stopped, none"),
            ("vulkan", || Ok(0), false, "wrong, too large"),
            ("vulkan", || Ok(3), true, "wrong, too large"),
            ("dx12", || Ok(3), false, "wrong, too deep"),
            ("dx12", || Err(Error::Refused), false, "known, refused too deep"),
            ("cpu", || Ok(3), true, "differs, -"),
            ("cpu", || Ok(0), false, "agrees, -"),
        ] {
            assert_eq!(of(path, verdict, replays), expected, "{path}");
        }
    }

    /// If a check judges the same path several times, each result counts.
    #[test]
    fn several_results_of_one_path_all_count() {
        let stops = |path: &str| Conclusion::<(), Error> {
            asked: 1,
            stopped: vec![(adapter(path), Error::Other("lost"))],
            ..Conclusion::default()
        };
        let mut all = stops("a");
        all.extend(stops("a"));
        let alike = all.verdict(|_, _| Vec::new());
        assert!(matches!(alike, Err(Error::Other("lost"))), "{alike:?}");
        let known = |path: &str| {
            let (adapter, reason) = (adapter(path), "bug".to_owned());
            KnownIssue { adapter, reason, cases: 2, failures: 1 }
        };
        let agrees = |path: &str| Conclusion::<(), Error> {
            asked: 2,
            agreeing: vec![(adapter(path), ())],
            known: vec![known(path)],
            ..Conclusion::default()
        };
        let mut all = agrees("a");
        all.extend(agrees("b"));
        let (agreeing, issues) = all.verdict(|_, _| Vec::new()).expect("they agree");
        assert_eq!((agreeing.len(), issues), (2, vec![known("a"), known("b")]));
        // The message shows stopped paths even if another path fails.
        let mut all = agrees("a");
        all.extend(Conclusion { differing: vec![(adapter("b"), ())], ..stops("c") });
        let found = all.verdict(|differing, agreeing| {
            assert_eq!((differing.len(), agreeing.len()), (1, 1));
            vec![Error::Other("off")]
        });
        let Err(Error::Paths(paths)) = found else { panic!("{found:?}") };
        assert_eq!(
            paths.to_string(),
            "off\non c: c there is no verdict\nlost\non a: a\n  all results agree"
        );
        let all: Vec<String> = paths.all().map(ToString::to_string).collect();
        assert_eq!(all, ["off", "lost"]);
    }

    struct Unsound;

    impl From<PathError> for Unsound {
        fn from(_: PathError) -> Self {
            Self
        }
    }

    impl From<WrongDeclaration> for Unsound {
        fn from(_: WrongDeclaration) -> Self {
            Self
        }
    }

    /// With two ways to pass arguments, Karat judges each path twice, and the message names each path once.
    #[test]
    fn a_path_is_named_once() {
        let mut all = Conclusion::<(), Error>::default();
        for (stop, agree) in [(["a", "c"], ["b", "d"]), (["c", "e"], ["a", "b"])] {
            all.extend(Conclusion {
                asked: 4,
                agreeing: agree.map(|path| (adapter(path), ())).into(),
                stopped: stop.map(|path| (adapter(path), Error::Late)).into(),
                ..Conclusion::default()
            });
        }
        let Err(Error::Paths(paths)) = all.verdict(|_, _| Vec::new()) else {
            panic!("some paths stop")
        };
        let stopped: Vec<&str> = paths.stopped.iter().map(|(adapter, _)| &*adapter.path).collect();
        let agreeing: Vec<&str> = paths.agreeing.iter().map(|adapter| &*adapter.path).collect();
        assert_eq!((&*stopped, &*agreeing), (&["a", "c", "e"][..], &["b", "d"][..]));
    }
}
