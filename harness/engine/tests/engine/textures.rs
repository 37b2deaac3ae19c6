//! Compares the values that samplers return with WebGPU's definitions, which this file computes as sums of texels.

use crate::common::program;
use karat_engine::{
    Address, Comparison, Dimension, F32, F64, Filter, Intervals, Lane, Options, Program, Resources,
    Sampler, Texels, Texture, TextureError,
};

fn texel(x: u32, y: u32, z: u32, level: u32) -> [f32; 4] {
    let n = x * 7 + y * 13 + z * 29 + level * 101;
    [(n % 17) as f32, (n % 5) as f32 * 0.5, -(n as f32), 1.0]
}

fn texture(dimension: Dimension, size: [u32; 3], levels: u32) -> Texture {
    let level = |k: u32| {
        let shrunk = |n: u32| (n >> k).max(1);
        let [w, h] =
            [shrunk(size[0]), if dimension == Dimension::D1 { 1 } else { shrunk(size[1]) }];
        let d = if dimension == Dimension::D3 { shrunk(size[2]) } else { size[2] };
        let mut texels = Vec::new();
        for z in 0..d {
            for y in 0..h {
                texels.extend((0..w).map(|x| texel(x, y, z, k)));
            }
        }
        Texels::Float(texels)
    };
    Texture::new(dimension, size, 1, (0..levels).map(level).collect()).expect("texels fit")
}

fn linear(address: Address) -> Sampler {
    let filter = Filter::Linear;
    Sampler { address: [address; 3], mag: filter, min: filter, mip: filter, ..Sampler::default() }
}

fn run(program: &Program, rows: &[f32], texture: Texture, sampler: Sampler) -> Vec<f32> {
    let mut resources = Resources::new();
    resources.set_texture(0, 0, texture);
    resources.set_sampler(0, 1, sampler);
    let rows: Vec<u32> = rows.iter().map(|x| x.to_bits()).collect();
    let cases = rows.len() / program.parameters().len();
    let options = Options::default();
    let found = program.call::<F32>(cases, &rows, &resources, &options, &()).expect("it runs");
    found.words().into_iter().map(f32::from_bits).collect()
}

/// Returns the indices of the two texels around a coordinate, and the weight of the second texel.
fn neighbours(u: f64, size: u32, address: Address) -> (u32, u32, f64) {
    let at = u * f64::from(size) - 0.5;
    let n = i64::from(size);
    let wrap = |i: i64| match address {
        Address::ClampToEdge => i.clamp(0, n - 1) as u32,
        Address::Repeat => i.rem_euclid(n) as u32,
        Address::MirrorRepeat => {
            // The texels repeat as 0 1 2 | 2 1 0 | 0 1 2.
            let tile = i.div_euclid(n);
            let inside = i.rem_euclid(n);
            (if tile % 2 == 0 { inside } else { n - 1 - inside }) as u32
        }
    };
    (wrap(at.floor() as i64), wrap(at.floor() as i64 + 1), at - at.floor())
}

fn bilinear(u: f64, v: f64, level: u32, address: Address) -> [f64; 4] {
    let (w, h) = ((6 >> level).max(1), (4 >> level).max(1));
    let (x0, x1, s) = neighbours(u, w, address);
    let (y0, y1, t) = neighbours(v, h, address);
    std::array::from_fn(|c| {
        let at = |x: u32, y: u32| f64::from(texel(x, y, 0, level)[c]);
        (at(x0, y0) * (1.0 - s) + at(x1, y0) * s) * (1.0 - t)
            + (at(x0, y1) * (1.0 - s) + at(x1, y1) * s) * t
    })
}

