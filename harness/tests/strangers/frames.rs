//! Frames as game engines draw them. For each kind of pipeline state (blending, culling, depth), a test draws an image
//! that comes out wrong if a path ignores this state.

use glam::{Vec2, Vec3, Vec4};
use karat::Path;
use karat::draw::{
    Blend, BlendComponent, BlendFactor, BlendOperation, Cull, DepthBias, Draw, Format, Mesh,
    Stencil, StencilOperation, Winding,
};
use karat::fixture::Compare;
use karat::prelude::*;
use karat::{Frame, Image};

const SIZE: u32 = 8;

/// A shader whose fragment functions return colours from a uniform buffer.
const FLAT: &str = "
struct Flat { color: vec4f, depth: f32 }
@group(0) @binding(0) var<uniform> flat: array<Flat, 3>;
@vertex fn vertex(@location(0) p: vec3f) -> @builtin(position) vec4f { return vec4f(p, 1.0); }
@fragment fn first() -> @location(0) vec4f { return flat[0].color; }
@fragment fn second() -> @location(0) vec4f { return flat[1].color; }
struct Two { @location(0) a: vec4f, @location(1) b: vec4f }
@fragment fn both() -> Two { return Two(flat[0].color, flat[1].color); }
";

karat::shareable! { struct Flat mirrors FlatMirror { color: Vec4, depth: f32 } }

fn colors(colors: [Vec4; 2]) -> Uniform {
    let flat = |color| Flat { color, depth: 0.0 };
    Uniform::new([flat(colors[0]), flat(colors[1]), flat(Vec4::ZERO)])
}

/// A rectangle in clip coordinates, counter-clockwise.
fn rectangle(from: Vec2, to: Vec2, depth: f32) -> Mesh {
    let corners = [from, Vec2::new(to.x, from.y), to, Vec2::new(from.x, to.y)];
    Mesh::new(corners.map(|corner| corner.extend(depth)).to_vec(), vec![0, 1, 2, 0, 2, 3])
}

fn all(depth: f32) -> Mesh {
    rectangle(Vec2::NEG_ONE, Vec2::ONE, depth)
}

fn left(depth: f32) -> Mesh {
    rectangle(Vec2::NEG_ONE, Vec2::new(0.0, 1.0), depth)
}

/// The frame's image on each driver.
fn images(frame: &Frame<'_>) -> Vec<(Path, Image)> {
    let open = Path::ALL.into_iter().filter(|path| karat::unstable::path::adapter(*path).is_ok());
    let drawn = |path| (path, frame.render(path).unwrap_or_else(|e| panic!("{path}: {e}")));
    let images: Vec<_> = open.map(drawn).collect();
    assert!(!images.is_empty(), "no path opens, so nothing would be checked");
    images
}

fn pixel(image: &Image, x: u32, y: u32) -> Vec4 {
    Vec4::from(image.pixels()[(y * image.width() + x) as usize])
}

/// Checks the colours of one pixel in the left half and of one pixel in the right half, on each driver.
fn expect(frame: &Frame<'_>, at: [Vec4; 2]) {
    for (path, image) in images(frame) {
        let seen = [pixel(&image, 1, 4), pixel(&image, 6, 4)];
        let near = seen.iter().zip(at).all(|(seen, at)| seen.abs_diff_eq(at, 2e-3));
        assert!(near, "{path}: {seen:?}, expected {at:?}");
    }
}

const RED: Vec4 = Vec4::new(1.0, 0.0, 0.0, 1.0);
const GREEN: Vec4 = Vec4::new(0.0, 1.0, 0.0, 1.0);

fn flat() -> Package {
    Package::from_source("flat", FLAT)
}

fn frame(package: &Package) -> Frame<'_> {
    package.frame("", SIZE, SIZE).with("flat", colors([RED, GREEN]))
}

fn red(mesh: Mesh) -> Draw {
    Draw::mesh("vertex", "first", mesh)
}

