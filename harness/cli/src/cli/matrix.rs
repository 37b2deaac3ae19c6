//! `karat matrix`

mod html;
mod junit;
mod reproduce;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use karat::tolerance::{Abs, Rel};
use karat::unstable::image::write_whole;
use karat::unstable::record::{Record, Recorded};
use karat_inspect::matrix::{Cell, Column, Finding, Matrix, Row, Status, Stop, restarted};

use super::project::{self, Project};
use super::table::{BAD, DIM, GOOD, HEAD, KNOWN, Table};
use super::{
    Ending, Outcome, PlaceArgs, Reported, call, is_in_package, resolved, spare_shaders, write_json,
};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Shows these columns: paths (`vulkan:hlsl`) and languages (`msl`) [default: 12 usual columns]
    #[arg(long, value_name = "COLUMNS", value_delimiter = ',')]
    columns: Vec<Column>,
    /// Fails unless every row reaches this status in this column: `vulkan:hlsl=executed`; may be a list. A row that
    /// `[[matrix]]` in `karat.toml` declares as failing in this column is exempt; if it no longer fails, the
    /// command fails
    #[arg(long, value_name = "COLUMN=STATUS", value_delimiter = ',', value_parser = requirement)]
    require: Vec<(String, Status)>,
    /// Runs only rows whose name contains this text; may be repeated
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Runs each function on this number of generated inputs
    #[arg(long, value_name = "COUNT", default_value_t = 512)]
    cases: usize,
    /// Accepts this relative or absolute difference between the results of two columns
    #[arg(long, value_name = "BOUND", default_value_t = 1e-3, value_parser = bound)]
    within: f64,
    /// Sets an `override`, by its name or its `@id`; may be repeated
    #[arg(long = "override", value_name = "NAME=VALUE")]
    overrides: Vec<String>,
    /// Prints JSON
    #[arg(long)]
    json: bool,
    /// Writes the table as Markdown to this file
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Writes an HTML page to this file: each cell with its evidence, and the translation beside the WGSL
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Writes JUnit XML to this file
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Writes a folder below DIR for each row that differs or is rejected, to attach to a bug report; DIR must be new
    /// or empty
    #[arg(long, value_name = "DIR")]
    reproduce: Option<PathBuf>,
    /// Judges functions by the verdicts of their tests on the same paths, from the record of the last run
    #[arg(long)]
    tests: bool,
    /// Before each cell runs, writes the cell's row and column to this file. If a cell ends the process, the file
    /// names this cell
    #[arg(long, hide = true)]
    journal: Option<PathBuf>,
    #[command(flatten)]
    place: PlaceArgs,
}

fn requirement(text: &str) -> Result<(String, Status), String> {
    let (column, status) = text.split_once('=').ok_or("write COLUMN=STATUS")?;
    let status = status.parse()?;
    let column: Column = column.parse()?;
    Ok((column.to_string(), status))
}

fn bound(text: &str) -> Result<f64, String> {
    let bound = text.parse().map_err(|_| "write a number such as 1e-3")?;
    let usable = |bound: &f64| *bound >= 0.0 && bound.is_finite();
    Some(bound).filter(usable).ok_or_else(|| "write a finite number of at least 0".to_owned())
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    match &args.journal {
        Some(file) => make(args, file, out),
        None => supervise(),
    }
}

/// Runs this command in a separate process. If a driver hangs or crashes and ends that process, the command starts
/// again, and skips the row that was running.
fn supervise() -> Outcome {
    let folder = tempfile::tempdir().context("can't make a temporary folder")?;
    let file = folder.path().join("journal.jsonl");
    let program = std::env::current_exe().context("can't find karat's executable file")?;
    let mut command = Command::new(program);
    command.args(std::env::args_os().skip(1)).arg("--journal").arg(&file);
    let status = restarted(&file, &mut command).context("can't run this program again")?;
    match status.code() {
        Some(0) => Ok(Ending::Good),
        Some(1) => Ok(Ending::Bad),
        Some(3) => Ok(Ending::Missing),
        Some(_) => Err(Reported.into()),
        None => bail!("the process that makes the matrix ended early: {status}"),
    }
}

