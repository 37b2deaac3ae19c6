//! Generated programs with a few atomics. A test of passes must find each outcome that at least one order of the
//! atomics can have.
//!
//! The programs have no races, so the outcome of a program depends only on the order of its atomics. A simple
//! interpreter in this file runs each program in all orders, and so finds all its outcomes.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use karat::compute::ComputeError;
use karat::prelude::*;

/// An atomic operation of a generated program.
#[derive(Clone, Copy, Debug)]
enum Atomic {
    Load,
    Store(u32),
    Add(u32),
    Max(u32),
    Exchange(u32),
}

/// The index of an element in the array of atomics, and the operation on this element.
type Step = (usize, Atomic);

const WORDS: usize = 3;

fn run((at, atomic): Step, memory: &mut [u32; WORDS]) -> u32 {
    let old = memory[at];
    memory[at] = match atomic {
        Atomic::Load => old,
        Atomic::Store(x) | Atomic::Exchange(x) => x,
        Atomic::Add(x) => old + x,
        Atomic::Max(x) => old.max(x),
    };
    if let Atomic::Store(_) = atomic { 0 } else { old }
}

/// All outcomes of a program. An outcome is the list of values that the last invocation reads in one order of the
/// atomics.
fn outcomes(program: &[Vec<Step>]) -> BTreeSet<Vec<u32>> {
    fn go(
        program: &[Vec<Step>],
        (memory, at, own): ([u32; WORDS], &mut Vec<usize>, &mut Vec<u32>),
        all: &mut BTreeSet<Vec<u32>>,
    ) {
        let mut ended = true;
        for who in 0..program.len() {
            let Some(step) = program[who].get(at[who]).copied() else { continue };
            ended = false;
            let mut memory = memory;
            let given = run(step, &mut memory);
            at[who] += 1;
            let is_last = who + 1 == program.len();
            own.extend(is_last.then_some(given));
            go(program, (memory, at, own), all);
            if is_last {
                own.pop();
            }
            at[who] -= 1;
        }
        if ended {
            all.insert(own.clone());
        }
    }
    let mut all = BTreeSet::new();
    go(program, ([0; WORDS], &mut vec![0; program.len()], &mut Vec::new()), &mut all);
    all
}

/// The WGSL text of a program. The last invocation writes 2 if it reads the values of `outcome`, and otherwise 1.
fn text(program: &[Vec<Step>], places: &[u32], outcome: &[u32]) -> String {
    let mut text = "@group(0) @binding(0) var<storage, read_write> a: array<atomic<u32>, 3>;\n\
                    @group(0) @binding(1) var<storage, read_write> out: array<u32, 1>;\n\
                    @compute @workgroup_size(8) fn main(@builtin(global_invocation_id) g: vec3u) {\n"
        .to_owned();
    let mut line = |own: String| writeln!(text, "{own}").expect("text takes text");
    for (who, (own, place)) in program.iter().zip(places).enumerate() {
        line(format!("    if g.x == {place}u {{"));
        for (number, (at, atomic)) in own.iter().enumerate() {
            line(match atomic {
                Atomic::Load => format!("        let r{number} = atomicLoad(&a[{at}]);"),
                Atomic::Store(x) => {
                    format!("        atomicStore(&a[{at}], {x}u); let r{number} = 0u;")
                }
                Atomic::Add(x) => format!("        let r{number} = atomicAdd(&a[{at}], {x}u);"),
                Atomic::Max(x) => format!("        let r{number} = atomicMax(&a[{at}], {x}u);"),
                Atomic::Exchange(x) => {
                    format!("        let r{number} = atomicExchange(&a[{at}], {x}u);")
                }
            });
        }
        if who + 1 == program.len() {
            let is =
                outcome.iter().enumerate().map(|(number, word)| format!("r{number} == {word}u"));
            let is: Vec<String> = is.collect();
            line(format!("        out[0] = 1u + u32({});", is.join(" && ")));
        }
        line("    }".to_owned());
    }
    text + "}\n"
}

