//! Tests domains in tests without Rust: filters, relations, named vectors, and numbers that aren't finite.

use super::*;

const SHADERS: &str = "\
struct Frame { t: vec3f, b: vec3f, n: vec3f }
fn tangent(n: vec3f) -> vec3f {
    let axis = select(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), abs(n.x) > 0.7);
    return normalize(cross(axis, n));
}
fn leaning(n: vec3f) -> vec3f { return normalize(tangent(n) + 1e-2 * n); }
fn frame(n: vec3f) -> Frame { let t = tangent(n); return Frame(t, cross(n, t), n); }
fn mirrored(n: vec3f) -> Frame { let t = tangent(n); return Frame(t, cross(t, n), n); }
fn cosines(n: vec3f, t: vec3f, b: vec3f) -> f32 { return abs(dot(n, t)) + abs(dot(n, b)) + abs(dot(t, b)); }
fn ratio(a: f32, b: f32) -> f32 { return a / b; }
fn size(q: vec4f) -> f32 { return length(q); }
fn turn(v: vec2f) -> vec2f { return vec2f(-v.y, v.x); }
fn capped(x: f32) -> f32 { return min(x, 1.0); }
";

/// Runs the tests of a file on the engine.
fn declared(tests: &str) -> Ran {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "f.wgsl", SHADERS);
    write(folder.path(), "f.test.toml", tests);
    write(folder.path(), "capped.csv", "x,result\n2,1\ninf,1\n-0x1p-1,-0.5\n");
    karat(folder.path(), &["test", ".", "--paths", "cpu"])
}

#[test]
fn declared_domains_draw_the_cases_that_they_describe() {
    let ran = declared(
        "[[test]]\nfunction = \"tangent\"\nover = { n = \"unit_vector\" }\nperpendicular_to = \"n\"\nunit = true\n\
         [[test]]\nfunction = \"frame\"\nright_handed_frame = true\n\
         [[test]]\nfunction = \"cosines\"\nin_range = [0, 1e-6]\n\
         over = { n = \"unit_vector\", t = { perpendicular_to = \"n\" }, b = { perpendicular_to = [\"n\", \"t\"] } }\n\
         [[test]]\nfunction = \"ratio\"\nover = { a = \"0..1\", b = \"0..1\" }\nin_range = [0, 1]\n\
         where = \"a <= b && b > 1e-20\" # with a comment\n\
         [[test]]\nname = \"two of nine\"\nfunction = \"ratio\"\nover = { a = [1, 2, 4], b = [1, 2, 4] }\n\
         where = \"a > b + 1.5\"\nin_range = [2, 4]\n\
         [[test]]\nfunction = \"size\"\nover = { q = \"sphere 2\" }\nin_range = [1.9999, 2.0001]\n\
         [[test]]\nfunction = \"turn\"\nover = { v = \"sphere 3\" }\nperpendicular_to = \"v\"\n\
         [[test]]\nname = \"round\"\nfunction = \"turn\"\nover = { v = \"unit_vector\" }\nunit = true\n\
         [[test]]\nfunction = \"capped\"\ntable = \"capped.csv\"\ntolerance = \"exact\"\n",
    )
    .good();
    for part in ["is perpendicular to `n`", "is a right-handed frame", "has length 1"] {
        assert!(ran.contains(part), "{part}: {ran}");
    }
    // If a filter leaves few values of a domain, Karat enumerates all of them.
    let of_filter = |line: &&str| line.contains("lies in 2..=4");
    let line = ran.lines().find(of_filter).expect("its row");
    assert_eq!(line.split_whitespace().nth(3), Some("2"), "{line}");
}

#[test]
fn wrong_frames_and_domains_are_reported_at_their_place() {
    for (test, place, part) in [
        (
            "function = \"leaning\"\nperpendicular_to = \"n\"",
            "f.wgsl:6:1",
            "is perpendicular to `n`",
        ),
        (
            "function = \"mirrored\"\nright_handed_frame = true",
            "f.wgsl:8:1",
            "is a right-handed frame",
        ),
        (
            "function = \"ratio\"\nfinite = true\nover = { a = \"0..1\", b = \"0..1\" }\nwhere = \"a > b + 2.0\"",
            "f.test.toml:5:1",
            "a filter that rejects nearly all values: use narrower ranges",
        ),
        (
            "function = \"ratio\"\nfinite = true\nover = { a = [0, 1], b = [0, 1] }\nwhere = \"a > b + 2.0\"",
            "f.test.toml:5:1",
            "its filter keeps none of the arguments: a > b + 2.0",
        ),
        (
            "function = \"ratio\"\nfinite = true\nwhere = \"a < c\"",
            "f.test.toml:4:1",
            "`a < c`: no definition in scope",
        ),
        (
            "function = \"ratio\"\nfinite = true\nwhere = \"a + b\"",
            "f.test.toml:4:1",
            "expected to be `bool`",
        ),
        (
            "function = \"ratio\"\nfinite = true\nwhere = \"true\"",
            "f.test.toml:4:1",
            "names no argument",
        ),
        (
            "function = \"capped\"\ntable = \"capped.csv\"\ntolerance = \"exact\"\nwhere = \"x > 0.0\"",
            "f.test.toml:5:1",
            "`where` does nothing here",
        ),
        (
            "function = \"cosines\"\nfinite = true\nover = { t = { perpendicular_to = \"t\" } }",
            "f.test.toml:4:1",
            "`t`: a unit vector can't be perpendicular to itself",
        ),
        (
            "function = \"turn\"\nover = { v = \"ball 3\" }\nperpendicular_to = \"v\"",
            "f.wgsl:12:1",
            "is perpendicular to `v`",
        ),
        (
            "function = \"ratio\"\nfinite = true\nwhere = \"a < 0.5) || (b < 0.5\"",
            "f.test.toml:4:1",
            "brackets don't match",
        ),
        (
            "function = \"ratio\"\nover = { b = \"0.5..1\" }\nwhere = \"a < b\"\ntolerance = \"abs 1e-3\"\n\
             limit = { a = 0, through = [0.1, 0.01, 0.001], equals = 0 }",
            "f.test.toml:4:1",
            "names `a`, but `limit` sets this argument",
        ),
        ("function = \"turn\"\nperpendicular_to = \"u\"", "f.test.toml:3:1", "did you mean `v`?"),
        (
            "function = \"ratio\"\nperpendicular_to = \"a\"",
            "f.test.toml:3:1",
            "but this check needs a vector of floats",
        ),
    ] {
        let ran = declared(&format!("[[test]]\n{test}\n"));
        assert_eq!(ran.code, Some(1), "{test}: {ran:?}");
        let told = format!("--> {place}\n");
        assert!(ran.out.contains(&told) && ran.out.contains(part), "{test}: {ran:?}");
    }
}
