//! `karat call`: a shader as a calculator.

mod trace;

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path as FilePath, PathBuf};

use anyhow::{Context, bail, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use karat::Path;
use karat::image::write_whole;
use karat::probe::{ProbeError, Probed};
use karat::reflect::Function;
use karat::value::{Scalar, Shape, format_lane, hexfloat};

use super::project::Project;
use super::table::{DIM, HEAD};
use super::{Ending, Outcome, PackageArgs, spare, spare_shaders};

#[derive(clap::Args)]
pub(super) struct Args {
    /// The function: `module::name`
    function: String,
    /// Its arguments; components are joined by commas
    #[arg(allow_negative_numbers = true)]
    arguments: Vec<String>,
    /// Path to run on; may be repeated [default: every path that opens]
    #[arg(long = "path", value_name = "PATH", value_delimiter = ',', env = "KARAT_PATHS")]
    paths: Vec<String>,
    /// Evaluate a table (CSV) instead, of at most 256 MB and 4194304 cases
    #[arg(long, value_name = "IN.CSV", conflicts_with = "arguments")]
    cases: Option<PathBuf>,
    /// Where the table goes [default: standard output]
    #[arg(long, value_name = "OUT.CSV", requires = "cases")]
    out: Option<PathBuf>,
    /// Show each intermediate in f32, in f64 and as WGSL bounds it
    #[arg(long, conflicts_with = "cases")]
    trace: bool,
    /// Write that as a page, beside the source
    #[arg(long, value_name = "FILE", conflicts_with = "cases")]
    html: Option<PathBuf>,
    #[command(flatten)]
    package: PackageArgs,
}

/// Rows of a table that are evaluated before the progress bar moves.
const STEP: usize = 65_536;
/// Bytes and rows of a table: what is read is kept, with all results, until the table is written.
const LONGEST: u64 = 256 << 20;
const MOST_CASES: usize = 1 << 22;

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    // Clap drops what `--out` requires as soon as arguments, which `--cases` excludes, are there.
    ensure!(args.out.is_none() || args.cases.is_some(), "--out needs a table: --cases IN.CSV");
    let package = Project::find()?.package_of(&args.package, &args.function)?;
    let probed = Probed::new(&package, &args.function)?;
    if let (Some(cases), Some(output)) = (&args.cases, &args.out) {
        // A package of one file is its module.
        let package = args.package.package.as_deref().filter(|path| path.is_file());
        let shader = FilePath::new(&probed.function().span.file.name);
        spare("table", output, [cases.as_path(), shader].into_iter().chain(package))?;
    }
    if let Some(file) = &args.html {
        spare_shaders("page", file, std::slice::from_ref(&package))?;
    }
    let paths = paths(&probed, &args.paths)?;
    match &args.cases {
        Some(cases) => table(&probed, &paths, cases, args.out.as_deref(), out),
        None => single(&probed, &paths, args, out),
    }
}

/// The paths that are named; else every driver that opens, and the engine.
fn paths(probed: &Probed, names: &[String]) -> anyhow::Result<Vec<Path>> {
    let named = if names.is_empty() { "all".to_owned() } else { names.join(",") };
    let mut paths = karat::path::named("--path", &named)?;
    if names.is_empty() {
        paths.push(Path::CPU);
    }
    ensure!(!paths.is_empty(), "no execution path opens; `karat doctor` tells why");
    if named.trim() != "all" {
        return Ok(paths);
    }
    // Unless they are asked for, paths without f16 are left out where it is needed.
    let able = |path: &Path| {
        !matches!(karat::executor::call(probed, *path, &[]), Err(ProbeError::F16 { .. }))
    };
    let able: Vec<_> = paths.into_iter().filter(able).collect();
    ensure!(!able.is_empty(), "`{}` needs f16, which no path has", probed.function().name);
    Ok(able)
}

