//! Functions with pointers, functions without a result, functions that write, and functions that only fragment shaders
//! may call.

use glam::{DVec2, DVec3, DVec4, UVec2, Vec2, Vec3, Vec4};
use karat::fixture::Compare;
use karat::prelude::*;
use karat::unstable::value::Quad;

fn check(text: &str) -> Package {
    Package::from_source("f", text)
}

/// For a pointer parameter, a test gives the value behind the pointer as the argument. After the call, the value behind
/// the pointer is an additional result.
// Lesson 123
#[test]
fn pointers_are_values_in_and_out() {
    let package = check(
        "fn next(state: ptr<function, u32>) -> u32 {\n    \
         *state = *state * 747796405u + 2891336453u;\n    return *state >> 16u;\n}\n\
         fn scale(v: ptr<function, vec2f>, by: f32) { *v = *v * by; }\n\
         var<private> kept: f32;\n\
         fn add(sum: ptr<private, f32>, x: f32) -> f32 { kept += x; *sum += x; return kept; }",
    );
    let step = |state: u32| state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    package
        .function("next")
        .over(Integers(0..=u32::MAX))
        .agrees_with(move |state: u32| (step(state) >> 16, step(state)), Abs(0.0));
    // If the function returns nothing, the value behind the pointer is its only result.
    package
        .function("scale")
        .over(((-1.0_f32..=1.0, -1.0_f32..=1.0).map(|(x, y)| Vec2::new(x, y)), 0.0_f32..=4.0))
        .agrees_with(|v: DVec2, by: f64| v * by, Ulp(1.0));
    // A private variable has its initial value again in each case.
    package
        .function("add")
        .over((-1.0_f32..=1.0, -1.0_f32..=1.0))
        .agrees_with(|sum: f64, x: f64| (x, sum + x), Ulp(1.0).or(Abs(1e-7)));
}

/// A check fails if the reference ignores the value behind the pointer, or returns a wrong value for it.
// Lesson 123
#[test]
fn the_values_behind_pointers_are_compared() {
    let package = check("fn f(a: ptr<function, i32>) -> i32 { *a += 1; return *a * 2; }");
    let probe = || package.function("f").over(Integers(-100..=100_i32));
    probe().agrees_with(|a: i32| (2 * (a + 1), a + 1), Abs(0.0));
    let wrong = probe().unrecorded().try_agrees_with(|a: i32| (2 * (a + 1), a), Abs(0.0));
    let text = wrong.expect_err("it adds 1").to_string();
    assert!(text.contains("at .a"), "{text}");
    let unpaired = probe().unrecorded().try_agrees_with(|a: i32| 2 * (a + 1), Abs(0.0));
    let text = unpaired.expect_err("the pointer is a result, too").to_string();
    assert!(text.contains("returns"), "{text}");
}

// Lesson 127
#[test]
fn twelve_parameters_and_none() {
    let package = check(
        "@must_use fn sum(a: f32, b: f32, c: f32, d: f32, e: f32, f: f32, g: f32, h: f32, i: f32, \
         j: f32, k: i32, l: u32) -> f32 {\n    \
         return a + b + c + d + e + f + g + h + i + j + f32(k) + f32(l);\n}\n\
         @group(0) @binding(0) var<uniform> one: f32;\n\
         fn none() -> f32 { return one; }",
    );
    let one = || OneOf(vec![0.0_f32, 1.0, 2.0]);
    let domain = (
        one(),
        one(),
        one(),
        one(),
        one(),
        one(),
        one(),
        one(),
        one(),
        one(),
        Integers(-3..=3_i32),
        Integers(0..=3_u32),
    );
    package.function("sum").over(domain).cases(2000).agrees_with(
        |a: f64,
         b: f64,
         c: f64,
         d: f64,
         e: f64,
         f: f64,
         g: f64,
         h: f64,
         i: f64,
         j: f64,
         k: i32,
         l: u32| a + b + c + d + e + f + g + h + i + j + f64::from(k) + f64::from(l),
        Abs(0.0),
    );
    package
        .function("none")
        .with("one", Uniform::new(1.0_f32))
        .over(())
        .agrees_with(|| 1.0_f64, Abs(0.0));
}

