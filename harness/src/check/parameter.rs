//! Selects a parameter of a function by its name or its index.

use std::fmt;

use super::Failure;
use super::Mismatch;
use crate::diagnostic::nearest;
use crate::reflect::Function;
use crate::value::{Scalar, Shape};

/// A parameter of a WGSL function, selected by its name or by its index. Indices count from 0.
///
/// ```
/// use karat::unstable::check::Parameter;
///
/// assert_eq!(Parameter::from("alpha").to_string(), "`alpha`");
/// assert_eq!(Parameter::from(0).to_string(), "argument 0");
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// The name of the WGSL parameter.
    Name(String),
    /// The index of the parameter, counted from 0.
    Place(usize),
}

impl From<&str> for Parameter {
    fn from(name: &str) -> Self {
        Self::Name(name.to_owned())
    }
}

impl From<usize> for Parameter {
    fn from(place: usize) -> Self {
        Self::Place(place)
    }
}

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name(name) => write!(f, "`{name}`"),
            Self::Place(place) => write!(f, "argument {place}"),
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct ScalarParameter {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    /// The index of the parameter among the components of all arguments.
    pub(super) lane: usize,
}

impl ScalarParameter {
    /// Returns the value at a fraction of the way from `own` to `other`. The value always differs from `own`.
    pub(super) fn between(&self, own: u32, other: u32, fraction: f64) -> u32 {
        let (from, to) = (self.scalar.decode(own), self.scalar.decode(other));
        let at = from + fraction * (to - from);
        match self.scalar {
            Scalar::F32 => {
                #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
                let at = at as f32;
                let own = f32::from_bits(own);
                let next = if to > from { own.next_up() } else { own.next_down() };
                (if at == own { next } else { at }).to_bits()
            }
            Scalar::I32 | Scalar::U32 => {
                let (steps, sign) = ((at - from).abs().round().max(1.0), (to - from).signum());
                #[expect(clippy::cast_possible_truncation, reason = "between two 32-bit integers")]
                let moved = (from + sign * steps) as i64;
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "the low 32 bits are the word of either type"
                )]
                let word = moved as u32;
                word
            }
            _ => other,
        }
    }
}

impl Parameter {
    /// Finds the parameter's index, and the index of its first component among the components of all arguments.
    pub(super) fn place(&self, function: &Function) -> Result<(usize, usize), Failure> {
        let parameters = &function.parameters;
        let names = || parameters.iter().map(|(name, _)| &**name);
        let place = match self {
            Self::Name(name) => names().position(|known| known == name),
            Self::Place(place) => (*place < parameters.len()).then_some(*place),
        };
        let Some(place) = place else {
            let mismatch = match self {
                Self::Name(name) => {
                    let nearest = nearest(name, names()).map(str::to_owned);
                    Mismatch::NoParameter { name: name.clone(), nearest }
                }
                Self::Place(place) => Mismatch::NoPlace { count: parameters.len(), place: *place },
            };
            return Err(mismatch.of(function));
        };
        let lane = parameters[..place].iter().map(|(_, shape)| shape.lanes().len()).sum();
        Ok((place, lane))
    }

    /// Finds the parameter. Returns an error if the parameter isn't a number.
    pub(super) fn scalar(&self, function: &Function) -> Result<ScalarParameter, Failure> {
        let (place, lane) = self.place(function)?;
        let (name, shape) = &function.parameters[place];
        let scalar = match shape {
            Shape::Scalar(scalar) if *scalar != Scalar::Bool => *scalar,
            _ => {
                let (name, shape) = (name.clone(), shape.clone());
                return Err(Mismatch::NoNumber { name, shape }.of(function));
            }
        };
        Ok(ScalarParameter { name: name.clone(), scalar, lane })
    }
}
