//! Samplers, textures and buffers of every kind.

use glam::{DVec2, DVec4, IVec4, UVec2, UVec4, Vec2, Vec4};
use karat::Path;
use karat::fixture::{Address, Buffer, Compare, Filter, Fixture};
use karat::prelude::*;
use karat::unstable::probe::ProbeError;

/// The tolerance for filtered texels. The tolerance allows drivers to round the filter's weights to 8 bits.
const FILTERED: Abs = Abs(0.006);

fn ramp() -> Texture {
    Texture::from_fn(4, 4, |x, y| Vec4::new(x as f32, y as f32, 0.0, 1.0))
}

fn package(declarations: &str, body: &str) -> Package {
    Package::from_source("r", format!("{declarations}\n{body}\n"))
}

const SAMPLED: &str = "@group(0) @binding(0) var image: texture_2d<f32>;\n\
     @group(0) @binding(1) var filtering: sampler;\n\
     fn f(uv: vec2f) -> vec4f { return textureSampleLevel(image, filtering, uv, 0.0); }";

/// The nearest texel of `ramp`. `wrap` maps the index of a column or row that lies outside the texture to an index
/// inside.
fn nearest(uv: DVec2, wrap: impl Fn(f64) -> f64) -> DVec4 {
    let at = (uv * 4.0).floor();
    DVec4::new(wrap(at.x), wrap(at.y), 0.0, 1.0)
}

fn mirrored(texel: f64) -> f64 {
    let twice = texel.rem_euclid(8.0);
    if twice < 4.0 { twice } else { 7.0 - twice }
}

/// Texture coordinates between a texel's centre and its edge, so that rounding doesn't change the nearest texel.
fn coordinates() -> impl Domain<Value = Vec2> {
    let texel = |i: i32| (f64::from(i) + 0.7) as f32 / 4.0;
    let places: Vec<Vec2> =
        (-9..12).flat_map(|y| (-9..12).map(move |x| Vec2::new(texel(x), texel(y)))).collect();
    OneOf(places)
}

fn addressed(sampler: Sampler, wrap: fn(f64) -> f64) {
    let package = package("", SAMPLED);
    let reference = move |uv: DVec2| nearest(uv, wrap);
    let probe = || package.function("f").with("image", ramp()).with("filtering", sampler);
    probe().over(coordinates()).agrees_with(reference, Abs(0.0));
}

// Lesson 119
#[test]
fn samplers_clamp_repeat_and_mirror() {
    addressed(Sampler::NEAREST, |texel| texel.clamp(0.0, 3.0));
    addressed(Sampler::NEAREST.repeat(), |texel| texel.rem_euclid(4.0));
    addressed(Sampler::NEAREST.mirror(), mirrored);
}

/// A check fails if the sampler clamps instead of repeating.
// Lesson 119
#[test]
fn a_wrong_sampler_fails_the_check() {
    let package = package("", SAMPLED);
    let repeated = |uv: DVec2| nearest(uv, |texel| texel.rem_euclid(4.0));
    for wrong in [Sampler::NEAREST, Sampler::NEAREST.mirror(), Sampler::LINEAR.repeat()] {
        let check = package.function("f").with("image", ramp()).with("filtering", wrong);
        check
            .over(coordinates())
            .unrecorded()
            .try_agrees_with(repeated, FILTERED)
            .expect_err("it differs");
    }
}

// Lesson 119
#[test]
fn each_coordinate_has_its_own_address() {
    let package = package("", SAMPLED);
    let sampler = Sampler::NEAREST.address([Address::Repeat, Address::Mirror, Address::Clamp]);
    let reference = |uv: DVec2| {
        let at = (uv * 4.0).floor();
        DVec4::new(at.x.rem_euclid(4.0), mirrored(at.y), 0.0, 1.0)
    };
    package
        .function("f")
        .with("image", ramp())
        .with("filtering", sampler)
        .over(coordinates())
        .agrees_with(reference, Abs(0.0));
}

