//! Tests the scene of the frame `lambert`: a room with five spheres.

use karat::prelude::*;
use shaders::{PBR, probe_room};

/// The function computes a product and a difference.
#[test]
fn sphere_centre() {
    PBR.function("probe_room::sphere_centre")
        .over(Integers(0..=4_u32))
        .agrees_with(probe_room::sphere_centre, Ulp(2.0));
}
