//! The samples of docs/guide, compiled and run. A test checks that this file or `guide/functions.rs` contains each
//! sample.

mod functions;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path as FilePath;
use std::sync::LazyLock;

use glam::{Vec2, Vec3};
use karat::draw::{Blend, Cull, Draw, Format, Mesh};
use karat::fixture::Compare;
use karat::golden::Goldens;
use karat::prelude::*;

use super::values::Project;

static PROJECT: LazyLock<Project> = LazyLock::new(Project::new);
static GOLDENS: LazyLock<Goldens> = LazyLock::new(|| PROJECT.goldens.clone());

static SHADERS: LazyLock<Package> = LazyLock::new(|| {
    Package::from_modules(
        "guide",
        [
            (
                "sky",
                "struct Globals { size: vec2f, time: f32 }
                 @group(0) @binding(0) var<uniform> globals: Globals;
                 @fragment fn fragment(@location(0) uv: vec2f) -> @location(0) vec4f {
                     return vec4f(uv, globals.time, 1.0);
                 }",
            ),
            (
                "shadow",
                "@vertex fn vertex(@location(0) place: vec3f) -> @builtin(position) vec4f {
                     return vec4f(place, 1.0);
                 }",
            ),
            (
                "forest",
                "@group(0) @binding(0) var shadow_map: texture_depth_2d;
                 @group(0) @binding(1) var comparing: sampler_comparison;
                 struct Leaf { @builtin(position) at: vec4f, @location(0) uv: vec2f }
                 struct Seen { @location(0) color: vec4f, @location(1) uv: vec2f }
                 @vertex fn vertex(@location(0) place: vec3f, @builtin(instance_index) copy: u32) -> Leaf {
                     let shift = vec2f(f32(copy % 10u), f32(copy / 10u)) * 0.2 - 0.9;
                     return Leaf(vec4f(place.xy * 0.08 + shift, 0.5, 1.0), place.xy * 0.5 + 0.5);
                 }
                 @fragment fn fragment(leaf: Leaf) -> Seen {
                     let lit = textureSampleCompareLevel(shadow_map, comparing, leaf.at.xy / 256.0, 0.5);
                     return Seen(vec4f(0.1, 0.2 + 0.6 * lit, 0.1, 1.0), leaf.uv);
                 }",
            ),
            (
                "scan",
                "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
                 @group(0) @binding(1) var<storage, read_write> sums: array<u32>;
                 var<workgroup> kept: array<u32, 64>;
                 @compute @workgroup_size(64)
                 fn blocks(@builtin(local_invocation_index) i: u32, @builtin(workgroup_id) block: vec3u) {
                     kept[i] = data[block.x * 64u + i];
                     workgroupBarrier();
                     var sum = 0u;
                     for (var k = 0u; k <= i; k++) { sum += kept[k]; }
                     data[block.x * 64u + i] = sum;
                     if i == 63u { sums[block.x] = sum; }
                 }
                 @compute @workgroup_size(64)
                 fn add(@builtin(local_invocation_index) i: u32, @builtin(workgroup_id) block: vec3u) {
                     var before = 0u;
                     for (var k = 0u; k < block.x; k++) { before += sums[k]; }
                     data[block.x * 64u + i] += before;
                 }",
            ),
        ]
        .map(|(name, text)| (name, text.to_owned())),
    )
});

fn square(half: f32, depth: f32) -> Mesh {
    let corners = [Vec2::NEG_ONE, Vec2::new(1.0, -1.0), Vec2::ONE, Vec2::new(-1.0, 1.0)];
    let places = corners.map(|corner| (half * corner).extend(depth));
    Mesh::new(places.to_vec(), vec![0, 1, 2, 0, 2, 3])
}

fn scene() -> Mesh {
    square(0.5, 0.25)
}

fn leaves() -> Mesh {
    square(1.0, 0.0)
}

mod shaded {
    karat::shareable! {
        // fn shade(n: vec3f) -> Shaded, with struct Shaded { weight: f32, color: vec3f }
        pub struct Shaded mirrors ShadedMirror { weight: f32, color: glam::Vec3 }
    }
}