/// All texels of a mip level have the same value, so the result depends only on the sampler's filter between levels and
/// on its limits for the level of detail.
// Lesson 119
#[test]
fn filters_between_levels_and_their_clamp() {
    let declarations = "@group(0) @binding(0) var image: texture_2d<f32>;\n\
         @group(0) @binding(1) var filtering: sampler;";
    let package = package(
        declarations,
        "fn f(lod: f32) -> f32 { return textureSampleLevel(image, filtering, vec2f(0.5), lod).x; }",
    );
    let flat = |size: u32, value: f32| Texture::from_fn(size, size, move |_, _| value);
    let image = || flat(4, 0.0).with_levels([flat(2, 1.0), flat(1, 2.0)]);
    let check = |sampler: Sampler, reference: fn(f64) -> f64| {
        let probe = package.function("f").with("image", image()).with("filtering", sampler);
        // These levels of detail avoid values where the nearest level changes.
        let lods = [-1.0, 0.0, 0.3, 0.7, 1.0, 1.2, 1.7, 2.0, 5.0_f32];
        probe.over(OneOf(lods.to_vec())).agrees_with(reference, FILTERED);
    };
    check(Sampler::LINEAR, |lod| lod.clamp(0.0, 2.0));
    check(Sampler::LINEAR.mip(Filter::Nearest), |lod| lod.clamp(0.0, 2.0).round());
    check(Sampler::LINEAR.lod(1.0, 1.5), |lod| lod.clamp(1.0, 1.5));
}

/// The sampler uses the filter `mag` for texels larger than a pixel, and the filter `min` for texels smaller than a
/// pixel.
// Lesson 119
#[test]
fn filters_of_larger_and_smaller_texels() {
    let text = "@group(0) @binding(0) var image: texture_2d<f32>;\n\
         @group(0) @binding(1) var filtering: sampler;\n\
         fn f(lod: f32) -> f32 {\n    \
         return textureSampleLevel(image, filtering, vec2f(0.45, 0.5), lod).x;\n}";
    let package = package("", text);
    let step =
        |size: u32| Texture::from_fn(size, size, move |x, _| f32::from(u8::from(2 * x >= size)));
    let image = step(4).with_levels([step(2)]);
    let sampler = Sampler::NEAREST.mag(Filter::Linear);
    let reference = |lod: f64| if lod <= 0.0 { 0.3 } else { 0.0 };
    package
        .function("f")
        .with("image", image)
        .with("filtering", sampler)
        .over(OneOf(vec![-1.0_f32, 1.0]))
        .agrees_with(reference, FILTERED);
}

fn depths() -> Texture {
    Texture::from_fn(2, 2, |x, y| (x + 2 * y) as f32 / 4.0)
}

// Lesson 119
#[test]
fn comparison_samplers_compare() {
    let text = "@group(0) @binding(0) var shadow: texture_depth_2d;\n\
         @group(0) @binding(1) var comparing: sampler_comparison;\n\
         fn f(at: vec2u, depth: f32) -> f32 {\n    \
         let uv = (vec2f(at) + 0.5) / 2.0;\n    \
         return textureSampleCompareLevel(shadow, comparing, uv, depth);\n}\n\
         fn loaded(at: vec2u) -> f32 { return textureLoad(shadow, at, 0); }";
    let package = package("", text);
    type Holds = fn(f64, f64) -> bool;
    let kinds: [(Compare, Holds); 8] = [
        (Compare::Never, |_, _| false),
        (Compare::Less, |a, b| a < b),
        (Compare::Equal, |a, b| a == b),
        (Compare::LessEqual, |a, b| a <= b),
        (Compare::Greater, |a, b| a > b),
        (Compare::NotEqual, |a, b| a != b),
        (Compare::GreaterEqual, |a, b| a >= b),
        (Compare::Always, |_, _| true),
    ];
    let places = || OneOf((0..4).map(|i| UVec2::new(i % 2, i / 2)).collect::<Vec<_>>());
    let depth = |at: UVec2| f64::from(at.x + 2 * at.y) / 4.0;
    for (compare, holds) in kinds {
        package
            .function("f")
            .with("shadow", depths())
            .with("comparing", Sampler::NEAREST.compare(compare))
            .over((places(), OneOf(vec![0.0_f32, 0.25, 0.5, 0.6, 0.75, 1.0])))
            .agrees_with(
                move |at: UVec2, reference: f64| f64::from(u8::from(holds(reference, depth(at)))),
                Abs(0.0),
            );
    }
    package
        .function("loaded")
        .with("shadow", depths())
        .over(places())
        .refused_on(Path::GL, "naga's GLSL has no textureLoad of depths")
        .agrees_with(depth, Abs(0.0));
}

