//! Failures as annotations of a GitHub workflow, and in the summary of its job.

use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::Write;

use anyhow::Context;
use karat::unstable::output::{Output, counted, markdown, visible};
use karat::unstable::record::{ModuleError, Record, Subject};

use super::short::{self, Finding};
use super::tables::{is_failure, share};
use super::{Names, Place, Sum, located, pictures, replays, workspace, wrong_place};
use crate::cli::project::Project;

/// The largest size of a summary, in bytes. GitHub drops a summary of more than 1 MiB per step.
const LONGEST: usize = 900 << 10;
/// The largest size of a log in the summary, in bytes. HTML escapes take up to five bytes per character.
const LONGEST_LOG: usize = LONGEST / 5;
/// The largest number of characters of a message in the summary.
const LONGEST_MESSAGE: usize = 4 << 10;
/// The largest number of errors per step that GitHub's runner annotates. The runner only logs further errors.
const MOST_ANNOTATIONS: usize = 10;
/// The largest number of UTF-16 units in the message of an annotation.
const LONGEST_ANNOTATION: usize = 4096;
const LONGEST_TITLE: usize = 255;

/// Checks if GitHub's runner reads the output.
pub(in crate::cli) fn runs_here() -> bool {
    std::env::var_os("GITHUB_ACTIONS").is_some_and(|value| value == "true")
}

/// The random word that makes GitHub's runner obey commands again. `None` if the runner never stopped obeying them.
#[derive(Debug, Default)]
pub(in crate::cli) struct Held(Option<String>);

impl Held {
    pub(super) fn begin(out: &mut dyn Write) -> std::io::Result<Self> {
        let number = || RandomState::new().build_hasher().finish();
        let word = format!("karat-{:016x}{:016x}", number(), number());
        writeln!(out, "::stop-commands::{word}")?;
        out.flush()?;
        Ok(Self(Some(word)))
    }

    pub(super) fn release(self, out: &mut dyn Write) -> std::io::Result<()> {
        self.0.map_or(Ok(()), |word| writeln!(out, "::{word}::"))
    }
}

pub(super) fn write(
    records: &[Record],
    (sum, errors): (&Sum, &[ModuleError]),
    project: &Project,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let failures: Vec<&Record> = records.iter().filter(|record| is_failure(record)).collect();
    let names = &Names::of(records);
    for annotation in annotations(&failures, (sum, errors), names, project) {
        writeln!(out, "{annotation}")?;
    }
    out.flush()?;
    let pictures = project.output().join("report");
    records.iter().try_for_each(|record| pictures::clear(record, names, &pictures))?;
    append_summary(|| summary(&failures, sum, names, project))
}

/// Adds a headline and the text of the log to the summary of the job, if the job has one.
pub(in crate::cli) fn summarise(title: &str, headline: &str, text: &[u8]) -> anyhow::Result<()> {
    let mut plain = Vec::new();
    let mut output = Output::new(anstream::StripStream::new(&mut plain));
    output.write_all(text)?;
    output.finish()?;
    let text = String::from_utf8_lossy(&plain);
    let end = text.char_indices().map(|(at, _)| at).take_while(|at| *at <= LONGEST_LOG).last();
    let cut = &text[..end.filter(|_| text.len() > LONGEST_LOG).unwrap_or(text.len())];
    let more = if cut.len() < text.len() { "\n... (the rest is in the log)" } else { "" };
    append_summary(|| {
        Ok(format!(
            "## {title}\n\n{}.\n\n<details><summary>more</summary>\n\n<pre>{}{more}</pre>\n</details>\n\n",
            markdown(headline),
            html(cut)
        ))
    })
}

fn append_summary(text: impl FnOnce() -> anyhow::Result<String>) -> anyhow::Result<()> {
    let Some(file) = std::env::var_os("GITHUB_STEP_SUMMARY").filter(|file| !file.is_empty()) else {
        return Ok(());
    };
    let text = text()?;
    let shown = std::path::Path::new(&file).display().to_string();
    let mut file = OpenOptions::new()
        .create(true)
        .append(true)
        .open(&file)
        .with_context(|| format!("can't append to the summary `{shown}`"))?;
    file.write_all(visible(&text).as_bytes())
        .with_context(|| format!("can't append to the summary `{shown}`"))
}