fn single(probed: &Probed, paths: &[Path], args: &Args, out: &mut dyn Write) -> Outcome {
    let arguments = &args.arguments;
    let function = probed.function();
    let expected = function.parameters.len();
    ensure!(
        arguments.len() == expected,
        "`{}` takes {expected} arguments, not {}\n  {function}",
        function.name,
        arguments.len()
    );
    let mut lanes = Vec::new();
    for (text, (name, shape)) in arguments.iter().zip(&function.parameters) {
        let words: Vec<&str> = text.split(',').collect();
        let scalars = shape.lanes();
        ensure!(
            words.len() == scalars.len(),
            "argument `{name}` is a {shape} of {} components, `{text}` has {}",
            scalars.len(),
            words.len()
        );
        for (word, scalar) in words.iter().zip(scalars) {
            lanes.push(parse(word, scalar).with_context(|| format!("argument `{name}`"))?);
        }
    }
    writeln!(out, "{DIM}{function}{DIM:#}")?;
    for path in paths {
        let results = karat::executor::call(probed, *path, std::slice::from_ref(&lanes))?;
        let result = results.first().context("the probe returned nothing")?;
        write!(out, "{HEAD}{path:<8}{HEAD:#} {}", function.result.format(result))?;
        let hexadecimal: Vec<String> = result
            .iter()
            .zip(function.result.lanes())
            .filter(|(_, scalar)| scalar.is_float())
            .map(|(lane, _)| hexfloat(f32::from_bits(*lane)))
            .collect();
        if !hexadecimal.is_empty() {
            write!(out, "  {DIM}{}{DIM:#}", hexadecimal.join(" "))?;
        }
        writeln!(out)?;
    }
    if args.trace {
        trace::write_text(probed, &lanes, out)?;
    }
    if let Some(file) = &args.html {
        trace::write_html(probed, &lanes, file)?;
    }
    Ok(Ending::Good)
}

fn table(
    probed: &Probed,
    paths: &[Path],
    input: &FilePath,
    output: Option<&FilePath>,
    out: &mut dyn Write,
) -> Outcome {
    let function = probed.function();
    let columns = columns(function);
    ensure!(
        !columns.is_empty(),
        "`{}` takes no arguments, so a table has no columns",
        function.name
    );
    let rows = read(input, &columns)?;
    ensure!(!rows.is_empty(), "`{}` holds no case", input.display());

    let steps = (rows.len() * paths.len()) as u64;
    let bar = ProgressBar::new(steps).with_style(
        ProgressStyle::with_template("{bar:40} {human_pos} of {human_len} cases, {eta} left")
            .expect("the template is valid"),
    );
    let mut results: Vec<Vec<Vec<u32>>> = Vec::new();
    for path in paths {
        let mut values = Vec::with_capacity(rows.len());
        for batch in rows.chunks(STEP) {
            values.extend(karat::executor::call(probed, *path, batch)?);
            bar.inc(batch.len() as u64);
        }
        results.push(values);
    }
    bar.finish_and_clear();

    let mut head: Vec<String> = columns.iter().map(|(name, _)| name.clone()).collect();
    for path in paths {
        let lanes = function.result.lane_names().into_iter();
        head.extend(lanes.map(|lane| format!("{path}{lane}")));
    }
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(&head)?;
    let scalars = function.result.lanes();
    for (index, row) in rows.iter().enumerate() {
        let inputs =
            row.iter().zip(&columns).map(|(lane, (_, scalar))| format_lane(*scalar, *lane));
        let values = results.iter().flat_map(|values| {
            values[index].iter().zip(&scalars).map(|(lane, scalar)| format_lane(*scalar, *lane))
        });
        writer.write_record(inputs.chain(values))?;
    }
    let bytes = writer.into_inner().context("a table in memory")?;
    match output {
        Some(path) => write_whole(path, &bytes)
            .with_context(|| format!("can't write `{}`", path.display()))?,
        None => out.write_all(&bytes)?,
    }
    Ok(Ending::Good)
}

/// Name and type of each scalar that a case consists of.
fn columns(function: &Function) -> Vec<(String, Scalar)> {
    let of = |(name, shape): &(String, Shape)| {
        let lanes = shape.lane_names().into_iter().map(|lane| format!("{name}{lane}"));
        lanes.zip(shape.lanes()).collect::<Vec<_>>()
    };
    function.parameters.iter().flat_map(of).collect()
}