/// The initialiser of an override can use other overrides: `override B = A * 3.0;`.
// Lesson 133
#[test]
fn overrides_that_others_are_made_of_are_set() {
    let package = check(
        "override A: f32 = 2.0;\noverride B = A * 3.0;\noverride D: f32;\noverride E = D + B;\n\
         @id(3) override N: u32 = 1u;\n\
         fn f(x: f32) -> f32 { return x + A + 10.0 * B + 100.0 * E + f32(N); }",
    );
    let probe = || package.function("f").with_override("D", 1.0);
    let xs = || OneOf(vec![0.0_f32, 1.0, 4.0]);
    probe().over(xs()).agrees_with(|x: f64| x + 3.0 + 60.0 + 700.0, Abs(0.0));
    probe()
        .with_override("A", 1.0)
        .over(xs())
        .agrees_with(|x: f64| x + 2.0 + 30.0 + 400.0, Abs(0.0));
    let twice = probe().with_override("N", 1.0).with_override("3", 2.0).over(xs());
    let error = twice
        .unrecorded()
        .try_agrees_with(|x: f64| x, Abs(0.0))
        .expect_err("two values")
        .to_string();
    assert!(error.contains("has two values"), "{error}");
}

/// A host sets overrides by their names. If two modules declare an override with the same name, a test must write the
/// module's name, too.
#[test]
fn overrides_of_several_modules_are_named() {
    let declares = |value: &str, own: &str| {
        format!(
            "override SAMPLES: u32 = {value};\nfn {own}(x: f32) -> f32 {{ return x * f32(SAMPLES); }}"
        )
    };
    let (shadow, occlusion) = (declares("4u", "soft"), declares("16u", "occluded"));
    let both = "import package::shadow::soft;\nimport package::occlusion::occluded;\n\
                fn both(x: f32) -> vec2f { return vec2f(soft(x), occluded(x)); }";
    let alone = "import package::shadow::soft;\nfn alone(x: f32) -> f32 { return soft(x); }";
    let package = Package::from_modules(
        "p",
        [("shadow", &*shadow), ("occlusion", &occlusion), ("lit", both), ("one", alone)],
    );
    let of = |name: &str| {
        package.function("lit::both").with_override(name, 2.0).over(OneOf(vec![1.0_f32]))
    };
    of("shadow::SAMPLES").agrees_with(|x: f64| DVec2::new(2.0 * x, 16.0 * x), Abs(0.0));
    let error = of("SAMPLES").unrecorded();
    let error = error.try_agrees_with(|x: f64| DVec2::splat(x), Abs(0.0));
    let error = error.expect_err("two are called so").to_string();
    assert!(error.contains("`shadow::SAMPLES` and `occlusion::SAMPLES`"), "{error}");
    package
        .function("one::alone")
        .with_override("SAMPLES", 2.0)
        .over(OneOf(vec![1.0_f32]))
        .agrees_with(|x: f64| 2.0 * x, Abs(0.0));
    // A local variable, a parameter or another import with the same name isn't the override.
    for (text, expected) in [
        (
            "import package::gain::gain as k; import package::other::gain;\n\
          fn f(gain: f32) -> f32 { return gain + k * 100.0; }",
            201.0,
        ),
        (
            "import package::gain::gain;\nfn f(gain: f32) -> f32 { return gain + package::gain::gain * 100.0; }",
            201.0,
        ),
        (
            "import package::gain::gain as k;\nfn f(x: f32) -> f32 { let gain = x; return gain + k * 100.0; }",
            201.0,
        ),
        (
            "import package::gain::{gain as k, both as gain};\nfn f(gain: f32) -> f32 { return gain + k * 100.0; }",
            201.0,
        ),
        (
            "import package::gain::gain as k;\nfn f(x: f32) -> f32 { var r = 0.0; for (var gain = x; gain < 3.0; gain += 1.0) \
          { r += k * 100.0 + gain; } return r; }",
            403.0,
        ),
        (
            "const gain = 50.0;\nfn f(gain: f32) -> f32 { return gain + package::user::gain * 100.0; }",
            5001.0,
        ),
    ] {
        let modules = [
            ("gain", "override gain: f32 = 2.0;\nfn both(x: f32) -> f32 { return x * gain; }"),
            ("other", "const gain = 50.0;"),
            ("user", text),
        ];
        let package = Package::from_modules("p", modules);
        package
            .function("user::f")
            .over(OneOf(vec![1.0_f32]))
            .agrees_with(|_: f64| expected, Abs(0.0));
    }
    let text = |module| {
        let program = karat::unstable::reflect::Program::of_module(&package, module);
        program.expect("it links").text().to_owned()
    };
    assert!(text("one").contains("override SAMPLES: u32"), "{}", text("one"));
    assert!(!text("lit").contains("override SAMPLES: u32"), "{}", text("lit"));
}

