//! The compilers that a package is for, besides naga: `[compilers]` in `karat.toml`.

use serde::Deserialize;

use super::Package;
use super::limits::Limits;
use crate::diagnostic::nearest;

/// The sections `[compilers]` and `[limits]` of `karat.toml`.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Compilers {
    /// Set if a shader that Tint rejects is invalid. Without Tint there is then no verdict.
    pub(crate) require_tint: bool,
    /// Native features of wgpu that shaders use on purpose, by naga's capability names.
    pub(crate) native: Vec<String>,
    pub(crate) limits: Limits,
    /// The file, for messages.
    pub(crate) file: String,
}

/// The section `[compilers]`, as the file has it.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Written {
    /// Compilers without whose verdict a run fails: `["tint"]`.
    #[serde(default)]
    require: Vec<String>,
    /// Capabilities of wgpu alone, by naga's names: Tint isn't asked about modules that use one.
    #[serde(default)]
    native: Vec<String>,
}

impl Compilers {
    pub(super) fn of(written: Written, limits: Limits, file: String) -> Result<Self, String> {
        let Written { require, native } = written;
        if let Some(other) = require.iter().find(|name| *name != "tint") {
            let near = nearest(other, ["tint"]).map_or("", |_| "; did you mean `tint`?");
            let other =
                format!("`[compilers] require` names `{other}`, and asks `tint` alone{near}");
            return Err(other);
        }
        Ok(Self { require_tint: !require.is_empty(), native, limits, file })
    }
}

impl Package {
    /// Requires Tint's verdict for [`is_valid`](Self::is_valid), whatever `karat.toml` says.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let package = Package::from_source("m", "fn shift(x: u32) -> u32 { return x << x + 1u; }");
    /// assert!(package.require_tint().try_is_valid().is_err()); // it is rejected, or isn't here
    /// ```
    #[must_use]
    pub fn require_tint(&self) -> Self {
        Self { requires_tint: true, ..self.clone() }
    }
}
