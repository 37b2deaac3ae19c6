//! Domains: the sets from which Karat samples the arguments of functions.
//!
//! A domain is closed: it includes its ends. Karat samples edges (ends, their neighbours, points at a logarithmic
//! distance from the ends, poles, axes) more often than other values. A domain is seeded: the value of case *i* depends
//! only on the seed and on *i*, so any case can be sampled again without the cases before it. A finite domain
//! ([`Just`], [`Grid`], [`OneOf`] and products of them) is enumerated completely.
//!
//! In one of eight sampled tuples, two components of the same type are tied: one component becomes equal or opposite to
//! the other component, or close to the equal or the opposite value. Functions of two directions often fail for tied
//! directions.
//!
//! Karat replaces a failing case by simpler values of the same domain. See [`Domain::shrink`].

mod composed;
mod direction;
mod dynamic;
mod edges;
mod emptiness;
mod grid;
mod perpendicular;
mod plausible;
mod product;
mod range;
mod shrink;
mod source;
mod sphere;
mod stream;
mod ties;
mod transform;
mod words;

use std::any::Any;
use std::fmt::Debug;

pub use composed::Composed;
pub use direction::{Above, Hemisphere, UnitRgb, UnitVector};
pub use dynamic::{Dynamic, Part};
pub use edges::{AnyF32, Edges};
pub use emptiness::Emptiness;
use emptiness::infinite;
pub use grid::Grid;
#[doc(hidden)]
pub use product::Parts;
pub use range::Integers;
pub use shrink::{Origin, Shrinkable};
pub use source::Source;
pub use sphere::Sphere;
#[doc(hidden)]
pub use stream::{Held, Numbering, Stream, Typed};

use crate::value::{Arguments, Shareable};

/// The number of consecutive samples that a [`filter`](Domain::filter) may reject before the check gives up. A filter
/// that accepts 1 % of the samples fails by chance in one of 5e8 cases.
const REJECTIONS: u32 = 2000;

/// The largest number of simpler grid points that Karat tries in place of a failing grid point.
const SIMPLER: usize = 256;

/// A set of values to sample from.
///
/// ```
/// use karat::{Domain, Integers};
///
/// // A tuple is a domain of tuples; `map` and `filter` make other domains.
/// let odd = (0.0..=1.0_f32, Integers(0..=9_u32)).filter(|&(_, n)| n % 2 == 1);
/// let power = odd.map(|(x, n)| x.powi(n as i32));
/// let drawn = power.draw(&mut karat::unstable::domain::Source::new(1, 0)).unwrap();
/// assert!((0.0..=1.0).contains(&drawn));
/// ```
///
/// ```
/// use karat::unstable::domain::Source;
/// use karat::Domain;
///
/// /// Directions of a narrow beam about z.
/// #[derive(Debug)]
/// struct Beam;
///
/// impl Domain for Beam {
///     type Value = glam::Vec3;
///
///     fn draw(&self, source: &mut Source) -> Option<glam::Vec3> {
///         let (slope, turn) = (0.1 * source.unit() as f32, std::f32::consts::TAU * source.unit() as f32);
///         Some(glam::Vec3::new(slope * turn.cos(), slope * turn.sin(), 1.0).normalize())
///     }
/// }
///
/// assert!(Beam.draw(&mut Source::new(7, 0)).expect("always one").z > 0.99);
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a domain",
    label = "expected a domain of WGSL values",
    note = "use a closed range such as `0.0..=1.0` (not `0.0..1.0`), `Integers(0..=7_u32)`, \
            `UnitVector`, `Hemisphere`, `UnitRgb`, `Just(x)`, `Grid`, `OneOf`, `Edges`, `AnyF32`, \
            or a tuple of up to twelve of them"
)]
pub trait Domain: Send + Sync {
    /// The type of the values.
    type Value: Clone + Debug + Send + Sync + 'static;

    /// Samples a value. `None` if a filter rejected too many consecutive values.
    fn draw(&self, source: &mut Source) -> Option<Self::Value>;

    /// Values that are always tried first. The simplest and most extreme values come first.
    fn edges(&self) -> Vec<Self::Value> {
        Vec::new()
    }

    /// Checks if the domain has no value: for example, a range that ends before it starts. The function doesn't detect
    /// a filter that rejects everything.
    fn is_empty(&self) -> bool {
        self.emptiness().is_some()
    }

