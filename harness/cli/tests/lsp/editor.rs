//! A fake editor: the client's side of the language server protocol.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::karat;

/// A limit far longer than any step takes, even on a busy machine.
const PATIENCE: Duration = Duration::from_secs(90);

pub(crate) struct Editor {
    child: Child,
    stdin: Option<ChildStdin>,
    messages: Receiver<Value>,
    folder: PathBuf,
    /// The diagnostics that the editor shows for each file.
    diagnostics: BTreeMap<String, Vec<Value>>,
    /// The messages that the editor showed to the user.
    pub(crate) said: Vec<String>,
    /// The methods of the server's messages that show nothing to the user.
    heard: Vec<String>,
    requests: u64,
    version: u64,
}

impl Editor {
    /// Starts a server that has received no message yet.
    pub(crate) fn silent(folder: &Path) -> Self {
        Self::of(folder, karat(folder))
    }

    fn of(folder: &Path, mut command: Command) -> Self {
        command.arg("lsp").stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().expect("it starts");
        let stdin = child.stdin.take();
        let out = child.stdout.take().expect("it is piped");
        let (sender, messages) = channel();
        std::thread::spawn(move || {
            let mut out = BufReader::new(out);
            while let Some(message) = read(&mut out) {
                if sender.send(message).is_err() {
                    return;
                }
            }
        });
        let folder = folder.canonicalize().expect("it is there");
        let (diagnostics, said, heard) = Default::default();
        let (requests, version) = (0, 0);
        Self { child, stdin, messages, folder, diagnostics, said, heard, requests, version }
    }

    /// Starts a server with an open folder.
    pub(crate) fn open(folder: &Path) -> Self {
        Self::silent(folder).opened()
    }

    /// Starts a server that runs this machine's Tint.
    pub(crate) fn with_tint(folder: &Path) -> Self {
        let mut command = karat(folder);
        command.env_remove("KARAT_TINT");
        Self::of(folder, command).opened()
    }

    fn opened(self) -> Self {
        let mut editor = self;
        let root = editor.uri("");
        let capabilities = json!({
            "window": { "workDoneProgress": true },
            "workspace": { "codeLens": { "refreshSupport": true } },
        });
        let parameters = json!({
            "processId": null, "capabilities": capabilities, "rootUri": null,
            "workspaceFolders": [{ "uri": root, "name": "it" }],
        });
        let answer = editor.ask("initialize", parameters);
        assert_eq!(answer["result"]["serverInfo"]["name"], "karat", "{answer}");
        editor.notify("initialized", json!({}));
        editor
    }

    pub(crate) fn uri(&self, file: &str) -> String {
        format!("file://{}", self.folder.join(file).display())
    }

    pub(crate) fn raw(&mut self, bytes: &[u8]) {
        let stdin = self.stdin.as_mut().expect("it is open");
        stdin.write_all(bytes).and_then(|()| stdin.flush()).expect("it reads");
    }

    fn send(&mut self, message: &Value) {
        let body = message.to_string();
        self.raw(format!("Content-Length: {}\r\n\r\n{body}", body.len()).as_bytes());
    }

    pub(crate) fn notify(&mut self, method: &str, parameters: Value) {
        self.send(&json!({ "jsonrpc": "2.0", "method": method, "params": parameters }));
    }

    /// Sends a request, and returns the whole reply.
    pub(crate) fn ask(&mut self, method: &str, parameters: Value) -> Value {
        self.requests += 1;
        let id = self.requests;
        self.send(&json!({ "jsonrpc": "2.0", "id": id, "method": method, "params": parameters }));
        self.until(&format!("an answer to {method}"), |_, message| {
            message["id"] == id && message["method"].is_null()
        })
    }

    /// Waits for an error reply, such as the reply to a message without a readable id.
    pub(crate) fn refusal(&mut self) -> Value {
        self.until("a refusal", |_, message| message["error"].is_object())
    }

    fn until(&mut self, what: &str, is_it: impl Fn(&Self, &Value) -> bool) -> Value {
        let began = Instant::now();
        while let Some(left) = PATIENCE.checked_sub(began.elapsed()) {
            let Ok(message) = self.messages.recv_timeout(left) else { break };
            self.take(&message);
            if is_it(self, &message) {
                return message;
            }
        }
        panic!("no {what}; shown: {:#?}, said: {:?}", self.diagnostics, self.said);
    }

    fn take(&mut self, message: &Value) {
        assert_eq!(message["jsonrpc"], "2.0", "{message}");
        let parameters = &message["params"];
        match message["method"].as_str() {
            Some("textDocument/publishDiagnostics") => {
                let uri = parameters["uri"].as_str().expect("a URI").to_owned();
                let all = parameters["diagnostics"].as_array().expect("a list").clone();
                self.diagnostics.insert(uri, all);
            }
            Some("window/showMessage") => {
                self.said.push(parameters["message"].as_str().expect("a text").to_owned());
            }
            Some(other) => self.heard.push(other.to_owned()),
            None => {}
        }
    }

