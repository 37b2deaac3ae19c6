//! `karat`: the commands and their exit codes.
//!
//! Exit codes: 0 when all is well; 1 when a check fails, a frame differs, a golden is unreferenced, an acceptance is
//! refused or a path is missing; 2 when the command couldn't do its work or write its output; 3 when its input is
//! missing: an image, a golden, a pending frame, the record of a full run. If the program that reads the output ends
//! early, the exit code stays the same.

mod artefact;
mod browser;
mod call;
mod check;
mod child;
mod compare;
mod coverage;
mod diff;
mod doctor;
mod git;
mod goldens;
mod hazards;
mod heatmap;
mod init;
mod list;
mod loader;
mod lsp;
mod manual;
mod matching;
mod matrix;
mod mutate;
mod patience;
mod preview;
mod project;
mod record;
mod render;
mod replay;
mod report;
mod review;
mod search;
mod show;
mod suite;
mod table;
mod tap;
mod terminal;
mod test;
mod trace;
mod translate;
mod unreferenced;
mod watch;

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use clap::{CommandFactory, Parser, Subcommand};
use karat::image::ImageError;
use karat::package::Feature;
use karat::unstable::golden::AcceptError;
use karat::unstable::output::{Output, tell, trusted, visible, visible_json};

type Outcome = anyhow::Result<Ending>;

/// The result of a command that ran without an error. The result determines the exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ending {
    Good,
    Bad,
    /// A file that the command needs doesn't exist, such as its input, a golden or a record.
    Missing,
}

impl From<Ending> for ExitCode {
    fn from(verdict: Ending) -> Self {
        Self::from(match verdict {
            Ending::Good => 0,
            Ending::Bad => 1,
            Ending::Missing => 3,
        })
    }
}

/// The error of a command that has already printed the cause, so that Karat prints no further message.
#[derive(Debug, thiserror::Error)]
#[error("see above")]
struct Reported;

/// The error of a command whose input is missing.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct NotThere(String);

