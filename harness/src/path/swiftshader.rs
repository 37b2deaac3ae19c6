//! Finds SwiftShader.

use std::path::PathBuf;

/// Paths at which Linux distributions install the Vulkan manifest of a browser's SwiftShader. The manifest tells
/// Vulkan's loader where SwiftShader is.
const MANIFESTS: [&str; 5] = [
    "/usr/lib/chromium/vk_swiftshader_icd.json",
    "/usr/lib64/chromium-browser/vk_swiftshader_icd.json",
    "/usr/lib/chromium-browser/vk_swiftshader_icd.json",
    "/opt/google/chrome/vk_swiftshader_icd.json",
    "/opt/chromium/vk_swiftshader_icd.json",
];

/// The environment variable that adds a driver to Vulkan's loader.
pub const ADD: &str = "VK_ADD_DRIVER_FILES";

/// The first file in `MANIFESTS` that exists on this machine.
#[must_use]
pub fn manifest() -> Option<PathBuf> {
    MANIFESTS.iter().map(PathBuf::from).find(|file| file.is_file())
}
