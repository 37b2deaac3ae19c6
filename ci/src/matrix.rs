//! `cargo ci matrix`: every translation of the shader library, as the documentation has it.

use anyhow::{Result, ensure};

use crate::{command, demo, setup};

/// Where the table goes.
const PAGE: &str = "docs/translations.md";

pub(crate) fn run() -> Result<()> {
    setup::install_validators()?;
    demo::build()?;
    let page = command::root().join(PAGE);
    let mut karat = command::karat(&["matrix", "--shaders"])?;
    command::run(karat.arg(command::root().join("shaders")).arg("--markdown").arg(&page))?;
    ensure!(page.is_file(), "{PAGE} wasn't written");
    Ok(())
}
