//! Parses the names of execution paths: an API, a route, and a driver.

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;
use std::sync::Mutex;

use super::{PathError, driver, web};
use crate::diagnostic::nearest;

/// The API or program that runs a shader.
///
/// ```
/// use karat::Path;
/// use karat::unstable::path::Api;
///
/// assert_eq!(Path::CPU.api(), Api::Cpu);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Api {
    /// Vulkan.
    Vulkan,
    /// Metal.
    Metal,
    /// Direct3D 12.
    Dx12,
    /// OpenGL or OpenGL ES.
    Gl,
    /// Karat's engine on the host's processor, without a driver.
    Cpu,
    /// A program that runs jobs. KARAT_EXECUTORS names the program.
    Process,
}

impl Api {
    const ALL: [Self; 6] =
        [Self::Vulkan, Self::Metal, Self::Dx12, Self::Gl, Self::Cpu, Self::Process];

    /// The name used on the command line and in the environment.
    ///
    /// ```
    /// use karat::unstable::path::Api;
    ///
    /// assert_eq!(Api::Vulkan.name(), "vulkan");
    /// ```
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Vulkan => "vulkan",
            Self::Metal => "metal",
            Self::Dx12 => "dx12",
            Self::Gl => "gl",
            Self::Cpu => "cpu",
            Self::Process => "process",
        }
    }
}

/// The part after the `:` in a path's name: the language into which naga translates shaders, or an arithmetic of `cpu`.
///
/// ```
/// use karat::Path;
/// use karat::unstable::path::Via;
///
/// let path: Path = "vulkan:hlsl".parse()?;
/// assert_eq!((path.via(), Path::CPU.via()), (Via::Hlsl, Via::Direct));
/// # Ok::<(), karat::path::PathError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Via {
    /// No translation: the WGSL of the source files.
    Direct,
    /// WGSL: naga writes the shader as WGSL, and reads this text again.
    Wgsl,
    /// SPIR-V.
    Spirv,
    /// GLSL.
    Glsl,
    /// HLSL that glslang compiles.
    Hlsl,
    /// HLSL that Microsoft's compiler DXC compiles.
    HlslDxc,
    /// Another arithmetic for the path `cpu`: the engine rounds `a * b + c` once, as WGSL (15.7.5) allows and many GPUs
    /// do.
    Fma,
    /// Another arithmetic for the path `cpu`: the engine treats subnormal numbers as zero, as WGSL (15.7.2) allows and
    /// many GPUs do.
    Ftz,
}

impl Via {
    const ALL: [Self; 8] = [
        Self::Direct,
        Self::Wgsl,
        Self::Spirv,
        Self::Glsl,
        Self::Hlsl,
        Self::HlslDxc,
        Self::Fma,
        Self::Ftz,
    ];

    /// Checks if this value is an arithmetic of the path `cpu` (`fma` or `ftz`) instead of a language.
    pub(crate) const fn is_arithmetic(self) -> bool {
        matches!(self, Self::Fma | Self::Ftz)
    }

    /// The name after the `:` in a path's name.
    ///
    /// ```
    /// use karat::unstable::path::Via;
    ///
    /// assert_eq!(Via::Hlsl.name(), "hlsl");
    /// ```
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Direct => "direct",
            Self::Wgsl => "wgsl",
            Self::Spirv => "spirv",
            Self::Glsl => "glsl",
            Self::Hlsl => "hlsl",
            Self::HlslDxc => "hlsl-dxc",
            Self::Fma => "fma",
            Self::Ftz => "ftz",
        }
    }
}

impl fmt::Display for Via {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// An execution path: an API, the route by which a shader is translated for the API, and the driver.
///
/// A path's name may contain an API, a route and a driver: `vulkan`, `vulkan:hlsl`, `vulkan@swiftshader`. Without a
/// driver's name, a path uses the first adapter of its API. Hardware comes before software.
///
/// ```
/// use karat::Path;
///
/// let path: Path = "vulkan:hlsl@llvmpipe".parse().unwrap();
/// assert_eq!(path.to_string(), "vulkan:hlsl@llvmpipe");
/// assert_eq!("gl".parse::<Path>().unwrap(), Path::GL);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Path {
    api: Api,
    via: Via,
    driver: Option<&'static str>,
}

impl Path {
    /// WGSL, translated to SPIR-V, on Vulkan.
    pub const VULKAN: Self = Self::of(Api::Vulkan);
    /// WGSL, translated to MSL, on Metal.
    pub const METAL: Self = Self::of(Api::Metal);
    /// WGSL, translated to HLSL, on Direct3D 12.
    pub const DX12: Self = Self::of(Api::Dx12);
    /// WGSL, translated to GLSL, on OpenGL or OpenGL ES.
    pub const GL: Self = Self::of(Api::Gl);
    /// WGSL in Karat's engine, on the host's processor, without a driver.
    pub const CPU: Self = Self::of(Api::Cpu);

