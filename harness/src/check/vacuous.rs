//! The reasons why a check has nothing to judge. Each cause has its own variant, so that a message names one cause.

use super::Parameter;
use crate::domain::Emptiness;
use crate::output::counted;

/// The most cases of a check: the number of `f32` values. They take minutes.
pub(super) const MOST_CASES: u64 = 1 << 32;

/// The reason why nothing could be judged, or why nothing could have failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Vacuous {
    /// The domain has no value.
    #[error("is empty: {}", shown(emptiness, argument.as_deref()))]
    Empty {
        /// The argument whose part of the domain is empty, if it is known.
        argument: Option<String>,
        /// The reason why it is empty.
        emptiness: Emptiness,
    },
    /// `.cases(0)`
    #[error("is asked for 0 cases, so nothing would be checked")]
    NoCases,
    /// The check has more than `MOST_CASES` cases.
    #[error("is asked for {0} cases, more than the {MOST_CASES} that are run at most")]
    TooManyCases(u64),
    /// A filter rejects nearly all values.
    #[error(
        "has a filter that rejects nearly everything: draw from narrower ranges, or make values that pass of others"
    )]
    Filtered,
    /// A replay selects a case that doesn't exist.
    #[error("has {}, none with index {case} (KARAT_CASE)", counted(*count, "case"))]
    NoSuchCase {
        /// The number of cases.
        count: u64,
        /// The index of the selected case.
        case: u64,
    },
    /// A replay selects a simpler value that doesn't exist.
    #[error("has no such simpler value any more (steps of KARAT_CASE)")]
    NoSuchStep,
    /// A replay gives arguments with another number of words.
    #[error("has values of {}, KARAT_INPUT has {found}", counted(*expected, "word"))]
    Words {
        /// The words of a case.
        expected: usize,
        /// The words in the replay.
        found: usize,
    },
    /// The verb compared fewer cases than the check has.
    #[error("declares {}, but {compared} were compared", counted(*declared, "case"))]
    Uncompared {
        /// The number of cases.
        declared: u64,
        /// The number of compared cases.
        compared: u64,
    },
    /// `Spec` or `DeviceSpec` has too wide bounds for all cases, so the other tolerance judged every case.
    #[error(
        "has no case in which what is allowed is as close together as is needed: take the other \
         tolerance alone"
    )]
    Ungranted,
    /// A transformation changes no argument of any case.
    #[error("has no case that the transformation changes")]
    Untransformed,
    /// A rotation changes no argument of any case.
    #[error("has no case that a rotation changes")]
    Unrotated,
    /// The domain has no two different values of an argument.
    #[error("has one value of {0} only")]
    OneValue(Parameter),
    /// No result changes with the argument.
    #[error("has no case whose result changes with {0} by more than the tolerance")]
    Constant(Parameter),
    /// Every result is at its limit at the first step already.
    #[error(
        "has only cases that are at the limit at the first step, {argument} = {step}: start farther away"
    )]
    AtLimit {
        /// The argument that approaches the limit.
        argument: Parameter,
        /// Its first value.
        step: f32,
    },
    /// All results are so small that they may be flushed to zero.
    #[error(
        "has only cases whose results are below the least normal f32, 1.2e-38: they may all be flushed \
         to 0, so that there is nothing to compare"
    )]
    Flushed,
    /// No case evaluates an expectation.
    #[error("has no case in which an expectation is evaluated, so nothing is tested")]
    NoExpectation,
    /// The significance isn't between 0 and 1.
    #[error("has a significance of {0}, which isn't between 0 and 1")]
    Significance(f64),
    /// The tolerance for a density's integral has an unusable bound.
    #[error("has `.mass_within({0})`, which isn't a finite number of at least 0")]
    Mass(f64),
    /// The interval of the samples has no finite length.
    #[error("is to lie on [{0}, {1}], which isn't an interval of finite length")]
    Interval(f64, f64),
}

impl Vacuous {
    /// The settings of a test that can cause this, the most likely one first.
    pub(super) fn settings(&self) -> &'static [&'static str] {
        match self {
            Self::NoCases | Self::TooManyCases(_) => &["cases"],
            Self::Filtered | Self::Empty { argument: None, .. } => &["where", "over"],
            _ => &["over"],
        }
    }

    /// The subject of the message: the domain of a function, or the settings of a check of samples.
    pub(super) fn whose(&self) -> &'static str {
        match self {
            Self::Significance(_) | Self::Mass(_) | Self::Interval(..) => "the check of",
            _ => "the domain of",
        }
    }
}

/// `the range of `alpha` starts at 1 and ends at 0`
fn shown(Emptiness { what, fault, .. }: &Emptiness, argument: Option<&str>) -> String {
    match argument {
        Some(name) => format!("the {what} of `{name}` {fault}"),
        None => format!("its {what} {fault}"),
    }
}
