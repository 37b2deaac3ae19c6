//! Selects the paths on which checks run, and matches paths with selectors.

use super::{Adapter, Api, Opened, Path, PathError, Selector, device, open};
use crate::settings::{self, Settings};

/// Checks that a selector's text is the name of a path, or a part of a name.
///
/// # Errors
/// Returns an error if the text is neither the name of a path nor a part of a name. The message has the reason and a
/// suggestion.
pub fn expect_sound(selector: &Selector) -> Result<(), PathError> {
    selector.expect_sound()
}

/// Checks if a selector matches a path.
#[must_use]
pub fn selects(selector: &Selector, path: Path, adapter: &Adapter) -> bool {
    selector.selects(path, adapter)
}

/// The adapter of a path.
///
/// ```no_run
/// use karat::Path;
///
/// let adapter = karat::unstable::path::adapter(Path::VULKAN)?;
/// println!("{adapter}"); // vulkan: NVIDIA GeForce ..., 580.95
/// # Ok::<(), karat::path::PathError>(())
/// ```
///
/// # Errors
/// Returns an error if the path can't be opened.
pub fn adapter(path: Path) -> Result<Adapter, PathError> {
    open(path).map(Opened::adapter)
}

/// The adapter of a path that the user requires.
///
/// ```no_run
/// use karat::Path;
///
/// let adapter = karat::unstable::path::required("vulkan@nvidia".parse::<Path>()?)?;
/// println!("{adapter}");
/// # Ok::<(), karat::path::PathError>(())
/// ```
///
/// # Errors
/// Returns an error if the path can't be opened. The message says that the user requires the path.
pub fn required(path: Path) -> Result<Adapter, PathError> {
    must_open(path).map(Opened::adapter)
}

fn must_open(path: Path) -> Result<Opened, PathError> {
    open(path).map_err(|error| match error {
        PathError::Unavailable { path, reason } => PathError::Required { path, reason },
        other => other,
    })
}

/// The paths that the environment selects for a check. The list has at least one path.
///
/// ```no_run
/// for path in karat::unstable::path::selected()? {
///     println!("checks run on {path}");
/// }
/// # Ok::<(), karat::path::PathError>(())
/// ```
///
/// # Errors
/// Returns an error if a setting is wrong, if a required path can't be opened, or if no path can be opened.
pub fn selected() -> Result<Vec<Path>, PathError> {
    Ok(chosen()?.into_iter().map(Opened::path).collect())
}

/// Opens the paths that [`selected`] returns.
pub(crate) fn chosen() -> Result<Vec<Opened>, PathError> {
    let Settings { paths, require, adapter, .. } = settings::current()?;
    let unasked = [paths, require, adapter].iter().all(|setting| setting.is_none());
    match select(paths.as_deref(), require.as_deref()) {
        // The user set no variable that selects paths, and no driver opens on this machine.
        Err(PathError::None { .. }) if unasked => open(Path::CPU).map(|engine| vec![engine]),
        chosen => chosen,
    }
}

fn select(paths: Option<&str>, required: Option<&str>) -> Result<Vec<Opened>, PathError> {
    let required = required.map_or_else(|| Ok(Vec::new()), |names| list("KARAT_REQUIRE", names))?;
    let named = paths.map_or_else(|| Ok(Vec::new()), |names| list("KARAT_PATHS", names))?;
    let drivers = || Path::ALL.into_iter().filter_map(|path| open(path).ok());
    let mut chosen: Vec<Opened> =
        required.into_iter().chain(named).map(must_open).collect::<Result<_, _>>()?;
    let is_all = paths.is_some_and(|names| names.split(',').any(|name| name.trim() == ALL));
    let usual: Vec<Opened> = match paths {
        _ if is_all => drivers().collect(),
        None if chosen.is_empty() => drivers().take(1).collect(),
        _ => Vec::new(),
    };
    // With `all`, at least one driver must open, even if the list has other paths.
    let none = usual.is_empty() && !chosen.iter().any(|opened| opened.device().is_some());
    if none && (is_all || chosen.is_empty()) {
        let reasons = Path::ALL
            .iter()
            .filter(|path| device::exists(**path))
            .filter_map(|path| open(*path).err().map(|error| error.to_string()))
            .collect();
        return Err(PathError::None { reasons });
    }
    chosen.extend(usual);
    chosen.sort_by_key(|opened| opened.path());
    chosen.dedup_by_key(|opened| opened.path());
    Ok(distinct(&chosen))
}

