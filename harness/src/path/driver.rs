//! Adapters and the families of their drivers. Drivers are recognised only here.

use std::fmt;

/// An opened path, as reported with each verdict.
///
/// ```
/// use karat::unstable::path::Adapter;
///
/// let adapter = Adapter {
///     path: "vulkan".to_owned(),
///     name: "llvmpipe (LLVM 15.0.6, 256 bits)".to_owned(),
///     driver: "llvmpipe Mesa 22.3.6".to_owned(),
///     software: true,
/// };
/// assert!(adapter.is_lavapipe());
/// assert_eq!(adapter.family(), "llvmpipe");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Adapter {
    /// Name of the path.
    pub path: String,
    /// Name of the adapter: `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub name: String,
    /// Driver and version: `llvmpipe Mesa 22.3.6`.
    pub driver: String,
    /// Set for a software rasteriser.
    pub software: bool,
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.path, self.name)?;
        if self.driver.is_empty() { Ok(()) } else { write!(f, ", {}", self.driver) }
    }
}

/// Mesa's rasteriser, whose Vulkan is lavapipe.
const LLVMPIPE: &str = "llvmpipe";

/// Google's rasteriser, which comes with Chromium.
const SWIFTSHADER: &str = "swiftshader";

/// Parts of drivers' and adapters' names, with the family. Software comes first, because a rasteriser's name may be
/// followed by the processor's.
const FAMILIES: [(&str, &str); 17] = [
    ("llvmpipe", LLVMPIPE),
    ("swiftshader", SWIFTSHADER),
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

/// The names of all families.
pub(super) fn families() -> impl Iterator<Item = &'static str> {
    FAMILIES.iter().map(|(_, family)| *family)
}

/// The family for the names of an adapter and its driver. If none is known, it is the first word.
pub(super) fn family(name: &str, driver: &str) -> String {
    let text = format!("{driver} {name}").to_lowercase();
    let known = FAMILIES.iter().find(|(mark, _)| text.contains(mark));
    let first = || text.split(|c: char| !c.is_ascii_alphanumeric()).find(|word| !word.is_empty());
    known.map(|(_, family)| *family).or_else(first).unwrap_or("unknown").to_owned()
}

impl Adapter {
    /// The family of its driver: `llvmpipe`, `nvidia`, `amd`. If no known family fits, it is the
    /// first word of the adapter's name.
    ///
    /// ```no_run
    /// use karat::Path;
    ///
    /// println!("{}", karat::unstable::path::adapter(Path::VULKAN)?.family()); // llvmpipe, nvidia, amd
    /// # Ok::<(), karat::path::PathError>(())
    /// ```
    #[must_use]
    pub fn family(&self) -> String {
        family(&self.name, &self.driver)
    }

    /// Returns `true` for Mesa's llvmpipe, on any API.
    ///
    /// ```no_run
    /// use karat::Path;
    ///
    /// let software = karat::unstable::path::adapter(Path::GL)?.is_llvmpipe();
    /// # let _ = software;
    /// # Ok::<(), karat::path::PathError>(())
    /// ```
    #[must_use]
    pub fn is_llvmpipe(&self) -> bool {
        self.family() == LLVMPIPE
    }

    pub(crate) fn is_swiftshader(&self) -> bool {
        self.family() == SWIFTSHADER
    }

    /// Returns `true` for lavapipe, which is llvmpipe on Vulkan. It can run on any machine.
    ///
    /// ```no_run
    /// use karat::Path;
    ///
    /// let canonical = karat::unstable::path::adapter(Path::VULKAN)?.is_lavapipe();
    /// # let _ = canonical;
    /// # Ok::<(), karat::path::PathError>(())
    /// ```
    #[must_use]
    pub fn is_lavapipe(&self) -> bool {
        self.path.split([':', '@']).next() == Some("vulkan") && self.is_llvmpipe()
    }
}
