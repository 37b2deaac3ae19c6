//! Meshes: triangles, with attributes of their vertices.

use glam::{IVec2, IVec3, IVec4, UVec2, UVec3, UVec4, Vec2, Vec3, Vec4};

use crate::value::Scalar;

/// Triangles, with their corners' positions at `@location(0)` as `vec3<f32>`.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use karat::draw::Mesh;
///
/// let corners = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
/// let square = Mesh::new(corners, vec![0, 1, 2, 0, 2, 3])
///     .attribute(1, &[Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]); // @location(1) uv: vec2f
/// # let _ = square;
/// ```
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Mesh {
    pub(super) indices: Vec<u32>,
    /// The first one is the positions, at location 0.
    pub(super) attributes: Vec<Column>,
}

/// The values of one attribute.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub(super) struct Column {
    pub(super) location: u32,
    pub(super) scalar: Scalar,
    /// Scalars of a value: 1 to 4.
    pub(super) width: usize,
    pub(super) words: Vec<u32>,
    /// Whether each copy has a value, not each vertex.
    pub(super) by_instance: bool,
}

/// A type of attributes: `f32`, `i32`, `u32` and glam's vectors of them.
///
/// ```
/// use glam::Vec3;
/// use karat::draw::{Attribute, Mesh};
///
/// fn constant<T: Attribute>(mesh: Mesh, location: u32, value: T) -> Mesh {
///     mesh.attribute(location, &[value; 3])
/// }
/// let triangle = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![0, 1, 2]);
/// # let _ =
/// constant(triangle, 1, Vec3::Z);
/// ```
pub trait Attribute: Copy {
    /// The type of its scalars.
    const SCALAR: Scalar;
    /// Number of scalars, 1 to 4.
    const WIDTH: usize;

    /// Appends the bits of the scalars.
    fn store(self, words: &mut Vec<u32>);
}

macro_rules! attribute {
    ($($name:ty: $scalar:ident $width:literal, |$value:ident| $words:expr;)*) => {$(
        impl Attribute for $name {
            const SCALAR: Scalar = Scalar::$scalar;
            const WIDTH: usize = $width;

            fn store(self, words: &mut Vec<u32>) {
                let $value = self;
                words.extend($words);
            }
        }
    )*};
}

attribute! {
    f32: F32 1, |x| [x.to_bits()];
    Vec2: F32 2, |v| v.to_array().map(f32::to_bits);
    Vec3: F32 3, |v| v.to_array().map(f32::to_bits);
    Vec4: F32 4, |v| v.to_array().map(f32::to_bits);
    i32: I32 1, |x| [x.cast_unsigned()];
    IVec2: I32 2, |v| v.to_array().map(i32::cast_unsigned);
    IVec3: I32 3, |v| v.to_array().map(i32::cast_unsigned);
    IVec4: I32 4, |v| v.to_array().map(i32::cast_unsigned);
    u32: U32 1, |x| [x];
    UVec2: U32 2, |v| v.to_array();
    UVec3: U32 3, |v| v.to_array();
    UVec4: U32 4, |v| v.to_array();
}

impl Mesh {
    /// A mesh of triangles that are counter-clockwise seen from outside. Back faces are culled.
    ///
    /// ```
    /// use glam::Vec3;
    /// use karat::draw::Mesh;
    ///
    /// let triangle = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![0, 1, 2]);
    /// # let _ = triangle;
    /// ```
    ///
    /// # Panics
    /// If an index has no position, or the indices aren't whole triangles.
    #[must_use]
    pub fn new(positions: Vec<Vec3>, indices: Vec<u32>) -> Self {
        assert_eq!(indices.len() % 3, 0, "a triangle has three indices");
        let highest = indices.iter().max().copied().unwrap_or(0);
        assert!((highest as usize) < positions.len(), "index {highest} has no position");
        Self { indices, attributes: vec![Column::new(0, &positions, false)] }
    }

    /// Adds a value for each vertex, which the vertex function reads at `@location(location)`:
    /// normals, texture coordinates, colours.
    ///
    /// ```
    /// use glam::Vec3;
    /// use karat::draw::Mesh;
    ///
    /// let triangle = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![0, 1, 2]);
    /// let with_normals = triangle.attribute(1, &[Vec3::Z; 3]); // @location(1) normal: vec3f
    /// # let _ = with_normals;
    /// ```
    ///
    /// # Panics
    /// If there are more or fewer values than positions, or the location is taken.
    #[must_use]
    pub fn attribute<T: Attribute>(self, location: u32, values: &[T]) -> Self {
        let vertices = self.vertices();
        assert_eq!(values.len(), vertices, "a mesh of {vertices} vertices has as many values");
        self.column(Column::new(location, values, false))
    }

    /// Adds a value for each copy that is drawn: its transformation's columns, its colour.
    ///
    /// ```
    /// use glam::{Vec3, Vec4};
    /// use karat::draw::{Draw, Mesh};
    ///
    /// let triangle = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![0, 1, 2]);
    /// // @location(1) color: vec4f
    /// let coloured = triangle.instance_attribute(1, &[Vec4::ONE, Vec4::new(1.0, 0.0, 0.0, 1.0)]);
    /// let two = Draw::mesh("vertex", "fragment", coloured).instances(2);
    /// # let _ = two;
    /// ```
    ///
    /// # Panics
    /// If there is no value, or the location is taken.
    #[must_use]
    pub fn instance_attribute<T: Attribute>(self, location: u32, values: &[T]) -> Self {
        assert!(!values.is_empty(), "location {location} has no value");
        self.column(Column::new(location, values, true))
    }

    fn column(mut self, column: Column) -> Self {
        let location = column.location;
        let taken = self.attributes.iter().any(|column| column.location == location);
        assert!(!taken, "location {location} is taken");
        self.attributes.push(column);
        self
    }

    fn vertices(&self) -> usize {
        self.attributes[0].words.len() / Vec3::WIDTH
    }

    /// The copies for which each attribute has a value; `None`: any number of them.
    pub(super) fn most_instances(&self) -> Option<usize> {
        let columns = self.attributes.iter().filter(|column| column.by_instance);
        columns.map(|column| column.words.len() / column.width).min()
    }
}

impl Column {
    fn new<T: Attribute>(location: u32, values: &[T], by_instance: bool) -> Self {
        let mut words = Vec::with_capacity(values.len() * T::WIDTH);
        values.iter().for_each(|value| value.store(&mut words));
        Self { location, scalar: T::SCALAR, width: T::WIDTH, words, by_instance }
    }

    /// wgpu's format of a value.
    pub(super) fn format(&self) -> wgpu::VertexFormat {
        use wgpu::VertexFormat as F;
        let formats = match self.scalar {
            Scalar::I32 => [F::Sint32, F::Sint32x2, F::Sint32x3, F::Sint32x4],
            Scalar::U32 => [F::Uint32, F::Uint32x2, F::Uint32x3, F::Uint32x4],
            _ => [F::Float32, F::Float32x2, F::Float32x3, F::Float32x4],
        };
        formats[self.width - 1]
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
        assert_eq!(mesh.attributes[1].words, [1.0_f32.to_bits(); 6]);
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
