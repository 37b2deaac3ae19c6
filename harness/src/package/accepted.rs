//! The parts of `karat.toml` for `karat hazards`, `karat mutate` and `karat matrix`: inputs, accepted hazards and
//! mutants, and known failures.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::inputs::Declaration;

/// The tables of `karat.toml` that `karat hazards` uses.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hazards {
    /// The entries of `[inputs]`, by name.
    pub inputs: BTreeMap<String, Declaration>,
    /// The values of WGSL's `override`s, by name. A value applies to all functions that use the `override`.
    pub overrides: BTreeMap<String, f64>,
    /// The entries of `[[hazard]]`.
    pub accepted: Vec<AcceptedHazard>,
}

/// An entry of `karat.toml` with accepted hazards.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AcceptedHazard {
    /// The functions: `brdf::schlick`, or all functions of a module: `brdf::*`.
    pub functions: Vec<String>,
    /// The source text of the operation. `None` accepts all operations.
    pub text: Option<String>,
    /// The reason why the hazard is acceptable.
    pub reason: String,
}

/// An entry of `karat.toml` with accepted mutants.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AcceptedMutants {
    /// The names of the mutants, as `karat mutate` prints them: `b778d00e`.
    pub ids: Vec<String>,
    /// The reason why no test can kill the mutants.
    pub reason: String,
}

/// An entry of `[[matrix]]` in `karat.toml`: known failures of functions (rows) in the table of `karat matrix`.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownRows {
    /// The functions: `brdf::schlick`.
    pub rows: Vec<String>,
    /// The columns of the matrix to which the entry applies, by name or by a selector of paths.
    pub columns: Vec<String>,
    /// The status that the rows don't reach: `"valid"`.
    pub status: String,
    /// The reason why the rows don't reach the status.
    pub reason: String,
}
