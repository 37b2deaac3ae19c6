//! Translates WGSL into every language that naga writes, and checks the translations with other tools.
//!
//! wgpu passes each driver a translation: SPIR-V to Vulkan, GLSL to OpenGL, HLSL to Direct3D, MSL to Metal. This crate
//! makes all these translations on any machine, with wgpu's options ([`Shader::translate`]). The crate checks
//! translations with the installed validators ([`Tool::validate`]). The crate also compiles GLSL and HLSL to SPIR-V
//! ([`compile`]), so that a Vulkan driver can run a translation for OpenGL or Direct3D.
//!
//! ```
//! use karat_translate::{Shader, Target};
//!
//! let shader = Shader::parse("@compute @workgroup_size(1) fn main() {}").unwrap();
//! let hlsl = shader.translate(Target::Hlsl, None).unwrap();
//! assert!(hlsl.code.text().unwrap().contains("numthreads(1, 1, 1)"));
//! ```

mod batch;
mod bindings;
mod child;
mod compile;
mod layout;
mod shader;
mod target;
mod tool;
mod write;

pub use bindings::{Bindings, Kind, Resource, Texels};
pub use compile::{CompileError, compile, compiler};
pub use shader::{EntryPoint, Shader, Stage, TranslateError};
pub use target::{Code, Target, Translation};
pub use tool::{Missing, Tool, Validation, Verdict};

/// The version of naga that makes the translations. A test compares this version with Cargo.lock.
pub const NAGA_VERSION: &str = "30.0.1";
