//! Checks if Cargo optimises the crates that make tests fast.

use std::path::Path;

use serde::Serialize;

/// The crates that need optimisation. Each entry has the crate's name, the level that the README recommends, and the
/// effect of a lower level.
const CRATES: [(&str, i64, &str); 3] = [
    ("karat-core", 2, "sampling arguments and comparing frames are slow"),
    ("karat-engine", 3, "the path `cpu`, the tolerance `Spec` and `karat hazards` are slow"),
    ("naga", 1, "each test starts slowly"),
];

#[derive(Debug, PartialEq, Eq, Serialize)]
pub(in crate::cli) struct Unoptimised {
    pub(in crate::cli) name: &'static str,
    /// The level of optimisation (`opt-level`) that the project's profile `dev` sets for the crate.
    pub(in crate::cli) level: i64,
    pub(in crate::cli) recommended: i64,
    pub(in crate::cli) about: &'static str,
}

/// Returns the crates that the project in the folder `root` compiles with less optimisation than recommended, or no
/// crates if the project doesn't use the crate `karat`.
pub(in crate::cli) fn unoptimised(root: &Path) -> Vec<Unoptimised> {
    let read = |file: &str| std::fs::read_to_string(root.join(file)).ok();
    let uses_karat =
        read("Cargo.lock").is_some_and(|lock| lock.lines().any(|line| line == "name = \"karat\""));
    match read("Cargo.toml").and_then(|text| text.parse().ok()).filter(|_| uses_karat) {
        Some(manifest) => of(&manifest),
        None => Vec::new(),
    }
}

fn of(manifest: &toml::Table) -> Vec<Unoptimised> {
    let dev = manifest.get("profile").and_then(|profile| profile.get("dev"));
    let level = |table: &toml::Value| match table.get("opt-level")? {
        toml::Value::Integer(level) => Some(*level),
        // The levels for size speed the crates up nearly as much as level 2.
        _ => Some(2),
    };
    let package = |name: &str| dev?.get("package")?.get(name).and_then(level);
    let general = dev.and_then(level).unwrap_or(0);
    let of = |(name, recommended, about): (&'static str, i64, &'static str)| {
        let level = package(name).or_else(|| package("*")).unwrap_or(general);
        (level < recommended).then_some(Unoptimised { name, level, recommended, about })
    };
    CRATES.into_iter().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(manifest: &str) -> Vec<(&'static str, i64)> {
        let table = manifest.parse().expect("a manifest");
        of(&table).into_iter().map(|one| (one.name, one.level)).collect()
    }

    #[test]
    fn crates_below_the_wanted_opt_level_are_listed() {
        assert_eq!(found("[package]"), [("karat-core", 0), ("karat-engine", 0), ("naga", 0)]);
        assert_eq!(found("[profile.dev]\nopt-level = 1"), [("karat-core", 1), ("karat-engine", 1)]);
        assert_eq!(found("[profile.dev.package.\"*\"]\nopt-level = 3"), []);
        let own = "[profile.dev.package]\nkarat-core.opt-level = 2\nnaga.opt-level = \"s\"\n\
                   karat-engine.opt-level = 2";
        assert_eq!(found(own), [("karat-engine", 2)]);
    }

    #[test]
    fn the_profile_of_readme_is_enough() {
        let readme = crate::cli::doctor::beside("README.md");
        let profile = readme.split("[profile.dev.package]").nth(1).expect("it has one");
        let profile = profile.split("```").next().unwrap_or_default();
        let profile = profile.lines().skip(1).collect::<Vec<_>>().join("\n");
        assert_eq!(found(&format!("[profile.dev.package]\n{profile}")), []);
    }

    #[test]
    fn a_project_without_karat_is_left_alone() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert_eq!(unoptimised(folder.path()), []);
        let write = |file: &str, text: &str| {
            std::fs::write(folder.path().join(file), text).expect("written");
        };
        write("Cargo.toml", "[package]\n");
        write("Cargo.lock", "[[package]]\nname = \"karaoke\"\n");
        assert_eq!(unoptimised(folder.path()), []);
        write("Cargo.lock", "[[package]]\nname = \"karat\"\n");
        assert_eq!(unoptimised(folder.path()).len(), 3);
    }
}
