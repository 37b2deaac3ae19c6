//! Tests of `tap` and `trace`: each value of a fragment function comes from the right pixel and the right draw.

use glam::{Vec2, Vec3};
use karat::draw::{Blend, Draw, Format, Mesh};
use karat::prelude::*;
use karat::unstable::frame::{Tap, TapError, Tapped};
use karat::{Frame, Path};

const SHADER: &str = "
struct Inputs { @location(0) uv: vec2f, @builtin(position) at: vec4f }

fn wave(x: f32, steps: u32) -> f32 {
    var sum = 0.0;
    for (var i = 0u; i < steps; i += 1u) {
        let term = x * f32(i + 1u);
        sum += term;
    }
    return sum;
}

@fragment
fn fragment(in: Inputs) -> @location(0) vec4f {
    let column = u32(in.at.x);
    let is_left = column < 2u;
    if (is_left) {
        return vec4f(0.25);
    }
    let direction = normalize(vec3f(in.uv, 1.0));
    let sum = wave(in.uv.x, column);
    let twice = mat2x2f(in.uv, in.uv + 1.0);
    if (in.at.y < 1.0) {
        discard;
    }
    let none = 2.0;
    return vec4f(sum * none, direction.xy, determinant(twice));
}

@fragment
fn red(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let from_red = at.x + 100.0;
    return vec4f(from_red, 0.0, 0.0, 0.5);
}

struct Two { @location(0) a: vec4f, @location(1) b: vec4f, @builtin(frag_depth) depth: f32 }

@fragment
fn two(@builtin(position) at: vec4f) -> Two {
    let depth = 0.5 * at.x / 4.0;
    return Two(vec4f(1.0), vec4f(2.0), depth);
}

@vertex
fn vertex(@location(0) position: vec3f, @builtin(instance_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(position.x + f32(i), position.y, position.z, 1.0);
}

@group(0) @binding(0) var<uniform> tint: vec4f;
@group(0) @binding(1) var<uniform> other: vec4f;
struct Pair { few: f32, many: vec2u }

@fragment
fn tinted(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let ternary = select(at.x, at.y, at.x > at.y);
    let same = ternary;
    let pair = Pair(at.x, vec2u(16777217u, 7u));
    let wide = fwidth(at.y * 3.0);
    return tint + ternary + wide + pair.few + same;
}

@fragment
fn behind() -> @location(0) vec4f {
    return other;
}

@fragment
fn slopes(@location(0) uv: vec2f) -> @location(0) vec4f {
    let across = dpdx(uv.x);
    return vec4f(across);
}

@fragment
fn bent(@location(0) uv: vec2f, @builtin(position) at: vec4f) -> @location(0) vec4f {
    let across = dpdx(uv.x * uv.x);
    let down = dpdy(at.y * at.y * uv.x);
    return vec4f(across, down, fwidth(at.x * at.x), 1.0);
}

@group(0) @binding(9) var<storage, read_write> log: array<f32, 4>;

@fragment
fn logged(@location(0) uv: vec2f) -> @location(0) vec4f {
    log[0] = uv.x;
    return vec4f(dpdx(uv.x));
}

@fragment
fn steep(@builtin(position) at: vec4f) -> @location(0) vec4f {
    return vec4f(dpdx(at.x));
}

@fragment
fn nothing() -> @location(0) vec4f {
    let nothing = vec4f(0.25);
    return nothing;
}
";

fn package() -> Package {
    Package::from_source("m", SHADER)
}

fn drivers() -> Vec<Path> {
    let all = karat::unstable::path::selected().expect("paths are open");
    all.into_iter().filter(|path| *path != Path::CPU).collect()
}

fn tapped(frame: &Frame<'_>, path: Path, tap: &Tap) -> Tapped {
    frame.tap(path, tap).unwrap_or_else(|error| panic!("{tap:?} on {path}: {error}"))
}

fn floats(tapped: &Tapped) -> Vec<f32> {
    tapped.lanes.iter().map(|lane| f32::from_bits(*lane)).collect()
}

/// Draws the frame of 4 x 2 pixels on each driver, and calls `check` with the value that `tap` reads on each pixel.
fn each(frame: impl Fn(&Package) -> Frame<'_>, tap: &Tap, check: impl Fn(&Tapped)) {
    let package = package();
    let drivers = drivers();
    assert!(!drivers.is_empty(), "there is a driver");
    for path in drivers {
        check(&tapped(&frame(&package), path, tap));
    }
}

fn plain(package: &Package) -> Frame<'_> {
    package.frame("", 4, 2).fragment("fragment")
}