/// A linear congruential generator with Knuth's constants, as in MMIX.
struct Random(u64);

impl Random {
    fn below(&mut self, count: u64) -> u64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % count
    }

    fn program(&mut self) -> Vec<Vec<Step>> {
        let step = |random: &mut Self| {
            let (at, x) = (random.below(2) as usize, 1 + random.below(3) as u32);
            let atomic = match random.below(5) {
                0 => Atomic::Load,
                1 => Atomic::Store(x),
                2 => Atomic::Add(x),
                3 => Atomic::Max(x),
                _ => Atomic::Exchange(x),
            };
            (at, atomic)
        };
        (0..2 + self.below(2))
            .map(|_| (0..2 + self.below(3)).map(|_| step(self)).collect())
            .collect()
    }
}

/// Runs a test of the program `text`. The test fails if `out[0]` differs from 1 after at least one order.
fn test(text: &str, workgroups: u32) -> Result<(), ComputeError> {
    let package = Package::from_source("m", text);
    let cpu = karat::unstable::executor::of(karat::Path::CPU).expect("it is always there");
    let passes = package.compute().with("a", Storage::new([0_u32; 3]));
    let passes = passes.with("out", Storage::new([0_u32])).dispatch("main", [workgroups, 1, 1]);
    let after = passes.on(cpu).after("out").unrecorded();
    after.try_agrees_with([1_u32], Abs(0.0)).map(drop)
}

/// A test that forbids an outcome fails nearly always, even if only an unusual order has this outcome.
// Lesson 216
#[test]
fn tests_nearly_always_find_outcomes_of_unusual_orders() {
    /// The number of generated programs. The tests must find the forbidden outcomes of at least `LEAST` programs.
    const COUNT: usize = 150;
    const LEAST: usize = 150;
    let mut random = Random(0x6f72_6465);
    let (mut tried, mut found) = (0, 0);
    while tried < COUNT {
        let program = random.program();
        let all: Vec<Vec<u32>> = outcomes(&program).into_iter().collect();
        if all.len() < 2 {
            continue;
        }
        let outcome = &all[random.below(all.len() as u64) as usize];
        // All invocations are in one workgroup, or each has its own.
        let places: Vec<u32> = match random.below(2) {
            0 => (0..program.len() as u32).map(|who| 2 * who + 1).collect(),
            _ => (0..program.len() as u32).map(|who| 8 * who + who).collect(),
        };
        let text = text(&program, &places, outcome);
        let groups = places.last().expect("there are some") / 8 + 1;
        match test(&text, groups) {
            // The usual order has this outcome.
            Err(ComputeError::Differs(_)) => continue,
            Err(ComputeError::Order(_)) => found += 1,
            Err(other) => panic!("{other}\n{text}"),
            Ok(()) => {}
        }
        tried += 1;
    }
    assert!(found >= LEAST, "{found} of {tried}");
}

/// A test that forbids an impossible outcome passes, even in orders in which the engine delays stores.
// Lesson 217: outcomes that no device has
#[test]
fn outcomes_of_no_order_are_never_met() {
    for (first, second) in [
        // Two reads of one atomic see the writes to it in order.
        (
            "atomicStore(&a[0], 1u); atomicStore(&a[0], 2u);",
            "let x = atomicLoad(&a[0]); let y = atomicLoad(&a[0]); out[0] = 1u + u32(x == 2u && y == 1u);",
        ),
        // An invocation reads its own store, or a later store.
        (
            "atomicStore(&a[0], 2u);",
            "atomicStore(&a[0], 1u); let x = atomicLoad(&a[0]); out[0] = 1u + u32(x == 0u);",
        ),
        // An invocation never reads an older value than it read before.
        (
            "atomicAdd(&a[0], 1u); atomicAdd(&a[0], 1u);",
            "let x = atomicLoad(&a[0]); let y = atomicLoad(&a[0]); out[0] = 1u + u32(x > y);",
        ),
        // If two invocations exchange a lock, exactly one gets it.
        (
            "if atomicExchange(&a[0], 1u) == 0u { atomicStore(&a[1], 1u); }",
            "let x = atomicExchange(&a[0], 1u); out[0] = 1u + u32(x == 0u && atomicLoad(&a[1]) == 1u);",
        ),
    ] {
        for workgroups in [1, 2] {
            test(&litmus(first, second, workgroups), workgroups)
                .unwrap_or_else(|error| panic!("{first}\n{second}\n{error}"));
        }
    }
}

