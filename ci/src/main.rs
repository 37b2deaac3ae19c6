//! `cargo ci`: runs the parts of CI, in the same way on any machine.
//!
//! Each command is a list of steps with a name, a wall time and a verdict; see [`step`]. This package stays small on
//! purpose: `cargo ci setup` must compile and run before the graphics libraries that the harness needs are installed.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

mod bench;
mod command;
mod corpus;
mod demo;
mod dist;
mod full;
mod glams;
mod licence;
mod lint;
mod matrix;
mod mutants;
mod nextest;
mod once;
mod packages;
#[path = "../../harness/src/record/folder.rs"]
#[expect(unreachable_pub, reason = "it is public in the harness, which is compiled later")]
mod record;
mod semver;
mod sentences;
mod setup;
mod size;
mod step;
mod suite;
#[path = "../../harness/src/path/swiftshader.rs"]
#[expect(unreachable_pub, reason = "Karat offers it to programs around tests")]
mod swiftshader;

/// Run the parts of CI on this machine, in the same way as CI does.
#[derive(Parser)]
#[command(name = "cargo ci", bin_name = "cargo ci", after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

const EXAMPLES: &str = "\
Examples:
  cargo ci setup            make sure Vulkan and GL open; install Mesa if they don't
  cargo ci demo             from a fresh clone to verdicts on every path
  cargo ci lint             the quick half of CI, before a commit
  cargo ci test             all of CI, before a push
  cargo ci bench -- frames  the benchmarks whose name contains `frames`
  cargo ci mutants camera   the mutants of a shader module against the library's tests

No GPU is needed: Mesa's lavapipe (Vulkan) and llvmpipe (GL) run on the processor.";

