//! `karat translate`

use std::io::{IsTerminal, Write};
use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use karat::unstable::image::write_whole;
use karat::unstable::probe::Probed;
use karat::unstable::reflect::Program;
use karat_translate::{Code, Shader, Target, Tool, Translation, Validation, Verdict};

use super::project::Project;
use super::table::{BAD, DIM, GOOD};
use super::{Ending, Outcome, PackageArgs, spare_shaders};

#[derive(clap::Args)]
pub(super) struct Args {
    /// The function, `module::name`, for which Karat writes a small entry point; or a module with entry points of its
    /// own
    what: String,
    /// Translates into this language
    #[arg(long, value_name = "LANGUAGE", value_parser = language())]
    to: String,
    /// Translates only this entry point of the module [default: all, but a GLSL file can have only one]
    #[arg(long, value_name = "NAME")]
    entry_point: Option<String>,
    /// Writes the translation to this file [default: standard output]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Validates the translation with the installed validators, which `karat doctor` lists
    #[arg(long)]
    validate: bool,
    #[command(flatten)]
    package: PackageArgs,
}

fn language() -> clap::builder::PossibleValuesParser {
    Target::ALL.map(Target::name).into()
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let target: Target = args.to.parse().map_err(anyhow::Error::msg)?;
    let packages = Project::find()?.packages(&args.package)?;
    if let Some(file) = &args.out {
        spare_shaders("translation", file, &packages)?;
    }
    let (text, own) = source(args)?;
    let shader = Shader::parse(&text)?;
    let wanted: Vec<Option<String>> = match own.or_else(|| args.entry_point.clone()) {
        Some(name) => vec![Some(name)],
        None if target.is_of_one_entry_point() => {
            shader.entry_points().into_iter().map(|e| Some(e.name)).collect()
        }
        None => vec![None],
    };
    ensure!(
        !shader.entry_points().is_empty(),
        "module `{}` has no entry point that Karat could translate: name a function of the module, \
         such as `{0}::f`",
        args.what
    );
    let translations = wanted.iter().map(|name| shader.translate(target, name.as_deref()));
    let translations = translations.collect::<Result<Vec<_>, _>>()?;
    match &args.out {
        Some(file) => {
            let [translation] = &*translations else {
                bail!(
                    "a file of {target} has only one entry point, but `{}` has {}: name an entry point with \
                     --entry-point",
                    args.what,
                    translations.len()
                );
            };
            write_whole(file, &translation.code.bytes())
                .with_context(|| format!("can't write `{}`", file.display()))?;
        }
        None => {
            for translation in &translations {
                print(translation, out)?;
            }
        }
    }
    if args.validate {
        return validate(&translations, out);
    }
    Ok(Ending::Good)
}

/// Returns the text of the shader. For a function, also returns the name of the entry point that calls it.
fn source(args: &Args) -> anyhow::Result<(String, Option<String>)> {
    let project = Project::find()?;
    for package in project.packages(&args.package)? {
        let modules = package.modules()?;
        // In a package of one file, the module has no name.
        let alone = (package.name() == args.what).then(String::new);
        let module = Some(&args.what).or(alone.as_ref()).filter(|m| modules.contains(m));
        let module = module.or(alone.as_ref().filter(|m| modules.contains(m)));
        if let Some(module) = module {
            let program = Program::of_module(&package, module)?;
            return Ok((program.text().to_owned(), None));
        }
    }
    let package = project.package_of(&args.package, &args.what)?;
    let probed = Probed::new(&package, &args.what)?;
    ensure!(
        args.entry_point.is_none(),
        "`{}` is a function, and Karat writes its entry point: remove --entry-point",
        args.what
    );
    Ok((probed.kernel().to_owned(), Some(Probed::ENTRY_POINT.to_owned())))
}

fn print(translation: &Translation, out: &mut dyn Write) -> anyhow::Result<()> {
    match &translation.code {
        Code::Text(text) => {
            let names: Vec<&str> =
                translation.entry_points.iter().map(|e| e.name.as_str()).collect();
            writeln!(out, "// {}; {}", translation.options, names.join(", "))?;
            writeln!(out, "{}", text.trim_end())?;
        }
        Code::Words(words) if std::io::stdout().is_terminal() => {
            bail!(
                "a terminal can't show SPIR-V, which is binary ({} words): name a file with --out, or pipe the \
                 output into a program such as `spirv-dis`",
                words.len()
            );
        }
        // `out` is for text, so SPIR-V doesn't go through it.
        Code::Words(_) => {
            let mut stdout = std::io::stdout().lock();
            let written = stdout.write_all(&translation.code.bytes()).and_then(|()| stdout.flush());
            match written {
                Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => {}
                written => written.context("can't write the output")?,
            }
        }
    }
    Ok(())
}

fn validate(translations: &[Translation], out: &mut dyn Write) -> Outcome {
    let mut ending = Ending::Good;
    let mut asked = 0;
    for translation in translations {
        for tool in Tool::of(translation.target) {
            let said = tool.validate(translation).with_context(|| tool.name().to_owned())?;
            asked += 1;
            if said.verdict != Verdict::Valid {
                ending = Ending::Bad;
            }
            writeln!(out, "{}", line(&said))?;
        }
    }
    ensure!(asked > 0, "no validator of this target is installed: `karat doctor` lists validators");
    Ok(ending)
}

fn line(said: &Validation) -> String {
    let (style, text) = match &said.verdict {
        Verdict::Valid => (GOOD, "valid".to_owned()),
        Verdict::Invalid(message) => (BAD, format!("invalid\n{message}")),
        Verdict::Unable(what) => (BAD, format!("no verdict, because {what}")),
        Verdict::Broke(how) => (BAD, format!("no verdict, because the validator {how}")),
    };
    let Validation { version, command, .. } = said;
    let version = if version.is_empty() { String::new() } else { format!(" ({version})") };
    format!("// {DIM}{command}{version}:{DIM:#} {style}{text}{style:#}")
}
