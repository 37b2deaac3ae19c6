//! The assertions that a test file makes about functions' results, and about resources after passes.

use std::path::PathBuf;

use karat::check::HazardKind;
use toml::Value;

use crate::declared::{Direction, Integral};
use crate::range::Range;
use crate::wrong::Misdeclared;

#[derive(Clone, Debug)]
pub(crate) enum What {
    // Assertions about functions and about resources.
    AgreesWith(String),
    Table(PathBuf),
    Golden(String),
    Equals(Value),
    Finite,
    InRange(Range),
    /// No hazards of the listed kinds; without a list, no hazards of any kind.
    NoHazards(Option<Vec<HazardKind>>),
    // Assertions about functions only.
    Unit,
    PerpendicularTo(String),
    RightHandedFrame,
    SymmetricIn([String; 2]),
    Monotone(String, Direction),
    Limit {
        argument: String,
        toward: f64,
        through: Vec<f64>,
        is: Value,
    },
    Integral(Integral),
    // Assertions about resources only.
    Sorted {
        descending: bool,
    },
    SumOf(String),
    PermutationOf(String),
    Unchanged,
    Written,
}

/// The assertions that tests of functions and tests of resources both have, each under its key.
pub(crate) struct Shared<'k> {
    pub(crate) agrees_with: &'k Option<String>,
    pub(crate) table: &'k Option<PathBuf>,
    pub(crate) golden: &'k Option<String>,
    pub(crate) equals: &'k Option<Value>,
    pub(crate) finite: Option<bool>,
    pub(crate) in_range: Option<Range>,
}

impl Shared<'_> {
    pub(crate) fn whats(&self) -> Result<Vec<What>, Misdeclared> {
        let mut all = Vec::new();
        all.extend(self.agrees_with.clone().map(What::AgreesWith));
        all.extend(self.table.clone().map(What::Table));
        all.extend(self.golden.clone().map(What::Golden));
        all.extend(self.equals.clone().map(What::Equals));
        all.extend(switched("finite", self.finite, What::Finite)?);
        all.extend(self.in_range.map(What::InRange));
        Ok(all)
    }
}

/// The assertion for a key that must be `true`, such as `finite`. `None` if the test doesn't have the key.
pub(crate) fn switched(
    key: &'static str,
    value: Option<bool>,
    what: What,
) -> Result<Option<What>, Misdeclared> {
    match value {
        Some(false) => {
            Err(Misdeclared::of(key)(format!("`{key} = false` asserts nothing: remove the key")))
        }
        on => Ok(on.map(|_| what)),
    }
}

impl What {
    pub(crate) fn key(&self) -> &'static str {
        match self {
            Self::AgreesWith(_) => "agrees_with",
            Self::Table(_) => "table",
            Self::Golden(_) => "golden",
            Self::Equals(_) => "equals",
            Self::Finite => "finite",
            Self::InRange(_) => "in_range",
            Self::NoHazards(_) => "no_hazards",
            Self::Unit => "unit",
            Self::PerpendicularTo(_) => "perpendicular_to",
            Self::RightHandedFrame => "right_handed_frame",
            Self::SymmetricIn(_) => "symmetric_in",
            Self::Monotone(..) => "monotone",
            Self::Limit { .. } => "limit",
            Self::Integral(_) => "integral",
            Self::Sorted { .. } => "sorted",
            Self::SumOf(_) => "sum_of",
            Self::PermutationOf(_) => "permutation_of",
            Self::Unchanged => "unchanged",
            Self::Written => "written",
        }
    }

    pub(crate) fn name(&self) -> String {
        match self {
            Self::Monotone(argument, _) => format!("monotone in {argument}"),
            Self::Limit { argument, .. } => format!("limit of {argument}"),
            other => other.key().to_owned(),
        }
    }

    /// The name by which [`TAKEN`] lists the assertion.
    fn form(&self) -> &'static str {
        match self {
            Self::Integral(Integral { equals: None, .. }) => "integral at_most",
            other => other.key(),
        }
    }

    /// Checks if the assertion accepts a key that only some assertions accept.
    pub(crate) fn takes(&self, key: &str) -> bool {
        // A sum accepts a tolerance for all paths, but no `tolerance_on`.
        if let (Self::SumOf(_), "tolerance") = (self, key) {
            return true;
        }
        let takers = TAKEN.iter().find(|(known, _)| *known == key);
        takers.is_none_or(|(_, takers)| takers.contains(&self.form()))
    }
}

/// The keys that only some assertions accept, each with the assertions that accept it. An integral with `at_most` has a
/// `slack` and no tolerance.
const TAKEN: [(&str, &[&str]); 8] = [
    ("over", &DRAWN),
    ("where", &DRAWN),
    ("cases", &DRAWN),
    ("seed", &DRAWN),
    ("tolerance", &WITHIN),
    ("tolerance_on", &WITHIN),
    ("accept_hazard", &["no_hazards"]),
    ("up_to_order", &["equals", "table", "agrees_with"]),
];

/// The assertions whose arguments are sampled. `table` isn't in this list, because the rows of the table contain the
/// arguments.
const DRAWN: [&str; 14] = [
    "agrees_with",
    "golden",
    "equals",
    "finite",
    "unit",
    "perpendicular_to",
    "right_handed_frame",
    "in_range",
    "symmetric_in",
    "monotone",
    "limit",
    "integral",
    "integral at_most",
    "no_hazards",
];

/// The assertions that accept a tolerance.
const WITHIN: [&str; 8] =
    ["agrees_with", "table", "golden", "equals", "symmetric_in", "monotone", "limit", "integral"];

/// The assertions that functions and resources share.
const OF_BOTH: [&str; 7] =
    ["agrees_with", "table", "golden", "equals", "finite", "in_range", "no_hazards"];

/// Finds a key in the test file that none of the test's assertions accepts. Returns the key and an error message.
pub(crate) fn idle_key(
    whats: &[What],
    of_resource: bool,
    written: &dyn Fn(&str) -> bool,
) -> Option<(&'static str, String)> {
    let idle = |(key, _): &&(&str, _)| written(key) && !whats.iter().any(|what| what.takes(key));
    let (key, takers) = TAKEN.iter().find(idle)?;
    let is_there = |taker: &&&str| !of_resource || OF_BOTH.contains(taker);
    let there: Vec<&str> = takers.iter().filter(is_there).copied().collect();
    let own: Vec<String> = whats.iter().map(|what| format!("`{}`", what.form())).collect();
    let error = format!(
        "`{key}` does nothing here: {} can't have this key. Remove the key, or add an assertion that uses the key: {}",
        own.join(", "),
        there.join(", ")
    );
    Some((*key, error))
}