fn green(mesh: Mesh) -> Draw {
    Draw::mesh("vertex", "second", mesh)
}

// Lesson 130
#[test]
fn targets_have_formats() {
    let package = flat();
    let color = Vec4::new(0.2, 0.25, 2.0, 0.4);
    let of = |format: Format| {
        package
            .frame("", SIZE, SIZE)
            .with("flat", colors([color, GREEN]))
            .formats([format])
            .draw(red(all(0.5)))
    };
    // 8 bits store 0.2 and 0.4 exactly, and 0.25 as 64 / 255; in sRGB 0.2 is 124 / 255, 0.25 is 137 / 255.
    let quarter = 64.0 / 255.0;
    let lacking = [Format::Rgba32Float, Format::R32Float, Format::Rg11b10Ufloat];
    for (format, kept) in [
        (Format::Float, color),
        (Format::Rgba32Float, color),
        (Format::Rgba16Float, Vec4::new(0.199_95, 0.25, 2.0, 0.399_9)),
        (Format::Rg16Float, Vec4::new(0.199_95, 0.25, 0.0, 1.0)),
        (Format::R32Float, Vec4::new(0.2, 0.0, 0.0, 1.0)),
        (Format::Rgba8Unorm, Vec4::new(0.2, quarter, 1.0, 0.4)),
        (Format::Bgra8Unorm, Vec4::new(0.2, quarter, 1.0, 0.4)),
        (Format::Rgba8UnormSrgb, Vec4::new(0.201_56, 0.250_16, 1.0, 0.4)),
        (Format::R8Unorm, Vec4::new(0.2, 0.0, 0.0, 1.0)),
        (Format::Rg8Unorm, Vec4::new(0.2, quarter, 0.0, 1.0)),
        (Format::Rgb10a2Unorm, Vec4::new(205.0 / 1023.0, 256.0 / 1023.0, 1.0, 1.0 / 3.0)),
        // Red and green have six bits of mantissa, and blue has five.
        (Format::Rg11b10Ufloat, Vec4::new(0.199_22, 0.25, 2.0, 1.0)),
    ] {
        for path in
            Path::ALL.into_iter().filter(|path| karat::unstable::path::adapter(*path).is_ok())
        {
            let image = match of(format).render(path) {
                Ok(image) => image,
                // wgpu's GL can't draw into these formats, and returns an error.
                Err(error) if path == Path::GL && lacking.contains(&format) => {
                    assert!(error.to_string().contains("is not renderable"), "{error}");
                    continue;
                }
                Err(error) => panic!("{format:?} on {path}: {error}"),
            };
            let seen = pixel(&image, 3, 3);
            // llvmpipe rounds 204.6 of 1023 to 204.
            let within = if format == Format::Rgb10a2Unorm { 1.0 / 1023.0 } else { 2e-4 };
            assert!(seen.abs_diff_eq(kept, within), "{format:?} on {path}: {seen}, not {kept}");
        }
    }
}

// Lesson 130
#[test]
fn integers_are_targets() {
    let text = "@fragment fn f() -> @location(0) vec4u { return vec4u(7u, 255u, 300u, 2u); }\n\
                @fragment fn g() -> @location(0) vec4i { return vec4i(-5); }\n";
    let package = Package::from_source("integers", text);
    let of = |format, fragment| package.frame("", 2, 2).formats([format]).fragment(fragment);
    for (path, image) in images(&of(Format::Rgba16Uint, "f")) {
        assert_eq!(pixel(&image, 0, 0), Vec4::new(7.0, 255.0, 300.0, 2.0), "{path}");
    }
    for (path, image) in images(&of(Format::R32Sint, "g")) {
        assert_eq!(pixel(&image, 0, 0), Vec4::new(-5.0, 0.0, 0.0, 1.0), "{path}");
    }
}

