//! Messages of JSON-RPC over pipes. The server reports an invalid message, and continues with the next message.

use std::collections::BTreeSet;
use std::io::{BufRead, Read, Write};

use lsp_types::notification::{LogMessage, Notification, ShowMessage};
use lsp_types::{LogMessageParams, MessageType, ShowMessageParams};
use serde::Serialize;
use serde_json::{Value, json};

/// The largest size of a message, in bytes. A message may contain the whole text of a file, but source files are far
/// smaller.
const LONGEST: u64 = 64 << 20;

/// The reason why a request has no result. The values are the error codes of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    Unparsed = -32700,
    Invalid = -32600,
    UnknownMethod = -32601,
    Parameters = -32602,
    Internal = -32603,
    NotInitialized = -32002,
}

#[derive(Debug, PartialEq)]
pub(super) enum Heard {
    Request {
        id: Value,
        method: String,
        parameters: Value,
    },
    Notification {
        method: String,
        parameters: Value,
    },
    /// A reply to a request that the server sent. The server ignores replies.
    Answer,
    /// An invalid message, with the reason.
    Garbage(Refusal, String),
    End,
}

/// Reads the next message, and skips other text before it.
pub(super) fn hear(from: &mut dyn BufRead) -> Heard {
    let mut length = None;
    loop {
        let mut line = Vec::new();
        // A line without an end isn't a header.
        match from.take(1 << 20).read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => return Heard::End,
            Ok(_) => {}
        }
        let line = String::from_utf8_lossy(&line).to_ascii_lowercase();
        // If the stated length was too small, the next header begins in the middle of a line.
        if let Some((_, value)) = line.rsplit_once("content-length:") {
            length = value.trim().parse::<u64>().ok().filter(|length| *length <= LONGEST);
            if length.is_none() {
                return Heard::Garbage(Refusal::Unparsed, format!("bad length: {}", value.trim()));
            }
        } else if line.trim().is_empty()
            && let Some(length) = length
        {
            let mut body = Vec::new();
            return match from.take(length).read_to_end(&mut body) {
                Ok(read) if read as u64 == length => parsed(&body),
                _ => Heard::End,
            };
        }
    }
}

fn parsed(body: &[u8]) -> Heard {
    let mut message: Value = match serde_json::from_slice(body) {
        Ok(message) => message,
        Err(error) => return Heard::Garbage(Refusal::Unparsed, format!("not JSON: {error}")),
    };
    let mut field = |name| message.get_mut(name).map(Value::take).unwrap_or_default();
    let (id, method, parameters) = (field("id"), field("method"), field("params"));
    let method = method.as_str().map(str::to_owned);
    match (method, id) {
        (Some(method), Value::Null) => Heard::Notification { method, parameters },
        (Some(method), id @ (Value::String(_) | Value::Number(_))) => {
            Heard::Request { id, method, parameters }
        }
        (None, Value::String(_) | Value::Number(_)) => Heard::Answer,
        _ => Heard::Garbage(Refusal::Invalid, "the message isn't valid JSON-RPC".to_owned()),
    }
}

/// The sending half of the connection to the editor.
pub(super) struct Client {
    out: Box<dyn Write + Send>,
    /// `true` after the editor has stopped reading.
    pub(super) gone: bool,
    /// The messages that the user has already seen, and that the server doesn't show again.
    said: BTreeSet<String>,
    requests: u64,
    /// `true` if the editor can show progress.
    pub(super) can_show_progress: bool,
    pub(super) can_refresh_lenses: bool,
}

impl Client {
    pub(super) fn new(out: Box<dyn Write + Send>) -> Self {
        let (said, requests) = (BTreeSet::new(), 0);
        let (can_show_progress, can_refresh_lenses) = (false, false);
        Self { out, gone: false, said, requests, can_show_progress, can_refresh_lenses }
    }

