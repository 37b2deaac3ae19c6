//! Edge cases: values such as 0 and the largest float, which code often treats specially.

use super::{Domain, Origin, Shrinkable, Source, shrink};

/// All named edge cases of a type: zeros of both signs, ones, denormals, powers of two and their neighbours, and the
/// largest value. The domain is finite. In a tuple with infinite domains, each edge occurs in at least one case, and
/// the first edges are combined with the first edges of the other domains.
///
/// ```
/// use karat::{Domain, Edges};
///
/// assert!(Edges::u32().edges().contains(&u32::MAX));
/// assert!(Edges::f32().without_denormals().edges().iter().all(|x| !x.is_subnormal()));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Edges<T>(Vec<T>);

/// The exponents of those powers of two that shaders often use as scales and thresholds.
const POWERS: [i32; 15] = [-126, -64, -24, -23, -16, -12, -2, -1, 0, 1, 2, 12, 23, 24, 64];

impl Edges<f32> {
    /// The finite edge cases of `f32`. WGSL lets implementations flush denormals to zero, so a function may return the
    /// same result for a denormal as for zero.
    ///
    /// ```
    /// use karat::{Domain, Edges};
    ///
    /// let edges = Edges::f32();
    /// assert!(edges.edges().contains(&f32::MAX));
    /// ```
    #[must_use]
    pub fn f32() -> Self {
        let mut positive = vec![0.0, 1.0, 0.5, 2.0];
        let smallest = f32::from_bits(1);
        let largest_denormal = f32::MIN_POSITIVE.next_down();
        positive.extend([smallest, smallest.next_up(), largest_denormal]);
        for power in POWERS.into_iter().chain([127]) {
            let power = 2.0_f32.powi(power);
            positive.extend([power, power.next_up()]);
            positive.extend((power > f32::MIN_POSITIVE).then(|| power.next_down()));
        }
        positive.push(f32::MAX);
        let mut values = Vec::new();
        for value in positive.into_iter().flat_map(|value: f32| [value, -value]) {
            if values.iter().all(|known: &f32| known.to_bits() != value.to_bits()) {
                values.push(value);
            }
        }
        Self(values)
    }

    /// Adds both infinities and a quiet NaN, for functions that promise a result for them. Use these values with
    /// `Check::satisfies`, because a reference must return a finite number. WGSL lets implementations assume that
    /// infinities and NaN don't occur, so drivers may differ.
    ///
    /// ```
    /// use karat::{Domain, Edges};
    ///
    /// assert!(Edges::f32().with_non_finite().edges().contains(&f32::INFINITY));
    /// ```
    #[must_use]
    pub fn with_non_finite(mut self) -> Self {
        self.0.extend([f32::INFINITY, f32::NEG_INFINITY, f32::NAN]);
        self
    }

    /// Removes denormals, which drivers may flush to zero.
    ///
    /// ```
    /// use karat::{Domain, Edges};
    ///
    /// let edges = Edges::f32().without_denormals().edges();
    /// assert!(edges.iter().all(|x| !x.is_subnormal()));
    /// ```
    #[must_use]
    pub fn without_denormals(mut self) -> Self {
        self.0.retain(|value| !value.is_subnormal());
        self
    }
}

impl Edges<i32> {
    /// The edge cases of `i32`: 0, 1, -1, powers of two and their neighbours, and the smallest and the largest value.
    ///
    /// ```
    /// use karat::{Domain, Edges};
    ///
    /// assert!(Edges::i32().edges().contains(&i32::MIN));
    /// ```
    #[must_use]
    pub fn i32() -> Self {
        let mut values = vec![0, 1, -1, i32::MIN, i32::MIN + 1, i32::MAX];
        for power in (1..31).map(|shift| 1_i32 << shift) {
            values.extend([power - 1, power, power + 1]);
            values.extend([1 - power, -power, -power - 1]);
        }
        Self(distinct(values))
    }
}

impl Edges<u32> {
    /// The edge cases of `u32`: 0, 1, powers of two and their neighbours, and the largest value.
    ///
    /// ```
    /// use karat::{Domain, Edges};
    ///
    /// assert!(Edges::u32().edges().contains(&u32::MAX));
    /// ```
    #[must_use]
    pub fn u32() -> Self {
        let mut values = vec![0, 1, u32::MAX];
        for power in (1..32).map(|shift| 1_u32 << shift) {
            values.extend([power - 1, power, power + 1]);
        }
        Self(distinct(values))
    }
}

fn distinct<T: PartialEq>(values: Vec<T>) -> Vec<T> {
    let mut found = Vec::new();
    for value in values {
        if !found.contains(&value) {
            found.push(value);
        }
    }
    found
}

macro_rules! edges {
    ($($type:ty, |$v:ident| $complexity:expr, $same:expr;)*) => {$(
        impl Domain for Edges<$type> {
            type Value = $type;
            fn draw(&self, source: &mut Source) -> Option<$type> {
                self.nth(source.below(self.0.len() as u64))
            }
            fn edges(&self) -> Vec<$type> {
                self.0.clone()
            }
            fn size(&self) -> Option<u64> {
                Some(self.0.len() as u64)
            }
            fn nth(&self, index: u64) -> Option<$type> {
                usize::try_from(index).ok().and_then(|index| self.0.get(index)).copied()
            }
            fn admits(&self, value: &$type) -> Option<bool> {
                let same: fn(&$type, &$type) -> bool = $same;
                Some(self.0.iter().any(|own| same(own, value)))
            }
            fn shrink(&self, value: &$type) -> Vec<$type> {
                let complexity = |$v: $type| $complexity;
                let own = complexity(*value);
                let mut simpler = self.0.clone();
                simpler.retain(|value| complexity(*value) < own);
                simpler.sort_by_cached_key(|value| complexity(*value));
                simpler
            }
        }
    )*};
}

