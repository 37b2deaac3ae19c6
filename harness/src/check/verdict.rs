//! The verdict of a check: an agreement or a failure.

use std::fmt;

use super::{Disagreement, Fit, Rejection};
use super::{Mismatch, Vacuous};
use crate::diagnostic::{Blame, Blamed};
use crate::golden::ValuesError;
use crate::output::counted;
use crate::path::{Adapter, PathError};
use crate::probe::ProbeError;
use crate::record::Details;
use crate::run::{Fails, KnownIssue, NotBegun, Passed, PathFailures, Stop, WrongDeclaration};
use crate::tolerance::LaneError;

/// The result of a check that passes: the number of cases, and the worst errors.
///
/// ```
/// use karat::prelude::*;
///
/// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 0.5 * x; }");
/// let agreement = package.function("f").over(0.0..=1.0).agrees_with(|x: f64| 0.5 * x, Ulp(1.0));
/// assert_eq!(agreement.cases, 65_536);
/// ```
#[derive(Clone, Debug)]
pub struct Agreement {
    /// The name of the function.
    pub function: String,
    /// The number of compared cases on each path.
    pub cases: u64,
    /// The paths that pass, each with its worst error.
    pub paths: Vec<(Adapter, LaneError)>,
    /// The worst error of all paths.
    pub worst: LaneError,
    /// `true` if Karat proved the statement for all arguments of the domain, on every implementation that WGSL allows.
    /// Only [`stays_within`](crate::Check::stays_within) tries to prove its statement.
    pub proved: bool,
    /// The paths that fail as declared. `paths` doesn't contain these paths.
    pub known_issues: Vec<KnownIssue>,
}

/// The reason why a check doesn't pass.
///
/// ```
/// use karat::check::Failure;
/// use karat::prelude::*;
///
/// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 0.6 * x; }");
/// let wrong = package.function("f").over(0.0..=1.0).unrecorded().try_agrees_with(|x: f64| 0.5 * x, Ulp(1.0));
/// let Err(Failure::Disagreement(_)) = wrong else { panic!("it is 0.6") };
/// ```
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Failure {
    /// Results differ from the expected values by more than the tolerance, or don't satisfy the statement.
    #[error("{0}")]
    Disagreement(Box<Disagreement>),
    /// Results differ from their golden, or there is no usable golden.
    #[error("{}{cause}", disagreement.as_ref().map_or_else(String::new, ToString::to_string))]
    Golden {
        /// The results that differ, if there is a usable golden.
        disagreement: Option<Box<Disagreement>>,
        /// The cause, and what to do about it.
        cause: Box<ValuesError>,
    },
    /// A declaration about a path, such as `fails_on`, doesn't hold or has no reason.
    #[error(transparent)]
    Declaration(#[from] WrongDeclaration),
    /// Paths fail in different ways, or some paths have no verdict.
    #[error("{0}")]
    Paths(Box<PathFailures<Self>>),
    /// The check of a sampler rejects the sampler.
    #[error("{0}")]
    Rejection(Box<Rejection>),
    /// Karat can't judge a sampler, for example because there are too few samples.
    #[error("Karat can't judge `{function}` for case {case}, {configuration}: {reason}")]
    Evidence {
        /// The sampler's name.
        function: String,
        /// The reason, as text.
        reason: String,
        /// The configuration's index.
        case: u64,
        /// The configuration's value.
        configuration: String,
    },
    /// An environment variable can't be used, or a replay names a case of another check.
    #[error(transparent)]
    NotBegun(#[from] NotBegun),
    /// Karat couldn't get results from the function.
    #[error(transparent)]
    Probe(#[from] ProbeError),
    /// The types of the function don't fit the domain, the reference or a setting.
    #[error("`{function}` {mismatch}\n  {signature}\n  at {location}")]
    Signature {
        /// The function's name.
        function: String,
        /// The mismatch.
        mismatch: Box<Mismatch>,
        /// The function's signature in WGSL.
        signature: String,
        /// The position of the function's declaration.
        location: String,
    },
    /// The check has nothing to judge.
    #[error("{} `{function}` {reason}", reason.whose())]
    Domain {
        /// The function's name.
        function: String,
        /// The reason why the check has nothing to judge.
        reason: Box<Vacuous>,
    },
    /// A quadrature rule has no nodes, has a weight that isn't finite, or gives an integral without a verdict.
    #[error("for case {case} ({arguments}), the quadrature rule of `{function}` {reason}")]
    Rule {
        /// The function's name.
        function: String,
        /// The fault of the rule, as text.
        reason: String,
        /// The index of the case.
        case: u64,
        /// The value of the case, as text.
        arguments: String,
    },
    /// The reference returned a value that isn't finite.
    #[error(
        "the reference of `{function}` returned {value} at {place} for case {case}: {arguments}; \
         a reference must be finite on the whole domain: restrict the domain, or correct the reference"
    )]
    Reference {
        /// The function's name.
        function: String,
        /// The value that the reference returned.
        value: f64,
        /// The component of the reference's result that isn't finite.
        place: String,
        /// The index of the case.
        case: u64,
        /// The arguments of the case.
        arguments: String,
    },
}

impl Failure {
    pub(super) fn golden(source: ValuesError) -> Self {
        Self::Golden { disagreement: None, cause: Box::new(source) }
    }
}

impl Blamed for Failure {
    fn blame(&self) -> Blame<'_> {
        match self {
            Self::Disagreement(_) | Self::Rejection(_) => Blame::VALUES,
            Self::Golden { disagreement: Some(_), .. } => Blame::VALUES,
            Self::Probe(error) => error.blame(),
            Self::Declaration(wrong) => wrong.blame(),
            Self::Domain { reason, .. } => Blame::setting(reason.settings()),
            Self::Paths(paths) => paths.blame(),
            _ => Blame::TEST,
        }
    }
}

