//! Finds the results that WGSL leaves open. If two columns differ in such a result, both are right.

use karat::fixture::Fixtures;
use karat::unstable::interpret::{Alone, Bound, Interpreted};
use karat::unstable::probe::Probed;
use karat::unstable::reflect::BindingKind;
use karat_core::value::Scalar;

/// A function in Karat's engine, which knows the results that WGSL leaves open; `Unknown` if the engine can't execute
/// the function.
#[derive(Default)]
pub(super) enum Leeway {
    #[default]
    Unknown,
    Function {
        function: Interpreted,
        loose: bool,
    },
    /// A function whose cases run in separate dispatches.
    Alone(Alone),
}

/// The values that WGSL allows for the lanes of some cases.
pub(super) struct Latitude {
    /// The allowed bounds of each lane; `None` if the bounds are unknown, as for derivatives.
    pub(super) bounds: Option<Vec<Bound>>,
    /// The lanes that depend on a read or a write outside of an array.
    strays: Vec<bool>,
    /// `true` if bounds are wider than WGSL's bounds. For example, the bounds of a texture sample contain all texels of
    /// the texture.
    loose: bool,
}

/// The values that WGSL allows for the lanes of one case.
#[derive(Clone, Copy)]
pub(super) struct OfCase<'l> {
    bounds: Option<&'l [Bound]>,
    strays: &'l [bool],
    loose: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Freedom {
    /// WGSL allows any value, so both results are right.
    Any,
    /// WGSL allows both results.
    Both,
    /// WGSL doesn't allow both results.
    NotBoth,
    /// The results that WGSL allows are unknown.
    Unknown,
}

impl Leeway {
    pub(super) fn of(probed: &Probed, fixtures: &Fixtures) -> Self {
        match probed.function().form.alone {
            true => Alone::new(probed, fixtures).map_or(Self::Unknown, Self::Alone),
            false => Interpreted::new(probed, fixtures).map_or(Self::Unknown, |function| {
                let bindings = &probed.function().bindings;
                let loose = bindings.iter().any(|one| {
                    matches!(one.kind, BindingKind::Texture(_) | BindingKind::StorageTexture { .. })
                });
                Self::Function { function, loose }
            }),
        }
    }

    /// The values that WGSL allows for the lanes of these cases; `None` if the engine doesn't know them.
    pub(super) fn at(&self, rows: &[u32], cases: usize) -> Option<Latitude> {
        match self {
            Self::Unknown => None,
            Self::Function { function, loose } => {
                let strays = function.strays(cases, rows).ok()?;
                let bounds = function.bounds(cases, rows).ok();
                Some(Latitude { bounds, strays, loose: *loose })
            }
            Self::Alone(function) => {
                let strays = function.strays(cases, rows).ok()?;
                Some(Latitude { bounds: None, strays, loose: false })
            }
        }
    }
}

impl Latitude {
    /// The allowed values for a case whose result has `width` lanes.
    pub(super) fn case(&self, case: usize, width: usize) -> OfCase<'_> {
        let lanes = case * width..(case + 1) * width;
        let bounds = self.bounds.as_ref().and_then(|bounds| bounds.get(lanes.clone()));
        OfCase { bounds, strays: self.strays.get(lanes).unwrap_or_default(), loose: self.loose }
    }
}

