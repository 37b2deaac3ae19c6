//! Tests the game's own shaders, linked with the shaders of the Bevy version that the game uses.

use karat::prelude::*;

static BEVY: Package = karat::package!(crate = "bevy_render@0.20.1");
static OURS: Package = karat::package!("assets/shaders");

fn ours() -> Package {
    OURS.depends_on("bevy_render", &BEVY)
}

/// The stepped light is never darker than the smooth light, and less than one step brighter.
#[test]
fn steps_follow_the_light() {
    let lambert = |n_dot_l: f32| n_dot_l.max(0.0) / std::f32::consts::PI;
    ours().function("toon::toon").over((-1.0..=1.0, OneOf(vec![2.0_f32, 3.0, 4.0]))).satisfies(
        "lies less than a step above the light",
        move |(n_dot_l, steps): (f32, f32), light: f32| {
            let above = light - lambert(n_dot_l);
            let step = 1.0 / (steps * std::f32::consts::PI);
            (-1e-6..=step + 1e-6).contains(&above)
        },
    );
}

/// A surface that faces away from the light is black.
#[test]
fn the_far_side_is_black() {
    let package = ours();
    let far = package.function("toon::toon").over((-1.0..=0.0, 1.0..=8.0));
    far.agrees_with(|_: f64, _: f64| 0.0, Abs(0.0));
}