#[test]
fn trilinear_filtering_with_each_address_mode() {
    let source = "
        @group(0) @binding(0) var t: texture_2d<f32>;
        @group(0) @binding(1) var s: sampler;
        fn f(uv: vec2f, level: f32) -> vec4f { return textureSampleLevel(t, s, uv, level); }";
    let program = program(source, "f");
    for address in [Address::ClampToEdge, Address::Repeat, Address::MirrorRepeat] {
        let mut rows = Vec::new();
        for k in 0..300 {
            let share = |n: i32| ((k * n) % 307) as f32 / 307.0;
            rows.extend([4.0 * share(59) - 2.0, 4.0 * share(101) - 2.0, 3.5 * share(31) - 0.5]);
        }
        // There are more texels than 31 bits can count.
        for u in [-7e8_f32, -4e8, 4e8, 7e8] {
            rows.extend([u, 0.3, 0.0, 0.3, u, 0.0]);
        }
        let found = run(&program, &rows, texture(Dimension::D2, [6, 4, 1], 3), linear(address));
        for (row, found) in rows.chunks(3).zip(found.chunks(4)) {
            let [u, v, level] = [0, 1, 2].map(|k| f64::from(row[k]));
            let level = level.clamp(0.0, 2.0);
            let low = bilinear(u, v, level.floor() as u32, address);
            let high = bilinear(u, v, (level.floor() as u32 + 1).min(2), address);
            for c in 0..4 {
                let expected = low[c] + (high[c] - low[c]) * level.fract();
                let error = (f64::from(found[c]) - expected).abs();
                assert!(error < 1e-4, "{address:?} {row:?} {c}: {} not {expected}", found[c]);
            }
        }
    }
}

#[test]
fn nearest_texels_gathers_gradients_and_loads() {
    let source = "
        @group(0) @binding(0) var t: texture_2d<f32>;
        @group(0) @binding(1) var s: sampler;
        fn f(uv: vec2f) -> vec4f { return textureSampleLevel(t, s, uv, 0.0, vec2i(1, 0)); }
        fn gather(uv: vec2f) -> vec4f { return textureGather(2, t, s, uv); }
        fn slope(uv: vec2f) -> vec4f { return textureSampleGrad(t, s, uv, vec2f(2.0 / 6.0, 0.0), vec2f(0.0, 0.1)); }
        fn load(uv: vec2f) -> vec4f { return textureLoad(t, vec2i(uv), 1); }
        fn sizes(uv: vec2f) -> vec4f {
            return vec4f(vec2f(textureDimensions(t, 1)), f32(textureNumLevels(t)), f32(textureDimensions(t).x));
        }";
    let call = |name: &str, uv: [f32; 2]| {
        let program = program(source, name);
        run(&program, &uv, texture(Dimension::D2, [6, 4, 1], 3), Sampler::default())
    };
    // (0.4, 0.6) is in texel (2, 2). The test reads the texel on the right of it.
    assert_eq!(call("f", [0.4, 0.6]), texel(3, 2, 0, 0));
    // The sample is at (2.4, 2.4) - 0.5 = (1.9, 1.9), between texels 1 and 2 in both directions.
    let third = |x, y| texel(x, y, 0, 0)[2];
    assert_eq!(call("gather", [0.4, 0.6]), [third(1, 2), third(2, 2), third(2, 1), third(1, 1)]);
    // The step is two texels for each pixel, so the sample reads level 1. In this level it reads texel (1, 1).
    assert_eq!(call("slope", [0.4, 0.6]), texel(1, 1, 0, 1));
    assert_eq!(call("load", [2.0, 1.0]), texel(2, 1, 0, 1));
    assert_eq!(call("load", [-9.0, 7.0]), texel(0, 1, 0, 1), "clamped");
    assert_eq!(call("sizes", [0.0, 0.0]), [3.0, 2.0, 3.0, 6.0]);
}

#[test]
fn layers_volumes_and_lines() {
    let source = "
        @group(0) @binding(0) var t: texture_2d_array<f32>;
        @group(0) @binding(1) var s: sampler;
        fn f(uv: vec2f, layer: f32) -> vec4f { return textureSampleLevel(t, s, uv, i32(layer), 0.0); }";
    let array = || texture(Dimension::D2, [6, 4, 3], 1);
    let found =
        run(&program(source, "f"), &[0.4, 0.6, 1.0, 0.4, 0.6, 9.0], array(), Sampler::default());
    assert_eq!(found[..4], texel(2, 2, 1, 0));
    assert_eq!(found[4..], texel(2, 2, 2, 0));
    let source = "
        @group(0) @binding(0) var t: texture_3d<f32>;
        @group(0) @binding(1) var s: sampler;
        fn f(uv: vec3f) -> vec4f { return textureSampleLevel(t, s, uv, 0.0); }";
    let volume = texture(Dimension::D3, [4, 4, 4], 1);
    let found = run(&program(source, "f"), &[0.25, 0.375, 0.625], volume, linear(Address::Repeat));
    // In x, the point is between texels 0 and 1. In y it is at the centre of texel 1, and in z of texel 2.
    let expected: [f32; 4] =
        std::array::from_fn(|c| 0.5 * (texel(0, 1, 2, 0)[c] + texel(1, 1, 2, 0)[c]));
    assert_eq!(found, expected);
}

