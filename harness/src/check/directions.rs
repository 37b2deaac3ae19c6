//! Checks of directions: unit vectors, perpendicular vectors, right-handed frames.

use super::demand::Demand;
use super::ordinary::unsuited;
use super::parameter::Parameter;
use super::plan::Plan;
use super::{Agreement, Calls, Check, Failure, Mismatch};
use crate::domain::Stream;
use crate::reflect::Function;
use crate::run::or_panic;
use crate::value::{Scalar, Shape};

/// The largest allowed difference between a length and 1. WGSL allows `normalize` an error of 1e-6, and a vector from a
/// cosine and `sqrt(1 - c * c)` an error several times as large. If a shader forgets to normalise a vector, its length
/// usually differs from 1 by more than 1e-5.
const LENGTH: f64 = 1e-5;

impl<V> Check<'_, Calls<V>> {
    /// Checks that results are vectors of length 1, to within 1e-5.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS.function("sampling::cosine_hemisphere").over((0.0..=1.0, 0.0..=1.0)).is_unit();
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a length isn't 1, if the function doesn't return a vector of floats, or if
    /// nothing could be checked.
    #[track_caller]
    pub fn is_unit(self) -> Agreement {
        or_panic(self.try_is_unit())
    }

    /// Runs [`is_unit`](Self::is_unit), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a length isn't 1, if the function doesn't return a vector of floats, or if nothing could
    /// be checked.
    pub fn try_is_unit(self) -> Result<Agreement, Failure> {
        self.plan.is_unit(&*self.stream, &self.demand())
    }

    /// Checks that each result is a vector perpendicular to an argument. The argument must be a vector of the
    /// result's type. The absolute cosine of the angle between the two vectors must be at most 1e-5. A zero
    /// vector fails, because it has no direction.
    ///
    /// This check can't see a wrong sign: a tangent or bitangent that points backwards passes.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS.function("geometry::tangent").over(UnitVector).is_perpendicular_to("normal");
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a result isn't perpendicular, if the argument or the result has another
    /// type, or if nothing could be checked.
    #[track_caller]
    pub fn is_perpendicular_to(self, argument: impl Into<Parameter>) -> Agreement {
        or_panic(self.try_is_perpendicular_to(argument))
    }

    /// Runs [`is_perpendicular_to`](Self::is_perpendicular_to), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a result isn't perpendicular, if the argument or the result has another type, or if
    /// nothing could be checked.
    pub fn try_is_perpendicular_to(
        self,
        argument: impl Into<Parameter>,
    ) -> Result<Agreement, Failure> {
        self.plan.is_perpendicular_to(&*self.stream, &self.demand(), &argument.into())
    }

    /// Checks that results are right-handed frames: three unit vectors at right angles to each other. The third
    /// vector must be the cross product of the first two. Lengths, angles and the product must be right to
    /// within 1e-5. The function returns the vectors as the columns of a 3x3 matrix, the elements of an array
    /// or the members of a structure.
    ///
    /// A mirrored frame fails this check, although its vectors are perpendicular unit vectors. A rotated frame passes
    /// this check: to test the frame's directions, use [`satisfies`](Self::satisfies).
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// // Tangent, bitangent, normal.
    /// SHADERS.function("geometry::basis").over(UnitVector).is_right_handed_frame();
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a result isn't a right-handed frame, if the result has another type, or
    /// if nothing could be checked.
    #[track_caller]
    pub fn is_right_handed_frame(self) -> Agreement {
        or_panic(self.try_is_right_handed_frame())
    }

    /// Runs [`is_right_handed_frame`](Self::is_right_handed_frame), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a result isn't a right-handed frame, if the result has another type, or if nothing could
    /// be checked.
    pub fn try_is_right_handed_frame(self) -> Result<Agreement, Failure> {
        self.plan.is_right_handed_frame(&*self.stream, &self.demand())
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn is_right_handed(lanes: &[f64]) -> bool {
    let [a, b, c] = [0, 3, 6].map(|first| &lanes[first..first + 3]);
    let cross = [0, 1, 2].map(|x| {
        let (y, z) = ((x + 1) % 3, (x + 2) % 3);
        a[y] * b[z] - a[z] * b[y]
    });
    let is_unit = |x: &&[f64]| (dot(x, x).sqrt() - 1.0).abs() <= LENGTH;
    // Two unit vectors are perpendicular if their cross product is a unit vector.
    [a, b, c].iter().all(is_unit)
        && dot(a, b).abs() <= LENGTH
        && cross.iter().zip(c).all(|(x, c)| (x - c).abs() <= LENGTH)
}

fn floats(shape: &Shape) -> Option<Scalar> {
    match shape {
        Shape::Vector { scalar: scalar @ (Scalar::F32 | Scalar::F16), .. } => Some(*scalar),
        _ => None,
    }
}

/// Returns the scalar type if `shape` is a matrix, array or structure of three vectors of three floats.
fn three_vectors(shape: &Shape) -> Option<Scalar> {
    let of_three = |shape: &Shape| match shape {
        Shape::Vector { size: 3, .. } => floats(shape),
        _ => None,
    };
    match shape {
        Shape::Matrix { columns: 3, rows: 3, scalar } => Some(*scalar),
        Shape::Array { element, length: 3 } => of_three(element),
        Shape::Struct { members, .. } => match &**members {
            [(_, a), (_, b), (_, c)] => of_three(a).filter(|_| a == b && a == c),
            _ => None,
        },
        _ => None,
    }
}

fn decoded(scalar: Scalar, words: &[u32]) -> Vec<f64> {
    words.iter().map(|word| scalar.decode(*word)).collect()
}

impl Plan<'_> {
    pub(super) fn is_unit(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
    ) -> Result<Agreement, Failure> {
        let statement = format!("each result has length 1 to within {LENGTH:e}");
        let suited = |function: Function| match function.result {
            Shape::Vector { scalar: scalar @ (Scalar::F32 | Scalar::F16), .. } => {
                Ok((function, scalar))
            }
            _ => Err(unsuited(&function, "but this check needs a vector of floats")),
        };
        let begun = self.function().and_then(suited);
        let asserted = ("is_unit", &*statement);
        self.with(begun, asserted, (stream, demand), |(function, scalar)| {
            let holds = |_: &[u32], words: &[u32]| {
                let square = |word: &u32| scalar.decode(*word).powi(2);
                (words.iter().map(square).sum::<f64>().sqrt() - 1.0).abs() <= LENGTH
            };
            self.states(stream, demand, asserted, (&function.result, &holds))
        })
    }

    pub(super) fn is_perpendicular_to(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        argument: &Parameter,
    ) -> Result<Agreement, Failure> {
        let statement = format!("each result is perpendicular to {argument} to within {LENGTH:e}");
        let suited = |function: Function| {
            let Some(scalar) = floats(&function.result) else {
                return Err(unsuited(&function, "but this check needs a vector of floats"));
            };
            let (place, first) = argument.place(&function)?;
            let (name, shape) = &function.parameters[place];
            // An argument that varies from pixel to pixel has four values. The pixel's own value comes first.
            if *shape.quad().unwrap_or(shape) != function.result {
                let (name, shape, result) = (name.clone(), shape.clone(), function.result.clone());
                return Err(Mismatch::NoDirection { name, shape, result }.of(&function));
            }
            Ok((function, scalar, first))
        };
        let begun = self.function().and_then(suited);
        let asserted = ("is_perpendicular_to", &*statement);
        self.with(begun, asserted, (stream, demand), |(function, scalar, first)| {
            let holds = |arguments: &[u32], words: &[u32]| {
                let to = decoded(scalar, &arguments[first..first + words.len()]);
                let own = decoded(scalar, words);
                let lengths = dot(&own, &own).sqrt() * dot(&to, &to).sqrt();
                // A zero vector has no direction. An infinite length would make every cosine small.
                let is_angle = lengths > 0.0 && lengths.is_finite();
                is_angle && dot(&own, &to).abs() <= LENGTH * lengths
            };
            self.states(stream, demand, asserted, (&function.result, &holds))
        })
    }

    pub(super) fn is_right_handed_frame(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
    ) -> Result<Agreement, Failure> {
        let statement = format!("each result is a right-handed frame to within {LENGTH:e}");
        let suited = |function: Function| match three_vectors(&function.result) {
            Some(scalar) => Ok((function, scalar)),
            None => Err(unsuited(&function, "but this check needs three vectors of three floats")),
        };
        let begun = self.function().and_then(suited);
        let asserted = ("is_right_handed_frame", &*statement);
        self.with(begun, asserted, (stream, demand), |(function, scalar)| {
            let holds = |_: &[u32], words: &[u32]| is_right_handed(&decoded(scalar, words));
            self.states(stream, demand, asserted, (&function.result, &holds))
        })
    }
}