/// A program with two invocations, in one workgroup or in two. One invocation runs the statements `first`, and the
/// other runs `second`.
fn litmus(first: &str, second: &str, workgroups: u32) -> String {
    let other = if workgroups == 1 { "g.x == 7u" } else { "g.x == 9u" };
    format!(
        "@group(0) @binding(0) var<storage, read_write> a: array<atomic<u32>, 3>;
         @group(0) @binding(1) var<storage, read_write> out: array<u32, 1>;
         @compute @workgroup_size(8) fn main(@builtin(global_invocation_id) g: vec3u) {{
             if g.x == 0u {{ {first} }} else if {other} {{ {second} }}
         }}"
    )
}

/// The litmus tests of relaxed atomics (Alglave et al. 2014, *Herding cats*). WGSL's atomics are relaxed: they allow
/// outcomes that no order of sequentially consistent atomics has. Karat finds these outcomes, with one exception: the
/// outcome that needs a store to take effect before an earlier load.
// Lesson 217
#[test]
fn outcomes_of_relaxed_atomics_are_met() {
    let store = |at: u32, x: u32| format!("atomicStore(&a[{at}], {x}u);");
    for (name, first, second, is_met) in [
        (
            "message passing",
            format!("{} {}", store(0, 42), store(1, 1)),
            "let f = atomicLoad(&a[1]); let d = atomicLoad(&a[0]); out[0] = 1u + u32(f == 1u && d == 0u);".to_owned(),
            true,
        ),
        (
            "store buffering",
            format!("{} atomicStore(&a[2], atomicLoad(&a[1]) + 1u);", store(0, 1)),
            format!("{} let x = atomicLoad(&a[0]); let y = atomicLoad(&a[2]); out[0] = 1u + u32(x == 0u && y == 1u);", store(1, 1)),
            true,
        ),
        (
            "S",
            format!("{} {}", store(0, 2), store(1, 1)),
            // The first invocation's store takes effect last.
            "let x = atomicLoad(&a[1]); let y = atomicExchange(&a[0], 1u); out[0] = 1u + u32(x == 1u && y == 0u);".to_owned(),
            true,
        ),
        (
            "R",
            format!("{} let y = atomicExchange(&a[1], 1u); atomicStore(&a[2], y + 1u);", store(0, 1)),
            format!("{} let x = atomicLoad(&a[0]); let y = atomicLoad(&a[2]); out[0] = 1u + u32(x == 0u && y == 1u);", store(1, 2)),
            true,
        ),
        (
            "2+2W",
            format!("{} {}", store(0, 1), store(1, 2)),
            format!(
                "{} {} let x = atomicLoad(&a[0]); let y = atomicLoad(&a[1]); out[0] = 1u + u32(x == 2u && y == 2u);",
                store(1, 1),
                store(0, 2)
            ),
            true,
        ),
        (
            "load buffering",
            format!("let x = atomicLoad(&a[0]); {} atomicStore(&a[2], x + 1u);", store(1, 1)),
            format!("let y = atomicLoad(&a[1]); {} let x = atomicLoad(&a[2]); out[0] = 1u + u32(y == 1u && x == 2u);", store(0, 1)),
            false,
        ),
    ] {
        for workgroups in [1, 2] {
            let found = test(&litmus(&first, &second, workgroups), workgroups);
            match found {
                Err(ComputeError::Order(order)) => assert!(is_met, "{name}: {order}"),
                Ok(()) => assert!(!is_met, "{name}"),
                Err(other) => panic!("{name}: {other}"),
            }
        }
    }
    // The message names both late stores, and not the atomic before them.
    let first = format!("atomicAdd(&a[2], 1u); {} {}", store(0, 42), store(1, 1));
    let second =
        "let f = atomicLoad(&a[1]); out[0] = 1u + u32(f == 1u && atomicLoad(&a[0]) == 0u);";
    let seen = test(&litmus(&first, second, 2), 2);
    let Err(ComputeError::Order(order)) = seen else { panic!("{seen:?}") };
    let late = &order.turns[1];
    assert!(late.contains(" runs `atomicStore(&a[0], 42u)` (<m>:4:"), "{late}");
    assert!(late.contains("before `atomicStore(&a[1], 1u)` (<m>:4:"), "{late}");
    // If sequentially consistent atomics have the outcome, too, the message doesn't mention relaxed ones.
    let seen = test(&litmus(&store(0, 1), "out[0] = 1u + atomicLoad(&a[0]);", 2), 2);
    let Err(ComputeError::Order(order)) = seen else { panic!("{seen:?}") };
    assert!(!order.to_string().contains("atomics are relaxed"), "{order}");
}