#[test]
fn cubes_are_seamless() {
    let source = "
        @group(0) @binding(0) var t: texture_cube<f32>;
        @group(0) @binding(1) var s: sampler;
        fn f(d: vec3f) -> vec4f { return textureSampleLevel(t, s, d, 0.0); }";
    let cube = || texture(Dimension::Cube, [4, 4, 6], 1);
    let program = program(source, "f");
    // The middle of texel (x, y) of +X is in the direction (1, -t, -s).
    let middle = |k: u32| (k as f32 + 0.5) / 4.0 * 2.0 - 1.0;
    let found = run(&program, &[1.0, -middle(1), -middle(3)], cube(), linear(Address::ClampToEdge));
    assert_eq!(found, texel(3, 1, 0, 0));
    // The axis of each face points between four texels.
    let axes = [
        ([1.0, 0.0, 0.0], 0),
        ([-1.0, 0.0, 0.0], 1),
        ([0.0, 1.0, 0.0], 2),
        ([0.0, -1.0, 0.0], 3),
        ([0.0, 0.0, 1.0], 4),
        ([0.0, 0.0, -1.0], 5),
    ];
    for (axis, face) in axes {
        let found = run(&program, &axis, cube(), linear(Address::ClampToEdge));
        for (c, found) in found.iter().enumerate() {
            let four = [(1, 1), (2, 1), (1, 2), (2, 2)].map(|(x, y)| texel(x, y, face, 0)[c]);
            assert_eq!(*found, four.iter().sum::<f32>() / 4.0, "{axis:?}");
        }
    }
    // The point is on the edge between +X and +Z, in the middle of row 1. The sample has half of the last texel of each
    // face: column 0 of +X (-s is z), and column 3 of +Z.
    let found = run(&program, &[1.0, -middle(1), 1.0], cube(), linear(Address::ClampToEdge));
    let expected: [f32; 4] =
        std::array::from_fn(|c| 0.5 * (texel(0, 1, 0, 0)[c] + texel(3, 1, 4, 0)[c]));
    for c in 0..4 {
        assert!((found[c] - expected[c]).abs() < 1e-5, "{found:?} {expected:?}");
    }
    // The value doesn't jump at an edge or a corner.
    let mut rows = Vec::new();
    for k in 0..1000 {
        let a = k as f32 / 1000.0 * std::f32::consts::TAU;
        rows.extend([a.cos(), (3.0 * a).sin(), a.sin()]);
    }
    let found = run(&program, &rows, cube(), linear(Address::ClampToEdge));
    let values: Vec<f32> = found.chunks(4).map(|texel| texel[0]).collect();
    for (k, pair) in values.windows(2).enumerate() {
        assert!((pair[0] - pair[1]).abs() < 1.5, "a jump at {k}: {pair:?}");
    }
}

#[test]
fn depths_compare_before_they_are_filtered() {
    let source = "
        @group(0) @binding(0) var t: texture_depth_2d;
        @group(0) @binding(1) var s: sampler_comparison;
        fn f(uv: vec2f, z: f32) -> f32 { return textureSampleCompareLevel(t, s, uv, z); }
        fn load(uv: vec2f, z: f32) -> f32 { return textureLoad(t, vec2i(uv), 0); }";
    let depth =
        || Texture::new(Dimension::D2, [2, 1, 1], 1, vec![Texels::Depth(vec![0.2, 0.8])]).unwrap();
    let sampler = || Sampler { compare: Some(Comparison::Less), ..linear(Address::ClampToEdge) };
    let rows = [0.5, 0.5, 0.5, 0.5, 0.5, 0.1, 0.625, 0.5, 0.5];
    let found = run(&program(source, "f"), &rows, depth(), sampler());
    assert_eq!(found, [0.5, 1.0, 0.75]);
    assert_eq!(run(&program(source, "load"), &[1.0, 0.0, 0.0], depth(), sampler()), [0.8]);
}

