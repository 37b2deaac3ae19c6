//! Keeps the kernels that a process has parsed, because each path compiles the same one.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use naga::Module;
use naga::front::wgsl;

use super::Overrides;

/// Kernels that are kept: those that all threads compile at a time, for path after path.
const MOST_KEPT: usize = 64;

/// naga's IR of a kernel, which is parsed once for all paths; or what is wrong with it.
pub(crate) fn parsed(text: &str) -> Result<Arc<Module>, String> {
    static KEPT: Mutex<VecDeque<(blake3::Hash, Arc<Module>)>> = Mutex::new(VecDeque::new());
    let lock = || KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    let key = blake3::hash(text.as_bytes());
    if let Some((_, module)) = lock().iter().find(|(known, _)| *known == key) {
        return Ok(Arc::clone(module));
    }
    let module = super::on_deep_stack(|| wgsl::parse_str(text));
    let module = Arc::new(module.map_err(|error| error.emit_to_string(text))?);
    let mut kept = lock();
    kept.truncate(MOST_KEPT - 1);
    kept.push_front((key, Arc::clone(&module)));
    Ok(module)
}

/// The kernel with values of overrides, by their names in its text.
pub(crate) fn parsed_with(text: &str, overrides: &Overrides) -> Result<Arc<Module>, String> {
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
