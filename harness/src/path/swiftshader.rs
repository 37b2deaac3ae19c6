//! Where SwiftShader is.

use std::path::PathBuf;

/// Where browsers keep the manifest by which Vulkan's loader finds it.
const MANIFESTS: [&str; 5] = [
    "/usr/lib/chromium/vk_swiftshader_icd.json",
    "/usr/lib64/chromium-browser/vk_swiftshader_icd.json",
    "/usr/lib/chromium-browser/vk_swiftshader_icd.json",
    "/opt/google/chrome/vk_swiftshader_icd.json",
    "/opt/chromium/vk_swiftshader_icd.json",
];

/// The variable by which the loader is told of one more driver.
pub const ADD: &str = "VK_ADD_DRIVER_FILES";

/// The manifest of a browser on this machine.
#[must_use]
pub fn manifest() -> Option<PathBuf> {
    MANIFESTS.iter().map(PathBuf::from).find(|file| file.is_file())
}