fn make(args: &Args, journal: &Path, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    let packages = project.packages(&args.place.package())?;
    expect_outputs(args, &packages)?;
    let records = if args.tests { records(&project)? } else { Vec::new() };
    let mut columns = if args.columns.is_empty() { Column::usual() } else { args.columns.clone() };
    for (name, _) in &args.require {
        let column: Column = name.parse().map_err(anyhow::Error::msg)?;
        if !columns.contains(&column) {
            columns.push(column);
        }
    }
    let overrides = call::bind::overrides_in(&packages, &args.overrides)?;
    let mut matrices = Vec::new();
    for package in &packages {
        // Only terminals show the bar.
        let bar = ProgressBar::new(0).with_message(package.name());
        bar.set_style(ProgressStyle::with_template("{msg}: {pos} of {len} rows {wide_bar}")?);
        let request = karat_inspect::matrix(package)
            .columns(columns.iter().copied())
            .cases(args.cases)
            .within(Rel(args.within).or(Abs(args.within)))
            .only(args.only.iter().map(String::as_str))
            .journal(journal);
        let own = call::bind::overrides_of(package, &overrides);
        let request = own.iter().fold(request, |all, (name, x)| all.with_override(name, *x));
        let matrix = request.run_with(&|done, of| {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        });
        bar.finish_and_clear();
        let mut matrix = matrix?;
        matrix.package = project::title(package, &packages);
        matrices.push(matrix);
    }
    if args.tests {
        let judged: usize = matrices.iter_mut().map(|matrix| matrix.judge_by(&records)).sum();
        ensure!(
            judged > 0,
            "no test of the last run checked these functions in their current version on these paths: run \
             `karat test` with the columns' paths, such as KARAT_PATHS=vulkan,vulkan:hlsl"
        );
    }
    if args.json {
        write_json(&matrices, out)?;
    } else {
        for matrix in &matrices {
            write_text(matrix, out)?;
        }
    }
    write_files(args, &matrices)?;
    let mut ending = Ending::Good;
    for matrix in &matrices {
        for (column, status) in &args.require {
            if let Err(missed) = matrix.try_expect_but(column, *status, &[]) {
                ending = Ending::Bad;
                karat::unstable::output::tell(&format!("{}: {missed}", matrix.package));
            }
        }
    }
    if tell_findings(&matrices) > 0 {
        ending = Ending::Bad;
    }
    expect_no_errors(&matrices)?;
    for matrix in &matrices {
        matrix.try_expect_evidence().with_context(|| format!("`{}`", matrix.package))?;
        let named = args.columns.iter().filter(|column| column.path().is_some());
        named.map(ToString::to_string).try_for_each(|name| expect_opened(matrix, &name))?;
    }
    Ok(ending)
}

/// Returns an error if an output would overwrite shaders or another output, or if the folder of
/// `--reproduce` has files.
fn expect_outputs(args: &Args, packages: &[karat::Package]) -> anyhow::Result<()> {
    let files = [&args.markdown, &args.html, &args.junit].into_iter().flatten();
    for file in files.clone() {
        spare_shaders("table", file, packages)?;
    }
    let mut outputs: Vec<PathBuf> = Vec::new();
    for output in files.chain(&args.reproduce) {
        let whole = resolved(output);
        ensure!(
            !outputs.contains(&whole),
            "two outputs have the same file `{}`: name another file for one of the outputs",
            output.display()
        );
        outputs.push(whole);
    }
    let Some(folder) = &args.reproduce else { return Ok(()) };
    let shown = folder.display();
    if let Some(package) = packages.iter().find(|package| is_in_package(folder, package)) {
        bail!(
            "--reproduce can't write to `{shown}`, because shaders there would belong to the package `{}`: \
             name a folder outside of the package",
            package.name()
        );
    }
    let earlier = folder.read_dir().is_ok_and(|mut entries| entries.next().is_some());
    ensure!(
        !earlier && !folder.is_file(),
        "`{shown}` isn't an empty folder, and could contain files of an earlier run: \
         delete the folder, or name another folder"
    );
    Ok(())
}