// Lesson 38: on each pixel of a frame
#[test]
fn a_value_is_that_of_its_pixel() {
    each(plain, &Tap::new("column"), |tapped| {
        // Two pixels of the upper row are discarded.
        assert_eq!(tapped.lanes, [0, 1, 0, 0, 0, 1, 2, 3]);
        assert_eq!(tapped.times[..4], [Some(1), Some(1), None, None]);
        assert_eq!((&*tapped.function, &*tapped.text), ("fragment", "u32(in.at.x)"));
        assert_eq!(tapped.changed, None);
    });
    each(plain, &Tap::new("column").beside(true), |tapped| {
        assert_eq!((tapped.changed, tapped.lanes[7]), (Some(0), 3));
    });
    each(plain, &Tap::new("is_left"), |tapped| {
        assert_eq!(tapped.lanes, [1, 1, 0, 0, 1, 1, 0, 0]);
        assert_eq!(tapped.told[6..], [true; 2], "false is a value");
    });
    each(plain, &Tap::new("in.uv + 1.0"), |tapped| {
        let uv = floats(tapped);
        assert_eq!(&uv[..4], [0.0; 4]);
        assert_eq!(&uv[14..], [1.875, 1.75]);
    });
}

#[test]
fn a_pixel_that_skips_a_line_has_no_value() {
    each(plain, &Tap::new("direction"), |tapped| {
        assert_eq!(tapped.told, [false, false, false, false, false, false, true, true]);
        assert_eq!(tapped.times[4..], [Some(0), Some(0), Some(1), Some(1)]);
        assert_eq!(tapped.lanes[..3], [0; 3]);
    });
    // A discarded pixel has no draw.
    each(plain, &Tap::new("in.at.y < 1.0"), |tapped| {
        assert_eq!(
            tapped.times,
            [Some(0), Some(0), None, None, Some(0), Some(0), Some(1), Some(1)]
        );
    });
}

// Lesson 38: on each pixel of a frame
#[test]
fn each_round_of_a_loop_has_its_value() {
    let term = |round| Tap::new("term").round(round);
    // In columns 2 and 3, uv.x is 0.625 and 0.875, and the loop has 2 and 3 iterations.
    each(plain, &term(None), |tapped| {
        assert_eq!(floats(tapped)[6..], [1.25, 2.625]);
        assert_eq!(tapped.times[6..], [Some(2), Some(3)]);
    });
    each(plain, &term(Some(1)), |tapped| assert_eq!(floats(tapped)[6..], [0.625, 0.875]));
    each(plain, &term(Some(3)), |tapped| {
        assert_eq!(tapped.told[6..], [false, true]);
        assert_eq!(floats(tapped)[6..], [0.0, 2.625]);
    });
}

#[test]
fn values_of_each_type_are_read() {
    each(plain, &Tap::new("twice"), |tapped| {
        assert_eq!(floats(tapped)[28..], [0.875, 0.75, 1.875, 1.75]);
    });
    each(plain, &Tap::new("in"), |tapped| {
        assert_eq!(tapped.shape.lanes().len(), 6);
        assert_eq!(floats(tapped)[42..46], [0.875, 0.75, 3.5, 1.5]);
    });
    each(plain, &Tap::new("x"), |tapped| assert_eq!(floats(tapped)[6..], [0.625, 0.875]));
}