// Lesson 120
#[test]
fn overrides_are_set() {
    let package = check(
        "override GAIN: f32;\n@id(7) override COUNT: u32 = 2u;\noverride ON: bool = false;\n\
         const K = 3.0;\n\
         fn f(x: f32) -> f32 { return select(0.0, GAIN * x + f32(COUNT), ON); }",
    );
    let probe = || package.function("f").with_override("GAIN", 2.0).with_override("ON", 1.0);
    let xs = || OneOf(vec![0.0_f32, 1.0, 4.0]);
    probe().over(xs()).agrees_with(|x: f64| 2.0 * x + 2.0, Abs(0.0));
    probe().with_override("7", 5.0).over(xs()).agrees_with(|x: f64| 2.0 * x + 5.0, Abs(0.0));
    // The check fails if the override's value is ignored.
    probe()
        .with_override("COUNT", 5.0)
        .over(xs())
        .unrecorded()
        .try_agrees_with(|x: f64| 2.0 * x + 2.0, Abs(0.0))
        .expect_err("COUNT is 5");
    let told = |name: &str, value: f64, parts: &[&str]| {
        let probe = package.function("f").with_override(name, value);
        let error = probe
            .over(xs())
            .unrecorded()
            .try_agrees_with(|x: f64| x, Abs(0.0))
            .expect_err("a mistake");
        parts.iter().for_each(|part| assert!(error.to_string().contains(part), "{error}"));
    };
    told("COUNT", 3.0, &["<f>:1:1", "the override `GAIN` has no value", "`--override GAIN=...`"]);
    told("GAINS", 3.0, &["no override `GAINS`", "did you mean `GAIN`?"]);
    let wrong = probe()
        .with_override("COUNT", -1.0)
        .over(xs())
        .unrecorded()
        .try_agrees_with(|x: f64| x, Abs(0.0));
    let text = wrong.expect_err("a u32").to_string();
    assert!(text.contains("`COUNT` must be a u32, but is -1"), "{text}");
    let wrong = probe()
        .with_override("GAIN", f64::NAN)
        .over(xs())
        .unrecorded()
        .try_agrees_with(|x: f64| x, Abs(0.0));
    wrong.expect_err("no constant is NaN");
}

/// Storage buffers have the same content at the start of each case. Their content at the end of the case is a result.
// Lesson 124
#[test]
fn each_case_begins_with_the_same_storage_and_returns_its_content() {
    let package = check(
        "struct Bins { total: atomic<u32>, count: array<atomic<u32>> }\n\
         @group(0) @binding(0) var<storage, read_write> bins: Bins;\n\
         fn bump(i: u32, by: u32) -> u32 {\n    \
         atomicAdd(&bins.total, by);\n    return atomicAdd(&bins.count[i % 3u], by);\n}\n\
         @group(0) @binding(1) var<storage, read_write> line: array<vec3f>;\n\
         fn put(i: u32, x: f32) { line[i] = vec3f(x, 1.0, f32(arrayLength(&line))); }",
    );
    let bins = || karat::fixture::Buffer::from_pod(&[10_u32, 1, 2, 3]);
    let domain = || (Integers(0..=5_u32), Integers(0..=9_u32));
    package.function("bump").with("bins", bins()).over(domain()).agrees_with(
        |i: u32, by: u32| {
            let mut count = [1_u32, 2, 3];
            count[i as usize % 3] += by;
            (count[i as usize % 3] - by, Bins { total: 10 + by, count })
        },
        Abs(0.0),
    );
    let line = || Storage::new([Vec3::ZERO, Vec3::ONE]);
    package
        .function("put")
        .with("line", line())
        .over((Integers(0..=1_u32), 0.0_f32..=1.0))
        .cases(64)
        .agrees_with(
            |i: u32, x: f64| {
                let mut line = [DVec3::ZERO, DVec3::ONE];
                line[i as usize] = DVec3::new(x, 1.0, 2.0);
                line
            },
            Abs(0.0),
        );
    let wrong = package
        .function("put")
        .with("line", line())
        .over((Integers(0..=1_u32), 0.0_f32..=1.0))
        .cases(64)
        .unrecorded()
        .try_agrees_with(|_: u32, _: f64| [DVec3::ZERO, DVec3::ONE], Abs(0.0));
    wrong.expect_err("it writes");
}