    /// One path for each graphics API of wgpu. The default path is the first of these paths that opens on this machine.
    pub const ALL: [Self; 4] = [Self::VULKAN, Self::METAL, Self::DX12, Self::GL];

    const fn of(api: Api) -> Self {
        Self { api, via: Via::Direct, driver: None }
    }

    /// A path with the same API and driver as this path, but with the route `via`.
    pub(crate) const fn through(self, via: Via) -> Self {
        Self { via, ..self }
    }

    /// The API or program that runs the shader.
    ///
    /// ```
    /// use karat::Path;
    /// use karat::unstable::path::Api;
    ///
    /// assert_eq!(Path::GL.api(), Api::Gl);
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub const fn api(self) -> Api {
        self.api
    }

    /// The route to the API.
    ///
    /// ```
    /// use karat::Path;
    /// use karat::unstable::path::Via;
    ///
    /// assert_eq!(Path::VULKAN.via(), Via::Direct);
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub const fn via(self) -> Via {
        self.via
    }

    /// The driver family in the path's name: `llvmpipe`. See [`Adapter::family`](super::Adapter::family).
    ///
    /// ```
    /// use karat::Path;
    ///
    /// assert_eq!("gl@llvmpipe".parse::<Path>()?.driver(), Some("llvmpipe"));
    /// # Ok::<(), karat::path::PathError>(())
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub const fn driver(self) -> Option<&'static str> {
        self.driver
    }

    /// Checks if the path's API exists on this operating system.
    ///
    /// ```
    /// use karat::Path;
    ///
    /// assert!(Path::GL.is_supported() || cfg!(target_os = "macos"));
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn is_supported(self) -> bool {
        super::device::exists(self)
    }

    /// The name used on the command line, in the environment and in records.
    ///
    /// ```
    /// use karat::Path;
    ///
    /// assert_eq!(Path::VULKAN.name(), "vulkan");
    /// ```
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self { via: Via::Direct, driver: None, .. } => self.api.name(),
            _ => intern(&self.to_string()),
        }
    }
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut name = self.api.name().to_owned();
        if self.via != Via::Direct {
            name = format!("{name}:{}", self.via.name());
        }
        if let Some(driver) = self.driver {
            name = format!("{name}@{driver}");
        }
        f.pad(&name)
    }
}

impl FromStr for Path {
    type Err = PathError;

    fn from_str(name: &str) -> Result<Self, PathError> {
        let Parts { api, via, driver } = Parts::read(name)?;
        let api = api.ok_or_else(|| unknown(name, name))?;
        Ok(Self { api, via: via.unwrap_or(Via::Direct), driver })
    }
}

/// The API, the route and the driver in a path's name. In a selector, each of the three may be missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Parts {
    pub(super) api: Option<Api>,
    pub(super) via: Option<Via>,
    pub(super) driver: Option<&'static str>,
}

impl Parts {
    /// Parses `api:via@driver`. Each part may be missing. `dawn` is short for `process@dawn`, and `chromium` for
    /// `process@chromium`.
    pub(super) fn read(name: &str) -> Result<Self, PathError> {
        if let Some(own) = web::NAMES.into_iter().find(|own| *own == name) {
            return Ok(Self { api: Some(Api::Process), via: None, driver: Some(own) });
        }
        let (rest, driver) = match name.split_once('@') {
            Some((rest, driver)) => (rest, Some(driver)),
            None => (name, None),
        };
        let (api, via) = match rest.split_once(':') {
            Some((api, via)) => (api, Some(via)),
            None => (rest, None),
        };
        let nothing = api.is_empty() && via.is_none() && driver.is_none();
        let api = match Api::ALL.into_iter().find(|known| known.name() == api) {
            None if nothing || !api.is_empty() => return Err(unknown(name, api)),
            api => api,
        };
        let of_name = |via: &str| Via::ALL.into_iter().find(|known| known.name() == via);
        let via = via.map(|via| of_name(via).ok_or_else(|| unknown_via(name, via))).transpose()?;
        let is_family = |driver: &str| {
            !driver.is_empty()
                && driver.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit())
        };
        match driver {
            Some(driver) if !is_family(driver) => Err(unknown_driver(name, driver)),
            // An unknown driver family is accepted, unless its name is similar to a known family.
            Some(driver)
                if api != Some(Api::Process)
                    && !driver::families().any(|known| known == driver)
                    && nearest(driver, driver::families()).is_some() =>
            {
                Err(unknown_driver(name, driver))
            }
            driver => Ok(Self { api, via, driver: driver.map(intern) }),
        }
    }
}