/// A rectangle over the left half of the frame.
fn half() -> Mesh {
    let corners = [Vec2::NEG_ONE, Vec2::new(0.0, -1.0), Vec2::new(-1.0, 3.0), Vec2::new(0.0, 3.0)];
    let corners = corners.map(|corner| Vec3::new(corner.x, corner.y, 0.5)).to_vec();
    Mesh::new(corners, vec![0, 1, 2, 2, 1, 3])
}

fn both(package: &Package) -> Frame<'_> {
    let draw = Draw::mesh("vertex", "red", half()).instances(1);
    package.frame("", 4, 2).draw(Draw::fragment("nothing")).draw(draw.blend(Blend::Alpha))
}

// Lesson 38: on each pixel of a frame
#[test]
fn the_visible_draw_gives_the_value() {
    let package = package();
    for path in drivers() {
        let told = tapped(&both(&package).clear([1.0; 4]), path, &Tap::new("from_red"));
        assert_eq!(told.told, [true, true, false, false, true, true, false, false], "{path}");
        assert_eq!(floats(&told)[..2], [100.5, 101.5]);
        assert_eq!(told.times[2], Some(0), "the other draw covers it");
        // Two instances cover the whole frame.
        let draw = Draw::mesh("vertex", "red", half()).instances(2);
        let copies = tapped(&package.frame("", 4, 2).draw(draw), path, &Tap::new("from_red"));
        assert_eq!(floats(&copies)[..4], [100.5, 101.5, 102.5, 103.5]);
        // The right half has only the clear colour, so it has no value.
        let draw = Draw::mesh("vertex", "red", half()).instances(1);
        let alone = package.frame("", 4, 2).clear([1.0; 4]).draw(draw);
        assert_eq!(tapped(&alone, path, &Tap::new("from_red")).times[2..4], [None, None]);
        let samples = package.frame("", 4, 2).samples(4).draw(Draw::mesh("vertex", "red", half()));
        let samples = tapped(&samples, path, &Tap::new("from_red"));
        assert_eq!((samples.changed, &floats(&samples)[..2]), (None, &[100.5, 101.5][..]));
    }
}

#[test]
fn several_targets_and_depth_stay() {
    let package = package();
    let frame = package.frame("", 4, 2).formats([Format::Rgba8Unorm, Format::Rgba16Float]);
    let frame = frame.fragment("two");
    for path in drivers() {
        let told = tapped(&frame, path, &Tap::new("depth"));
        assert_eq!(floats(&told)[..4], [0.0625, 0.1875, 0.3125, 0.4375]);
        let beside = Tap::new("depth").beside(true);
        assert!(matches!(frame.tap(path, &beside), Err(TapError::Beside)));
    }
}

/// Karat reads several values in one draw, up to 32 bytes per pixel. Each value is the same as if Karat read only this
/// value.
// Lesson 214
#[test]
fn values_read_in_one_draw_equal_values_read_alone() {
    let package = package();
    let frame = plain(&package);
    let names = ["column", "sum", "term", "in", "column"];
    for path in drivers() {
        let taps = names.map(Tap::new);
        let all = frame.taps(path, &taps).unwrap_or_else(|error| panic!("{path}: {error}"));
        assert_eq!(all.len(), names.len());
        for (tap, together) in taps.iter().zip(&all) {
            let alone = tapped(&frame, path, tap);
            assert_eq!(
                (&together.lanes, &together.times),
                (&alone.lanes, &alone.times),
                "{path} {tap:?}"
            );
        }
        let beside = taps.map(|tap| tap.beside(true));
        let beside = frame.taps(path, &beside).expect("it has one target");
        assert!(
            beside.iter().zip(&all).all(|(a, b)| a.lanes == b.lanes && a.changed == Some(0)),
            "{path}"
        );
        // If one value is unknown, Karat refuses all values.
        let wrong = frame.taps(path, &[Tap::new("column"), Tap::new("colunm")]);
        assert!(wrong.is_err_and(|error| error.to_string().contains("did you mean `column`?")));
    }
}

