//! Rust counterpart of `camera.wgsl`: the camera of a frame.

use glam::dcamera::rh::{proj::directx::perspective, view::look_at_mat4};
use glam::{DMat4, DVec2, DVec3, Mat4, Vec3};

karat::shareable! {
    /// A perspective camera.
    pub struct Camera mirrors CameraMirror {
        /// The matrix from world space to clip space: right-handed, with depth from 0 (near) to 1 (far).
        view_projection: Mat4,
        /// The position in world space.
        position: Vec3,
    }
}

/// A camera's position, target, field of view, and near and far planes. Lengths are in the scene's unit.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    /// The position of the camera.
    pub position: DVec3,
    /// The point at which the camera looks. +Y is up.
    pub target: DVec3,
    /// The vertical field of view in radians.
    pub field_of_view: f64,
    /// The distances of the near and the far plane from the camera.
    pub depth: [f64; 2],
}

impl Setup {
    /// Returns the camera for a frame `aspect` times as wide as high. The matrix is computed in f64 and rounded once.
    #[must_use]
    pub fn camera(self, aspect: f64) -> Camera {
        let [near, far] = self.depth;
        let projection = perspective(self.field_of_view, aspect, near, far);
        let view = look_at_mat4(self.position, self.target, DVec3::Y);
        Camera { view_projection: (projection * view).as_mat4(), position: self.position.as_vec3() }
    }
}

/// Returns the direction in which a camera sees the point `ndc`. The function uses the inverse of the matrix to compute
/// the vector from the near plane to the far plane at this point. The vector isn't normalised.
#[must_use]
pub fn view_direction(view_projection: DMat4, ndc: DVec2) -> DVec3 {
    let inverse = view_projection.inverse();
    inverse.project_point3(ndc.extend(1.0)) - inverse.project_point3(ndc.extend(0.0))
}

/// Returns corner `index` of the triangle that covers the frame. The frame covers [-1, 1] in x and y.
#[must_use]
pub fn covering_corner(index: u32) -> DVec2 {
    [DVec2::NEG_ONE, DVec2::new(3.0, -1.0), DVec2::new(-1.0, 3.0)][index as usize % 3]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setup() -> Setup {
        Setup {
            position: DVec3::new(1.0, 2.0, 30.0),
            target: DVec3::new(0.5, 0.0, 0.0),
            field_of_view: 0.4,
            depth: [20.0, 50.0],
        }
    }

    #[test]
    fn view_directions_reach_what_they_show() {
        let camera = setup().camera(1.5);
        let (eye, matrix) = (camera.position.as_dvec3(), camera.view_projection.as_dmat4());
        for ndc in [DVec2::ZERO, DVec2::new(-0.8, 0.6), DVec2::ONE] {
            let direction = view_direction(matrix, ndc).normalize();
            let seen = matrix.project_point3(eye + 31.0 * direction);
            assert!(seen.truncate().abs_diff_eq(ndc, 1e-5), "{seen} for {ndc}");
        }
        let forward = (setup().target - setup().position).normalize();
        assert!(view_direction(matrix, DVec2::ZERO).normalize().abs_diff_eq(forward, 1e-6));
    }

    #[test]
    fn the_triangle_covers_the_frame() {
        let [a, b, c] = [0, 1, 2].map(covering_corner);
        for corner in [DVec2::ONE, DVec2::NEG_ONE, DVec2::new(1.0, -1.0), DVec2::new(-1.0, 1.0)] {
            let left_of = |from: DVec2, to: DVec2| (to - from).perp_dot(corner - from) >= 0.0;
            assert!(left_of(a, b) && left_of(b, c) && left_of(c, a), "{corner}");
        }
    }
}