/// Removes a path without a driver's name if a path with a driver's name uses the same adapter: `vulkan` is removed if
/// it has the same adapter as `vulkan@llvmpipe`.
fn distinct(all: &[Opened]) -> Vec<Opened> {
    let what = |opened: &Opened| {
        let (path, adapter) = (opened.path(), opened.adapter());
        (path.api(), path.via(), adapter.name, adapter.driver)
    };
    let named: Vec<_> =
        all.iter().filter(|opened| opened.path().driver().is_some()).map(what).collect();
    let stays =
        |opened: &Opened| opened.path().driver().is_some() || !named.contains(&what(opened));
    all.iter().copied().filter(stays).collect()
}

/// Checks the names of custom executors. Each name must be unique, and different from the drivers' names. Also checks
/// that `KARAT_PATHS` and `KARAT_REQUIRE` contain only names of paths.
pub(crate) fn expect_own(paths: impl Iterator<Item = Path>) -> Result<(), PathError> {
    let settings = settings::current()?;
    for (variable, names) in
        [("KARAT_PATHS", &settings.paths), ("KARAT_REQUIRE", &settings.require)]
    {
        names.as_deref().map_or(Ok(Vec::new()), |names| list(variable, names))?;
    }
    let mut known = Vec::new();
    for path in paths {
        if Path::ALL.contains(&path) || known.contains(&path) {
            return Err(PathError::Taken { path });
        }
        known.push(path);
    }
    Ok(())
}

/// The paths in a list. The list has the format of `KARAT_PATHS`, in which `all` stands for the paths of [`Path::ALL`]
/// that open on this machine.
///
/// ```no_run
/// use karat::Path;
///
/// assert_eq!(karat::unstable::path::named("KARAT_PATHS", "vulkan,gl")?, [Path::VULKAN, Path::GL]);
/// # Ok::<(), karat::path::PathError>(())
/// ```
///
/// # Errors
/// Returns an error if a name isn't a path, or occurs twice.
pub fn named(variable: &'static str, names: &str) -> Result<Vec<Path>, PathError> {
    let mut paths = list(variable, names)?;
    if names.split(',').any(|name| name.trim() == ALL) {
        let open = Path::ALL.into_iter().filter(|path| open(*path).is_ok());
        paths.extend(open.filter(|path| !paths.contains(path)).collect::<Vec<_>>());
    }
    Ok(paths)
}

/// The paths of the programs in `KARAT_EXECUTORS`.
///
/// ```
/// for path in karat::unstable::path::programs()? {
///     println!("{path}"); // process@dawn
/// }
/// # Ok::<(), karat::path::PathError>(())
/// ```
///
/// # Errors
/// Returns an error if a setting is wrong.
pub fn programs() -> Result<Vec<Path>, PathError> {
    let names = settings::current()?.executors.iter();
    names.map(|(name, _)| format!("{}@{name}", Api::Process.name()).parse()).collect()
}

/// The word in a list that stands for all paths of [`Path::ALL`] that open on this machine.
const ALL: &str = "all";

