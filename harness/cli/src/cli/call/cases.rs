//! `karat call --table`: calls a function for each row of a table, and with `--expect` compares the results with a
//! column of the table.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path as FilePath;

use anyhow::{Context, bail, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use karat::fixture::Fixtures;
use karat::unstable::image::write_whole;
use karat::unstable::interpret::asserted::printed;
use karat::unstable::output::{counted, tell};
use karat::unstable::probe::{ProbeError, Probed};
use karat::unstable::reflect::Function;
use karat::unstable::value::{Scalar, Shape};
use karat::unstable::value::{format_f32, format_lane, hexfloat};
use karat::{Path, Tolerance};
use karat_suite::{Places, Wanted, begins_with_mark, head_of, line_of};

use super::arguments::parse;
use super::{BAD, Ending, Outcome};

/// The number of rows that Karat runs between two updates of the progress bar.
const STEP: usize = 65_536;
/// The largest size of a table, in bytes. The size is limited because the table and all results stay in memory until
/// Karat writes the output.
const LONGEST: u64 = 256 << 20;
const MOST_CASES: usize = 1 << 22;
/// The largest number of failing rows that Karat prints.
const SHOWN: usize = 10;

pub(super) struct Request<'a> {
    pub(super) probed: &'a Probed,
    pub(super) fixtures: &'a Fixtures,
    pub(super) paths: &'a [Path],
    /// The file for the results. `None` means standard output.
    pub(super) output: Option<&'a FilePath>,
    /// `true` if floats are written in hexadecimal.
    pub(super) exact: bool,
    /// The name of the column with the expected results, and the tolerance.
    pub(super) expect: Option<(&'a str, Tolerance)>,
}

#[derive(Default)]
struct Table {
    rows: Vec<Vec<u32>>,
    text: String,
    /// The byte offset of each row in the file.
    starts: Vec<usize>,
    /// The expected results of each row.
    expected: Vec<Vec<f64>>,
    /// The columns that aren't arguments. Each entry has the column's name, and the column's cell in each row.
    others: Vec<(String, Vec<String>)>,
}

pub(super) fn evaluate(request: &Request<'_>, input: &FilePath, out: &mut dyn Write) -> Outcome {
    let function = request.probed.function();
    let columns = columns(function);
    ensure!(
        !columns.is_empty(),
        "the function `{}` has no parameters, so a table can't set its arguments: remove --table",
        function.name
    );
    let table = read(input, &columns, function, request.expect.as_ref())?;
    ensure!(!table.rows.is_empty(), "the table `{}` has no cases", input.display());
    let given = results(request, &table.rows)?;
    eprint!("{}", given.printed);
    match &request.expect {
        None => {
            write_table(request, &table.rows, &given.results, &table.others, out)?;
            given.ending()
        }
        Some((_, tolerance)) => {
            if request.output.is_some() {
                write_table(request, &table.rows, &given.results, &table.others, out)?;
            }
            let ending = compare(request, &columns, &table, &given.results, tolerance, input, out)?;
            let asserted = given.ending()?;
            Ok(if matches!(asserted, Ending::Good) { ending } else { asserted })
        }
    }
}

/// A path with its results: for each case, the lanes of the result.
pub(super) type OfPath = (Path, Vec<Vec<u32>>);

/// The results of all paths.
pub(super) struct Given {
    pub(super) results: Vec<OfPath>,
    /// The paths without results, each with its error.
    stopped: Vec<(Path, ProbeError)>,
    /// The output of the shader's `karat: print` lines.
    pub(super) printed: String,
    /// An error with the first assertion in the shader that fails for a row, or `Ok` if no assertion fails.
    asserted: Result<(), ProbeError>,
}

impl Given {
    /// Returns the command's outcome: an error if a path has no results, and [`Ending::Bad`] if an assertion of the
    /// shader failed. Prints the failed assertion. Call this function after you have printed the results.
    pub(super) fn ending(&self) -> Outcome {
        let told = |(path, error): &(Path, ProbeError)| {
            let error = error.to_string();
            format!("path `{path}` returned no result: {}", error.trim_start_matches("error: "))
        };
        let told: Vec<String> = self.stopped.iter().map(told).collect();
        ensure!(told.is_empty(), "{}", told.join("\n"));
        match &self.asserted {
            Ok(()) => Ok(Ending::Good),
            Err(ProbeError::Asserted(found)) => {
                tell(&found.to_string());
                Ok(Ending::Bad)
            }
            Err(other) => bail!("{other}"),
        }
    }
}

/// Calls the function for each row on each path. If a path fails, the other paths still run. If all paths fail, returns
/// an error.
pub(super) fn results(request: &Request<'_>, rows: &[Vec<u32>]) -> anyhow::Result<Given> {
    let steps = (rows.len() * request.paths.len()) as u64;
    let bar = ProgressBar::new(steps).with_style(
        ProgressStyle::with_template("{bar:40} {human_pos} of {human_len} cases, {eta} left")
            .expect("the template is valid"),
    );
    let of = |path: Path| {
        let mut values = Vec::with_capacity(rows.len());
        for batch in rows.chunks(STEP) {
            let fixtures = request.fixtures;
            values.extend(karat::unstable::executor::call(request.probed, path, batch, fixtures)?);
            bar.inc(batch.len() as u64);
        }
        Ok::<_, ProbeError>(values)
    };
    let (mut results, mut stopped) = (Vec::new(), Vec::new());
    for path in request.paths {
        match of(*path) {
            Ok(values) => results.push((*path, values)),
            Err(error) => stopped.push((*path, error)),
        }
    }
    bar.finish_and_clear();
    if results.is_empty() && !stopped.is_empty() {
        let mut told: Vec<String> = stopped.iter().map(|(_, error)| error.to_string()).collect();
        told.dedup();
        match &*told {
            [_] => return Err(stopped.swap_remove(0).1.into()),
            _ => bail!("{}", told.join("\n")),
        }
    }
    let (printed, asserted) = printed(request.probed, request.fixtures, rows);
    Ok(Given { results, stopped, printed, asserted })
}

/// Formats a lane: if `exact`, as a hexadecimal float, and otherwise as the shortest decimal that gives the same bits
/// again when it is parsed.
fn shown(scalar: Scalar, lane: u32, exact: bool) -> String {
    match exact && scalar.is_float() {
        true => hexfloat(f32::from_bits(lane)),
        false => format_lane(scalar, lane),
    }
}

/// Formats an expected value. If the value is exactly an `f32`, writes only as many digits as identify this `f32`.
fn wanted(scalar: Scalar, value: f64) -> String {
    #[expect(clippy::cast_possible_truncation, reason = "it is compared")]
    let single = value as f32;
    match scalar.is_float() && f64::from(single).to_bits() == value.to_bits() {
        true => format_f32(single),
        false => value.to_string(),
    }
}

/// Writes the arguments and the results as a table (CSV), with a column for each scalar of each path's result.
pub(super) fn write_table(
    request: &Request<'_>,
    rows: &[Vec<u32>],
    results: &[OfPath],
    others: &[(String, Vec<String>)],
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let (function, exact) = (request.probed.function(), request.exact);
    let columns = columns(function);
    let mut head: Vec<String> = columns.iter().map(|(name, _)| name.clone()).collect();
    let mut results_head = Vec::new();
    for (path, _) in results {
        let lanes = function.result.lane_names().into_iter();
        results_head.extend(lanes.map(|lane| format!("{path}{lane}")));
    }
    // A table that this command wrote already has columns of these names.
    let carried = |name: &String| match results_head.contains(name) {
        true => format!("given.{name}"),
        false => name.clone(),
    };
    head.extend(others.iter().map(|(name, _)| carried(name)));
    head.extend(results_head.iter().cloned());
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(&head)?;
    let scalars = function.result.lanes();
    for (index, row) in rows.iter().enumerate() {
        let inputs =
            row.iter().zip(&columns).map(|(lane, (_, scalar))| shown(*scalar, *lane, exact));
        let others = others.iter().map(|(_, words)| words[index].clone());
        let values = results.iter().flat_map(|(_, values)| {
            let lanes = values[index].iter().zip(&scalars);
            lanes.map(|(lane, scalar)| shown(*scalar, *lane, exact))
        });
        writer.write_record(inputs.chain(others).chain(values))?;
    }
    let bytes = writer.into_inner().context("can't make the table of results")?;
    match request.output {
        Some(path) => write_whole(path, &bytes)
            .with_context(|| format!("can't write `{}`", path.display()))?,
        None => out.write_all(&bytes)?,
    }
    Ok(())
}

/// Compares the results of each path with the expected values, and prints the first rows that differ.
fn compare(
    request: &Request<'_>,
    columns: &[(String, Scalar)],
    table: &Table,
    results: &[OfPath],
    tolerance: &Tolerance,
    input: &FilePath,
    out: &mut dyn Write,
) -> Outcome {
    let function = request.probed.function();
    let (scalars, names) = (function.result.lanes(), function.result.lane_names());
    let mut ending = Ending::Good;
    for (path, values) in results {
        let mut failing = 0;
        for (index, (actual, expected)) in values.iter().zip(&table.expected).enumerate() {
            let (lane, error) = tolerance.measure_words(&scalars, actual, expected);
            if error.passes() {
                continue;
            }
            failing += 1;
            if failing > SHOWN {
                continue;
            }
            let arguments = table.rows[index].iter().zip(columns);
            let arguments = arguments
                .map(|(lane, (name, scalar))| format!("{name} = {}", format_lane(*scalar, *lane)));
            writeln!(
                out,
                "{BAD}{path} {}:{}{BAD:#}  {}: result{} = {}, expected {}, error {error}",
                input.display(),
                line_of(table.text.as_bytes(), table.starts[index]),
                arguments.collect::<Vec<_>>().join(", "),
                names[lane],
                shown(scalars[lane], actual[lane], request.exact),
                wanted(scalars[lane], expected[lane]),
            )?;
        }
        let count = table.rows.len();
        match failing {
            0 if count == 1 => {
                writeln!(out, "{path}: the row agrees with the shader ({tolerance})")?
            }
            0 => writeln!(out, "{path}: all {count} rows agree with the shader ({tolerance})")?,
            _ => {
                writeln!(
                    out,
                    "{path}: {failing} of {count} rows differ from the shader ({tolerance})"
                )?;
                ending = Ending::Bad;
            }
        }
    }
    Ok(ending)
}

/// Returns the columns that a table of cases needs: the name and the type of each scalar of the function's arguments.
pub(super) fn columns(function: &Function) -> Vec<(String, Scalar)> {
    let of = |(name, shape): &(String, Shape)| {
        let lanes = shape.lane_names().into_iter().map(|lane| format!("{name}{lane}"));
        lanes.zip(shape.lanes()).collect::<Vec<_>>()
    };
    function.parameters.iter().flat_map(of).collect()
}

fn names(columns: &[(String, Scalar)]) -> String {
    columns.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(",")
}

/// Returns, for each argument, `true` if the table has columns for the argument's derivatives: for the argument `x`
/// these are `x.value`, `x.dx` and `x.dy`.
pub(super) fn varying(input: &FilePath, function: &Function) -> anyhow::Result<Vec<bool>> {
    let text = text(input)?;
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(&text.as_bytes()[head_of(text.as_bytes())..]);
    let head = reader.records().next().transpose()?.unwrap_or_default();
    let of = |(name, _): &(String, Shape)| {
        head.iter().any(|column| column.starts_with(&format!("{name}.value")))
    };
    Ok(function.parameters.iter().map(of).collect())
}

fn read(
    input: &FilePath,
    columns: &[(String, Scalar)],
    function: &Function,
    expect: Option<&(&str, Tolerance)>,
) -> anyhow::Result<Table> {
    let near = expect.map_or(Wanted::Near, |(_, tolerance)| Wanted::from(tolerance));
    let expect = expect.map(|(name, _)| *name);
    let shown = input.display();
    let text = text(input)?;
    let above = head_of(text.as_bytes());
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true) // the length of each row is checked against the signature
        .trim(csv::Trim::All)
        .from_reader(&text.as_bytes()[above..]);
    let lanes = function.result.lane_names().into_iter();
    let expected: Vec<String> =
        expect.map_or_else(Vec::new, |name| lanes.map(|lane| format!("{name}{lane}")).collect());
    let mut places = Places {
        arguments: (0..columns.len()).collect(),
        expected: Vec::new(),
        others: Vec::new(),
    };
    let mut headed = false;
    let mut width = columns.len();
    let mut table = Table::default();
    let mut record = csv::StringRecord::new();
    for index in 0.. {
        if !reader.read_record(&mut record).with_context(|| format!("can't read `{shown}`"))? {
            break;
        }
        let start = above + record.position().map_or(0, |position| position.byte() as usize);
        let line = || line_of(text.as_bytes(), start);
        ensure!(
            !begins_with_mark(text.as_bytes(), start),
            "`{shown}` line {} begins with `#`, but comments are allowed only above the header: remove the line, or quote its \
             first cell",
            line()
        );
        if index == 0 && record.iter().any(is_name) {
            if let Some(both) = expected.iter().find(|name| columns.iter().any(|(c, _)| c == *name))
            {
                bail!(
                    "--expect can't name the column `{both}`: this column has the values of an argument"
                );
            }
            let head: Vec<&str> = record.iter().collect();
            let own: Vec<&str> = columns.iter().map(|(name, _)| &**name).collect();
            let expected: Vec<&str> = expected.iter().map(String::as_str).collect();
            places = Places::of_head(&head, &own, &expected)
                .map_err(|why| anyhow::anyhow!("`{shown}` {why}"))?;
            let others = places.others.iter().map(|(name, _)| (name.clone(), Vec::new()));
            table.others = others.collect();
            (headed, width) = (true, record.len());
            continue;
        }
        ensure!(
            headed || expect.is_none(),
            "the table `{shown}` has no header, so --expect finds no column `{}`: write the columns' names in the first line",
            expect.unwrap_or_default()
        );
        ensure!(
            record.len() == width,
            "`{shown}` line {} has {own}, but {needs} {width}: {names}",
            line(),
            own = counted(record.len(), "column"),
            needs = if width == columns.len() { "a case needs" } else { "the header has" },
            names = names(columns)
        );
        ensure!(
            table.rows.len() < MOST_CASES,
            "the table `{shown}` has more than {MOST_CASES} cases: split the table into several files"
        );
        let at = |name: &str| format!("`{shown}` line {}, column `{name}`", line());
        let row = columns.iter().zip(&places.arguments).map(|((name, scalar), place)| {
            parse(&record[*place], *scalar).with_context(|| at(name))
        });
        table.rows.push(row.collect::<anyhow::Result<_>>()?);
        table.starts.push(start);
        let scalars = function.result.lanes();
        let wanted = places.expected.iter().zip(&expected).zip(scalars);
        let wanted = wanted.map(|((place, name), scalar)| {
            let word = record[*place].trim();
            let value = karat_suite::expected(scalar, word, near);
            value.map_err(anyhow::Error::msg).with_context(|| at(name))
        });
        table.expected.push(wanted.collect::<anyhow::Result<_>>()?);
        for ((_, place), (_, words)) in places.others.iter().zip(&mut table.others) {
            words.push(record[*place].to_owned());
        }
    }
    drop(reader);
    table.text = text;
    Ok(table)
}