// Lesson 130
#[test]
fn several_targets_and_depth() {
    let package = flat();
    let frame = frame(&package)
        .formats([Format::Rgba8Unorm, Format::Rgba16Float])
        .draw(Draw::mesh("vertex", "both", left(0.25)));
    expect(&frame.clone(), [RED, Vec4::ZERO]);
    expect(&frame.clone().target(1), [GREEN, Vec4::ZERO]);
    let near = Vec4::new(0.25, 0.0, 0.0, 1.0);
    expect(&frame.depth(), [near, RED]);
    let alone = package.frame("", SIZE, SIZE).depth().draw(Draw::depth("vertex", left(0.25)));
    expect(&alone, [near, RED]);
}

/// With 4 samples per pixel, a rectangle whose edge goes through a pixel covers only some of the pixel's samples.
// Lesson 130
#[test]
fn pixels_have_samples() {
    let package = flat();
    let third = rectangle(Vec2::NEG_ONE, Vec2::new(0.125, 1.0), 0.5);
    let frame = frame(&package).draw(red(third));
    let at_edge = |image: &Image| pixel(image, 4, 4).x;
    for (path, image) in images(&frame) {
        assert!([0.0, 1.0].contains(&at_edge(&image)), "{path}");
    }
    for (path, image) in images(&frame.samples(4)) {
        assert!((0.2..=0.8).contains(&at_edge(&image)), "{path}: {}", at_edge(&image));
    }
}

// Lesson 129
#[test]
fn faces_are_culled_by_their_winding() {
    let package = flat();
    for (cull, winding, seen) in [
        (Cull::None, Winding::CounterClockwise, true),
        (Cull::Back, Winding::CounterClockwise, true),
        (Cull::Front, Winding::CounterClockwise, false),
        (Cull::None, Winding::Clockwise, true),
        (Cull::Back, Winding::Clockwise, false),
        (Cull::Front, Winding::Clockwise, true),
    ] {
        let draw = red(all(0.5)).cull(cull).front_face(winding);
        let color = if seen { RED } else { Vec4::ZERO };
        expect(&frame(&package).draw(draw), [color, color]);
    }
    expect(&frame(&package).draw(red(all(0.5)).front_face(Winding::Clockwise)), [Vec4::ZERO; 2]);
}

// Lesson 129
#[test]
fn depth_is_compared_written_and_biased() {
    let package = flat();
    let two = |first: Draw, second: Draw| frame(&package).draw(first).draw(second);
    // The red rectangle covers the left half of the green one.
    expect(&two(red(left(0.25)), green(all(0.5))), [RED, GREEN]);
    let unwritten = red(left(0.25)).depth_write(false);
    expect(&two(unwritten, green(all(0.5))), [GREEN, GREEN]);
    let always = green(all(0.5)).depth_compare(Compare::Always);
    expect(&two(red(left(0.25)), always), [GREEN, GREEN]);
    // With reversed depth, nearer pixels have larger values.
    let reversed = |draw: Draw| draw.depth_compare(Compare::GreaterEqual);
    let both = two(reversed(red(left(0.25))), reversed(green(all(0.5))));
    expect(&both.clone().clear_depth(0.0), [GREEN, GREEN]);
    expect(&both, [Vec4::ZERO, Vec4::ZERO]);
    // At equal depths the later draw is visible, unless a bias moves it back.
    expect(&two(red(left(0.5)), green(all(0.5))), [GREEN, GREEN]);
    let bias = DepthBias { constant: 1000, slope: 0.0, clamp: 0.0 };
    expect(&two(red(left(0.5)), green(all(0.5)).depth_bias(bias)), [RED, GREEN]);
}

