//! Why a check has nothing to judge: each cause by itself, so that no message names several.

use super::Parameter;
use crate::domain::Emptiness;
use crate::output::counted;

/// Cases of a check: as many as there are values of an `f32`, which take minutes.
pub(super) const MOST_CASES: u64 = 1 << 32;

/// Why nothing could be judged, or nothing could have failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Vacuous {
    /// The domain has no value.
    #[error("is empty: {}", shown(emptiness, argument.as_deref()))]
    Empty {
        /// The argument whose part of the domain is empty, where that is known.
        argument: Option<String>,
        /// What is wrong with it.
        emptiness: Emptiness,
    },
    /// `.cases(0)`
    #[error("is asked for 0 cases, so nothing would be checked")]
    NoCases,
    /// More cases than anybody waits for.
    #[error("is asked for {0} cases, more than the {MOST_CASES} that are run at most")]
    TooManyCases(u64),
    /// A filter leaves next to nothing.
    #[error(
        "has a filter that rejects nearly everything: draw from narrower ranges, or make values that pass of others"
    )]
    Filtered,
    /// A replay selects a case that isn't there.
    #[error("has {}, none with index {case} (KARAT_CASE)", counted(*count, "case"))]
    NoSuchCase {
        /// Cases that there are.
        count: u64,
        /// The one that is asked for.
        case: u64,
    },
    /// A replay selects a simpler value that isn't there.
    #[error("has no such simpler value any more (steps of KARAT_CASE)")]
    NoSuchStep,
    /// A replay gives arguments of another width.
    #[error("has values of {}, KARAT_INPUT has {found}", counted(*expected, "word"))]
    Words {
        /// Words of a case.
        expected: usize,
        /// Words that are given.
        found: usize,
    },
    /// Fewer cases were compared than there are.
    #[error("declares {}, but {compared} were compared", counted(*declared, "case"))]
    Uncompared {
        /// Cases that there are.
        declared: u64,
        /// Cases that were compared.
        compared: u64,
    },
    /// `Spec` or `DeviceSpec` bounds no case closely enough, and another tolerance judges each.
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
    /// There are no two values of an argument to compare.
    #[error("has one value of {0} only")]
    OneValue(Parameter),
    /// No result changes with an argument.
    #[error("has no case whose result changes with {0} by more than the tolerance")]
    Constant(Parameter),
    /// Every result is at its limit from the first step on.
    #[error(
        "has only cases that are at the limit at the first step, {argument} = {step}: start farther away"
    )]
    AtLimit {
        /// What goes to the limit.
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
    /// A significance that isn't between 0 and 1.
    #[error("has a significance of {0}, which isn't between 0 and 1")]
    Significance(f64),
    /// The tolerance for a density's integral bounds nothing.
    #[error("has `.mass_within({0})`, which isn't a finite number of at least 0")]
    Mass(f64),
    /// The interval that samples should lie on isn't one of finite length.
    #[error("is to lie on [{0}, {1}], which isn't an interval of finite length")]
    Interval(f64, f64),
}

impl Vacuous {
    /// The settings of a test that it is about, the closest one first.
    pub(super) fn settings(&self) -> &'static [&'static str] {
        match self {
            Self::NoCases | Self::TooManyCases(_) => &["cases"],
            Self::Filtered | Self::Empty { argument: None, .. } => &["where", "over"],
            _ => &["over"],
        }
    }

    /// What is at fault: the domain of a function, or what a check of samples says of it.
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
