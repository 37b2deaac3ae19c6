//! Validators: other programs that check a translation.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::child::{self, End, Ran};
use crate::{Code, EntryPoint, Shader, Target, Translation, compile};

/// A tool's verdict on a translation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The tool accepts the translation.
    Valid,
    /// The tool rejects the translation with this message.
    Invalid(String),
    /// No verdict: the tool doesn't support a feature of the language. The text names the feature, and contains the
    /// tool's output.
    Unable(String),
    /// No verdict: the tool crashed, took too long, or wrote too much. The text names the problem, and contains the
    /// tool's output.
    Broke(String),
}

/// A tool's verdict, with the data to repeat the check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Validation {
    /// The tool's name.
    pub tool: &'static str,
    /// The tool's version, as the tool prints it.
    pub version: String,
    /// The command line, in which the file `shader.*` is the translation.
    pub command: String,
    /// The verdict.
    pub verdict: Verdict,
}

/// A validator on this machine.
#[derive(Clone, Debug)]
pub struct Tool {
    known: &'static Known,
    /// The program; `None` for naga, which is a part of Karat.
    program: Option<PathBuf>,
    version: String,
}

#[derive(Debug)]
struct Known {
    name: &'static str,
    targets: &'static [Target],
    /// The arguments that make the program print its version or its help. The printed text must contain `says`. Other
    /// programs with the same name don't print this text.
    asked: &'static [&'static str],
    says: &'static str,
    remedy: &'static str,
    /// The languages for which one process of the tool checks several files, and prints the name of each file.
    several: &'static [Target],
    /// The arguments for a check. The last argument is the file.
    arguments: fn(Target, &EntryPoint, file: &str) -> Vec<String>,
}

const NAGA: &str = "naga";

static BUILT_IN: Known = Known {
    name: NAGA,
    targets: &[Target::Wgsl],
    asked: &[],
    says: "",
    remedy: "naga is a part of karat",
    several: &[],
    arguments: |_, _, _| Vec::new(),
};

static KNOWN: [Known; 6] = [
    Known {
        name: "spirv-val",
        targets: &[Target::Spirv],
        asked: &["--version"],
        says: "SPIRV-Tools",
        remedy: "install the package spirv-tools (Debian, Fedora, Homebrew) or Vulkan's SDK",
        several: &[],
        arguments: |_, _, file| words(&["--target-env", "vulkan1.1", file]),
    },
    Known {
        name: "spirv-cross",
        targets: &[Target::Spirv],
        asked: &["--help"],
        says: "SPIRV-Cross",
        remedy: "install the package spirv-cross (Debian, Homebrew) or Vulkan's SDK",
        several: &[],
        arguments: |_, entry_point, file| {
            let (stage, name) = (entry_point.stage.short(), &*entry_point.name);
            words(&["--vulkan-semantics", "--entry", name, "--stage", stage, file])
        },
    },
    Known {
        name: "glslangValidator",
        targets: &[Target::Glsl, Target::GlslEs, Target::Hlsl],
        asked: &["--version"],
        says: "Glslang Version",
        remedy: "install the package glslang-tools (Debian), glslang (Fedora, Homebrew), or Vulkan's SDK",
        several: &[Target::Glsl, Target::GlslEs],
        arguments: |target, entry_point, file| {
            let stage = entry_point.stage.short();
            match target {
                Target::Hlsl => compile::arguments(target, entry_point, file).unwrap_or_default(),
                _ => words(&["-S", stage, file]),
            }
        },
    },
    Known {
        name: "dxc",
        targets: &[Target::Hlsl, Target::Hlsl6],
        asked: &["--version"],
        says: "dxcompiler",
        remedy: "install a release of microsoft/DirectXShaderCompiler from GitHub, or Vulkan's SDK",
        several: &[],
        arguments: |target, entry_point, file| {
            let stage = compile::profile(entry_point);
            let mut arguments = words(&["-E", &entry_point.name, "-Fo", "out.dxil"]);
            match target {
                Target::Hlsl6 => {
                    arguments.extend(words(&[
                        "-T",
                        &format!("{stage}_6_2"),
                        "-enable-16bit-types",
                    ]));
                }
                _ => arguments.extend(words(&["-T", &format!("{stage}_6_0")])),
            }
            arguments.push(file.to_owned());
            arguments
        },
    },
    Known {
        // Debian has another program with this name, a desktop panel.
        name: "tint",
        targets: &[Target::Wgsl],
        asked: &["--help"],
        says: "--format",
        remedy: "build Tint from Dawn's sources: dawn.googlesource.com",
        several: &[],
        arguments: |_, _, file| words(&["--format", "wgsl", "-o", "out.wgsl", file]),
    },
    Known {
        name: "xcrun",
        targets: &[Target::Msl],
        asked: &["metal", "--version"],
        says: "metal",
        remedy: "install Xcode, which exists only for macOS",
        several: &[],
        arguments: |_, _, file| {
            words(&["-sdk", "macosx", "metal", "-std=macos-metal2.4", "-o", "out.air", "-c", file])
        },
    },
];