#[test]
fn places_name_the_largest_expression() {
    let package = package();
    let file = tapped(&plain(&package), drivers()[0], &Tap::new("column")).span.file.name.clone();
    let line = SHADER.lines().position(|line| line.contains("let sum")).expect("it is there") + 1;
    let error = |wanted: &str| {
        let error = plain(&package).tap(drivers()[0], &Tap::new(wanted)).expect_err(wanted);
        error.to_string()
    };
    let of = |wanted: &str| {
        let told = tapped(&plain(&package), drivers()[0], &Tap::new(wanted));
        told.text
    };
    assert_eq!(of(&format!("{file}:{line}")), "wave(in.uv.x, column)");
    assert_eq!(of(&format!("{file}:{line}:9")), "wave(in.uv.x, column)", "on the name of the let");
    assert_eq!(of(&format!("{file}:{line}:15")), "wave(in.uv.x, column)");
    assert_eq!(of(&format!("{file}:{line}:20")), "in.uv.x");
    let between = error(&format!("{file}:{line}:11"));
    assert!(
        between.contains("this line has the values")
            && between.contains("fragment::sum: f32 = wave(in.uv.x, column)")
    );
    assert!(error("collumn").contains("did you mean `column`?"));
    let several = error("in.uv");
    assert!(several.contains("matches 4 values: choose one"), "{several}");
    assert_eq!(of("wave::term"), "x * f32(i + 1u)");
    assert!(error("ave::term").contains("computes no value `ave::term`"));
    let elsewhere = error("other.wgsl:3");
    assert!(elsewhere.contains("run no code in this file"), "{elsewhere}");
}

/// The names and values of the named steps of a trace. The values are converted to `f32`, to compare them with the
/// values of `tap`.
fn named_steps(traced: &karat::unstable::frame::TracedPixel) -> Vec<(String, Vec<f32>)> {
    use karat::unstable::trace::Value;
    let float = |value: &Value| match value {
        Value::Single(x) => *x,
        #[expect(clippy::cast_precision_loss, reason = "they are small")]
        Value::Int(x) => *x as f32,
        _ => f32::NAN,
    };
    let steps = traced.steps.iter();
    let named = steps.filter_map(|step| Some((step.name.clone()?, &step.single)));
    named.map(|(name, values)| (name, values.iter().map(float).collect())).collect()
}

/// In a trace of a pixel, the engine computes the same values and the same colour as the driver.
// Lesson 39
#[test]
fn a_traced_pixel_is_the_drawn_one() {
    let package = package();
    for path in drivers() {
        let frame = plain(&package);
        for pixel in [(0, 0), (2, 1), (3, 1)] {
            let traced = frame.trace(path, pixel).unwrap_or_else(|error| panic!("{path}: {error}"));
            assert_eq!(traced.function, "fragment");
            let (x, y) = (pixel.0 as f32, pixel.1 as f32);
            let uv = format!("uv: ({}, {})", (x + 0.5) / 4.0, (y + 0.5) / 2.0);
            assert!(traced.arguments[0].1.contains(&uv), "{:?}", traced.arguments);
            for (name, single) in named_steps(&traced) {
                if !["direction", "sum", "term"].contains(&&*name) {
                    continue;
                }
                let tapped = tapped(&frame, path, &Tap::new(&name));
                let width = tapped.shape.lanes().len();
                let at = (pixel.1 * 4 + pixel.0) as usize;
                let driver = &floats(&tapped)[at * width..][..width];
                let last = named_steps(&traced).into_iter().rfind(|(other, _)| *other == name);
                let (_, engine) = last.expect("it is there");
                for (a, b) in driver.iter().zip(&engine) {
                    assert!((a - b).abs() <= 1e-6, "{name} at {pixel:?} on {path}: {a}, {b}");
                }
                assert_eq!(single.len(), width);
            }
            let engine: Vec<f32> = traced
                .engine
                .split(|c: char| !(c.is_ascii_digit() || "-.e".contains(c)))
                .filter_map(|number| number.parse().ok())
                .collect();
            assert_eq!(engine.len(), 4, "{}", traced.engine);
            // Some paths draw floats of 16 bits, which have 11 digits.
            for (driver, engine) in traced.driver.iter().zip(&engine) {
                let far = 1e-3 * engine.abs().max(1.0);
                assert!((driver - engine).abs() <= far, "{driver}, {}", traced.engine);
            }
        }
        let none = frame.trace(path, (2, 0)).expect_err("it is discarded");
        assert!(matches!(none, TapError::Undrawn { pixel: (2, 0) }), "{none}");
        let outside = frame.trace(path, (4, 0)).expect_err("there are 4 columns");
        assert!(outside.to_string().contains("4 x 2 pixels"), "{outside}");
    }
}