edges! {
    f32, |v| shrink::float_complexity(v), |a, b| a.to_bits() == b.to_bits();
    i32, |v| (v.unsigned_abs(), v < 0), |a, b| a == b;
    u32, |v| v, |a, b| a == b;
}

/// All finite `f32`. One sample in four is a named edge case ([`Edges::f32`]). The other samples are uniform over bit
/// patterns, so all binades are equally likely.
///
/// ```
/// use karat::{AnyF32, Domain};
///
/// let x = AnyF32::finite().draw(&mut karat::unstable::domain::Source::new(1, 0)).unwrap();
/// assert!(x.is_finite());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct AnyF32 {
    edges: Edges<f32>,
}

impl AnyF32 {
    /// All finite values.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn keep(x: f32) -> f32 { return x; }");
    /// package.function("keep").over(AnyF32::finite()).is_finite();
    /// ```
    #[must_use]
    pub fn finite() -> Self {
        Self { edges: Edges::f32() }
    }

    /// All values, including infinities and NaN: see [`Edges::with_non_finite`].
    ///
    /// ```
    /// use karat::domain::{AnyF32, Domain};
    ///
    /// assert!(AnyF32::with_non_finite().edges().iter().any(|x| x.is_nan()));
    /// ```
    #[must_use]
    pub fn with_non_finite() -> Self {
        Self { edges: Edges::f32().with_non_finite() }
    }
}

impl Domain for AnyF32 {
    type Value = f32;

    fn draw(&self, source: &mut Source) -> Option<f32> {
        if source.bits() & 3 == 0 {
            return self.edges.draw(source);
        }
        // One random bit pattern in 256 has the largest exponent, and so is an infinity or a NaN.
        let draw = |_| f32::from_bits(source.bits());
        (0..64).map(draw).find(|value| self.admits(value) == Some(true))
    }

    fn edges(&self) -> Vec<f32> {
        self.edges.edges()
    }

    fn admits(&self, value: &f32) -> Option<bool> {
        Some(value.is_finite() || self.edges.0.iter().any(|edge| !edge.is_finite()))
    }

    fn shrink(&self, value: &f32) -> Vec<f32> {
        shrink::floats(*value, &self.edges.0, |value| self.admits(&value) == Some(true))
    }

    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, f32>> {
        let value = match origin {
            Origin::Nth(_) => None,
            Origin::Edge(index) => self.edges.0.get(index).copied(),
            Origin::Draw(source) => self.draw(source),
        };
        Some(Shrinkable::of(self, value?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_named_once() {
        let edges = Edges::f32().0;
        for value in
            [0.0, -0.0, 1.0, -2.0, f32::MAX, f32::MIN, f32::from_bits(1), 1.0_f32.next_up()]
        {
            let count = edges.iter().filter(|edge| edge.to_bits() == value.to_bits()).count();
            assert_eq!(count, 1, "{value:e}");
        }
        assert!(
            edges.contains(&f32::MIN_POSITIVE) && edges.contains(&f32::MIN_POSITIVE.next_down())
        );
        assert!(edges.iter().all(|edge| edge.is_finite()));
        let normal = Edges::f32().without_denormals().0;
        assert!(normal.iter().all(|edge| !edge.is_subnormal()) && normal.contains(&-0.0));
        let more = Edges::f32().with_non_finite().0;
        assert_eq!(more.len(), edges.len() + 3);
        assert_eq!(Edges::u32().admits(&65_537), Some(true));
        assert_eq!(Edges::i32().admits(&i32::MIN), Some(true));
        assert_eq!(Edges::i32().admits(&100), Some(false));
    }

    #[test]
    fn floats_of_each_magnitude_are_drawn() {
        let draws: Vec<f32> =
            (0..20_000).filter_map(|i| AnyF32::finite().draw(&mut Source::new(1, i))).collect();
        assert!(draws.len() == 20_000 && draws.iter().all(|value| value.is_finite()));
        for (low, high) in [(1e-38, 1e-30), (1e-10, 1.0), (1e10, 1e20), (1e30, f32::MAX)] {
            let count = draws.iter().filter(|v| (low..=high).contains(&v.abs())).count();
            assert!(count > 500, "{count} of 20,000 lie in {low:e}..={high:e}");
        }
        let wild: Vec<f32> = (0..20_000)
            .filter_map(|i| AnyF32::with_non_finite().draw(&mut Source::new(1, i)))
            .collect();
        assert!(wild.iter().any(|value| value.is_nan()));
        assert!(wild.contains(&f32::INFINITY) && wild.contains(&f32::NEG_INFINITY));
        assert_eq!(AnyF32::finite().shrink(&1.234e30).first(), Some(&0.0));
        assert!(AnyF32::with_non_finite().shrink(&f32::NAN).contains(&f32::INFINITY));
    }
}
