//! Keeps Mesa from complaining of where it runs.

/// Mesa's device-select layer looks for a window system, and complains twice where `XDG_RUNTIME_DIR` is no
/// folder: in CI, and in containers. A variable turns the layer off, if it is there before the first thread
/// is. So this program begins once more with it.
#[cfg(target_os = "linux")]
pub(crate) fn begin() {
    use std::os::unix::process::CommandExt;
    use std::path::Path;
    use std::process::Command;

    let is_folder = |value: std::ffi::OsString| Path::new(&value).is_dir();
    let is_set = |name: &str| std::env::var_os(name).is_some();
    // Who chooses a device by the layer needs it.
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
        // It returns where it failed. Then there are complaints, and nothing else is other.
        drop(again.exec());
    }
}

#[cfg(not(target_os = "linux"))]
pub(crate) fn begin() {}
