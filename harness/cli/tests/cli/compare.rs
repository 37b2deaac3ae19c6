//! Tests `karat compare`.

use super::*;
use crate::repository::git;

#[test]
fn an_edit_is_compared_with_a_revision_and_with_a_folder() {
    let folder = project();
    let calc = folder.path().join("shaders").join("calc.wgsl");
    let before = std::fs::read_to_string(&calc).expect("it is there");
    git(folder.path(), &["init", "-q"]);
    git(folder.path(), &["add", "."]);
    git(folder.path(), &["commit", "-qm", "one"]);
    let same = karat(folder.path(), &["compare", "HEAD"]).good();
    assert!(same.contains("0 changed, 0 edited with the same results, 11 untouched"), "{same}");
    let after = before
        .replace("return TWO * x;", "return x + x; /* the same */")
        .replace("return -x;", "return select(-x, x, x > 2);")
        .replace("fn third() -> f32", "fn third() -> f32 /* a third */");
    std::fs::write(&calc, &after).expect("written");
    let ran = karat(folder.path(), &["compare", "HEAD", "--paths", "cpu,vulkan"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "same       calc::double",
        "changed    calc::negate  shaders/calc.wgsl:",
        "    cpu: ",
        "    vulkan: ",
        "at x = 3: -3 -> 3",
        "1 changed, 1 edited with the same results, 9 untouched",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in {}", ran.out);
    }
    let old = tempfile::tempdir().expect("a temporary folder");
    write(old.path(), "calc.wgsl", &before);
    write(old.path(), "constants.wgsl", SHADERS[0].1);
    let old = old.path().display().to_string();
    let found = json(&karat(folder.path(), &["compare", &old, "--json", "--only", "negate"]).out);
    assert_eq!(
        (&found[0]["change"], &found[0]["paths"][0]["after"]),
        (&"changed".into(), &"3".into())
    );
    // In a folder of shaders without Cargo, the command needs no names. The report lists functions that can't be
    // called.
    let alone = tempfile::tempdir().expect("a temporary folder");
    let draws = "@fragment fn fs() -> @location(0) vec4f { return vec4f(1.0); }\n";
    write(
        alone.path(),
        "calc.wgsl",
        &format!("fn half(x: f32) -> f32 {{ return 0.5 * x; }}\n{draws}"),
    );
    git(alone.path(), &["init", "-q"]);
    git(alone.path(), &["add", "."]);
    git(alone.path(), &["commit", "-qm", "one"]);
    let same = karat(alone.path(), &["compare", "HEAD"]).good();
    assert!(same.contains("0 changed, 0 edited with the same results, 2 untouched"), "{same}");
    let edited = draws.replace("1.0", "0.5");
    write(
        alone.path(),
        "calc.wgsl",
        &format!("fn half(x: f32) -> f32 {{ return x * 0.5; }}\n{edited}"),
    );
    let ran = karat(alone.path(), &["compare", "HEAD"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "4096 inputs\n    generated from -1048576 to 1048576, with half of the values from -4 to 4: x",
        "changed    calc::fs  calc.wgsl:2:11",
        "1 changed, 1 edited with the same results, 0 untouched",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in {}", ran.out);
    }
    // If no input reaches an edited line, the results are equal only because the line didn't run.
    let bounded = "fn bounded(x: f32) -> f32 {\n    if x * x == 1234.56 {\n        return 2.0;\n    }\n    return x;\n}\n";
    write(alone.path(), "calc.wgsl", &bounded.replace("2.0", "3.0"));
    let old = tempfile::tempdir().expect("a temporary folder");
    write(old.path(), "calc.wgsl", bounded);
    let ran = karat(alone.path(), &["compare", &old.path().display().to_string()]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "same       calc::bounded",
        "    no input reaches calc.wgsl:3:9: return 3.0;\n",
        "0 changed, 1 edited with the same results, 0 untouched; no input reaches 2 lines that the edit changed\n",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in {}", ran.out);
    }
    // A new function changes no result if nothing called it before.
    write(alone.path(), "calc.wgsl", &format!("{bounded}fn more() -> f32 {{ return 1.0; }}\n"));
    let more = karat(alone.path(), &["compare", &old.path().display().to_string()]).good();
    assert!(more.starts_with("added      calc::more  ("), "{more}");
    assert!(
        more.contains(" of 2)\nfunctions: 0 changed, 1 added, 0 edited with the same"),
        "{more}"
    );
    for (wrong, part) in [
        (&["nowhere"][..], "neither a folder nor a revision"),
        (&["--upload-pack=x"], "unexpected argument"),
        (&["HEAD", "--only", "nothing"], "a function with `nothing` in its name"),
        (&["HEAD", "--paths", "vulcan"], "did you mean `vulkan`"),
        (&["HEAD", "--cases", "0"], "0 is not in"),
    ] {
        let error = karat(folder.path(), &[&["compare"], wrong].concat()).error();
        assert!(error.contains(part), "{error}");
    }
}

/// `karat compare` detects an edit that swaps two parameters, or that makes a function read another texture or sampler.
#[test]
fn swapped_textures_and_samplers_are_a_change() {
    let old = "@group(0) @binding(0) var ga: texture_2d<f32>;\n\
               @group(0) @binding(1) var gb: texture_2d<f32>;\n\
               fn two(a: texture_2d<f32>, b: texture_2d<f32>, s: sampler, t: sampler, uv: vec2f) -> f32 {\n    \
               return textureSampleLevel(a, s, uv, 0.0).x;\n}\n\
               fn loaded(p: vec2u) -> f32 { return textureLoad(ga, p % 16u, 0).x; }\n";
    let (before, after) =
        (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("one"));
    write(before.path(), "m.wgsl", old);
    let revision = before.path().display().to_string();
    let compared = |from: &str, to: &str| {
        assert!(old.contains(from));
        write(after.path(), "m.wgsl", &old.replace(from, to));
        karat(after.path(), &["compare", &revision, "--paths", "cpu"])
    };
    for (from, to, change) in [
        ("(a, s, uv", "(b, s, uv", "changed    m::two"),
        ("(a, s, uv", "(a, t, uv", "changed    m::two"),
        ("Load(ga", "Load(gb", "changed    m::loaded"),
        (
            "(a: texture_2d<f32>, b: texture_2d<f32>",
            "(b: texture_2d<f32>, a: texture_2d<f32>",
            "signature  m::two",
        ),
    ] {
        let ran = compared(from, to);
        assert!(ran.code == Some(1) && ran.out.contains(change), "{to}: {ran:?}");
    }
    assert!(compared("return", "return ").good().contains("0 changed"), "a blank is no edit");
}

/// Verdicts are numbered: of seven verdicts, the first has the number `(1 of 7)`. The last line of the output
/// counts the functions that Karat didn't compare completely.
#[test]
fn verdicts_come_with_their_count() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let slow = "fn slow(x: f32) -> f32 {\n    var sum = 0.0;\n    for (var i = 0u; i < 900u; i++) {\n        \
                for (var j = 0u; j < 64u; j++) { sum += x * f32(j); }\n    }\n    return sum;\n}\n";
    let quick: String =
        (0..6).map(|n| format!("fn quick{n}x(x: f32) -> f32 {{ return x * {n}.5; }}\n")).collect();
    let before = format!("{slow}{quick}");
    write(folder.path(), "before/m.wgsl", &before);
    write(folder.path(), "after/m.wgsl", &before.replace("x * ", "1.0 * x * "));
    let ran = karat(folder.path(), &["compare", "before", "--shaders", "after"]);
    assert_eq!(ran.code, Some(1), "what isn't looked at whole isn't the same: {ran:?}");
    let lines: Vec<&str> = ran
        .out
        .lines()
        .filter(|line| line.starts_with("same") || line.starts_with("unjudged"))
        .collect();
    let counts: Vec<&str> = lines.iter().filter_map(|line| line.rsplit('(').next()).collect();
    assert_eq!(
        counts,
        ["1 of 7)", "2 of 7)", "3 of 7)", "4 of 7)", "5 of 7)", "6 of 7)", "7 of 7)"]
    );
    let slow = lines.iter().find(|line| line.contains("m::slow")).expect("it has a verdict");
    assert!(slow.starts_with("unjudged") && slow.contains("Karat compared only"), "{slow}");
    let last = ran.out.lines().last().unwrap_or_default();
    assert!(last.contains("1 edited but not compared, 6 edited with the same results"), "{last}");
    assert!(last.contains("inputs left out, because loops ran too long"), "{last}");
    let found = karat(folder.path(), &["compare", "before", "--shaders", "after", "--json"]);
    let names: Vec<String> = json(&found.out)
        .as_array()
        .expect("a list")
        .iter()
        .map(|one| one["function"].as_str().unwrap_or_default().to_owned())
        .collect();
    assert!(names.is_sorted() && names.len() == 7, "one document, by names: {names:?}");
}
