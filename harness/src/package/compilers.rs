//! The compilers that a package must support in addition to naga: `[compilers]` in `karat.toml`.

use serde::Deserialize;

use super::Package;
use super::limits::Limits;
use crate::diagnostic::nearest;

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Compilers {
    /// `true` if Tint, too, must accept each shader. In that case, a package is invalid if Tint gives no
    /// verdict, for example because Tint isn't installed.
    pub(crate) require_tint: bool,
    /// The native features of wgpu that shaders use intentionally, as naga names them.
    pub(crate) native: Vec<String>,
    pub(crate) limits: Limits,
    pub(crate) file: String,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Written {
    /// Compilers that must give a verdict: `["tint"]`. Without this verdict, the run fails.
    #[serde(default)]
    require: Vec<String>,
    /// Capabilities that only wgpu has, by naga's names. If a module uses one of these capabilities, Karat doesn't ask
    /// Tint about the module.
    #[serde(default)]
    native: Vec<String>,
}

impl Compilers {
    pub(super) fn of(written: Written, limits: Limits, file: String) -> Result<Self, String> {
        let Written { require, native } = written;
        if let Some(other) = require.iter().find(|name| *name != "tint") {
            let near = nearest(other, ["tint"]).map_or("", |_| "; did you mean `tint`?");
            let other =
                format!("`[compilers] require` names `{other}`, but accepts only `tint`{near}");
            return Err(other);
        }
        Ok(Self { require_tint: !require.is_empty(), native, limits, file })
    }
}

impl Package {
    /// Makes [`is_valid`](Self::is_valid) require Tint's verdict, even if `karat.toml` doesn't require it.
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
