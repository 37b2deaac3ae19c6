//! Selectors: the paths to which a declaration applies.

use std::fmt;

use super::name::{Api, Parts, Via};
use super::{Adapter, Path, PathError};

/// Selects the paths to which a tolerance or a known issue applies, by API, by route, by driver, or by several of
/// these.
///
/// A selector without an API matches every API. The same is true of the route and the driver. `Path::GL` and `"gl"`
/// match OpenGL with any driver and route. `"vulkan@nvidia"` matches Vulkan with one driver. `"@llvmpipe"` matches
/// llvmpipe on each API. `":hlsl"` matches every route through HLSL. If several selectors match a path, the selector
/// with the most parts applies. If several selectors have the most parts, the last declaration applies.
///
/// ```
/// use karat::Path;
/// use karat::path::Selector;
///
/// let selectors: [Selector; 3] = [Path::GL.into(), "vulkan@nvidia".into(), "@llvmpipe".into()];
/// assert_eq!(selectors[0].to_string(), "gl");
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selector {
    text: String,
    /// The API, the route and the driver that `text` names. `None` if `text` isn't a valid selector.
    parts: Option<Parts>,
}

impl From<Path> for Selector {
    fn from(path: Path) -> Self {
        let via = Some(path.via()).filter(|via| *via != Via::Direct);
        let parts = Parts { api: Some(path.api()), via, driver: path.driver() };
        Self { text: path.to_string(), parts: Some(parts) }
    }
}

/// Accepts any text. If the text isn't a valid selector, the check returns an error when it runs.
impl From<&str> for Selector {
    fn from(text: &str) -> Self {
        Self { text: text.to_owned(), parts: Parts::read(text).ok() }
    }
}

impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Selector {
    /// Checks if Karat knows the API, the route and the driver that the selector names.
    ///
    /// ```
    /// use karat::path::Selector;
    ///
    /// let (known, unknown): (Selector, Selector) = ("gl@llvmpipe".into(), "gll".into());
    /// assert!(known.is_known() && !unknown.is_known());
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.parts.is_some()
    }

    /// Returns an error if the text isn't a valid selector.
    pub(crate) fn expect_sound(&self) -> Result<(), PathError> {
        match self.parts {
            Some(_) => Ok(()),
            None => Parts::read(&self.text).map(drop),
        }
    }

    /// Checks if the selector matches a path.
    pub(crate) fn selects(&self, path: Path, adapter: &Adapter) -> bool {
        self.fits(path, adapter).is_some()
    }

    /// The number of parts (API, route, driver) in this selector, if all these parts match the path; `None` otherwise.
    fn fits(&self, path: Path, adapter: &Adapter) -> Option<usize> {
        let Parts { api, via, driver } = self.parts?;
        let family = || adapter.family();
        let named: [Option<bool>; 3] = [
            api.map(|api: Api| api == path.api()),
            via.map(|via| via == path.via()),
            // The path of a program that runs jobs has the program's name, and also a driver family.
            driver.map(|driver| Some(driver) == path.driver() || driver == family()),
        ];
        let named: Vec<bool> = named.into_iter().flatten().collect();
        named.iter().all(|fits| *fits).then_some(named.len())
    }
}

/// Declared values, such as tolerances. Each value has the selector of the paths to which the value applies.
#[derive(Clone, Debug)]
pub(crate) struct Selected<T>(Vec<(Selector, T)>);

impl<T> Default for Selected<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T> Selected<T> {
    pub(crate) fn declare(&mut self, selector: Selector, value: T) {
        self.0.push((selector, value));
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (&Selector, &T)> {
        self.0.iter().map(|(selector, value)| (selector, value))
    }

    pub(crate) fn get_mut(&mut self, selector: &Selector) -> Option<&mut T> {
        self.0.iter_mut().find(|(known, _)| known == selector).map(|(_, value)| value)
    }

    /// The value for a path. Of the selectors that match the path, the selector with the most parts applies. If several
    /// selectors have the most parts, the last of these selectors applies.
    pub(crate) fn on(&self, path: Path, adapter: &Adapter) -> Option<&T> {
        let fitting = self
            .iter()
            .filter_map(|(selector, value)| Some((selector.fits(path, adapter)?, value)));
        fitting.max_by_key(|(named, _)| *named).map(|(_, value)| value)
    }

    /// Returns an error if the text of a selector isn't valid.
    pub(crate) fn expect_sound(&self) -> Result<(), PathError> {
        self.iter().try_for_each(|(selector, _)| selector.expect_sound())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(path: Path, name: &str) -> Adapter {
        let (path, driver) = (path.to_string(), String::new());
        Adapter { path, name: name.to_owned(), driver, software: false }
    }

    #[test]
    fn the_most_particular_declaration_holds_and_of_equals_the_last() {
        let mut declared = Selected::default();
        for (selector, value) in [
            (Selector::from("vulkan@nvidia"), 1),
            (Path::VULKAN.into(), 2),
            ("@llvmpipe".into(), 3),
            (":hlsl".into(), 4),
            ("vulkan:hlsl@llvmpipe".into(), 5),
            ("gl".into(), 6),
            ("gl".into(), 7),
        ] {
            declared.declare(selector, value);
        }
        let on = |path: &str, name: &str| {
            let path = path.parse().expect(path);
            declared.on(path, &adapter(path, name)).copied()
        };
        assert_eq!(on("vulkan", "NVIDIA H200"), Some(1));
        assert_eq!(on("vulkan", "AMD Radeon"), Some(2));
        assert_eq!(on("metal", "Apple M2"), None);
        assert_eq!(on("vulkan", "llvmpipe (LLVM 15)"), Some(3), "two name one thing: the last");
        assert_eq!(on("dx12:hlsl", "Intel"), Some(4));
        assert_eq!(on("vulkan:hlsl", "llvmpipe"), Some(5));
        assert_eq!(on("gl@nvidia", "GeForce"), Some(7));
    }

    #[test]
    fn a_selector_without_a_path_is_an_error() {
        let mut declared = Selected::default();
        declared.declare(Selector::from("@llvmpipe"), ());
        assert!(declared.expect_sound().is_ok());
        declared.declare(Selector::from("gl-llvmpipe"), ());
        let error = declared.expect_sound().expect_err("a profile's name").to_string();
        assert!(error.starts_with("there is no execution path `gl-llvmpipe`"), "{error}");
    }
}