/// The Rust type for the structure `Bins` in WGSL. Atomics become scalars.
#[derive(Clone, Debug)]
struct Bins {
    total: u32,
    count: [u32; 3],
}

impl karat::unstable::value::Mirror for Bins {
    fn shape() -> karat::unstable::value::Shape {
        use karat::unstable::value::{Scalar, Shape};
        let count = Shape::Array { element: Box::new(Shape::Scalar(Scalar::U32)), length: 3 };
        let total = ("total".to_owned(), Shape::Scalar(Scalar::U32));
        Shape::Struct { name: "Bins".to_owned(), members: vec![total, ("count".to_owned(), count)] }
    }

    fn lanes(&self, lanes: &mut Vec<f64>) {
        lanes.push(f64::from(self.total));
        lanes.extend(self.count.map(f64::from));
    }
}

/// If a function only reads a `read_write` buffer, the buffer's content isn't a result.
// Lesson 133
#[test]
fn storage_that_is_only_read_is_no_result() {
    let package = check(
        "struct Lights { count: atomic<u32>, items: array<f32> }\n\
         @group(0) @binding(0) var<storage, read_write> lights: Lights;\n\
         fn f(i: u32) -> f32 { return f32(atomicLoad(&lights.count)) * lights.items[i]; }",
    );
    let words = [2_u32, 0.5_f32.to_bits(), 3.0_f32.to_bits()];
    let probe = package.function("f").with("lights", karat::fixture::Buffer::from_pod(&words));
    probe.over(Integers(0..=1_u32)).agrees_with(|i: u32| if i == 0 { 1.0 } else { 6.0 }, Abs(0.0));
}

// Lesson 124
#[test]
fn workgroup_state_starts_anew() {
    let package = check(
        "var<workgroup> shared_sum: array<u32, 4>;\n\
         fn f(i: u32, x: u32) -> u32 {\n    \
         shared_sum[i] += x;\n    workgroupBarrier();\n    \
         return shared_sum[0] + shared_sum[1] + shared_sum[2] + shared_sum[3];\n}",
    );
    let domain = || (Integers(0..=3_u32), Integers(0..=9_u32));
    package.function("f").over(domain()).agrees_with(|_: u32, x: u32| x, Abs(0.0));
}

// Lesson 124
#[test]
fn storage_textures_are_read_back() {
    let package = check(
        "@group(0) @binding(0) var target_: texture_storage_2d<rgba8unorm, write>;\n\
         @group(0) @binding(1) var counts: texture_storage_2d<r32uint, read_write>;\n\
         fn paint(at: vec2u, x: f32) { textureStore(target_, at, vec4f(x, 1.0 - x, 2.0, 1.0)); }\n\
         fn count(at: vec2u) -> u32 {\n    \
         let old = textureLoad(counts, at).x;\n    \
         textureStore(counts, at, vec4u(old + 1u, 0u, 0u, 0u));\n    return old;\n}",
    );
    let places = || OneOf((0..6).map(|i| UVec2::new(i % 3, i / 3)).collect::<Vec<_>>());
    let rounded = |x: f64| (x.clamp(0.0, 1.0) * 255.0).round_ties_even() / 255.0;
    package
        .function("paint")
        .with("target_", Texture::from_fn(3, 2, |_, _| Vec4::ZERO))
        .over((places(), OneOf(vec![0.0_f32, 0.2, 0.6, 1.0])))
        .agrees_with(
            move |at: UVec2, x: f64| {
                let mut texels = [DVec4::ZERO; 6];
                texels[(at.y * 3 + at.x) as usize] =
                    DVec4::new(rounded(x), rounded(1.0 - x), 1.0, 1.0);
                texels
            },
            Abs(1e-7),
        );
    package
        .function("count")
        .with("counts", Texture::from_fn(3, 2, |x, y| 10 * y + x))
        .over(places())
        .agrees_with(
            |at: UVec2| {
                // Each expected texel is one number, because the format has one channel.
                let mut texels: [u32; 6] = std::array::from_fn(|i| {
                    let i = i as u32;
                    10 * (i / 3) + i % 3
                });
                texels[(at.y * 3 + at.x) as usize] += 1;
                (10 * at.y + at.x, texels)
            },
            Abs(0.0),
        );
}