#[derive(Parser)]
#[command(
    name = "karat",
    version,
    about = "Tests WGSL shaders: functions against references, frames against goldens.",
    after_help = "Start with `karat init`, then `karat watch`; `karat doctor` lists the drivers that open.\n\
                  Environment: KARAT_PATHS (vulkan, gl, all), KARAT_REQUIRE (paths that must run), \
                  KARAT_ADAPTER (part of an adapter's name),\nKARAT_TIMEOUT (seconds that a shader may take), KARAT_FUEL (the largest number of loop iterations on `cpu`), KARAT_SEED and \
                  KARAT_CASE (for a replay),\nKARAT_OVERLAY (a folder of files that replace \
                  modules), NO_COLOR.\n\
                  Exit codes: 0 success; 1 a check failed, a frame differs, an acceptance is refused; \
                  2 the command couldn't do its work;\n3 an input is missing (an image, a golden, a record). \
                  If the program that reads the output (such as `head`) ends early, the exit code doesn't change."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Runs the tests, and prints a row for each function and path with its cases and its worst error
    #[command(after_help = "Examples:\n  karat test\n  karat test schlick --paths all\n  \
                            karat test --failed                runs the tests that failed in the last run\n  \
                            karat test shaders                 runs tests that aren't in Rust: @test, *.test.toml\n  \
                            karat test -p tests --require vulkan,gl\n  \
                            karat test --junit target/karat/junit.xml\n  \
                            karat test --short                 prints file:line:column: error: message, for editors\n\
                            The command fails if a test fails or no check ran. On GitHub (or with \
                            --github), the command annotates\nthe lines of failures, and writes a summary.")]
    Test(test::Args),
    /// Watches files, and runs the tests that an edit affects
    #[command(after_help = "Examples:\n  karat watch\n  karat watch my/shaders\n  \
                            karat watch shaders fresnel --paths cpu\n\
                            `karat watch` runs tests without Rust (functions with `@test`, `*.test.toml`), and in a Cargo project \
                            also the Rust tests.\nAn edit of a shader runs the tests that depend on the edited code; an edit of \
                            comments runs no test. Only an edit of Rust code starts a build.\nIf the output isn't a terminal, the command prints lines, and doesn't redraw the screen.\n\
                            Keys: r runs all tests, f filters tests by name, n shows the next failure, arrow and page keys scroll, a accepts frames,\no opens the report, q quits.")]
    Watch(watch::Args),
    /// Serves an editor (LSP): shows invalid modules, failing tests, and a code lens beside each function
    #[command(
        after_help = "An editor starts the server: docs/editors.md has the settings for VS Code, Helix, Zed and Neovim.\n\
                            As you type, the server shows invalid modules. It also shows the failures of the last `karat test`. After each\n\
                            save the server runs the tests that aren't in Rust. When you edit a file, the server\n\
                            hides the old verdicts of the file's tests. A code lens beside each function shows the function's worst error; a\n\
                            click runs the function's tests. Without a server, `karat test --short` prints a line for each failure.\n\
                            Exit codes: 0 the editor asked the server to shut down; 1 the editor ended without this request."
    )]
    Lsp(lsp::Args),
    /// Runs the tests of a folder of shaders as `karat test` does, and prints a line for each test
    #[command(hide = true)]
    Suite(suite::Args),
    /// Runs the tests in a browser on this machine
    #[command(after_help = "Examples:\n  karat browser\n  karat browser --open shaders\n  \
                            karat browser -- tests/brdf --junit out.xml    passes arguments to `karat test`\n\
                            Only this machine can open the page, and the page's URL contains a secret. For the paths `dawn` and `chromium`, run `karat test`: these paths need no page.\n\
                            Exit codes: the codes of `karat test`, and 2 if no browser opens the page.")]
    Browser(browser::Args),
    /// Runs a failing case of the last run again
    #[command(after_help = "Examples:\n  karat replay          runs the only failure again\n  \
                            karat replay 3f2a     runs the failure that `karat test` calls 3f2a\n  \
                            karat replay 3f2a --print    prints the whole command, for a debugger or CI\n\
                            `karat replay` runs the simplest failing case that Karat found, on the first path that failed.\n\
                            Exit codes: 0 the case passes now; 1 the case fails; 2 the case can't run; 3 no failure has this name.")]
    Replay(replay::Args),
    /// Runs your own test command, and records the verdicts of its checks
    #[command(after_help = "Examples:\n  karat record -- cargo nextest run\n  \
                            karat record --into part-1 -- cargo nextest run --partition count:1/3\n  \
                            karat report --merge part-1 part-2 part-3 --html report.html\n\
                            `karat record` sets KARAT_RECORD for the command, and then prints the same table as `karat test`.\n\
                            Exit codes: 0 the command and all checks passed; 1 the command or a check failed; 2 no check ran,\nor the \
                            command can't be run.")]
    Record(record::Args),
    /// Prints the verdicts of the last run, and writes reports for CI
    #[command(after_help = "Examples:\n  karat report\n  karat report --github\n  \
                            karat report --junit target/karat/junit.xml\n  \
                            karat report --html report.html\n  \
                            karat report --merge shard1 shard2 shard3 --html report.html\n\
                            Exit codes: 0 every check passed; 1 a check failed; 2 the record can't be \
                            read; 3 there is no record.")]
    Report(report::Args),
    /// Validates every module and entry point of the shader packages, and runs no test
    #[command(after_help = "Examples:\n  karat check\n  karat check --shaders shaders\n\
                            `karat test` validates the modules, too. If a module needs features to be valid, \
                            declare the features in Cargo.toml:\n  [package.metadata.karat.features]\n  \
                            \"debug::overlay\" = [\"DEBUG\"]\n\
                            Exit codes: 0 all modules are valid; 1 a module is invalid; 2 a package can't be \
                            read.")]
    Check(check::Args),
    /// Writes a first test for a folder of shaders and lines for .gitignore, and on request a CI workflow
    #[command(after_help = "Examples:\n  karat init\n  karat init my/shaders --github\n\
                            `karat init` writes a `*.test.toml` for one function or compute pass, and lines for .gitignore. \
                            With --github or\n--gitlab, the command also writes a CI workflow. Then the command runs the tests. \
                            `karat init` doesn't change\nyour lines: it only adds lines to .gitignore, Cargo.toml, package.json and karat.toml.")]
    Init(init::Args),
    /// Lists the functions of the shader packages with their signatures, and marks the tested functions
    #[command(after_help = "Examples:\n  karat list\n  karat list --crate bevy_pbr@0.20.1\n\
                            Exit codes: 0 every module is valid; 1 a module is invalid, and the list of its \
                            functions may be incomplete;\n2 a package can't be read.")]
    List(list::Args),
    /// Prints the linked shader of a function with its generated kernel
    Show(show::Args),
    /// Translates a function or a module with naga, and prints the SPIR-V, GLSL, HLSL, MSL or WGSL
    #[command(after_help = "Examples:\n  karat translate fresnel::schlick --to hlsl\n  \
                            karat translate scene --to msl --validate\n  \
                            karat translate scene --to glsl --entry-point fs_main --out scene.frag\n  \
                            karat translate fresnel::schlick --to spirv | spirv-dis\n\
                            Karat gives naga the options that wgpu sets; the first line of the output lists these options.\n\
                            Exit codes: 0 the shader is translated, and with --validate the translation is valid; 1 a validator \
                            rejects the translation;\n2 naga can't translate the shader, or the shader can't be read.")]
    Translate(translate::Args),
    /// Translates every function and entry point with naga, then validates, runs and compares the translations
    #[command(
        after_help = "Examples:\n  karat matrix\n  karat matrix my/shaders\n  karat matrix --crate bevy_pbr@0.20.1\n  \
                            karat matrix --columns vulkan,vulkan:hlsl,msl --only fresnel\n  \
                            karat matrix --require vulkan:hlsl=executed,vulkan:glsl=agrees\n\
                            The status of a row is `translated` if naga translates it, `valid` if all installed validators accept it,\n\
                            `executed` if it runs on inputs generated from its signature, and `agrees` if another column has the\n\
                            same results. If no validator is installed, no row gets the status `valid`.\n\
                            Exit codes: 0 karat.toml declares all failures, and --require is met;\n1 --require isn't met, or a row fails and karat.toml \
                            doesn't declare this failure; 2 a function can't be read, or no row has a status."
    )]
    Matrix(matrix::Args),
    /// Finds operations that can go wrong, without a test: NaN, infinities, lost digits
    #[command(after_help = "Examples:\n  karat hazards\n  karat hazards my/shaders --all\n  \
                            karat hazards --only fresnel --input roughness=0.05..1\n\
                            Karat's own engine runs each function in f32, in f64 and in interval arithmetic, so the command needs no \
                            driver.\nKarat generates arguments from types and names: `n` is a unit \
                            vector, `n_dot_l` and `roughness` are from 0 to 1.\n`[inputs]` in karat.toml \
                            declares other ranges: roughness = [0.05, 1]. A `[[hazard]]` in karat.toml accepts an intended \
                            hazard,\nand has the keys functions, text (the operation) and reason.\n\
                            Exit codes: 0 no fault, and with `--deny requirements` no requirement; 1 a fault, a denied requirement, \
                            a module\nthat can't be read, or a function that naga rejects; 2 no function could be checked, or a declaration is wrong.\n\
                            Without --deny, requirements don't change the exit code.")]
    Hazards(hazards::Args),
    /// Compares the results of every function before and after an edit, without a test
    #[command(
        after_help = "Examples:\n  karat compare HEAD\n  karat compare HEAD my/shaders\n  karat compare main --only fresnel\n  \
                            karat compare ../old/shaders --paths cpu,vulkan\n\
                            Karat generates arguments: three quarters of the arguments lie in the range that the parameter's name suggests.\n\
                            `karat compare` skips functions that differ only in comments and blanks, and compares results bit by bit.\n\
                            Exit codes: 0 no change, or only new functions; 1 a result, a signature or an interface changed, a \
                            function\nwas removed, or something can't be compared; 2 the revision can't be read."
    )]
    Compare(compare::Args),
    /// Measures your tests: makes mutants of the shaders, and lists the mutants that no test kills
    #[command(
        after_help = "Examples:\n  karat mutate\n  karat mutate my/shaders --only fresnel\n  \
                            karat mutate --in-diff main --fail-under 95\n  karat mutate --stryker mutation.json\n\
                            Each mutant has one small change: another operator, another number, a guard removed.\n\
                            Tests that use the mutated code run on Karat's engine until a test fails. Karat changes no file.\n\
                            For each surviving mutant, Karat prints arguments for which the result differs, and a test to paste.\n\
                            Exit codes: 0 the score is at least --fail-under (default: 100), or --in-diff finds no mutant;\n\
                            1 the score is lower, or karat.toml accepts a mutant that a test kills;\n\
                            2 a test fails without a mutant, or there is no test or no mutant."
    )]
    Mutate(mutate::Args),
    /// Finds lines and branches of shaders that no test runs, and lines whose values no test checks
    #[command(
        after_help = "Examples:\n  karat coverage --missing\n  karat coverage shaders --html coverage.html\n  \
                      karat coverage --in-diff main --fail-under-lines 90\n  karat coverage --lcov lcov.info -- -p my-crate\n\n\
                      Exit codes: 0 the tests pass, and enough lines ran; 1 a test fails, or too few lines ran; 2 no line was counted."
    )]
    Coverage(coverage::Args),
    /// Calls a function, and prints its value on every path
    #[command(after_help = "Examples:\n  karat call fresnel::schlick 0.04,0.04,0.04 0.3\n  \
                            karat call layering::thin_coat --path vulkan -- -1,0,0 1,1,1 0.5\n  \
                            karat call fresnel::schlick --table in.csv --out out.csv --path vulkan\n  \
                            karat call double 21 --shaders my.wgsl\n  \
                            karat call fresnel::schlick 0.04,0.04,0.04 0.3 --trace --html trace.html\n\
                            Write a vector's components with commas between the numbers. A table has one case per row \
                            and one scalar per column.\nThe table's first line may name the columns (f0.x,f0.y,f0.z,v_dot_h). \
                            Karat reads a number as the nearest f32, and prints enough digits to read this f32 again.")]
    Call(call::Args),
    /// Lists the execution paths that open, with drivers and versions, and says how to get the other paths
    #[command(after_help = "Examples:\n  karat doctor\n  karat doctor my/shaders --write\n  \
                            KARAT_EXECUTORS='mine=python3 mine.py' karat doctor --executor mine\n\
                            Exit codes: 0 all is well; 1 a required path or every path fails to open, a module isn't \
                            valid, or a\nprogram's result is wrong; 2 a program doesn't run, or a folder can't be read.")]
    Doctor(doctor::Args),
    /// Lists frames that differ from their golden or have no golden
    #[command(after_help = "Examples:\n  karat pending\n  karat pending --from karat.zip --json\n\
                      Exit codes: 0 nothing is pending; 1 a frame differs; 2 a file can't be read; \
                      3 all pending frames are new.")]
    Pending(goldens::PendingArgs),
    /// Makes a pending frame the golden
    #[command(
        after_help = "Examples:\n  karat accept scene --because \"the coat conserves energy\"\n  \
                            karat accept 'furnace/*' --because \"new mesh\"\n  \
                            karat accept scene --from karat.zip --because \"as reviewed\"\n\
                            Exit codes: 0 the frame is accepted; 1 Karat refuses the frame (the golden has changed, the driver \
                            differs, a value is NaN, the image is too large);\n2 a file can't be read or written; 3 no \
                            pending frame has this name."
    )]
    Accept(goldens::AcceptArgs),
    /// Deletes a pending frame
    #[command(after_help = "Examples:\n  karat reject scene\n  karat reject '*'\n\
                            Exit codes: 0 the frame is deleted; 2 a file can't be deleted; 3 no pending frame has \
                            this name.")]
    Reject(goldens::RejectArgs),
    /// Shows pending frames beside their goldens in a browser, where you accept or reject them
    #[command(after_help = "Examples:\n  karat review --open\n  \
                            karat review --port 8000      (with `ssh -L 8000:127.0.0.1:8000`)\n  \
                            karat review --static report  (writes the page as files: open report/index.html)\n  \
                            karat review --from karat.zip (shows frames of a CI run, and accepts them on this machine)\n\
                            Only this machine can open the page. The URL is secret, because \
                            anyone who has the URL can accept frames.\nOn the page, ? shows the keys: \
                            j and k go from frame to frame, / filters the frames.\nIf the URL ends in \
                            `#` and a frame's name, the page opens at this frame.\nExit codes: 0 no frame is pending any more, or \
                            the page is written; 1 a frame is still pending; 2 an error.")]
    Review(review::Args),
    /// Lists goldens that no test compared in the last full run
    #[command(after_help = "Examples:\n  karat test && karat unreferenced\n  \
                            karat unreferenced --delete\n\
                            If a test is ignored, or needs a feature that is off, the test compares \
                            no golden.\nComparisons by checks with `.unrecorded()` don't count.\n\
                            Exit codes: 0 each golden was compared; 1 a golden wasn't compared, its provenance \
                            (`.toml`) doesn't match its image,\nor a file doesn't belong to a golden; 2 a file \
                            can't be read; 3 no verdict: there is no golden or no record,\nor the last run \
                            failed, ran only some of the tests, or compared none of the goldens.")]
    Unreferenced(unreferenced::Args),
    /// Compares an image of another program with its golden
    #[command(name = "match", after_help = matching::EXAMPLES)]
    Match(matching::Args),
    /// Compares any two images, EXR or PNG
    #[command(after_help = diff::EXAMPLES)]
    Diff(diff::Args),
    /// Writes frames of the project's gallery as EXR (linear, 32-bit float) and PNG (to look at)
    #[command(after_help = "Examples:\n  karat render --list\n  karat render --first\n  \
                            karat render 'furnace/*' --size 640x360 --samples 256 --exposure -1\n\
                            A gallery is a binary of your project. This binary runs a \
                            karat_gallery::Gallery,\nand `metadata.karat` in Cargo.toml names the binary. The command fails if \
                            a frame can't be rendered or has values that are not finite.")]
    Render(karat_gallery::RenderArguments),
    /// Shows a value of a frame's fragment functions on every pixel, as an image and in numbers
    #[command(after_help = tap::EXAMPLES)]
    Tap(tap::Args),
    /// Shows, step by step, how a frame gets the value of one pixel
    #[command(after_help = trace::EXAMPLES)]
    Trace(trace::Args),
    /// Writes an EXR image as a tone-mapped PNG
    Preview(preview::Args),
    /// Builds the manual of the karat that your project uses, and opens it in a browser
    Manual(manual::Args),
    /// Prints a completion script for a shell
    Completions {
        /// The shell that reads the script
        shell: clap_complete::Shell,
    },
}

