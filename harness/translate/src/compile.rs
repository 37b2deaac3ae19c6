//! SPIR-V by compilers that aren't naga: of naga's GLSL and HLSL.

use std::io;
use std::path::Path;
use std::process::Command;

use crate::child::{self, End};
use crate::{Target, Translation, layout, tool};

/// Why there is no SPIR-V.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CompileError {
    /// There is no compiler for it on this machine.
    #[error("`{name}` compiles {target}, and isn't here: {reason} ({remedy})")]
    NoCompiler {
        /// The language.
        target: Target,
        /// The compiler.
        name: &'static str,
        /// Why it isn't used.
        reason: String,
        /// How to get it.
        remedy: &'static str,
    },
    /// No compiler is known that makes SPIR-V of it.
    #[error("no compiler is known that makes SPIR-V of {target}")]
    NoWay {
        /// The language.
        target: Target,
    },
    /// The compiler rejects it.
    #[error("`{command}` rejects naga's {target}:\n{message}")]
    Rejected {
        /// The language.
        target: Target,
        /// The command.
        command: String,
        /// The compiler's words.
        message: String,
    },
    /// The compiler crashed, or didn't end.
    #[error("`{command}` {how} on naga's {target}:\n{message}")]
    Broke {
        /// The language.
        target: Target,
        /// The command.
        command: String,
        /// `crashes`, or `doesn't end`.
        how: &'static str,
        /// What it wrote.
        message: String,
    },
    /// The compiler makes SPIR-V that isn't valid.
    #[error("`{command}` makes invalid SPIR-V of naga's {target}: {message}")]
    Invalid {
        /// The language.
        target: Target,
        /// The command.
        command: String,
        /// The words of `spirv-val`.
        message: String,
    },
    /// The compiler lays a uniform buffer out in another way than naga means it.
    #[error("`{command}` doesn't lay uniform buffers out as Direct3D does: {message}")]
    Layout {
        /// The command.
        command: String,
        /// Which member is where.
        message: String,
    },
    /// The compiler can't be run.
    #[error("`{command}` can't be run: {message}")]
    Unrunnable {
        /// The command.
        command: String,
        /// Why.
        message: String,
    },
}

/// glslang, which reads GLSL and HLSL.
const GLSLANG: &str = "glslangValidator";

/// The first word of SPIR-V.
const MAGIC: u32 = 0x0723_0203;

/// What `spirv-val` has against `out.spv`, if it is here: drivers take what compilers make on trust.
fn rejected(folder: &Path) -> io::Result<Option<String>> {
    let Ok((program, _)) = tool::program("spirv-val") else { return Ok(None) };
    let mut command = Command::new(program);
    command.args(["--target-env", "vulkan1.1", "out.spv"]).current_dir(folder);
    let ran = child::run(&mut command)?;
    Ok(Some(ran.output).filter(|_| ran.end != End::Good))
}

/// SPIR-V 1.3 for Vulkan 1.1 of a translation with one entry point, by a compiler that isn't naga.
/// Its bindings are those of the translation.
///
/// # Errors
/// If there is no compiler for its language, or the compiler rejects it, crashes or doesn't end.
pub fn compile(translation: &Translation) -> Result<Vec<u32>, CompileError> {
    let (target, text) = (translation.target, translation.code.text());
    let (Some(text), [entry_point]) = (text, &*translation.entry_points) else {
        return Err(CompileError::NoWay { target });
    };
    let stage = entry_point.stage.short();
    let file = format!("shader.{}", target.extension());
    let common = ["-V", "--target-env", "vulkan1.1", "-S", stage, "-o", "out.spv", &*file];
    let own: &[&str] = match target {
        Target::Glsl | Target::GlslEs => &[],
        // naga lays buffers out as HLSL does.
        Target::Hlsl => &["-D", "--hlsl-offsets", "-e", &entry_point.name],
        Target::Hlsl6 | Target::Msl | Target::Spirv | Target::Wgsl => {
            return Err(CompileError::NoWay { target });
        }
    };
    let arguments = [own, &common].concat();
    let command = format!("{GLSLANG} {}", arguments.join(" "));
    let (program, _) = tool::program(GLSLANG).map_err(|missing| CompileError::NoCompiler {
        target,
        name: missing.name,
        reason: missing.reason.clone(),
        remedy: missing.remedy,
    })?;
    let unrunnable = |error: io::Error| CompileError::Unrunnable {
        command: command.clone(),
        message: error.to_string(),
    };
    let folder = tempfile::tempdir().map_err(unrunnable)?;
    std::fs::write(folder.path().join(&file), text).map_err(unrunnable)?;
    let ran = child::run(Command::new(program).args(&arguments).current_dir(folder.path()))
        .map_err(unrunnable)?;
    let broke = |how| CompileError::Broke {
        target,
        command: command.clone(),
        how,
        message: ran.output.clone(),
    };
    match ran.end {
        End::Good => {}
        End::Bad => return Err(CompileError::Rejected { target, command, message: ran.output }),
        End::Crashed => return Err(broke("crashes")),
        End::TimedOut => return Err(broke("doesn't end")),
    }
    let bytes = std::fs::read(folder.path().join("out.spv")).map_err(unrunnable)?;
    let (words, rest) = bytes.as_chunks::<4>();
    if words.is_empty() || !rest.is_empty() {
        return Err(broke("writes no SPIR-V"));
    }
    let words: Vec<u32> = words.iter().map(|word| u32::from_le_bytes(*word)).collect();
    if words[0] != MAGIC {
        return Err(broke("writes no SPIR-V"));
    }
    if let Some(message) = rejected(folder.path()).map_err(unrunnable)? {
        return Err(CompileError::Invalid { target, command, message });
    }
    match layout::fault(&translation.uniforms, &words).filter(|_| target == Target::Hlsl) {
        Some(message) => Err(CompileError::Layout { command, message }),
        None => Ok(words),
    }
}