/// Functions load texels of each type (`f32`, `i32`, `u32`, depth) from textures of each dimension.
// Lesson 120
#[test]
fn every_texture_is_loaded_from() {
    let value = |x: u32, y: u32, z: u32| x + 4 * y + 16 * z;
    let place = |i: u32| (i % 4, i / 4 % 4, i / 16);
    let float = move |x, y, z| value(x, y, z) as f32 / 8.0;
    let signed = move |x, y, z| IVec4::splat(5 - value(x, y, z).cast_signed());
    let unsigned = move |x, y, z| UVec4::splat(value(x, y, z) << 20);
    let at = "let p = vec3u(i % 4u, i / 4u % 4u, i / 16u);";
    let depth = move |x: u32, y: u32, z: u32| value(x, y, z) as f32 / 64.0;
    let layer = |z: u32| Texture::from_fn(4, 4, move |x, y| float(x, y, z));
    let cases: Vec<(&str, &str, Texture, u32)> = vec![
        (
            "texture_1d<f32>",
            "textureLoad(t, p.x, 0).x * 8.0",
            Texture::from_fn_1d(4, |x| float(x, 0, 0)),
            4,
        ),
        ("texture_2d<f32>", "textureLoad(t, p.xy, 0).x * 8.0", layer(0), 16),
        (
            "texture_2d_array<f32>",
            "textureLoad(t, p.xy, p.z, 0).x * 8.0",
            Texture::array((0..4).map(layer)),
            64,
        ),
        ("texture_3d<f32>", "textureLoad(t, p, 0).x * 8.0", Texture::volume([4; 3], float), 64),
        (
            "texture_2d<i32>",
            "f32(5 - textureLoad(t, p.xy, 0).w)",
            Texture::from_fn(4, 4, |x, y| signed(x, y, 0)),
            16,
        ),
        ("texture_3d<i32>", "f32(5 - textureLoad(t, p, 0).y)", Texture::volume([4; 3], signed), 64),
        (
            "texture_2d<u32>",
            "f32(textureLoad(t, p.xy, 0).z >> 20u)",
            Texture::from_fn(4, 4, |x, y| unsigned(x, y, 0)),
            16,
        ),
        (
            "texture_depth_2d",
            "textureLoad(t, p.xy, 0) * 64.0",
            Texture::from_fn(4, 4, |x, y| depth(x, y, 0)),
            16,
        ),
        (
            "texture_depth_2d_array",
            "textureLoad(t, p.xy, p.z, 0) * 64.0",
            Texture::array((0..4).map(|z| Texture::from_fn(4, 4, move |x, y| depth(x, y, z)))),
            64,
        ),
        (
            "texture_multisampled_2d<f32>",
            "textureLoad(t, p.xy, p.z).x * 8.0",
            Texture::multisampled(4, 4, 4, float),
            64,
        ),
        (
            "texture_multisampled_2d<u32>",
            "f32(textureLoad(t, p.xy, p.z).x)",
            Texture::multisampled(4, 4, 4, |x, y, s| UVec4::splat(value(x, y, s))),
            64,
        ),
        (
            "texture_depth_multisampled_2d",
            "textureLoad(t, p.xy, p.z) * 64.0",
            Texture::multisampled(4, 4, 4, depth),
            64,
        ),
        (
            "texture_storage_2d<r32uint, read>",
            "f32(textureLoad(t, p.xy).x >> 20u)",
            Texture::from_fn(4, 4, |x, y| unsigned(x, y, 0)),
            16,
        ),
        (
            "texture_storage_3d<r32float, read>",
            "textureLoad(t, p).x * 8.0",
            Texture::volume([4; 3], float),
            64,
        ),
    ];
    for (kind, expression, texture, texels) in cases {
        let gl = match kind {
            "texture_1d<f32>" => Some("wgpu makes a 2D texture of it"),
            "texture_storage_3d<r32float, read>" => Some("wgpu binds one slice of it"),
            kind if kind.contains("multisampled") => Some("wgpu makes a plain texture of it"),
            kind if kind.contains("depth") => Some("naga's GLSL has no textureLoad of depths"),
            _ => None,
        };
        let text = format!(
            "@group(0) @binding(0) var t: {kind};\nfn f(i: u32) -> f32 {{ {at} return {expression}; }}"
        );
        let package = Package::from_source(kind, text);
        let check = package.function("f").with("t", texture).over(Integers(0..=texels - 1));
        let check = gl.into_iter().fold(check, |check, reason| check.refused_on(Path::GL, reason));
        check.agrees_with(
            move |i: u32| {
                let (x, y, z) = place(i);
                f64::from(value(x, y, z))
            },
            Abs(0.0),
        );
    }
}

