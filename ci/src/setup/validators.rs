//! Finds the programs that check and compile naga's translations. `karat` searches in the same folders as this module.

use std::path::PathBuf;

use super::host::Host;

/// The programs that the tests of translations run.
pub(crate) const NAMES: [&str; 5] =
    ["spirv-val", "spirv-dis", "spirv-as", "spirv-cross", "glslangValidator"];

/// Returns the names of the missing programs.
pub(crate) fn missing(host: &Host) -> Vec<&'static str> {
    let mut folders = host.listed("PATH").unwrap_or_default();
    let sdk = host.listed("VULKAN_SDK").unwrap_or_default();
    folders.extend(sdk.iter().flat_map(|sdk| ["bin", "Bin"].map(|bin| sdk.join(bin))));
    let is_here = |name: &&str| {
        let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
        folders.iter().map(|folder| folder.join(&file)).any(|file: PathBuf| file.is_file())
    };
    NAMES.into_iter().filter(|name| !is_here(name)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::host::tests::Machine;
    use super::*;

    #[test]
    fn each_program_is_looked_for() {
        assert_eq!(missing(&Machine::new().host()), NAMES);
        let machine = NAMES.iter().fold(Machine::new().variable("PATH", "/usr/bin"), |m, name| {
            m.file(&format!("/usr/bin/{name}{}", std::env::consts::EXE_SUFFIX), "")
        });
        assert!(missing(&machine.host()).is_empty());
    }
}
