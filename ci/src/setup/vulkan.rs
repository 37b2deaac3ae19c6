//! Finds Vulkan: the loader, and at least one driver that it can load.

use anyhow::{Context, Result, bail};

use super::host::{self, Host};
use super::manifest::{self, Driver};

/// Returns the drivers that Vulkan will use, as text. If Vulkan can't work, the error names the missing part.
pub(crate) fn find(host: &Host) -> Result<String> {
    host.library("libvulkan.so.1").context("the Vulkan loader, libvulkan.so.1")?;
    // Each of these variables replaces the usual folders. `VK_ICD_FILENAMES` is the older name of `VK_DRIVER_FILES`.
    let variable = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"]
        .into_iter()
        .find_map(|variable| Some((variable, host.listed(variable)?)));
    let places = match &variable {
        Some((_, files)) => files.clone(),
        None => host.data_folders("vulkan/icd.d"),
    };
    let search = manifest::search(host, &places);
    let gpu = host.has_gpu();
    let usable: Vec<String> = search
        .drivers
        .iter()
        .filter_map(|driver| match software(driver) {
            Some(name) => Some(format!("{name} ({})", driver.manifest.display())),
            None => gpu.then(|| driver.manifest.display().to_string()),
        })
        .collect();
    if !usable.is_empty() {
        return Ok(usable.join(", "));
    }
    if let Some((variable, _)) = variable {
        bail!("{variable} hides all drivers but its own, of which none is usable; unset it");
    }
    let hint = match &search.rejected[..] {
        [] if search.drivers.is_empty() => {
            "no manifest in vulkan/icd.d below /etc, /usr/share or XDG's data folders".to_owned()
        }
        [] => "there is no GPU for the drivers installed".to_owned(),
        rejected => rejected.join("; "),
    };
    bail!("lavapipe, the software driver ({hint})")
}

/// Returns the name of a driver that runs on the processor, or `None` for a driver of a GPU.
fn software(driver: &Driver) -> Option<&'static str> {
    let library = host::name(&driver.library);
    if library.contains("vulkan_lvp") {
        Some("lavapipe")
    } else if library.contains("vk_swiftshader") {
        Some("SwiftShader")
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::host::tests::Machine;
    use super::*;

    fn loader() -> Machine {
        Machine::new().file("/usr/lib/libvulkan.so.1", "")
    }

    fn message(machine: &Machine) -> String {
        format!("{:#}", find(&machine.host()).expect_err("something is missing"))
    }

    #[test]
    fn an_empty_machine_lacks_the_loader_first() {
        assert_eq!(message(&Machine::new()), "the Vulkan loader, libvulkan.so.1");
        assert_eq!(
            message(&loader()),
            "lavapipe, the software driver \
             (no manifest in vulkan/icd.d below /etc, /usr/share or XDG's data folders)"
        );
    }

    #[test]
    fn lavapipe_needs_no_gpu_and_hardware_does() {
        let lavapipe = loader()
            .manifest("/usr/share/vulkan/icd.d/lvp_icd.json", "/usr/lib/libvulkan_lvp.so")
            .file("/usr/lib/libvulkan_lvp.so", "");
        assert!(find(&lavapipe.host()).is_ok_and(|found| found.starts_with("lavapipe (")));

        let radeon = loader()
            .manifest("/usr/share/vulkan/icd.d/radeon_icd.json", "/usr/lib/libvulkan_radeon.so")
            .file("/usr/lib/libvulkan_radeon.so", "");
        assert_eq!(
            message(&radeon),
            "lavapipe, the software driver (there is no GPU for the drivers installed)"
        );
        let radeon = radeon.file("/dev/dri/renderD128", "");
        assert!(find(&radeon.host()).is_ok_and(|found| found.ends_with("radeon_icd.json")));
    }

    #[test]
    fn a_variable_that_hides_the_drivers_is_named() {
        let machine = loader()
            .manifest("/usr/share/vulkan/icd.d/lvp_icd.json", "/usr/lib/libvulkan_lvp.so")
            .file("/usr/lib/libvulkan_lvp.so", "")
            .variable("VK_ICD_FILENAMES", "/nowhere.json");
        assert_eq!(
            message(&machine),
            "VK_ICD_FILENAMES hides all drivers but its own, of which none is usable; unset it"
        );
    }
}