/// If a function uses derivatives, each argument is a value with its derivatives over a quad of pixels. The check
/// judges the result at the quad's upper left pixel.
// Lesson 126
#[test]
fn derivatives_over_quads() {
    let package = check(
        "fn edge(d: f32) -> f32 { return clamp(0.5 - d / fwidth(d), 0.0, 1.0); }\n\
         fn slope(p: vec2f, by: f32) -> vec4f { return by * vec4f(dpdx(p), dpdy(p)); }",
    );
    // These steps are exact in binary, so adding and subtracting one gives the same value again.
    let steps = || OneOf(vec![-0.5_f32, -0.25, 0.25, 1.0]);
    let values = || Grid::linear(-1.0..=1.0, 33);
    let quad = || (values(), steps(), steps()).map(|(value, dx, dy)| Quad { value, dx, dy });
    package.function("edge").over(quad()).agrees_with(
        |d: Quad<f64>| (0.5 - d.value / (d.dx.abs() + d.dy.abs())).clamp(0.0, 1.0),
        Ulp(4.0).or(Abs(1e-6)),
    );
    let pair = || {
        (quad(), quad()).map(|(x, y)| Quad {
            value: Vec2::new(x.value, y.value),
            dx: Vec2::new(x.dx, y.dx),
            dy: Vec2::new(x.dy, y.dy),
        })
    };
    package.function("slope").over((pair(), OneOf(vec![1.0_f32, -2.0]))).agrees_with(
        |p: Quad<DVec2>, by: f64| by * DVec4::new(p.dx.x, p.dx.y, p.dy.x, p.dy.y),
        Ulp(0.0),
    );
    let wrong = package
        .function("edge")
        .over(quad())
        .unrecorded()
        .try_agrees_with(|d: Quad<f64>| (0.5 - d.value / d.dx.abs()).clamp(0.0, 1.0), Abs(1e-3));
    wrong.expect_err("a derivative is left out");
    // An argument without derivatives has the same value at all four pixels.
    package
        .function("slope")
        .over((Just(Vec2::ONE), Just(3.0_f32)))
        .agrees_with(|_: DVec2, _: f64| DVec4::ZERO, Abs(0.0));
}

karat::shareable! { struct Point mirrors PointMirror { uv: Vec2, id: u32 } }

/// In a structure, floats have derivatives, and integers don't.
// Lesson 132
#[test]
fn structures_vary_over_quads() {
    let package = check(
        "struct Point { uv: vec2f, id: u32 }\n\
         fn f(p: Point) -> vec3f { return vec3f(dpdx(p.uv), f32(p.id)); }",
    );
    let at = |u: f32, id: u32| Point { uv: Vec2::new(u, 0.5), id };
    let quads = OneOf(
        vec![1.0_f32, 2.0, 4.0]
            .into_iter()
            .map(|u| Quad { value: at(u, 7), dx: at(0.25 * u, 3), dy: at(0.0, 5) })
            .collect(),
    );
    let expect = |p: Quad<PointMirror>| DVec3::new(p.dx.uv.x, p.dx.uv.y, f64::from(p.value.id));
    package.function("f").over((quads,)).agrees_with(expect, Abs(0.0));
}

/// A check can call functions that use `textureSample` or `textureSampleBias`, which need derivatives to choose a level
/// of detail.
// Lesson 126
#[test]
fn implicit_levels_of_detail() {
    let package = check(
        "@group(0) @binding(0) var image: texture_2d<f32>;\n\
         @group(0) @binding(1) var filtering: sampler;\n\
         fn f(uv: vec2f) -> f32 { return textureSample(image, filtering, uv).x; }\n\
         fn biased(uv: vec2f, bias: f32) -> f32 {\n    \
         return textureSampleBias(image, filtering, uv, bias).x;\n}",
    );
    let flat = |size: u32, value: f32| Texture::from_fn(size, size, move |_, _| value);
    let image = || flat(8, 0.0).with_levels([flat(4, 1.0), flat(2, 2.0), flat(1, 3.0)]);
    let uv = || {
        OneOf(vec![1.0_f32, 2.0, 4.0]).map(|texels| Quad {
            value: Vec2::splat(0.25),
            dx: Vec2::new(texels / 8.0, 0.0),
            dy: Vec2::new(0.0, texels / 8.0),
        })
    };
    let level = |uv: Quad<DVec2>| (8.0 * uv.dx.x).log2();
    let probe = |function: &str| {
        package.function(function).with("image", image()).with("filtering", Sampler::LINEAR)
    };
    probe("f").over(uv()).agrees_with(level, Abs(0.02));
    probe("biased").over((uv(), OneOf(vec![-1.0_f32, 0.0, 1.0]))).agrees_with(
        move |uv: Quad<DVec2>, bias: f64| (level(uv) + bias).clamp(0.0, 3.0),
        Abs(0.02),
    );
}