fn read(input: &FilePath, columns: &[(String, Scalar)]) -> anyhow::Result<Vec<Vec<u32>>> {
    let shown = input.display();
    let text = text(input)?;
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true) // each row is compared with the signature, not with the row above it
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(text.as_bytes());
    let mut order: Vec<usize> = (0..columns.len()).collect();
    let mut rows = Vec::new();
    for (index, record) in reader.records().enumerate() {
        let record = record.with_context(|| format!("in `{shown}`"))?;
        let line = || line(&text, &record);
        let names = || columns.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(",");
        ensure!(
            record.len() == columns.len(),
            "`{shown}` line {} has {} columns, a case has {}: {}",
            line(),
            record.len(),
            columns.len(),
            names()
        );
        // A head names the columns, in any order.
        if index == 0 && record.iter().any(is_name) {
            for (place, word) in record.iter().enumerate() {
                let column = columns.iter().position(|(name, _)| name == word);
                let Some(column) = column else {
                    bail!("`{shown}` has a column `{word}`; the columns are {}", names());
                };
                let again = record.iter().take(place).any(|before| before == word);
                ensure!(!again, "`{shown}` has two columns `{word}`; the columns are {}", names());
                order[column] = place;
            }
            continue;
        }
        ensure!(
            rows.len() < MOST_CASES,
            "`{shown}` has more than {MOST_CASES} cases: evaluate it in parts"
        );
        let lanes = columns.iter().zip(&order).map(|((name, scalar), place)| {
            parse(&record[*place], *scalar)
                .with_context(|| format!("`{shown}` line {}, column `{name}`", line()))
        });
        rows.push(lanes.collect::<anyhow::Result<_>>()?);
    }
    Ok(rows)
}

/// A table as text, if it has an end.
fn text(input: &FilePath) -> anyhow::Result<String> {
    let shown = input.display();
    let failed = || format!("can't read `{shown}`");
    let file = File::open(input).with_context(failed)?;
    let announced = file.metadata().with_context(failed)?.len();
    let mut text = String::new();
    let mut length = announced;
    if announced <= LONGEST {
        // A device or a pipe announces nothing, and may never end.
        length = file.take(LONGEST + 1).read_to_string(&mut text).with_context(failed)? as u64;
    }
    ensure!(
        length <= LONGEST,
        "`{shown}` is longer than {} MB: evaluate it in parts",
        LONGEST >> 20
    );
    Ok(text)
}

/// Whether a word of a table's first row is a name: it reads as no value of any type.
fn is_name(word: &str) -> bool {
    word.parse::<f64>().is_err() && word.parse::<bool>().is_err()
}

/// The line of a record, from 1. A record's position is where its reader stood before it: comments
/// and empty lines may follow.
fn line(text: &str, record: &csv::StringRecord) -> usize {
    let start = record.position().map_or(0, |position| position.byte() as usize);
    let rest = text.get(start..).unwrap_or_default();
    let skipped = rest
        .split_inclusive('\n')
        .take_while(|line| line.starts_with('#') || line.trim_end_matches(['\r', '\n']).is_empty());
    let start = start + skipped.map(str::len).sum::<usize>();
    text.get(..start).unwrap_or_default().matches('\n').count() + 1
}

/// A scalar's lane. Decimals are rounded to the nearest f32, which the shortest decimals of that
/// f32 name exactly.
fn parse(word: &str, scalar: Scalar) -> anyhow::Result<u32> {
    let word = word.trim();
    let bad = || format!("`{word}` isn't a value of type {}", scalar.wgsl());
    Ok(match scalar {
        Scalar::F32 | Scalar::F16 => {
            let value: f32 = word.parse().with_context(bad)?;
            let value = match scalar {
                Scalar::F16 => half::f16::from_f32(value).to_f32(),
                _ => value,
            };
            // An infinity is written `inf`: digits that overflow are a slip.
            let digits = word.contains(|c: char| c.is_ascii_digit());
            ensure!(value.is_finite() || !digits, "`{word}` is too large for {}", scalar.wgsl());
            value.to_bits()
        }
        Scalar::I32 => word.parse::<i32>().with_context(bad)?.cast_unsigned(),
        Scalar::U32 => word.parse::<u32>().with_context(bad)?,
        Scalar::Bool => u32::from(word.parse::<bool>().with_context(bad)?),
    })
}