/// A trace computes derivatives over the pixel's quad. If several draws cover the pixel, the trace shows the visible
/// draw.
// Lesson 39
// Lesson 210
#[test]
fn a_traced_pixel_has_the_derivatives_of_its_quad() {
    let package = package();
    for path in drivers() {
        let slopes = package.frame("", 4, 2).fragment("slopes");
        for pixel in [(0, 0), (3, 1)] {
            let traced =
                slopes.trace(path, pixel).unwrap_or_else(|error| panic!("{path}: {error}"));
            let found = named_steps(&traced).into_iter().find(|(name, _)| name == "across");
            assert_eq!(found.map(|(_, values)| values), Some(vec![0.25]), "{path}");
            assert_eq!(traced.driver[0], 0.25);
            assert!(traced.notes.is_empty(), "{:?}", traced.notes);
        }
        // The value isn't linear, so each pixel of the quad has other derivatives.
        let bent = package.frame("", 4, 2).fragment("bent");
        for pixel in (0..8).map(|pixel| (pixel % 4, pixel / 4)) {
            let traced = bent.trace(path, pixel).unwrap_or_else(|error| panic!("{path}: {error}"));
            let found = named_steps(&traced).into_iter().find(|(name, _)| name == "down");
            let (_, down) = found.expect("it is there");
            let engine: Vec<f32> = traced
                .engine
                .trim_matches(['(', ')'])
                .split(", ")
                .map(|one| one.parse().expect("a number"))
                .collect();
            assert_eq!(down[0], engine[1]);
            for (a, b) in traced.driver.iter().zip(&engine) {
                assert!(
                    (a - b).abs() <= 1e-3,
                    "{path} at {pixel:?}: {:?}, {engine:?}",
                    traced.driver
                );
            }
        }
        // A function that writes storage runs for one pixel, and a note says so at other pixels of a quad.
        let logged = package.frame("", 4, 2).with("log", Storage::new([0.0_f32; 4]));
        let logged = logged.fragment("logged");
        for (pixel, is_noted) in [((2, 0), false), ((1, 0), true)] {
            let traced =
                logged.trace(path, pixel).unwrap_or_else(|error| panic!("{path}: {error}"));
            let is_it = |note: &String| note.contains("writes storage");
            assert_eq!(traced.notes.iter().any(is_it), is_noted, "{path}: {:?}", traced.notes);
        }
        let of = |pixel| both(&package).trace(path, pixel).expect("it is drawn");
        assert_eq!((&*of((1, 0)).function, &*of((2, 0)).function), ("red", "nothing"));
        assert_eq!(of((1, 0)).arguments[0].1, "(1.5, 0.5, 0.5, 1)");
        // Another draw covers one column of the quad.
        let corner = Mesh::new(
            vec![Vec3::new(-1.0, -1.0, 0.5), Vec3::new(-0.5, -1.0, 0.5), Vec3::new(-1.0, 3.0, 0.5)],
            vec![0, 1, 2],
        );
        let draw = Draw::mesh("vertex", "steep", corner);
        let edge = package.frame("", 4, 2).draw(Draw::fragment("nothing")).draw(draw);
        let edge = edge.trace(path, (0, 1)).unwrap_or_else(|error| panic!("{path}: {error}"));
        assert!(
            edge.notes.iter().any(|note| note.contains("another function draws a neighbour")),
            "{:?}",
            edge.notes
        );
    }
}