/// Reads the text of a table, or returns an error if the table is larger than [`LONGEST`].
fn text(input: &FilePath) -> anyhow::Result<String> {
    let shown = input.display();
    let failed = || format!("can't read `{shown}`");
    let file = File::open(input).with_context(failed)?;
    let announced = file.metadata().with_context(failed)?.len();
    let mut text = String::new();
    let mut length = announced;
    if announced <= LONGEST {
        // A pipe or a device file has no known size, and may have no end.
        length = file.take(LONGEST + 1).read_to_string(&mut text).with_context(failed)? as u64;
    }
    ensure!(
        length <= LONGEST,
        "the table `{shown}` is longer than {} MB: split the table into several files",
        LONGEST >> 20
    );
    Ok(text)
}

/// Checks if a cell of a table's first row is a name, and neither a number nor a boolean.
fn is_name(word: &str) -> bool {
    word.parse::<f64>().is_err() && word.parse::<bool>().is_err()
}

#[cfg(test)]
mod tests {
    use super::*;
    use karat::{Abs, Package};

    /// Karat must compare the results of every path with the expected values, and not only those of the first path.
    // Lesson 172
    #[test]
    fn rows_that_differ_only_on_the_second_path_fail() {
        let package = Package::from_source("m", "fn twice(x: f32) -> f32 { return 2.0 * x; }");
        let probed = Probed::new(&package, "twice").expect("valid");
        let (fixtures, paths) = (Fixtures::new(), [Path::CPU, Path::VULKAN]);
        let (probed, fixtures, tolerance) = (&probed, &fixtures, Tolerance::from(Abs(0.0)));
        let expect = Some(("wanted", tolerance.clone()));
        let paths = &paths[..];
        let request = Request { probed, fixtures, paths, output: None, exact: false, expect };
        let row = |x: f32| vec![x.to_bits()];
        let table = Table {
            rows: vec![row(1.0), row(2.0)],
            text: "x,wanted\n1,2\n2,4\n".to_owned(),
            starts: vec![9, 13],
            expected: vec![vec![2.0], vec![4.0]],
            others: Vec::new(),
        };
        let columns = columns(probed.function());
        let right = vec![row(2.0), row(4.0)];
        for wrong in [None, Some(0), Some(1)] {
            let mut results: Vec<OfPath> =
                paths.iter().map(|path| (*path, right.clone())).collect();
            if let Some(wrong) = wrong {
                results[wrong].1[1] = row(5.0);
            }
            let mut out = Vec::new();
            let input = FilePath::new("t.csv");
            let ending = compare(&request, &columns, &table, &results, &tolerance, input, &mut out);
            let text = String::from_utf8_lossy(&out).into_owned();
            let good = if wrong.is_some() { Ending::Bad } else { Ending::Good };
            assert_eq!(ending.expect("it is written"), good, "{text}");
            let guilty = wrong.map(|path| format!("{}: 1 of 2 rows differ", paths[path]));
            assert!(guilty.is_none_or(|guilty| text.contains(&guilty)), "{text}");
        }
    }

    // Lesson 172
    #[test]
    fn a_path_without_results_is_bad() {
        let (path, expected, found) = (Path::VULKAN, 1, 0);
        let stopped = vec![(path, ProbeError::Length { path, expected, found })];
        let given = Given {
            results: vec![(Path::CPU, Vec::new())],
            stopped,
            printed: String::new(),
            asserted: Ok(()),
        };
        let error = given.ending().expect_err("a path has no result").to_string();
        assert!(
            error.starts_with(
                "path `vulkan` returned no result: path `vulkan` returned 0 u32 words"
            ),
            "{error}"
        );
    }
}
