//! Tests fragment entry points, whose invocations are the pixels of a draw.

use karat_engine::{
    F32, Options, Place, Priorities, Program, Resources, Schedule, Settings, pixel_of,
};

use crate::common::module;

const HEAD: &str = "@group(0) @binding(0) var<storage, read_write> d: array<f32>;\n\
                    @group(0) @binding(1) var<storage, read_write> count: atomic<u32>;\n\
                    fn at(p: vec2f) -> u32 { return u32(p.x) + 16u * u32(p.y); }\n\
                    @fragment fn main(@builtin(position) position: vec4f) {\n\
                        let p = position.xy; var x = p.x + 16.0 * p.y;\n";

fn lowered(body: &str) -> Program {
    let (module, info) = module(&format!("{HEAD}{body}\n}}\n"));
    Program::entry_point(&module, &info, "main", &Settings::default()).expect("it lowers")
}

fn resources() -> Resources {
    let mut resources = Resources::new();
    resources.set_buffer(0, 0, vec![0; 4 * 16 * 16]);
    resources.set_buffer(0, 1, vec![0; 4]);
    resources
}

/// Draws 11 x 5 pixels. Returns the contents of the buffers `d` and `count`.
fn drawn(body: &str, options: &Options) -> (Vec<f32>, u32) {
    let mut resources = resources();
    lowered(body).dispatch::<F32>([11, 5, 1], &mut resources, options, &()).expect("it runs");
    let words = |binding| -> Vec<u32> {
        let bytes = resources.buffer(0, binding).expect("it is bound").as_chunks().0;
        bytes.iter().map(|word| u32::from_le_bytes(*word)).collect()
    };
    (words(0).into_iter().map(f32::from_bits).collect(), words(1)[0])
}

/// Each pixel runs once, with its own position. Pixels outside of the draw write nothing.
#[test]
fn a_draw_runs_each_of_its_pixels() {
    let (left, count) =
        drawn("d[at(p)] += position.x + position.w; atomicAdd(&count, 1u);", &Options::default());
    assert_eq!(count, 55);
    for (index, value) in left.into_iter().enumerate() {
        let (x, y) = (index % 16, index / 16);
        let expected = if x < 11 && y < 5 { x as f32 + 1.5 } else { 0.0 };
        assert_eq!(value, expected, "({x}, {y})");
    }
    let numbers = (0..128).map(|number| pixel_of(number, 11));
    assert!((0..5).all(|y| (0..11).all(|x| numbers.clone().any(|pixel| pixel == [x, y]))));
}

/// A discarded pixel continues, so that its neighbours have derivatives. The discarded pixel has no other effect.
#[test]
fn a_discarded_pixel_gives_derivatives_and_writes_nothing() {
    let body = "if at(p) % 2u == 0u { discard; }\n\
                x = x * x; d[at(p)] = dpdx(x); atomicAdd(&count, 1u);\n\
                loop { if atomicCompareExchangeWeak(&count, 1000u, 0u).exchanged || at(p) % 2u == 1u { break; } }";
    for serial in [false, true] {
        let together = if serial { 1 } else { usize::MAX };
        let priorities = Priorities::Shuffled(3);
        let schedule = Schedule { priorities, together, ..Schedule::default() };
        for schedule in [Schedule::default(), schedule] {
            let options = Options { schedule: schedule.clone(), ..Options::default() };
            let (left, count) = drawn(body, &options);
            assert_eq!(count, 5 * 5, "{schedule:?}");
            for (index, value) in left.into_iter().enumerate() {
                let (x, y) = (index % 16, index / 16);
                let square = |x: usize| (x as f32 + 0.5 + 16.0 * (y as f32 + 0.5)).powi(2);
                let is_left = x < 11 && y < 5 && x % 2 == 1;
                let expected = if is_left { square(x) - square(x - 1) } else { 0.0 };
                assert_eq!(value, expected, "({x}, {y}) {schedule:?}");
            }
        }
    }
}

/// Pixels may race. Helper invocations don't race, and the engine doesn't check their indices.
#[test]
fn helper_invocations_cannot_race() {
    for (guard, expected) in [("", Some(([0, 0], [1, 0]))), ("if at(p) != 3u { discard; }", None)] {
        let body = format!("{guard} d[7] = x; d[at(p) * 1000u * u32(p.x > 10.0)] = d[9];");
        let program = lowered(&body);
        let options = Options::default();
        let mut resources = resources();
        let seen = program.observe_races([11, 5, 1], &mut resources, &options, None);
        let seen = seen.expect("it runs");
        assert_eq!(seen.invocations, 55);
        let race = seen.races.iter().find(|race| race.place == Place::Byte(28)).map(|race| {
            (pixel_of(race.first.invocation, 11), pixel_of(race.second.invocation, 11))
        });
        assert_eq!(race, expected, "{guard}");
        assert_eq!(seen.outside.is_empty(), expected.is_none(), "{guard}: {:?}", seen.outside);
    }
}

/// The engine refuses vertex entry points, and fragment entry points with inputs other than the position.
#[test]
fn other_inputs_of_a_draw_are_refused() {
    for input in ["@location(0) x: f32", "@builtin(front_facing) front: bool"] {
        let source = format!("@fragment fn main({input}) {{ }}");
        let (module, info) = module(&source);
        let refused = Program::entry_point(&module, &info, "main", &Settings::default());
        assert!(refused.is_err(), "{input}");
    }
    let (module, info) =
        module("@vertex fn main() -> @builtin(position) vec4f { return vec4f(); }");
    assert!(Program::entry_point(&module, &info, "main", &Settings::default()).is_err());
}