// Lesson 129
#[test]
fn stencils_are_written_and_compared() {
    let package = flat();
    let written = Stencil { reference: 5, pass: StencilOperation::Replace, ..Stencil::default() };
    let equal = |reference| Stencil { compare: Compare::Equal, reference, ..Stencil::default() };
    let draws = |first: Stencil, second: Stencil| {
        frame(&package)
            .draw(red(left(0.5)).stencil(first).write_mask(0, ""))
            .draw(green(all(0.25)).stencil(second))
    };
    expect(&draws(written, equal(5)), [GREEN, Vec4::ZERO]);
    expect(&draws(written, equal(0)), [Vec4::ZERO, GREEN]);
    expect(&draws(Stencil::default(), equal(0)), [GREEN, GREEN]);
    let masked = Stencil { write_mask: 1, ..written };
    expect(&draws(masked, equal(1)), [GREEN, Vec4::ZERO]);
    let low_bits = Stencil { read_mask: 1, ..equal(3) };
    expect(&draws(written, low_bits), [GREEN, Vec4::ZERO]);
    let more = Stencil { pass: StencilOperation::Increment, ..Stencil::default() };
    expect(&draws(more, equal(1)), [GREEN, Vec4::ZERO]);
    let behind = Stencil { depth_fail: StencilOperation::Invert, ..Stencil::default() };
    let hidden = frame(&package)
        .draw(red(all(0.1)))
        .draw(red(left(0.5)).stencil(behind))
        .draw(green(all(0.05)).stencil(equal(255)));
    expect(&hidden, [GREEN, RED]);
}

// Lesson 129
#[test]
fn pixels_are_blended() {
    let package = flat();
    let (old, new) = (Vec4::new(0.5, 0.25, 1.0, 0.75), Vec4::new(0.25, 0.5, 0.75, 0.5));
    let frame = |blend: Blend| {
        package
            .frame("", SIZE, SIZE)
            .with("flat", colors([new, old]))
            .draw(green(all(0.5)))
            .draw(red(left(0.25)).blend(blend).blend_constant([0.25, 0.5, 1.0, 0.5]))
    };
    let both = |src_factor, dst_factor, operation| {
        let component = BlendComponent { src_factor, dst_factor, operation };
        Blend::Custom { color: component, alpha: component }
    };
    use BlendFactor::{
        Constant, Dst, DstAlpha, One, OneMinusConstant, OneMinusDst, OneMinusDstAlpha, OneMinusSrc,
        Src, SrcAlpha, SrcAlphaSaturated, Zero,
    };
    let constant = Vec4::new(0.25, 0.5, 1.0, 0.5);
    let add = BlendOperation::Add;
    for (blend, expected) in [
        (Blend::Replace, new),
        (Blend::Add, old + new),
        (Blend::Alpha, (new * 0.5 + old * 0.5).truncate().extend(0.5 + 0.75 * 0.5)),
        (Blend::Premultiplied, new + old * 0.5),
        (Blend::Multiply, new * old),
        (both(Zero, OneMinusSrc, add), old * (1.0 - new)),
        (both(Src, Dst, add), new * new + old * old),
        (both(OneMinusDst, Zero, add), new * (1.0 - old)),
        (both(DstAlpha, OneMinusDstAlpha, add), new * 0.75 + old * 0.25),
        (both(Constant, OneMinusConstant, add), new * constant + old * (1.0 - constant)),
        (both(SrcAlphaSaturated, One, add), (new * 0.25 + old).truncate().extend(new.w + old.w)),
        (both(One, One, BlendOperation::Subtract), new - old),
        (both(One, One, BlendOperation::ReverseSubtract), old - new),
        (both(One, One, BlendOperation::Min), new.min(old)),
        (both(One, One, BlendOperation::Max), new.max(old)),
        (
            Blend::Custom {
                color: BlendComponent { src_factor: SrcAlpha, dst_factor: Zero, operation: add },
                alpha: BlendComponent { src_factor: One, dst_factor: Zero, operation: add },
            },
            (new * 0.5).truncate().extend(0.5),
        ),
    ] {
        for (path, image) in images(&frame(blend)) {
            let seen = [pixel(&image, 1, 4), pixel(&image, 6, 4)];
            assert!(
                seen[0].abs_diff_eq(expected, 2e-3),
                "{blend:?} on {path}: {seen:?}, not {expected}"
            );
            assert!(seen[1].abs_diff_eq(old, 2e-3), "{blend:?} on {path}: {seen:?}");
        }
    }
}

