//! `cargo ci matrix`: writes the documentation's table of translations of the shader library.

use anyhow::{Context, Result, ensure};

use crate::{command, corpus, demo, setup, swiftshader};

/// The page with the table.
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

/// Tests each operator and builtin function on the engine, Vulkan, GL and two translations, and then on SwiftShader.
pub(crate) fn divergences() -> Result<()> {
    setup::install_missing()?;
    setup::install_browser()?;
    setup::install_validators()?;
    let ask = |paths: &str| {
        let mut asked = corpus::program("divergences");
        asked.arg(command::root().join("docs/divergences"));
        asked.env("KARAT_PATHS", paths);
        asked
    };
    command::run(&mut ask("cpu,cpu:fma,cpu:ftz,vulkan,gl,vulkan:glsl,vulkan:hlsl"))?;
    let manifest = swiftshader::manifest().context("no Chromium with SwiftShader is here")?;
    command::run(ask("vulkan").env("VK_DRIVER_FILES", manifest))
}
