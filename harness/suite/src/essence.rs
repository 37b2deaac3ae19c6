//! What a test is made of: while that is the same, so is its verdict.

use std::path::Path;

use karat::reflect::Program;
use toml::Value;

use crate::declared::What;
use crate::{Kind, Suite, Test};

impl Suite {
    /// All that a test's verdict depends on, but for comments and blanks of shaders and the driver; `None`
    /// where it can't be told, as of a shader that isn't valid.
    #[must_use]
    pub fn essence(&self, test: &Test) -> Option<String> {
        match &test.kind {
            Kind::Wgsl(test) => Some(test.essence().to_owned()),
            Kind::Function(assertion) => {
                let mut text =
                    Program::of_function(&self.package, &assertion.function).ok()?.essence();
                match &assertion.what {
                    What::AgreesWith(reference) => {
                        let name = assertion.of_module(reference);
                        text += &Program::of_function(&self.package, &name).ok()?.essence();
                    }
                    What::Table(file) => text += &content(&assertion.folder.join(file))?,
                    _ => {}
                }
                text += &files(assertion.test.with.values(), &assertion.folder)?;
                Some(format!("{text} {:?} {:?}", assertion.test, assertion.what))
            }
            Kind::Frame(frame) => {
                let module = frame.module.as_deref().unwrap_or_default();
                let text = Program::of_module(&self.package, module).ok()?.essence();
                let golden = content(&frame.golden_file())?;
                let files = files(frame.with.values(), &frame.folder)?;
                Some(format!("{text} {frame:?} {golden} {files}"))
            }
        }
    }
}

/// What stands in a file, as long as it is there.
fn content(file: &Path) -> Option<String> {
    let bytes = std::fs::read(file).ok()?;
    Some(blake3::hash(&bytes).to_hex().to_string())
}

/// What stands in the images that are bound.
fn files<'v>(with: impl Iterator<Item = &'v Value>, folder: &Path) -> Option<String> {
    let names = with.filter_map(Value::as_str).filter(|name| name.contains('.'));
    names.map(|name| content(&folder.join(name))).collect()
}