// Lesson 129
#[test]
fn targets_are_blended_and_masked_apart() {
    let package = flat();
    let draw = |mesh| Draw::mesh("vertex", "both", mesh);
    let twice = frame(&package)
        .formats([Format::Rgba16Float; 2])
        .draw(draw(all(0.5)))
        .draw(draw(left(0.25)).blend_target(1, Blend::Add).write_mask(0, "rb"));
    expect(&twice, [RED, RED]);
    expect(&twice.clone().target(1), [GREEN * 2.0, GREEN]);
    let masked = frame(&package)
        .formats([Format::Rgba16Float; 2])
        .clear([0.5; 4])
        .draw(draw(left(0.25)).write_mask(0, "gb"));
    expect(&masked, [Vec4::new(0.5, 0.0, 0.0, 0.5), Vec4::splat(0.5)]);
}

const INSTANCES: &str = "
struct Out { @builtin(position) clip: vec4f, @location(0) color: vec4f }
@vertex fn vertex(
    @location(0) p: vec3f,
    @location(1) offset: vec2f,
    @location(2) id: u32,
    @builtin(instance_index) instance: u32,
    @builtin(vertex_index) index: u32,
) -> Out {
    return Out(vec4f(p.xy + offset, p.z, 1.0), vec4f(f32(id), f32(instance), f32(index / 4u), 1.0));
}
@fragment fn fragment(in: Out) -> @location(0) vec4f { return in.color; }
@vertex fn plain(@builtin(vertex_index) i: u32, @builtin(instance_index) n: u32) -> Out {
    let p = vec2f(f32(i % 3u & 1u), f32(i % 3u >> 1u)) * 4.0 - 1.0;
    return Out(vec4f(p, 0.5, 1.0), vec4f(f32(i / 3u), f32(n), 0.0, 1.0));
}
";

// Lesson 131
#[test]
fn copies_have_attributes_and_numbers() {
    let package = Package::from_source("instances", INSTANCES);
    let mesh = || {
        left(0.5)
            .instance_attribute(1, &[Vec2::ZERO, Vec2::X, Vec2::new(1.0, 4.0)])
            .instance_attribute(2, &[7_u32, 9, 11])
    };
    let draw = || Draw::mesh("vertex", "fragment", mesh());
    let frame = |draw: Draw| package.frame("", SIZE, SIZE).draw(draw);
    let color = |id: f32, instance: f32, set: f32| Vec4::new(id, instance, set, 1.0);
    let two = [color(7.0, 0.0, 0.0), color(9.0, 1.0, 0.0)];
    expect(&frame(draw().instances(2)), two);
    expect(&frame(draw().instances(2).u16_indices()), two);
    expect(&frame(draw().instances(2).indirect()), two);
    expect(&frame(draw()), [two[0], Vec4::ZERO]);
    let vertices = |draw: &str| Draw::vertices(draw, "fragment", 3);
    expect(&frame(vertices("plain")), [color(0.0, 0.0, 0.0); 2]);
    let error = frame(draw().instances(4)).render(Path::ALL[0]).expect_err("3 values").to_string();
    assert!(
        error.contains("makes 4 copies of a mesh, beginning with copy 0, but an attribute has values for only 3 copies"),
        "{error}"
    );
}

