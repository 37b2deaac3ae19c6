//! Finds the parts of GL: the library EGL, a vendor's EGL library, and a driver.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};

use super::host::{self, Host};
use super::manifest;

/// Returns the drivers that GL will use, as text. If GL can't work, the error names the missing part.
pub(crate) fn find(host: &Host) -> Result<String> {
    host.library("libEGL.so.1").context("EGL, libEGL.so.1")?;
    // Each of these variables replaces the usual folders.
    let variable = ["__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS"]
        .into_iter()
        .find_map(|variable| Some((variable, host.listed(variable)?)));
    let places = match &variable {
        Some((_, places)) => places.clone(),
        None => host.data_folders("glvnd/egl_vendor.d"),
    };
    let search = manifest::search(host, &places);
    let gpu = host.has_gpu();
    let mut usable = Vec::new();
    let mut unusable = Vec::new();
    for vendor in &search.drivers {
        let mesa = host::name(&vendor.library).contains("mesa");
        let driver = if mesa { software_driver(host) } else { None };
        match driver {
            Some(driver) => usable.push(format!("llvmpipe ({})", driver.display())),
            None if gpu => usable.push(vendor.manifest.display().to_string()),
            None if mesa => unusable.push("Mesa's swrast_dri.so is not installed".to_owned()),
            None => unusable.push(format!("there is no GPU for {}", vendor.manifest.display())),
        }
    }
    if !usable.is_empty() {
        return Ok(usable.join(", "));
    }
    if let Some((variable, _)) = variable {
        bail!("{variable} hides all EGL vendors but its own, of which none is usable; unset it");
    }
    unusable.extend(search.rejected);
    if unusable.is_empty() {
        let folders = "/etc, /usr/share or XDG's data folders";
        unusable.push(format!("no manifest in glvnd/egl_vendor.d below {folders}"));
    }
    bail!("llvmpipe, the software driver ({})", unusable.join("; "))
}

/// Returns the file of Mesa's software rasteriser: `dri/swrast_dri.so`, or since Mesa 24.2 `libgallium`, which contains
/// the rasteriser.
fn software_driver(host: &Host) -> Option<PathBuf> {
    let folders = host.library_folders();
    let listed = host.listed("LIBGL_DRIVERS_PATH").unwrap_or_default();
    let dri = listed.into_iter().chain(folders.iter().map(|folder| folder.join("dri")));
    let gallium = |file: &PathBuf| {
        let name = host::name(file);
        name.starts_with("libgallium") && name.ends_with(".so")
    };
    dri.map(|folder| folder.join("swrast_dri.so"))
        .find(|file| file.is_file())
        .or_else(|| folders.iter().flat_map(|folder| host::files(folder)).find(gallium))
}

#[cfg(test)]
mod tests {
    use super::host::tests::Machine;
    use super::*;

    fn mesa() -> Machine {
        Machine::new()
            .file("/usr/lib/libEGL.so.1", "")
            .manifest("/usr/share/glvnd/egl_vendor.d/50_mesa.json", "libEGL_mesa.so.0")
            .file("/usr/lib/libEGL_mesa.so.0", "")
    }

    fn message(machine: &Machine) -> String {
        format!("{:#}", find(&machine.host()).expect_err("something is missing"))
    }

    #[test]
    fn each_missing_layer_is_named() {
        assert_eq!(message(&Machine::new()), "EGL, libEGL.so.1");
        assert_eq!(
            message(&Machine::new().file("/usr/lib/libEGL.so.1", "")),
            "llvmpipe, the software driver \
             (no manifest in glvnd/egl_vendor.d below /etc, /usr/share or XDG's data folders)"
        );
        assert_eq!(
            message(&mesa()),
            "llvmpipe, the software driver (Mesa's swrast_dri.so is not installed)"
        );
    }

    #[test]
    fn mesa_is_found_by_its_old_and_by_its_new_driver() {
        let old = mesa().file("/usr/lib/dri/swrast_dri.so", "");
        assert!(find(&old.host()).is_ok_and(|found| found.starts_with("llvmpipe (")));
        let new = mesa().file("/usr/lib/libgallium-24.3.2.so", "");
        assert!(find(&new.host()).is_ok_and(|found| found.starts_with("llvmpipe (")));
    }

    #[test]
    fn another_vendor_needs_a_gpu() {
        let vendor = Machine::new()
            .file("/usr/lib/libEGL.so.1", "")
            .manifest("/usr/share/glvnd/egl_vendor.d/10_nvidia.json", "libEGL_nvidia.so.0")
            .file("/usr/lib/libEGL_nvidia.so.0", "");
        assert!(message(&vendor).contains("there is no GPU for"));
        let vendor = vendor.file("/dev/nvidiactl", "");
        assert!(find(&vendor.host()).is_ok_and(|found| found.ends_with("10_nvidia.json")));
    }
}
