//! Unconstrained numbers, of which Karat knows only the type.

use std::sync::LazyLock;

use super::{Domain, Edges, Emptiness, Integers, Source, shrink};
use crate::value::Scalar;

/// A domain of unconstrained numbers. Half of the samples are small, like most numbers in shaders.
#[derive(Clone, Debug)]
pub(super) struct Plausible<T>(Vec<T>);

/// The largest unconstrained float: positions in metres and times in milliseconds are rarely larger. Squares of larger
/// numbers lose their digits in sums, and this loss isn't a fault of the shader.
const LARGEST: f32 = 1_048_576.0;

/// The largest unconstrained `f16`. Half precision can represent all integers up to this number.
pub(super) const LARGEST_HALF: f32 = 2048.0;

/// Half of the floats are between minus this number and this number.
const SMALL: f32 = 4.0;

/// Half of the integers have an absolute value below this number.
const FEW: u32 = 16;

pub(super) fn described(scalar: Scalar) -> String {
    match scalar {
        Scalar::F16 => format!("from -{LARGEST_HALF} to {LARGEST_HALF}"),
        Scalar::F32 => {
            format!(
                "from -{LARGEST} to {LARGEST}, with half of the values from -{SMALL} to {SMALL}"
            )
        }
        Scalar::I32 | Scalar::U32 => format!("any integer, with half of the values below {FEW}"),
        Scalar::Bool => "false or true".to_owned(),
    }
}

/// Checks if an unconstrained number is 0, 1, -1 or an end of its range.
pub(super) fn is_plain(scalar: Scalar, word: u32) -> bool {
    match scalar {
        Scalar::F32 => [0.0, 1.0, LARGEST].contains(&f32::from_bits(word).abs()),
        Scalar::F16 => [0.0, 1.0, LARGEST_HALF].contains(&f32::from_bits(word).abs()),
        Scalar::I32 => [0, 1, -1, i32::MAX, i32::MIN].contains(&word.cast_signed()),
        Scalar::U32 => [0, 1, u32::MAX].contains(&word),
        Scalar::Bool => true,
    }
}

/// The integers of `all`, where the integers of `often` occur more often: at least every second sample is one of them.
#[derive(Clone, Debug)]
pub(super) struct Often<T> {
    pub(super) all: Integers<T>,
    pub(super) often: Integers<T>,
}

impl<T> Domain for Often<T>
where
    Integers<T>: Domain<Value = T>,
    T: Clone + std::fmt::Debug + Send + Sync + 'static,
{
    type Value = T;

    fn draw(&self, source: &mut Source) -> Option<T> {
        if source.below(2) == 0 { self.often.draw(source) } else { self.all.draw(source) }
    }

    fn edges(&self) -> Vec<T> {
        self.all.edges()
    }

    fn emptiness(&self) -> Option<Emptiness> {
        self.all.emptiness()
    }

    fn size(&self) -> Option<u64> {
        self.all.size()
    }

    fn nth(&self, index: u64) -> Option<T> {
        self.all.nth(index)
    }

    fn admits(&self, value: &T) -> Option<bool> {
        self.all.admits(value)
    }

    fn ends(&self) -> Option<(T, T)> {
        self.all.ends()
    }

    fn shrink(&self, value: &T) -> Vec<T> {
        self.all.shrink(value)
    }
}

impl Plausible<f32> {
    pub(super) fn floats() -> Self {
        let positive = [1.0, LARGEST, 0.5, 2.0, 1e-3, SMALL, 1000.0];
        let signed = positive.into_iter().flat_map(|x| [x, -x]);
        Self([0.0].into_iter().chain(signed).chain([-0.0]).collect())
    }
}

impl Domain for Plausible<f32> {
    type Value = f32;

