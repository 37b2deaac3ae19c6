//! Compiles naga's GLSL and HLSL to SPIR-V, with glslang and DXC.

use std::collections::VecDeque;
use std::io;
use std::path::Path;
use std::process::Command;
use std::sync::{Arc, Mutex, PoisonError};

use crate::child::{self, End, Ran};
use crate::{Code, EntryPoint, Stage, Target, Translation, layout, tool};

/// The reason why [`compile`] returns no SPIR-V.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CompileError {
    /// This machine has no compiler for the language.
    #[error(
        "Karat needs `{name}` to compile {target}, but can't use this compiler: {reason} ({remedy})"
    )]
    NoCompiler {
        /// The language.
        target: Target,
        /// The compiler.
        name: &'static str,
        /// The reason: the compiler isn't in `PATH`, or doesn't run.
        reason: String,
        /// Instructions to install the compiler.
        remedy: &'static str,
    },
    /// Karat knows no compiler from this language to SPIR-V.
    #[error("Karat knows no compiler from {target} to SPIR-V")]
    NoWay {
        /// The language.
        target: Target,
    },
    /// The compiler rejects the translation.
    #[error("`{command}` rejects naga's {target}:\n{message}")]
    Rejected {
        /// The language.
        target: Target,
        /// The compiler's command line.
        command: String,
        /// The compiler's message.
        message: String,
    },
    /// The compiler crashed, took too long, or wrote no SPIR-V.
    #[error("`{command}` {how} on naga's {target}:\n{message}")]
    Broke {
        /// The language.
        target: Target,
        /// The compiler's command line.
        command: String,
        /// The failure: `crashes (signal: 11)`.
        how: String,
        /// The compiler's output.
        message: String,
    },
    /// The compiler's SPIR-V is invalid.
    #[error("`{command}` compiles naga's {target} to invalid SPIR-V: {message}")]
    Invalid {
        /// The language.
        target: Target,
        /// The compiler's command line.
        command: String,
        /// The message of `spirv-val`.
        message: String,
    },
    /// The compiler and naga lay out a uniform buffer differently.
    #[error("`{command}` doesn't lay uniform buffers out as Direct3D does: {message}")]
    Layout {
        /// The compiler's command line.
        command: String,
        /// The members with different offsets.
        message: String,
    },
    /// The compiler didn't start.
    #[error("`{command}` can't be run: {message}")]
    Unrunnable {
        /// The compiler's command line.
        command: String,
        /// The reason.
        message: String,
    },
}

/// The name of glslang's program, which compiles GLSL and HLSL.
pub(crate) const GLSLANG: &str = "glslangValidator";

/// The name of Microsoft's HLSL compiler.
const DXC: &str = "dxc";

/// The program that compiles a language to SPIR-V; `None` if Karat knows none.
#[must_use]
pub fn compiler(target: Target) -> Option<&'static str> {
    match target {
        Target::Glsl | Target::GlslEs | Target::Hlsl => Some(GLSLANG),
        Target::Hlsl6 => Some(DXC),
        Target::Msl | Target::Spirv | Target::Wgsl => None,
    }
}

/// The compiler's arguments; `None` if Karat knows no compiler for the language.
pub(crate) fn arguments(target: Target, one: &EntryPoint, file: &str) -> Option<Vec<String>> {
    let own: &[&str] = match target {
        Target::Glsl | Target::GlslEs => &[],
        // `--hlsl-offsets` selects HLSL's layout of buffers, on which naga's HLSL relies.
        Target::Hlsl => &["-D", "--hlsl-offsets", "-e", &one.name],
        Target::Hlsl6 => return Some(of_dxc(one, file)),
        Target::Msl | Target::Spirv | Target::Wgsl => return None,
    };
    let stage = one.stage.short();
    let common = ["-V", "--target-env", "vulkan1.1", "-S", stage, "-o", OUTPUT, file];
    Some(own.iter().chain(&common).map(|argument| (*argument).to_owned()).collect())
}

/// The arguments of DXC. DXC lays out buffers as Direct3D does. DXC's own validator checks only DXIL, not SPIR-V.
fn of_dxc(one: &EntryPoint, file: &str) -> Vec<String> {
    let profile = format!("{}_6_2", profile(one));
    let words = [
        "-spirv",
        "-fspv-target-env=vulkan1.1",
        "-fvk-use-dx-layout",
        "-Vd",
        "-enable-16bit-types",
        "-T",
        &profile,
        "-E",
        &one.name,
        "-Fo",
        OUTPUT,
        file,
    ];
    words.map(str::to_owned).to_vec()
}

