//! Rust counterpart of `overdraw.wgsl`: spheres with holes, with stepped depths, and with a colour for each sphere.

use glam::{DVec2, DVec3};

/// The height of a band of a sphere, as a share of the radius. Each band has a hole at its bottom.
const BAND: f64 = 0.25;
/// The height of a hole, as a share of the radius.
const HOLE: f64 = 0.1;

/// Checks if the sphere has a hole where its normal is `normal`.
#[must_use]
pub fn is_hole(normal: DVec3) -> bool {
    normal.y.rem_euclid(BAND) < HOLE
}

/// Returns the difference in Y between `normal` and the nearest edge of a hole.
#[must_use]
pub fn from_edge(normal: DVec3) -> f64 {
    let above = normal.y.rem_euclid(BAND);
    above.min(BAND - above).min((above - HOLE).abs())
}

/// The height of one step of a stepped depth. Depths are in 0..=1.
pub const STEP: f64 = 1.0 / 16.0;

/// Rounds `depth` down to a whole number of steps.
#[must_use]
pub fn stepped_depth(depth: f64) -> f64 {
    depth - depth.rem_euclid(STEP)
}

/// Returns a colour that labels a pixel: R is the number of the sphere. G and B are X and Y of the normal, mapped to
/// 0..=1.
#[must_use]
pub fn label(instance: u32, normal: DVec3) -> DVec3 {
    let share = (normal.truncate() - DVec2::NEG_ONE) / 2.0;
    DVec3::new(instance.into(), share.x, share.y)
}
