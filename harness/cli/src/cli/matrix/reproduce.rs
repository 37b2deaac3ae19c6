//! Folders with the evidence of wrong cells, to attach to bug reports.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use karat::unstable::image::write_whole;
use karat_inspect::matrix::{Cell, Divergence, Head, Matrix, Row, Stop};
use serde_json::json;

/// Writes a folder for each cell that differs, is rejected or crashed a validator. Returns the folders.
pub(super) fn write(folder: &Path, matrices: &[Matrix]) -> anyhow::Result<Vec<PathBuf>> {
    let mut written = Vec::new();
    for matrix in matrices {
        for row in &matrix.rows {
            for (head, cell) in matrix.columns.iter().zip(&row.cells) {
                if !cell.stopped.as_ref().is_some_and(Stop::is_wrong) {
                    continue;
                }
                let name = format!("{}@{}", row.name.replace("::", "."), head.name);
                let place = folder.join(matrix.package.as_str()).join(plain(&name));
                one(&place, matrix, row, head, cell)
                    .with_context(|| format!("can't write `{}`", place.display()))?;
                written.push(place);
            }
        }
    }
    Ok(written)
}

/// Returns a file name that has `-` in place of special characters, such as `:` and `/`.
fn plain(name: &str) -> String {
    let kept = |c: char| if c.is_alphanumeric() || "._@-".contains(c) { c } else { '-' };
    name.chars().map(kept).collect()
}

fn one(place: &Path, matrix: &Matrix, row: &Row, head: &Head, cell: &Cell) -> anyhow::Result<()> {
    std::fs::create_dir_all(place)?;
    let file = |name: &str, bytes: &[u8]| write_whole(&place.join(name), bytes);
    file("shader.wgsl", row.text.as_bytes())?;
    let mut files = vec![(
        "shader.wgsl".to_owned(),
        if row.kind == "function" {
            "the function with everything that it uses, and the kernel that calls the function: `karat_in` contains \
             the arguments as 32-bit words, `karat_out` contains the results, with a canary after each case"
        } else {
            "the linked text of the entry point"
        }
        .to_owned(),
    )];
    let baseline = cell.against.as_deref();
    let columns = matrix.columns.iter().zip(&row.cells);
    for (head, cell) in columns.filter(|(h, _)| h.name == head.name || Some(&*h.name) == baseline) {
        let column = plain(&head.name);
        let name = format!("{column}/shader.{}", extension(&head.language));
        if let Some(code) = &cell.code {
            std::fs::create_dir_all(place.join(column))?;
            file(&name, &code.bytes())?;
            files.push((name, format!("naga's translation on `{}`", head.name)));
        }
    }
    if cell.divergence.is_some() || !row.buffers.is_empty() {
        let text = serde_json::to_string_pretty(&values(row, cell))?;
        file("values.json", text.as_bytes())?;
        files.push(("values.json".to_owned(), "inputs and results, as 32-bit words".to_owned()));
    }
    let text = readme(matrix, row, head, cell, &files)?;
    // Texts of authors and messages of validators may contain control characters.
    file("README.md", karat::unstable::output::visible(&text).as_bytes())?;
    Ok(())
}

/// Returns the file extension of a language.
fn extension(language: &str) -> &str {
    match language {
        "spirv" => "spv",
        "glsl-es" => "glsl",
        "hlsl6" => "hlsl",
        "msl" => "metal",
        other => other,
    }
}

fn hex(words: &[u32]) -> Vec<String> {
    words.iter().map(|word| format!("{word:#010x}")).collect()
}

fn values(row: &Row, cell: &Cell) -> serde_json::Value {
    let buffers = row.buffers.iter().map(|buffer| {
        let words: Vec<u32> =
            buffer.bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
        json!({ "group": buffer.group, "binding": buffer.binding, "words": hex(&words) })
    });
    let divergence = cell.divergence.as_ref().map(|found| {
        json!({
            "arguments": hex(&found.words),
            "result": hex(&found.results.0),
            "result_of_baseline": hex(&found.results.1),
        })
    });
    json!({ "case": divergence, "buffers": buffers.collect::<Vec<_>>() })
}