/// Returns an error if the path of a requested column doesn't open. Such a column has no results.
fn expect_opened(matrix: &Matrix, name: &str) -> anyhow::Result<()> {
    let Some(index) = matrix.columns.iter().position(|head| head.name == name) else {
        return Ok(());
    };
    let absent =
        |cell: &Cell| matches!(cell.stopped, Some(Stop::Unavailable(_) | Stop::NoValidator(_)));
    let cells = || matrix.rows.iter().filter_map(|row| row.cells.get(index));
    let Some(stop) = cells().find_map(|cell| cell.stopped.as_ref().filter(|_| absent(cell))) else {
        return Ok(());
    };
    // An entry point that no path runs has another reason.
    let ran = |cell: &Cell| matches!(cell.status, Some(Status::Executed | Status::Agrees));
    let lacks_path = matches!(stop, Stop::Unavailable(_));
    ensure!(
        if lacks_path { cells().any(ran) } else { !cells().all(absent) },
        "path `{name}` doesn't open, so no row ran on this path: {}\nTo translate and validate without \
         running, name the column `{}`",
        stop.text(),
        matrix.columns[index].language
    );
    Ok(())
}

/// Lists the wrong cells, and the declared failures that no longer occur. Returns the number of listed items.
fn tell_findings(matrices: &[Matrix]) -> usize {
    let findings: Vec<Finding> = matrices.iter().flat_map(Matrix::findings).collect();
    let (outdated, wrong): (Vec<&Finding>, Vec<&Finding>) =
        findings.iter().partition(|finding| finding.outdated);
    let place = |finding: &&Finding| format!("{} on {}", finding.row, finding.column);
    let places = |findings: &[&Finding]| few(findings.iter().map(place));
    let counted = |count: usize, one: &str, many: &str| match count {
        1 => format!("one {one}"),
        count => format!("{count} {many}"),
    };
    if !wrong.is_empty() {
        karat::unstable::output::tell(&format!(
            "the matrix has {}, which `karat.toml` doesn't declare: {}",
            counted(wrong.len(), "wrong cell", "wrong cells"),
            places(&wrong)
        ));
    }
    if !outdated.is_empty() {
        karat::unstable::output::tell(&format!(
            "delete {} from `karat.toml`, because these failures are gone: {}",
            counted(outdated.len(), "declaration", "declarations"),
            few(outdated.iter().map(|finding| format!("{}: {}", place(finding), finding.why)))
        ));
    }
    findings.len()
}

/// Returns an error if Karat couldn't read a row of the matrix.
fn expect_no_errors(matrices: &[Matrix]) -> anyhow::Result<()> {
    let rows = || matrices.iter().flat_map(|m| &m.rows).filter(|row| row.is_judged());
    let Some(error) = rows().find_map(|row| row.error.as_ref()) else { return Ok(()) };
    let same = rows().filter(|row| row.error.as_ref() == Some(error));
    bail!("Karat can't read these rows: {}\n{error}", few(same.map(|row| row.name.clone())))
}

/// Formats the first four names, and the number of other names.
fn few(names: impl Iterator<Item = String>) -> String {
    let all: Vec<String> = names.collect();
    let more = all.len().saturating_sub(4);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{}{more}", all[..all.len().min(4)].join(", "))
}

fn records(project: &Project) -> anyhow::Result<Vec<Record>> {
    let folder = project.record();
    let recorded = Recorded::read(&folder)?;
    let missing =
        || format!("there is no record of a run in `{}`: run `karat test` first", folder.display());
    Ok(recorded.with_context(missing)?.records)
}

fn write_files(args: &Args, matrices: &[Matrix]) -> anyhow::Result<()> {
    let write = |file: &Option<PathBuf>, text: &dyn Fn() -> anyhow::Result<String>| match file {
        Some(file) => write_whole(file, text()?.as_bytes())
            .with_context(|| format!("can't write `{}`", file.display())),
        None => Ok(()),
    };
    let markdown = || Ok(matrices.iter().map(Matrix::markdown).collect::<Vec<_>>().join("\n"));
    write(&args.markdown, &markdown)?;
    write(&args.html, &|| html::page(matrices))?;
    write(&args.junit, &|| junit::text(matrices, &args.require))?;
    if let Some(folder) = &args.reproduce {
        let written = reproduce::write(folder, matrices)?;
        karat::unstable::output::tell(&format!(
            "folders that Karat wrote for bug reports: {}, in `{}`",
            written.len(),
            folder.display()
        ));
    }
    Ok(())
}