pub(crate) fn profile(one: &EntryPoint) -> &'static str {
    match one.stage {
        Stage::Vertex => "vs",
        Stage::Fragment => "ps",
        Stage::Compute | Stage::Other => "cs",
    }
}

const OUTPUT: &str = "out.spv";

#[derive(Debug)]
pub(crate) struct Compiled {
    pub(crate) ran: Ran,
    /// The SPIR-V that the compiler wrote; `None` if the compiler failed or wrote no SPIR-V.
    words: Option<Vec<u32>>,
}

impl Compiled {
    /// Checks if the compiler reports success although it wrote no SPIR-V.
    pub(crate) fn writes_nothing(&self) -> bool {
        self.ran.end == End::Good && self.words.is_none()
    }
}

/// Runs a compiler on a translation. Karat runs the same command twice on HLSL: first to check the HLSL, and later to
/// compile it. So this function keeps its last results.
pub(crate) fn run(
    program: &Path,
    arguments: &[String],
    translation: &Translation,
) -> io::Result<Arc<Compiled>> {
    type Known = (Vec<String>, String, Arc<Compiled>);
    /// The number of results that this function keeps. Karat checks at most 128 shaders together before it runs them.
    const KEPT: usize = 128;
    static LAST: Mutex<VecDeque<Known>> = Mutex::new(VecDeque::new());
    let text = translation.code.text().expect("compilers read text");
    let last = || LAST.lock().unwrap_or_else(PoisonError::into_inner);
    let same = |(made_by, of, _): &&Known| made_by == arguments && of == text;
    if let Some((.., compiled)) = last().iter().find(same) {
        return Ok(Arc::clone(compiled));
    }
    let folder = tempfile::tempdir()?;
    let file = arguments.last().expect("the file is the last argument");
    std::fs::write(folder.path().join(file), text)?;
    let ran = child::run(Command::new(program).args(arguments).current_dir(folder.path()))?;
    // A compiler writes no file for source text that it rejects. A compiler may also fail to write a file for text that
    // it accepts.
    let written = match std::fs::read(folder.path().join(OUTPUT)) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        read => Some(read?),
    };
    let words = written.and_then(|bytes| spirv(&bytes)).filter(|_| ran.end == End::Good);
    let compiled = Arc::new(Compiled { ran, words });
    let mut last = last();
    last.push_front((arguments.to_vec(), text.to_owned(), Arc::clone(&compiled)));
    last.truncate(KEPT);
    Ok(compiled)
}

fn spirv(bytes: &[u8]) -> Option<Vec<u32>> {
    let (words, rest) = bytes.as_chunks::<4>();
    let words: Vec<u32> = words.iter().map(|word| u32::from_le_bytes(*word)).collect();
    (words.first() == Some(&MAGIC) && rest.is_empty()).then_some(words)
}

/// The magic number at the start of SPIR-V.
const MAGIC: u32 = 0x0723_0203;

/// The error that `spirv-val` finds in SPIR-V; `None` if the SPIR-V is valid, or if `spirv-val` isn't installed. Karat
/// runs `spirv-val` because drivers don't check SPIR-V.
fn rejected(words: &[u32]) -> io::Result<Option<String>> {
    let Ok((program, _)) = tool::program("spirv-val") else { return Ok(None) };
    let folder = tempfile::tempdir()?;
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    std::fs::write(folder.path().join(OUTPUT), bytes)?;
    let mut command = Command::new(program);
    command.args(["--target-env", "vulkan1.1", OUTPUT]).current_dir(folder.path());
    let ran = child::run(&mut command)?;
    Ok(match (ran.broke(), ran.end) {
        (Some(how), _) => Some(format!("`spirv-val` {how}\n{}", ran.output)),
        (None, End::Good) => None,
        (None, _) => Some(ran.output),
    })
}