/// `tap` shows the author's types: a number stays a number, even if naga converts it to a vector. `tap` also reads a
/// `let` that only names another value, and members such as `pair.many.x`.
#[test]
fn types_aliases_and_parts_are_the_author_s() {
    let package = package();
    let draw = Draw::mesh("vertex", "tinted", half());
    let tint = |value: f32| Uniform::new(glam::Vec4::splat(value));
    for path in drivers() {
        let frame = package.frame("", 4, 2).with("tint", tint(0.5)).with("other", tint(0.25));
        let frame = frame.draw(Draw::fragment("behind")).draw(draw.clone());
        let of = |wanted: &str| tapped(&frame, path, &Tap::new(wanted));
        assert_eq!(of("ternary").shape.lanes().len(), 1);
        assert_eq!(floats(&of("ternary"))[..2], [0.5, 1.5 - 1.0]);
        assert_eq!(floats(&of("same")), floats(&of("ternary")));
        assert_eq!(of("pair.many.x").lanes[0], 16_777_217);
        assert_eq!(of("pair.many").lanes[..2], [16_777_217, 7]);
        assert_eq!(floats(&of("at.y * 3.0"))[0], 1.5);
        // Each draw has its own resources.
        let front = frame.trace(path, (0, 0)).unwrap_or_else(|error| panic!("{path}: {error}"));
        let wide = named_steps(&front).into_iter().rfind(|(name, _)| name == "wide");
        assert_eq!(wide.map(|(_, values)| values), Some(vec![3.0]), "{path}");
        let behind = frame.trace(path, (3, 0)).unwrap_or_else(|error| panic!("{path}: {error}"));
        assert_eq!((&*behind.engine, behind.driver), ("(0.25, 0.25, 0.25, 0.25)", [0.25; 4]));
        assert!(behind.notes.is_empty(), "{:?}", behind.notes);
        // Behind the visible draw there is a second draw, and no third.
        let second =
            frame.trace_layer(path, (0, 0), 2).unwrap_or_else(|error| panic!("{path}: {error}"));
        assert_eq!((&*second.engine, second.driver), (&*behind.engine, [0.25; 4]), "{path}");
        let third = frame.trace_layer(path, (0, 0), 3).expect_err("two draws cover it");
        assert!(matches!(third, TapError::Undrawn { pixel: (0, 0) }), "{third}");
        let blended = both(&package).trace(path, (0, 0)).expect("it is drawn");
        assert!(
            blended.notes.iter().any(|note| note.contains("several draws contribute")),
            "{:?}",
            blended.notes
        );
    }
}

#[test]
fn names_without_a_value_are_refused() {
    let package = package();
    let refused = |frame: Frame<'_>, wanted: &str| {
        frame.tap(drivers()[0], &Tap::new(wanted)).expect_err(wanted)
    };
    let constant = refused(plain(&package), "none");
    assert!(matches!(constant, TapError::Untold { .. }), "{constant}");
    assert!(
        constant.to_string().contains("`2.0` can't be tapped, because it is a constant"),
        "{constant}"
    );
    let often = plain(&package).tap(drivers()[0], &Tap::new("term").round(Some(9)));
    let often = often.expect_err("no pixel goes round so often").to_string();
    assert!(often.contains("9 times: a pixel computes the value at most 3 times"), "{often}");
    let variable = refused(plain(&package), "sum.x").to_string();
    assert!(variable.contains("computes no value `sum.x`"), "{variable}");
    let mesh = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![0, 1, 2]);
    let depth = package.frame("", 4, 2).draw(Draw::depth("vertex", mesh)).depth();
    assert!(matches!(refused(depth, "at"), TapError::Depth));
    assert!(
        plain(&package).tap(Path::CPU, &Tap::new("column")).is_err(),
        "the engine draws no frames"
    );
}