fn words(words: &[&str]) -> Vec<String> {
    words.iter().map(|word| (*word).to_owned()).collect()
}

/// A tool that isn't installed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// The tool's name.
    pub name: &'static str,
    /// The languages that the tool checks.
    pub targets: &'static [Target],
    /// The reason: the program isn't in `PATH`, doesn't run, or is another program with the same name.
    pub reason: String,
    /// Instructions to install the tool.
    pub remedy: &'static str,
}

impl Tool {
    /// All supported tools: a [`Tool`] if the tool is installed, and otherwise a [`Missing`]. Each process of Karat
    /// searches for the tools once, in `PATH` and in `VULKAN_SDK`.
    pub fn all() -> &'static [Result<Self, Missing>] {
        static ALL: OnceLock<Vec<Result<Tool, Missing>>> = OnceLock::new();
        ALL.get_or_init(|| {
            let version = format!("{} of this karat", crate::NAGA_VERSION);
            let own = Self { known: &BUILT_IN, program: None, version };
            let others = KNOWN.iter().map(|known| known.find(&folders()));
            std::iter::once(Ok(own)).chain(others).collect()
        })
    }

    /// The installed tools that check a language.
    ///
    /// naga is one of the tools for WGSL. naga isn't one of the tools for SPIR-V, because it rejects much valid SPIR-V.
    /// To check SPIR-V with naga, call [`naga`](Self::naga).
    pub fn of(target: Target) -> impl Iterator<Item = &'static Self> {
        let here = Self::all().iter().filter_map(|tool| tool.as_ref().ok());
        here.filter(move |tool| tool.targets().contains(&target))
    }

    /// naga as a validator. naga can read the WGSL and the SPIR-V that it writes.
    #[must_use]
    pub fn naga() -> &'static Self {
        let first = Self::all().first().and_then(|tool| tool.as_ref().ok());
        first.expect("naga is a part of this program")
    }

    /// The tool's name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.known.name
    }

    /// The tool's version, as the tool prints it.
    #[must_use]
    pub fn version(&self) -> &str {
        &self.version
    }

    /// The languages that the tool checks.
    #[must_use]
    pub fn targets(&self) -> &'static [Target] {
        self.known.targets
    }

    /// Checks the entry points of a translation, and stops at the first rejected entry point.
    ///
    /// # Errors
    /// Returns an error if the tool's program doesn't start, or if Karat can't write the file for the program.
    pub fn validate(&self, translation: &Translation) -> io::Result<Validation> {
        let Some(program) = &self.program else { return Ok(self.read_back(translation)) };
        if let Some(arguments) = self.compiles(translation) {
            let compiled = compile::run(program, &arguments, translation)?;
            let verdict = match compiled.writes_nothing() {
                true => Verdict::Broke("reports success, but writes no SPIR-V".to_owned()),
                false => self.verdict(translation.target, compiled.ran.clone()),
            };
            return Ok(self.says(format!("{} {}", self.name(), arguments.join(" ")), verdict));
        }
        let folder = tempfile::tempdir()?;
        let file = file_of(translation.target);
        std::fs::write(folder.path().join(&file), translation.code.bytes())?;
        let mut said = self.says(String::new(), Verdict::Valid);
        for entry_point in &translation.entry_points {
            let arguments = (self.known.arguments)(translation.target, entry_point, &file);
            let mut command = Command::new(program);
            let ran = child::run(command.args(&arguments).current_dir(folder.path()))?;
            let verdict = self.verdict(translation.target, ran);
            let rejects = verdict != Verdict::Valid;
            said = self.says(format!("{} {}", self.name(), arguments.join(" ")), verdict);
            if rejects {
                break;
            }
        }
        if said.command.is_empty() {
            return Err(io::Error::other("the translation has no entry point to check"));
        }
        Ok(said)
    }

    pub(crate) fn program(&self) -> Option<&Path> {
        self.program.as_deref()
    }

    /// The tool's arguments for a translation with one entry point.
    pub(crate) fn arguments(&self, translation: &Translation) -> Option<Vec<String>> {
        let [entry_point] = &*translation.entry_points else { return None };
        let target = translation.target;
        Some((self.known.arguments)(target, entry_point, &file_of(target)))
    }

    /// The arguments that compile a translation; `None` if the tool checks this language without compiling.
    fn compiles(&self, translation: &Translation) -> Option<Vec<String>> {
        let own = self.name() == compile::GLSLANG && translation.target == Target::Hlsl;
        own.then(|| self.arguments(translation)).flatten()
    }

    /// Checks if one process of the tool can check several files of a language.
    pub(crate) fn judges_files(&self, target: Target) -> bool {
        self.known.several.contains(&target)
    }

    pub(crate) fn says(&self, command: String, verdict: Verdict) -> Validation {
        Validation { tool: self.name(), version: self.version.clone(), command, verdict }
    }

    /// Reads naga's own translation with naga.
    fn read_back(&self, translation: &Translation) -> Validation {
        let read = karat_core::panics::caught(|| match &translation.code {
            Code::Text(text) => Shader::parse(text).map_err(|error| error.to_string()),
            Code::Words(words) => Shader::from_spirv(words).map_err(|error| error.to_string()),
        });
        let verdict = match read {
            Ok(Ok(_)) => Verdict::Valid,
            Ok(Err(message)) => Verdict::Invalid(message),
            Err(panicked) => Verdict::Broke(format!("panics: {}", panicked.message)),
        };
        let file = format!("naga shader.{}", translation.target.extension());
        self.says(file, verdict)
    }
}