    fn write(&mut self, message: &Value) {
        let body = message.to_string();
        let head = format!("Content-Length: {}\r\n\r\n", body.len());
        let written = self.out.write_all((head + &body).as_bytes());
        self.gone |= written.and_then(|()| self.out.flush()).is_err();
    }

    pub(super) fn answer(&mut self, id: &Value, result: impl Serialize) {
        match serde_json::to_value(result) {
            Ok(result) => self.write(&json!({ "jsonrpc": "2.0", "id": id, "result": result })),
            Err(error) => self.refuse(id, Refusal::Internal, &error.to_string()),
        }
    }

    pub(super) fn refuse(&mut self, id: &Value, why: Refusal, message: &str) {
        let error = json!({ "code": why as i32, "message": message });
        self.write(&json!({ "jsonrpc": "2.0", "id": id, "error": error }));
    }

    pub(super) fn notify<N: Notification>(&mut self, parameters: &N::Params) {
        self.write(&json!({ "jsonrpc": "2.0", "method": N::METHOD, "params": parameters }));
    }

    /// Sends a notification whose parameters are JSON. For notifications with a Rust type, use
    /// [`notify`](Self::notify).
    pub(super) fn notify_value(&mut self, method: &str, parameters: &Value) {
        self.write(&json!({ "jsonrpc": "2.0", "method": method, "params": parameters }));
    }

    /// Sends a request, and ignores the reply.
    pub(super) fn ask(&mut self, method: &str, parameters: &Value) {
        self.requests += 1;
        let id = format!("karat/{}", self.requests);
        let message = json!({ "jsonrpc": "2.0", "id": id, "method": method, "params": parameters });
        self.write(&message);
    }

    pub(super) fn tell(&mut self, typ: MessageType, message: impl Into<String>) {
        self.notify::<ShowMessage>(&ShowMessageParams { typ, message: message.into() });
    }

    pub(super) fn tell_once(&mut self, message: &str) {
        if self.said.insert(message.to_owned()) {
            self.tell(MessageType::WARNING, format!("karat: {message}"));
        }
    }

    pub(super) fn log(&mut self, message: impl Into<String>) {
        let (typ, message) = (MessageType::LOG, message.into());
        self.notify::<LogMessage>(&LogMessageParams { typ, message });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &str) -> Vec<Heard> {
        let mut from = text.as_bytes();
        let mut heard = Vec::new();
        loop {
            match hear(&mut from) {
                Heard::End => return heard,
                other => heard.push(other),
            }
        }
    }

    fn framed(body: &str) -> String {
        format!("Content-Length: {}\r\n\r\n{body}", body.len())
    }

    #[test]
    fn messages_after_garbage_are_read() {
        let good = framed(r#"{"jsonrpc":"2.0","method":"initialized","params":{}}"#);
        let heard = |text: &str| {
            let found = all(text);
            let is_good = |heard: &&Heard| matches!(heard, Heard::Notification { method, .. } if method == "initialized");
            (found.iter().filter(is_good).count(), found.len())
        };
        assert_eq!(heard(&good), (1, 1));
        for (before, garbage) in [
            ("no head at all\r\n\r\n", 0),
            ("half a line, then ", 0),
            ("Content-Length: five\r\n\r\n", 1),
            ("Content-Length: 99999999999999999999\r\n\r\n{}", 1),
            ("Content-Length: 999999999999\r\n\r\n{}", 1),
            (&framed("{"), 1),
            (&framed("[]"), 1),
            (&framed(r#"{"jsonrpc":"2.0"}"#), 1),
            (&framed(r#"{"id":{},"method":"a"}"#), 1),
            (&framed("\u{0}\u{1f980}"), 1),
            // The stated length is smaller than the body.
            ("Content-Length: 2\r\n\r\n{} and more", 1),
        ] {
            assert_eq!(heard(&format!("{before}{good}{good}")), (2, 2 + garbage), "{before:?}");
        }
        assert_eq!(all("Content-Length: 50\r\n\r\n{"), []);
    }
}
