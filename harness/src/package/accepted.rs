//! The declarations of `karat.toml` about findings: inputs, hazards that are accepted, mutants that no test can kill, rows
//! of the matrix that don't get far.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::inputs::Declaration;

/// What is declared for the search for hazards.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hazards {
    /// `[inputs]`, by name.
    pub inputs: BTreeMap<String, Declaration>,
    /// Values of overrides, in each function that has one.
    pub overrides: BTreeMap<String, f64>,
    /// `[[hazard]]`.
    pub accepted: Vec<AcceptedHazard>,
}

/// Hazards that are accepted, as it is written.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AcceptedHazard {
    /// The functions: `brdf::schlick`, or all of a module, `brdf::*`.
    pub functions: Vec<String>,
    /// The operation as it is written; without it all operations.
    pub text: Option<String>,
    /// The reason why it is meant.
    pub reason: String,
}

/// Mutants that no test can kill, as it is written.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AcceptedMutants {
    /// Their names, as `karat mutate` prints them: `b778d00e`.
    pub ids: Vec<String>,
    /// The reason why no test can kill them.
    pub reason: String,
}

/// Rows of the matrix of translations that are declared not to get to a status, as it is written.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownRows {
    /// The functions: `brdf::schlick`.
    pub rows: Vec<String>,
    /// The columns of the matrix, or selectors of paths.
    pub columns: Vec<String>,
    /// The status that they don't get to: `"valid"`.
    pub status: String,
    /// The reason.
    pub reason: String,
}
