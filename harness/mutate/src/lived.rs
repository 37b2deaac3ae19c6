//! Why a mutant lived: where it and the original part, if they do.

use std::fmt;

use karat::Package;
use karat::unstable::interpret::equal::{Guard, agree_everywhere, is_same, never_acts};
use karat::unstable::probe::Probed;
use karat_inspect::compare::{Change, Compared, PathChange, Request};
use serde::Serialize;

use crate::Candidate;
use crate::maker::{Mutant, Rule};

/// Why a mutant lived.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "why", rename_all = "snake_case")]
pub enum Lived {
    /// It returns something else where no test looks.
    Differs(Difference),
    /// No input was found for which it returns something else. That shows nothing beyond these inputs.
    Unseen {
        /// The inputs that were tried.
        cases: usize,
    },
    /// It is the sampler of a test, and the shader is the same: no test samples where the two differ.
    Sampler,
    /// Original and mutant can't be compared.
    Unknown {
        /// Why.
        reason: String,
    },
}

/// Where original and mutant part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// The function that shows it: `calc::half`.
    pub function: String,
    /// The simplest arguments that show it, by their names, and the members of buffers that matter there.
    pub arguments: Vec<(String, String)>,
    /// The result of the original, or the values that its pass leaves.
    pub original: String,
    /// The result of the mutant there.
    pub mutant: String,
    /// True if its numbers are floats, of which a test says how near they have to be.
    pub floats: bool,
    /// True of a compute pass, which leaves something and returns nothing.
    pub leaves: bool,
    /// True if its arguments alone make the difference, and no feature.
    #[serde(skip)]
    pastes: bool,
}

/// Why no test can see a mutant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Equality {
    /// Its function executes the same operations.
    Operations,
    /// It leaves a guard out that never acts: whatever the arguments, the value lies within its bounds.
    Intervals,
    /// Its function returns the same for so many inputs, and has no others.
    Inputs(usize),
}

impl fmt::Display for Equality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Operations => f.write_str("it executes the same operations"),
            Self::Intervals => {
                f.write_str("the guard never acts: by intervals its value is within the bound")
            }
            Self::Inputs(0 | 1) => f.write_str("it has no inputs, and returns the same"),
            Self::Inputs(count) => write!(f, "it returns the same for all {count} inputs"),
        }
    }
}

/// Why a mutant's function is known to do what the original does; `None`: it may do something else.
pub(crate) fn equality(
    original: &Package,
    mutant: &Package,
    candidate: &Candidate,
) -> Option<Equality> {
    let probed = [original, mutant].map(|package| Probed::new(package, &candidate.path()));
    let [Ok(a), Ok(b)] = &probed else { return None };
    let Mutant { rule, range, original, replacement, .. } = &candidate.mutant;
    let argument = replacement.strip_prefix('(').and_then(|rest| rest.strip_suffix(')'));
    let guard = argument.map(|argument| Guard { at: range.start, text: original, argument });
    let guard = guard.filter(|_| *rule == Rule::Guard);
    match guard.is_some_and(|guard| never_acts(a, &guard)) {
        _ if is_same([a, b]) => Some(Equality::Operations),
        true => Some(Equality::Intervals),
        false => agree_everywhere([a, b]).map(Equality::Inputs),
    }
}

/// Compares a mutant with the original, at its function or else at what uses it.
pub(crate) fn why(original: &Package, mutant: &Package, candidate: &Candidate) -> Lived {
    let own = candidate.path();
    let compared = |only: &[&str]| {
        let request = Request::new(original.clone(), mutant.clone());
        request.only(only.iter().copied()).run().map_err(|error| error.to_string())
    };
    let found = match compared(&[&own]) {
        Ok(found) => found,
        Err(reason) => return Lived::Unknown { reason },
    };
    match verdict(original, found.iter().filter(|one| one.function == own)) {
        // A constant, or a function that can't be called by itself: what uses it can.
        None | Some(Lived::Unknown { .. }) => match compared(&[]) {
            Ok(all) => verdict(original, all.iter()).unwrap_or_else(|| Lived::Unknown {
                reason: "no function that can be called by itself shows a difference".to_owned(),
            }),
            Err(reason) => Lived::Unknown { reason },
        },
        Some(known) => known,
    }
}