/// The options that name the shaders, for commands that also accept the folder as a positional argument.
#[derive(clap::Args)]
struct PlaceArgs {
    /// Folder of WGSL modules, or one file; the same as `--shaders`
    #[arg(value_name = "FOLDER", conflicts_with_all = ["package", "krate"])]
    folder: Option<PathBuf>,
    #[command(flatten)]
    package: PackageArgs,
}

impl PlaceArgs {
    /// Returns the options, with a positional folder as the value of `--shaders`.
    fn package(&self) -> PackageArgs {
        let mut package = self.package.clone();
        package.package = package.package.or_else(|| self.folder.clone());
        package
    }

    /// Prints the names of tests that don't run because they are outside of the packages that Karat found. Prints
    /// nothing if an option names the package.
    fn write_outside(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let package = self.package();
        match package.package.is_none() && package.krate.is_none() {
            true => search::write_outside(None, out),
            false => Ok(()),
        }
    }
}

/// The options that name the shaders.
#[derive(Clone, clap::Args, Default)]
struct PackageArgs {
    /// Uses this folder of WGSL modules, or one file [default: the folders in `metadata.karat` of Cargo.toml, else each
    /// folder `shaders` beside a Cargo.toml, and the folders that tests used in earlier runs; without a Cargo.toml,
    /// `shaders`, else the working directory]
    #[arg(long = "shaders", value_name = "DIR")]
    package: Option<PathBuf>,
    /// Uses the shaders of a crate that the project builds (`bevy_pbr`), or of any crate at an exact version
    /// (`bevy_pbr@0.20.1`), which cargo fetches and doesn't compile
    #[arg(long = "crate", value_name = "NAME[@VERSION]", conflicts_with = "package")]
    krate: Option<String>,
    /// Takes the crate's modules from this folder, in place of the folder that Karat finds; `NAME=DIR` sets the
    /// folder of an imported crate; may be repeated
    #[arg(long = "root", value_name = "[NAME=]DIR", requires = "krate")]
    roots: Vec<String>,
    /// Turns a feature on (`@if(NAME)`, `#ifdef NAME`), or sets the feature's value (`NAME=3`,
    /// `NAME=false`); may be repeated
    #[arg(long = "feature", value_name = "NAME[=VALUE]", value_parser = feature)]
    features: Vec<(String, Feature)>,
}

