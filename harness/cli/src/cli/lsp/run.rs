//! `karat.run`: runs the tests of a function with `karat test`.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::mpsc::Sender;

use anyhow::Context;
use lsp_types::MessageType;
use serde_json::json;

use super::Event;
use super::wire::Client;

/// The state of `karat.run`: at most one run at a time.
#[derive(Default)]
pub(super) struct Runs {
    running: Option<String>,
    count: u64,
}

pub(super) struct Ended {
    typ: MessageType,
    message: String,
}

impl Runs {
    /// Starts `karat test` for some tests. `whole` is `true` if Karat knows all tests of the project.
    pub(super) fn start(
        &mut self,
        function: &str,
        names: &BTreeSet<String>,
        whole: bool,
        folder: PathBuf,
        client: &mut Client,
        sender: &Sender<Event>,
    ) {
        if let Some(running) = &self.running {
            let message = format!("karat: the tests of `{running}` are still running");
            return client.tell(MessageType::WARNING, message);
        }
        if names.is_empty() {
            let message = match whole {
                true => format!("karat: `{function}` has no test"),
                false => format!("karat: no test of `{function}` is known: run `karat test`"),
            };
            return client.tell(MessageType::WARNING, message);
        }
        self.running = Some(function.to_owned());
        self.count += 1;
        if client.can_show_progress {
            let token = self.token();
            client.ask("window/workDoneProgress/create", &json!({ "token": token }));
            let title = format!("karat test: {function}");
            self.progress(client, &json!({ "kind": "begin", "title": title }));
        }
        let (function, names, sender) = (function.to_owned(), names.clone(), sender.clone());
        std::thread::spawn(move || {
            let ended = run(&function, &names, folder).unwrap_or_else(|error| Ended {
                typ: MessageType::ERROR,
                message: format!("karat: {error:#}"),
            });
            drop(sender.send(Event::Ran(ended)));
        });
    }

    pub(super) fn end(&mut self, ended: Ended, client: &mut Client) {
        self.running = None;
        if client.can_show_progress {
            self.progress(client, &json!({ "kind": "end", "message": ended.message }));
        }
        client.tell(ended.typ, ended.message);
    }

    fn token(&self) -> String {
        format!("karat/run/{}", self.count)
    }

    fn progress(&self, client: &mut Client, value: &serde_json::Value) {
        let parameters = json!({ "token": self.token(), "value": value });
        client.notify_value("$/progress", &parameters);
    }
}

fn run(function: &str, names: &BTreeSet<String>, folder: PathBuf) -> anyhow::Result<Ended> {
    let program = std::env::current_exe().context("can't find karat's executable file")?;
    let mut command = Command::new(program);
    command.current_dir(folder).args(["test", "--short"]);
    for name in names {
        command.args(["--named", name]);
    }
    // Standard input and output belong to the protocol.
    let ran = command.stdin(Stdio::null()).output().context("can't run `karat test`")?;
    let (out, err) = (String::from_utf8_lossy(&ran.stdout), String::from_utf8_lossy(&ran.stderr));
    // The last line of a run counts the verdicts, or gives the reason why there are none.
    let count = out.lines().last().filter(|_| matches!(ran.status.code(), Some(0 | 1)));
    let why = || err.lines().find(|line| line.starts_with("error")).unwrap_or("it ended");
    let said = count.unwrap_or_else(why).to_owned();
    let typ = match ran.status.code() {
        Some(0) => MessageType::INFO,
        Some(1) => MessageType::WARNING,
        _ => MessageType::ERROR,
    };
    Ok(Ended { typ, message: format!("karat: `{function}`: {said}") })
}