#[test]
fn integers_are_loaded_as_they_are() {
    let source = "
        @group(0) @binding(0) var t: texture_2d<i32>;
        fn f(x: i32) -> vec4i { return textureLoad(t, vec2i(x, 0), 0); }";
    let texels = vec![[1, -2, i32::MIN, i32::MAX], [5, 6, 7, 8]];
    let mut resources = Resources::new();
    let texture = Texture::new(Dimension::D2, [2, 1, 1], 1, vec![Texels::Sint(texels)]).unwrap();
    resources.set_texture(0, 0, texture);
    let program = program(source, "f");
    let found = program.call::<F64>(2, &[0, 1], &resources, &Options::default(), &()).unwrap();
    let expected = [1, -2, i32::MIN, i32::MAX, 5, 6, 7, 8].map(i32::cast_unsigned);
    assert_eq!(found.words(), expected);
}

#[test]
fn bounds_of_a_sample_hold_all_texels() {
    let source = "
        @group(0) @binding(0) var t: texture_2d<f32>;
        @group(0) @binding(1) var s: sampler;
        fn f(uv: vec2f) -> f32 { return textureSampleLevel(t, s, uv, 0.0).x; }";
    let mut resources = Resources::new();
    resources.set_texture(0, 0, texture(Dimension::D2, [6, 4, 1], 1));
    resources.set_sampler(0, 1, linear(Address::Repeat));
    let rows = [0.3f32, 0.4].map(f32::to_bits);
    let found = program(source, "f")
        .call::<Intervals>(1, &rows, &resources, &Options::default(), &())
        .unwrap();
    let Lane::Float(x) = found.row(0)[0] else { panic!() };
    assert!(x.lo() == 0.0 && x.hi() >= 16.0 && x.hi() < 16.001, "{x:?}");
}

#[test]
fn texels_must_fit_their_size() {
    let level = |n: usize| Texels::Float(vec![[0.0; 4]; n]);
    let error = Texture::new(Dimension::D2, [4, 4, 1], 1, vec![level(16), level(5)]).unwrap_err();
    assert_eq!(error, TextureError::Level { level: 1, found: 5, needed: 4 });
    assert!(Texture::new(Dimension::Cube, [4, 4, 5], 1, vec![level(80)]).is_err());
    assert!(Texture::new(Dimension::D2, [0, 4, 1], 1, vec![level(0)]).is_err());
    assert!(Texture::new(Dimension::D2, [u32::MAX; 3], 1, vec![level(0)]).is_err());
}

#[test]
fn storage_textures_are_written_as_their_format_rounds() {
    let source = "
        @group(0) @binding(0) var t: texture_storage_2d<rgba8unorm, write>;
        @group(0) @binding(1) var u: texture_storage_2d<r32uint, read_write>;
        @compute @workgroup_size(4, 2)
        fn main(@builtin(global_invocation_id) id: vec3u) {
            textureStore(t, id.xy, vec4f(f32(id.x) * 0.3, 2.0, -1.0, 0.5));
            let before = textureLoad(u, id.xy).x;
            textureStore(u, id.xy, vec4u(before + id.x + 10u * id.y));
        }";
    let (module, info) = crate::common::module(source);
    let settings = karat_engine::Settings::default();
    let program = Program::entry_point(&module, &info, "main", &settings).unwrap();
    let mut resources = Resources::new();
    let blank = Texels::Float(vec![[0.0; 4]; 6]);
    // The texture has one column fewer than there are invocations. Writes outside of it have no effect.
    resources.set_texture(0, 0, Texture::new(Dimension::D2, [3, 2, 1], 1, vec![blank]).unwrap());
    let ones = Texels::Uint(vec![[1, 0, 0, 1]; 8]);
    resources.set_texture(0, 1, Texture::new(Dimension::D2, [4, 2, 1], 1, vec![ones]).unwrap());
    program.dispatch::<F32>([1, 1, 1], &mut resources, &Options::default(), &()).unwrap();
    let Texels::Float(texels) = &resources.texture(0, 0).unwrap().texels()[0] else { panic!() };
    // 0.5 of 255 is halfway between two integers, and 128 is the even one. 0.3 of 255 is 76.5, which may be rounded up
    // or down.
    let expected = |x: f32| [x, 1.0, 0.0, 128.0 / 255.0];
    assert_eq!(texels[0], expected(0.0));
    assert!(texels[1][0] == 76.0 / 255.0 || texels[1][0] == 77.0 / 255.0);
    assert_eq!(texels[5][1..], expected(0.0)[1..]);
    let Texels::Uint(texels) = &resources.texture(0, 1).unwrap().texels()[0] else { panic!() };
    let found: Vec<u32> = texels.iter().map(|texel| texel[0]).collect();
    assert_eq!(found, [1, 2, 3, 4, 11, 12, 13, 14]);
    let stop = program
        .dispatch::<Intervals>([1, 1, 1], &mut resources, &Options::default(), &())
        .unwrap_err();
    assert!(stop.to_string().contains("texture that the shader writes"), "{stop}");
}

