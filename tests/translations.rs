//! Tests the library's translations by naga. On each route, each function and entry point reaches the status that
//! `docs/translations.md` shows. `cargo ci matrix` writes this page.

use std::collections::BTreeMap;

use karat::Package;
use karat_inspect::matrix::{Column, Matrix, Status};
use shaders::PBR;

/// The columns of the table: the paths and routes that CI tests.
const COLUMNS: [&str; 8] =
    ["vulkan", "gl", "vulkan:wgsl", "vulkan:spirv", "vulkan:glsl", "vulkan:hlsl", "metal", "cpu"];

/// The modules that the test translates by default. Together they have rows of each kind, and each kind of known
/// failure. With `SUITES=whole`, the test translates all modules.
const SAMPLE: [&str; 7] = [
    "environment::",
    "fresnel::",
    "layering::",
    "maps::",
    "materials::",
    "overdraw::",
    "sampling::",
];

fn is_asked(row: &str) -> bool {
    frames::are_suites_whole() || SAMPLE.iter().any(|module| row.contains(module))
}

/// The text of each cell of a table, by row and then by column.
type Words = BTreeMap<String, BTreeMap<String, String>>;

/// Reads the texts in the cells of a page's table.
fn words(page: &str) -> Words {
    let cells = |line: &str| -> Vec<String> {
        let inside = line.trim().trim_matches('|').split('|');
        inside.map(|cell| cell.trim().to_owned()).collect()
    };
    let mut lines = page.lines().skip_while(|line| !line.starts_with("| row |"));
    let columns = lines.next().map(cells).unwrap_or_default();
    let rows = lines.skip(1).take_while(|line| line.starts_with('|')).map(cells);
    rows.map(|row| {
        let words = columns.iter().cloned().zip(row.iter().cloned()).skip(1).collect();
        (row[0].clone(), words)
    })
    .collect()
}

/// The differences of the table `made` from the table `written`: changed cells, and rows that are new or gone.
fn differences(written: &Words, made: &Words) -> Vec<String> {
    let mut found = Vec::new();
    for (row, words) in made {
        let Some(known) = written.get(row) else {
            found.push(format!("{row} is new"));
            continue;
        };
        for (column, word) in words {
            match known.get(column) {
                Some(known) if known != word => {
                    found.push(format!("{row} on {column}: {word}, and was {known}"));
                }
                Some(_) => {}
                None => found.push(format!("{column} is new")),
            }
        }
    }
    let gone = written.keys().filter(|row| !made.contains_key(*row));
    found.extend(gone.map(|row| format!("{row} is gone")));
    found
}

fn matrix() -> Matrix {
    let columns = COLUMNS.map(|name| name.parse::<Column>().expect("a column"));
    let request = karat_inspect::matrix(&PBR).columns(columns);
    let request = if frames::are_suites_whole() { request } else { request.only(SAMPLE) };
    let vulkan =
        karat::unstable::path::adapter(karat::Path::VULKAN).map(|adapter| adapter.family());
    let request = match vulkan.as_deref() {
        Ok("swiftshader") => request.fails_on(
            "cpu",
            "as_written::specular::estimate",
            Status::Agrees,
            "few samples of a texture, whose cosines cancel: the two are within WGSL's bounds",
        ),
        _ => request,
    };
    request.run().expect("the library is valid")
}

/// The columns for which the page names another driver than this machine's, and the columns without a driver.
fn run_elsewhere(page: &str, matrix: &Matrix) -> Vec<String> {
    let elsewhere = matrix.columns.iter().filter(|column| {
        let line = page.lines().find(|line| line.starts_with(&format!("| {} |", column.name)));
        let adapter = column.adapter.as_deref();
        !line.is_some_and(|line| adapter.is_some_and(|adapter| line.contains(adapter)))
    });
    let elsewhere: Vec<String> = elsewhere.map(|column| column.name.clone()).collect();
    // Each column is compared with the first column.
    match matrix.columns.first().is_some_and(|first| elsewhere.contains(&first.name)) {
        true => {
            let runs = matrix.columns.iter().filter(|column| column.adapter.is_some());
            runs.map(|column| column.name.clone()).chain(elsewhere).collect()
        }
        false => elsewhere,
    }
}

/// In `columns`, replaces `valid` and all better statuses by one text, because the exact status depends on the driver.
fn as_far_as_valid(words: &mut Words, columns: &[String]) {
    for (_, word) in words.values_mut().flatten().filter(|(column, _)| columns.contains(column)) {
        if ["valid", "executed", "agrees", "known"].contains(&word.as_str()) {
            *word = "valid, at least".to_owned();
        }
    }
}