/// Returns the paths that a list names. Skips the word `all`, except in `KARAT_REQUIRE`, where `all` is an error. Each
/// path may occur only once.
fn list(variable: &'static str, names: &str) -> Result<Vec<Path>, PathError> {
    let repeated = |path: String| PathError::Repeated { variable, names: names.to_owned(), path };
    let (mut paths, mut all) = (Vec::new(), false);
    for name in names.split(',').map(str::trim) {
        if name == ALL && variable != "KARAT_REQUIRE" {
            if std::mem::replace(&mut all, true) {
                return Err(repeated(ALL.to_owned()));
            }
            continue;
        }
        let path: Path = name.parse()?;
        if paths.contains(&path) {
            return Err(repeated(path.to_string()));
        }
        paths.push(path);
    }
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 66
    #[test]
    fn lists_are_read_whole() {
        let names = |names: &str| list("KARAT_PATHS", names);
        assert_eq!(names("gl, vulkan").ok(), Some(vec![Path::GL, Path::VULKAN]));
        assert_eq!(names("all").ok(), Some(Vec::new()));
        for (wrong, message) in [
            ("gl,gl", "KARAT_PATHS=gl,gl names `gl` twice"),
            ("all,gl,all", "KARAT_PATHS=all,gl,all names `all` twice"),
            ("all,vulcan", "there is no execution path `vulcan`"),
            ("vulkan,", "there is no execution path ``"),
        ] {
            let error = names(wrong).expect_err(wrong).to_string();
            assert!(error.starts_with(message), "{error}");
        }
        let all = list("KARAT_REQUIRE", "gl,all").expect_err("names no path").to_string();
        assert!(all.starts_with("there is no execution path `all`"), "{all}");
        for (paths, required) in
            [(Some("cpu"), None), (None, Some("cpu")), (Some(" cpu"), Some("cpu"))]
        {
            let chosen = select(paths, required).expect("it is always there");
            assert!(matches!(&*chosen, [Opened::Cpu(Path::CPU)]), "{chosen:?}");
        }
        for names in ["all,vulcan", "vulkan,opengl"] {
            assert!(matches!(select(Some(names), None), Err(PathError::Unknown { .. })));
        }
    }

    /// All paths of a list run, in an order that doesn't depend on the order of the list.
    // Lesson 73
    #[test]
    fn each_path_of_a_list_is_run() {
        let here: Vec<Path> = Path::ALL.into_iter().filter(|path| open(*path).is_ok()).collect();
        let named = |paths: &[Path]| -> Vec<Path> {
            let names: Vec<&str> = paths.iter().map(|path| path.name()).collect();
            let opened = select(Some(&names.join(",")), None).expect("they open");
            opened.into_iter().map(Opened::path).collect()
        };
        let backwards: Vec<Path> = here.iter().rev().copied().collect();
        assert_eq!((named(&here), named(&backwards)), (here.clone(), here.clone()));
        let required = select(None, Some("vulkan,gl").filter(|_| here.len() > 1));
        assert!(here.len() < 2 || required.is_ok_and(|devices| devices.len() == 2));
    }

    // Lesson 3
    #[test]
    fn a_required_path_that_cannot_exist_is_an_error() {
        let foreign = if cfg!(target_os = "macos") { "dx12" } else { "metal" };
        let error = select(Some("all"), Some(foreign)).expect_err("not on this platform");
        assert!(matches!(error, PathError::Required { .. }), "{error}");
        assert!(select(Some(foreign), None).is_err(), "a path listed by name must open");
    }

    /// A path such as `vulkan@llvmpipe` uses an adapter of the driver family `llvmpipe`, even if the API has other
    /// adapters. If the machine lacks the route or the driver in the path's name, opening the path returns an error.
    #[test]
    fn a_path_opens_only_the_driver_that_it_names() {
        let here = Path::ALL.into_iter().filter_map(|path| open(path).ok());
        for device in here {
            let family = device.adapter().family();
            let named: Path = format!("{}@{family}", device.path()).parse().expect("a family");
            let same = open(named).expect("it is here");
            assert_eq!(same.adapter().name, device.adapter().name);
            assert_eq!(same.adapter().path, named.to_string());
            // The path runs once, whether it is required, part of `all`, or listed.
            for (paths, required) in
                [(format!("all,{named}"), None), (named.to_string(), Some(device.path()))]
            {
                let required = required.map(Path::name);
                let selected = select(Some(&paths), required).expect("they open");
                let paths: Vec<Path> = selected.iter().map(|device| device.path()).collect();
                assert!(paths.contains(&named) && !paths.contains(&device.path()), "{paths:?}");
            }
            let nobody: Path = format!("{}@nobody", device.path()).parse().expect("a name");
            let error = open(nobody).expect_err("no such driver").to_string();
            assert!(error.contains("no adapter of the family `nobody`"), "{error}");
        }
        let engine: Path = "cpu:hlsl".parse().expect("a name");
        let error = open(engine).expect_err("there is no such engine").to_string();
        assert!(error.contains("`cpu:hlsl` is unavailable"), "{error}");
    }
}