impl PackageArgs {
    fn featured(&self, package: karat::Package) -> karat::Package {
        featured(package, &self.features)
    }
}

/// Parses a percentage from 0 to 100.
fn percent(text: &str) -> Result<f64, String> {
    let number = text.trim_end_matches('%').trim().parse::<f64>();
    let number = number.ok().filter(|number| (0.0..=100.0).contains(number));
    number.ok_or_else(|| "write a number from 0 to 100".to_owned())
}

fn featured(package: karat::Package, features: &[(String, Feature)]) -> karat::Package {
    features.iter().fold(package, |package, (name, value)| package.feature(name, *value))
}

/// Parses a feature: `NAME`, `NAME=false`, `NAME=3`.
fn feature(text: &str) -> Result<(String, Feature), String> {
    let (name, value) = text.split_once('=').unwrap_or((text, "true"));
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    if name.is_empty() || !name.chars().all(is_name) {
        return Err("a feature's name may contain only letters, digits and `_`".to_owned());
    }
    let value = match value {
        "true" => Feature::Flag(true),
        "false" => Feature::Flag(false),
        number => Feature::Number(number.parse().map_err(|_| {
            "a feature's value must be a whole number, `true` or `false`".to_owned()
        })?),
    };
    Ok((name.to_owned(), value))
}