/// Other invocations see two atomic operations of an invocation in the written order only if a barrier or a pass
/// boundary lies between the operations, or if both operations use the same `u32`.
// Lesson 217
#[test]
fn only_barriers_passes_and_the_same_word_order_two_atomics() {
    let cpu = karat::unstable::executor::of(karat::Path::CPU).expect("it is always there");
    let text = "@group(0) @binding(0) var<storage, read_write> a: array<atomic<u32>, 3>;
        @group(0) @binding(1) var<storage, read_write> out: array<u32, 1>;
        @compute @workgroup_size(2) fn barrier(@builtin(local_invocation_index) i: u32) {
            if i == 0u { atomicStore(&a[0], 42u); }
            storageBarrier();
            if i == 0u { atomicStore(&a[1], 1u); }
            else { out[0] = 1u + u32(atomicLoad(&a[1]) == 1u && atomicLoad(&a[0]) == 0u); }
        }
        @compute @workgroup_size(2) fn together(@builtin(local_invocation_index) i: u32) {
            if i == 0u { atomicStore(&a[0], 42u << 1u | 1u); }
            else { let x = atomicLoad(&a[0]); out[0] = 1u + u32((x & 1u) == 1u && x >> 1u == 0u); }
        }
        @compute @workgroup_size(1) fn first() { atomicStore(&a[0], 42u); }
        @compute @workgroup_size(2) fn second(@builtin(local_invocation_index) i: u32) {
            if i == 0u { atomicStore(&a[1], 1u); }
            else { out[0] = 1u + u32(atomicLoad(&a[1]) == 1u && atomicLoad(&a[0]) == 0u); }
        }
        @compute @workgroup_size(2) fn nothing(@builtin(local_invocation_index) i: u32) {
            if i == 0u { atomicStore(&a[0], 42u); atomicStore(&a[1], 1u); }
            else { out[0] = 1u + u32(atomicLoad(&a[1]) == 1u && atomicLoad(&a[0]) == 0u); }
        }";
    let package = Package::from_source("m", text);
    for (entries, is_ordered) in [
        (&["barrier"][..], true),
        (&["together"], true),
        (&["first", "second"], true),
        (&["nothing"], false),
    ] {
        let passes = package.compute().with("a", Storage::new([0_u32; 3]));
        let passes = passes.with("out", Storage::new([0_u32])).on(cpu);
        let passes = entries.iter().fold(passes, |all, entry| all.dispatch(entry, [1, 1, 1]));
        let seen = passes.after("out").unrecorded().try_agrees_with([1_u32], Abs(0.0));
        assert_eq!(seen.is_ok(), is_ordered, "{entries:?}: {seen:?}");
    }
}