    fn draw(&self, source: &mut Source) -> Option<f32> {
        match source.below(8) {
            0..=4 => (-SMALL..=SMALL).draw(source),
            5 => self.0.get(usize::try_from(source.below(self.0.len() as u64)).ok()?).copied(),
            _ => {
                // All binades from 2^-24 to a million are equally likely. 2^-24 is the size of the last digit of 1.
                let size = (44.0 * source.unit() - 24.0).exp2();
                #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
                let size = size as f32;
                Some(if source.bits() & 1 == 0 { size } else { -size })
            }
        }
    }

    fn edges(&self) -> Vec<f32> {
        self.0.clone()
    }

    fn admits(&self, value: &f32) -> Option<bool> {
        Some(value.abs() <= LARGEST)
    }

    fn ends(&self) -> Option<(f32, f32)> {
        Some((-LARGEST, LARGEST))
    }

    fn shrink(&self, value: &f32) -> Vec<f32> {
        shrink::floats(*value, &self.0, |value| value.abs() <= LARGEST)
    }
}

macro_rules! integer {
    ($integer:ty, $constructor:ident, $edges:expr, $small:expr, |$source:ident| $any:expr) => {
        impl Plausible<$integer> {
            pub(super) fn $constructor() -> Self {
                Self($edges)
            }
        }

        impl Domain for Plausible<$integer> {
            type Value = $integer;

            fn draw(&self, $source: &mut Source) -> Option<$integer> {
                // The limit is a million because buffers have millions of elements.
                static ENDS: LazyLock<Edges<$integer>> =
                    LazyLock::new(Edges::<$integer>::$constructor);
                match $source.below(8) {
                    0..=3 => Integers($small).draw($source),
                    4..=5 => ENDS.draw($source),
                    _ => Some($any),
                }
            }

            fn edges(&self) -> Vec<$integer> {
                self.0.clone()
            }

            fn admits(&self, _: &$integer) -> Option<bool> {
                Some(true)
            }

            fn ends(&self) -> Option<($integer, $integer)> {
                Some((<$integer>::MIN, <$integer>::MAX))
            }

            fn shrink(&self, value: &$integer) -> Vec<$integer> {
                Integers(<$integer>::MIN..=<$integer>::MAX).shrink(value)
            }
        }
    };
}

#[expect(clippy::cast_possible_wrap, reason = "16")]
const SIGNED: i32 = FEW as i32;

integer!(
    u32,
    u32,
    vec![0, 1, u32::MAX, 2, 3, FEW - 1, FEW, 255, 65_535, 1 << 31, u32::MAX - 1],
    0..=FEW - 1,
    |source| source.bits()
);
integer!(
    i32,
    i32,
    vec![0, 1, -1, i32::MAX, i32::MIN, 2, -2, SIGNED - 1, 255, 65_535, i32::MAX - 1],
    1 - SIGNED..=SIGNED - 1,
    |source| source.bits().cast_signed()
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plausible_numbers_have_each_magnitude_and_half_are_small() {
        let floats = Plausible::floats();
        let draw = |case| floats.draw(&mut Source::new(3, case)).expect("a number");
        let drawn: Vec<f32> = (0..4000).map(draw).collect();
        assert!(drawn.iter().all(|x| floats.admits(x) == Some(true)));
        assert!(drawn.iter().filter(|x| x.abs() <= SMALL).count() >= 2000);
        for (least, most) in [(6e-8, 1e-6), (1e-6, 1e-4), (10.0, 1e3), (1e3, 1e6)] {
            let count = drawn.iter().filter(|x| (least..most).contains(&x.abs())).count();
            assert!(count > 40, "{count} of 4000 have a size from {least} to {most}");
        }
        let whole = Plausible::<u32>::u32();
        let draw = |case| whole.draw(&mut Source::new(3, case)).expect("a number");
        let drawn: Vec<u32> = (0..4000).map(draw).collect();
        assert!(drawn.iter().filter(|x| **x < FEW).count() >= 2000);
        assert!(drawn.iter().filter(|x| **x > 1 << 24).count() > 800);
        assert_eq!(whole.shrink(&77_000).first(), Some(&0));
    }
}
