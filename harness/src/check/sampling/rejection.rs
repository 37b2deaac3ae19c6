//! The report of a rejected sampler, as text and as data.

use std::fmt;
use std::path::PathBuf;

use super::super::disagreement::failed;
use super::picture::Histogram;
use crate::path::Adapter;
use crate::record::{CaseDetails, Details, PathDetails, Replay};
use crate::reflect::Function;
use crate::stats::Support;

/// A failed check of a sampler: at least one path rejects the sampler.
///
/// ```
/// use karat::check::Failure;
/// # use karat::prelude::*;
///
/// let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
/// let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
/// let wrong = sampler.unrecorded().try_has_mean("u", |x: f32| x.into(), |()| 0.6, 1e-6);
/// let Err(Failure::Rejection(found)) = wrong else { panic!("it is 0.5") };
/// println!("each p-value must be at least {}", found.threshold);
/// for path in &found.paths {
///     println!("{} of {} fail on {}", path.rejected, path.configurations, path.adapter);
/// }
/// ```
#[derive(Clone, Debug)]
pub struct Rejection {
    /// The sampler's function.
    pub function: Function,
    /// The verb, such as `follows`.
    pub check: &'static str,
    /// The assertion, as text.
    pub assertion: String,
    /// The probability that the check rejects a correct sampler.
    pub significance: f64,
    /// The smallest p-value that passes.
    pub threshold: f64,
    /// The paths that reject the sampler.
    pub paths: Vec<PathRejection>,
    /// The paths that don't reject the sampler.
    pub agreeing: Vec<Adapter>,
    /// The seed of configurations and random numbers.
    pub seed: u64,
}

impl Rejection {
    pub(crate) fn details(&self) -> Details {
        Details {
            headline: failed(&self.function, self.check, &self.assertion).message,
            paths: self.paths.iter().map(PathRejection::details).collect(),
            ..Details::default()
        }
    }
}

impl PathRejection {
    fn details(&self) -> PathDetails {
        let ConfigurationRejection { case, configuration, findings, notes, .. } = &self.worst;
        let findings: Vec<String> = findings.iter().map(ToString::to_string).collect();
        let worst = CaseDetails {
            case: *case,
            arguments: vec![("configuration".to_owned(), configuration.clone())],
            error: findings.join("; "),
            notes: notes.iter().map(|(name, text)| ((*name).to_owned(), text.clone())).collect(),
            replay: Some(self.replay.clone()),
            ..CaseDetails::default()
        };
        PathDetails { worst: Some(worst), ..PathDetails::on(&self.adapter) }
    }
}

/// The rejected configurations on one path.
///
/// ```
/// # use karat::check::Failure;
/// # use karat::prelude::*;
/// # let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
/// # let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
/// let wrong = sampler.unrecorded().try_has_mean("u", |x: f32| x.into(), |()| 0.6, 1e-6);
/// let Err(Failure::Rejection(found)) = wrong else { panic!("it is 0.5") };
/// assert_eq!(found.paths[0].rejected, 1);
/// println!("run it again: {}", found.paths[0].replay);
/// ```
#[derive(Clone, Debug)]
pub struct PathRejection {
    /// The path, its adapter and its driver.
    pub adapter: Adapter,
    /// The number of tested configurations.
    pub configurations: u64,
    /// The number of rejected configurations.
    pub rejected: u64,
    /// The configuration with the smallest p-value.
    pub worst: ConfigurationRejection,
    /// The command that runs the worst configuration again.
    pub replay: Replay,
}