#[derive(Subcommand)]
enum Task {
    /// Find the execution paths, and install Mesa's software drivers if one is missing.
    ///
    /// On Linux both Vulkan and GL must be loadable, in software or hardware. On Debian, Fedora and Arch (and their
    /// relatives) the command installs missing packages; on other systems the command prints their names. macOS and
    /// Windows include Metal and DX12, so the command installs no drivers there. The command also installs two programs
    /// outside the working tree: Chromium, for the tests of the review page, and Tint, with npm. Then the command
    /// builds the harness, which opens each path.
    Setup {
        /// Only report: install nothing, and fail if a path is missing.
        #[arg(long)]
        check: bool,
    },
    /// Set up, build, and run the shader tests on every path; stop at the first failure.
    Demo,
    /// Run all of CI: set up, lint, then every test. Later steps run even if an earlier step fails.
    Test,
    /// Run the suites that are too long for each change, such as every test with SwiftShader as the only driver.
    ///
    /// The results on SwiftShader go to docs/swiftshader.md. `cargo ci test` runs a sample of these suites.
    Full,
    /// Check formatting, Clippy, documentation and licences: CI without the tests.
    Lint,
    /// Check that the usual commands compile each crate only once, with one set of features.
    Once,
    /// Run the checks that find faults of released shaders
    ///
    /// Each check must fail on the released crate, and pass with the change that repairs the fault. The command writes
    /// the pages in docs/found.
    Found,
    /// Test karat with mint, and with each version of glam for which karat has a feature
    Glams,
    /// Test each operator and builtin function on each path, and write a page for each path and driver
    ///
    /// The pages list the expressions with wrong results, and go to docs/divergences; pages of drivers that this
    /// machine lacks stay unchanged.
    Divergences,
    /// Check the shaders of published crates: which modules open, link and are valid, and which functions Karat can
    /// call.
    ///
    /// Cargo fetches the crates, and doesn't compile them. The table goes to docs/corpus.md.
    Corpus {
        /// The list of crates and folders [default: ci/corpus.toml]
        list: Option<PathBuf>,
        /// Only runs each function in every translation, and writes docs/corpus-translations.md
        #[arg(long)]
        routes: bool,
        /// Only validates each module, with naga and with Tint, and writes docs/corpus-compilers.md
        #[arg(long, conflicts_with_all = ["routes", "json"])]
        compilers: bool,
        /// Also write the rows as JSON to this file, or with --routes into this folder
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
    },
    /// Run the benchmarks; arguments after `--` go to the benchmarks.
    Bench {
        /// Write the measurements to `docs/speed.md`, with the machine's description.
        #[arg(long)]
        page: bool,
        /// Arguments for the benchmarks.
        #[arg(last = true)]
        arguments: Vec<String>,
    },
    /// Translate, validate, run and compare the shader library on every route, and write
    /// `docs/translations.md`.
    Matrix,
    /// Build and test the crates as they would be published: packed, and unpacked into a separate workspace.
    ///
    /// Cargo uses the unpacked packages in place of those in the registry. This takes minutes.
    Package,
    /// Run tests with cargo-nextest, once whole and once in three parts, and compare the reports.
    Nextest,
    /// Test the npm packages `karat-vitest` and `karat-playwright`, with each vitest that this machine's Node runs.
    Npm,
    /// Build the packages for people without Rust, and try them without Rust
    ///
    /// Writes an archive with its checksum, npm packages and a Python wheel into target/dist/packages. Needs python3
    /// with `venv`, and for this machine's own target also npm.
    Dist {
        /// The target to build for [default: this machine's], such as aarch64-unknown-linux-gnu
        #[arg(long, value_name = "TRIPLE")]
        target: Option<String>,
    },
    /// Compare the libraries' public interfaces with those of a revision, by cargo-semver-checks.
    Semver {
        /// The revision [default: the newest release, else the revision in ci/baseline.txt]
        revision: Option<String>,
    },
    /// Print a random sample of the sentences that people read, for a reader who has never seen them.
    Sentences {
        /// The texts from which the sentences come
        from: sentences::Source,
        /// The number of sentences
        #[arg(long, default_value_t = 30)]
        count: usize,
        /// The seed of the sample: another seed gives other sentences
        #[arg(long, default_value_t = 0)]
        seed: u64,
    },
    /// Measure the harness: lines, public items, and the number of files that mention a verb, a path or a subcommand.
    Size {
        /// A revision to compare the working tree with.
        revision: Option<String>,
    },
    /// Try every mutant of the shader library, and list the mutants that no test kills; this takes hours.
    ///
    /// Runs `karat mutate`, and writes the result for each mutant to `target/karat/mutation.json`. `cargo ci test`
    /// tries only a few mutants.
    Mutants {
        /// Try only the mutants of this module (`brdf`) or function (`brdf::schlick`), or only the mutant with this id
        /// (`b778d00e`).
        names: Vec<String>,
    },
}

fn main() -> ExitCode {
    match Cli::parse().task {
        Task::Setup { check: false } => demo::set_up(),
        Task::Setup { check: true } => step::verdict(setup::check()),
        Task::Demo => demo::run(),
        Task::Test => suite::run(),
        Task::Full => full::run(),
        Task::Lint => lint::run(),
        Task::Once => step::verdict(once::check()),
        Task::Found => step::verdict(corpus::run_found()),
        Task::Corpus { list, compilers: true, .. } => step::verdict(corpus::run_compilers(list)),
        Task::Corpus { list, routes: false, json, .. } => step::verdict(corpus::run(list, json)),
        Task::Corpus { list, routes: true, json, .. } => {
            step::verdict(corpus::run_routes(list, json))
        }
        Task::Glams => step::verdict(glams::run()),
        Task::Divergences => step::verdict(matrix::divergences()),
        Task::Matrix => step::verdict(matrix::run()),
        Task::Bench { page, arguments } => step::verdict(bench::run(&arguments, page)),
        Task::Package => packages::run(),
        Task::Dist { target } => step::verdict(dist::run(target.as_deref())),
        Task::Npm => suite::npm(),
        Task::Nextest => step::verdict(nextest::run()),
        Task::Semver { revision } => step::verdict(semver::run(revision)),
        Task::Sentences { from, count, seed } => step::verdict(sentences::run(from, count, seed)),
        Task::Size { revision } => step::verdict(size::run(revision.as_deref())),
        Task::Mutants { names } => step::verdict(mutants::run(&names)),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn command_line_is_consistent() {
        super::Cli::command().debug_assert();
    }
}