impl OfCase<'_> {
    pub(super) fn freedom(&self, lane: usize, scalar: Scalar, results: [u32; 2]) -> Freedom {
        if self.strays.get(lane) == Some(&true) {
            return Freedom::Any;
        }
        // An index outside of an array in one lane makes the bounds of all lanes unusable.
        let Some(bounds) = self.bounds.filter(|_| !self.strays.contains(&true)) else {
            return Freedom::Unknown;
        };
        let Some(bound) = bounds.get(lane) else { return Freedom::Unknown };
        let is_any = bound.ends().is_none_or(|(least, most)| match scalar {
            Scalar::I32 | Scalar::U32 => most - least >= f64::from(u32::MAX),
            Scalar::Bool => least < most,
            Scalar::F32 | Scalar::F16 => false,
        });
        match results.iter().all(|word| bound.allows(scalar.decode(*word))) {
            _ if is_any => Freedom::Any,
            true if self.loose => Freedom::Unknown,
            true => Freedom::Both,
            false => Freedom::NotBoth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use karat::Package;

    // Lesson 155
    #[test]
    fn a_read_out_of_bounds_is_open_and_other_results_are_not() {
        let text = "fn f(i: u32, x: f32) -> vec2f {
                        var a = array<f32, 3>(1.0, 2.0, 3.0);
                        return vec2f(a[i], x / 3.0);
                    }
                    fn g(i: u32, n: i32) -> vec2i {
                        var a = array<i32, 3>();
                        a[i] = 5;
                        return vec2i(a[2], 7 / n);
                    }";
        let package = Package::from_source("p", text);
        let freedom = |name: &str, row: [u32; 2], scalar: Scalar, results: [[u32; 2]; 2]| {
            let probed = Probed::new(&package, name).expect("the function can be called");
            let fixtures = Fixtures::new();
            let latitude =
                Leeway::of(&probed, &fixtures).at(&row, 1).expect("the open lanes are known");
            [0, 1].map(|lane| latitude.case(0, 2).freedom(lane, scalar, results[lane]))
        };
        let [two, three, one] = [2.0_f32, 3.0, 1.0].map(f32::to_bits);
        // The value of `a[1]` is 2, and 3 / 3 is 1.
        let f = |i: u32, lane| freedom("f", [i, three], Scalar::F32, [[two, lane], [one, one]]);
        assert_eq!(f(1, two), [Freedom::Both, Freedom::Both]);
        assert_eq!(f(1, three), [Freedom::NotBoth, Freedom::Both]);
        assert_eq!(f(7, three), [Freedom::Any, Freedom::Unknown]);
        // A write outside of an array may change any element. A division by zero is defined.
        let g = |i: u32, n: u32| freedom("g", [i, n], Scalar::I32, [[0, 0], [7, 0]]);
        assert_eq!(g(1, 0), [Freedom::Both, Freedom::NotBoth]);
        assert_eq!(g(9, 0), [Freedom::Any, Freedom::Unknown]);
    }

    /// An atomic operation outside of its array may change another element, or none.
    // Lesson 163
    #[test]
    fn an_atomic_out_of_bounds_has_open_results() {
        let text = "@group(0) @binding(0) var<storage, read_write> b: array<atomic<u32>, 4>;
                    fn f(i: u32) -> u32 { return atomicAdd(&b[i], 1u); }";
        let package = Package::from_source("p", text);
        let probed = Probed::new(&package, "f").expect("the function can be called");
        let held = karat::fixture::Storage::new([7_u32, 8, 9, 10]);
        let fixtures = vec![("b".to_owned(), held.into())];
        let leeway = Leeway::of(&probed, &fixtures);
        for (i, result, freedom) in [(1_u32, 8_u32, Freedom::Unknown), (5, 10, Freedom::Any)] {
            let latitude = leeway.at(&[i], 1).expect("the open lanes are known");
            let case = latitude.case(0, 5);
            assert_eq!(
                case.freedom(0, Scalar::U32, [result, 0]),
                freedom,
                "the result for index {i}"
            );
            assert_eq!(
                case.freedom(4, Scalar::U32, [10, 11]),
                freedom,
                "an element that index {i} may change"
            );
            assert_eq!(
                case.freedom(1, Scalar::U32, [7, 8]),
                Freedom::Unknown,
                "an element that index {i} doesn't change"
            );
        }
    }

    // Lesson 155
    #[test]
    fn nan_is_open() {
        let package = Package::from_source("p", "fn f(x: f32) -> f32 { return sqrt(x) / x; }");
        let probed = Probed::new(&package, "f").expect("the function can be called");
        let leeway = Leeway::of(&probed, &Fixtures::new());
        for (x, open) in [(-1.0_f32, true), (0.0, true), (4.0, false)] {
            let latitude = leeway.at(&[x.to_bits()], 1).expect("the open lanes are known");
            let half = 0.5_f32.to_bits();
            let seen = latitude.case(0, 1).freedom(0, Scalar::F32, [half, half]);
            assert_eq!(seen == Freedom::Any, open, "{x}");
        }
    }
}