/// A configuration that the check rejects. A configuration contains the values of the sampler's non-random
/// arguments.
///
/// ```
/// # use karat::check::Failure;
/// # use karat::prelude::*;
/// # let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
/// # let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
/// let wrong = sampler.unrecorded().try_has_mean("u", |x: f32| x.into(), |()| 0.6, 1e-6);
/// let Err(Failure::Rejection(found)) = wrong else { panic!("it is 0.5") };
/// let worst = &found.paths[0].worst;
/// println!("{}: {}", worst.configuration, worst.findings[0]);
/// ```
#[derive(Clone, Debug)]
pub struct ConfigurationRejection {
    /// The configuration's index.
    pub case: u64,
    /// The configuration's value, as `Debug` shows it.
    pub configuration: String,
    /// The reasons to reject the configuration's samples.
    pub findings: Vec<Finding>,
    /// Additional facts, such as the density's integral and the worst cells.
    pub notes: Vec<(&'static str, String)>,
    /// The files of the pictures. Each picture shows the observed counts, the expected counts and their difference.
    pub pictures: Vec<PathBuf>,
}

/// A reason to reject samples.
///
/// ```
/// use karat::check::Failure;
/// use karat::unstable::check::Finding;
/// # use karat::prelude::*;
///
/// # let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
/// # let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
/// let wrong = sampler.unrecorded().try_has_mean("u", |x: f32| x.into(), |()| 0.6, 1e-6);
/// let Err(Failure::Rejection(found)) = wrong else { panic!("it is 0.5") };
/// assert!(matches!(found.paths[0].worst.findings[0], Finding::Mean { expected: 0.6, .. }));
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Finding {
    /// A call returned NaN or an infinity.
    NotFinite {
        /// The number of calls with this fault.
        count: u64,
        /// The first call with this fault, as text.
        call: String,
    },
    /// Some samples aren't unit vectors, although the points of the support are directions.
    NotUnit {
        /// The number of samples with this fault.
        count: u64,
        /// The first call with this fault, as text.
        call: String,
    },
    /// Samples are outside the support, and the check doesn't allow that.
    Outside {
        /// The number of samples with this fault.
        count: u64,
        /// The first call with this fault, as text.
        call: String,
    },
    /// The density of a sample is 0, so a correct sampler never returns this sample.
    Impossible {
        /// The number of samples with this fault.
        count: u64,
        /// The call of the density for the first sample with this fault, as text.
        call: String,
    },
    /// A density or a reflectance is negative.
    Negative {
        /// The number of calls with this fault.
        count: u64,
        /// The first call with this fault, as text.
        call: String,
    },
    /// A weight isn't eval cos / pdf.
    Weight {
        /// The number of samples with this fault.
        count: u64,
        /// The first wrong weight, and the expected weight, as text.
        call: String,
    },
    /// The integral of a density is wrong: it must be 1, or at most 1 if samples may leave the support.
    Mass {
        /// The integral.
        integral: f64,
        /// The largest allowed difference from 1.
        bound: f64,
    },
    /// The share of samples outside the support isn't 1 minus the density's integral.
    Left {
        /// The number of samples outside the support.
        left: u64,
        /// The expected number of samples outside the support.
        expected: f64,
        /// The p-value: the probability that a correct sampler deviates at least this far from the expected number.
        p: f64,
    },
    /// Samples don't follow the density.
    ChiSquare {
        /// Chi-square, summed over the cells.
        statistic: f64,
        /// The number of degrees of freedom.
        dof: usize,
        /// The p-value: the probability that a correct sampler gives at least this chi-square.
        p: f64,
    },
    /// A mean differs from the expected mean.
    Mean {
        /// The name of the mean: `the mean of component 0 of eval cos / pdf`.
        of: String,
        /// The mean of the samples.
        mean: f64,
        /// The standard error of the mean.
        error: f64,
        /// The expected mean.
        expected: f64,
        /// The p-value: the probability that a correct sampler's mean differs at least this much from the expected
        /// mean.
        p: f64,
    },
    /// A distribution differs from the expected distribution function.
    Distribution {
        /// The name of the number that the verb computes from each sample.
        of: String,
        /// The Kolmogorov distance between the samples' distribution and the expected distribution function.
        distance: f64,
        /// The number at which the two distribution functions differ most.
        at: f64,
        /// The p-value: the probability that a correct sampler gives at least this Kolmogorov distance.
        p: f64,
    },
}

/// Returns the count followed by `one` if the count is 1, and otherwise by `several`.
fn told(count: u64, one: &str, several: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { several })
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite { count, call } => {
                write!(
                    f,
                    "{}, first {call}",
                    told(*count, "call returns NaN or infinity", "calls return NaN or infinity")
                )
            }
            Self::NotUnit { count, call } => {
                write!(
                    f,
                    "{}, first {call}",
                    told(*count, "sample isn't a unit vector", "samples aren't unit vectors")
                )
            }
            Self::Outside { count, call } => {
                write!(
                    f,
                    "{}, first {call}",
                    told(
                        *count,
                        "sample is outside the support",
                        "samples are outside the support"
                    )
                )
            }
            Self::Impossible { count, call } => {
                write!(
                    f,
                    "{}, first {call}",
                    told(*count, "sample has density 0", "samples have density 0")
                )
            }
            Self::Negative { count, call } => {
                write!(
                    f,
                    "{}, first {call}",
                    told(*count, "call returns less than 0", "calls return less than 0")
                )
            }
            Self::Weight { count, call } => {
                write!(
                    f,
                    "{}, first {call}",
                    told(*count, "weight is not eval cos / pdf", "weights are not eval cos / pdf")
                )
            }
            Self::Mass { integral, bound } => {
                write!(f, "the density's integral is {integral:.7}, not 1 to within {bound:.1e}")
            }
            Self::Left { left, expected, p } => write!(
                f,
                "{left} samples are outside the support, but the density predicts {expected:.1}: \
                 p = {p:.2e}"
            ),
            Self::ChiSquare { statistic, dof, p } => {
                write!(f, "chi-square is {statistic:.1} with {dof} degrees of freedom: p = {p:.2e}")
            }
            Self::Mean { of, mean, error, expected, p } => {
                write!(f, "{of} is {mean:.7} +- {error:.1e}, expected {expected:.7}: p = {p:.2e}")
            }
            Self::Distribution { of, distance, at, p } => {
                write!(f, "the distribution of {of} differs by {distance:.2e} at {at}: p = {p:.2e}")
            }
        }
    }
}

