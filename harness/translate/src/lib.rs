//! Every translation that naga makes of WGSL, and the tools that judge them.
//!
//! wgpu hands each driver a translation: SPIR-V to Vulkan, GLSL to OpenGL, HLSL to Direct3D, MSL to
//! Metal. This crate makes all of them on any machine, with the options that wgpu uses
//! ([`Shader::translate`]), asks the validators that are installed what they think of one
//! ([`Tool::validate`]), and compiles GLSL and HLSL to SPIR-V, so that a Vulkan driver can run what
//! another API would get ([`compile`]).
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

/// The version of naga whose translations these are; a test compares it with Cargo.lock.
pub const NAGA_VERSION: &str = "30.0.1";
