//! Caches the parsed kernels of a process, because every path compiles the same kernel.

use std::sync::Arc;

use naga::Module;
use naga::front::wgsl;

use super::Overrides;
use crate::package::as_naga_takes;
use crate::package::workspace::{self, Kind};

struct Kernels;

impl Kind for Kernels {
    type Key = blake3::Hash;
    type Value = Arc<Module>;
    // All threads together compile fewer kernels than this at the same time.
    const MOST: usize = 256;
}

/// naga's IR of a kernel, or naga's error. All paths share the result.
pub(crate) fn parsed(text: &str) -> Result<Arc<Module>, String> {
    let key = blake3::hash(text.as_bytes());
    if let Some(module) = workspace::get::<Kernels>(&key) {
        return Ok(module);
    }
    let module = super::on_deep_stack(|| wgsl::parse_str(&as_naga_takes(text)));
    let module = Arc::new(module.map_err(|error| error.emit_to_string(text))?);
    workspace::keep::<Kernels>(key, Arc::clone(&module));
    Ok(module)
}

/// naga's IR of a kernel, with these values of overrides. The keys are the overrides' names in the kernel's text.
pub fn parsed_with(text: &str, overrides: &Overrides) -> Result<Arc<Module>, String> {
    let module = parsed(text)?;
    if overrides.is_empty() {
        return Ok(module);
    }
    let mut module = Module::clone(&module);
    super::overrides::set(&mut module, overrides).map_err(|(_, reason)| reason)?;
    Ok(Arc::new(module))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_parsed_once() {
        let text = |value: usize| format!("fn f() -> f32 {{ return {value}.0; }}");
        let first = parsed(&text(0)).expect("valid");
        assert!(Arc::ptr_eq(&first, &parsed(&text(0)).expect("valid")));
        assert!(!Arc::ptr_eq(&first, &parsed(&text(1)).expect("valid")));
        assert!(parsed("const VALUE = ;").expect_err("not WGSL").contains("const VALUE = ;"));
    }
}
