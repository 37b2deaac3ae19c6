//! Tests that Karat compares fixtures with the variables to which they are bound.

use karat::prelude::*;

use crate::known_issues::selected;

karat::shareable! {
    struct Gains mirrors GainsMirror { gain: f32, bias: f32 }
}

karat::shareable! {
    struct Swapped mirrors SwappedMirror { bias: f32, gain: f32 }
}

/// Karat compares the type of a fixture with the type of its variable, including the names of struct members.
#[test]
fn fixtures_of_another_type() {
    let wgsl = "struct Gains { gain: f32, bias: f32 }\n\
                @group(0) @binding(0) var<uniform> gains: Gains;\n\
                @group(0) @binding(1) var<storage, read> table: array<f32>;\n\
                fn f(x: f32) -> f32 { return gains.gain * x + gains.bias + table[0]; }";
    let package = Package::from_source("planted", wgsl);
    let check = |gains: Uniform, table: Storage| {
        let probe = package.function("f").with("gains", gains).with("table", table);
        probe.over(0.0..=1.0).unrecorded().try_agrees_with(|x: f64| 2.0 * x + 3.5, Abs(1e-6))
    };
    let right = || Uniform::new(Gains { gain: 2.0, bias: 3.0 });
    let table = || Storage::new([0.5_f32]);
    check(right(), table()).expect("the fixtures fit");
    let swapped = Uniform::new(Swapped { bias: 3.0, gain: 2.0 });
    let wrong = [
        (
            swapped,
            table(),
            "holds { gain: f32, bias: f32 }, but the fixture holds { bias: f32, gain: f32 }",
        ),
        (
            Uniform::new([1.0_f32; 2]),
            table(),
            "holds { gain: f32, bias: f32 }, but the fixture holds array",
        ),
        (right(), Storage::new([7_u32]), "holds f32, but the fixture holds u32"),
        (right(), Storage::new(Vec::<f32>::new()), "is empty"),
    ];
    for (gains, table, message) in wrong {
        let error = check(gains, table).expect_err(message).to_string();
        assert!(error.contains(message), "{error}");
    }
}

/// Two variables of a frame may have the same binding number if no draw uses both. Each draw then reads the fixture of
/// its own variable. Karat reports an error if one draw uses both variables.
// Lesson 70
#[test]
fn a_fixture_that_another_one_hides() {
    let wgsl = "@group(0) @binding(0) var<uniform> near: vec4f;\n\
                @group(0) @binding(0) var<uniform> far: vec4f;\n\
                @vertex fn corners(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {\n    \
                    return vec4f(4.0 * f32(i & 1u) - 1.0, 4.0 * f32(i >> 1u) - 1.0, 1.0, 1.0);\n}\n\
                @vertex fn moved(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {\n    \
                    return vec4f(4.0 * f32(i & 1u) - 1.0, 4.0 * f32(i >> 1u) - 1.0, near.w, 1.0);\n}\n\
                @fragment fn first() -> @location(0) vec4f { return near; }\n\
                @fragment fn second() -> @location(0) vec4f { return far; }";
    let package = Package::from_source("planted", wgsl);
    let frame = |vertex: &str| {
        package
            .frame("", 4, 4)
            .fullscreen("corners", "first")
            .fullscreen(vertex, "second")
            .blend(karat::draw::Blend::Add)
            .with("near", Uniform::new(glam::Vec4::splat(0.25)))
            .with("far", Uniform::new(glam::Vec4::ONE))
    };
    for path in selected() {
        let image = frame("corners").render(path).expect("each draw has its fixture");
        assert!(image.pixels().iter().all(|pixel| *pixel == [1.25; 4]), "{:?}", image.pixels()[0]);
        let error = frame("moved").render(path).expect_err("one draw, one binding").to_string();
        assert_eq!(
            error,
            "`near` and `far` are both @group(0) @binding(0), and a shader can use only one of \
             them: give one of the two variables another number"
        );
    }
}
