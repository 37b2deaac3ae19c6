//! Computes the fragment functions of `scene.wgsl` in `f64`, and estimates the incoming light in several ways.

use glam::{DVec2, DVec3};
use karat::{CubeMap, Texture};
use shaders::scene::{Painted, Samples};
use shaders::{
    compensation, distribution, fresnel, geometry, irradiance, layering, sampling, specular,
};

use super::trace::{Hit, Ray};

/// The surface at the point that a pixel shows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    diffuse: DVec3,
    f0: DVec3,
    alpha: f64,
    mask: f64,
    pub(crate) n: DVec3,
    v: DVec3,
}

impl Surface {
    pub(crate) fn new(painted: Painted, mask: &Texture, hit: Hit, ray: Ray) -> Self {
        let base_color = painted.base_color.as_dvec3();
        let metallic = f64::from(painted.metallic);
        let normal = hit.normal.normalize();
        let v = -ray.direction;
        // Turns the normal towards v if interpolation has turned it away, as `facing_normal` does.
        let missing = 1e-3 - normal.dot(v);
        let n = if missing > 0.0 { (normal + missing * v).normalize() } else { normal };
        let coordinate = DVec2::new(0.5 * (1.0 + normal.x), 0.5 * (1.0 - normal.y));
        Self {
            diffuse: base_color * (1.0 - metallic),
            f0: DVec3::splat(0.04).lerp(base_color, metallic),
            alpha: f64::from(painted.roughness),
            mask: mask.sample(coordinate).x,
            n,
            v,
        }
    }

    pub(crate) fn n_dot_v(&self) -> f64 {
        self.n.dot(self.v)
    }