    /// The reason why the domain has no value, for the check's message. `None` if the domain has values.
    fn emptiness(&self) -> Option<Emptiness> {
        (self.size() == Some(0)).then(|| Emptiness::of("domain", "has no value"))
    }

    /// The number of values in a finite domain.
    fn size(&self) -> Option<u64> {
        None
    }

    /// The value at `index` in a finite domain. `None` past the domain's end, or if the domain isn't finite.
    fn nth(&self, index: u64) -> Option<Self::Value> {
        let _ = index;
        None
    }

    /// Returns `Some(true)` if `value` belongs to the domain, and `Some(false)` if not. `None` if the domain can't
    /// decide, as after `map`.
    fn admits(&self, value: &Self::Value) -> Option<bool> {
        let _ = value;
        None
    }

    /// Two values that bound the domain: each component of every value lies between the corresponding components of
    /// these two values. `None` if the domain has no such bounds. `stays_within` proves its claim for everything
    /// between the bounds. The bounds may be wider than the domain. But if a value of the domain were outside of the
    /// bounds, the proof would be false.
    ///
    /// ```
    /// use karat::{Domain, UnitRgb};
    /// use glam::Vec3;
    ///
    /// assert_eq!((UnitRgb, 0.5..=2.0).ends(), Some(((Vec3::ZERO, 0.5), (Vec3::ONE, 2.0))));
    /// ```
    #[doc(hidden)]
    fn ends(&self) -> Option<(Self::Value, Self::Value)> {
        None
    }

    /// Values of the domain that are simpler than `value`, the simplest first. Karat replaces a failing case by the
    /// first of these values that fails, and repeats this until none fails. The default is an empty list.
    fn shrink(&self, value: &Self::Value) -> Vec<Self::Value> {
        let _ = value;
        Vec::new()
    }

    /// A case from [`nth`](Self::nth), [`edges`](Self::edges) or [`draw`](Self::draw), with the data that Karat needs
    /// to simplify the case. Domains that are made of other domains override this method. All other domains need only
    /// [`shrink`](Self::shrink).
    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, Self::Value>> {
        let value = match origin {
            Origin::Nth(index) => self.nth(index),
            Origin::Edge(index) => self.edges().into_iter().nth(index),
            Origin::Draw(source) => self.draw(source),
        };
        Some(Shrinkable::of(self, value?))
    }

    /// Applies `map` to each value.
    fn map<T, F>(self, map: F) -> Map<Self, F>
    where
        Self: Sized,
        T: Clone + Debug + Send + Sync + 'static,
        F: Fn(Self::Value) -> T + Send + Sync,
    {
        Map { domain: self, map }
    }

    /// Converts the values to another type of the same shape, such as a vector of another glam version, or of mint.
    ///
    /// ```
    /// use glam::Vec3;
    /// use karat::prelude::*;
    ///
    /// // In an engine on glam 0.29, with karat's feature `glam-029`: `cast::<engine::Vec3>()`.
    /// let normals = UnitVector.cast::<Vec3>();
    /// # let _ = normals;
    /// ```
    ///
    /// # Panics
    /// Panics if the types have different shapes.
    #[track_caller]
    fn cast<T: Shareable>(self) -> Map<Self, fn(Self::Value) -> T>
    where
        Self: Sized,
        Self::Value: Shareable,
    {
        let (own, other) = (Self::Value::shape(), T::shape());
        assert!(own == other, "`cast` can't turn `{own}` into `{other}`: the WGSL types differ");
        self.map(|value| {
            let mut lanes = Vec::new();
            value.store(&mut lanes);
            T::load(&mut lanes.iter())
        })
    }

    /// Makes values of a structure or a vector from the domains of its members, in order. Unlike [`map`](Domain::map),
    /// this function keeps the members separate, so Karat can simplify each member, and try equal and opposite members.
    ///
    /// ```
    /// use glam::{Vec2, Vec3};
    /// use karat::prelude::*;
    ///
    /// karat::shareable! {
    ///     struct Material mirrors MaterialMirror { albedo: Vec3, roughness: f32 }
    /// }
    /// let materials = (UnitRgb, 0.1..=1.0).compose::<Material>();
    /// let u = (0.0..=1.0, 0.0..=1.0).compose::<Vec2>();
    /// let package = Package::from_source(
    ///     "s",
    ///     "struct Material { albedo: vec3f, roughness: f32 }
    ///      fn pick(m: Material, u: vec2f) -> f32 { return m.roughness * u.x; }",
    /// );
    /// package.function("pick").over((materials, u)).stays_within(0.0..=1.0);
    /// ```
    ///
    /// If the members have other types or another order, the check fails with an error.
    fn compose<T>(self) -> Composed<Self, T>
    where
        Self: Sized,
        Self::Value: Arguments,
        T: Shareable,
    {
        Composed::new(self)
    }

