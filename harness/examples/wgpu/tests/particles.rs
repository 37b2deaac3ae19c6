//! Tests the shader, and the program that runs the shader.

use example_wgpu::{Particle, stepped};
use karat::prelude::*;

static SHADERS: Package = karat::package!("shaders");

/// A particle never leaves the box.
#[test]
fn a_place_stays_in_the_box() {
    SHADERS
        .function("particles::moved")
        .over((0.0..=1.0, -4.0..=4.0, 0.0..=0.25))
        .satisfies("lies in the box", |_: (f32, f32, f32), moved: glam::Vec2| {
            (0.0..=1.0).contains(&moved.x)
        });
}

/// The reference for one coordinate in `f64`.
fn moved([place, velocity]: [f32; 2], time: f32) -> [f64; 2] {
    let [place, velocity, time] = [place, velocity, time].map(f64::from);
    let free = place + velocity * time;
    let inside = free.clamp(0.0, 1.0);
    if free == inside {
        return [free, velocity];
    }
    [(inside - 0.5 * (free - inside)).clamp(0.0, 1.0), -0.5 * velocity]
}

fn particles() -> Vec<Particle> {
    let at = |i: u16| f32::from(i) / 100.0;
    (0..100).map(|i| Particle { position: [at(i), 1.0 - at(i)], velocity: [3.0, at(i)] }).collect()
}

/// Each particle moves as in the reference, on every path, and the sanitizer looks for races. The shader rounds five
/// numbers of at most 3, so its error is below 1e-6.
#[test]
fn a_step_moves_each_particle() {
    let expected: Vec<f64> = particles()
        .iter()
        .flat_map(|old| {
            let [x, y] = [0, 1].map(|axis| moved([old.position[axis], old.velocity[axis]], 0.125));
            [x[0], y[0], x[1], y[1]]
        })
        .collect();
    let passes = SHADERS
        .compute()
        .with("particles", karat::fixture::Buffer::from_pod(&particles()))
        .with("seconds", Uniform::new(0.125_f32))
        .dispatch("particles::step", [2, 1, 1]);
    let of = |expected: &[f64], from: usize| -> Vec<glam::DVec2> {
        expected.chunks(4).map(|one| glam::DVec2::from_slice(&one[from..])).collect()
    };
    passes.clone().after("particles.position").agrees_with(of(&expected, 0), Abs(1e-6));
    passes.after("particles.velocity").agrees_with(of(&expected, 2), Abs(1e-6));
}

/// Tests the program's own buffers, layout and dispatch.
#[test]
fn the_program_does_the_same() {
    let Some(moved_by_wgpu) = stepped(&particles(), 0.125) else {
        panic!("wgpu finds no adapter, or fails")
    };
    for (old, new) in particles().iter().zip(&moved_by_wgpu) {
        for axis in [0, 1] {
            let [place, velocity] = moved([old.position[axis], old.velocity[axis]], 0.125);
            assert!((f64::from(new.position[axis]) - place).abs() <= 1e-6, "{old:?}: {new:?}");
            assert!((f64::from(new.velocity[axis]) - velocity).abs() <= 1e-6, "{old:?}: {new:?}");
        }
    }
}