/// The test runs only on Vulkan, because shaders see wrong instance and vertex indices on wgpu's GL if the indices
/// don't begin at 0.
// Lesson 131
#[test]
fn instance_and_vertex_indices_begin_at_the_given_offset() {
    if karat::unstable::path::adapter(Path::VULKAN).is_err() {
        return;
    }
    let package = Package::from_source("instances", INSTANCES);
    let seen = |draw: Draw| {
        let image = package.frame("", SIZE, SIZE).draw(draw).render(Path::VULKAN);
        pixel(&image.expect("it is drawn"), 1, 4)
    };
    let plain = || Draw::vertices("plain", "fragment", 3);
    assert_eq!(seen(plain().first_instance(2)), Vec4::new(0.0, 2.0, 0.0, 1.0));
    assert_eq!(seen(plain().base_vertex(6)), Vec4::new(2.0, 0.0, 0.0, 1.0));
    assert_eq!(
        seen(plain().base_vertex(3).first_instance(5).indirect()),
        Vec4::new(1.0, 5.0, 0.0, 1.0)
    );
}

// Lesson 131
#[test]
fn frames_read_frames() {
    let text = "
@group(0) @binding(0) var before: texture_2d<f32>;
@group(0) @binding(1) var shadow_map: texture_depth_2d;
@group(0) @binding(2) var comparing: sampler_comparison;
@vertex fn vertex(@location(0) p: vec3f) -> @builtin(position) vec4f { return vec4f(p, 1.0); }
@fragment fn ramp(@location(0) uv: vec2f) -> @location(0) vec4f { return vec4f(uv, 0.0, 1.0); }
@fragment fn doubled(@builtin(position) p: vec4f) -> @location(0) vec4f {
    return 2.0 * textureLoad(before, vec2u(p.xy), 0);
}
@fragment fn lit(@location(0) uv: vec2f) -> @location(0) vec4f {
    return vec4f(textureSampleCompare(shadow_map, comparing, uv, 0.5));
}
";
    let package = Package::from_source("passes", text);
    let ramp = || package.frame("", SIZE, SIZE).fragment("ramp");
    let (near, far) =
        (Vec4::new(1.5 / 8.0, 4.5 / 8.0, 0.0, 1.0), Vec4::new(6.5 / 8.0, 4.5 / 8.0, 0.0, 1.0));
    expect(&ramp(), [near, far]);
    let twice = package.frame("", SIZE, SIZE).with_frame("before", ramp()).fragment("doubled");
    expect(&twice, [2.0 * near, 2.0 * far]);
    let again = package.frame("", SIZE, SIZE).with_frame("before", twice).fragment("doubled");
    expect(&again, [4.0 * near, 4.0 * far]);

    let shadow = package.frame("", SIZE, SIZE).draw(Draw::depth("vertex", left(0.25))).depth();
    let lit = package
        .frame("", SIZE, SIZE)
        .with_frame("shadow_map", shadow)
        .with("comparing", Sampler::NEAREST.compare(Compare::Less))
        .fragment("lit");
    expect(&lit, [Vec4::ZERO, Vec4::ONE]);
}

// Lesson 131
#[test]
fn members_of_buffers_are_inputs() {
    let text = "struct Light { color: vec3f, power: f32 }\n\
        struct Globals { time: f32, light: Light, frame_count: u32 }\n\
        @group(0) @binding(0) var<uniform> globals: Globals;\n\
        @fragment fn f() -> @location(0) vec4f {\n    \
        return vec4f(globals.time, globals.light.power, f32(globals.frame_count), globals.light.color.y);\n}\n";
    let package = Package::from_source("globals", text);
    let frame = || package.frame("", SIZE, SIZE).fragment("f");
    let set = frame().set("globals.time", 1.5_f32).set("globals.frame_count", 90_u32);
    expect(&set, [Vec4::new(1.5, 0.0, 90.0, 0.0); 2]);
    let light = frame()
        .set("globals.light.color", Vec3::new(0.0, 0.5, 0.0))
        .set("globals.light.power", 3.0_f32);
    expect(&light, [Vec4::new(0.0, 3.0, 0.0, 0.5); 2]);
    for (frame, part) in [
        (frame().set("globals.tme", 1.0_f32), "no member `tme`; did you mean `time`?"),
        (frame().set("global.time", 1.0_f32), "did you mean `globals`?"),
        (frame().set("globals.time", 1_u32), "`time` is f32, but the value is u32"),
        (frame().set("globals.time.x", 1.0_f32), "has no members"),
    ] {
        let error = frame.render(Path::ALL[0]).expect_err(part).to_string();
        assert!(error.contains(part), "{error}");
    }
}

