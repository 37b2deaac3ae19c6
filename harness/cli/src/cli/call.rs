//! `karat call`: calls a shader's function with given arguments.

mod arguments;
pub(super) mod bind;
mod cases;
mod curve;
mod dispatch;
mod trace;

pub(super) use trace::write_rows;

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, anyhow, bail, ensure};
use karat::fixture::Fixtures;
use karat::unstable::probe::Probed;
use karat::unstable::reflect::{Function, Stage};
use karat::unstable::value::hexfloat;
use karat::{Path, Tolerance};
use karat_inspect::made_up::{MadeUp, Ranges};

use super::project::Project;
use super::table::{BAD, DIM, HEAD};
use super::{Ending, Outcome, PackageArgs, spare, spare_shaders};
use arguments::Given;
use cases::Request;
use curve::Curve;

#[derive(clap::Args)]
pub(super) struct Args {
    /// The function to call: `module::name`
    function: String,
    /// The function's arguments, in order or as NAME=VALUE. Join the components of a vector by commas: `1,0,0`. Write
    /// a structure as JSON: `m={"f0": [1, 1, 1], "roughness": 0.5}`. `0..1:100` sweeps a component from 0 to 1 in 100
    /// points; write `x=-1..1:100` if the range begins with a minus. For a fragment function `0.5@0.1@0` is the value
    /// 0.5 with its derivatives to the right and downwards; `0.5,1@0.1,0@0,0.1` is the same for a vector
    #[arg(allow_negative_numbers = true)]
    arguments: Vec<String>,
    /// Sets a variable of the shader: to an image file or a colour, to a value as JSON or in a file (.json, .toml,
    /// .bin), or to a sampler (`linear repeat`); may be repeated
    #[arg(long = "bind", value_name = "NAME=VALUE")]
    bind: Vec<String>,
    /// Generates all arguments, and the variables that --bind doesn't set, as `karat hazards` does. Each CASE (0, 1, 2,
    /// ...) has different values; in the first cases, the values are ends of ranges [default CASE: 0]
    #[arg(long, alias = "made-up", value_name = "CASE", num_args = 0..=1, default_missing_value = "0", require_equals = true,
        conflicts_with_all = ["table", "arguments"])]
    arbitrary: Option<usize>,
    /// Dispatches a compute entry point over this number of workgroups, such as `4` or `4,2,1`, and shows the results
    /// in its buffers and textures. Without this option Karat runs a single invocation, and you pass its builtin values
    /// as arguments
    #[arg(long, value_name = "X,Y,Z", value_parser = dispatch::workgroups,
        conflicts_with_all = ["arguments", "table", "plot", "out"])]
    dispatch: Option<[u32; 3]>,
    /// Shows the invocation with this `global_invocation_id` in --trace and --html of a dispatch [default: 0,0,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = dispatch::invocation, requires = "dispatch")]
    invocation: Option<[u32; 3]>,
    /// Sets an `override`, by its name or its `@id`; may be repeated
    #[arg(long = "override", value_name = "NAME=VALUE")]
    overrides: Vec<String>,
    /// Runs on this path; may be repeated [default: every path that opens]
    #[arg(long = "path", value_name = "PATH", value_delimiter = ',', env = "KARAT_PATHS")]
    paths: Vec<String>,
    /// Evaluates every row of a table (CSV) of at most 256 MB and 4194304 cases, in place of ARGUMENTS
    #[arg(long, alias = "cases", value_name = "IN.CSV", conflicts_with = "arguments")]
    table: Option<PathBuf>,
    /// Writes the table of results to this file [default: standard output]
    #[arg(long, value_name = "OUT.CSV")]
    out: Option<PathBuf>,
    /// Compares each case with this column of the table, within --tolerance, and fails if a case differs. For a vector
    /// the table needs one column per component: `COLUMN.x`, `COLUMN.y`. If the function also writes through pointers,
    /// the table needs one column per result: `COLUMN.result` for the returned value, and `COLUMN.p` for the pointer
    /// `p`
    #[arg(long, value_name = "COLUMN", requires = "table", requires = "tolerance")]
    expect: Option<String>,
    /// Accepts results within this tolerance of the column that --expect names: `4 ulp`, `rel 1e-4 or abs 1e-6`,
    /// `exact`
    #[arg(long, requires = "expect")]
    tolerance: Option<String>,
    /// Writes floats in hexadecimal, with all their bits
    #[arg(long, alias = "exact")]
    hex: bool,
    /// Plots a sweep in the terminal, or writes the plot to FILE.SVG
    #[arg(long, value_name = "FILE.SVG", num_args = 0..=1, require_equals = true, conflicts_with = "table")]
    plot: Option<Option<PathBuf>>,
    /// Shows each intermediate value in f32, in f64, and with the bounds of the errors that WGSL allows
    #[arg(long, conflicts_with = "table")]
    trace: bool,
    /// Writes the intermediate values of --trace beside the source, as an HTML page, to this file
    #[arg(long, value_name = "FILE", conflicts_with = "table")]
    html: Option<PathBuf>,
    #[command(flatten)]
    package: PackageArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let package = Project::find()?.package_of(&args.package, &args.function)?;
    let overrides = bind::overrides(&args.overrides)?;
    let mut probed = Probed::with_overrides(&package, &args.function, &overrides)?;
    bind::expect_types(&probed, &args.overrides)?;
    // If the option names a file, this file is the shader's module, and an input of the command.
    let own = args.package.package.as_deref().filter(|path| path.is_file());
    let shader = PathBuf::from(&probed.function().span.file.name);
    let inputs = || args.table.as_deref().into_iter().chain([shader.as_path()]).chain(own);
    if let Some(output) = &args.out {
        spare("table", output, inputs())?;
    }
    if let Some(Some(plot)) = &args.plot {
        spare("plot", plot, inputs())?;
    }
    if let Some(file) = &args.html {
        spare_shaders("page", file, std::slice::from_ref(&package))?;
    }
    ensure!(
        args.dispatch.is_none() || probed.function().stage() == Some(Stage::Compute),
        "`{}` isn't a compute entry point: remove --dispatch",
        args.function
    );
    let made_up = match args.arbitrary {
        Some(case) => {
            let ranges = Ranges::of(&package)?;
            let made = match args.dispatch {
                Some(groups) => {
                    let of = (&package, &*args.function);
                    MadeUp::of_pass(of, &overrides, groups, &ranges, case)
                }
                None => MadeUp::of(&probed, &ranges, case),
            };
            Some(made.map_err(|error| anyhow!("--arbitrary: {error}"))?)
        }
        None => None,
    };
    let fixtures = bind::fixtures(&probed, &args.bind, made_up.as_ref())?;
    probed.fit(&fixtures)?;
    if let Some(groups) = args.dispatch {
        let paths = paths(&probed, &fixtures, &args.paths)?;
        if let Some(made_up) = &made_up {
            write_made_up(probed.function(), made_up, args, out)?;
        }
        let compute =
            fixtures.into_iter().fold(package.compute(), |all, (name, one)| all.with(&name, one));
        let compute =
            overrides.iter().fold(compute, |all, (name, value)| all.with_override(name, *value));
        ensure!(
            args.invocation.is_none() || args.trace || args.html.is_some(),
            "--invocation needs an option that shows the invocation's steps: add --trace, or --html FILE"
        );
        let compute = compute.dispatch(&args.function, groups);
        let invocation = args.invocation.unwrap_or_default();
        // The trace comes first: it reports the error that the shader has no such invocation.
        let steps = match args.trace || args.html.is_some() {
            true => karat::unstable::compute::trace(&compute, invocation)?,
            false => Vec::new(),
        };
        let ending = dispatch::run(&compute, &paths, out)?;
        if args.trace {
            let [x, y, z] = invocation;
            write!(out, "\n{DIM}steps of invocation ({x}, {y}, {z}):{DIM:#}")?;
        }
        args.show_steps(&args.function, &|| Ok(steps.clone()), out)?;
        return Ok(ending);
    }
    if let Some(Some(plot)) = &args.plot {
        let svg = plot.extension().is_some_and(|end| end.eq_ignore_ascii_case("svg"));
        ensure!(
            svg,
            "--plot writes only SVG files: write --plot={}",
            plot.with_extension("svg").display()
        );
    }
    let tolerance = match &args.tolerance {
        Some(text) => Some(karat_suite::tolerance(text).map_err(|error| anyhow!(error))?),
        None => None,
    };
    ensure!(
        args.expect.is_none() || args.table.is_some(),
        "--expect needs a table: add --table IN.CSV"
    );
    if let Some(cases) = &args.table {
        if probed.takes_derivatives() {
            let varying = cases::varying(cases, probed.function())?;
            probed = probed.with_quads(&varying);
        }
        let paths = paths(&probed, &fixtures, &args.paths)?;
        let expect = args.expect.as_deref().zip(tolerance);
        return cases::evaluate(&args.request(&probed, &fixtures, &paths, expect), cases, out);
    }
    if let Some(made_up) = made_up {
        let paths = paths(&probed, &fixtures, &args.paths)?;
        write_made_up(probed.function(), &made_up, args, out)?;
        return single(&args.request(&probed, &fixtures, &paths, None), &made_up.lanes, args, out);
    }
    let given = Given::read(probed.function(), &args.arguments)?;
    if given.varying.contains(&true) {
        ensure!(
            probed.takes_derivatives(),
            "`{}` uses no derivatives: remove each `@` and the number after `@`",
            args.function
        );
        probed = probed.with_quads(&given.varying);
    }
    let paths = paths(&probed, &fixtures, &args.paths)?;
    let request = args.request(&probed, &fixtures, &paths, None);
    match given.sweep {
        Some(_) => sweep(&request, &given, args, out),
        None => {
            ensure!(
                args.out.is_none(),
                "--out needs a table or a sweep: add --table IN.CSV, or write an argument such as `0..1:100`"
            );
            ensure!(args.plot.is_none(), "--plot needs a sweep as an argument, such as `0..1:100`");
            single(&request, &given.lanes, args, out)
        }
    }
}