#[test]
fn structures() {
    let package = Package::from_source(
        "m",
        "struct Shaded { weight: f32, color: vec3f }
         fn shade(n: vec3f) -> Shaded { return Shaded(n.z, 2.0 * n); }",
    );
    let mirror = |n: glam::DVec3| shaded::ShadedMirror { weight: n.z, color: 2.0 * n };
    package.function("shade").over(UnitVector).agrees_with(mirror, Abs(0.0));
    let host = shaded::Shaded { weight: 1.0, color: Vec3::X };
    package
        .function("shade")
        .over(Just(Vec3::Z))
        .satisfies("isn't x", move |_, seen: shaded::Shaded| seen.color != host.color);
}

/// The compiler checks these tests, but nothing runs them, because they would fetch Bevy's crate. `cargo ci found`
/// tests the functions of that crate.
#[expect(dead_code, reason = "it would fetch a crate")]
mod bevy {
    use karat::prelude::*;

    static BEVY: Package = karat::package!(crate = "bevy_render@0.20.1");

    fn srgb_is_decoded() {
        let srgb = |x: f64| if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
        BEVY.function("color_operations::gamma").over(0.0..=1.0).agrees_with(srgb, Rel(1e-5));
    }

    static OURS: Package = karat::package!("assets/shaders");

    fn ours() -> Package {
        OURS.depends_on("bevy_render", &BEVY)
    }
}

#[test]
fn passes() {
    let values: Vec<u32> = (0..256).map(|i| i * 7 % 13).collect();
    let sum = |sum: &mut u32, value: &u32| {
        *sum += value;
        Some(*sum)
    };
    let expected: Vec<u32> = values.iter().scan(0, sum).collect();
    SHADERS
        .compute()
        .with("data", Storage::new(values))
        .with("sums", karat::fixture::Buffer::zeros(16))
        .dispatch("scan::blocks", [4, 1, 1]) // workgroups
        .dispatch("scan::add", [4, 1, 1]) // the same buffers
        .after("data") // what a pass writes: a buffer or a storage texture
        .agrees_with(expected, Abs(0.0)); // an element each; or `.satisfies("is in order", |data: &[u32]| ..)`
}

fn frames() {
    // A draw with only a fragment function covers the frame. Its inputs are texture coordinates.
    SHADERS
        .frame("sky", 256, 128)
        .set("globals.time", 1.5_f32)
        .fragment("fragment")
        .matches(&GOLDENS, "sky");

    let shadow = SHADERS.frame("shadow", 512, 512).draw(Draw::depth("vertex", scene())).depth();
    SHADERS
        .frame("forest", 256, 256)
        .formats([Format::Rgba8UnormSrgb, Format::Rg16Float]) // the targets; `.target(1)` is judged
        .samples(4)
        .with_frame("shadow_map", shadow) // another frame is drawn first, and read
        .with("comparing", Sampler::LINEAR.compare(Compare::LessEqual))
        .draw(
            Draw::mesh("vertex", "fragment", leaves())
                .instances(100)
                .cull(Cull::None)
                .blend(Blend::Premultiplied),
        )
        .matches(&GOLDENS, "forest");
}

/// The sample of the chapter on frames.
mod first_frame {
    use super::GOLDENS;
    use super::functions::SHADERS;

    pub(super) fn dusk() {
        SHADERS.frame("dusk", 128, 64).fragment("fragment").matches(&GOLDENS, "dusk");
    }
}

