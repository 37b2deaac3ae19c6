//! The path that needs no driver.

use super::{Adapter, Path};

/// What runs it.
pub(crate) fn adapter() -> Adapter {
    Adapter {
        path: Path::CPU.to_string(),
        name: "Karat's engine".to_owned(),
        driver: format!("karat-engine {}", env!("CARGO_PKG_VERSION")),
        software: true,
    }
}