impl Args {
    fn request<'a>(
        &'a self,
        probed: &'a Probed,
        fixtures: &'a Fixtures,
        paths: &'a [Path],
        expect: Option<(&'a str, Tolerance)>,
    ) -> Request<'a> {
        let (output, exact) = (self.out.as_deref(), self.hex);
        Request { probed, fixtures, paths, output, exact, expect }
    }
}

/// Returns the paths that `--path` and `KARAT_REQUIRE` name. Without `--path`, also returns the engine and every driver
/// that opens, except paths that lack an ability that the function needs.
fn paths(probed: &Probed, fixtures: &Fixtures, names: &[String]) -> anyhow::Result<Vec<Path>> {
    // An empty environment variable counts as unset.
    let names: Vec<&str> =
        names.iter().map(|name| name.trim()).filter(|name| !name.is_empty()).collect();
    let named = if names.is_empty() { "all".to_owned() } else { names.join(",") };
    let mut paths = karat::unstable::path::named("--path", &named)?;
    let required = match std::env::var("KARAT_REQUIRE") {
        Ok(names) if !names.trim().is_empty() => {
            karat::unstable::path::named("KARAT_REQUIRE", &names)?
        }
        _ => Vec::new(),
    };
    paths.extend(required.iter().copied().filter(|path| !paths.contains(path)).collect::<Vec<_>>());
    if names.is_empty() {
        paths.push(Path::CPU);
    }
    ensure!(!paths.is_empty(), "no execution path opens: run `karat doctor` to see why");
    if named.trim() != "all" {
        return Ok(paths);
    }
    // Paths without a needed ability are left out, unless an option names them.
    let (mut able, mut reasons) = (Vec::new(), Vec::new());
    for path in paths {
        match karat::unstable::executor::call(probed, path, &[], fixtures) {
            Err(error) if error.is_of_path() && !required.contains(&path) => {
                reasons.push(error.to_string());
            }
            _ => able.push(path),
        }
    }
    if able.is_empty() {
        bail!("{}", reasons.join("\n"));
    }
    for reason in reasons {
        eprintln!("note: {}", reason.trim_start_matches("error: "));
    }
    Ok(able)
}