/// Compares the statuses on this machine with the page. If this machine has another driver than the page, a status only
/// needs to be at least `valid` where the page shows `valid` or better.
// Lesson 81
#[cfg_attr(not(target_os = "linux"), ignore = "the page is that of Mesa's drivers")]
#[test]
fn each_row_gets_as_far_as_the_page_says() {
    let page =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/translations.md"));
    let page = page.expect("the page is there");
    let mut written = words(&page);
    written.retain(|row, _| is_asked(row));
    let matrix = matrix();
    let elsewhere = run_elsewhere(&page, &matrix);
    // `shaders/karat.toml` declares the failures.
    matrix.expect_no_findings();
    // naga's GLSL divides by a size that may be 0.
    let outside: Vec<(&str, &str)> = matrix
        .rows
        .iter()
        .flat_map(|row| row.columns_outside().map(|(column, _)| (&*row.name, column)))
        .map(|(row, column)| (row, &*matrix.columns[column].name))
        .collect();
    let known = ["gl", "vulkan:glsl"].map(|column| ("maps::texel_direction", column));
    for (row, column) in &outside {
        assert!(known.contains(&(*row, *column)), "{row} on {column} is outside of WGSL");
    }
    let gl = || elsewhere.iter().all(|column| column != "gl");
    assert!(!outside.is_empty() || !gl(), "naga divides as WGSL does now: delete this");
    let bounded =
        |cell: &karat_inspect::matrix::Cell| cell.allowed.as_ref().map_or(0, |a| a.bounded);
    let bounded: usize = matrix.rows.iter().flat_map(|row| &row.cells).map(bounded).sum();
    let least = if frames::are_suites_whole() { 400_000 } else { 200_000 };
    assert!(bounded > least, "WGSL bounds {bounded} results only");
    let mut made = words(&matrix.markdown());
    for words in [&mut written, &mut made] {
        as_far_as_valid(words, &elsewhere);
    }
    let least = if frames::are_suites_whole() { 200 } else { 70 };
    assert!(written.len() > least && made.len() > least, "{} and {}", written.len(), made.len());
    let found = differences(&written, &made);
    assert!(
        found.is_empty(),
        "not as docs/translations.md says; `cargo ci matrix` writes it anew:\n{}",
        found.join("\n")
    );
}

/// `differences` reports a changed cell, a new row, a missing row and a new column.
#[test]
fn another_page_is_seen() {
    let page =
        "| row | a | b |\n|---|---|---|\n| f | valid | agrees |\n| g | valid | valid |\n\n## x";
    let written = words(page);
    assert_eq!(written["f"]["b"], "agrees");
    assert!(differences(&written, &written).is_empty());
    for (changed, seen) in [
        (page.replace("agrees", "DIFFERS"), "f on b: DIFFERS, and was agrees"),
        (page.replace("| g |", "| h |"), "h is new"),
        (page.replace("| g | valid | valid |\n", ""), "g is gone"),
        (page.replace("| b |", "| c |"), "c is new"),
    ] {
        let found = differences(&written, &words(&changed));
        assert!(found.iter().any(|line| line == seen), "{found:?}");
    }
}

/// Checks that naga's translation has the fault that `reason` describes: in `column`, the function `row` doesn't reach
/// `status`, but the other functions of `module` do.
fn naga_fails(column: &str, status: Status, module: &str, row: &str, reason: &str) {
    let package = Package::from_modules("bugs", [("bugs", module)]);
    let columns = ["vulkan", column].map(|name| name.parse().expect("a column"));
    let matrix = karat_inspect::matrix(&package).columns(columns).run().expect("it is valid");
    matrix.expect("vulkan", Status::Valid);
    if column == "vulkan:glsl" {
        // This row has values that GLSL leaves undefined, which may be right on this machine. The values of the other
        // rows must be right.
        matrix.expect(column, Status::Executed);
        let cells = matrix.rows.iter().filter(|other| other.name != row).flat_map(|row| &row.cells);
        assert!(cells.clone().count() > 0 && cells.clone().all(|cell| cell.status == Some(status)));
        return;
    }
    matrix.expect_but(column, status, &[(row, reason)]);
}

/// A path that runs naga's GLSL: `gl`, or `vulkan:glsl` on machines without GL.
fn glsl_path() -> &'static str {
    if karat::unstable::path::adapter(karat::Path::GL).is_ok() { "gl" } else { "vulkan:glsl" }
}

