//! Values that are made from their members: a structure from a tuple, or a vector from its components.

use std::marker::PhantomData;

use super::{Domain, Emptiness, Origin, Shrinkable, Source};
use crate::value::{Arguments, Scalar, Shape, Shareable};

/// The domain that [`Domain::compose`] returns.
///
/// ```
/// use glam::Vec2;
/// # use karat::prelude::*;
///
/// // The argument is one `vec2f`, not two numbers.
/// let uv = (0.0..=1.0, 0.0..=1.0).compose::<Vec2>();
/// let package = Package::from_source("m", "fn swap(uv: vec2f) -> vec2f { return uv.yx; }");
/// package.function("swap").over(uv).stays_within(0.0..=1.0);
/// ```
#[derive(Debug)]
pub struct Composed<D, T> {
    members: D,
    whole: PhantomData<fn() -> T>,
}

impl<D: Clone, T> Clone for Composed<D, T> {
    fn clone(&self) -> Self {
        Self::new(self.members.clone())
    }
}

impl<D: Copy, T> Copy for Composed<D, T> {}

impl<D, T> Composed<D, T> {
    pub(super) fn new(members: D) -> Self {
        Self { members, whole: PhantomData }
    }
}

fn lanes_of(shapes: &[Shape]) -> Vec<Scalar> {
    shapes.iter().flat_map(Shape::lanes).collect()
}

fn fits<M: Arguments, T: Shareable>() -> bool {
    let (members, whole) = (M::shapes(), T::shape());
    let in_place = match &whole {
        // Members are compared one by one, because the same scalars can be grouped in different ways.
        Shape::Struct { members: own, .. } => {
            own.len() == members.len()
                && own.iter().zip(&members).all(|((_, own), member)| member.stands_for(own, false))
        }
        _ => true,
    };
    in_place && lanes_of(&members) == whole.lanes()
}

fn whole<M: Arguments, T: Shareable>(members: &M) -> T {
    let mut words = Vec::new();
    members.store_all(&mut words);
    T::load(&mut words.iter())
}

fn members<M: Arguments, T: Shareable>(whole: &T) -> M {
    let mut words = Vec::new();
    whole.store(&mut words);
    M::load_all(&mut words.iter())
}

impl<D, T> Domain for Composed<D, T>
where
    D: Domain,
    D::Value: Arguments,
    T: Shareable,
{
    type Value = T;

    fn draw(&self, source: &mut Source) -> Option<T> {
        self.members.draw(source).as_ref().map(whole)
    }

    fn edges(&self) -> Vec<T> {
        self.members.edges().iter().map(whole).collect()
    }

    fn emptiness(&self) -> Option<Emptiness> {
        if !fits::<D::Value, T>() {
            let list = |shapes: &[Shape]| {
                shapes.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
            };
            let given = list(&D::Value::shapes());
            let wanted = match T::shape() {
                Shape::Struct { name, members } => {
                    let own: Vec<Shape> = members.into_iter().map(|(_, shape)| shape).collect();
                    format!("{name} has ({})", list(&own))
                }
                shape => {
                    format!("a {shape} needs {} numbers of its component type", shape.lanes().len())
                }
            };
            return Some(Emptiness::of("composition", &format!("has ({given}), but {wanted}")));
        }
        self.members.emptiness().map(Emptiness::apart)
    }

    fn size(&self) -> Option<u64> {
        self.members.size()
    }

    fn nth(&self, index: u64) -> Option<T> {
        self.members.nth(index).as_ref().map(whole)
    }

    fn admits(&self, value: &T) -> Option<bool> {
        self.members.admits(&members(value))
    }

    fn ends(&self) -> Option<(T, T)> {
        let (least, most) = self.members.ends()?;
        Some((whole(&least), whole(&most)))
    }

    fn shrink(&self, value: &T) -> Vec<T> {
        self.members.shrink(&members(value)).iter().map(whole).collect()
    }

    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, T>> {
        Some(self.members.shrinkable(origin)?.map(&|members: D::Value| whole(&members)))
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};

    use super::*;
    use crate::domain::{Integers, UnitRgb};

    crate::shareable! {
        struct Layer mirrors LayerMirror { albedo: Vec3, roughness: f32, count: u32 }
    }

    #[test]
    fn a_structure_is_made_of_its_members() {
        let domain = (UnitRgb, 0.25..=1.0_f32, Integers(1..=4_u32)).compose::<Layer>();
        assert!(domain.emptiness().is_none());
        for index in 0..1000 {
            let layer: Layer = domain.draw(&mut Source::new(7, index)).expect("it draws");
            assert!((0.25..=1.0).contains(&layer.roughness) && (1..=4).contains(&layer.count));
            assert_eq!(domain.admits(&layer), Some(true));
            let rough = Layer { roughness: 0.1, ..layer };
            assert_eq!(domain.admits(&rough), Some(false), "the members' domains decide");
            assert!(
                domain.shrink(&layer).iter().all(|simpler| domain.admits(simpler) == Some(true))
            );
        }
    }

    #[test]
    fn a_vector_is_made_of_numbers_and_of_vectors() {
        let unit = || 0.0..=1.0_f32;
        let square = (unit(), 2.0..=3.0_f32).compose::<Vec2>();
        let at = square.draw(&mut Source::new(1, 1)).expect("it draws");
        assert!((0.0..=1.0).contains(&at.x) && (2.0..=3.0).contains(&at.y));
        assert!(
            ((unit(), unit()).compose::<Vec2>(), unit()).compose::<Vec3>().emptiness().is_none()
        );
    }

    #[test]
    fn members_that_do_not_fit_are_errors() {
        let unit = || 0.0..=1.0_f32;
        let told = |emptiness: Option<Emptiness>| emptiness.expect("it doesn't fit").fault;
        assert_eq!(
            told((unit(), unit()).compose::<Vec3>().emptiness()),
            "has (f32, f32), but a vec3<f32> needs 3 numbers of its component type"
        );
        let swapped = (0.0..=1.0_f32, UnitRgb, Integers(1..=4_u32)).compose::<Layer>();
        assert_eq!(
            told(swapped.emptiness()),
            "has (f32, vec3<f32>, u32), but Layer has (vec3<f32>, f32, u32)"
        );
    }
}
