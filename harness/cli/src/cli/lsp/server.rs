//! The session: messages of the editor, and replies of the server.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;

use lsp_types::{
    CodeLens, CodeLensOptions, CodeLensParams, DidChangeTextDocumentParams,
    DidCloseTextDocumentParams, DidOpenTextDocumentParams, DidSaveTextDocumentParams,
    ExecuteCommandOptions, ExecuteCommandParams, InitializeResult, MessageType, SaveOptions,
    ServerCapabilities, ServerInfo, TextDocumentSyncCapability, TextDocumentSyncKind,
    TextDocumentSyncOptions, TextDocumentSyncSaveOptions,
};
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::super::project::Project;
use super::super::watch::files::{Watching, watch};
use super::documents::{Document, Documents, Now};
use super::findings::Findings;
use super::lenses::{Known, RUN, Subjects};
use super::live::{Live, Told};
use super::place::{self, resolved};
use super::root::Root;
use super::run::Runs;
use super::wire::{Client, Heard, Refusal};
use super::{Event, Said};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    New,
    Open,
    Shut,
}

pub(super) struct Server {
    pub(super) client: Client,
    phase: Phase,
    pub(super) documents: Documents,
    pub(super) roots: Vec<Root>,
    pub(super) live: Live,
    runs: Runs,
    sender: Sender<Event>,
    /// The watched packages. `None` means that the system can't watch the package's files. Then the server notices only
    /// saves in the editor.
    watched: BTreeMap<PathBuf, Option<Watching>>,
    /// The errors that the last validation of the modules found.
    pub(super) invalid: Findings,
    /// The diagnostics that the editor shows.
    pub(super) published: Findings,
    /// `true` if modules may have changed since the last validation.
    pub(super) edited: bool,
    pub(super) judged: bool,
}

/// A request that the server refuses, with the reason.
struct Refused(Refusal, String);

impl Server {
    pub(super) fn new(
        client: Client,
        paths: Vec<String>,
        sender: Sender<Event>,
    ) -> anyhow::Result<Self> {
        Ok(Self {
            client,
            phase: Phase::New,
            documents: Documents::default(),
            roots: Vec::new(),
            live: Live::new(paths, sender.clone())?,
            runs: Runs::default(),
            sender,
            watched: BTreeMap::new(),
            invalid: Findings::new(),
            published: Findings::new(),
            edited: false,
            judged: false,
        })
    }

    /// Checks if the editor has stopped reading the server's messages.
    pub(super) fn is_gone(&self) -> bool {
        self.client.gone
    }

    /// Checks if the shown diagnostics may be out of date.
    pub(super) fn is_unsettled(&self) -> bool {
        self.edited || self.judged
    }

    /// Handles an event. Returns `None` while the session goes on. At the end of the session, returns `true` if the
    /// editor had asked the server to shut down.
    pub(super) fn take(&mut self, event: Event) -> Option<bool> {
        match event {
            Event::Heard(Heard::End) => return Some(false),
            Event::Heard(Heard::Notification { method, .. }) if method == "exit" => {
                return Some(self.phase == Phase::Shut);
            }
            Event::Heard(Heard::Request { id, method, parameters }) => {
                // A panic ends one request, but not the session.
                let answered = catch_unwind(AssertUnwindSafe(|| self.answer(&method, parameters)));
                let broken = || Refused(Refusal::Internal, format!("`{method}` failed"));
                match answered.unwrap_or_else(|_| Err(broken())) {
                    Ok(result) => self.client.answer(&id, result),
                    Err(Refused(why, message)) => self.client.refuse(&id, why, &message),
                }
            }
            Event::Heard(Heard::Notification { method, parameters }) => {
                if self.phase == Phase::Open {
                    self.note(&method, parameters);
                }
            }
            Event::Heard(Heard::Garbage(why, message)) => {
                self.client.refuse(&Value::Null, why, &message);
            }
            Event::Heard(Heard::Answer) => {}
            Event::Files(files) => {
                let folders = files.iter().map(|file| resolved(file)).collect::<Vec<_>>();
                self.changed(|package| folders.iter().any(|file| file.starts_with(package)));
            }
            Event::Worker(index, said) => self.hear(index, said),
            Event::Ran(ended) => {
                self.look();
                self.settle();
                self.runs.end(ended, &mut self.client);
            }
        }
        None
    }

