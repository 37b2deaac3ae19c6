//! A shader in naga's form.

use std::fmt;

use karat_core::panics;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{Module, ShaderStage};

use crate::{Bindings, Code, Target, Translation, write};

/// The reason why there is no translation.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TranslateError {
    /// naga can't read the shader.
    #[error("naga doesn't read the shader: {0}")]
    Unread(String),
    /// The shader isn't valid.
    #[error("naga finds the shader invalid: {0}")]
    Invalid(String),
    /// naga reports that it can't write something.
    #[error("naga doesn't write it as {target}: {message}")]
    Unsupported {
        /// The language.
        target: Target,
        /// naga's own words.
        message: String,
    },
    /// naga panicked.
    #[error("naga panics as it writes {target}: {message}")]
    Panicked {
        /// The language.
        target: Target,
        /// The panic's message.
        message: String,
    },
    /// There is no such entry point.
    #[error("the shader has no entry point `{0}`")]
    NoEntryPoint(String),
}

/// The stage of an entry point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Stage {
    /// `@vertex`
    Vertex,
    /// `@fragment`
    Fragment,
    /// `@compute`
    Compute,
    /// A stage of an extension: mesh shaders, ray tracing.
    Other,
}

impl Stage {
    pub(crate) fn of(stage: ShaderStage) -> Self {
        match stage {
            ShaderStage::Vertex => Self::Vertex,
            ShaderStage::Fragment => Self::Fragment,
            ShaderStage::Compute => Self::Compute,
            _ => Self::Other,
        }
    }

    /// glslang's name for it.
    pub(crate) fn short(self) -> &'static str {
        match self {
            Self::Vertex => "vert",
            Self::Fragment => "frag",
            Self::Compute => "comp",
            Self::Other => "other",
        }
    }
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Vertex => "vertex",
            Self::Fragment => "fragment",
            Self::Compute => "compute",
            Self::Other => "other",
        })
    }
}

/// An entry point of a shader or of a translation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EntryPoint {
    /// Its stage.
    pub stage: Stage,
    /// Its name.
    pub name: String,
}

/// A valid shader, with naga's analysis.
#[derive(Debug)]
pub struct Shader {
    pub(crate) module: Module,
    pub(crate) info: ModuleInfo,
}

impl Shader {
    /// Reads WGSL.
    ///
    /// # Errors
    /// If naga can't read it, or finds it invalid.
    pub fn parse(wgsl: &str) -> Result<Self, TranslateError> {
        /// naga writes this line but can't read it; it accepts subgroup operations without it.
        const SUBGROUPS: &str = "enable subgroups;";
        let read = wgsl.replacen(SUBGROUPS, &" ".repeat(SUBGROUPS.len()), 1);
        let module = on_deep_stack(|| naga::front::wgsl::parse_str(&read));
        Self::of(module.map_err(|error| TranslateError::Unread(error.emit_to_string(wgsl)))?)
    }

    /// Wraps a module of naga.
    ///
    /// # Errors
    /// If naga finds it invalid.
    pub fn of(module: Module) -> Result<Self, TranslateError> {
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
        let info = on_deep_stack(|| {
            let invalid = |error: naga::WithSpan<_>| causes(error.as_inner());
            validator.validate(&module).map_err(invalid)
        });
        Ok(Self { info: info.map_err(TranslateError::Invalid)?, module })
    }

    /// Returns `true` if a compute entry point uses `num_workgroups`: as HLSL it needs this value from the host, in a
    /// buffer of its own.
    #[must_use]
    pub fn takes_constants(&self, entry_point: &str) -> bool {
        write::hlsl::takes_constants(&self.module, entry_point)
    }

    /// Reads SPIR-V.
    ///
    /// # Errors
    /// If naga can't read it, or finds it invalid.
    pub fn from_spirv(words: &[u32]) -> Result<Self, TranslateError> {
        // naga flipped the Y axis when it wrote the SPIR-V.
        let options = naga::front::spv::Options::default();
        let frontend = naga::front::spv::Frontend::new(words.iter().copied(), &options);
        let module = on_deep_stack(|| frontend.parse());
        Self::of(module.map_err(|error| TranslateError::Unread(causes(&error)))?)
    }

    /// The entry points, in the order of the text.
    #[must_use]
    pub fn entry_points(&self) -> Vec<EntryPoint> {
        let own =
            |e: &naga::EntryPoint| EntryPoint { stage: Stage::of(e.stage), name: e.name.clone() };
        self.module.entry_points.iter().map(own).collect()
    }

    /// The workgroup size of a compute entry point; 0 for other stages.
    #[must_use]
    pub fn workgroup_size(&self, entry_point: &str) -> (u32, u32, u32) {
        let known = self.module.entry_points.iter().find(|e| e.name == entry_point);
        known.map_or((0, 0, 0), |e| e.workgroup_size.into())
    }

    /// The IR of naga.
    #[must_use]
    pub fn module(&self) -> &Module {
        &self.module
    }

    /// The shader's IR, by value.
    #[must_use]
    pub fn into_module(self) -> Module {
        self.module
    }

    /// Translates one entry point with everything that it uses, or the whole shader. A GLSL text has one entry point,
    /// so name it if there are several.
    ///
    /// # Errors
    /// If there is no such entry point, or naga can't write it in this language.
    pub fn translate(
        &self,
        target: Target,
        entry_point: Option<&str>,
    ) -> Result<Translation, TranslateError> {
        let known = |name: &str| self.module.entry_points.iter().find(|e| e.name == name);
        let entry_point = match entry_point {
            Some(name) => {
                Some(known(name).ok_or_else(|| TranslateError::NoEntryPoint(name.to_owned()))?)
            }
            None => None,
        };
        // A crash or a panic of a compiler is a verdict on it. naga is one of these compilers.
        let written = panics::caught(|| on_deep_stack(|| write::write(self, target, entry_point)));
        match written {
            Ok(Ok(translation)) => Ok(translation),
            Ok(Err(message)) => Err(TranslateError::Unsupported { target, message }),
            Err(panicked) => Err(TranslateError::Panicked { target, message: panicked.message }),
        }
    }
}

impl Shader {
    /// The text from which the shader was [parsed](Self::parse), for an executor of naga's IR. Nothing is translated.
    ///
    /// # Errors
    /// If there is no such entry point.
    pub fn as_it_is(&self, text: &str, entry_point: &str) -> Result<Translation, TranslateError> {
        let one = self.entry_points().into_iter().find(|one| one.name == entry_point);
        let one = one.ok_or_else(|| TranslateError::NoEntryPoint(entry_point.to_owned()))?;
        Ok(Translation {
            target: Target::Wgsl,
            code: Code::Text(text.to_owned()),
            entry_points: vec![one],
            bindings: Bindings::default(),
            options: "the author's text, which nothing translates".to_owned(),
            uniforms: Vec::new(),
        })
    }
}

/// Runs code that recurses as deeply as a shader nests, on a large stack.
fn on_deep_stack<T>(work: impl FnOnce() -> T) -> T {
    /// Without optimisation, naga's recursion takes up to some 20 KB a level.
    const STACK: usize = 256 << 20;
    stacker::grow(STACK, work)
}

/// An error with its causes.
pub(crate) fn causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        let cause_text = cause.to_string();
        if !text.contains(&cause_text) {
            text = format!("{text}: {cause_text}");
        }
        source = cause.source();
    }
    text
}