/// Runs the command that the arguments of this process name.
pub(crate) fn run() -> ExitCode {
    match loader::with_second_driver() {
        None => {}
        Some(Ok(code)) => return code,
        Some(Err(error)) => {
            complain(&format!("{error:#}"));
            return ExitCode::from(2);
        }
    }
    terminal::measure();
    let mut out = Output::stdout();
    let result = match Cli::try_parse() {
        Ok(cli) => settled(cli.command, &mut out).map(ExitCode::from),
        Err(error) => explain(error, &mut out),
    };
    // A command that can't write its output fails.
    let result = match (result, out.finish()) {
        (Err(error), _) => Err(error),
        (Ok(_), Err(error)) => Err(anyhow::Error::from(error).context("can't write the output")),
        (Ok(code), Ok(())) => Ok(code),
    };
    result.unwrap_or_else(|error| {
        if !error.is::<Reported>() {
            complain(&format!("{error:#}"));
        }
        ExitCode::from(if is_missing(&error) { 3 } else { 2 })
    })
}

/// Runs a command. First checks the names of the environment variables that begin with `KARAT_`, because a misspelt
/// variable would have no effect.
fn settled(wanted: Command, out: &mut dyn Write) -> Outcome {
    if !matches!(wanted, Command::Completions { .. }) {
        karat::unstable::settings::check()?;
    }
    command(wanted, out)
}

