//! Parses Tint's answers, and finds the text ranges of their messages.

use std::ops::Range;

use serde::Deserialize;

use super::NoVerdict;

/// Tint's answer about a text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Answer {
    /// The messages about the text, in Tint's order. A note follows the message that it explains.
    pub(crate) messages: Vec<Message>,
    /// The entry points from which Tint can't make a pipeline, each with the reason.
    pub(crate) pipelines: Vec<(String, String)>,
    /// `true` if Tint made pipelines from entry points. The program `tint` makes no pipelines.
    pub(crate) made_pipelines: bool,
}

impl Answer {
    /// Checks if Tint rejects the text or one of its entry points.
    pub(crate) fn rejects(&self) -> bool {
        self.reason().is_some()
    }

    /// The reason why Tint rejects the text or one of its entry points, in one line. `None` if Tint accepts the text
    /// and all entry points.
    pub fn reason(&self) -> Option<&str> {
        let mut errors = self.messages.iter().filter(|one| one.severity == Severity::Error);
        let text = errors.next().map(|message| &message.text);
        let text = text.or_else(|| self.pipelines.first().map(|(_, reason)| reason))?;
        text.lines().find(|line| !line.trim().is_empty())
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Message {
    pub(crate) severity: Severity,
    pub(crate) text: String,
    /// The byte range in the text, if the message has a position.
    pub(crate) range: Option<Range<usize>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Severity {
    Error,
    Warning,
    #[serde(alias = "note")]
    Info,
}

/// The JSON that a process with Tint writes in each line.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    id: u64,
    /// The [`sum`] of the text that the process read.
    sum: u32,
    messages: Vec<WrittenMessage>,
    pipelines: Vec<WrittenPipeline>,
}

#[derive(Debug, Deserialize)]
struct WrittenMessage {
    severity: Severity,
    text: String,
    /// The position at which the message's range starts, in UTF-16 code units, as in WebGPU's GPUCompilationMessage.
    offset: usize,
    length: usize,
    /// The line, counted from 1; 0 if the message has no position.
    line: usize,
}

#[derive(Debug, Deserialize)]
struct WrittenPipeline {
    entry_point: String,
    error: Option<String>,
    /// The error in Karat's own module [`Pipeline::feeder`](super::Pipeline::feeder), if that module isn't valid.
    broke: Option<String>,
}

/// A checksum of a text: FNV-1a over the UTF-16 code units, which JavaScript can compute in one line. The checksum
/// detects an answer about another text, or about a text that lost bytes.
pub(super) fn sum(text: &str) -> u32 {
    const OFFSET: u32 = 0x811c_9dc5;
    const PRIME: u32 = 0x0100_0193;
    text.encode_utf16().fold(OFFSET, |sum, unit| (sum ^ u32::from(unit)).wrapping_mul(PRIME))
}

/// Parses the answer to question `id` about `text`.
pub(super) fn read(line: &str, id: u64, text: &str) -> Result<Answer, NoVerdict> {
    let garbage = || NoVerdict::Garbage(crate::diagnostic::one_line(line));
    let written: Written = serde_json::from_str(line).map_err(|_| garbage())?;
    if written.id < id {
        return Err(NoVerdict::Twice);
    }
    if written.id != id || written.sum != sum(text) {
        return Err(NoVerdict::Other);
    }
    if let Some(broke) = written.pipelines.iter().find_map(|one| one.broke.as_ref()) {
        return Err(NoVerdict::Garbage(broke.clone()));
    }
    let messages = written.messages.into_iter().map(|message| Message {
        range: (message.line > 0).then(|| bytes(text, message.offset, message.length)),
        severity: message.severity,
        text: message.text,
    });
    let rejected = written.pipelines.into_iter();
    let rejected = rejected.filter_map(|one| Some((one.entry_point, one.error?)));
    Ok(Answer { messages: messages.collect(), pipelines: rejected.collect(), made_pipelines: true })
}

/// The byte range of the `length` UTF-16 code units that start at `offset`.
fn bytes(text: &str, offset: usize, length: usize) -> Range<usize> {
    let mut units = 0;
    let mut at = |wanted: usize| {
        units = 0;
        for (byte, character) in text.char_indices() {
            if units >= wanted {
                return byte;
            }
            units += character.len_utf16();
        }
        text.len()
    };
    at(offset)..at(offset + length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_in_bytes() {
        let text = "// \u{e9}\u{1d465}\nfn f";
        assert_eq!(&text[bytes(text, 7, 2)], "fn");
        assert_eq!(bytes(text, 99, 1), text.len()..text.len());
    }

    // Lesson 203
    #[test]
    fn an_answer_of_tint_to_another_question_is_refused() {
        let text = "fn f() {}";
        let line = |id: u64, sum: u32| {
            format!("{{\"id\":{id},\"sum\":{sum},\"messages\":[],\"pipelines\":[]}}")
        };
        assert!(!read(&line(7, sum(text)), 7, text).expect("an answer").rejects());
        assert_eq!(read(&line(6, sum(text)), 7, text), Err(NoVerdict::Twice));
        assert_eq!(read(&line(8, sum(text)), 7, text), Err(NoVerdict::Other));
        assert_eq!(read(&line(7, sum("fn f() { }")), 7, text), Err(NoVerdict::Other));
        for garbage in ["", "null", "{}", "Segmentation fault", "{\"id\":7}"] {
            let error = read(garbage, 7, text).expect_err("no answer");
            assert!(matches!(error, NoVerdict::Garbage(_)), "{garbage}");
        }
    }
}
