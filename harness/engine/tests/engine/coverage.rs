//! Tests how often statements run, and how often lanes take each branch.

use std::sync::Arc;

use karat_engine::{Count, F32, Options, Program, Resources, Settings, StatementKind};

use crate::common;

/// Calls the function `f` of `text` with the arguments `x`. Returns for each statement its text, its kind, `true` if a
/// result depends on the statement, and its counts.
fn counted(text: &str, x: &[f32]) -> Vec<(String, StatementKind, bool, Count)> {
    let (module, info) = common::module(text);
    let settings = Settings { statements: true, ..Settings::default() };
    let program = Program::function(&module, &info, "f", &settings).expect("it lowers");
    let rows: Vec<u32> = x.iter().map(|x| x.to_bits()).collect();
    let counts = program.counts().expect("statements are listed");
    let options = Options { counts: Some(Arc::clone(&counts)), ..Options::default() };
    let own = program.call::<F32>(x.len(), &rows, &Resources::new(), &options, &());
    let plain = Program::function(&module, &info, "f", &Settings::default()).expect("it lowers");
    let usual = plain.call::<F32>(x.len(), &rows, &Resources::new(), &Options::default(), &());
    assert_eq!(own.expect("it runs").words(), usual.expect("it runs").words());
    let text_of = |span: naga::Span| text[span.to_range().expect("it is written")].to_owned();
    // `statements` lists each statement that runs.
    let there = karat_engine::statements(&module);
    let known = |one: &karat_engine::Statement| {
        there.iter().any(|own| (own.span, own.kind) == (one.span, one.kind))
    };
    let all = program.counted(&counts).inspect(|(one, _)| assert!(known(one), "{one:?}"));
    all.map(|(one, count)| (text_of(one.span), one.kind, one.needed, count)).collect()
}

/// The counts of the first statement of this kind that contains `text`.
fn of<'a>(
    all: &'a [(String, StatementKind, bool, Count)],
    kind: StatementKind,
    text: &str,
) -> &'a Count {
    let found = all.iter().find(|one| one.1 == kind && one.0.contains(text));
    found.map(|one| &one.3).unwrap_or_else(|| panic!("no {kind:?} `{text}` in {all:#?}"))
}

// Lesson 28: lines, branches and results that no test compares
#[test]
fn cases_are_counted_on_each_branch() {
    let text = "fn side(x: f32) -> f32 { if (x > 0.0) { return 2.0 * x; } return -x; }\n\
                fn f(x: f32) -> f32 {\n    var y = side(x);\n    if (x > 10.0 && y < 50.0) {\n        y += 1.0;\n    } else {\n        y -= 1.0;\n    }\n    \
                switch (i32(x)) { case 1, 2: { y *= 3.0; } case 3: { y *= 4.0; } default: { y *= 5.0; } }\n    \
                return select(y, x, x > 100.0);\n}\n";
    // There are more lanes than a chunk has, so the first cases of the ways are in different chunks.
    let mut x = vec![-1.0; 700];
    (x[300], x[301], x[600], x[601]) = (1.0, 2.0, 20.0, 40.0);
    let all = counted(text, &x);
    let [plain, branch] = [StatementKind::Plain, StatementKind::If];
    let first = of(&all, plain, "2.0 * x");
    assert_eq!((first.lanes, first.first), (4, Some(300)));
    assert_eq!(of(&all, branch, "if (x > 0.0)").ways[..2], [4, 696]);
    assert_eq!(of(&all, branch, "x > 10.0 && y").ways[..2], [2, 698]);
    assert_eq!(of(&all, branch, "if (x > 10.0").ways[..2], [1, 699]);
    let more = of(&all, plain, "y += 1.0");
    assert_eq!((more.lanes, more.first), (1, Some(600)));
    assert_eq!(of(&all, plain, "y -= 1.0").lanes, 699);
    let clause = |number| of(&all, StatementKind::Clause(number), "switch").ways[0];
    assert_eq!([clause(0), clause(1), clause(2)], [2, 0, 698]);
    assert_eq!(of(&all, plain, "y *= 4.0"), &Count::default());
    assert_eq!(of(&all, StatementKind::Select, "select").ways[..2], [0, 700]);
    assert_eq!(of(&all, plain, "side(x)").lanes, 700);
}