/// GLSL allows `invariant` only for outputs. If a vertex and a fragment shader share a struct, naga also writes
/// `invariant` for the position that the fragment shader receives. Mesa accepts this mistake.
#[test]
fn positions_of_fragments_are_invariant_in_glsl() {
    let module = "struct Shared { @invariant @builtin(position) at: vec4f }\n\
                  struct Plain { @builtin(position) at: vec4f }\n\
                  @fragment fn shade(in: Shared) -> @location(0) vec4f { return in.at; }\n\
                  @fragment fn plain(in: Plain) -> @location(0) vec4f { return in.at; }\n";
    naga_fails(
        "glsl",
        Status::Valid,
        module,
        "bugs::shade",
        "naga 30.0.1 writes `invariant` for an input of a fragment shader",
    );
}

/// If a shader loads a texel at unsigned coordinates, naga clamps the coordinates. For the clamp, naga writes a
/// constant `vec2u` from two components of type `i32` (`OpConstantComposite %v2uint %int_1 %int_1`). `spirv-val` 2023.1
/// and Mesa accept this SPIR-V, but naga itself can't read it.
#[test]
fn unsigned_texel_coordinates_are_clamped_by_signed_ones() {
    let module = "@group(0) @binding(0) var image: texture_2d<f32>;\n\
                  fn unsigned_texel(at: vec2u) -> vec4f { return textureLoad(image, at, 0); }\n\
                  fn signed_texel(at: vec2i) -> vec4f { return textureLoad(image, at, 0); }\n";
    naga_fails(
        "vulkan:spirv",
        Status::Executed,
        module,
        "bugs::unsigned_texel",
        "naga 30.0.1 makes a constant vec2u of two i32",
    );
}

/// GLSL leaves `%` of negative operands and division by 0 undefined. In other languages, naga writes code that handles
/// these cases, but not in GLSL. So on Mesa's GL the results differ from the values that WGSL requires.
#[cfg_attr(not(target_os = "linux"), ignore = "another driver's GL may have the right values")]
#[test]
fn remainders_of_negative_integers_differ_in_glsl() {
    let module = "fn remainder(a: i32, b: i32) -> i32 { return a % (b * b + 1); }\n\
                  fn quotient(a: i32, b: i32) -> i32 { return a / (b * b + 1); }\n";
    naga_fails(
        glsl_path(),
        Status::Agrees,
        module,
        "bugs::remainder",
        "naga 30.0.1 writes GLSL's `%`, which is undefined for negative operands",
    );
}

/// WGSL clamps a float outside an integer's range: -1 becomes 0 as a `u32`. naga clamps in SPIR-V, HLSL and MSL, but
/// writes a plain conversion in GLSL, which leaves the result undefined. This fault affects shaders of Bevy (light
/// clusters) and of `kludgine`.
#[cfg_attr(not(target_os = "linux"), ignore = "another driver's GL may have the right values")]
#[test]
fn floats_out_of_range_become_other_integers_in_glsl() {
    let module = "fn whole(x: f32) -> u32 { return u32(x); }\n\
                  fn clamped(x: f32) -> u32 { return u32(clamp(x, 0.0, 4.0)); }\n";
    naga_fails(
        glsl_path(),
        Status::Agrees,
        module,
        "bugs::whole",
        "naga 30.0.1 writes GLSL's conversion, which is undefined for negative floats",
    );
}

/// When naga writes WGSL, it renames entry points whose names are builtins, such as `step`, or end with a digit. Karat
/// still finds and runs these entry points.
#[test]
fn entry_points_of_any_name_run_on_each_route() {
    let pass = |name: &str| {
        format!(
            "@compute @workgroup_size(64) fn {name}(@builtin(global_invocation_id) id: vec3u) {{ \
             data[id.x] = f32(id.x) + 1.0; }}\n"
        )
    };
    let text = ["step", "pass1"].map(pass).concat();
    let text = format!("@group(0) @binding(0) var<storage, read_write> data: array<f32>;\n{text}");
    let columns =
        ["vulkan", "vulkan:wgsl", "vulkan:spirv"].map(|name| name.parse().expect("a column"));
    let package = Package::from_modules("names", [("names", &*text)]);
    let matrix = karat_inspect::matrix(&package).columns(columns).run().expect("it is valid");
    for column in ["vulkan:wgsl", "vulkan:spirv"] {
        matrix.expect(column, Status::Agrees);
    }
}