    /// Keeps the values for which `keep` returns `true`. If a filter rejects almost everything, the check fails with an
    /// error: sample from narrower ranges, or make suitable values with [`map`](Domain::map).
    fn filter<F>(self, keep: F) -> Filter<Self, F>
    where
        Self: Sized,
        F: Fn(&Self::Value) -> bool + Send + Sync,
    {
        Filter { domain: self, keep }
    }
}

impl<D: Domain + ?Sized> Domain for &D {
    type Value = D::Value;
    fn draw(&self, source: &mut Source) -> Option<Self::Value> {
        (**self).draw(source)
    }
    fn edges(&self) -> Vec<Self::Value> {
        (**self).edges()
    }
    fn emptiness(&self) -> Option<Emptiness> {
        (**self).emptiness()
    }
    fn size(&self) -> Option<u64> {
        (**self).size()
    }
    fn nth(&self, index: u64) -> Option<Self::Value> {
        (**self).nth(index)
    }
    fn admits(&self, value: &Self::Value) -> Option<bool> {
        (**self).admits(value)
    }
    fn ends(&self) -> Option<(Self::Value, Self::Value)> {
        (**self).ends()
    }
    fn shrink(&self, value: &Self::Value) -> Vec<Self::Value> {
        (**self).shrink(value)
    }
    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, Self::Value>> {
        (**self).shrinkable(origin)
    }
}

/// A single value.
///
/// ```
/// use karat::{Domain, Just};
///
/// assert_eq!((Just(2.0_f32).size(), Just(2.0_f32).nth(0)), (Some(1), Some(2.0)));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Just<T>(pub T);

impl<T: Clone + Debug + Send + Sync + 'static> Domain for Just<T> {
    type Value = T;
    fn draw(&self, _: &mut Source) -> Option<T> {
        Some(self.0.clone())
    }
    fn edges(&self) -> Vec<T> {
        vec![self.0.clone()]
    }
    fn size(&self) -> Option<u64> {
        Some(1)
    }
    fn nth(&self, index: u64) -> Option<T> {
        (index == 0).then(|| self.0.clone())
    }
    fn ends(&self) -> Option<(T, T)> {
        Some((self.0.clone(), self.0.clone()))
    }
}

/// The listed values. Karat tries each value.
///
/// ```
/// use karat::{Domain, OneOf};
///
/// let widths = OneOf(vec![0.01_f32, 0.5, 1.0]);
/// assert_eq!((widths.size(), widths.nth(1)), (Some(3), Some(0.5)));
/// ```
#[derive(Clone, Debug)]
pub struct OneOf<T>(pub Vec<T>);

impl<T: Clone + Debug + Send + Sync + 'static> Domain for OneOf<T> {
    type Value = T;
    fn draw(&self, source: &mut Source) -> Option<T> {
        self.nth(source.below(self.0.len() as u64))
    }
    fn edges(&self) -> Vec<T> {
        self.0.iter().take(1).chain(self.0.iter().skip(1).next_back()).cloned().collect()
    }
    fn emptiness(&self) -> Option<Emptiness> {
        self.0.is_empty().then(|| Emptiness::of("list", "is empty"))
    }
    fn size(&self) -> Option<u64> {
        Some(self.0.len() as u64)
    }
    fn nth(&self, index: u64) -> Option<T> {
        usize::try_from(index).ok().and_then(|index| self.0.get(index)).cloned()
    }
    /// Simplifies a number or a boolean to more readable values of the list, and any other value to values nearer to
    /// the front of the list.
    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, T>> {
        let index = match origin {
            Origin::Nth(index) => usize::try_from(index).ok()?,
            Origin::Edge(0) => 0,
            Origin::Edge(_) => self.0.len().checked_sub(1)?,
            Origin::Draw(source) => usize::try_from(source.below(self.0.len() as u64)).ok()?,
        };
        self.at(index)
    }
}

