//! Why a mutant lived: where it and the original part, if they do.

use karat::Package;
use karat::unstable::probe::Probed;
use karat_inspect::compare::{Change, Compared, PathChange, Request};
use serde::Serialize;

/// Why a mutant lived.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "why", rename_all = "snake_case")]
pub enum Lived {
    /// It is the same shader: no test can see it.
    Equal,
    /// It returns something else where no test looks.
    Differs(Difference),
    /// No input was found for which it returns something else. That shows nothing beyond these inputs.
    Unseen {
        /// The inputs that were tried.
        cases: usize,
    },
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
    /// The simplest arguments that show it, by their names. Others change nothing there.
    pub arguments: Vec<(String, String)>,
    /// What the original returns.
    pub original: String,
    /// What the mutant returns.
    pub mutant: String,
    /// True if its numbers are floats, of which a test says how near they have to be.
    pub floats: bool,
}

/// Compares a mutant with the original, at its function or else at what uses it.
pub(crate) fn why(original: &Package, mutant: &Package, module: &str, item: &str) -> Lived {
    let own = if module.is_empty() { item.to_owned() } else { format!("{module}::{item}") };
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
            Ok(all) => verdict(original, all.iter()).unwrap_or(Lived::Equal),
            Err(reason) => Lived::Unknown { reason },
        },
        Some(known) => known,
    }
}

/// A difference before all else, then that something isn't known. `None` if nothing was compared.
fn verdict<'c>(original: &Package, compared: impl Iterator<Item = &'c Compared>) -> Option<Lived> {
    let (mut cases, mut unknown, mut any) = (0, None, false);
    for one in compared {
        any = true;
        match &one.change {
            Change::Changed { paths } => {
                if let Some(path) = paths.first() {
                    return Some(Lived::Differs(Difference::of(original, &one.function, path)));
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
        (0, None) => any.then_some(Lived::Equal),
        (cases, _) => Some(Lived::Unseen { cases }),
    }
}

impl Difference {
    fn of(original: &Package, function: &str, change: &PathChange) -> Self {
        let probed = Probed::new(original, function);
        let lanes = probed.map_or_else(|_| Vec::new(), |one| one.function().result.lanes());
        Self {
            floats: lanes.iter().any(|lane| lane.is_float()),
            function: function.to_owned(),
            arguments: change.arguments.clone(),
            original: change.before.clone(),
            mutant: change.after.clone(),
        }
    }
}

impl Difference {
    /// A test that the mutant fails and the original passes, to be pasted into a `*.test.toml`: what the original returns is
    /// right by its author's word alone. `None` where the input is no argument, or a value is no finite number.
    #[must_use]
    pub fn test(&self) -> Option<String> {
        let over: Option<Vec<String>> = self
            .arguments
            .iter()
            .map(|(name, value)| {
                let is_argument = !name.contains(['.', '[']);
                is_argument.then_some(())?;
                let value = toml_of(value)?;
                // A list would be the domains of a vector's components.
                Some(match value.starts_with('[') {
                    true => format!("{name} = {{ one_of = [{value}] }}"),
                    false => format!("{name} = {value}"),
                })
            })
            .collect();
        let over = match over?.join(", ") {
            none if none.is_empty() => String::new(),
            some => format!("over = {{ {some} }}\n"),
        };
        let equals = toml_of(&self.original)?;
        let numbers = |text: &str| -> Vec<f64> {
            text.split(|c: char| !(c.is_ascii_alphanumeric() || ".+-".contains(c)))
                .filter_map(|word| word.parse().ok())
                .collect()
        };
        // Half of the way to the mutant; what isn't finite is no number of a test.
        let pairs = numbers(&self.original).into_iter().zip(numbers(&self.mutant));
        let far =
            pairs.map(|(a, b)| (a - b).abs()).filter(|far| far.is_finite()).fold(0.0, f64::max);
        let tolerance = match self.floats && far > 0.0 {
            true => format!("tolerance = \"abs {:.1e}\"\n", far / 2.0),
            false => String::new(),
        };
        let name = self.function.rsplit("::").next().unwrap_or(&self.function);
        Some(format!("[[test]]\nfunction = \"{name}\"\n{over}equals = {equals}\n{tolerance}"))
    }
}

/// A number, `true`, or a vector as TOML.
fn toml_of(value: &str) -> Option<String> {
    let plain = |c: char| c.is_ascii_digit() || " ,.+-e()".contains(c);
    let is_plain = value.chars().all(plain) || matches!(value, "true" | "false");
    is_plain.then(|| value.replace('(', "[").replace(')', "]"))
}
