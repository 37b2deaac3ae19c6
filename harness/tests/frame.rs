//! What frames are drawn from reaches the shader: vertex attributes, and mip levels of textures.

use glam::{Vec2, Vec3, Vec4};
use karat::prelude::*;
use karat::{Frame, FrameError, Image, Mesh, Rect};

const SHADER: &str = "
@group(0) @binding(0) var stripes: texture_2d<f32>;
@group(0) @binding(1) var stripes_sampler: sampler;

struct Varyings {
    @builtin(position) clip: vec4f,
    @location(0) color: vec3f,
    @location(1) uv: vec2f,
    @location(2) weight: f32,
}

@vertex
fn vertex(
    @location(0) position: vec3f,
    @location(3) weight: f32,
    @location(1) color: vec3f,
    @location(2) uv: vec2f,
) -> Varyings {
    return Varyings(vec4f(position, 1.0), color, uv, weight);
}

@fragment
fn attributes(in: Varyings) -> @location(0) vec4f {
    return vec4f(in.color.xy, in.uv.y, in.weight);
}

@fragment
fn levels(in: Varyings) -> @location(0) vec4f {
    let fine = textureSampleLevel(stripes, stripes_sampler, vec2f(0.125, 0.5), 0.0).r;
    let coarse = textureSampleLevel(stripes, stripes_sampler, vec2f(0.125, 0.5), 1.0).r;
    let coarsest = textureSampleLevel(stripes, stripes_sampler, vec2f(0.125, 0.5), 2.0).r;
    return vec4f(fine, coarse, coarsest, in.weight);
}
";

/// A triangle over the whole frame, its corners' attributes in no order of location.
fn triangle() -> Mesh {
    let corners = [Vec2::NEG_ONE, Vec2::new(3.0, -1.0), Vec2::new(-1.0, 3.0)];
    let positions = corners.map(|corner| corner.extend(0.5)).to_vec();
    let unit = corners.map(|corner| 0.5 * (corner + Vec2::ONE));
    Mesh::new(positions, vec![0, 1, 2])
        .attribute(2, &unit)
        .attribute(3, &[0.5_f32; 3])
        .attribute(1, &unit.map(|at| Vec3::new(at.x, 0.25, 0.0)))
}

fn drawn(fragment: &str, fixtures: bool) -> Vec<Image> {
    let package = Package::from_source("frame", SHADER);
    let open = Path::ALL.into_iter().filter(|path| karat::adapter(*path).is_ok());
    let frame = |path| {
        let mut frame = package.frame("", 4, 4).mesh("vertex", fragment, triangle(), 1);
        if fixtures {
            let stripes = Texture::from_fn(4, 4, |column, _| Vec4::splat(column as f32));
            frame = frame
                .with("stripes", stripes.with_mips())
                .with("stripes_sampler", Sampler::Nearest);
        }
        frame.render(path).expect("the triangle is drawn")
    };
    let images: Vec<Image> = open.map(frame).collect();
    assert!(!images.is_empty(), "no path opens, so nothing would be checked");
    images
}

/// Each attribute arrives at its own location, interpolated: small binary fractions are exact.
#[test]
fn attributes_reach_the_vertex_function() {
    for image in drawn("attributes", false) {
        for (index, pixel) in image.pixels().iter().enumerate() {
            let (column, row) = (index % 4, index / 4);
            let [x, y] = [column, 3 - row].map(|place| (place as f32 + 0.5) / 4.0);
            for (found, expected) in pixel.iter().zip([x, 0.25, y, 0.5]) {
                assert!((found - expected).abs() < 1e-6, "{pixel:?} at {column}, {row}");
            }
        }
    }
}

/// Columns 0, 1, 2, 3; in pairs 1/2, 5/2; and all of them 3/2.
#[test]
fn levels_are_means() {
    for image in drawn("levels", true) {
        assert!(image.pixels().iter().all(|pixel| *pixel == [0.0, 0.5, 1.5, 0.5]));
    }
}

/// The mean of a rectangle, without a golden; a value that isn't a number is no mean.
#[test]
fn the_mean_of_a_rectangle_is_what_is_expected() {
    let package = Package::from_source("frame", SHADER);
    let frame: Frame<'_> = package.frame("", 4, 4).mesh("vertex", "attributes", triangle(), 1);
    let right = Rect::new(2, 0, 2, 4);
    let mean = frame.expect_mean(right, [0.75, 0.25, 0.5], Abs(1e-6));
    assert!(!mean.paths.is_empty());
    let error = frame.try_expect_mean(right, [0.75, 0.25, 0.51], Rel(0.01)).expect_err("it is .5");
    assert!(matches!(error, FrameError::Mean { .. }));
    assert!(error.to_string().contains("the mean of (2, 0) to (3, 3) is [0.75, 0.25, 0.5]"));
    let error = frame.try_expect_mean(Rect::new(2, 0, 3, 4), [0.0; 3], Abs(1.0));
    assert!(error.expect_err("too wide").to_string().contains("isn't a part of a frame of 4 x 4"));
    for useless in [f64::NAN, f64::INFINITY, -1.0] {
        let error = frame.try_expect_mean(right, [0.0; 3], Abs(useless)).expect_err("no bound");
        assert!(error.to_string().contains("the tolerance of the frame is"), "{error}");
    }
    let nan = "@vertex fn vertex(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
        return vec4f(vec2f(f32(i & 1u), f32(i >> 1u)) * 4.0 - 1.0, 0.5, 1.0);
    }
    @fragment fn fragment(@builtin(position) at: vec4f) -> @location(0) vec4f {
        return vec4f(select(1.0, bitcast<f32>(u32(at.x) + 0x7fc00000u), at.x < 1.0 && at.y < 1.0));
    }";
    let package = Package::from_source("frame", nan);
    let frame = package.frame("", 4, 4).fullscreen("vertex", "fragment");
    frame.expect_mean(Rect::new(0, 1, 4, 3), [1.0; 3], Abs(0.0));
    let error = frame.try_expect_mean(Rect::new(0, 0, 4, 4), [1.0; 3], Rel(1e9));
    assert!(matches!(error, Err(FrameError::Mean { .. })), "{error:?}");
}