/// Returns a line for each annotation. If there are more failures than GitHub's runner annotates, one annotation lists
/// the remaining failures.
fn annotations(
    failures: &[&Record],
    (sum, errors): (&Sum, &[ModuleError]),
    names: &Names,
    project: &Project,
) -> Vec<String> {
    let reasons = sum.reasons();
    let workspace = workspace(project.root());
    // Invalid modules come first, because they make tests fail. They get at most half of the annotations.
    let errors = errors.iter().take(MOST_ANNOTATIONS / 2).map(|ModuleError { place, message }| {
        let place = located(place, project.root(), &workspace);
        annotation(place.as_ref(), "invalid module", message)
    });
    let errors: Vec<String> = errors.collect();
    let room = MOST_ANNOTATIONS - usize::from(!reasons.is_empty()) - errors.len();
    let of = |record: &&Record| {
        let title = names.subject(record);
        let found = short::expectations(record, &workspace);
        if found.is_empty() {
            let place = wrong_place(record, project.root(), &workspace);
            return vec![annotation(place.as_ref(), &title, &message(record))];
        }
        let replay = replays(record).first().map(|command| format!("\nreplay: {command}"));
        let replay = replay.unwrap_or_default();
        let one = |Finding { place, message }: &Finding| {
            annotation(place.as_ref(), &title, &format!("{message}{replay}"))
        };
        found.iter().map(one).collect()
    };
    let all: Vec<Vec<String>> = failures.iter().map(of).collect();
    let count = all.iter().flatten().count();
    let shown = if count > room { room - 1 } else { count };
    let (mut lines, mut rest) = (Vec::new(), Vec::new());
    for (record, own) in failures.iter().zip(all) {
        if lines.len() >= shown {
            rest.push(names.subject(record));
        }
        lines.extend(own);
    }
    lines.truncate(shown);
    lines.splice(0..0, errors);
    if !rest.is_empty() {
        let title = format!("{} failed", counted(rest.len(), "more check"));
        let message = format!("the log has the messages of these checks:\n{}", rest.join("\n"));
        lines.push(annotation(None, &title, &message));
    }
    if !reasons.is_empty() {
        lines.push(annotation(None, "karat", &reasons.join("\n")));
    }
    lines
}

/// Returns the message of a failure. If the message is too long, cuts it, and appends the replay command.
fn message(record: &Record) -> String {
    let message = record.message.clone();
    let message = message.unwrap_or_else(|| "the check fails without a message".to_owned());
    if message.encode_utf16().count() <= LONGEST_ANNOTATION {
        return message;
    }
    let replay = replays(record).first().map(|command| format!("\n  replay: {command}"));
    let end = format!("\n  ... (the rest is in the log){}", replay.unwrap_or_default());
    let room = LONGEST_ANNOTATION.saturating_sub(end.encode_utf16().count());
    format!("{}{end}", cut(&message, room))
}

/// Returns the longest beginning of a text with at most `units` UTF-16 units.
fn cut(text: &str, units: usize) -> &str {
    let mut taken = 0;
    let end = text.char_indices().find(|(_, character)| {
        taken += character.len_utf16();
        taken > units
    });
    end.map_or(text, |(end, _)| &text[..end])
}

/// Writes warnings with locations, at most as many as GitHub's runner annotates. If there are more, the last warning
/// counts the others.
pub(in crate::cli) fn write_warnings(
    title: &str,
    warnings: impl ExactSizeIterator<Item = (String, String)>,
    project: &Project,
    out: &mut dyn Write,
) -> std::io::Result<()> {
    let workspace = workspace(project.root());
    let count = warnings.len();
    let shown = if count > MOST_ANNOTATIONS { MOST_ANNOTATIONS - 1 } else { count };
    for (place, message) in warnings.take(shown) {
        let place = located(&place, project.root(), &workspace);
        writeln!(out, "{}", command("warning", place.as_ref(), title, &message))?;
    }
    if count > shown {
        let message = format!("the log has {} more warnings", count - shown);
        writeln!(out, "{}", command("warning", None, title, &message))?;
    }
    Ok(())
}

fn annotation(place: Option<&Place>, title: &str, message: &str) -> String {
    command("error", place, title, message)
}

/// Formats a command: `::error file=...,line=...,col=...,title=...::message`.
fn command(level: &str, place: Option<&Place>, title: &str, message: &str) -> String {
    let mut properties = String::new();
    if let Some(Place { file, line, column }) = place {
        let file = escape_property(file);
        properties = format!("file={file},line={line},col={column},");
    }
    let title = escape_property(cut(title, LONGEST_TITLE));
    let message = anstream::adapter::strip_str(cut(message, LONGEST_ANNOTATION)).to_string();
    format!("::{level} {properties}title={title}::{}", escape(&message))
}