impl Tool {
    fn verdict(&self, target: Target, ran: Ran) -> Verdict {
        match (ran.broke(), ran.end) {
            (Some(how), _) => Verdict::Broke(format!("{how}\n{}", ran.output).trim().to_owned()),
            (None, End::Good) => Verdict::Valid,
            (None, _) => match self.lacks(target, &ran.output) {
                Some(what) => Verdict::Unable(format!("{what}:\n{}", ran.output)),
                None => Verdict::Invalid(ran.output),
            },
        }
    }

    /// The feature of the language that the tool doesn't support, if the tool's first error is about that feature. Only
    /// the first error counts, because it may cause the later errors.
    fn lacks(&self, target: Target, output: &str) -> Option<&'static str> {
        /// glslang's error messages (as of 11.12) about HLSL that DXC and FXC accept, and the reasons that Karat
        /// reports.
        const OF_HLSL: [(&str, &str); 2] = [
            (
                "array constructor needs one argument per array element",
                "glslang doesn't support the zero value of an array, `(uint[64])0`",
            ),
            // WGSL has no recursion, so naga's output has none.
            (
                "Recursion detected",
                "glslang reports recursion by mistake, because the initialiser of a constant calls a function",
            ),
        ];
        let asked = self.name() == compile::GLSLANG && target == Target::Hlsl;
        let first = output.lines().find(|line| line.starts_with("ERROR")).filter(|_| asked)?;
        let mut all = OF_HLSL.iter();
        all.find(|(message, _)| first.contains(message)).map(|(_, what)| *what)
    }
}