    fn answer(&mut self, method: &str, parameters: Value) -> Result<Value, Refused> {
        match (method, self.phase) {
            ("initialize", Phase::New) => Ok(self.initialize(&parameters)),
            ("initialize", _) => {
                Err(Refused(Refusal::Invalid, "the session has already begun".to_owned()))
            }
            (_, Phase::New) => {
                Err(Refused(Refusal::NotInitialized, "begin with `initialize`".to_owned()))
            }
            (_, Phase::Shut) => Err(Refused(Refusal::Invalid, "the session is over".to_owned())),
            ("shutdown", _) => {
                self.phase = Phase::Shut;
                Ok(Value::Null)
            }
            ("textDocument/codeLens", _) => {
                let wanted: CodeLensParams = read(parameters)?;
                let lenses = place::file(wanted.text_document.uri.as_str())
                    .map(|file| self.lenses(&file, &wanted))
                    .unwrap_or_default();
                serde_json::to_value(lenses)
                    .map_err(|error| Refused(Refusal::Internal, error.to_string()))
            }
            ("workspace/executeCommand", _) => self.execute(&read(parameters)?),
            _ => Err(Refused(Refusal::UnknownMethod, format!("there is no method `{method}`"))),
        }
    }

    fn initialize(&mut self, parameters: &Value) -> Value {
        self.phase = Phase::Open;
        let can = &parameters["capabilities"];
        self.client.can_show_progress = can["window"]["workDoneProgress"] == true;
        self.client.can_refresh_lenses = can["workspace"]["codeLens"]["refreshSupport"] == true;
        let several = parameters["workspaceFolders"].as_array().into_iter().flatten();
        let mut uris: Vec<&str> = several.filter_map(|folder| folder["uri"].as_str()).collect();
        if uris.is_empty() {
            uris.extend(parameters["rootUri"].as_str());
        }
        let mut folders: Vec<PathBuf> = uris.into_iter().filter_map(place::file).collect();
        if folders.is_empty() {
            folders.extend(std::env::current_dir());
        }
        for folder in folders.iter().filter(|folder| folder.is_dir()) {
            self.open_root(folder);
        }
        let sync = TextDocumentSyncOptions {
            open_close: Some(true),
            change: Some(TextDocumentSyncKind::FULL),
            save: Some(TextDocumentSyncSaveOptions::SaveOptions(SaveOptions {
                include_text: Some(false),
            })),
            ..TextDocumentSyncOptions::default()
        };
        let result = InitializeResult {
            capabilities: ServerCapabilities {
                text_document_sync: Some(TextDocumentSyncCapability::Options(sync)),
                code_lens_provider: Some(CodeLensOptions { resolve_provider: Some(false) }),
                execute_command_provider: Some(ExecuteCommandOptions {
                    commands: vec![RUN.to_owned()],
                    ..ExecuteCommandOptions::default()
                }),
                ..ServerCapabilities::default()
            },
            server_info: Some(ServerInfo {
                name: "karat".to_owned(),
                version: Some(env!("CARGO_PKG_VERSION").to_owned()),
            }),
        };
        serde_json::to_value(result).unwrap_or_default()
    }

    /// Opens the project of a folder, and the folder that was tested last. If the tested folder is inside the project,
    /// opens only the tested folder.
    fn open_root(&mut self, folder: &Path) {
        let (own, last) = (Project::at(folder), Project::last_tested_at(folder));
        let is_within = match (&own, &last) {
            (Ok(own), Ok(last)) => last.root() != own.root() && last.root().starts_with(own.root()),
            _ => false,
        };
        if !is_within {
            self.open_project(own);
        }
        self.open_project(last);
    }

    fn open_project(&mut self, project: anyhow::Result<Project>) {
        match project.and_then(Root::open) {
            Ok(root)
                if self.roots.iter().any(|known| known.project.root() == root.project.root()) => {}
            Ok(root) => {
                self.roots.push(root);
                self.look();
                self.changed(|_| true);
            }
            Err(error) => self.client.tell_once(&format!("{error:#}")),
        }
    }

    /// Handles a notification. Unknown notifications have no effect.
    fn note(&mut self, method: &str, parameters: Value) {
        match method {
            "textDocument/didOpen" => {
                let Ok(DidOpenTextDocumentParams { text_document: item }) = read(parameters) else {
                    return;
                };
                let Some(file) = place::file(item.uri.as_str()) else { return };
                self.find_root(&file);
                let (uri, version, text) = (item.uri, item.version, item.text);
                self.documents.open(file, Document { uri, version, text });
                self.edited = true;
            }
            "textDocument/didChange" => {
                let Ok(change) = read::<DidChangeTextDocumentParams>(parameters) else { return };
                let Some(file) = place::file(change.text_document.uri.as_str()) else { return };
                // Each change contains the whole text.
                if let Some(last) = change.content_changes.into_iter().next_back() {
                    self.documents.change(&file, change.text_document.version, last.text);
                    self.edited = true;
                }
            }
            "textDocument/didClose" => {
                let Ok(closed) = read::<DidCloseTextDocumentParams>(parameters) else { return };
                let Some(file) = place::file(closed.text_document.uri.as_str()) else { return };
                self.documents.close(&file);
                self.edited = true;
            }
            "textDocument/didSave" => {
                let Ok(saved) = read::<DidSaveTextDocumentParams>(parameters) else { return };
                let Some(file) = place::file(saved.text_document.uri.as_str()) else { return };
                self.changed(|package| file.starts_with(package));
            }
            _ => {}
        }
    }

