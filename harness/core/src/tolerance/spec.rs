//! Tolerances from the WGSL specification, and from the measured accuracy of an adapter.

use std::fmt;

use super::{Abs, Rel, Tolerance, Ulp};
use crate::value::Scalar;

/// The largest relative difference between the reference and an end of WGSL's range, unless a check sets another limit.
/// Such a range leaves three decimal digits, which the eye and 8-bit channels need. An `f32` has seven digits, so a
/// shader may lose four of them.
const NEED: f64 = 1.0 / 1024.0;

/// The largest relative difference between the reference and an end of WGSL's range for `f16`, unless a check sets
/// another limit. An `f16` has a relative precision of 2^-10. Such a range leaves five of an `f16`'s ten bits. WGSL's
/// range for a single division is narrower than this limit.
const NEED_HALF: f64 = 1.0 / 32.0;

/// The range of values that the WGSL specification allows a function to return for the case's arguments. Karat computes
/// it by interval arithmetic, from the accuracy of each operation ("Floating Point Accuracy").
///
/// A case passes if both the result and the reference are inside of the range, and if the range is narrow. A range is
/// narrow if the reference differs from each end by at most 2^-10 of the reference (2^-5 for `f16`). To set another
/// limit, call [`needing`](Self::needing). With `Spec`, you needn't choose a tolerance for a first test, and the
/// verdict doesn't depend on the driver. Cases in which WGSL allows a wider range, or any value, fail. Set a tolerance
/// for these cases with [`or`](Self::or).
///
/// ```no_run
/// # use karat::prelude::*;
/// # static SHADERS: Package = karat::package!("shaders");
/// SHADERS
///     .function("fresnel::schlick_scalar")
///     .over((0.0..=1.0, 0.0..=1.0))
///     .agrees_with(|f0: f64, c: f64| f0 + (1.0 - f0) * (1.0 - c).powi(5), Spec);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spec;

impl Spec {
    /// [`Spec`] with another limit for the difference between the reference and an end of the range. A smaller limit
    /// requires more exact digits, a larger limit fewer.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS
    ///     .function("fresnel::dielectric")
    ///     .over((1.1..=2.5, 0.0..=1.0))
    ///     .agrees_with(|ior: f64, c: f64| ior * c, Spec.needing(Rel(1e-2))); // two digits are enough
    /// ```
    pub fn needing(self, tolerance: impl Into<Tolerance>) -> SpecTolerance {
        SpecTolerance { need: tolerance.into(), otherwise: None, measured: false }
    }

    /// [`Spec`], with another tolerance for cases in which WGSL's range is too wide.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS
    ///     .function("phase::rayleigh")
    ///     .over(-1.0..=1.0)
    ///     .agrees_with(|c: f64| 0.75 * (1.0 + c * c), Spec.or(Abs(1e-6)));
    /// ```
    pub fn or(self, tolerance: impl Into<Tolerance>) -> SpecTolerance {
        SpecTolerance::from(self).or(tolerance)
    }
}

/// The range of values that each path's adapter may return for the case's arguments, computed from the measured
/// accuracy of the adapter's builtin functions.
///
/// `DeviceSpec` works like [`Spec`]. In each case its range is at most as wide as the range of [`Spec`]. For a sine
/// between -pi and pi, WGSL allows an error of 2^-11. For other arguments, WGSL allows any error. Most adapters are
/// thousands of times more precise, for all arguments. Karat measures each builtin function once on an adapter, and
/// allows twice the largest error. Karat stores the results in cargo's home, by adapter and driver.
///
/// A test that passes with `DeviceSpec` shows nothing about other adapters. Use `DeviceSpec` to test your shader's own
/// rounding. Use [`Spec`] for a test that should pass everywhere.
///
/// ```no_run
/// # use karat::prelude::*;
/// # static SHADERS: Package = karat::package!("shaders");
/// SHADERS
///     .function("phase::henyey_greenstein")
///     .over((-0.9..=0.9, -1.0..=1.0))
///     .agrees_with(|g: f64, c: f64| (1.0 - g * g) / (1.0 + g * g - 2.0 * g * c).powf(1.5), DeviceSpec);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceSpec;

impl DeviceSpec {
    /// [`DeviceSpec`] with another limit for the difference between the reference and an end of the range. A smaller
    /// limit requires more exact digits, a larger limit fewer.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS
    ///     .function("noise::wave")
    ///     .over(-100.0..=100.0)
    ///     .agrees_with(|x: f64| x.sin(), DeviceSpec.needing(Abs(1e-4)));
    /// ```
    pub fn needing(self, tolerance: impl Into<Tolerance>) -> SpecTolerance {
        SpecTolerance { measured: true, ..Spec.needing(tolerance) }
    }