// Lesson 131
#[test]
fn frames_that_no_device_draws_are_errors() {
    let package = Package::from_source(
        "wrong",
        [
            FLAT,
            "@fragment fn colored(@location(1) c: vec3f) -> @location(0) vec4f { return c.xyzz; }",
        ]
        .concat(),
    );
    let frame = || package.frame("", SIZE, SIZE).with("flat", colors([RED, GREEN]));
    let depth = || Draw::depth("vertex", all(0.5));
    for (frame, part) in [
        (frame(), "draws nothing"),
        (frame().draw(red(all(0.5))).draw(depth()), "some of its draws write only depth"),
        (frame().draw(depth()), "add `depth` to compare"),
        (
            frame().draw(red(all(0.5))).target(1),
            "the frame has 1 target, counted from 0, so it can't show target 1",
        ),
        (
            frame().draw(red(all(0.5)).write_mask(1, "r")),
            "target 1, but the frame's number of targets is 1",
        ),
        (frame().draw(red(all(0.5))).depth().samples(4), "several samples"),
        (package.frame("", 2, 2).fragment("colored"), "at @location(1) isn't a vec2f"),
        (
            frame().with_frame("falt", frame().draw(red(all(0.5)))).draw(red(all(0.5))),
            "did you mean `flat`?",
        ),
    ] {
        let error = frame.render(Path::ALL[0]).expect_err(part).to_string();
        assert!(error.contains(part), "{part}: {error}");
    }
}

/// Each target of a frame needs an output of the fragment function, and each output needs a target. Otherwise Karat
/// reports an error.
#[test]
fn targets_and_outputs_are_the_same() {
    let package = Package::from_source(
        "m",
        "override GAIN: f32;
         struct Both { @location(0) a: vec4f, @location(1) b: vec4f }
         @fragment fn both(@location(0) uv: vec2f) -> Both { return Both(vec4f(uv, 0.0, 1.0), vec4f(0.5)); }
         @fragment fn second(@location(0) uv: vec2f) -> @location(1) vec4f { return vec4f(uv, 0.0, 1.0); }
         @fragment fn depth(@location(0) uv: vec2f) -> @builtin(frag_depth) f32 { return uv.x; }
         @fragment fn one(@location(0) uv: vec2f) -> @location(0) f32 { return 1.0 + uv.x; }
         @fragment fn two(@location(0) uv: vec2f) -> @location(0) vec2f { return 1.0 + uv; }
         @fragment fn whole() -> @location(0) vec4u { return vec4u(7u); }
         @fragment fn gained() -> @location(0) vec4f { return vec4f(GAIN); }",
    );
    let frame = |fragment: &str| package.frame("", 4, 4).fragment(fragment);
    let two = [Format::Float, Format::Float];
    for (frame, part) in [
        (frame("both"), "`both` writes @location(1), but the frame has 1 target: add `formats`"),
        (frame("second"), "`second` writes nothing at @location(0)"),
        (frame("second").formats(two), "`second` writes nothing at @location(0)"),
        (frame("depth"), "`depth` writes nothing at @location(0)"),
        (frame("whole"), "`whole` writes unsigned integers at @location(0)"),
        (frame("one").formats([Format::Rgba32Uint]), "`one` writes floats at @location(0)"),
        (frame("gained"), "the override `GAIN` has no value"),
        (frame("one").with_override("GIAN", 2.0), "no override `GIAN`"),
        (frame("one").samples(3), "it has 3 samples a pixel"),
        (frame("one").depth(), "it shows depth, but none of its draws writes depth"),
    ] {
        let error = frame.render(Path::VULKAN).expect_err(part).to_string();
        assert!(error.contains(part), "no `{part}` in:\n{error}");
    }
    // Masked channels keep the clear value.
    let masked = package.frame("", 4, 4).formats(two);
    let masked = masked.draw(Draw::fragment("second").write_mask(0, "")).target(1);
    for (_, image) in images(&masked) {
        assert_eq!(pixel(&image, 3, 0).x, 0.875);
    }
    for (_, image) in images(&frame("both").formats(two).target(1)) {
        assert_eq!(pixel(&image, 1, 1), Vec4::splat(0.5));
    }
    // A draw with only a fragment function writes the depth that the function returns.
    let depth = package.frame("", 4, 4).draw(Draw::fragment("depth").write_mask(0, "")).depth();
    for (_, image) in images(&depth) {
        assert_eq!(pixel(&image, 3, 0).x, 0.875);
    }
    // A target has as many components as its output.
    for (_, image) in images(&frame("one")) {
        assert_eq!(pixel(&image, 3, 0).truncate(), Vec3::new(1.875, 0.0, 0.0));
    }
    for (_, image) in images(&frame("two")) {
        assert_eq!(pixel(&image, 3, 1).truncate(), Vec3::new(1.875, 1.375, 0.0));
    }
    for (_, image) in images(&frame("whole").formats([Format::Rgba32Uint])) {
        assert_eq!(pixel(&image, 0, 0), Vec4::splat(7.0));
    }
    for (_, image) in images(&frame("gained").with_override("GAIN", 0.25)) {
        assert_eq!(pixel(&image, 0, 0), Vec4::splat(0.25));
    }
}