/// Checks if glslang's SPIR-V computes the length of a buffer in 32-bit words instead of bytes. HLSL's
/// `ByteAddressBuffer.GetDimensions` returns bytes, so correct SPIR-V multiplies the length by 4.
fn counts_words(words: &[u32]) -> bool {
    // The instructions' numbers in the SPIR-V specification.
    const OP_ARRAY_LENGTH: u32 = 68;
    const OP_I_MUL: u32 = 132;
    const OP_SHIFT_LEFT_LOGICAL: u32 = 196;
    let all = || layout::instructions(words);
    let lengths = all().filter_map(|(operation, instruction)| match instruction {
        [_, _, length, ..] if operation == OP_ARRAY_LENGTH => Some(*length),
        _ => None,
    });
    let multiplied = |length: u32| {
        all().any(|(operation, instruction)| {
            matches!(operation, OP_I_MUL | OP_SHIFT_LEFT_LOGICAL)
                && instruction.iter().skip(3).any(|operand| *operand == length)
        })
    };
    lengths.into_iter().any(|length| !multiplied(length))
}

/// naga's HLSL, changed for a compiler that [counts words](counts_words): the HLSL multiplies the length of a buffer by
/// 4.
fn with_bytes(translation: &Translation) -> Translation {
    const ASKED: &str = "buffer.GetDimensions(ret);";
    let text = translation.code.text().expect("compilers read text");
    let code = Code::Text(text.replace(ASKED, &format!("{ASKED} ret *= 4;")));
    Translation { code, ..translation.clone() }
}

/// Compiles a translation with one entry point to SPIR-V 1.3 for Vulkan 1.1. [`compiler`] gives the compiler's name.
/// The SPIR-V has the same bindings as the translation.
///
/// # Errors
/// Returns an error if Karat knows no compiler for the language, or if the compiler rejects the translation, crashes or
/// takes too long.
pub fn compile(translation: &Translation) -> Result<Vec<u32>, CompileError> {
    let target = translation.target;
    let [entry_point] = &*translation.entry_points else {
        return Err(CompileError::NoWay { target });
    };
    let file = format!("shader.{}", target.extension());
    let arguments = arguments(target, entry_point, &file).ok_or(CompileError::NoWay { target })?;
    let compiler = compiler(target).ok_or(CompileError::NoWay { target })?;
    let command = format!("{compiler} {}", arguments.join(" "));
    let (program, _) = tool::program(compiler).map_err(|missing| CompileError::NoCompiler {
        target,
        name: missing.name,
        reason: missing.reason.clone(),
        remedy: missing.remedy,
    })?;
    let unrunnable = |error: io::Error| CompileError::Unrunnable {
        command: command.clone(),
        message: error.to_string(),
    };
    let compiled = run(program, &arguments, translation).map_err(unrunnable)?;
    let compiled =
        match target == Target::Hlsl && compiled.words.as_deref().is_some_and(counts_words) {
            true => run(program, &arguments, &with_bytes(translation)).map_err(unrunnable)?,
            false => compiled,
        };
    let message = || compiled.ran.output.clone();
    let broke = |how: String| {
        let command = command.clone();
        CompileError::Broke { target, command, how, message: message() }
    };
    match (compiled.ran.broke(), compiled.ran.end) {
        (Some(how), _) => return Err(broke(how)),
        (None, End::Good) => {}
        (None, _) => return Err(CompileError::Rejected { target, command, message: message() }),
    }
    let words = compiled.words.clone().ok_or_else(|| broke("writes no SPIR-V".to_owned()))?;
    if let Some(message) = rejected(&words).map_err(unrunnable)? {
        return Err(CompileError::Invalid { target, command, message });
    }
    let is_hlsl = matches!(target, Target::Hlsl | Target::Hlsl6);
    match layout::fault(&translation.uniforms, &words).filter(|_| is_hlsl) {
        Some(message) => Err(CompileError::Layout { command, message }),
        None => Ok(words),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// If SPIR-V multiplies a buffer's length by 4, the result is the length in bytes. A later version of glslang
    /// could write such SPIR-V.
    // Lesson 159
    #[test]
    fn lengths_in_words_differ_from_lengths_in_bytes() {
        let head = [MAGIC, 0x0001_0300, 0, 20, 0];
        let length = [5 << 16 | 68, 1, 7, 2, 0];
        let load = [4 << 16 | 61, 1, 8, 7];
        let (multiplied, shifted) = ([5 << 16 | 132, 1, 8, 7, 9], [5 << 16 | 196, 1, 8, 7, 9]);
        let module = |instructions: &[&[u32]]| [&head[..], &instructions.concat()].concat();
        assert!(counts_words(&module(&[&length, &load])));
        assert!(!counts_words(&module(&[&length, &multiplied])));
        assert!(!counts_words(&module(&[&length, &shifted])));
        assert!(!counts_words(&module(&[&load])), "the module has no `OpArrayLength`");
    }
}