fn write_text(matrix: &Matrix, out: &mut dyn Write) -> anyhow::Result<()> {
    writeln!(out, "{HEAD}{}{HEAD:#}, naga {}", matrix.package, matrix.naga)?;
    for head in &matrix.columns {
        let what = match (&head.adapter, &head.unavailable) {
            (Some(adapter), _) => adapter.clone(),
            (None, why) => why.clone().unwrap_or_default(),
        };
        writeln!(out, "{DIM}{:<12} {}: {what}{DIM:#}", head.name, head.language)?;
    }
    writeln!(out)?;
    let mut names = vec![""];
    names.extend(matrix.columns.iter().map(|head| head.name.as_str()));
    let mut table = Table::new(&names, &[]);
    for row in &matrix.rows {
        let mut cells = vec![format!("{} ({})", row.name, row.kind)];
        cells.extend(row.cells.iter().map(|cell| shown(cell, row, matrix.cases)));
        let style = match () {
            () if row.error.is_some() => DIM,
            () if row.cells.iter().any(is_bad) => BAD,
            () if row.cells.iter().all(|c| c.status == Some(Status::Agrees)) => GOOD,
            () => KNOWN,
        };
        table.row(style, cells);
    }
    table.write(out)?;
    writeln!(out, "\n{}", summary(matrix))?;
    for (why, rows) in matrix.reasons() {
        writeln!(out, "\n{why}\n{DIM}  {}{DIM:#}", few(rows.into_iter()))?;
    }
    for row in &matrix.rows {
        for (column, allowed) in row.columns_outside() {
            let (head, name) = (&matrix.columns[column].name, &row.name);
            let (outside, first) = (allowed.outside, allowed.first.as_deref().unwrap_or_default());
            writeln!(
                out,
                "\ncolumn `{head}`: WGSL doesn't allow {outside} of the results: {first}\n{DIM}  {name}{DIM:#}"
            )?;
        }
    }
    if !matrix.undecided.is_empty() {
        let mut columns: Vec<&str> = matrix.undecided.iter().map(|k| k.column.as_str()).collect();
        columns.dedup();
        let (count, columns) = (matrix.undecided.len(), columns.join("`, `"));
        writeln!(
            out,
            "\n{DIM}not checked: declared failures on `{columns}` ({count}), because this machine can't test them{DIM:#}"
        )?;
    }
    Ok(())
}

/// Formats the status of a cell. If a function's results agree, but fewer than half of the cases were compared, adds
/// the number of compared cases. If results differ where WGSL allows several results, also adds the number of these
/// differences.
fn shown(cell: &Cell, row: &Row, cases: usize) -> String {
    let few = row.kind == "function" && cell.compared * 2 < cases;
    let word = match cell.status {
        Some(Status::Agrees) if few => format!("{} in {}", cell.word(), cell.compared),
        _ => cell.word().to_owned(),
    };
    match cell.open {
        0 => word,
        open => format!("{word}, {open} open"),
    }
}

fn is_bad(cell: &Cell) -> bool {
    let wrong = |stop: &Stop| stop.is_wrong() || matches!(stop, Stop::Unsupported(_));
    cell.fails_as_declared().is_none() && cell.stopped.as_ref().is_some_and(wrong)
}

/// Counts the rows of each status in each column.
fn summary(matrix: &Matrix) -> String {
    let judged = matrix.rows.iter().filter(|row| row.is_judged()).count();
    let lines = matrix.columns.iter().enumerate().map(|(index, head)| {
        let counts = Status::ALL.map(|status| format!("{} {status}", matrix.count(index, status)));
        format!("{:<12} {}", head.name, counts.join(", "))
    });
    let lines: Vec<String> = lines.collect();
    let skipped = matrix.rows.len() - judged;
    let open = matrix.open().map_or_else(String::new, |text| format!("\n{text}"));
    let lines = lines.join("\n");
    format!("status of {judged} rows (Karat can't call {skipped} functions):\n{lines}{open}")
}