/// Prints the values that Karat generated, and the ranges from which Karat chose these values.
fn write_made_up(
    function: &Function,
    made_up: &MadeUp,
    args: &Args,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let bound = |name: &str| args.bind.iter().any(|given| given.split('=').next() == Some(name));
    let members =
        made_up.members.iter().filter(|(path, _)| !bound(path.split('.').next().unwrap_or(path)));
    for (name, value) in made_up.arguments(function).iter().chain(members) {
        writeln!(out, "{DIM}generated: {name} = {value}{DIM:#}")?;
    }
    for line in made_up.drawn.lines(usize::MAX) {
        writeln!(out, "{DIM}generated {line}{DIM:#}")?;
    }
    Ok(())
}

/// The largest number of floats in a result that Karat also prints in hexadecimal. A 4 x 4 matrix has 16 floats. If a
/// result had more floats, their hexadecimal numbers would make the values hard to find.
const MOST_HEXADECIMAL: usize = 16;

impl Args {
    /// Shows the intermediate values of a call, if `--trace` or `--html` is given.
    fn show_steps(
        &self,
        name: &str,
        steps: &dyn Fn() -> anyhow::Result<Vec<karat::unstable::trace::Step>>,
        out: &mut dyn Write,
    ) -> anyhow::Result<()> {
        if self.trace {
            trace::write_text(&steps()?, out)?;
        }
        if let Some(file) = &self.html {
            trace::write_html(name, &steps()?, file)?;
        }
        Ok(())
    }
}

