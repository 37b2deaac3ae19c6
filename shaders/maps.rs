//! Rust counterpart of `maps.wgsl`: the settings of frames that are drawn to make textures, and the conversion of a
//! frame to a cube map.

use glam::{DVec2, DVec3, UVec2};
use karat::Image;

use crate::environment;

/// The number of cube map faces side by side in a frame: +X, -X, +Y, and below them -Y, +Z, -Z.
pub const ACROSS: u32 = 3;
/// The number of rows of faces in a frame.
pub const DOWN: u32 = 2;

karat::shareable! {
    /// The settings of a frame that becomes a map.
    pub struct MapSettings mirrors MapSettingsMirror {
        /// The width in texels of a face, or of the table that `specular::split_sum_table` fills.
        side: u32,
        /// The number of directions for each texel.
        samples: u32,
        /// The GGX width of a prefiltered mip level.
        alpha: f32,
    }
}

/// Returns the direction through the texel at `pixel`. The vector isn't normalised.
#[must_use]
pub fn texel_direction(side: u32, pixel: UVec2) -> DVec3 {
    let face = pixel.y / side * ACROSS + pixel.x / side;
    let centre = |texel: u32| (f64::from(texel % side) + 0.5) / f64::from(side);
    let uv = DVec2::new(centre(pixel.x), centre(pixel.y));
    environment::face_direction(face as usize, uv.x, uv.y)
}

/// Cuts a frame of three by two faces into six faces, each `side` texels wide and high.
///
/// # Panics
///
/// Panics if the frame isn't `3 side` wide and `2 side` high.
#[must_use]
pub fn faces(frame: &Image, side: u32) -> [Image; 6] {
    assert_eq!([frame.width(), frame.height()], [ACROSS * side, DOWN * side], "three by two faces");
    std::array::from_fn(|face| {
        let (left, top) = (face % ACROSS as usize, face / ACROSS as usize);
        let side = side as usize;
        let rows = (0..side).map(|row| (top * side + row) * ACROSS as usize * side + left * side);
        let pixels = rows.flat_map(|first| frame.pixels()[first..first + side].to_vec()).collect();
        Image::new(side as u32, side as u32, pixels)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_are_cut_where_their_texels_were_drawn() {
        let side = 4;
        let pixels = (0..DOWN * side)
            .flat_map(|y| (0..ACROSS * side).map(move |x| texel_direction(side, UVec2::new(x, y))))
            .map(|direction| direction.as_vec3().extend(1.0).to_array())
            .collect();
        let faces = faces(&Image::new(ACROSS * side, DOWN * side, pixels), side);
        for (index, face) in faces.iter().enumerate() {
            let expected = environment::face_direction(index, 0.375, 0.125).as_vec3();
            assert_eq!(face.pixels()[1][..3], expected.to_array(), "face {index}");
        }
    }
}
