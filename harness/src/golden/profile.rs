//! Profiles: what results of a rasteriser depend on, as a name for files.

use std::fmt;

use crate::path::{Adapter, Path};

/// An execution path and the family of its driver: `vulkan-llvmpipe`, `gl-nvidia`.
///
/// A golden for all profiles is `<case>.exr`. Where it can't serve one, `@<profile>/<case>.exr` is
/// that profile's own; it is used there, and nowhere else.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Profile(String);

/// What drivers and adapters call themselves, and the family. Software comes first, as the name
/// of a rasteriser may be followed by that of the processor it runs on.
const FAMILIES: [(&str, &str); 17] = [
    ("llvmpipe", "llvmpipe"),
    ("swiftshader", "swiftshader"),
    ("basic render", "warp"),
    ("softpipe", "softpipe"),
    ("nvidia", "nvidia"),
    ("geforce", "nvidia"),
    ("nouveau", "nvidia"),
    ("radv", "amd"),
    ("radeon", "amd"),
    ("amd", "amd"),
    ("intel", "intel"),
    ("apple", "apple"),
    ("adreno", "qualcomm"),
    ("qualcomm", "qualcomm"),
    ("mali", "arm"),
    ("powervr", "imagination"),
    ("v3d", "broadcom"),
];

impl Profile {
    /// Whether this can be a profile's name: a path, a hyphen and a family.
    pub(crate) fn is_name(text: &str) -> bool {
        text.split_once('-').is_some_and(|(path, family)| {
            let sound = !family.is_empty() && family.chars().all(|c| c.is_ascii_alphanumeric());
            path.parse::<Path>().is_ok() && sound
        })
    }

    /// The profile of an adapter. One of no known family has the first word of its name.
    #[must_use]
    pub fn of(adapter: &Adapter) -> Self {
        let text = format!("{} {}", adapter.driver, adapter.name).to_lowercase();
        let known = FAMILIES.iter().find(|(mark, _)| text.contains(mark));
        let family = known.map_or_else(
            || text.split(|c: char| !c.is_ascii_alphanumeric()).find(|word| !word.is_empty()),
            |(_, family)| Some(*family),
        );
        let path: String = adapter.path.chars().filter(char::is_ascii_alphanumeric).collect();
        Self(format!("{path}-{}", family.unwrap_or("unknown")))
    }
}

impl fmt::Display for Profile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_a_path_and_a_family() {
        for name in ["gl-llvmpipe", "vulkan-nvidia", "dx12-warp"] {
            assert!(Profile::is_name(name), "{name}");
        }
        for name in ["", "gl", "gl-", "llvmpipe", "opengl-mesa", "gl_llvmpipe", "gl-a/b"] {
            assert!(!Profile::is_name(name), "{name}");
        }
    }

    #[test]
    fn drivers_of_a_family_share_a_profile() {
        let profile = |path: &str, name: &str, driver: &str| {
            let (path, name, driver) = (path.to_owned(), name.to_owned(), driver.to_owned());
            Profile::of(&Adapter { path, name, driver, software: false }).to_string()
        };
        for (adapter, expected) in [
            (
                ["vulkan", "llvmpipe (LLVM 15.0.6, 256 bits)", "llvmpipe Mesa 22.3.6"],
                "vulkan-llvmpipe",
            ),
            (["gl", "llvmpipe (LLVM 15.0.6, 128 bits)", "OpenGL 4.5 (Mesa)"], "gl-llvmpipe"),
            (["vulkan", "NVIDIA H100 80GB HBM3", "NVIDIA 550.1"], "vulkan-nvidia"),
            (["vulkan", "AMD Radeon RX 7900 (RADV NAVI31)", "radv"], "vulkan-amd"),
            (["dx12", "Microsoft Basic Render Driver", ""], "dx12-warp"),
            (["metal", "Apple M2", ""], "metal-apple"),
            (["vulkan", "../Frobnicator 3000", ""], "vulkan-frobnicator"),
            (["gl", "", ""], "gl-unknown"),
        ] {
            let [path, name, driver] = adapter;
            assert_eq!(profile(path, name, driver), expected);
        }
    }
}
