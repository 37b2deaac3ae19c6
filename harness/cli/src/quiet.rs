//! Turns off Mesa's warning about `XDG_RUNTIME_DIR`.

/// Turns off Mesa's device-select layer, which warns twice if `XDG_RUNTIME_DIR` isn't a folder, as in CI and in
/// containers. The environment variable `NODEVICE_SELECT` turns the layer off, but must be set before the first thread
/// starts. So this program sets the variable and restarts once.
#[cfg(target_os = "linux")]
pub(crate) fn begin() {
    use std::os::unix::process::CommandExt;
    use std::path::Path;
    use std::process::Command;

    let is_folder = |value: std::ffi::OsString| Path::new(&value).is_dir();
    let is_set = |name: &str| std::env::var_os(name).is_some();
    // A user who selects a device with the layer needs the layer.
    let is_wanted = is_set("MESA_VK_DEVICE_SELECT") || is_set("DRI_PRIME");
    if is_set("NODEVICE_SELECT")
        || is_wanted
        || std::env::var_os("XDG_RUNTIME_DIR").is_some_and(is_folder)
    {
        return;
    }
    let mut arguments = std::env::args_os();
    if let (Some(name), Ok(program)) = (arguments.next(), std::env::current_exe()) {
        let mut again = Command::new(program);
        again.arg0(name).args(arguments).env("NODEVICE_SELECT", "1");
        // `exec` returns only if it failed. Then the warnings appear, and nothing else changes.
        drop(again.exec());
    }
}

#[cfg(not(target_os = "linux"))]
pub(crate) fn begin() {}