impl Fails for Failure {
    fn is_verdict(&self) -> bool {
        match self {
            Self::Disagreement(_) | Self::Rejection(_) => true,
            Self::Probe(error) => matches!(error, ProbeError::Asserted(_)),
            Self::Declaration(wrong) => wrong.is_verdict(),
            Self::Golden { cause, .. } => cause.is_failure(),
            Self::Paths(paths) => paths.all().any(Self::is_verdict),
            _ => false,
        }
    }

    fn is_vacuous(&self) -> bool {
        match self {
            Self::Domain { .. } => true,
            Self::Paths(paths) => paths.all().any(Self::is_vacuous),
            _ => false,
        }
    }

    fn details(&self) -> Details {
        match self {
            Self::Disagreement(found) => found.details(),
            Self::Golden { disagreement: Some(found), .. } => found.details(),
            Self::Rejection(found) => found.details(),
            Self::Paths(failures) => failures.details(Self::details),
            other => Details::of(&other.to_string()).at(self.blame().message),
        }
    }

    fn location(&self) -> Option<String> {
        match self {
            Self::Signature { location, .. } => Some(location.clone()),
            _ => None,
        }
    }
}

impl Stop for Failure {
    fn is_refusal(&self) -> bool {
        matches!(self, Self::Probe(error) if error.is_refusal())
    }

    fn of_paths(failures: PathFailures<Self>) -> Self {
        Self::Paths(Box::new(failures))
    }
}

impl From<PathError> for Failure {
    fn from(error: PathError) -> Self {
        Self::Probe(ProbeError::Path(error))
    }
}

impl Passed for Agreement {
    fn known_issues(&self) -> &[KnownIssue] {
        &self.known_issues
    }
}

impl Passed for Fit {
    fn known_issues(&self) -> &[KnownIssue] {
        &self.known_issues
    }
}

impl fmt::Display for Agreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (cases, agree) =
            (counted(self.cases, "case"), if self.cases == 1 { "agrees" } else { "agree" });
        write!(f, "{}: {cases} {agree}", self.function)?;
        for (adapter, worst) in &self.paths {
            write!(f, "; {} worst {worst}", adapter.path)?;
        }
        for KnownIssue { adapter, reason, failures, .. } in &self.known_issues {
            write!(f, "; {} fails {failures} cases as declared: {reason}", adapter.path)?;
        }
        Ok(())
    }
}
