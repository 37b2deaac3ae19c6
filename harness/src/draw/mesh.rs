//! Meshes: triangles, with attributes of their vertices.

use glam::{Vec2, Vec3, Vec4};

/// Triangles, with their corners' positions at `@location(0)` as `vec3<f32>`.
#[derive(Clone, Debug)]
pub struct Mesh {
    pub(super) indices: Vec<u32>,
    /// The first one is the positions, at location 0.
    pub(super) attributes: Vec<Column>,
}

/// The values of one attribute.
#[derive(Clone, Debug)]
pub(super) struct Column {
    pub(super) location: u32,
    /// Scalars of a value: 1 to 4.
    pub(super) width: usize,
    pub(super) scalars: Vec<f32>,
}

/// A type of vertex attributes: `f32` and glam's vectors of it.
pub trait Attribute: Copy {
    /// Number of scalars, 1 to 4.
    const WIDTH: usize;

    /// Appends the scalars.
    fn store(self, scalars: &mut Vec<f32>);
}

macro_rules! attribute {
    ($($name:ty: $width:literal),*) => {$(
        impl Attribute for $name {
            const WIDTH: usize = $width;

            fn store(self, scalars: &mut Vec<f32>) {
                scalars.extend_from_slice(&self.to_array());
            }
        }
    )*};
}

attribute!(Vec2: 2, Vec3: 3, Vec4: 4);

impl Attribute for f32 {
    const WIDTH: usize = 1;

    fn store(self, scalars: &mut Vec<f32>) {
        scalars.push(self);
    }
}

impl Mesh {
    /// A mesh of triangles that are counter-clockwise seen from outside. Back faces are culled.
    ///
    /// # Panics
    /// If an index has no position, or the indices aren't whole triangles.
    #[must_use]
    pub fn new(positions: Vec<Vec3>, indices: Vec<u32>) -> Self {
        assert_eq!(indices.len() % 3, 0, "a triangle has three indices");
        let highest = indices.iter().max().copied().unwrap_or(0);
        assert!((highest as usize) < positions.len(), "index {highest} has no position");
        Self { indices, attributes: vec![Column::new(0, &positions)] }
    }

    /// Adds a value for each vertex, which the vertex function reads at `@location(location)`:
    /// normals, texture coordinates, colours.
    ///
    /// # Panics
    /// If there are more or fewer values than positions, or the location is taken.
    #[must_use]
    pub fn attribute<T: Attribute>(mut self, location: u32, values: &[T]) -> Self {
        let vertices = self.attributes[0].scalars.len() / Vec3::WIDTH;
        assert_eq!(values.len(), vertices, "a mesh of {vertices} vertices has as many values");
        let taken = self.attributes.iter().any(|column| column.location == location);
        assert!(!taken, "location {location} is taken");
        self.attributes.push(Column::new(location, values));
        self
    }
}

impl Column {
    fn new<T: Attribute>(location: u32, values: &[T]) -> Self {
        let mut scalars = Vec::with_capacity(values.len() * T::WIDTH);
        values.iter().for_each(|value| value.store(&mut scalars));
        Self { location, width: T::WIDTH, scalars }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle() -> Mesh {
        Mesh::new(vec![Vec3::X, Vec3::Y, Vec3::Z], vec![0, 1, 2])
    }

    #[test]
    fn attributes_follow_the_positions() {
        let mesh = triangle().attribute(2, &[Vec2::ONE; 3]).attribute(1, &[0.5_f32; 3]);
        let widths: Vec<_> = mesh.attributes.iter().map(|c| (c.location, c.width)).collect();
        assert_eq!(widths, [(0, 3), (2, 2), (1, 1)]);
        assert_eq!(mesh.attributes[1].scalars, [1.0; 6]);
    }

    #[test]
    #[should_panic(expected = "a mesh of 3 vertices has as many values")]
    fn each_vertex_has_a_value() {
        let _ = triangle().attribute(1, &[Vec3::X; 2]);
    }

    #[test]
    #[should_panic(expected = "location 0 is taken")]
    fn positions_stay_in_their_place() {
        let _ = triangle().attribute(0, &[Vec3::X; 3]);
    }
}