/// Escapes the characters that end a command's message or look like an escape.
fn escape(text: &str) -> String {
    text.replace('%', "%25").replace('\r', "%0D").replace('\n', "%0A")
}

fn escape_property(text: &str) -> String {
    escape(text).replace(':', "%3A").replace(',', "%2C")
}

fn summary(
    failures: &[&Record],
    sum: &Sum,
    names: &Names,
    project: &Project,
) -> anyhow::Result<String> {
    let mut text = String::from("## Karat\n\n");
    writeln!(text, "{}.\n", markdown(&sum.line()))?;
    let is_frame = |record: &Record| matches!(record.subject, Subject::Frame { .. });
    let (frames, functions): (Vec<&Record>, Vec<&Record>) =
        failures.iter().partition(|record| is_frame(record));
    let mut dropped = 0;
    for (head, records) in [("Function", functions), ("Frame", frames)] {
        if records.is_empty() {
            continue;
        }
        writeln!(
            text,
            "| {head} | Path | Cases | Failed | Worst | Of bound | Asserted |\n\
             |---|---|--:|--:|---|--:|---|"
        )?;
        records.iter().try_for_each(|record| rows(record, names, &mut text))?;
        text.push('\n');
        for record in records {
            let section = section(record, names, project)?;
            if text.len() + section.len() > LONGEST {
                dropped += 1;
            } else {
                text.push_str(&section);
            }
        }
    }
    if dropped > 0 {
        writeln!(text, "The log has {}.", counted(dropped, "more message"))?;
    }
    Ok(text)
}

fn rows(record: &Record, names: &Names, text: &mut String) -> std::fmt::Result {
    let name = markdown(&names.subject(record));
    if record.paths.is_empty() {
        writeln!(text, "| {name} | - | 0 | - | error | | |")?;
    }
    for path in &record.paths {
        let (worst, asserted) = (markdown(&path.worst), markdown(&path.asserted));
        let (cases, share) = (path.cases, markdown(&share(path)));
        // A sampler fails per configuration, and each configuration has many samples.
        let failures = match path.configurations {
            Some(_) => counted(path.failures, "configuration"),
            None => path.failures.to_string(),
        };
        let path = markdown(&path.adapter.path);
        writeln!(
            text,
            "| {name} | {path} | {cases} | {failures} | {worst} | {share} | {asserted} |"
        )?;
    }
    Ok(())
}

/// Returns a folded section of the summary: a failure's message, its replay command and the names of its pictures.
fn section(record: &Record, names: &Names, project: &Project) -> anyhow::Result<String> {
    let subject = markdown(&names.subject(record));
    let mut text = format!("<details><summary>{subject}</summary>\n\n");
    let message = record.message.as_deref().unwrap_or_default();
    let end = message.char_indices().nth(LONGEST_MESSAGE).map_or(message.len(), |(end, _)| end);
    writeln!(text, "<pre>{}</pre>\n", html(&message[..end]))?;
    if let Some(command) = replays(record).first() {
        writeln!(text, "Replay: <code>{}</code>\n", markdown(command))?;
    }
    let output = project.output();
    let pictures = pictures::write(record, names, project, &output.join("report"))?;
    if !pictures.is_empty() {
        let name = |(what, file): &(&str, std::path::PathBuf)| {
            let file = file.strip_prefix(&output).unwrap_or(file).display().to_string();
            format!("{what} `{}`", file.replace('\\', "/"))
        };
        let names: Vec<String> = pictures.iter().map(name).collect();
        writeln!(text, "Pictures in the artefact of this run: {}\n", names.join(", "))?;
    }
    text.push_str("</details>\n\n");
    Ok(text)
}

/// Escapes a text for an HTML element in Markdown.
fn html(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_cut_between_characters() {
        assert_eq!(cut("abc", 3), "abc");
        assert_eq!(cut("abc", 2), "ab");
        // One character of two UTF-16 units.
        assert_eq!(cut("a\u{1f980}b", 2), "a");
        assert_eq!(cut("a\u{1f980}b", 3), "a\u{1f980}");
    }

    #[test]
    fn commands_are_escaped() {
        assert_eq!(escape("100% off\r\nat (1, 2): red"), "100%25 off%0D%0Aat (1, 2): red");
        assert_eq!(escape_property("a::b, 5%"), "a%3A%3Ab%2C 5%25");
    }
}