    /// Opens the Cargo project around a file, unless an open project contains the file's module.
    fn find_root(&mut self, file: &Path) {
        if self.roots.iter().any(|root| root.module_of(file).is_some()) {
            return;
        }
        let Some(folder) = file.parent().filter(|folder| folder.is_dir()) else { return };
        match Project::around(folder) {
            Ok(project) if project.is_cargo() => self.open_root(folder),
            _ => {
                // The file may be the first module of an open folder.
                self.find_packages();
            }
        }
    }

    fn find_packages(&mut self) {
        for root in &mut self.roots {
            if let Err(error) = root.find_packages() {
                self.client.tell_once(&format!("{error:#}"));
            }
        }
        for package in self.roots.iter().flat_map(|root| &root.packages) {
            let folder = resolved(&package.root());
            if !self.watched.contains_key(&folder) {
                let sender = self.sender.clone();
                let told = move |files| sender.send(Event::Files(files)).is_ok();
                let watching = watch(&folder, told).ok();
                self.watched.insert(folder, watching);
            }
        }
    }

    /// Runs the tests that edits affect, in the packages for which `is_concerned` returns `true`.
    fn changed(&mut self, is_concerned: impl Fn(&Path) -> bool) {
        self.find_packages();
        for package in self.roots.iter().flat_map(|root| &root.packages) {
            if !is_concerned(&resolved(&package.root())) {
                continue;
            }
            if let Err(error) = self.live.ask(package) {
                self.client.tell_once(&format!("{error:#}"));
            }
        }
        (self.edited, self.judged) = (true, true);
    }

    fn hear(&mut self, index: usize, said: Said) {
        match self.live.hear(index, said) {
            Ok(Told::Nothing) => {}
            Ok(Told::Verdicts) => self.judged = true,
            Ok(Told::Ended(why)) => {
                self.client.log(format!("the process that runs the tests ended: {why}"));
                self.client
                    .tell_once("the test process ended early; the next save runs the tests again (see the log)");
                self.judged = true;
            }
            Err(error) => self.client.tell_once(&format!("{error:#}")),
        }
    }

    /// Reads the records of runs that have ended since the last call.
    pub(super) fn look(&mut self) {
        for root in &mut self.roots {
            match root.read_record() {
                Ok(new) => self.judged |= new,
                Err(error) => {
                    self.client.tell_once(&format!("{error:#}"));
                    self.judged = true;
                }
            }
        }
    }

    fn lenses(&self, file: &Path, wanted: &CodeLensParams) -> Vec<CodeLens> {
        let Some((root, package, subjects)) = self.subjects(file) else { return Vec::new() };
        let verdicts = self.verdicts(root, &Now::of(&self.documents));
        let lanes = self.live.lanes().filter(|lane| lane.package == package);
        let busy = lanes.into_iter().any(|lane| lane.resident.busy);
        let known = Known { verdicts: &verdicts, busy, whole: root.knows_all() };
        subjects.lenses(&wanted.text_document.uri, &known)
    }

    fn subjects(&self, file: &Path) -> Option<(&Root, PathBuf, Subjects)> {
        self.roots.iter().find_map(|root| {
            let (package, module) = root.module_of(file)?;
            let folder = resolved(&package.root());
            Some((root, folder, Subjects::of(&self.documents.applied(package), &module, file)))
        })
    }

    fn execute(&mut self, wanted: &ExecuteCommandParams) -> Result<Value, Refused> {
        if wanted.command != RUN {
            let why = format!("karat lsp has no command `{}`", wanted.command);
            return Err(Refused(Refusal::Parameters, why));
        }
        let [Value::String(uri), Value::String(function), ..] = &wanted.arguments[..] else {
            let why = format!("`{RUN}` needs the URI of a file and the name of a function");
            return Err(Refused(Refusal::Parameters, why));
        };
        let Some((root, _, subjects)) = place::file(uri).and_then(|file| self.subjects(&file))
        else {
            let why = format!("karat: `{uri}` isn't in a package of shaders");
            self.client.tell(MessageType::WARNING, why);
            return Ok(Value::Null);
        };
        let names = subjects.names(function, &self.verdicts(root, &Now::of(&self.documents)));
        let (folder, whole) = (root.project.root().to_owned(), root.knows_all());
        self.runs.start(function, &names, whole, folder, &mut self.client, &self.sender);
        Ok(Value::Null)
    }
}

fn read<T: DeserializeOwned>(parameters: Value) -> Result<T, Refused> {
    serde_json::from_value(parameters)
        .map_err(|error| Refused(Refusal::Parameters, error.to_string()))
}