// Lesson 28: lines, branches and results that no test compares
#[test]
fn rounds_of_loops_are_counted_separately() {
    let text = "fn f(x: f32) -> f32 {\n    var y = 0.0;\n    for (var i = 0.0; i < x; i += 1.0) {\n        \
                if (i > 5.0) { break; }\n        y += 2.0;\n    }\n    loop {\n        y += 1.0;\n        continuing { break if y > 3.0; }\n    }\n    return y;\n}\n";
    let all = counted(text, &[0.0, 0.0, 0.0, 1.0, 9.0, 2.0]);
    // A loop ends in its first iteration if its condition doesn't hold. The three calls run 0, 1 and more iterations of
    // the body.
    assert_eq!(of(&all, StatementKind::Loop, "for (").ways, [3, 1, 2]);
    // The argument 0 needs 4 iterations, 2 needs 2 iterations, and 12 and 4 need 1 iteration.
    assert_eq!(of(&all, StatementKind::Loop, "loop {").ways, [2, 1, 3]);
    assert_eq!(of(&all, StatementKind::Plain, "y += 2.0").lanes, 1 + 6 + 2);
    assert_eq!(of(&all, StatementKind::If, "if (i > 5.0)").ways[..2], [1, 9]);
}

/// A statement is needed if a result of the function, or a value in a buffer, depends on it.
// Lesson 28: lines, branches and results that no test compares
#[test]
fn expressions_without_influence_are_not_needed() {
    let text = "fn f(x: f32) -> f32 {\n    let used = x * 2.0;\n    let unused = x * 3.0;\n    var a = array<f32, 3>(1.0, 2.0, 3.0);\n    var dead = 0.0;\n    \
                if (x > 4.0) { dead = unused; }\n    if (x > 5.0) { a[u32(x) % 3u] = x * 6.0; }\n    a[1] = x * 9.0;\n    var b = array<f32, 3>();\n    b[u32(x) % 3u] = x * 11.0;\n    if (x > 7.0) { return x * 8.0; }\n    \
                for (var i = 0; i < 9; i += 1) { dead += x * 10.0; }\n    return used + a[u32(x) % 2u] + b[2];\n}\n";
    let all = counted(text, &[1.0, 6.0, 9.0]);
    let is = |one: &(String, StatementKind, bool, Count), text: &str| {
        one.0.contains(text) && one.2 && one.1 != StatementKind::Loop
    };
    let needed = |text: &str| all.iter().any(|one| is(one, text));
    for used in [
        "x * 2.0",
        "x * 6.0",
        "x * 9.0",
        "x * 11.0",
        "x * 8.0",
        "if (x > 5.0)",
        "if (x > 7.0)",
        "used + a",
    ] {
        assert!(needed(used), "{used} is needed: {all:#?}");
    }
    // A test sees if the loop ends, but doesn't see its sum.
    assert!(needed("i < 9"), "{all:#?}");
    for unused in ["x * 3.0", "dead = unused", "if (x > 4.0)", "dead += x * 10.0;"] {
        assert!(!needed(unused), "{unused} isn't needed: {all:#?}");
    }
}

/// In a pass, the counts include the invocations of all workgroups, but no helper invocations.
#[test]
fn invocations_are_counted() {
    let text = "@group(0) @binding(0) var<storage, read_write> out: array<u32>;\nvar<workgroup> sum: u32;\nvar<workgroup> lost: u32;\n\
                @compute @workgroup_size(8) fn f(@builtin(global_invocation_id) id: vec3u) {\n    let unread = id.x * 5u;\n    if (id.x == 3u) { sum = 7u; }\n    \
                if (id.x == 4u) { lost = 8u; }\n    workgroupBarrier();\n    if (id.x < 10u) { out[id.x] = sum; }\n}\n";
    let (module, info) = common::module(text);
    let settings = Settings { statements: true, ..Settings::default() };
    let program = Program::entry_point(&module, &info, "f", &settings).expect("it lowers");
    let counts = program.counts().expect("statements are listed");
    let options = Options { counts: Some(Arc::clone(&counts)), ..Options::default() };
    let mut resources = Resources::new();
    resources.set_buffer(0, 0, vec![0; 64]);
    program.dispatch::<F32>([2, 1, 1], &mut resources, &options, &()).expect("it runs");
    let lanes = |part: &str| {
        let own = program
            .counted(&counts)
            .find(|(one, _)| text[one.span.to_range().expect("it is written")].starts_with(part));
        own.map(|(one, count)| (count.lanes, count.first, one.needed)).expect("it is listed")
    };
    assert_eq!(lanes("sum = 7u"), (1, Some(3), true));
    assert_eq!(lanes("lost = 8u"), (1, Some(4), true), "the sanitizer checks it");
    assert_eq!(lanes("id.x * 5u"), (16, Some(0), false), "nothing reads it");
    assert_eq!(lanes("out[id.x] = sum"), (10, Some(0), true));
    assert_eq!(lanes("workgroupBarrier"), (16, Some(0), true));
}