/// Functions sample each face and layer of cube maps in the directions of the axes.
// Lesson 120
#[test]
fn cubes_have_faces_layers_and_depths() {
    let text = "@group(0) @binding(0) var many: texture_cube_array<f32>;\n\
         @group(0) @binding(1) var filtering: sampler;\n\
         @group(0) @binding(2) var shadow: texture_depth_cube;\n\
         @group(0) @binding(3) var comparing: sampler_comparison;\n\
         fn axis(i: u32) -> vec3f {\n    \
         var d = vec3f();\n    d[i / 2u] = 1.0 - 2.0 * f32(i % 2u);\n    return d;\n}\n\
         fn f(face: u32, layer: u32) -> f32 {\n    \
         return textureSampleLevel(many, filtering, axis(face), layer, 0.0).x;\n}\n\
         fn lit(face: u32, depth: f32) -> f32 {\n    \
         return textureSampleCompareLevel(shadow, comparing, axis(face), depth);\n}\n";
    let package = package("", text);
    let face = |value: f32| Texture::from_fn(2, 2, move |_, _| value);
    package
        .function("f")
        .with("many", Texture::cube_array((0..12_u8).map(|i| face(f32::from(i)))))
        .with("filtering", Sampler::NEAREST)
        .over((Integers(0..=5_u32), Integers(0..=1_u32)))
        .agrees_with(|face: u32, layer: u32| f64::from(6 * layer + face), Abs(0.0));
    // wgpu's GL treats an array with one cube as a cube, which is wrong.
    package
        .function("f")
        .with("many", Texture::cube_array((0..6_u8).map(|i| face(f32::from(i)))))
        .with("filtering", Sampler::NEAREST)
        .over((Integers(0..=5_u32), Just(0_u32)))
        .refused_on(Path::GL, "wgpu's GL turns an array of one cube map into a single cube map")
        .agrees_with(|face: u32, _: u32| f64::from(face), Abs(0.0));
    package
        .function("lit")
        .with("shadow", Texture::cube((0..6_u8).map(|i| face(f32::from(i) / 8.0))))
        .with("comparing", Sampler::NEAREST.compare(Compare::Less))
        .over((Integers(0..=5_u32), OneOf(vec![0.2_f32, 0.4, 0.6])))
        .agrees_with(
            |face: u32, depth: f64| f64::from(u8::from(depth < f64::from(face) / 8.0)),
            Abs(0.0),
        );
}

karat::shareable! {
    struct Head mirrors HeadMirror { count: u32, scale: f32 }
}

