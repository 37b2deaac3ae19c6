//! The reasons why a check has nothing to judge. Each reason has its own variant and message.

use super::Parameter;
use crate::domain::Emptiness;
use crate::output::counted;

/// The largest number of cases of a check: 2^32, the number of `f32` values. A check with this many cases
/// takes minutes.
pub(super) const MOST_CASES: u64 = 1 << 32;

/// The reason why a check has nothing to judge, or can't fail.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Vacuous {
    /// The domain has no value.
    #[error("is empty: {}", shown(emptiness, argument.as_deref()))]
    Empty {
        /// The argument with an empty domain, if Karat knows which argument that is.
        argument: Option<String>,
        /// The reason why the domain is empty.
        emptiness: Emptiness,
    },
    /// The check has no cases, for example because of `.cases(0)`.
    #[error("has 0 cases, so the check would test nothing")]
    NoCases,
    /// The check has more than `MOST_CASES` cases.
    #[error("has {0} cases, but a check can have at most {MOST_CASES}")]
    TooManyCases(u64),
    /// A filter rejects nearly all values.
    #[error(
        "has a filter that rejects nearly all values: use narrower ranges, or replace the filter by a domain that has only accepted values"
    )]
    Filtered,
    /// A replay selects a case that doesn't exist.
    #[error("has {}, but no case with index {case}, which KARAT_CASE selects", counted(*count, "case"))]
    NoSuchCase {
        /// The number of cases.
        count: u64,
        /// The index of the selected case.
        case: u64,
    },
    /// A replay selects a simpler value that doesn't exist.
    #[error("no longer has the simpler value that KARAT_CASE selects")]
    NoSuchStep,
    /// A replay supplies more or fewer words of arguments than a case has.
    #[error("needs {} in each case, but KARAT_INPUT has {found}", counted(*expected, "word"))]
    Words {
        /// The number of words of a case.
        expected: usize,
        /// The number of words in the replay.
        found: usize,
    },
    /// The verb compared fewer cases than the check has.
    #[error("has {}, but Karat compared only {compared}", counted(*declared, "case"))]
    Uncompared {
        /// The number of cases.
        declared: u64,
        /// The number of compared cases.
        compared: u64,
    },
    /// The bounds of `Spec` or `DeviceSpec` are too wide in all cases, so the fallback tolerance (`.or(...)`) judged
    /// every case.
    #[error(
        "has no case in which WGSL's bounds are narrow enough for the test: use `x` \
         instead of `Spec.or(x)`"
    )]
    Ungranted,
    /// A transformation changes no argument of any case.
    #[error("has no case that the transformation changes")]
    Untransformed,
    /// A rotation changes no argument of any case.
    #[error("has no case that a rotation changes")]
    Unrotated,
    /// The domain has only one value for the argument that the check varies.
    #[error("has only one value for {0}")]
    OneValue(Parameter),
    /// No result changes by more than the tolerance if the argument changes.
    #[error("has no case in which {0} changes the result by more than the tolerance")]
    Constant(Parameter),
    /// Even at the first step, every result is within the tolerance of its limit.
    #[error(
        "has only cases whose results already equal the limit at the first step, {argument} = {step}: add an earlier step that is farther away"
    )]
    AtLimit {
        /// The argument that approaches the limit.
        argument: Parameter,
        /// The argument's value at the first step.
        step: f32,
    },
    /// All results are so small that drivers may flush them to 0.
    #[error(
        "has only cases with results below the smallest normal f32, 1.2e-38: drivers may turn all of \
         these results into 0, so the check would compare nothing"
    )]
    Flushed,
    /// In no case does the test reach an expectation, such as `expect_less`.
    #[error("has no case that evaluates an expectation, so the test tests nothing")]
    NoExpectation,
    /// The significance isn't between 0 and 1.
    #[error("has a significance of {0}, which isn't between 0 and 1")]
    Significance(f64),
    /// The argument of `.mass_within(...)` isn't a finite number of at least 0.
    #[error("has `.mass_within({0})`, which isn't a finite number of at least 0")]
    Mass(f64),
    /// The support of the samples is an interval, but its length isn't positive and finite.
    #[error("has the support [{0}, {1}], which isn't an interval of finite length")]
    Interval(f64, f64),
}

impl Vacuous {
    /// The settings of a test that can cause this error, the most likely setting first.
    pub(super) fn settings(&self) -> &'static [&'static str] {
        match self {
            Self::NoCases | Self::TooManyCases(_) => &["cases"],
            Self::Filtered | Self::Empty { argument: None, .. } => &["where", "over"],
            _ => &["over"],
        }
    }

    /// The beginning of the message, before the function's name: `the domain of` or `the check of`.
    pub(super) fn whose(&self) -> &'static str {
        match self {
            Self::Significance(_) | Self::Mass(_) | Self::Interval(..) => "the check of",
            _ => "the domain of",
        }
    }
}

fn shown(Emptiness { what, fault, .. }: &Emptiness, argument: Option<&str>) -> String {
    match argument {
        Some(name) => format!("the {what} of `{name}` {fault}"),
        None => format!("its {what} {fault}"),
    }
}
