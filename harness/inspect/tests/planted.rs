//! Tests that `compare` finds faults planted in the entry points of a small renderer.

use karat::Package;
use karat_inspect::compare::{Change, Compared, Request};

const RENDERER: &str = include_str!("planted/renderer.wgsl");

/// The changes that an edit causes in entry points and in the functions that they use.
fn edited(from: &str, to: &str) -> Vec<Compared> {
    assert!(RENDERER.contains(from), "the renderer has `{from}`");
    let package = |text: &str| Package::from_source("renderer", text);
    let after = RENDERER.replacen(from, to, 1);
    let compared = Request::new(package(RENDERER), package(&after)).cases(512).run();
    let all = compared.expect("compared").into_iter();
    all.filter(|one| one.change != Change::Untouched).collect()
}

/// The first function or entry point whose results an edit changes. Panics if its name isn't `function`.
fn changed(from: &str, to: &str, function: &str) -> Compared {
    let all = edited(from, to);
    let one = all.iter().find(|one| matches!(one.change, Change::Changed { .. }));
    let one = one.unwrap_or_else(|| panic!("`{to}` changes something: {all:#?}"));
    assert_eq!(one.function, function);
    one.clone()
}

#[test]
fn faults_of_shading_are_seen_in_the_fragments() {
    for (from, to) in [
        ("select(-1.0, 1.0, front)", "select(1.0, -1.0, front)"),
        ("let n_dot_l = max(dot(n, l), 0.0);", "let n_dot_l = dot(n, l);"),
        ("return vec4f(to_srgb(lit), 1.0);", "return vec4f(to_srgb(to_srgb(lit)), 1.0);"),
        ("camera.lod)", "camera.lod + 1.0)"),
        (
            "max(4.0 * max(dot(n, v), 0.0) * n_dot_l, 0.001)",
            "(4.0 * max(dot(n, v), 0.0) * n_dot_l)",
        ),
    ] {
        changed(from, to, "fs_main");
    }
}

#[test]
fn faults_of_transformations_are_seen_in_the_vertices() {
    changed("camera.view_proj * world", "world * camera.view_proj", "vs_main");
    changed("vec4f(position, 1.0)", "vec4f(position, 0.0)", "vs_main");
}

/// `compare` compares the values that a compute pass writes. A smaller workgroup size for `blur_x` leaves these values
/// unchanged.
#[test]
fn faults_of_passes_are_seen_in_what_they_leave() {
    let blur = changed("k <= 2", "k < 2", "blur_x");
    let Change::Changed { paths } = &blur.change else { unreachable!("it changed") };
    assert!(paths[0].before.starts_with("target_["), "{paths:?}");
    assert!(blur.dispatched.is_some() && paths[0].cases.0 < paths[0].cases.1, "{paths:?}");
    changed("id.y * blur.width + u32(x)", "id.y * blur.height + u32(x)", "blur_x");
    let smaller = edited("@workgroup_size(8, 8)", "@workgroup_size(4, 4)");
    assert!(
        matches!(&*smaller, [one] if matches!(one.change, Change::Same { .. })),
        "{smaller:#?}"
    );
    assert_eq!(
        smaller[0].interface,
        ["`blur_x` is @workgroup_size(4, 4, 1), and was @workgroup_size(8, 8, 1) before the edit"]
    );
}

/// Even if a race doesn't change the results in the engine's order, the sanitizer reports the race.
#[test]
fn a_barrier_that_is_gone_is_a_new_violation() {
    let all = edited("tile[i] += add;\n        workgroupBarrier();", "tile[i] += add;");
    let [scan] = &*all else { panic!("{all:#?}") };
    assert!(matches!(scan.change, Change::Same { .. }) && scan.violations.len() == 1, "{scan:#?}");
    assert_eq!(scan.violations[0].variable, "tile");
    let all =
        edited("if (id.x < arrayLength(&sums)) { sums[id.x] = tile[i]; }", "sums[id.x] = tile[i];");
    assert!(all[0].violations[0].headline.contains("writes outside"), "{all:#?}");
}

#[test]
fn changes_of_an_interface_are_reported() {
    let all = edited("@location(2) uv: vec2f,\n}", "@location(3) uv: vec2f,\n}");
    let told = |name: &str| {
        let one = all.iter().find(|one| one.function == name);
        one.unwrap_or_else(|| panic!("no `{name}` in {all:#?}")).interface.join("\n")
    };
    assert_eq!(told("fs_main"), "`in.uv` is @location(3), and was @location(2) before the edit");
    assert_eq!(
        told("vs_main"),
        "`result.uv` is @location(3), and was @location(2) before the edit"
    );
    let all = edited("@fragment\nfn fs_main", "@compute @workgroup_size(1)\nfn fs_main");
    assert!(
        matches!(all[0].change, Change::Signature { .. } | Change::Unjudged { .. }),
        "{all:#?}"
    );
}

#[test]
fn an_edit_that_changes_nothing_is_the_same() {
    let all = edited("base * n_dot_l + light * spec", "light * spec + base * n_dot_l");
    assert!(matches!(&*all, [one] if matches!(one.change, Change::Same { .. })), "{all:#?}");
    let all = edited(
        "sum += source[id.y * blur.width + u32(x)];",
        "sum += source[u32(x) + id.y * blur.width];",
    );
    assert!(matches!(&*all, [one] if matches!(one.change, Change::Same { .. })), "{all:#?}");
}