/// The level of detail of a cube map depends on the distance between the points that two adjacent pixels sample on a
/// face. The longer the direction vectors are, the shorter this distance is for the same derivatives.
#[test]
fn implicit_levels_of_detail_of_cubes() {
    let package = check(
        "@group(0) @binding(0) var sky: texture_cube<f32>;\n\
         @group(0) @binding(1) var filtering: sampler;\n\
         fn f(d: vec3f) -> f32 { return textureSample(sky, filtering, d).x; }\n\
         fn biased(d: vec3f, bias: f32) -> f32 { return textureSampleBias(sky, filtering, d, bias).x; }\n\
         fn given(d: vec3f, by: vec3f) -> f32 { return textureSampleGrad(sky, filtering, d, by, by).x; }",
    );
    let level = |(size, value): (usize, f32)| vec![[value; 4]; 6 * size * size];
    let levels = [(8, 0.0), (4, 1.0), (2, 2.0), (1, 3.0)].map(level).to_vec();
    let probe = |function: &str| {
        let sky = CubeMap::from_levels(8, levels.clone());
        package.function(function).with("sky", sky).with("filtering", Sampler::LINEAR)
    };
    // For each face: short and long directions, with steps of one, two and four texels along both sides.
    let numbers = (0..3_usize).flat_map(|axis| [-0.5_f32, 0.5, 3.0].map(|major| (axis, major)));
    let all: Vec<[Vec3; 2]> = numbers
        .flat_map(|(axis, major)| {
            [1.0_f32, 2.0, 4.0].map(|texels| {
                let mut at = Vec3::splat(0.125 * major);
                at[axis] = major;
                let mut step = Vec3::ZERO;
                step[(axis + 1) % 3] = 2.0 * major.abs() * texels / 8.0;
                [at, step]
            })
        })
        .collect();
    let quads = || OneOf(all.clone()).map(|[value, dx]| Quad { value, dx, dy: Vec3::ZERO });
    let moved = |at: DVec3, by: DVec3| {
        let major = at.abs().max_element();
        (8.0 * 0.5 * by.length() / major).log2()
    };
    let of = move |d: Quad<DVec3>| moved(d.value, d.dx);
    probe("f").over(quads()).agrees_with(of, Abs(0.02));
    probe("biased")
        .over((quads(), OneOf(vec![-1.0_f32, 1.0])))
        .agrees_with(move |d: Quad<DVec3>, bias: f64| (of(d) + bias).clamp(0.0, 3.0), Abs(0.02));
    let pairs = OneOf(all.clone()).map(|[at, by]| (at, by));
    probe("given").over(pairs).agrees_with(|at: DVec3, by: DVec3| moved(at, by), Abs(0.02));
}

/// A host binds only one of two variables with the same group and binding, so a function that reads both is refused.
#[test]
fn variables_at_one_place_are_refused() {
    let text = "@group(0) @binding(0) var<uniform> u: f32;
        @group(0) @binding(0) var<uniform> v: f32;
        fn both(x: f32) -> f32 { return x * u + v; }
        fn one(x: f32) -> f32 { return x * v; }";
    let package = Package::from_source("m", text);
    let given = |name: &str| {
        let probe = package.function(name).with("v", Uniform::new(2.0_f32));
        let both = name == "both";
        let probe = if both { probe.with("u", Uniform::new(1.0_f32)) } else { probe };
        if both { probe.over(0.0..=1.0).unrecorded() } else { probe.over(0.0..=1.0) }
    };
    given("one").agrees_with(|x: f64| 2.0 * x, Ulp(1.0));
    let error = given("both").try_agrees_with(|x: f64| x + 2.0, Ulp(1.0));
    let error = error.expect_err("a host binds one of them").to_string();
    assert!(error.contains("`u` and `v` are both @group(0) @binding(0)"), "{error}");
}