/// Without a golden the test fails. After the author accepts the frame, the test passes.
#[test]
fn frames_have_goldens() {
    // The first verdicts fail on purpose, so don't record them.
    if std::env::var_os("KARAT_RECORD").is_some() {
        let program = std::env::current_exe().expect("this test's program");
        let mut own = std::process::Command::new(program);
        own.args(["guide::frames_have_goldens", "--exact"]).env_remove("KARAT_RECORD");
        let output = own.output().expect("it runs");
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && text.contains("1 passed"), "{text}");
        return;
    }
    let shown: [(&str, fn()); 3] =
        [("sky", frames), ("forest", frames), ("dusk", first_frame::dusk)];
    for (case, frame) in shown {
        let message = catch_unwind(AssertUnwindSafe(frame)).expect_err("no golden yet");
        let text = message.downcast_ref::<String>().expect("a message");
        assert!(text.contains(&format!("`{case}` has no golden; look at `")), "{text}");
        PROJECT.accept(case);
    }
    frames();
    first_frame::dusk();
}

/// The file name and the text of each chapter of the guide. `None` in a published package, which doesn't contain the
/// guide.
fn chapters() -> Option<Vec<(String, String)>> {
    let package = FilePath::new(env!("CARGO_MANIFEST_DIR"));
    let folder = package.join("../docs/guide");
    if package.join(".cargo_vcs_info.json").exists() {
        return None;
    }
    let entries = std::fs::read_dir(&folder).expect("the guide").flatten();
    let files = entries.filter(|entry| entry.path().extension().is_some_and(|end| end == "md"));
    let read = |entry: std::fs::DirEntry| {
        let text = std::fs::read_to_string(entry.path()).expect("a chapter");
        (entry.file_name().to_string_lossy().into_owned(), text)
    };
    let mut chapters: Vec<_> = files.map(read).collect();
    chapters.sort();
    Some(chapters)
}

/// The code blocks of a chapter that are in `language`.
fn blocks<'a>(text: &'a str, language: &str) -> Vec<&'a str> {
    let opening = format!("```{language}\n");
    let parts: Vec<&str> = text.split(opening.as_str()).skip(1).collect();
    parts.into_iter().map(|rest| rest.split("```").next().unwrap_or_default()).collect()
}

/// The text of a sample without white space, without trailing commas, and without lines such as `use ...` and
/// `#[test]`.
fn plain(text: &str) -> String {
    let around = ["use ", "// tests/", "// shaders/", "#[test]", "static "];
    let kept =
        text.lines().filter(|line| !around.iter().any(|start| line.trim().starts_with(start)));
    let dense: String = kept.flat_map(|line| line.chars()).filter(|c| !c.is_whitespace()).collect();
    let dense = dense.replace("pub(super)", "");
    dense.replace(",)", ")").replace(",]", "]").replace(",}", "}")
}

/// This file or `functions.rs` contains each sample of the guide.
// Lesson 137
#[test]
fn the_guide_has_these_samples() {
    let Some(chapters) = chapters() else { return };
    let own = plain(include_str!("guide.rs")) + &plain(include_str!("guide/functions.rs"));
    let mut count = 0;
    for (chapter, text) in chapters {
        for sample in blocks(&text, "rust") {
            count += 1;
            assert!(own.contains(&plain(sample)), "{chapter}: not compiled here:\n{sample}");
        }
    }
    assert_eq!(count, 18);
}

/// The folder `shaders` beside this file contains each shader of the guide, with a few exceptions.
/// `harness/tests/package.rs` and `harness/cli/tests/cli/asserts.rs` test the shaders that contain `@if`. No test
/// imports Bevy's shader, because the test would fetch a crate. The crate karat-suite tests the shaders that contain
/// `@test`. `cargo ci dist` runs the shaders of `web.md`, and `harness/cli/tests/cli/tutorial.rs` runs the shaders of
/// `tutorial.md`.
// Lesson 137
#[test]
fn the_guide_has_these_shaders() {
    let Some(chapters) = chapters() else { return };
    let folder = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("tests/strangers/shaders");
    let files = std::fs::read_dir(folder).expect("the shaders").flatten();
    let own: String = files
        .map(|file| plain(&std::fs::read_to_string(file.path()).expect("a shader")))
        .collect::<Vec<_>>()
        .join("\n");
    let elsewhere = ["@if(fast)", "@if(karat)", "import bevy_render::", "@test fn"];
    let mut count = 0;
    for (chapter, text) in chapters {
        for sample in blocks(&text, "wgsl") {
            let has_own_walk = ["web.md", "tutorial.md"].contains(&&*chapter);
            if has_own_walk || elsewhere.iter().any(|part| sample.contains(part)) {
                continue;
            }
            count += 1;
            // A chapter may show only the first functions of a file.
            assert!(own.contains(&plain(sample)), "{chapter}: not tested here:\n{sample}");
        }
    }
    assert_eq!(count, 4);
}

