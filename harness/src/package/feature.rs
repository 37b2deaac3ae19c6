//! The values of features.

use std::collections::BTreeMap;
use std::fmt;

/// The value of a feature.
///
/// ```
/// use karat::Package;
///
/// let package = Package::from_source("m", "@if(fast) fn f() {}").feature("fast", true);
/// let with_a_number = package.feature("SAMPLES", 4);
/// # let _ = with_a_number;
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum Feature {
    /// On or off: `@if(name)`, `#ifdef name`.
    Flag(bool),
    /// On, with a number: `constants::name` in Bevy's WESL, `#{name}` and `#if name == 3` in `naga_oil`'s
    /// modules.
    Number(i64),
}

impl From<bool> for Feature {
    fn from(on: bool) -> Self {
        Self::Flag(on)
    }
}

impl From<i32> for Feature {
    fn from(value: i32) -> Self {
        Self::Number(value.into())
    }
}

impl From<u32> for Feature {
    fn from(value: u32) -> Self {
        Self::Number(value.into())
    }
}

impl fmt::Display for Feature {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Flag(on) => on.fmt(f),
            Self::Number(value) => value.fmt(f),
        }
    }
}

/// The values of features. Other features are off.
pub(crate) type Features = BTreeMap<String, Feature>;

pub(super) fn is_on(features: &Features, name: &str) -> bool {
    !matches!(features.get(name), None | Some(Feature::Flag(false)))
}
