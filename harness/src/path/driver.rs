//! Adapters and their driver families. Only this module recognises drivers.

use std::fmt;

/// The adapter and driver of an opened path, as verdicts report them.
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
    /// The name of the path.
    pub path: String,
    /// The name of the adapter: `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub name: String,
    /// The driver and its version: `llvmpipe Mesa 22.3.6`.
    pub driver: String,
    /// `true` for a software rasteriser.
    pub software: bool,
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.path, self.name)?;
        if self.driver.is_empty() { Ok(()) } else { write!(f, ", {}", self.driver) }
    }
}

/// Mesa's software rasteriser, which is called lavapipe on Vulkan.
const LLVMPIPE: &str = "llvmpipe";

/// Google's software rasteriser, which is a part of Chromium.
const SWIFTSHADER: &str = "swiftshader";

/// Pairs of a text and a driver family. A driver belongs to the family if the name of the driver or of its adapter
/// contains the text. Software rasterisers come first, because their names may also contain the processor's name.
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

pub(super) fn families() -> impl Iterator<Item = &'static str> {
    FAMILIES.iter().map(|(_, family)| *family)
}

/// The driver family of an adapter. For an unknown driver, the family is the first word of the driver's name, or of the
/// adapter's name if the driver has no name.
pub(super) fn family(name: &str, driver: &str) -> String {
    let text = format!("{driver} {name}").to_lowercase();
    let known = FAMILIES.iter().find(|(mark, _)| text.contains(mark));
    let first = || text.split(|c: char| !c.is_ascii_alphanumeric()).find(|word| !word.is_empty());
    known.map(|(_, family)| *family).or_else(first).unwrap_or("unknown").to_owned()
}

impl Adapter {
    /// The driver family of the adapter: `llvmpipe`, `nvidia`, `amd`. For an unknown driver, the family is the first
    /// word of the driver's name, or of the adapter's name if the driver has no name.
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

    /// Checks if the adapter is Mesa's llvmpipe, on any API.
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

    /// Checks if the adapter is lavapipe, Mesa's llvmpipe on Vulkan. lavapipe can run on any machine.
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