/// A difference before all else, then that something isn't known. `None` if nothing was compared.
fn verdict<'c>(original: &Package, compared: impl Iterator<Item = &'c Compared>) -> Option<Lived> {
    let (mut cases, mut unknown) = (0, None);
    for one in compared {
        match &one.change {
            Change::Changed { paths } => {
                if let Some(path) = paths.first() {
                    return Some(Lived::Differs(Difference::of(original, one, path)));
                }
            }
            Change::Same { cases: own } => cases = cases.max(*own),
            Change::Unjudged { reason } => unknown = unknown.or(Some(reason.clone())),
            Change::Signature { .. } | Change::Added | Change::Removed => {
                unknown = unknown.or(Some("it takes or returns something else".to_owned()));
            }
            _ => {}
        }
    }
    match (cases, unknown) {
        (0, Some(reason)) => Some(Lived::Unknown { reason }),
        (0, None) => None,
        (cases, _) => Some(Lived::Unseen { cases }),
    }
}

impl Difference {
    fn of(original: &Package, compared: &Compared, change: &PathChange) -> Self {
        let probed = Probed::new(original, &compared.function);
        let is_float =
            |probed: &Probed| probed.function().result.lanes().iter().any(|lane| lane.is_float());
        let floats = probed.as_ref().is_ok_and(is_float);
        let parameters =
            probed.map_or_else(|_| Vec::new(), |one| one.function().parameters.clone());
        // Members of buffers, overrides and features aren't what a test says in `over`.
        let is_parameter =
            |(name, _): &(String, String)| parameters.iter().any(|(own, _)| own == name);
        let is_other = |one: &&(String, String)| change.given.iter().all(|(own, _)| *own != one.0);
        let others: Vec<_> = change.arguments.iter().filter(is_other).cloned().collect();
        let pastes = compared.under.is_empty()
            && compared.dispatched.is_none()
            && change.given.len() == parameters.len()
            && others.iter().all(is_parameter);
        Self {
            function: compared.function.clone(),
            arguments: change.given.iter().cloned().chain(others).collect(),
            original: change.before.clone(),
            mutant: change.after.clone(),
            floats,
            leaves: compared.dispatched.is_some(),
            pastes,
        }
    }

    /// A test that the mutant fails and the original passes, to be pasted into a `*.test.toml`: what the original returns is
    /// right by its author's word alone. `None` where the input is no argument, the original returns no finite number, or the
    /// two differ by the sign of a 0 alone, which no test tells apart.
    #[must_use]
    pub fn test(&self) -> Option<String> {
        let over = self.arguments.iter().map(|(name, value)| {
            let value = toml_of(value)?;
            // A list would be the domains of a vector's components.
            Some(match value.starts_with('[') {
                true => format!("{name} = {{ one_of = [{value}] }}"),
                false => format!("{name} = {value}"),
            })
        });
        let over = over.collect::<Option<Vec<_>>>()?.join(", ");
        let over = if over.is_empty() { over } else { format!("over = {{ {over} }}\n") };
        let equals = toml_of(&self.original).filter(|_| self.pastes)?;
        let [own, others] = [&self.original, &self.mutant].map(|text| numbers(text));
        if own == others {
            return None;
        }
        let far: Vec<f64> = own.iter().zip(&others).map(|(a, b)| (a - b).abs()).collect();
        // A mutant's NaN is outside of any bound, and then the narrowest says the most.
        let is_number = far.iter().all(|one| one.is_finite());
        let far = far.into_iter().fold(0.0, f64::max);
        let tolerance = match (self.floats, is_number && far > 0.0) {
            (false, _) => String::new(),
            // Half of the way to the mutant.
            (true, true) => format!("tolerance = \"abs {:.1e}\"\n", far / 2.0),
            (true, false) => "tolerance = \"1 ulp\"\n".to_owned(),
        };
        let name = self.function.rsplit("::").next().unwrap_or(&self.function);
        Some(format!("[[test]]\nfunction = \"{name}\"\n{over}equals = {equals}\n{tolerance}"))
    }
}

/// The numbers of a value as it is shown: `(1, NaN)`.
fn numbers(text: &str) -> Vec<f64> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || ".+-".contains(c);
    text.split(|c| !is_part(c)).filter_map(|word| word.parse().ok()).collect()
}

/// A number, `true`, or a vector as TOML.
fn toml_of(value: &str) -> Option<String> {
    let plain = |c: char| c.is_ascii_digit() || " ,.+-e()".contains(c);
    let is_plain = value.chars().all(plain) || matches!(value, "true" | "false");
    // `-0` is an integer in TOML, and has no sign.
    let is_signed_zero = value.split(|c: char| " ,()".contains(c)).any(|word| word == "-0");
    (is_plain && !is_signed_zero).then(|| value.replace('(', "[").replace(')', "]"))
}