// Lesson 120
#[test]
fn buffers_by_their_values_and_by_their_bytes() {
    let text = "struct Lights { count: u32, scale: f32, items: array<vec4f> }\n\
         @group(0) @binding(0) var<storage, read> lights: Lights;\n\
         @group(0) @binding(1) var<storage, read> plain: array<f32>;\n\
         fn f(i: u32) -> f32 { return lights.items[i].y * lights.scale + f32(lights.count); }\n\
         fn lengths() -> vec2u { return vec2u(arrayLength(&lights.items), arrayLength(&plain)); }\n\
         fn g(i: u32) -> f32 { return plain[i]; }";
    let package = package("", text);
    let items = || (0..3_u8).map(|i| Vec4::splat(f32::from(i)));
    let lights = || Storage::with_head(Head { count: 3, scale: 2.0 }, items());
    let expected = |i: u32| 2.0 * f64::from(i) + 3.0;
    let three = || Integers(0..=2_u32);
    package.function("f").with("lights", lights()).over(three()).agrees_with(expected, Abs(0.0));

    let mut words = vec![3_u32, 2.0_f32.to_bits(), 0, 0];
    words.extend(items().flat_map(|item| item.to_array().map(f32::to_bits)));
    let bytes = Buffer::from_pod(&words);
    package
        .function("f")
        .with("lights", bytes.clone())
        .over(three())
        .agrees_with(expected, Abs(0.0));
    package
        .function("lengths")
        .with("lights", lights())
        .with("plain", Storage::new([1.0_f32, 2.0, 3.0]))
        .over(())
        .agrees_with(|| UVec2::new(3, 3), Abs(0.0));
    // With a dynamic offset, the function doesn't see the bytes before the offset.
    let shifted = [vec![7.0_f32; 64], vec![0.0, 1.0, 2.0]].concat();
    package
        .function("g")
        .with("plain", Buffer::from_pod(&shifted).with_offset(256))
        .over(three())
        .agrees_with(|i: u32| f64::from(i), Abs(0.0));
}

// Lesson 120
#[test]
fn immediates_are_set() {
    let text = "struct Push { offset: vec2f, scale: f32 }\n\
         var<immediate> push: Push;\n\
         fn f(x: f32) -> f32 { return push.offset.y + push.scale * x; }";
    karat::shareable! {
        struct Push mirrors PushMirror { offset: Vec2, scale: f32 }
    }
    let package = package("", text);
    let push = Push { offset: Vec2::new(1.0, 3.0), scale: 0.5 };
    package
        .function("f")
        .with("push", Uniform::new(push))
        .over(OneOf(vec![0.0_f32, 2.0, 8.0]))
        .agrees_with(|x: f64| 3.0 + 0.5 * x, Abs(0.0));
    // Immediates with fewer than 16 bytes, for a function and for a pass.
    let text = "var<immediate> two: vec2u;
        @group(0) @binding(0) var<storage, read_write> out: array<u32>;
        fn sum() -> u32 { return two.x + two.y; }
        @compute @workgroup_size(1) fn fill() { out[0] = sum(); }";
    let small = self::package("", text);
    let two = || Uniform::new(UVec2::new(3, 5));
    small.function("sum").with("two", two()).over(()).agrees_with(|| 8_u32, Abs(0.0));
    let filled = small.compute().with("two", two()).with("out", Storage::new([0_u32]));
    filled.dispatch("fill", [1, 1, 1]).after("out").agrees_with([8_u32], Abs(0.0));
}