/// A rejected configuration, before Karat writes its pictures.
pub(super) struct Worst {
    pub(super) configuration: u64,
    pub(super) shown: String,
    pub(super) findings: Vec<Finding>,
    pub(super) notes: Vec<(&'static str, String)>,
    pub(super) histogram: Option<Histogram>,
}

impl Worst {
    /// Writes the pictures. The file names consist of the check's name, the path's name and the configuration's index.
    pub(super) fn reported(
        self,
        support: Support,
        (check, path): (String, String),
    ) -> ConfigurationRejection {
        let Self { configuration: case, shown: configuration, findings, mut notes, histogram } =
            self;
        let mut pictures = Vec::new();
        if let Some(histogram) = histogram {
            notes.push(("worst cells", histogram.worst_cells(support)));
            let name: String = format!("{check}-{path}-{case}")
                .chars()
                .map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' })
                .collect();
            match histogram.write(&name) {
                Ok(files) => pictures = files,
                Err(error) => notes.push(("no picture", error.to_string())),
            }
        }
        ConfigurationRejection { case, configuration, findings, notes, pictures }
    }
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { significance, threshold, .. } = self;
        writeln!(f, "{}", failed(&self.function, self.check, &self.assertion))?;
        for path in &self.paths {
            writeln!(f, "\non {}", path.adapter)?;
            let PathRejection { configurations, rejected, worst, replay, .. } = path;
            writeln!(
                f,
                "  {rejected} of {configurations} configurations fail (p below \
                 {threshold:.2e}; the significance of the check is {significance})"
            )?;
            writeln!(f, "  worst (case {}): {}", worst.case, worst.configuration)?;
            for finding in &worst.findings {
                writeln!(f, "    {finding}")?;
            }
            for (name, note) in &worst.notes {
                // A note that has several lines begins with a line break.
                let space = if note.starts_with('\n') { "" } else { " " };
                writeln!(f, "    {name}:{space}{note}")?;
            }
            for picture in &worst.pictures {
                writeln!(f, "    observed, expected, difference: {}", picture.display())?;
            }
            writeln!(f, "  replay: {replay}")?;
        }
        for adapter in &self.agreeing {
            writeln!(f, "\non {adapter}\n  all configurations pass")?;
        }
        Ok(())
    }
}