    /// Reads the scale and the bias of f0 from the table, for the surface's width and view.
    fn entry(&self, table: &Texture) -> DVec2 {
        table.sample(DVec2::new(self.n.dot(self.v), self.alpha)).truncate().truncate()
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Gather<'a> {
    /// Uses the same samples as the shader.
    Same(&'a Samples),
    /// Uses the same samples as the shader, and reads the same mip levels.
    Filtered(&'a Samples),
    /// Samples the shader's densities, but with these points of the unit square.
    Moved { diffuse: &'a [DVec2], specular: &'a [DVec2] },
    /// Samples other densities than the shader, with these points: cosine-weighted directions, and visible normals.
    Independent { points: &'a [DVec2] },
}

/// The light of a scene, and the method of estimating it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Light<'a> {
    pub(crate) map: &'a CubeMap,
    /// `true` if the path filters across the edges of faces.
    pub(crate) seamless: bool,
    pub(crate) gather: Gather<'a>,
}

impl Light<'_> {
    pub(crate) fn radiance(&self, direction: DVec3) -> DVec3 {
        self.level(direction, 0.0)
    }

    fn level(&self, direction: DVec3, level: f64) -> DVec3 {
        look_up(self.map, self.seamless, direction, level)
    }

    /// The irradiance for the normal `n`, divided by pi.
    fn diffuse(&self, n: DVec3) -> DVec3 {
        let radiance = |l: DVec3| self.radiance(l);
        match self.gather {
            Gather::Same(samples) => irradiance::estimate(n, samples.diffuse, radiance),
            Gather::Filtered(samples) => {
                let level = |l: DVec3, level: f64| self.level(l, level);
                irradiance::filtered_estimate(n, samples.diffuse, self.map.size(), level)
            }
            Gather::Moved { diffuse, .. } => {
                let frame = sampling::orthonormal_basis(n);
                mean(diffuse, |u| {
                    let local = sampling::uniform_hemisphere(u);
                    2.0 * local.z * radiance(frame * local)
                })
            }
            Gather::Independent { points } => {
                let frame = sampling::orthonormal_basis(n);
                mean(points, |u| radiance(frame * sampling::cosine_hemisphere(u)))
            }
        }
    }

    fn specular(&self, s: &Surface) -> DVec3 {
        let radiance = |l: DVec3| self.radiance(l);
        let Surface { f0, alpha, n, v, .. } = *s;
        if alpha == 0.0 {
            return fresnel::schlick(f0, n.dot(v)) * radiance(2.0 * n.dot(v) * n - v);
        }
        let frame = sampling::orthonormal_basis(n);
        let local_v = frame.transpose() * v;
        match self.gather {
            Gather::Same(samples) => {
                specular::estimate(f0, alpha, n, v, samples.specular, radiance)
            }
            Gather::Filtered(samples) => {
                let level = |l: DVec3, level: f64| self.level(l, level);
                let size = self.map.size();
                specular::filtered_estimate(f0, alpha, n, v, samples.specular, size, level)
            }
            Gather::Moved { specular, .. } => mean(specular, |u| {
                let h = sampling::ggx_normal(alpha, u);
                frame_sample(s, local_v, h, sampling::ggx_normal_pdf(alpha, h), |l| {
                    radiance(frame * l)
                })
            }),
            Gather::Independent { points } => mean(points, |u| {
                let h = sampling::ggx_visible_normal(alpha, local_v, u);
                let density = sampling::ggx_visible_normal_pdf(alpha, local_v, h);
                frame_sample(s, local_v, h, density, |l| radiance(frame * l))
            }),
        }
    }
}

/// Looks up a cube map as a path does: with filtering across the edges of faces if `seamless`, and clamped to one face
/// otherwise.
pub(crate) fn look_up(map: &CubeMap, seamless: bool, direction: DVec3, level: f64) -> DVec3 {
    let texel = if seamless {
        map.sample_level(direction, level)
    } else {
        map.sample_level_clamped(direction, level)
    };
    texel.truncate()
}

fn mean(points: &[DVec2], term: impl Fn(DVec2) -> DVec3) -> DVec3 {
    points.iter().map(|u| term(*u)).sum::<DVec3>() / points.len() as f64
}

/// Computes f L cos / pdf in the local frame for the half vector `h`, whose density is `density`: Walter et al. 2007,
/// eq. 20 and 14, with the lecture's G.
fn frame_sample(
    s: &Surface,
    v: DVec3,
    h: DVec3,
    density: f64,
    radiance: impl Fn(DVec3) -> DVec3,
) -> DVec3 {
    let v_dot_h = v.dot(h);
    let l = 2.0 * v_dot_h * h - v;
    if l.z <= 0.0 || v_dot_h <= 0.0 {
        return DVec3::ZERO;
    }
    let g = geometry::v_cavity(h.z, v.z, l.z, v_dot_h);
    let d = distribution::ggx_from_vectors(s.alpha, DVec3::Z, h);
    let f = fresnel::schlick(s.f0, v_dot_h) * d * g / (4.0 * v.z * l.z);
    f * radiance(l) * l.z / (density / (4.0 * v_dot_h))
}

/// Computes the colour of a pixel of frame `name` that shows `s`.
pub(crate) fn shade(name: &str, s: &Surface, light: &Light<'_>) -> DVec3 {
    let n_dot_v = s.n.dot(s.v);
    let plastic =
        |s: &Surface| layering::plastic(s.f0, diffuse(s, light), light.specular(s), n_dot_v);
    let coated = |base: DVec3| {
        let mirrored = 2.0 * n_dot_v * s.n - s.v;
        layering::thin_coat(light.radiance(mirrored), base, n_dot_v)
    };
    match name {
        "diffuse" | "filtered_diffuse" => {
            layering::plastic(s.f0, diffuse(s, light), DVec3::ZERO, n_dot_v)
        }
        "specular" | "filtered_specular" => light.specular(s),
        "masked_roughness" => plastic(&Surface { alpha: s.alpha + (0.5 - s.alpha) * s.mask, ..*s }),
        "layered" => coated(plastic(s)),
        "masked_layered" => coated(plastic(s).lerp(light.diffuse(s.n), s.mask)),
        _ => plastic(s),
    }
}

fn diffuse(s: &Surface, light: &Light<'_>) -> DVec3 {
    if s.diffuse == DVec3::ZERO { DVec3::ZERO } else { s.diffuse * light.diffuse(s.n) }
}

/// Computes the colour with compensation for the energy that single reflections lose. `table` is the split sum's table.
pub(crate) fn compensated(s: &Surface, light: &Light<'_>, table: &Texture) -> DVec3 {
    let entry = s.entry(table);
    let specular = light.specular(s);
    if s.diffuse == DVec3::ZERO {
        compensation::compensated(s.f0, specular, entry)
    } else {
        compensation::coupled(s.f0, diffuse(s, light), specular, entry)
    }
}

/// Computes the colour with the split sum instead of the specular estimator, from the prefiltered environment and the
/// split sum's table.
pub(crate) fn split_sum(
    s: &Surface,
    light: &Light<'_>,
    prefiltered: &CubeMap,
    table: &Texture,
) -> DVec3 {
    let n_dot_v = s.n.dot(s.v);
    let level = specular::prefiltered_level(s.alpha, prefiltered.level_count());
    let mirrored = 2.0 * n_dot_v * s.n - s.v;
    let about = look_up(prefiltered, light.seamless, mirrored, level);
    let specular = specular::split_sum(s.f0, s.entry(table), about);
    layering::plastic(s.f0, diffuse(s, light), specular, n_dot_v)
}
