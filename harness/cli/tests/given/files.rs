//! Writes the files that a test needs.

use std::path::Path;

/// Writes a file, and creates its folders.
pub(crate) fn write(folder: &Path, file: &str, text: &str) {
    let path = folder.join(file);
    std::fs::create_dir_all(path.parent().expect("in the folder")).expect("a folder");
    std::fs::write(path, text).expect("written");
}