/// Karat doesn't compare integers and depths as colours: integers must be equal, and depths must be equal within
/// rounding.
#[test]
fn integers_and_depths_are_no_colours() {
    let project = super::values::Project::new();
    let package = |id: &str, depth: &str| {
        let text = format!(
            "@fragment fn ids(@builtin(position) p: vec4f) -> @location(0) u32 {{
                 return select(150u, {id}, p.x < 3.0 && p.y < 3.0);
             }}
             @fragment fn depth() -> @builtin(frag_depth) f32 {{ return {depth}; }}"
        );
        Package::from_source("m", text)
    };
    let drawn = |package: &Package, case: &str| match case {
        "ids" => {
            let frame = package.frame("", 64, 64).formats([Format::R32Uint]).fragment("ids");
            frame.unrecorded().try_matches(&project.goldens, case).map(|_| ())
        }
        _ => {
            let frame = package.frame("", 64, 64).fragment("depth").depth();
            frame.unrecorded().try_matches(&project.goldens, case).map(|_| ())
        }
    };
    let first = package("5000u", "0.9990");
    for case in ["ids", "depths"] {
        drawn(&first, case).expect_err("no golden");
        project.accept(case);
        drawn(&first, case).expect("the same");
    }
    let facts = project.facts("ids");
    assert!(facts.contains("[modules]\npackage = \""), "what made it is kept: {facts}");
    // A few pixels differ by one, which would be invisible in a colour. A surface is a tenth farther away.
    drawn(&package("5001u", "0.9990"), "ids").expect_err("another integer");
    drawn(&package("5000u", "0.9991"), "depths").expect_err("another depth");
    let large = drawn(&package("16777217u", "0.9990"), "ids").expect_err("no float is it");
    assert!(large.to_string().contains("its target contains 16777217"), "{large}");
    let signed =
        Package::from_source("m", "@fragment fn f() -> @location(0) vec4i { return vec4i(1); }");
    let frame = signed.frame("", 4, 4).formats([Format::R32Uint]).fragment("f");
    let error = frame.render(Path::ALL[0]).expect_err("another type").to_string();
    assert!(error.contains("`f` writes signed integers at @location(0)"), "{error}");
}
