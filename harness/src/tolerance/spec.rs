//! What the WGSL specification allows, as a tolerance.

use std::fmt;

use super::{Abs, Rel, Tolerance, Ulp};

/// How wide what WGSL allows may be unless a check says otherwise: three decimal digits, which is what
/// the eye and 8 bits a channel need, and a quarter of what `f32` has.
const NEED: f64 = 1.0 / 1024.0;

/// What the WGSL specification allows this very code to return for these very arguments. It is computed
/// by interval arithmetic, from the accuracy of each operation ("Floating Point Accuracy").
///
/// A case passes if both result and reference are inside, and all that is inside is the same to within
/// 2^-10 relative, or to what [`needing`](Self::needing) says. So a first test needs no number, and
/// what it accepts doesn't depend on the driver. Cases in which WGSL allows more, or anything, fail: say
/// with [`or`](Self::or) what is wanted there.
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
    /// [`Spec`] for whoever needs more or fewer digits.
    pub fn needing(self, tolerance: impl Into<Tolerance>) -> Granting {
        Granting { need: tolerance.into(), otherwise: None }
    }

    /// [`Spec`], and this tolerance where WGSL allows too much.
    pub fn or(self, tolerance: impl Into<Tolerance>) -> Granting {
        Granting::from(self).or(tolerance)
    }
}

/// [`Spec`] with what its author needs.
#[derive(Clone, Debug, PartialEq)]
#[must_use]
pub struct Granting {
    /// How far apart results may be that WGSL allows.
    pub(crate) need: Tolerance,
    /// What holds where they are further apart.
    pub(crate) otherwise: Option<Tolerance>,
}

impl Granting {
    /// Judges by this tolerance where WGSL allows more than is needed, or anything.
    pub fn or(self, tolerance: impl Into<Tolerance>) -> Self {
        Self { otherwise: Some(tolerance.into()), ..self }
    }
}

impl From<Spec> for Granting {
    fn from(spec: Spec) -> Self {
        spec.needing(Rel(NEED))
    }
}

impl fmt::Display for Granting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("what WGSL allows")?;
        match &self.need {
            Tolerance::Rel(need) if *need == NEED => {}
            need => write!(f, " if that is within {need}")?,
        }
        match &self.otherwise {
            Some(tolerance) => write!(f, ", or else {tolerance}"),
            None => Ok(()),
        }
    }
}

/// What a result is judged by.
#[derive(Clone, Debug, PartialEq)]
pub enum Criterion {
    /// Its distance from the reference.
    Within(Tolerance),
    /// What WGSL allows.
    Spec(Granting),
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
        Self::Spec(spec.into())
    }
}

impl From<Granting> for Criterion {
    fn from(granting: Granting) -> Self {
        Self::Spec(granting)
    }
}

impl fmt::Display for Criterion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Within(tolerance) => tolerance.fmt(f),
            Self::Spec(granting) => granting.fmt(f),
        }
    }
}
