//! The declarations of `karat.toml` about findings: inputs, accepted hazards, accepted mutants, and rows of the matrix
//! that are known to fail.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::inputs::Declaration;

/// The declarations for the search for hazards.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hazards {
    /// `[inputs]`, by name.
    pub inputs: BTreeMap<String, Declaration>,
    /// Values of overrides, in each function that has one.
    pub overrides: BTreeMap<String, f64>,
    /// `[[hazard]]`.
    pub accepted: Vec<AcceptedHazard>,
}

/// An entry of accepted hazards, as `karat.toml` has it.
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

/// An entry of accepted mutants, as `karat.toml` has it.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AcceptedMutants {
    /// Their names, as `karat mutate` prints them: `b778d00e`.
    pub ids: Vec<String>,
    /// The reason why no test can kill them.
    pub reason: String,
}

/// An entry for rows of the translation matrix that are known not to reach a status, as `karat.toml` has it.
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