/// A wrong fixture is reported before a dispatch, with the line that declares the variable.
// Lesson 121
#[test]
fn mistakes_are_reported_with_the_line_of_the_variable() {
    let text = "@group(0) @binding(0) var image: texture_2d<u32>;\n\
         @group(0) @binding(1) var<storage, read> table: array<vec4f>;\n\
         @group(0) @binding(2) var filtering: sampler;\n\
         @group(0) @binding(3) var shadow: texture_depth_2d;\n\
         fn f(i: u32) -> u32 { return textureLoad(image, vec2u(i, 0u), 0).x; }\n\
         fn g(i: u32) -> f32 { return table[i].x; }\n\
         fn h(i: u32) -> f32 { return textureLoad(shadow, vec2u(i, 0u), 0); }";
    let package = package("", text);
    let told = |function: &str, name: &str, fixture: Option<Fixture>, parts: &[&str]| {
        let probe = package.function(function);
        let probe = match fixture {
            Some(fixture) => probe.with(name, fixture),
            None => probe,
        };
        let error = match function {
            "f" => probe.over(Just(0_u32)).unrecorded().try_agrees_with(|_: u32| 0_u32, Abs(0.0)),
            _ => probe.over(Just(0_u32)).unrecorded().try_agrees_with(|_: u32| 0.0_f64, Abs(0.0)),
        };
        let error = error.expect_err("the fixture is wrong").to_string();
        for part in parts {
            assert!(error.contains(part), "{part} in:\n{error}");
        }
    };
    told("f", "", None, &["<r>:2:23", "`image` (texture_2d<u32>) has no fixture"]);
    told(
        "f",
        "image",
        Some(ramp().into()),
        &["<r>:2:23", "`image` is a texture_2d<u32>", "a Texture for `texture_2d<f32>`"],
    );
    told(
        "f",
        "image",
        Some(Sampler::LINEAR.into()),
        &["<r>:2:23", "a Sampler without a comparison"],
    );
    told("f", "imgae", Some(ramp().into()), &["no variable `imgae`", "did you mean `image`"]);
    told(
        "g",
        "table",
        Some(Buffer::zeros(12).into()),
        &["<r>:3:23", "at least 16 bytes, but the fixture has 12"],
    );
    told("h", "shadow", Some(Texture::constant(2.0_f32).into()), &["a texel has the depth 2"]);
    let empty = Texture::from_fn(0, 0, |_, _| 0_u32);
    told("f", "image", Some(empty.into()), &["the fixture of `image` is empty"]);
}

/// An author can declare that a path's compiler refuses a function. If the compiler accepts the function, the check
/// fails.
// Lesson 122
#[test]
fn a_path_that_compiles_nothing_is_declared() {
    let text = "@group(0) @binding(0) var shadow: texture_depth_2d;\n\
         fn f(i: u32) -> f32 { return textureLoad(shadow, vec2u(i, 0u), 0); }\n\
         fn g(i: u32) -> f32 { return f32(i); }";
    let package = package("", text);
    let check = || package.function("f").with("shadow", depths()).over(Integers(0..=1_u32));
    let reference = |i: u32| f64::from(i) / 4.0;
    let plain = check().unrecorded().try_agrees_with(reference, Abs(0.0));
    let paths = karat::unstable::path::selected().expect("some path opens");
    if !paths.contains(&Path::GL) {
        plain.expect("nothing refuses it without GL");
        return;
    }
    let error = plain.expect_err("GL refuses it");
    assert!(error.to_string().contains("not supported in GLSL"), "{error}");
    let values = check().fails_on(Path::GL, "no textureLoad of depths");
    let error =
        values.unrecorded().try_agrees_with(reference, Abs(0.0)).expect_err("it has no values");
    assert!(error.to_string().contains("not supported in GLSL"), "{error}");
    let declared = check().refused_on(Path::GL, "no textureLoad of depths");
    let agreement =
        declared.unrecorded().try_agrees_with(reference, Abs(0.0)).expect("others agree");
    let issues: Vec<_> = agreement.known_issues.iter().map(|i| (i.cases, i.failures)).collect();
    assert_eq!(issues, [(0, 1)]);
    check()
        .refused_on(Path::VULKAN, "nothing")
        .unrecorded()
        .try_agrees_with(reference, Abs(0.0))
        .expect_err("another path is declared");
    let runs = package.function("g").over(Integers(0..=1_u32)).refused_on(Path::GL, "no loads");
    let error =
        runs.unrecorded().try_agrees_with(|i: u32| f64::from(i), Abs(0.0)).expect_err("it runs");
    assert!(error.to_string().contains("remove the `refused_on`"), "{error}");
}

