//! A shader as naga's module, and the errors of its translation.

use std::fmt;

use karat_core::panics;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{Module, ShaderStage};

use crate::{Bindings, Code, Target, Translation, write};

/// The reason why a shader couldn't be read or translated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TranslateError {
    /// naga can't parse the shader.
    #[error("naga can't read the shader: {0}")]
    Unread(String),
    /// naga's validator rejects the shader.
    #[error("naga finds the shader invalid: {0}")]
    Invalid(String),
    /// naga can't write a construct of the shader in this language.
    #[error("naga can't write the shader as {target}: {message}")]
    Unsupported {
        /// The language.
        target: Target,
        /// naga's message.
        message: String,
    },
    /// naga panicked while it wrote the translation.
    #[error("naga panics as it writes {target}: {message}")]
    Panicked {
        /// The language.
        target: Target,
        /// The panic's message.
        message: String,
    },
    /// The shader has no entry point with this name.
    #[error("the shader has no entry point `{0}`")]
    NoEntryPoint(String),
}

/// The stage of an entry point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Stage {
    /// `@vertex`.
    Vertex,
    /// `@fragment`.
    Fragment,
    /// `@compute`.
    Compute,
    /// A stage of a WGSL extension: mesh shaders, ray tracing.
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

    /// glslang's name of the stage.
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
    /// The entry point's stage.
    pub stage: Stage,
    /// The entry point's name.
    pub name: String,
}

/// A valid shader as naga's module, with naga's analysis of it.
#[derive(Debug)]
pub struct Shader {
    pub(crate) module: Module,
    pub(crate) info: ModuleInfo,
}

impl Shader {
    /// Parses and validates WGSL.
    ///
    /// # Errors
    /// Returns an error if naga can't parse the text, or if naga's validator rejects the shader.
    pub fn parse(wgsl: &str) -> Result<Self, TranslateError> {
        /// naga writes this directive into WGSL, but can't parse it. naga accepts subgroup operations without the
        /// directive.
        const SUBGROUPS: &str = "enable subgroups;";
        let read = wgsl.replacen(SUBGROUPS, &" ".repeat(SUBGROUPS.len()), 1);
        let module = on_deep_stack(|| naga::front::wgsl::parse_str(&read));
        Self::of(module.map_err(|error| TranslateError::Unread(error.emit_to_string(wgsl)))?)
    }

    /// Validates a naga module.
    ///
    /// # Errors
    /// Returns an error if naga's validator rejects the module.
    pub fn of(module: Module) -> Result<Self, TranslateError> {
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
        let info = on_deep_stack(|| {
            let invalid = |error: naga::WithSpan<_>| causes(error.as_inner());
            validator.validate(&module).map_err(invalid)
        });
        Ok(Self { info: info.map_err(TranslateError::Invalid)?, module })
    }

    /// Checks if a compute entry point uses `num_workgroups`. In HLSL the host passes this value in a separate buffer.
    #[must_use]
    pub fn takes_constants(&self, entry_point: &str) -> bool {
        write::hlsl::takes_constants(&self.module, entry_point)
    }

    /// Parses and validates SPIR-V.
    ///
    /// # Errors
    /// Returns an error if naga can't parse the SPIR-V, or if naga's validator rejects the shader.
    pub fn from_spirv(words: &[u32]) -> Result<Self, TranslateError> {
        // naga flipped the Y axis when it wrote the SPIR-V.
        let options = naga::front::spv::Options::default();
        let frontend = naga::front::spv::Frontend::new(words.iter().copied(), &options);
        let module = on_deep_stack(|| frontend.parse());
        Self::of(module.map_err(|error| TranslateError::Unread(causes(&error)))?)
    }

    /// The entry points, in source order.
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

    /// The shader's naga module.
    #[must_use]
    pub fn module(&self) -> &Module {
        &self.module
    }

    /// Converts the shader into its naga module.
    #[must_use]
    pub fn into_module(self) -> Module {
        self.module
    }

    /// Translates one entry point with everything that it uses, or the whole shader. A GLSL translation has only one
    /// entry point, so pass a name if the shader has several entry points.
    ///
    /// # Errors
    /// Returns an error if the shader has no such entry point, or if naga can't write the shader in this language.
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
        // naga is a compiler under test, so its crash or panic counts as a verdict.
        let written = panics::caught(|| on_deep_stack(|| write::write(self, target, entry_point)));
        match written {
            Ok(Ok(translation)) => Ok(translation),
            Ok(Err(message)) => Err(TranslateError::Unsupported { target, message }),
            Err(panicked) => Err(TranslateError::Panicked { target, message: panicked.message }),
        }
    }
}

impl Shader {
    /// Returns a [`Translation`] that contains the shader's WGSL unchanged. `text` is the WGSL from which the shader
    /// was [parsed](Self::parse). Executors that run WGSL directly use this translation.
    ///
    /// # Errors
    /// Fails if the shader has no entry point with this name.
    pub fn as_it_is(&self, text: &str, entry_point: &str) -> Result<Translation, TranslateError> {
        let one = self.entry_points().into_iter().find(|one| one.name == entry_point);
        let one = one.ok_or_else(|| TranslateError::NoEntryPoint(entry_point.to_owned()))?;
        Ok(Translation {
            target: Target::Wgsl,
            code: Code::Text(text.to_owned()),
            entry_points: vec![one],
            bindings: Bindings::default(),
            options: "the author's text, not translated".to_owned(),
            uniforms: Vec::new(),
        })
    }
}

/// Runs a function on a large stack, because naga's recursion is as deep as the nesting of a shader's statements and
/// expressions.
fn on_deep_stack<T>(work: impl FnOnce() -> T) -> T {
    /// Without optimisation, naga's recursion needs up to about 20 KB for each level.
    const STACK: usize = 256 << 20;
    stacker::grow(STACK, work)
}

/// An error's message, followed by the messages of its causes.
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