fn unknown(name: &str, api: &str) -> PathError {
    let known = Api::ALL.map(Api::name).into_iter().chain(web::NAMES);
    let nearest = nearest(api, known).map(|known| match known {
        "process" => "process@NAME".to_owned(),
        known => known.to_owned(),
    });
    PathError::Unknown { name: name.to_owned(), nearest }
}

fn unknown_via(name: &str, via: &str) -> PathError {
    let (name, via) = (name.to_owned(), via.to_owned());
    let of_cpu = name.starts_with("cpu");
    let known = Via::ALL.into_iter().filter(|known| matches!(known, Via::Fma | Via::Ftz) == of_cpu);
    let nearest = nearest(&via.to_lowercase(), known.map(Via::name)).map(str::to_owned);
    PathError::UnknownVia { name, via, nearest }
}

fn unknown_driver(name: &str, driver: &str) -> PathError {
    let (name, driver) = (name.to_owned(), driver.to_owned());
    let nearest = nearest(&driver.to_lowercase(), driver::families()).map(str::to_owned);
    PathError::UnknownDriver { name, driver, nearest }
}

/// Returns the process's only copy of a text, and never frees it: `Path` is `Copy`, so it can't own the name of its
/// driver. A process uses only a few such names.
fn intern(text: &str) -> &'static str {
    static TEXTS: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
    let mut texts = TEXTS.lock().expect("no thread panics while it holds the lock");
    if let Some(known) = texts.get(text) {
        return known;
    }
    let text: &'static str = Box::leak(text.to_owned().into_boxed_str());
    texts.insert(text);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `process@dawn` and `process@chromium` have short names, because Karat itself contains the programs that run
    /// their jobs.
    #[test]
    fn dawn_and_chromium_are_short_names_of_paths() {
        for name in ["dawn", "chromium"] {
            let path: Path = name.parse().expect("it is a path");
            assert_eq!((path.api(), path.driver()), (Api::Process, Some(name)));
            assert_eq!(path.name().parse::<Path>().expect("its long name"), path);
        }
        let error = "chromum".parse::<Path>().expect_err("it is none").to_string();
        assert!(error.contains("chromium"), "{error}");
    }

    #[test]
    fn a_name_says_api_route_and_driver() {
        for name in ["vulkan", "cpu", "vulkan:hlsl", "gl@llvmpipe", "dx12:hlsl-dxc@warp"] {
            let path: Path = name.parse().expect(name);
            assert_eq!((path.to_string().as_str(), path.name()), (name, name));
            assert_eq!(name.parse::<Path>().ok(), Some(path));
        }
        assert_eq!("vulkan:direct".parse::<Path>().ok(), Some(Path::VULKAN));
        assert_eq!(format!("{:>8}|{:<6}|", Path::GL, Path::VULKAN), "      gl|vulkan|");
    }

    #[test]
    fn unknown_names_are_errors_with_the_nearest() {
        for (name, message) in [
            (
                "vulcan",
                "there is no execution path `vulcan`; a path is vulkan, metal, dx12, gl, cpu, dawn, chromium or process@NAME; \
                 did you mean `vulkan`?",
            ),
            (
                "",
                "there is no execution path ``; a path is vulkan, metal, dx12, gl, cpu, dawn, chromium or process@NAME",
            ),
            ("@llvmpipe", "there is no execution path `@llvmpipe`; a path is"),
            (
                "vulkan:hlls",
                "execution path `vulkan:hlls` has no route `hlls`: use wgsl, spirv, glsl, \
                 hlsl or hlsl-dxc; did you mean `hlsl`?",
            ),
            (
                "cpu:FMA",
                "execution path `cpu:FMA` has no route `FMA`: use `cpu:fma` or `cpu:ftz`; did you mean `fma`?",
            ),
            ("vulkan:", "execution path `vulkan:` has no route ``"),
            (
                "gl@LLVMpipe",
                "execution path `gl@LLVMpipe` has the unknown driver family `LLVMpipe`; did \
                 you mean `llvmpipe`?",
            ),
            ("gl@", "execution path `gl@` has the unknown driver family ``"),
            (
                "vulkan@lavapipe",
                "execution path `vulkan@lavapipe` has the unknown driver family `lavapipe`; \
                 did you mean `llvmpipe`?",
            ),
        ] {
            let error = name.parse::<Path>().expect_err(name).to_string();
            assert!(error.starts_with(message), "{error}");
        }
    }
}