fn file_of(target: Target) -> String {
    format!("shader.{}", target.extension())
}

impl Known {
    fn find(&'static self, folders: &[PathBuf]) -> Result<Tool, Missing> {
        let missing = |reason: String| Missing {
            name: self.name,
            targets: self.targets,
            reason,
            remedy: self.remedy,
        };
        let mut other = None;
        for program in folders.iter().map(|folder| folder.join(program_name(self.name))) {
            if !program.is_file() {
                continue;
            }
            let ran = child::run(Command::new(&program).args(self.asked));
            let broke = match &ran {
                Ok(ran) => ran.broke(),
                Err(error) => Some(format!("can't be run: {error}")),
            };
            if let Some(how) = broke {
                other = Some(format!("`{}` {how}", program.display()));
                continue;
            }
            let said = ran.map(|ran| ran.output).unwrap_or_default();
            if said.contains(self.says) {
                let line = said.lines().find(|line| line.contains(self.says)).unwrap_or_default();
                let version =
                    if self.asked == ["--help"] { "it prints no version" } else { line.trim() };
                let version = version.to_owned();
                return Ok(Tool { known: self, program: Some(program), version });
            }
            other = Some(format!("`{}` has this name, but is another program", program.display()));
        }
        Err(missing(other.unwrap_or_else(|| "the program isn't in PATH".to_owned())))
    }
}

/// The path and the version of an installed compiler, for [`compile`](crate::compile()).
pub(crate) fn program(name: &str) -> Result<(&'static Path, &'static str), &'static Missing> {
    let of_name = Tool::all().iter().find(|tool| match tool {
        Ok(tool) => tool.name() == name,
        Err(missing) => missing.name == name,
    });
    match of_name.expect("the tool is known") {
        Ok(tool) => Ok((tool.program.as_deref().unwrap_or(Path::new("")), &tool.version)),
        Err(missing) => Err(missing),
    }
}

fn folders() -> Vec<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let sdk = std::env::var_os("VULKAN_SDK").filter(|sdk: &OsString| !sdk.is_empty());
    let sdk = sdk.into_iter().flat_map(|sdk| ["bin", "Bin"].map(|bin| Path::new(&sdk).join(bin)));
    std::env::split_paths(&path).chain(sdk).filter(|folder| folder.is_absolute()).collect()
}

fn program_name(name: &str) -> String {
    format!("{name}{}", std::env::consts::EXE_SUFFIX)
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    /// Debian's `tint` is a desktop panel, so Karat checks what a program prints about itself.
    // Lesson 83
    #[test]
    fn a_program_of_the_same_name_is_not_the_tool() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let program = |name: &str, says: &str| {
            let file = folder.path().join(name);
            std::fs::write(&file, format!("#!/bin/sh\necho '{says}'\n"))
                .expect("the script is written");
            let all = std::fs::Permissions::from_mode(0o755);
            std::fs::set_permissions(&file, all).expect("the script is executable");
        };
        program("tint", "tint: a lightweight panel");
        program("spirv-val", "SPIRV-Tools v2099.1 unknown hash");
        let known = |name: &str| KNOWN.iter().find(|known| known.name == name).expect(name);
        let folders = [folder.path().to_owned()];
        let error = known("tint").find(&folders).expect_err("this `tint` is another program");
        assert!(error.reason.contains("has this name, but is another program"), "{}", error.reason);
        program("dxc", "'; kill -SEGV $$; echo '");
        let error = known("dxc").find(&folders).expect_err("this `dxc` crashes");
        assert!(error.reason.contains("crashes (signal: 11"), "{}", error.reason);
        let found = known("spirv-val").find(&folders).expect("this `spirv-val` is accepted");
        assert_eq!(found.version, "SPIRV-Tools v2099.1 unknown hash");
        let error = known("xcrun").find(&folders).expect_err("no `xcrun` is in the folder");
        assert_eq!(error.reason, "the program isn't in PATH");
    }
}