#[test]
fn a_texture_with_another_type_of_texels_is_an_error() {
    let source = "
        @group(0) @binding(0) var t: texture_2d<i32>;
        fn f(x: i32) -> vec4i { return textureLoad(t, vec2i(x, 0), 0); }";
    let mut resources = Resources::new();
    resources.set_texture(0, 0, texture(Dimension::D2, [6, 4, 1], 1));
    let program = program(source, "f");
    let stop = program.call::<F32>(1, &[0], &resources, &Options::default(), &()).unwrap_err();
    assert_eq!(
        stop.to_string(),
        "no texture with the dimension and texel type of `t` is bound to group 0, binding 0"
    );
}

fn bounds(source: &str, texture: Texture) -> Vec<(f32, f32)> {
    let program = program(source, "f");
    let mut resources = Resources::new();
    resources.set_texture(0, 0, texture);
    resources.set_sampler(0, 1, linear(Address::ClampToEdge));
    let found =
        program.call::<Intervals>(1, &[0], &resources, &Options::default(), &()).expect("it runs");
    let ends = |lane| match lane {
        Lane::Float(x) => (karat_engine::Interval::lo(x), x.hi()),
        other => panic!("{other:?}"),
    };
    found.row(0).into_iter().map(ends).collect()
}

/// A linear filter adds texels with rounded weights, so its result may differ from the texels even if all texels are
/// equal.
// Lesson 169
#[test]
fn bounds_of_filtered_equal_texels_are_wider_than_the_texel() {
    let source = "
        @group(0) @binding(0) var t: texture_cube<f32>;
        @group(0) @binding(1) var s: sampler;
        fn f(x: f32) -> vec4f { return textureSampleLevel(t, s, vec3f(x, 1.0, 0.3), 0.0); }";
    let texels = Texels::Float(vec![[0.0, -3.0, 48.0 / 255.0, 1.0]; 6 * 4]);
    let cube = Texture::new(Dimension::Cube, [2, 2, 6], 1, vec![texels]).expect("they fit");
    let found = bounds(source, cube);
    assert_eq!(found[0], (0.0, 0.0));
    for ((lo, hi), texel) in found[1..].iter().zip([-3.0, 48.0 / 255.0, 1.0_f32]) {
        assert!(*lo < texel.next_down() && *hi > texel.next_up(), "{texel}: {lo} to {hi}");
        assert!(hi - lo < 1e-5 * texel.abs(), "{texel}: {lo} to {hi}");
    }
}

/// The GPU divides an 8-bit channel by 255, and may round the quotient. It returns a 32-bit float channel exactly.
// Lesson 169
#[test]
fn normalised_channels_are_near_to_their_quotients() {
    let read = "fn f(i: u32) -> vec4f { return textureLoad(t, vec2u(i, 0u)); }";
    let texels = || vec![Texels::Float(vec![[0.0, 48.0 / 255.0, 1.0 / 255.0, 1.0]])];
    let texture = || Texture::new(Dimension::D2, [1, 1, 1], 1, texels()).expect("they fit");
    let source = |format: &str| {
        format!("@group(0) @binding(0) var t: texture_storage_2d<{format}, read>; {read}")
    };
    let exact = bounds(&source("rgba32float"), texture());
    assert!(exact.iter().all(|(lo, hi)| lo == hi), "{exact:?}");
    let near = bounds(&source("rgba8unorm"), texture().normalized());
    assert_eq!(near[0], (0.0, 0.0));
    let quotient = 48.0 / 255.0_f32;
    assert!(near[1].0 <= quotient.next_down() && near[1].1 >= quotient.next_up(), "{near:?}");
    assert!(near.iter().all(|(lo, hi)| hi - lo < 1e-6), "{near:?}");
}