fn command(command: Command, out: &mut dyn Write) -> Outcome {
    match command {
        Command::Test(args) => test::run(&args, out),
        Command::Watch(args) => watch::run(&args, out),
        Command::Lsp(args) => lsp::run(&args, out),
        Command::Suite(args) => suite::run(&args, out),
        Command::Match(args) => matching::run(&args, out),
        Command::Browser(args) => browser::run(&args, out),
        Command::Replay(args) => replay::run(&args, out),
        Command::Record(args) => record::run(&args, out),
        Command::Report(args) => report::run(&args, out),
        Command::Check(args) => check::run(&args, out),
        Command::Init(args) => init::run(&args, out),
        Command::List(args) => list::run(&args, out),
        Command::Show(args) => show::run(&args, out),
        Command::Translate(args) => translate::run(&args, out),
        Command::Matrix(args) => matrix::run(&args, out),
        Command::Compare(args) => compare::run(&args, out),
        Command::Mutate(args) => mutate::run(&args, out),
        Command::Coverage(args) => coverage::run(&args, out),
        Command::Hazards(args) => hazards::run(&args, out),
        Command::Call(args) => call::run(&args, out),
        Command::Doctor(args) => doctor::run(&args, out),
        Command::Pending(args) => goldens::pending(&args, out),
        Command::Accept(args) => goldens::accept(&args, out),
        Command::Reject(args) => goldens::reject(&args, out),
        Command::Unreferenced(args) => unreferenced::run(&args, out),
        Command::Diff(args) => diff::run(&args, out),
        Command::Review(args) => review::run(&args, out),
        Command::Render(args) => render::run(args, out),
        Command::Tap(args) => tap::run(&args, out),
        Command::Trace(args) => trace::run(&args, out),
        Command::Preview(args) => preview::run(&args, out),
        Command::Manual(args) => manual::run(&args, out),
        Command::Completions { shell } => {
            // The generator panics if it can't write, so it writes to memory.
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "karat", &mut script);
            out.write_all(&script).map(|()| Ending::Good).map_err(Into::into)
        }
    }
}