/// Calls a function once, and prints the result of each path.
fn single(request: &Request<'_>, lanes: &[u32], args: &Args, out: &mut dyn Write) -> Outcome {
    let Request { probed, fixtures, .. } = *request;
    let function = probed.function();
    writeln!(out, "{DIM}{function}{DIM:#}")?;
    if function.stage() == Some(Stage::Compute) {
        writeln!(
            out,
            "{DIM}only one invocation ran: to run workgroups, add --dispatch X,Y,Z{DIM:#}"
        )?;
    }
    let given = cases::results(request, &[lanes.to_vec()])?;
    for (path, results) in &given.results {
        let result = results.first().context("the path returned no result")?;
        write!(out, "{HEAD}{path:<8}{HEAD:#} {}", function.result.format(result))?;
        let hexadecimal: Vec<String> = result
            .iter()
            .zip(function.result.lanes())
            .filter(|(_, scalar)| scalar.is_float())
            .map(|(lane, _)| hexfloat(f32::from_bits(*lane)))
            .collect();
        if (1..=MOST_HEXADECIMAL).contains(&hexadecimal.len()) {
            write!(out, "  {DIM}{}{DIM:#}", hexadecimal.join(" "))?;
        }
        writeln!(out)?;
    }
    write!(out, "{}", given.printed)?;
    args.show_steps(
        &function.name,
        &|| Ok(karat::unstable::trace::trace(probed, fixtures, lanes)?),
        out,
    )?;
    given.ending()
}

/// Calls a function for each value of a sweep, and prints the results as a table or as a curve.
fn sweep(request: &Request<'_>, given: &Given, args: &Args, out: &mut dyn Write) -> Outcome {
    ensure!(!args.trace && args.html.is_none(), "a trace can't show a sweep: write one value");
    let Some(sweep) = &given.sweep else { return Ok(Ending::Good) };
    let row = |value: &u32| {
        let mut lanes = given.lanes.clone();
        lanes[sweep.lane] = *value;
        lanes
    };
    let rows: Vec<Vec<u32>> = sweep.values.iter().map(row).collect();
    let found = cases::results(request, &rows)?;
    eprint!("{}", found.printed);
    let Some(plot) = &args.plot else {
        cases::write_table(request, &rows, &found.results, &[], out)?;
        return found.ending();
    };
    let function = request.probed.function();
    let columns = cases::columns(function);
    let (axis, scalar) = &columns[sweep.lane];
    let lanes = function.result.lanes().into_iter().zip(function.result.lane_names());
    let mut curves = Vec::new();
    for (lane, (kind, name)) in lanes.enumerate() {
        for (path, values) in &found.results {
            let points = values.iter().zip(&sweep.values);
            let points = points.map(|(result, x)| (scalar.decode(*x), kind.decode(result[lane])));
            curves.push(Curve { name: format!("{path}{name}"), points: points.collect() });
        }
    }
    if request.output.is_some() {
        cases::write_table(request, &rows, &found.results, &[], out)?;
    }
    match plot {
        None => curve::write_text(&curves, axis, out)?,
        Some(file) => {
            curve::write_svg(&curves, axis, file)?;
            writeln!(out, "{}", file.display())?;
        }
    }
    found.ending()
}
