//! Dependencies between modules go in one direction, and only some modules name the GPU.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The modules of the library from the bottom up: a module uses only those before it.
const ORDER: [&str; 21] = [
    "output",
    "diagnostic",
    "settings",
    "value",
    "tolerance",
    "domain",
    "stats",
    "image",
    "metric",
    "package",
    "reflect",
    "path",
    "fixture",
    "probe",
    "golden",
    "review",
    "record",
    "run",
    "check",
    "frame",
    "gallery",
];

/// Crates that only these modules may name.
const OWNERS: [(&str, &[&str]); 9] = [
    ("wgpu", &["path", "fixture", "probe", "frame"]),
    ("naga", &["reflect"]),
    ("exr", &["image"]),
    ("png", &["image"]),
    ("flip_rs", &["metric"]),
    ("codespan_reporting", &["diagnostic"]),
    ("clap", &["gallery"]),
    ("statrs", &["stats"]),
    ("httparse", &["review"]),
];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("readable") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            sources(&path, found);
        } else {
            found.push(path);
        }
    }
}

/// The text of each module without comments, tests and its own folder's name.
fn modules() -> BTreeMap<String, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let mut modules: BTreeMap<String, String> = BTreeMap::new();
    for file in files {
        let relative = file.strip_prefix(&root).expect("below src").with_extension("");
        let first = relative.iter().next().expect("a name").to_string_lossy().into_owned();
        if ["lib", "main", "cli"].contains(&first.as_str()) {
            continue;
        }
        let text = std::fs::read_to_string(&file).expect("UTF-8");
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
        let module = modules.entry(first).or_default();
        for line in lines {
            module.push_str(line);
            module.push('\n');
        }
    }
    modules
}

#[test]
fn every_module_has_its_place() {
    let known: Vec<String> = modules().into_keys().collect();
    let mut order = ORDER.map(str::to_owned).to_vec();
    order.sort();
    assert_eq!(known, order);
}

#[test]
fn modules_use_only_what_is_below_them() {
    for (module, text) in modules() {
        let place = ORDER.iter().position(|name| *name == module).expect("it has a place");
        for above in &ORDER[place + 1..] {
            let uses = text.contains(&format!("crate::{above}::"));
            assert!(!uses, "`{module}` uses `{above}`, which is above it");
        }
    }
}

#[test]
fn only_their_owners_name_the_large_crates() {
    for (module, text) in modules() {
        for (name, owners) in OWNERS {
            let names =
                text.contains(&format!("{name}::")) || text.contains(&format!("use {name}"));
            // The image module's own file is called exr, too.
            let names = names && !(name == "exr" && text.contains("self::exr"));
            assert!(!names || owners.contains(&module.as_str()), "`{module}` names `{name}`");
        }
    }
}