fn readme(
    matrix: &Matrix,
    row: &Row,
    head: &Head,
    cell: &Cell,
    files: &[(String, String)],
) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    let verb = match cell.stopped {
        Some(Stop::Differs(_)) => "differs",
        Some(Stop::Rejected(_)) => "is rejected",
        Some(Stop::Panicked(_)) => "makes naga panic",
        _ => "gets no verdict",
    };
    writeln!(text, "# `{}` {verb} on `{}`\n", row.name, head.name)?;
    let why = cell.stopped.as_ref().map_or("", Stop::text);
    writeln!(text, "{}\n", fenced("text", why))?;
    writeln!(text, "- naga {}, {}", matrix.naga, cell.options)?;
    let baseline = cell.against.as_deref();
    for one in &matrix.columns {
        if let (true, Some(adapter)) =
            (one.name == head.name || Some(&*one.name) == baseline, &one.adapter)
        {
            writeln!(text, "- column `{}` ran on {adapter}", one.name)?;
        }
    }
    if let Some(found) = &cell.divergence {
        write_divergence(&mut text, head, found)?;
    }
    let source = &row.source;
    writeln!(text, "\n## The shader's source\n\n`{}:{}`\n", source.file, source.line)?;
    writeln!(text, "{}", fenced("wgsl", &source.text))?;
    writeln!(text, "\n## Files\n")?;
    for (name, what) in files {
        writeln!(text, "- `{name}`: {what}")?;
    }
    if !cell.validators.is_empty() {
        writeln!(text, "\n## Commands\n\nIn `{}`:\n", plain(&head.name))?;
        for said in &cell.validators {
            let (command, version) = (&said.command, &said.version);
            writeln!(text, "```sh\n{command}   # {version}\n```\n")?;
            writeln!(text, "{}\n", fenced("text", &said.verdict))?;
        }
    }
    let all = baseline.into_iter().chain([&*head.name]).collect::<Vec<_>>().join(",");
    writeln!(text, "Repeat the run with `karat matrix --shaders shader.wgsl --columns {all}`.")?;
    Ok(text)
}

/// Returns a block of code. Its fence is longer than any sequence of backticks in the code.
fn fenced(language: &str, text: &str) -> String {
    let longest = text.split(|c| c != '`').map(str::len).max().unwrap_or(0);
    let fence = "`".repeat(3.max(longest + 1));
    format!("{fence}{language}\n{}\n{fence}", text.trim())
}

fn write_divergence(text: &mut String, head: &Head, found: &Divergence) -> std::fmt::Result {
    let title = if found.alone { "The simplest input" } else { "An input" };
    writeln!(text, "\n## {title}\n\n| argument | value |\n|---|---|")?;
    for (name, value) in &found.arguments {
        writeln!(text, "| `{name}` | {value} |")?;
    }
    writeln!(text, "\nAs 32-bit words: {}\n", hex(&found.words).join(" "))?;
    writeln!(text, "| column | result | words |\n|---|---|---|")?;
    let (here, there) = (hex(&found.results.0).join(" "), hex(&found.results.1).join(" "));
    writeln!(text, "| `{}` | {} | {here} |", head.name, found.here)?;
    writeln!(text, "| `{}` | {} | {there} |", found.baseline, found.there)?;
    if !found.alone {
        writeln!(
            text,
            "\nThe two columns differ only if the kernel also runs other inputs: for this input alone, their results are \
             equal. The results above are from a run of all generated inputs, which are the same in each run."
        )?;
        return Ok(());
    }
    match &found.first {
        Some(first) => {
            let place = first.location.as_ref().map_or_else(String::new, |at| format!(" at {at}"));
            writeln!(
                text,
                "\nThe first value that differs is `{}`{place}: {} in the column `{}`, {} in the column `{}`.{}",
                first.name,
                first.here,
                head.name,
                first.there,
                found.baseline,
                if first.in_loop {
                    " These values are from the loop's last iteration."
                } else {
                    ""
                }
            )?;
            if let Some(line) = first.text_line {
                writeln!(text, "In the translation, this value is in line {line}.")?;
            }
        }
        None => writeln!(text, "\nAll intermediate values that Karat could compare are equal.")?,
    }
    if !found.unseen.is_empty() {
        writeln!(text, "Karat couldn't compare `{}`.", found.unseen.join("`, `"))?;
    }
    Ok(())
}