    /// [`DeviceSpec`], with another tolerance for cases in which the adapter's range is too wide.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS
    ///     .function("noise::wave")
    ///     .over(-100.0..=100.0)
    ///     .agrees_with(|x: f64| x.sin(), DeviceSpec.or(Abs(1e-6)));
    /// ```
    pub fn or(self, tolerance: impl Into<Tolerance>) -> SpecTolerance {
        SpecTolerance::from(self).or(tolerance)
    }
}

/// [`Spec`] or [`DeviceSpec`], with the limits that the author of a test has set.
///
/// ```
/// use karat::{Abs, Rel, Spec};
///
/// let spec_tolerance = Spec.needing(Rel(1e-2)).or(Abs(1e-6));
/// let text = "what WGSL allows if all allowed results are within rel 1e-2 of the reference, or else abs 1e-6";
/// assert_eq!(spec_tolerance.to_string(), text);
/// ```
#[derive(Clone, Debug, PartialEq)]
#[must_use]
pub struct SpecTolerance {
    /// The largest difference between the reference and an end of the range.
    #[doc(hidden)]
    pub need: Tolerance,
    /// The tolerance for cases in which the range is wider than `need` allows.
    #[doc(hidden)]
    pub otherwise: Option<Tolerance>,
    /// `true` if the range comes from the adapter's measured accuracy.
    #[doc(hidden)]
    pub measured: bool,
}

impl SpecTolerance {
    /// Sets a tolerance for cases in which WGSL allows a range that is too wide, or any value.
    ///
    /// ```
    /// use karat::{Abs, Rel, Spec};
    ///
    /// let spec_tolerance = Spec.needing(Rel(1e-2)).or(Abs(1e-6));
    /// # let _ = spec_tolerance;
    /// ```
    pub fn or(self, tolerance: impl Into<Tolerance>) -> Self {
        Self { otherwise: Some(tolerance.into()), ..self }
    }

    /// The largest difference between the reference and an end of the range, for a scalar type: the author's limit, or
    /// the default for this type.
    #[doc(hidden)]
    pub fn need_of(&self, scalar: Scalar) -> Tolerance {
        match (&self.need, scalar) {
            (Tolerance::Rel(need), Scalar::F16) if *need == NEED => Tolerance::Rel(NEED_HALF),
            (need, _) => need.clone(),
        }
    }
}

impl From<Spec> for SpecTolerance {
    fn from(spec: Spec) -> Self {
        spec.needing(Rel(NEED))
    }
}

impl From<DeviceSpec> for SpecTolerance {
    fn from(device: DeviceSpec) -> Self {
        device.needing(Rel(NEED))
    }
}

impl fmt::Display for SpecTolerance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.measured { "what this adapter allows" } else { "what WGSL allows" })?;
        match &self.need {
            Tolerance::Rel(need) if *need == NEED => {}
            need => write!(f, " if all allowed results are within {need} of the reference")?,
        }
        match &self.otherwise {
            Some(tolerance) => write!(f, ", or else {tolerance}"),
            None => Ok(()),
        }
    }
}

/// The criterion by which Karat judges a result.
///
/// ```
/// use karat::unstable::tolerance::Criterion;
/// use karat::{Spec, Ulp};
///
/// let criteria: [Criterion; 2] = [Ulp(4.0).into(), Spec.into()];
/// assert_eq!(criteria[0].to_string(), "4 ulp");
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum Criterion {
    /// The result must be within this tolerance of the reference.
    Within(Tolerance),
    /// The result must be in the range that WGSL allows, or in the adapter's measured range.
    Allowed(SpecTolerance),
}

macro_rules! within {
    ($($name:ty),*) => {
        $(impl From<$name> for Criterion {
            fn from(tolerance: $name) -> Self {
                Self::Within(tolerance.into())
            }
        })*
    };
}
within!(Tolerance, Ulp, Rel, Abs);

impl From<Spec> for Criterion {
    fn from(spec: Spec) -> Self {
        Self::Allowed(spec.into())
    }
}

impl From<DeviceSpec> for Criterion {
    fn from(device: DeviceSpec) -> Self {
        Self::Allowed(device.into())
    }
}

impl From<SpecTolerance> for Criterion {
    fn from(spec_tolerance: SpecTolerance) -> Self {
        Self::Allowed(spec_tolerance)
    }
}

impl fmt::Display for Criterion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Within(tolerance) => tolerance.fmt(f),
            Self::Allowed(spec_tolerance) => spec_tolerance.fmt(f),
        }
    }
}