/// A message shows the expression that first gives NaN or infinity, with file, line and column, even if a `clamp` hides
/// this NaN or infinity. Messages about the buffers of passes also show this expression.
#[test]
fn nan_and_infinity_have_a_place() {
    let text = "fn g(v: f32, l: f32) -> f32 {\n    return (v * l) / (4.0 * v * l);\n}\n\
        fn outer(v: f32, l: f32) -> f32 { return clamp(g(v, l), -10.0, 10.0) + 1.0; }\n\
        fn inverse(x: f32) -> f32 { return min(1.0 / x, 8.0); }\n\
        @group(0) @binding(0) var<storage, read_write> data: array<f32>;\n\
        @compute @workgroup_size(4) fn fill(@builtin(local_invocation_index) i: u32) {\n    \
        let x = f32(i);\n    data[i] = x / (x * x - x * 2.0);\n}";
    let package = check(text);
    let probe = package.function("outer").over((Just(0.0_f32), Just(0.0_f32))).unrecorded();
    let error = probe.try_stays_within(0.0..=2.0).expect_err("it is 1 and a bound").to_string();
    assert!(error.contains("first NaN = `(v * l) / (4.0 * v * l)` of 0, 0 (<f>:2:12)"), "{error}");
    let error = package.function("inverse").over(Just(0.0_f32)).unrecorded();
    let error = error.try_agrees_with(|x: f64| x, Abs(0.0)).expect_err("it is 8").to_string();
    assert!(error.contains("infinite = `1.0 / x` of 1, 0 (<f>:5:40)"), "{error}");
    let passes = package.compute().with("data", Storage::new(vec![0.0_f32; 4]));
    let passes = passes.dispatch("fill", [1, 1, 1]).after("data").unrecorded();
    let error = passes.try_agrees_with([0.0_f64; 4], Abs(0.1)).expect_err("0 / 0").to_string();
    assert!(error.contains("first NaN: `x / (x * x - x * 2.0)` of 0, 0 (<f>:9:15)"), "{error}");
}

/// If a driver leaves a long loop before its end, the check fails with an error at the loop's line. This also holds for
/// functions that write storage or use derivatives.
// Lesson 125
#[test]
fn loops_of_functions_that_drivers_cut_short_are_errors() {
    let text = "@group(0) @binding(0) var<storage, read_write> sum: u32;\n\
         fn written(n: u32) {\n    for (var i = 0u; i < n; i++) { sum += i % 3u; }\n}\n\
         fn drawn(n: u32, x: f32) -> f32 {\n    \
         var s = dpdx(x);\n    for (var i = 0u; i < n; i++) { s += f32(i % 3u); }\n    return s;\n}";
    let package = check(text);
    let spun = |n: u32| (0..n).map(|i| i % 3).sum::<u32>();
    let written = |n: u32| {
        let probe = package.function("written").with("sum", Uniform::new(0_u32));
        probe.over(Just(n)).unrecorded().try_agrees_with(spun, Abs(0.0))
    };
    let drawn = |n: u32| {
        let reference = |n: u32, _: f64| f64::from(spun(n));
        package
            .function("drawn")
            .over((Just(n), Just(1.0_f32)))
            .unrecorded()
            .try_agrees_with(reference, Abs(0.0))
    };
    written(1000).expect("it ends");
    drawn(1000).expect("it ends");
    for (name, result) in [("written", written(200_000)), ("drawn", drawn(200_000))] {
        match result {
            Ok(agreement) => assert!(
                agreement.paths.iter().all(|(adapter, _)| !adapter.name.contains("llvmpipe")),
                "{agreement}"
            ),
            Err(error) => {
                let error = error.to_string();
                let told = error.contains("<f>:3:5") || error.contains("<f>:7:5");
                assert!(error.contains(name) && told, "{error}");
            }
        }
    }
}

/// If a check can't call a function, the error gives the reason and the function's line.
// Lesson 127
#[test]
fn functions_without_a_value_are_refused() {
    let told = |text: &str, part: &str| {
        let package = check(text);
        let check = package.function("f").over(Just(1.0_f32));
        let error =
            check.unrecorded().try_agrees_with(|x: f64| x, Abs(0.0)).expect_err("it is refused");
        let error = error.to_string();
        assert!(error.contains(part) && error.contains("<f>:"), "{part} in:\n{error}");
    };
    told("fn f(x: f32) { }", "returns nothing and writes nothing");
    told("fn f(x: f32) -> f32 { return subgroupAdd(x); }", "a call has only one invocation");
}

