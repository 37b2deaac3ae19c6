//! Profiles: a path and a driver, as a part of file names. A rasteriser's results depend on the path and the driver.

use std::fmt;

use crate::path::Adapter;

/// An execution path and the family of the path's driver: `vulkan-llvmpipe`, `gl-nvidia`.
///
/// The golden for all profiles is `<case>.exr`. If a profile fails with that golden, the profile can have its own
/// golden, `@<profile>/<case>.exr`. Other profiles don't use that file.
///
/// ```
/// # use karat::unstable::path::Adapter;
/// use karat::unstable::golden::Profile;
///
/// # let (path, name, driver) = ("gl".to_owned(), "llvmpipe (LLVM 15)".to_owned(), "Mesa".to_owned());
/// # let adapter = Adapter { path, name, driver, software: true };
/// assert_eq!(Profile::of(&adapter).to_string(), "gl-llvmpipe");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Profile(String);

impl Profile {
    /// The profile of an adapter. If the driver's family is unknown, the first word of the adapter's name stands
    /// for the family.
    ///
    /// ```
    /// use karat::unstable::golden::Profile;
    /// use karat::unstable::path::Adapter;
    ///
    /// let [path, name, driver] = ["gl", "llvmpipe (LLVM 15.0.6, 256 bits)", "4.5 Mesa 22.3.6"].map(str::to_owned);
    /// let adapter = Adapter { path, name, driver, software: true };
    /// assert_eq!(Profile::of(&adapter).to_string(), "gl-llvmpipe");
    /// ```
    #[must_use]
    pub fn of(adapter: &Adapter) -> Self {
        // A path's suffix isn't part of the profile, because the family names the driver. A program is named by
        // the suffix.
        if let Some(name) = adapter.path.strip_prefix("process@") {
            return Self(format!("process-{name}"));
        }
        let route = adapter.path.split('@').next().unwrap_or_default();
        let route: String = route.chars().filter(char::is_ascii_alphanumeric).collect();
        Self(format!("{route}-{}", adapter.family()))
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
            (["vulkan@nvidia", "NVIDIA H100 80GB HBM3", ""], "vulkan-nvidia"),
            (["vulkan:hlsl@amd", "AMD Radeon", ""], "vulkanhlsl-amd"),
        ] {
            let [path, name, driver] = adapter;
            assert_eq!(profile(path, name, driver), expected);
        }
    }
}
