//! The path `cpu`, which needs no driver.

use super::{Adapter, Path, Via};

pub(crate) fn adapter(path: Path) -> Adapter {
    let name = match path.via() {
        Via::Fma => "Karat's engine, a * b + c rounded once",
        Via::Ftz => "Karat's engine, subnormals as zero",
        _ => "Karat's engine",
    };
    Adapter {
        path: path.to_string(),
        name: name.to_owned(),
        driver: format!("karat-engine {}", env!("CARGO_PKG_VERSION")),
        software: true,
    }
}
