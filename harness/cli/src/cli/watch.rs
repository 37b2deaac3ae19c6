//! `karat watch`: the tests of a folder of shaders, again at each edit.
//!
//! Processes that stay, one a path, run the tests: their devices, pipelines and parsed modules live on. Each
//! knows what every test was made of, so an edit runs the tests that it concerns, and a comment none. A
//! process that hangs or crashes is told, and the next edit starts another one.

mod files;
mod screen;
mod worker;

use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use anyhow::Context;
use crossterm::event::{Event as Typed, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

use super::{Ending, Outcome};
use screen::Screen;
use worker::Worker;
pub(super) use worker::{Request, Said};

/// How long a shader may take here, unless KARAT_DEADLINE says: who waits has an editor open.
const DEADLINE: &str = "10";

#[derive(clap::Args)]
pub(super) struct Args {
    /// Folder of shaders, or one file [default: the working directory]
    folder: Option<PathBuf>,
    /// Only tests whose names contain this
    filter: Option<String>,
    /// Execution paths, each in a process of its own; the first has its verdict first
    #[arg(long, value_name = "PATHS", default_value = "cpu,vulkan", env = "KARAT_PATHS")]
    paths: String,
    /// Print lines, as where there is no terminal
    #[arg(long)]
    lines: bool,
    /// Run the tests once, and end
    #[arg(long, hide = true)]
    once: bool,
}

/// What happens.
pub(super) enum Event {
    /// Files changed, or are gone.
    Files(Vec<PathBuf>),
    /// A worker said a line, or ended.
    Worker(usize, Said),
    Key(KeyEvent),
    /// The terminal has another size.
    Resized,
}

/// What one path has of a test.
#[derive(Clone, Debug, Default)]
pub(super) struct Verdicts {
    /// Messages of tests that fail.
    pub(super) failing: BTreeMap<String, String>,
    /// Tests that there are, and what couldn't be read as one.
    pub(super) count: usize,
    /// Tests that the last edit concerned.
    pub(super) ran: usize,
    pub(super) took: Duration,
    /// Whether tests run.
    pub(super) busy: bool,
    /// Why there is no verdict.
    pub(super) broken: Option<String>,
}

/// One path with its process.
pub(super) struct Lane {
    pub(super) path: String,
    worker: Option<Worker>,
    pub(super) verdicts: Verdicts,
    /// Whether files changed while it ran.
    again: Option<bool>,
    began: Instant,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let folder = args.folder.clone().unwrap_or_else(|| PathBuf::from("."));
    anyhow::ensure!(folder.exists(), "there is no folder or file `{}`", folder.display());
    let names = karat::path::named("--paths", &args.paths)?;
    let (sender, events) = channel();
    let watching = files::watch(&folder, sender.clone())?;
    let lanes = names.iter().enumerate().map(|(index, path)| {
        Lane {
            path: path.to_string(),
            worker: None,
            verdicts: Verdicts::default(),
            again: None,
            began: Instant::now(),
        }
        .started(index, &folder, &sender)
    });
    let lanes: Vec<Lane> = lanes.collect::<anyhow::Result<_>>()?;
    let is_terminal = std::io::stdout().is_terminal() && std::io::stdin().is_terminal();
    let screen = match args.lines || args.once || !is_terminal {
        true => Screen::lines(),
        false => {
            keys(sender.clone());
            Screen::full()?
        }
    };
    let filter = args.filter.clone().unwrap_or_default();
    let mut watch =
        Watch { folder, filter, typing: None, lanes, screen, sender, changed: Vec::new() };
    let ending = watch.run(&events, args.once, out);
    drop(watching);
    ending
}

/// What is watched, and what is known of it.
struct Watch {
    folder: PathBuf,
    filter: String,
    /// What is typed of another filter.
    typing: Option<String>,
    lanes: Vec<Lane>,
    screen: Screen,
    sender: Sender<Event>,
    changed: Vec<String>,
}

impl Watch {
    fn run(&mut self, events: &Receiver<Event>, once: bool, out: &mut dyn Write) -> Outcome {
        for index in 0..self.lanes.len() {
            self.ask(index, true)?;
        }
        self.screen.draw(&self.view(), out)?;
        loop {
            let event = events.recv().context("nobody watches any more")?;
            match event {
                Event::Files(files) => {
                    self.changed = files.iter().map(|file| shown(file, &self.folder)).collect();
                    self.screen.say_changed(&self.changed, out)?;
                    for index in 0..self.lanes.len() {
                        self.ask(index, false)?;
                    }
                }
                Event::Worker(index, said) => self.hear(index, said, out)?,
                Event::Key(key) => {
                    if !self.press(key)? {
                        return Ok(Ending::Good);
                    }
                }
                Event::Resized => {}
            }
            self.screen.draw(&self.view(), out)?;
            if once && self.lanes.iter().all(|lane| !lane.verdicts.busy) {
                let red = |lane: &Lane| {
                    let Verdicts { broken, failing, count, .. } = &lane.verdicts;
                    broken.is_some() || !failing.is_empty() || *count == 0
                };
                let bad = self.lanes.iter().any(red);
                return Ok(if bad { Ending::Bad } else { Ending::Good });
            }
        }
    }

    fn view(&self) -> screen::View<'_> {
        screen::View {
            folder: &self.folder,
            filter: &self.filter,
            typing: self.typing.as_deref(),
            changed: &self.changed,
            lanes: &self.lanes,
        }
    }

    /// Asks a path for the tests that an edit concerns, or for all.
    fn ask(&mut self, index: usize, all: bool) -> anyhow::Result<()> {
        let lane = &mut self.lanes[index];
        if lane.verdicts.busy {
            lane.again = Some(all || lane.again == Some(true));
            return Ok(());
        }
        if lane.worker.is_none() {
            lane.worker = Some(Worker::start(index, &lane.path, &self.folder, &self.sender)?);
        }
        lane.began = Instant::now();
        lane.verdicts.busy = true;
        lane.verdicts.ran = 0;
        let first: Vec<&String> = lane.verdicts.failing.keys().collect();
        let request = worker::request(&self.filter, all, &first);
        if let Some(worker) = &mut lane.worker
            && worker.ask(&request).is_err()
        {
            // It ended; its last words come as an event.
            lane.verdicts.busy = true;
        }
        Ok(())
    }

    fn hear(&mut self, index: usize, said: Said, out: &mut dyn Write) -> anyhow::Result<()> {
        let lane = &mut self.lanes[index];
        match said {
            Said::Test { name, message } => {
                lane.verdicts.ran += 1;
                match message {
                    Some(message) => {
                        self.screen.say_failed(&lane.path, &name, &message, out)?;
                        lane.verdicts.failing.insert(name, message);
                    }
                    None => drop(lane.verdicts.failing.remove(&name)),
                }
                return Ok(());
            }
            Said::Done { tests, error } => {
                lane.verdicts.busy = false;
                lane.verdicts.took = lane.began.elapsed();
                lane.verdicts.count = tests.len();
                // Of a module that can't be read nobody knows which tests it has.
                lane.verdicts.failing.retain(|name, _| tests.contains(name));
                lane.verdicts.broken = error;
                self.screen.say_done(lane, out)?;
            }
            Said::Ended { why } => {
                lane.worker = None;
                lane.verdicts.busy = false;
                lane.verdicts.took = lane.began.elapsed();
                lane.verdicts.broken = Some(why);
                self.screen.say_done(lane, out)?;
            }
        }
        if let Some(all) = self.lanes[index].again.take() {
            self.ask(index, all)?;
        }
        Ok(())
    }

    /// What a key does; `false` ends.
    fn press(&mut self, key: KeyEvent) -> anyhow::Result<bool> {
        let control = key.modifiers.contains(KeyModifiers::CONTROL);
        if control && matches!(key.code, KeyCode::Char('c' | 'd')) {
            return Ok(false);
        }
        if let Some(mut typing) = self.typing.take() {
            match key.code {
                KeyCode::Enter => {
                    self.filter = typing;
                    return self.all_again();
                }
                KeyCode::Esc => return Ok(true),
                KeyCode::Backspace => drop(typing.pop()),
                KeyCode::Char(letter) => typing.push(letter),
                _ => {}
            }
            self.typing = Some(typing);
            return Ok(true);
        }
        match key.code {
            KeyCode::Char('q') => Ok(false),
            KeyCode::Char('r') => self.all_again(),
            KeyCode::Char('f') => {
                self.typing = Some(String::new());
                Ok(true)
            }
            _ => Ok(true),
        }
    }

    fn all_again(&mut self) -> anyhow::Result<bool> {
        for index in 0..self.lanes.len() {
            self.lanes[index].verdicts.failing.clear();
            self.ask(index, true)?;
        }
        Ok(true)
    }
}

impl Lane {
    fn started(self, index: usize, folder: &Path, sender: &Sender<Event>) -> anyhow::Result<Self> {
        let worker = Some(Worker::start(index, &self.path, folder, sender)?);
        Ok(Self { worker, ..self })
    }
}

/// A file as seen from the folder that is watched.
fn shown(file: &Path, folder: &Path) -> String {
    let whole = folder.canonicalize();
    let below = whole.ok().and_then(|folder| Some(file.strip_prefix(folder).ok()?.to_owned()));
    below.as_deref().unwrap_or(file).display().to_string()
}

/// Tells of keys, as long as somebody listens.
fn keys(sender: Sender<Event>) {
    std::thread::spawn(move || {
        while let Ok(event) = crossterm::event::read() {
            let told = match event {
                Typed::Key(key) if key.kind != KeyEventKind::Release => {
                    sender.send(Event::Key(key))
                }
                Typed::Resize(..) => sender.send(Event::Resized),
                _ => continue,
            };
            if told.is_err() {
                return;
            }
        }
    });
}