/// Prints the help that the user requested, or an error about wrong arguments.
fn explain(error: clap::Error, out: &mut dyn Write) -> anyhow::Result<ExitCode> {
    // Arguments in the message may contain escape sequences. The writer makes them visible.
    let words = std::env::args_os().map(|word| visible(&word.to_string_lossy()).into_owned());
    let error = Cli::try_parse_from(words).err().unwrap_or(error);
    let text = trusted(&error.render().ansi().to_string());
    if error.use_stderr() {
        tell(text.trim_end());
    } else {
        write!(out, "{text}")?;
    }
    Ok(u8::try_from(error.exit_code()).map_or(ExitCode::FAILURE, ExitCode::from))
}

/// Prints a message to standard error, after the word `error`.
fn complain(text: &str) {
    let prefix = if text.starts_with("error") { "" } else { "error: " };
    tell(&format!("{prefix}{text}"));
}

/// Returns an error if the output file is also an input file, even under another name, because the output would replace
/// the input.
fn spare<'a>(
    what: &str,
    output: &Path,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> anyhow::Result<()> {
    // Only a regular file is replaced. The comparison would open a pipe or a device file.
    if !output.is_file() {
        return Ok(());
    }
    for input in inputs.into_iter().filter(|input| input.is_file()) {
        // A missing input isn't the output. Reading the input later reports that it is missing.
        if same_file::is_same_file(output, input).unwrap_or(false) {
            bail!(
                "the {what} `{}` would overwrite `{}`, which the command reads: name another file",
                output.display(),
                input.display()
            );
        }
    }
    Ok(())
}