    pub(crate) fn shown(&self, file: &str) -> Vec<Value> {
        self.diagnostics.get(&self.uri(file)).cloned().unwrap_or_default()
    }

    /// Waits until the diagnostics of a file satisfy a condition.
    #[track_caller]
    pub(crate) fn wait(&mut self, file: &str, is_so: impl Fn(&[Value]) -> bool) -> Vec<Value> {
        if !is_so(&self.shown(file)) {
            let what = format!("such diagnostics of {file}");
            self.until(&what, |editor, _| is_so(&editor.shown(file)));
        }
        self.shown(file)
    }

    /// Waits until the user has seen a message that contains `part`.
    pub(crate) fn wait_said(&mut self, part: &str) -> String {
        let has = |editor: &Self| editor.said.iter().any(|said| said.contains(part));
        if !has(self) {
            self.until(&format!("`{part}`"), |editor, _| has(editor));
        }
        self.said.iter().find(|said| said.contains(part)).cloned().unwrap_or_default()
    }

    /// Waits until the server has sent a message with this method.
    pub(crate) fn wait_heard(&mut self, method: &str) {
        let has = |editor: &Self| editor.heard.iter().any(|heard| heard == method);
        if !has(self) {
            self.until(method, |editor, _| has(editor));
        }
    }

    pub(crate) fn open_file(&mut self, file: &str, text: &str) {
        let document = json!({
            "uri": self.uri(file), "languageId": "wgsl", "version": self.version, "text": text,
        });
        self.notify("textDocument/didOpen", json!({ "textDocument": document }));
    }

    pub(crate) fn edit(&mut self, file: &str, text: &str) {
        self.version += 1;
        let document = json!({ "uri": self.uri(file), "version": self.version });
        let changes = json!([{ "text": text }]);
        let parameters = json!({ "textDocument": document, "contentChanges": changes });
        self.notify("textDocument/didChange", parameters);
    }

    pub(crate) fn save(&mut self, file: &str, text: &str) {
        self.edit(file, text);
        std::fs::write(self.folder.join(file), text).expect("written");
        let document = json!({ "uri": self.uri(file) });
        self.notify("textDocument/didSave", json!({ "textDocument": document }));
    }

    /// The titles of a file's lenses, each with its line.
    pub(crate) fn lenses(&mut self, file: &str) -> Vec<(u64, String)> {
        let document = json!({ "uri": self.uri(file) });
        let answer = self.ask("textDocument/codeLens", json!({ "textDocument": document }));
        let lenses = answer["result"].as_array().unwrap_or_else(|| panic!("{answer}"));
        let lens = |lens: &Value| {
            let line = lens["range"]["start"]["line"].as_u64().expect("a line") + 1;
            (line, lens["command"]["title"].as_str().expect("a title").to_owned())
        };
        lenses.iter().map(lens).collect()
    }

    /// Waits until a lens of a line begins with `title`.
    pub(crate) fn wait_lens(&mut self, file: &str, line: u64, title: &str) {
        let began = Instant::now();
        loop {
            let lenses = self.lenses(file);
            if lenses.iter().any(|(at, found)| *at == line && found.starts_with(title)) {
                return;
            }
            assert!(began.elapsed() < PATIENCE, "no `{title}` in {lenses:#?}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Closes the server's input, and waits for its exit code.
    pub(crate) fn end(mut self) -> Option<i32> {
        self.stdin = None;
        let began = Instant::now();
        while began.elapsed() < PATIENCE {
            if let Some(status) = self.child.try_wait().expect("it is there") {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("it doesn't end");
    }
}

impl Drop for Editor {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// Reads the server's next message. Any other text on standard output makes the test fail.
fn read(out: &mut impl BufRead) -> Option<Value> {
    let mut length = None;
    loop {
        let mut line = String::new();
        if out.read_line(&mut line).expect("text") == 0 {
            return None;
        }
        let line = line.strip_suffix("\r\n").unwrap_or_else(|| panic!("no head: {line:?}"));
        if line.is_empty() {
            break;
        }
        let value = line.strip_prefix("Content-Length: ");
        let value = value.unwrap_or_else(|| panic!("no head: {line:?}"));
        length = Some(value.parse::<usize>().expect("a length"));
    }
    let mut body = vec![0; length.expect("a length")];
    out.read_exact(&mut body).expect("as long as it says");
    Some(serde_json::from_slice(&body).expect("JSON"))
}
