//! Finds the surface at a pixel with a ray instead of a rasteriser, from the frame's own triangles.

use glam::{DMat4, DVec2, DVec3, Vec3};
use shaders::camera::Camera;

/// Copies of one mesh of a sphere, and a camera.
#[derive(Debug)]
pub(crate) struct Scene {
    camera: DMat4,
    eye: DVec3,
    size: (u32, u32),
    /// The triangles of the unit sphere's mesh. The position of each vertex is also its normal.
    triangles: Vec<[DVec3; 3]>,
    centres: Vec<DVec3>,
    radius: f64,
}

/// The point at which a ray hits the nearest triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    pub(crate) instance: u32,
    pub(crate) position: DVec3,
    /// The normal, interpolated between the vertices and not normalised, so that its length is below 1.
    pub(crate) normal: DVec3,
    distance: f64,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub(crate) origin: DVec3,
    /// The direction, of unit length.
    pub(crate) direction: DVec3,
}

impl Scene {
    /// A scene with spheres of `radius` around `centres`, for a frame of `size` pixels.
    pub(crate) fn new(
        camera: Camera,
        size: (u32, u32),
        (positions, indices): (Vec<Vec3>, Vec<u32>),
        centres: Vec<DVec3>,
        radius: f64,
    ) -> Self {
        let corner = |index: u32| positions[index as usize].as_dvec3();
        let triangles =
            indices.chunks_exact(3).map(|corners| [0, 1, 2].map(|i| corner(corners[i]))).collect();
        Self {
            camera: camera.view_projection.as_dmat4(),
            eye: camera.position.as_dvec3(),
            size,
            triangles,
            centres,
            radius,
        }
    }

    /// The ray through the middle of a pixel.
    pub(crate) fn ray(&self, pixel: (u32, u32)) -> Ray {
        self.ray_beside(pixel, DVec2::ZERO)
    }

    /// The ray through a point beside the middle of a pixel. `by` is the offset from the middle, in pixels.
    pub(crate) fn ray_beside(&self, (x, y): (u32, u32), by: DVec2) -> Ray {
        let (width, height) = (f64::from(self.size.0), f64::from(self.size.1));
        let (x, y) = (f64::from(x) + 0.5 + by.x, f64::from(y) + 0.5 + by.y);
        let ndc = DVec2::new(2.0 * x / width - 1.0, 1.0 - 2.0 * y / height);
        let direction = shaders::camera::view_direction(self.camera, ndc).normalize();
        Ray { origin: self.eye, direction }
    }

    /// The pixel that shows a point.
    pub(crate) fn pixel_of(&self, point: DVec3) -> (u32, u32) {
        let ndc = self.camera.project_point3(point);
        let (width, height) = (f64::from(self.size.0), f64::from(self.size.1));
        ((0.5 * (ndc.x + 1.0) * width) as u32, (0.5 * (1.0 - ndc.y) * height) as u32)
    }

    /// The nearest point at which the ray hits the front of a triangle.
    pub(crate) fn trace(&self, ray: Ray) -> Option<Hit> {
        let mut nearest: Option<Hit> = None;
        for (instance, centre) in (0..).zip(&self.centres) {
            let from_centre = (ray.origin - centre) / self.radius;
            if from_centre.cross(ray.direction).length_squared() > 1.0 {
                continue;
            }
            for corners in &self.triangles {
                let Some((distance, normal)) = intersect(from_centre, ray.direction, corners)
                else {
                    continue;
                };
                let distance = distance * self.radius;
                if nearest.is_none_or(|hit| distance < hit.distance) {
                    let position = ray.origin + distance * ray.direction;
                    nearest = Some(Hit { instance, position, normal, distance });
                }
            }
        }
        nearest
    }
}

/// The distance along the ray to a triangle, and the point of the hit. Moeller and Trumbore 1997.
fn intersect(origin: DVec3, direction: DVec3, [a, b, c]: &[DVec3; 3]) -> Option<(f64, DVec3)> {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(ac);
    let determinant = ab.dot(p);
    // The determinant is positive if the vertices are counter-clockwise. Other triangles are culled.
    if determinant <= 0.0 {
        return None;
    }
    let from_a = origin - a;
    let u = from_a.dot(p) / determinant;
    let q = from_a.cross(ab);
    let v = direction.dot(q) / determinant;
    let distance = ac.dot(q) / determinant;
    let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
    (inside && distance > 0.0).then(|| (distance, a + u * ab + v * ac))
}