/// A program can match on the error that a wrong fixture causes.
// Lesson 121
#[test]
fn errors_carry_their_source() {
    let package = package("", SAMPLED);
    let probed = karat::unstable::probe::Probed::new(&package, "f").expect("valid");
    let error = karat::unstable::executor::call(&probed, Path::CPU, &[vec![0, 0]], &Vec::new());
    let Err(ProbeError::Fixture(karat::fixture::FixtureError::Declared { cause, .. })) = error
    else {
        panic!("{error:?}");
    };
    assert!(matches!(*cause, karat::fixture::FixtureError::Missing { .. }));
}

/// wgpu's GL can't filter 32-bit floats, so Karat stores filtered textures in 16-bit floats there. If a shader loads
/// texels without a sampler, the texels keep all 32 bits on GL, too.
// Lesson 133
#[test]
fn loaded_texels_have_full_precision() {
    let package = package(
        "",
        "@group(0) @binding(0) var image: texture_2d<f32>;\n\
         fn f(x: u32) -> f32 { return textureLoad(image, vec2u(x, 0u), 0).x; }\n",
    );
    let texels = [0.1_f32, 1.0e9, 1.0 + f32::EPSILON, 65_505.0];
    package
        .function("f")
        .with("image", Texture::from_fn(4, 1, |x, _| texels[x as usize]))
        .over(Integers(0..=3_u32))
        .agrees_with(|x: u32| f64::from(texels[x as usize]), Abs(0.0));
}

/// A uniform buffer that the crate `encase` converts to bytes.
#[derive(encase::ShaderType)]
struct Sun {
    strength: f32,
    #[shader(size(12))]
    samples: u32,
    weights: [Weight; 3],
}

#[derive(Clone, Copy, encase::ShaderType)]
struct Weight {
    #[shader(size(16))]
    share: f32,
}

#[test]
fn buffers_that_encase_writes_are_taken_as_they_are() {
    let package = Package::from_source(
        "sun",
        "struct Weight { @size(16) share: f32 }
         struct Sun { strength: f32, @size(12) samples: u32, weights: array<Weight, 3> }
         @group(0) @binding(0) var<uniform> sun: Sun;
         fn weighted(i: u32) -> f32 { return sun.strength * sun.weights[i].share + f32(sun.samples); }",
    );
    let weights = [0.5, 0.25, 0.125];
    let sun = Sun { strength: 2.0, samples: 3, weights: weights.map(|share| Weight { share }) };
    let mut bytes = encase::UniformBuffer::new(Vec::new());
    bytes.write(&sun).expect("it fits in memory");
    package
        .function("weighted")
        .with("sun", Buffer::from_bytes(bytes.into_inner()))
        .over(Integers(0..=2_u32))
        .agrees_with(|i: u32| 2.0 * f64::from(weights[i as usize]) + 3.0, Abs(0.0));
}

/// In uniform buffers, the columns of a matrix with two rows are 16 bytes apart in GLSL and 8 bytes apart in WGSL. So
/// Karat refuses such a matrix on GL.
#[test]
fn narrow_matrices_are_right_or_refused() {
    let package = Package::from_source(
        "m",
        "struct G { m: mat2x2f, t: f32 }
         @group(0) @binding(0) var<uniform> g: G;
         @group(0) @binding(1) var<storage> s: mat2x2f;
         fn uniform_() -> f32 { return g.m[1].y * 100.0 + g.t; }
         fn stored() -> f32 { return s[1].y; }",
    );
    let bytes: Vec<f32> = vec![1.0, 2.0, 3.0, 4.0, 7.0, 0.0];
    let uniform = package.function("uniform_").with("g", Buffer::from_pod(&bytes));
    let result = uniform.over(()).unrecorded().try_agrees_with(|| 407.0, Abs(0.0));
    let on_gl = karat::unstable::path::selected().expect("paths").contains(&Path::GL);
    match (result, on_gl) {
        (Ok(_), false) => {}
        (Err(error), true) => {
            assert!(error.to_string().contains("GLSL's layout of matrices"), "{error}");
        }
        (other, _) => panic!("{other:?}"),
    }
    let stored = package.function("stored").with("s", Buffer::from_pod(&bytes[..4]));
    stored.over(()).agrees_with(|| 4.0, Abs(0.0));
}