/// Returns the absolute path of a file, with symbolic links resolved and without `..`. The file needn't exist.
fn resolved(path: &Path) -> PathBuf {
    let mut whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    // A link may lead to a file that doesn't exist yet.
    if let Ok(target) = std::fs::read_link(&whole) {
        whole = whole.parent().unwrap_or(Path::new("")).join(target);
    }
    // The part of the path that doesn't exist has no links.
    let mut rest = Vec::new();
    while let Some(parent) = whole.parent() {
        if let Ok(there) = whole.canonicalize() {
            whole = there;
            break;
        }
        rest.extend(whole.components().next_back().map(|last| last.as_os_str().to_owned()));
        whole = parent.to_owned();
    }
    for part in rest.into_iter().rev() {
        match part.to_str() {
            Some("..") => drop(whole.pop()),
            Some(".") => {}
            _ => whole.push(part),
        }
    }
    whole
}

/// Checks if the output is inside the folder of a package, or is the only file of a package.
fn is_in_package(output: &Path, package: &karat::Package) -> bool {
    resolved(output).starts_with(resolved(&package.root()))
}

/// Returns an error if the output would replace a file of one of these packages, or would become a module of a package.
fn spare_shaders(what: &str, output: &Path, packages: &[karat::Package]) -> anyhow::Result<()> {
    let is_read = |name: &str| [".wgsl", ".wesl"].iter().any(|end| name.ends_with(end));
    let name = output.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    for package in packages {
        let manifest = name == "karat.toml" && output.is_file();
        ensure!(
            !manifest && !((is_read(&name) || output.is_file()) && is_in_package(output, package)),
            "the {what} `{}` would overwrite a file of the package `{}`, or become a file of the package: name another \
             file",
            output.display(),
            package.name()
        );
    }
    let functions = packages.iter().filter_map(|package| package.functions().ok()).flatten();
    let files: BTreeSet<PathBuf> =
        functions.map(|function| PathBuf::from(&function.span.file.name)).collect();
    spare(what, output, files.iter().map(PathBuf::as_path))
}

/// Checks if the error means that a file, golden or record is missing. An unusable file is a different error.
fn is_missing(error: &anyhow::Error) -> bool {
    let missing = |image: &ImageError| matches!(image, ImageError::Missing { .. });
    error.is::<NotThere>()
        || error.downcast_ref().is_some_and(missing)
        || error.downcast_ref().is_some_and(|error| match error {
            AcceptError::NotPending { .. } => true,
            AcceptError::Image(image) => missing(image),
            _ => false,
        })
}

/// Writes a value as indented JSON and a line end. Control characters are escaped, so terminals can show the JSON
/// safely.
fn write_json(value: &impl serde::Serialize, out: &mut dyn Write) -> anyhow::Result<()> {
    let json = serde_json::to_string_pretty(value).context("the result isn't JSON")?;
    writeln!(out, "{}", visible_json(&json))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    mod reference;

    use anyhow::anyhow;

    use super::*;

    #[test]
    fn an_error_names_each_cause_once() {
        let told = |error: &anyhow::Error| format!("{error:#}");
        let folder = || std::io::Error::new(std::io::ErrorKind::IsADirectory, "it is a folder");
        let image = ImageError::Read { path: "a".to_owned(), cause: folder() };
        assert_eq!(told(&image.into()), "can't read `a`: it is a folder");
        let accept =
            AcceptError::Image(ImageError::Write { path: "a".to_owned(), cause: folder() });
        let accept = anyhow::Error::from(accept).context("frame `scene`");
        assert_eq!(told(&accept), "frame `scene`: can't write `a`: it is a folder");
        let context = anyhow!("no entry").context("it isn't a zip").context("can't use `a`");
        assert_eq!(told(&context), "can't use `a`: it isn't a zip: no entry");
    }
}