/// Fixtures bind textures and samplers to parameters by the parameters' names.
#[test]
fn textures_are_parameters() {
    let package = check(
        "@group(0) @binding(3) var<uniform> gain: f32;\n\
         struct Tap { uv: vec2f, lod: f32 }\n\
         fn tap(t: texture_2d<f32>, at: Tap, s: sampler) -> vec4f {\n    \
         return gain * textureSampleLevel(t, s, at.uv, at.lod);\n}\n\
         fn twice(first: texture_2d<f32>, second: texture_2d<f32>, s: sampler, u: f32) -> f32 {\n    \
         let at = Tap(vec2f(u, 0.5), 0.0);\n    \
         return tap(first, at, s).x - tap(second, at, s).x;\n}\n\
         fn index(t: texture_2d<u32>, p: vec2u, found: ptr<function, u32>) {\n    \
         *found += textureLoad(t, p, 0).y;\n}\n\
         fn lit(shadows: texture_depth_2d, s: sampler_comparison, depth: f32) -> f32 {\n    \
         return textureSampleCompareLevel(shadows, s, vec2f(0.5), depth);\n}\n\
         fn mip(t: texture_2d<f32>, s: sampler, uv: vec2f) -> f32 { return textureSample(t, s, uv).x; }",
    );
    let ramp =
        |scale: f32| Texture::from_fn(4, 1, move |x, _| Vec4::new(scale * x as f32, 0.0, 0.0, 1.0));
    let of = |name| package.function(name).with("s", Sampler::NEAREST);
    let texel = |u: f64| (4.0 * u).floor().clamp(0.0, 3.0);
    let difference = || {
        let twice = of("twice").with("gain", Uniform::new(2.0_f32));
        twice.with("first", ramp(3.0)).over(Grid::linear(0.0625..=0.9375, 8))
    };
    let two = || package.function("twice").with("s", Sampler::NEAREST);
    let right = two().with("gain", Uniform::new(2.0_f32));
    right
        .with("first", ramp(3.0))
        .with("second", ramp(1.0))
        .over(Grid::linear(0.0625..=0.9375, 8))
        .agrees_with(|u: f64| 4.0 * texel(u), Abs(1e-5));
    // The check fails if the two values are swapped.
    let swapped = two().with("gain", Uniform::new(2.0_f32));
    let swapped = swapped.with("first", ramp(1.0)).with("second", ramp(3.0));
    let swapped = swapped.over(Grid::linear(0.0625..=0.9375, 8));
    swapped.unrecorded().try_agrees_with(|u: f64| 4.0 * texel(u), Abs(1e-5)).expect_err("swapped");
    let error = difference()
        .unrecorded()
        .try_agrees_with(|u: f64| u, Abs(1.0))
        .expect_err("unbound")
        .to_string();
    assert!(error.contains("`second` (texture_2d<f32>) has no fixture"), "{error}");
    assert!(error.contains("<f>:6:1"), "{error}");
    // A module's variable with the same name is another binding.
    let both = check(
        "@group(0) @binding(0) var t: texture_2d<f32>;\n\
         fn outer() -> f32 { return 10.0 * textureLoad(t, vec2u(), 0).x; }\n\
         fn both(t: texture_2d<f32>) -> f32 { return outer() + textureLoad(t, vec2u(), 0).x; }",
    );
    let grey = |x: f32| Texture::from_fn(1, 1, move |_, _| Vec4::splat(x));
    let probe = both.function("both").with("t", grey(0.25)).with("both::t", grey(0.5));
    probe.over(()).agrees_with(|| 3.0, Abs(0.0));
    let numbers = Texture::from_fn(2, 2, |x, y| glam::UVec4::new(0, 10 * y + x, 0, 0));
    package
        .function("index")
        .with("t", numbers)
        .over((Just(UVec2::new(1, 1)), Integers(0..=3_u32)))
        .agrees_with(|_: UVec2, found: u32| found + 11, Abs(0.0));
    let depth = Texture::from_fn(1, 1, |_, _| 0.5_f32);
    package
        .function("lit")
        .with("shadows", depth)
        .with("s", Sampler::NEAREST.compare(Compare::LessEqual))
        .over(OneOf(vec![0.25_f32, 0.75]))
        .agrees_with(|depth: f64| if depth < 0.5 { 1.0 } else { 0.0 }, Abs(0.0));
    let levels = Texture::from_fn(4, 4, |_, _| Vec4::ONE);
    let quad = Quad { value: Vec2::splat(0.5), dx: Vec2::new(0.25, 0.0), dy: Vec2::new(0.0, 0.25) };
    of("mip").with("t", levels).over(Just(quad)).agrees_with(|_: Quad<DVec2>| 1.0, Abs(1e-6));
}
