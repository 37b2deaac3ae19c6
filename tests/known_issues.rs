//! Declares known faults of drivers. A check fails as soon as its driver no longer has the declared fault.

use glam::{DVec3, Vec3};
use karat::Path;
use karat::prelude::*;

use crate::drivers::{NVIDIA, SWIFTSHADER};

/// WGSL requires `mix(x, y, a)` to be as accurate as x (1 - a) + y a, which is exactly y at a = 1. Some drivers compute
/// x + (y - x) a. If x is much larger than y, rounding y - x loses digits of y. The library doesn't use `mix` for
/// masks, because where the mask is 1, the rounding error of a bright base would be visible.
// Lesson 45
#[test]
fn mix_ends_at_its_second_value() {
    let module = "fn blend(x: f32, y: f32, a: f32) -> f32 { return mix(x, y, a); }";
    Package::from_modules("blending", [("blending", module)])
        .function("blending::blend")
        .over((1.0..=50.0, 1e-4..=1.0, Just(1.0)))
        .fails_on(Path::GL, "Mesa's llvmpipe computes mix as x + (y - x) * a, which cancels")
        .fails_on(NVIDIA, "mix is computed as x + (y - x) * a, which cancels")
        .fails_on(SWIFTSHADER, "FMix is a * (y - x) + x (SpirvShaderGLSLstd450.cpp), which cancels")
        .agrees_with(|_: f64, y: f64, _: f64| y, Ulp(1.0));
}

/// Each face has its direction as its colour. At a corner, a linear filter returns the mean of the three faces that
/// meet there. The filter starts from one of these faces: Vulkan 1.3 (section 16.5.4) prefers the Z face to the Y face,
/// and the Y face to the X face.
#[test]
fn a_corner_of_a_cube_belongs_to_a_face() {
    let module = "@group(0) @binding(0) var cube: texture_cube<f32>;
                  @group(0) @binding(1) var cube_sampler: sampler;
                  fn look(d: vec3f) -> vec3f {
                      return textureSampleLevel(cube, cube_sampler, d, 0.0).rgb;
                  }";
    let axes = Vec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    let faces = axes.map(|axis| axis.extend(1.0).to_array()).collect();
    let sign = || OneOf(vec![-1.0_f32, 1.0]);
    Package::from_modules("corners", [("corners", module)])
        .function("corners::look")
        .with("cube", CubeMap::from_texels(1, faces))
        .with("cube_sampler", Sampler::LINEAR)
        .over((sign(), sign(), sign()).map(|(x, y, z)| Vec3::new(x, y, z)))
        .fails_on(Path::GL, SEAMS)
        .fails_on(SWIFTSHADER, CORNERS)
        .agrees_with(|d: DVec3| d / 3.0, Abs(3.0 / 512.0)); // the weights have 8 bits
}

pub(crate) const SEAMS: &str = "wgpu leaves desktop GL's seamless cube maps off: faces are clamped";

pub(crate) const CORNERS: &str = "where all three components are equally large no axis is the major one, \
                           and a point of the wrong face is sampled (`cubeFace` in SamplerCore.cpp)";