impl<T: Clone + Debug + Send + Sync + 'static> OneOf<T> {
    fn at(&self, index: usize) -> Option<Shrinkable<'_, T>> {
        let value = self.0.get(index)?.clone();
        let key = |index: usize| (complexity(&self.0[index]).unwrap_or(index as u64), index);
        Some(Shrinkable::new(value, move || {
            let mut simpler: Vec<_> =
                (0..self.0.len()).filter(|other| key(*other) < key(index)).collect();
            simpler.sort_by_key(|index| key(*index));
            simpler.into_iter().filter_map(|index| self.at(index)).collect()
        }))
    }
}

/// A measure of how hard a number or boolean is to read. `None` for other types.
#[doc(hidden)]
pub fn complexity(value: &dyn Any) -> Option<u64> {
    None.or_else(|| value.downcast_ref::<bool>().map(|value| u64::from(*value)))
        .or_else(|| value.downcast_ref::<f32>().map(|value| shrink::float_complexity(*value)))
        .or_else(|| value.downcast_ref::<u32>().map(|value| 2 * u64::from(*value)))
        .or_else(|| {
            let value = value.downcast_ref::<i32>()?;
            Some(2 * u64::from(value.unsigned_abs()) + u64::from(*value < 0))
        })
}

/// The domain that [`Domain::map`] returns.
///
/// ```
/// use karat::Domain;
///
/// // Artists set the roughness. The function takes the roughness squared.
/// let alpha = (0.05..=1.0).map(|roughness: f32| roughness * roughness);
/// assert!(alpha.edges().iter().all(|alpha| *alpha <= 1.0));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Map<D, F> {
    domain: D,
    map: F,
}

impl<D, F, T> Domain for Map<D, F>
where
    D: Domain,
    T: Clone + Debug + Send + Sync + 'static,
    F: Fn(D::Value) -> T + Send + Sync,
{
    type Value = T;
    fn draw(&self, source: &mut Source) -> Option<T> {
        self.domain.draw(source).map(&self.map)
    }
    fn edges(&self) -> Vec<T> {
        self.domain.edges().into_iter().map(&self.map).collect()
    }
    fn emptiness(&self) -> Option<Emptiness> {
        self.domain.emptiness().map(Emptiness::apart)
    }
    fn size(&self) -> Option<u64> {
        self.domain.size()
    }
    fn nth(&self, index: u64) -> Option<T> {
        self.domain.nth(index).map(&self.map)
    }
    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, T>> {
        Some(self.domain.shrinkable(origin)?.map(&self.map))
    }
}

/// The domain that [`Domain::filter`] returns.
///
/// ```
/// use karat::{Domain, Hemisphere};
///
/// let apart = (Hemisphere, Hemisphere).filter(|(v, l)| (*v + *l).length() > 0.1);
/// # let _ = apart;
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Filter<D, F> {
    domain: D,
    keep: F,
}

impl<D, F> Domain for Filter<D, F>
where
    D: Domain,
    F: Fn(&D::Value) -> bool + Send + Sync,
{
    type Value = D::Value;
    fn draw(&self, source: &mut Source) -> Option<Self::Value> {
        (0..REJECTIONS).find_map(|_| self.domain.draw(source).filter(&self.keep))
    }
    fn edges(&self) -> Vec<Self::Value> {
        self.domain.edges().into_iter().filter(&self.keep).collect()
    }
    fn emptiness(&self) -> Option<Emptiness> {
        self.domain.emptiness()
    }
    fn admits(&self, value: &Self::Value) -> Option<bool> {
        if (self.keep)(value) { self.domain.admits(value) } else { Some(false) }
    }
    fn ends(&self) -> Option<(Self::Value, Self::Value)> {
        self.domain.ends()
    }
    fn shrink(&self, value: &Self::Value) -> Vec<Self::Value> {
        self.domain.shrink(value).into_iter().filter(&self.keep).collect()
    }
    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, Self::Value>> {
        let kept = |shrinkable: &Shrinkable<'_, D::Value>| (self.keep)(shrinkable.value());
        let found = match origin {
            Origin::Nth(_) => None, // a filtered domain isn't enumerated
            Origin::Edge(index) => {
                let edges = self.domain.edges().into_iter().enumerate();
                let mut edges = edges.filter(|(_, edge)| (self.keep)(edge));
                self.domain.shrinkable(Origin::Edge(edges.nth(index)?.0))
            }
            Origin::Draw(source) => (0..REJECTIONS)
                .find_map(|_| self.domain.shrinkable(Origin::Draw(&mut *source)).filter(kept)),
        };
        Some(found?.filter(&self.keep))
    }
}

#[cfg(test)]
mod tests;
