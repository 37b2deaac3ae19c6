//! Driver manifests: the JSON files that describe a driver to the Vulkan loader and GLVND.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde_json::Value;

use super::host::{self, Host};

/// A driver whose manifest names an existing library.
pub(crate) struct Driver {
    pub(crate) manifest: PathBuf,
    pub(crate) library: PathBuf,
}

/// The result of reading all manifests.
pub(crate) struct Search {
    pub(crate) drivers: Vec<Driver>,
    /// A message for each manifest that names no usable driver.
    pub(crate) rejected: Vec<String>,
}

/// Reads the manifests in `places`. A place is a manifest or a folder of manifests.
pub(crate) fn search(host: &Host, places: &[PathBuf]) -> Search {
    let files = places
        .iter()
        .flat_map(|place| if place.is_dir() { host::files(place) } else { vec![place.clone()] });
    let mut search = Search { drivers: Vec::new(), rejected: Vec::new() };
    for manifest in files.filter(|file| file.extension().is_some_and(|end| end == "json")) {
        if !manifest.exists() {
            continue;
        }
        match library(host, &manifest) {
            Ok(library) => search.drivers.push(Driver { manifest, library }),
            Err(error) => search.rejected.push(format!("{}: {error:#}", manifest.display())),
        }
    }
    search
}

fn library(host: &Host, manifest: &Path) -> Result<PathBuf> {
    let text = std::fs::read_to_string(manifest).context("can't be read")?;
    let named = library_path(&text)?;
    let found = if Path::new(&named).is_absolute() {
        Some(host.path(&named))
    } else if named.contains('/') {
        manifest.parent().map(|folder| folder.join(&named))
    } else {
        host.library(&named)
    };
    found
        .filter(|library| library.is_file())
        .with_context(|| format!("its library `{named}` is not installed"))
}

/// Returns the library that the text of a manifest names: a path, or a name for the dynamic linker.
fn library_path(text: &str) -> Result<String> {
    let manifest: Value = serde_json::from_str(text).context("is not JSON")?;
    let driver = &manifest["ICD"];
    let bits = driver["library_arch"].as_str();
    ensure!(bits.is_none_or(|bits| bits == usize::BITS.to_string()), "is for another architecture");
    let path = driver["library_path"].as_str().filter(|path| !path.is_empty());
    Ok(path.context("has no `ICD.library_path`")?.to_owned())
}

#[cfg(test)]
mod tests {
    use super::host::tests::Machine;
    use super::*;

    #[test]
    fn library_path_is_read() {
        let text = r#"{
            "ICD": { "api_version": "1.3.255", "library_path": "/usr/lib/libvulkan_lvp.so" },
            "file_format_version": "1.0.0"
        }"#;
        assert_eq!(library_path(text).expect("it is there"), "/usr/lib/libvulkan_lvp.so");
    }

    #[test]
    fn defects_are_named() {
        let message = |text| format!("{:#}", library_path(text).expect_err("it has a defect"));
        assert!(message("{").starts_with("is not JSON: "));
        assert_eq!(message("{}"), "has no `ICD.library_path`");
        assert_eq!(message(r#"{ "ICD": { "library_path": 1 } }"#), "has no `ICD.library_path`");
        assert_eq!(
            message(r#"{ "ICD": { "library_path": "a.so", "library_arch": "16" } }"#),
            "is for another architecture"
        );
    }

    #[test]
    fn libraries_are_found_by_path_by_relative_path_and_by_name() {
        let machine = Machine::new()
            .manifest("/icd.d/absolute.json", "/opt/liba.so")
            .manifest("/icd.d/missing.json", "/opt/libmissing.so")
            .manifest("/icd.d/named.json", "libnamed.so.0")
            .manifest("/icd.d/relative.json", "../lib/librelative.so")
            .file("/icd.d/notes.txt", "not a manifest")
            .file("/opt/liba.so", "")
            .file("/lib/librelative.so", "")
            .file("/usr/lib64/libnamed.so.0", "");
        let host = machine.host();
        let search = search(&host, &[host.path("/icd.d"), host.path("/nowhere")]);
        let names: Vec<String> =
            search.drivers.iter().map(|driver| host::name(&driver.manifest)).collect();
        assert_eq!(names, ["absolute.json", "named.json", "relative.json"]);
        let [rejected] = &search.rejected[..] else { panic!("{:?}", search.rejected) };
        assert!(
            rejected.ends_with("missing.json: its library `/opt/libmissing.so` is not installed"),
            "{rejected}"
        );
    }
}
