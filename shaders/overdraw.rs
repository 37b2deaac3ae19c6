//! Twin of `overdraw.wgsl`: what its pictures show of the 64 spheres.

use glam::{DVec2, DVec3};

/// Bands of a quarter of a radius, counted from any; in each, the hole is at the bottom.
const BAND: f64 = 0.25;
/// How high a hole is.
const HOLE: f64 = 0.1;

/// Whether the sphere has a hole where its normal is `normal`.
#[must_use]
pub fn is_hole(normal: DVec3) -> bool {
    normal.y.rem_euclid(BAND) < HOLE
}

/// How far `normal` is, in Y, from the nearest edge of a hole.
#[must_use]
pub fn from_edge(normal: DVec3) -> f64 {
    let above = normal.y.rem_euclid(BAND);
    above.min(BAND - above).min((above - HOLE).abs())
}

/// How deep a step is, of the range 0..=1.
pub const STEP: f64 = 1.0 / 16.0;

/// The depth below `depth` that is a whole number of steps.
#[must_use]
pub fn stepped_depth(depth: f64) -> f64 {
    depth - depth.rem_euclid(STEP)
}

/// The number of a sphere, and where X and Y of a normal lie between -1 and 1.
#[must_use]
pub fn label(instance: u32, normal: DVec3) -> DVec3 {
    let share = (normal.truncate() - DVec2::NEG_ONE) / 2.0;
    DVec3::new(instance.into(), share.x, share.y)
}
