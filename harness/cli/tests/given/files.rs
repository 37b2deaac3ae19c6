//! Files that a test begins with.

use std::path::Path;

/// Writes a file and the folders that it is in.
pub(crate) fn write(folder: &Path, file: &str, text: &str) {
    let path = folder.join(file);
    std::fs::create_dir_all(path.parent().expect("in the folder")).expect("a folder");
    std::fs::write(path, text).expect("written");
}
