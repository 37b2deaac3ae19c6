//! Meshes: triangles with vertex attributes.

use crate::value::{Scalar, Shareable};

const POSITION: usize = 3;

/// Triangles with attributes of their vertices. The positions are at `@location(0)` as `vec3<f32>`.
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
    /// The attributes. The first one has the positions, at location 0.
    pub(super) attributes: Vec<Column>,
}

#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub(super) struct Column {
    pub(super) location: u32,
    pub(super) scalar: Scalar,
    /// The number of scalars in a value: 1 to 4.
    pub(super) width: usize,
    pub(super) words: Vec<u32>,
    /// `true` if each value belongs to a copy of the mesh, `false` if each value belongs to a vertex.
    pub(super) by_instance: bool,
}

impl Mesh {
    /// Makes a mesh of triangles. Seen from outside, the corners of a triangle are in counter-clockwise order. By
    /// default, a draw culls triangles with corners in clockwise order.
    ///
    /// ```
    /// use glam::Vec3;
    /// use karat::draw::Mesh;
    ///
    /// let triangle = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![0, 1, 2]);
    /// # let _ = triangle;
    /// ```
    ///
    /// A position may be any vector of three floats that can be a function's argument: a vector of glam or mint,
    /// `[f32; 3]`, or a type of your own ([`vector!`](crate::vector)).
    ///
    /// # Panics
    /// Panics if an index has no position, if the number of indices isn't a multiple of three, or if a position doesn't
    /// consist of three floats.
    #[must_use]
    pub fn new<P: Shareable>(positions: Vec<P>, indices: Vec<u32>) -> Self {
        assert_eq!(indices.len() % 3, 0, "the number of indices must be a multiple of three");
        let highest = indices.iter().max().copied().unwrap_or(0);
        assert!(
            (highest as usize) < positions.len(),
            "index {highest} is outside of the mesh's positions"
        );
        let column = Column::new(0, &positions, false);
        let is_position = (column.scalar, column.width) == (Scalar::F32, POSITION);
        assert!(
            is_position,
            "a position must be three floats, but the given type is {}",
            P::shape()
        );
        Self { indices, attributes: vec![column] }
    }

    /// Adds a value for each vertex, such as a normal, texture coordinates or a colour. The vertex function reads the
    /// value at `@location(location)`.
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
    /// Panics if the number of values differs from the number of positions, if another attribute uses the location, or
    /// if a value doesn't consist of one to four floats or integers.
    #[must_use]
    pub fn attribute<T: Shareable>(self, location: u32, values: &[T]) -> Self {
        let vertices = self.vertices();
        assert_eq!(
            values.len(),
            vertices,
            "an attribute needs one value for each of the mesh's {vertices} vertices"
        );
        self.column(Column::new(location, values, false))
    }

    /// Adds a value for each copy of the mesh, such as a column of the copy's transformation, or the copy's colour.
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
    /// Panics if `values` is empty, if another attribute uses the location, or if a value doesn't consist of one to
    /// four floats or integers.
    #[must_use]
    pub fn instance_attribute<T: Shareable>(self, location: u32, values: &[T]) -> Self {
        assert!(!values.is_empty(), "the attribute at location {location} has no values");
        self.column(Column::new(location, values, true))
    }

    fn column(mut self, column: Column) -> Self {
        let location = column.location;
        let taken = self.attributes.iter().any(|column| column.location == location);
        assert!(!taken, "another attribute uses location {location}");
        self.attributes.push(column);
        self
    }

    fn vertices(&self) -> usize {
        self.attributes[0].words.len() / POSITION
    }

    /// The largest number of copies for which each per-copy attribute has enough values. `None` if the mesh has no
    /// per-copy attribute.
    pub(super) fn most_instances(&self) -> Option<usize> {
        let columns = self.attributes.iter().filter(|column| column.by_instance);
        columns.map(|column| column.words.len() / column.width).min()
    }
}

impl Column {
    fn new<T: Shareable>(location: u32, values: &[T], by_instance: bool) -> Self {
        let (scalar, width) = T::shape().components().unwrap_or_else(|| {
            panic!(
                "an attribute must be one to four floats or integers, but the given type is {}",
                T::shape()
            )
        });
        let mut words = Vec::with_capacity(values.len() * width);
        values.iter().for_each(|value| value.store(&mut words));
        Self { location, scalar, width, words, by_instance }
    }

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
    use glam::{Vec2, Vec3};

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
    #[should_panic(expected = "an attribute needs one value for each of the mesh's 3 vertices")]
    fn each_vertex_has_a_value() {
        let _ = triangle().attribute(1, &[Vec3::X; 2]);
    }

    /// A mesh's attributes can have the same vector types as a function's arguments.
    #[test]
    fn vectors_of_any_kind_are_attributes() {
        let mesh = Mesh::new(vec![[0.0_f32; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![0, 1, 2]);
        let mesh = mesh.attribute(1, &[[1_u32, 2]; 3]).attribute(2, &[0.5_f32; 3]);
        let columns = mesh.attributes.iter().map(|c| (c.scalar, c.width)).collect::<Vec<_>>();
        assert_eq!(columns, [(Scalar::F32, 3), (Scalar::U32, 2), (Scalar::F32, 1)]);
        assert_eq!(mesh.attributes[1].words, [1, 2, 1, 2, 1, 2]);
    }

    #[test]
    #[should_panic(
        expected = "an attribute must be one to four floats or integers, but the given type is mat4x4<f32>"
    )]
    fn a_matrix_is_no_attribute() {
        let _ = triangle().attribute(1, &[glam::Mat4::IDENTITY; 3]);
    }

    #[test]
    #[should_panic(expected = "a position must be three floats, but the given type is vec2<f32>")]
    fn positions_have_three_floats() {
        let _ = Mesh::new(vec![Vec2::X; 3], vec![0, 1, 2]);
    }

    #[test]
    #[should_panic(expected = "another attribute uses location 0")]
    fn an_attribute_at_location_zero_panics() {
        let _ = triangle().attribute(0, &[Vec3::X; 3]);
    }
}
