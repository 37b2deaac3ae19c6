//! Finds a Chromium for the tests of the review page. The tests of the review page search in the same folders as this
//! module.

use std::path::PathBuf;

use super::host::Host;

/// The names of Chromium's and Chrome's programs, the preferred name first.
const NAMES: [&str; 7] = [
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "Google Chrome",
    "chrome.exe",
];

/// Returns the path of Chromium's program, which is the file that `KARAT_BROWSER` names, or else a file in the usual
/// folders.
pub(crate) fn find(host: &Host) -> Option<PathBuf> {
    if let Some(named) = host.listed("KARAT_BROWSER") {
        return named.into_iter().find(|program| program.is_file());
    }
    let usual = ["/usr/bin", "/Applications/Google Chrome.app/Contents/MacOS"];
    let mut folders = host.listed("PATH").unwrap_or_default();
    folders.extend(usual.map(|folder| host.path(folder)));
    folders.push(PathBuf::from(r"C:\Program Files\Google\Chrome\Application"));
    let mut programs =
        folders.iter().flat_map(|folder| NAMES.iter().map(move |name| folder.join(name)));
    programs.find(|program| program.is_file())
}

#[cfg(test)]
mod tests {
    use super::super::host::tests::Machine;
    use super::*;

    #[test]
    fn a_browser_is_found_by_its_names_or_by_karat_browser() {
        assert_eq!(find(&Machine::new().host()), None);
        let machine =
            Machine::new().file("/opt/bin/google-chrome", "").variable("PATH", "/opt/bin");
        assert!(find(&machine.host()).is_some_and(|at| at.ends_with("opt/bin/google-chrome")));
        let machine = Machine::new().file("/usr/bin/chromium", "");
        assert!(find(&machine.host()).is_some());
        let machine = machine.variable("KARAT_BROWSER", "/nowhere/chrome");
        assert_eq!(find(&machine.host()), None, "what is named is meant");
    }
}