/// The function on the guide's page about prints and assertions fails at the line that the page shows.
#[test]
fn a_line_asserts() {
    let text = include_str!("shaders/lights.wgsl");
    let package = Package::from_source("lights", text);
    let check = |least: f32| {
        let over = package.function("attenuation").over((least..=8.0, 1.0..=2.0));
        over.unrecorded().try_stays_within(0.0..=1.0)
    };
    check(0.0).expect("no distance is below 0");
    let told = check(-5.0).expect_err("some are").to_string();
    assert!(told.contains("the assertion `ratio >= 0.0` is false"), "{told}");
}

/// Each link of a chapter leads to an existing file. The guide's index and mdBook's `SUMMARY.md` list each chapter.
// Lesson 137
#[test]
fn links_of_the_guide_lead_somewhere() {
    let folder = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("../docs/guide");
    let Some(chapters) = chapters() else { return };
    for (chapter, text) in &chapters {
        for rest in text.split("](").skip(1) {
            let link = rest.split(')').next().unwrap_or_default();
            let (file, section) = link.split_once('#').unwrap_or((link, ""));
            let file = if file.is_empty() { chapter } else { file };
            assert!(folder.join(file).exists(), "{chapter}: there is no `{link}`");
            if section.is_empty() {
                continue;
            }
            let linked = std::fs::read_to_string(folder.join(file)).expect("a chapter");
            let anchor = |head: &str| {
                head.trim_start_matches('#')
                    .trim()
                    .to_lowercase()
                    .replace(' ', "-")
                    .replace(['`', ':', ','], "")
            };
            let mut heads = linked.lines().filter(|line| line.starts_with('#'));
            assert!(heads.any(|head| anchor(head) == section), "{chapter}: no section `{link}`");
        }
    }
    for (index, below) in [("README.md", ""), ("../SUMMARY.md", "guide/")] {
        let text = std::fs::read_to_string(folder.join(index)).expect("an index");
        for (chapter, _) in chapters.iter().filter(|(name, _)| name != "README.md") {
            assert!(
                text.contains(&format!("({below}{chapter})")),
                "{index} doesn't name {chapter}"
            );
        }
    }
}

/// The targets of the Markdown links in a text, except web addresses.
fn links(text: &str) -> impl Iterator<Item = &str> {
    let targets = text.split("](").skip(1).map(|rest| rest.split(')').next().unwrap_or_default());
    targets.filter(|link| !link.starts_with("http"))
}

/// Pages of the book link only to pages and pictures of the book. If a link leads to another file, mdBook prints no
/// warning, and the link is broken.
// Lesson 137
#[test]
fn links_of_the_book_stay_in_it() {
    let docs = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    if chapters().is_none() {
        return;
    }
    let docs = docs.canonicalize().expect("the documentation");
    let summary = std::fs::read_to_string(docs.join("SUMMARY.md")).expect("the summary");
    let pages: Vec<_> = links(&summary).map(|page| docs.join(page)).collect();
    assert!(pages.len() > 25, "{} pages", pages.len());
    for page in &pages {
        let text = std::fs::read_to_string(page).expect("a page of the summary");
        for link in links(&text) {
            let file = link.split('#').next().unwrap_or_default();
            let there = page.parent().expect("a folder").join(file).canonicalize();
            let inside = there.is_ok_and(|there| {
                file.is_empty()
                    || pages.contains(&there)
                    || (there.starts_with(&docs) && there.extension().is_some_and(|e| e != "md"))
            });
            assert!(inside, "{}: `{link}` leads out of the book", page.display());
        }
    }
}