const PASS: &str = "
@group(0) @binding(0) var<storage, read_write> data: array<f32>;

fn doubled(x: f32) -> f32 {
    let twice = 2.0 * x;
    return twice;
}

@compute @workgroup_size(4, 2)
fn root(@builtin(global_invocation_id) id: vec3u) {
    let index = id.y * 8u + id.x;
    if (id.x == 7u) {
        return;
    }
    let own = doubled(data[index]);
    for (var i = 0u; i < id.x; i += 1u) {
        let part = own + f32(i);
        data[index] = part;
    }
}

@compute @workgroup_size(2)
fn without(@builtin(local_invocation_index) at: u32) {
    let own = at * 3u;
    data[at] = f32(own);
}

struct In { @builtin(global_invocation_id) id: vec3u }
@compute @workgroup_size(1)
fn inside(in: In) {
    let own = in.id.x;
    data[own] = 1.0;
}
";

/// In a pass, `tap` reads the value of each invocation, on the engine and on drivers.
// Lesson 39
#[test]
fn each_invocation_of_a_pass_has_its_traced_value() {
    let package = Package::from_source("m", PASS);
    let data: Vec<f32> = (0..16_u8).map(f32::from).collect();
    let passes = package.compute().with("data", Storage::new(data));
    let root = passes.clone().dispatch("root", [2, 1, 1]);
    let mut paths = drivers();
    paths.push(Path::CPU);
    for path in paths {
        let of = |wanted: &str| {
            root.tap(path, &Tap::new(wanted)).unwrap_or_else(|error| panic!("{path}: {error}"))
        };
        let index = of("index");
        assert_eq!((index.size, index.of), ((8, 2), "invocation"), "{path}");
        assert_eq!(index.lanes, (0..16).collect::<Vec<u32>>(), "{path}");
        let twice = of("twice");
        assert_eq!(floats(&twice)[..3], [0.0, 2.0, 4.0], "{path}");
        assert_eq!(
            (twice.told[7], twice.times[7], floats(&twice)[14]),
            (false, Some(0), 28.0),
            "{path}"
        );
        let part = of("part");
        assert_eq!(
            (part.times[0], part.times[3], floats(&part)[3]),
            (Some(0), Some(3), 8.0),
            "{path}"
        );
        let second = root.tap(path, &Tap::new("part").round(Some(2))).expect("some go round twice");
        assert_eq!((second.told[1], floats(&second)[3]), (false, 7.0), "{path}");
        assert_eq!(of("id").lanes[3 * 10..3 * 11], [2, 1, 0], "{path}");
        // The taps don't change the results of the pass.
        let left = karat::unstable::compute::left(&root, path).expect("it runs");
        assert_eq!(f32::from_bits(left[0].lanes[3]), 8.0, "{path}");
        let without = passes.clone().dispatch("without", [1, 1, 1]);
        assert_eq!(without.tap(path, &Tap::new("own")).expect("it runs").lanes, [0, 3], "{path}");
        let inside = passes.clone().dispatch("inside", [1, 1, 1]).tap(path, &Tap::new("own"));
        assert!(inside.expect_err("it is in a structure").to_string().contains("in a structure"));
    }
    let listed = root.values().expect("it is valid");
    assert!(
        listed.iter().any(|line| line.starts_with("doubled::twice: f32 = 2.0 * x")),
        "{listed:?}"
    );
}
