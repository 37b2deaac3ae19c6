//! The members of a Cargo workspace, from their manifests. Karat doesn't run Cargo, because Cargo may not be installed.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use anyhow::Context;
use toml::{Table, Value};

/// The tables of dependencies in a manifest. A `[target]` may contain such tables, too.
const DEPENDENCIES: [&str; 3] = ["dependencies", "dev-dependencies", "build-dependencies"];

/// Returns the folders of a workspace's members below its root, each with its manifest. Members are the listed folders,
/// and the folders that the root or another member has as path dependencies.
pub(super) fn of(root: &Path, manifest: &Table) -> anyhow::Result<BTreeMap<PathBuf, Table>> {
    let mut found = BTreeMap::new();
    let Some(workspace) = manifest.get("workspace") else { return Ok(found) };
    let words = |key: &str| {
        let list = workspace.get(key).and_then(Value::as_array).into_iter().flatten();
        list.filter_map(Value::as_str)
    };
    let excluded: Vec<PathBuf> = words("exclude").map(|word| clean(&root.join(word))).collect();
    let mut queue = paths(root, manifest);
    for word in words("members") {
        // The root's name may contain characters with a special meaning in glob patterns.
        let pattern = match Path::new(word).is_absolute() {
            true => word.to_owned(),
            false => format!("{}/{word}", glob::Pattern::escape(&root.to_string_lossy())),
        };
        let file = root.join("Cargo.toml");
        let listed = glob::glob(&pattern).with_context(|| {
            format!("can't read the workspace member `{word}` in `{}`", file.display())
        })?;
        for folder in listed {
            let folder = folder.with_context(|| {
                format!("can't read a workspace member in `{}`", file.display())
            })?;
            queue.push(clean(&folder));
        }
    }
    while let Some(folder) = queue.pop() {
        let is_out = excluded.iter().any(|excluded| folder.starts_with(excluded));
        let is_known = folder == root || found.contains_key(&folder);
        if is_out || is_known || !folder.starts_with(root) {
            continue;
        }
        let file = folder.join("Cargo.toml");
        let Some(text) = super::text_of(&file)? else { continue };
        let table: Table = text.parse().with_context(|| format!("in `{}`", file.display()))?;
        queue.extend(paths(&folder, &table));
        found.insert(folder, table);
    }
    Ok(found)
}

/// Returns the folders of a manifest's path dependencies.
fn paths(folder: &Path, manifest: &Table) -> Vec<PathBuf> {
    let shared = manifest.get("workspace").and_then(Value::as_table);
    let platforms = manifest.get("target").and_then(Value::as_table).into_iter();
    let platforms = platforms.flat_map(Table::values).filter_map(Value::as_table);
    let tables = platforms.chain(shared).chain([manifest]);
    let tables = tables.flat_map(|table| DEPENDENCIES.iter().filter_map(|name| table.get(*name)));
    let all = tables.filter_map(Value::as_table).flat_map(Table::values);
    let all = all.filter_map(|dependency| dependency.get("path")?.as_str());
    all.map(|path| clean(&folder.join(path))).collect()
}

/// Returns a path without `.` and `..`, because members are compared by their paths.
fn clean(path: &Path) -> PathBuf {
    let mut clean = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => drop(clean.pop()),
            part => clean.push(part),
        }
    }
    clean
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 186
    #[test]
    fn workspace_members_include_path_dependencies() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path();
        let write = |member: &str, text: &str| {
            let folder = root.join(member);
            std::fs::create_dir_all(&folder).expect("a folder");
            std::fs::write(folder.join("Cargo.toml"), text).expect("a file");
        };
        write("crates/a", "[target.'cfg(unix)'.dependencies]\nfar = { path = \"../../far\" }");
        write("crates/b", "[dev-dependencies]\nb = { path = \"../b\" }\nout = { path = \"/\" }");
        write("crates/old", "");
        write("far", "[dependencies]\n");
        write("alone", "");
        let text = "[workspace]\nmembers = [\"crates/*\", \"./gone\"]\nexclude = [\"crates/old\"]\n\
                    [workspace.dependencies]\na = { path = \"crates/a\" }\n";
        let found = of(root, &text.parse().expect("TOML")).expect("they are read");
        let names = found.keys().map(|found| found.strip_prefix(root).expect("below").to_owned());
        assert_eq!(names.collect::<Vec<_>>(), ["crates/a", "crates/b", "far"].map(PathBuf::from));
        let invalid = of(root, &"[workspace]\nmembers = [\"a**\"]".parse().expect("TOML"));
        let error = format!("{:#}", invalid.expect_err("it is no pattern"));
        let manifest = root.join("Cargo.toml");
        let told = format!("can't read the workspace member `a**` in `{}`: ", manifest.display());
        assert!(error.starts_with(&told), "{error}");
        let alone = of(root, &"[package]\nname = \"x\"".parse().expect("TOML"));
        assert!(alone.expect("it is read").is_empty(), "it is no workspace");
    }

    #[test]
    fn members_below_a_folder_with_brackets_are_found() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path().join("[work] in");
        let member = root.join("crates/a");
        std::fs::create_dir_all(&member).expect("a folder");
        std::fs::write(member.join("Cargo.toml"), "").expect("a file");
        let text = "[workspace]\nmembers = [\"crates/*\"]";
        let found = of(&root, &text.parse().expect("TOML")).expect("they are read");
        assert_eq!(found.into_keys().collect::<Vec<_>>(), [member]);
    }
}
