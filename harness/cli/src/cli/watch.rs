//!
//! `karat watch`: runs the tests of a project or of a folder of shaders again after each edit.
//!
//! Each path has a long-lived process that runs the tests beside the shaders, and keeps its GPU devices, pipelines and
//! parsed modules. The process knows the shaders and files of every test, so it runs only the tests that an edit
//! affects. An edit of a comment affects no test. If a process hangs or crashes, the screen says so, and the next edit
//! starts another process. In a Cargo project, each path has a second process for the Rust tests.

pub(super) mod files;
mod keys;
mod resident;
mod screen;
mod worker;

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use anyhow::Context;
use crossterm::event::{Event as Typed, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

use karat::Package;
use karat_suite::Wrong;

use super::project::Project;
use super::search::{Found, expect_filter, stands_for, write_outside};
use super::{Ending, Outcome, PackageArgs, resolved};
pub(super) use resident::Resident;
use screen::Screen;
use worker::Worker;
pub(super) use worker::{Reads, Request, Said};

/// The default time limit of a shader, in seconds, if KARAT_TIMEOUT isn't set. This limit is short, because a person
/// waits for the verdict.
const DEADLINE: &str = "10";
/// The number of lines that a page key scrolls: half of a usual terminal.
const PAGE: isize = 12;
/// The paths on which the tests run, if neither `--paths` nor KARAT_PATHS names paths.
const PATHS: &str = "cpu,vulkan";

#[derive(clap::Args)]
pub(super) struct Args {
    /// Cargo project, folder of shaders, or one file [default: the working directory]
    folder: Option<PathBuf>,
    /// Runs only tests whose names contain this text
    filter: Option<String>,
    /// Runs the tests on these paths, with one process per path; the first path gives its verdict first
    #[arg(long, value_name = "PATHS", default_value = PATHS, env = "KARAT_PATHS")]
    paths: String,
    /// Prints lines in place of a full screen, even on a terminal
    #[arg(long)]
    lines: bool,
    /// Runs the tests once, and ends
    #[arg(long, hide = true)]
    once: bool,
}

/// The kind of tests, with the folder that contains them.
#[derive(Clone, Debug)]
pub(super) enum Source {
    /// Tests beside the shaders of a package.
    Shaders(PathBuf),
    /// Rust tests of a Cargo project.
    Cargo(PathBuf),
}

impl Source {
    pub(super) fn folder(&self) -> &Path {
        match self {
            Self::Shaders(folder) | Self::Cargo(folder) => folder,
        }
    }

    /// Finds the folder to watch and its tests: the Rust tests of a Cargo project, and the tests beside its shaders. If
    /// no folder is named, returns the tests that `karat test` would run.
    fn all(named: Option<&Path>) -> anyhow::Result<(PathBuf, Vec<Self>)> {
        let project = match named {
            None => Project::find()?,
            Some(folder) => {
                anyhow::ensure!(
                    folder.exists(),
                    "there is no folder or file `{}`",
                    folder.display()
                );
                // The path becomes absolute now, because the working directory may be moved and replaced by another
                // folder.
                let whole = folder.canonicalize()?;
                if !whole.join("Cargo.toml").is_file() {
                    let shaders = if whole.is_dir() { stands_for(&whole)? } else { whole.clone() };
                    return Ok((whole, vec![Self::Shaders(shaders)]));
                }
                Project::around(&whole)?
            }
        };
        let mut all = Vec::new();
        if project.is_cargo() {
            all.push(Self::Cargo(project.root().to_owned()));
        }
        let found = project.search(&PackageArgs::default())?;
        all.extend(found.iter().filter_map(Found::place).map(Self::Shaders));
        Ok((project.root().canonicalize()?, all))
    }
}

pub(super) enum Event {
    Files(Vec<PathBuf>),
    /// A process that runs tests wrote a line, or ended.
    Worker(usize, Said),
    Key(KeyEvent),
    Resized,
    /// The program that reads the output of this command, such as `tee`, has ended.
    Unread,
    /// Ctrl-C or the system asks the command to end.
    Stopped,
}

/// The text that the user is typing.
#[derive(Clone, Debug)]
enum Typing {
    Filter(String),
    /// The user types the reason why these frames are right.
    Reason(keys::Waiting, String),
}

impl Typing {
    fn text(&mut self) -> &mut String {
        match self {
            Self::Filter(text) | Self::Reason(_, text) => text,
        }
    }

    fn prompt(&self) -> String {
        match self {
            Self::Filter(text) => format!("run only tests whose names contain: {text}_"),
            Self::Reason(frames, text) => {
                let names: Vec<&str> = frames.values().flatten().map(String::as_str).collect();
                format!("accept {} because: {text}_", names.join(", "))
            }
        }
    }
}

/// The verdicts of one path.
#[derive(Clone, Debug, Default)]
pub(super) struct Verdicts {
    pub(super) ran: usize,
    pub(super) took: Duration,
    pub(super) idle: usize,
    /// The errors of unreadable tests, or the reason why the process ended.
    pub(super) broken: Option<String>,
    pub(super) invalid: Option<String>,
    /// The remarks of other compilers on the modules: a summary line, and then each remark.
    pub(super) remarks: Option<String>,
}

/// A path, and the process that runs the tests on this path.
pub(super) struct Lane {
    /// The name of the path. If there are several sources of tests, the name includes the source.
    pub(super) name: String,
    pub(super) resident: Resident,
    pub(super) verdicts: Verdicts,
    /// `true` if no other process runs tests on this path.
    pub(super) alone: bool,
    /// `true` for the first path, which validates the modules.
    validates: bool,
    /// The files that the tests read, except for modules and for files that declare tests.
    reads: Reads,
    began: Instant,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    // An empty variable counts as unset.
    let names = if args.paths.trim().is_empty() { PATHS } else { &args.paths };
    let names = karat::unstable::path::named("--paths", names)?;
    if let Some(folder) = &args.folder {
        expect_filter(folder, args.filter.as_deref())?;
    }
    write_outside(args.folder.as_deref(), out)?;
    let (whole, sources) = Source::all(args.folder.as_deref())?;
    let (sender, events) = channel();
    let watching = outermost(&whole, &sources).into_iter().map(|folder| {
        let told = sender.clone();
        files::watch(&folder, move |files| told.send(Event::Files(files)).is_ok())
    });
    let watching = watching.collect::<anyhow::Result<Vec<_>>>()?;
    let records = tempfile::tempdir().context("can't make a temporary folder")?;
    let mut lanes = Vec::new();
    for (at, path) in names.iter().enumerate() {
        for source in &sources {
            let of = match source {
                _ if sources.len() == 1 => String::new(),
                Source::Cargo(_) => " (Rust)".to_owned(),
                Source::Shaders(shaders) => {
                    format!(" ({})", shown(shaders, &whole))
                }
            };
            let mut lane = Lane::new(lanes.len(), &of, &path.to_string(), source, records.path());
            (lane.alone, lane.validates) = (sources.len() == 1, at == 0);
            lanes.push(lane);
        }
    }
    tell_when_unread(sender.clone());
    tell_when_stopped(sender.clone())?;
    let is_dumb = std::env::var_os("TERM").is_some_and(|name| name == "dumb");
    let is_terminal = std::io::stdout().is_terminal() && std::io::stdin().is_terminal() && !is_dumb;
    let screen = match args.lines || args.once || !is_terminal {
        true => Screen::lines(),
        false => {
            keys(sender.clone());
            Screen::full()?
        }
    };
    let filter = args.filter.clone().unwrap_or_default();
    let around = if whole.is_file() { whole.parent().unwrap_or(&whole) } else { &whole };
    let mut watch = Watch {
        project: Project::at(around)?,
        folder: whole,
        filter,
        typing: None,
        notice: None,
        reports: None,
        lanes,
        screen,
        sender,
        changed: Vec::new(),
    };
    let ending = watch.run(&events, args.once, out);
    drop(watching);
    ending
}

/// The watched sources of tests, and the state of the command.
struct Watch {
    folder: PathBuf,
    project: Project,
    filter: String,
    typing: Option<Typing>,
    /// The message that the last pressed key caused.
    notice: Option<String>,
    /// The number of paths that haven't yet sent their records for the requested report.
    reports: Option<usize>,
    lanes: Vec<Lane>,
    screen: Screen,
    sender: Sender<Event>,
    changed: Vec<String>,
}

impl Watch {
    fn run(&mut self, events: &Receiver<Event>, once: bool, out: &mut dyn Write) -> Outcome {
        for index in 0..self.lanes.len() {
            self.ask(index, all())?;
        }
        self.screen.draw(&self.view(), out)?;
        loop {
            let event = events.recv().context("the watch has ended")?;
            match event {
                Event::Files(mut files) => {
                    files.retain(|file| self.concerns(file) && !self.screen.is_printed_in(file));
                    if files.is_empty() {
                        continue;
                    }
                    self.changed = files.iter().map(|file| shown(file, &self.folder)).collect();
                    self.screen.say_changed(&self.changed, out)?;
                    self.screen.rewind();
                    for index in 0..self.lanes.len() {
                        self.ask(index, Request { changed: files.clone(), ..Request::default() })?;
                    }
                }
                Event::Worker(index, said) => self.hear(index, said, out)?,
                Event::Key(key) => {
                    if !self.press(key)? {
                        return Ok(Ending::Good);
                    }
                }
                Event::Resized => {}
                Event::Unread | Event::Stopped => return Ok(Ending::Good),
            }
            self.screen.draw(&self.view(), out)?;
            if once && self.lanes.iter().all(|lane| !lane.resident.busy) {
                let red = |lane: &Lane| {
                    let Verdicts { broken, invalid, .. } = &lane.verdicts;
                    broken.is_some() || invalid.is_some() || !lane.resident.failing.is_empty()
                };
                // All paths have the same tests.
                let none = |lane: &Lane| lane.resident.tests.len() + lane.verdicts.idle == 0;
                let bad =
                    self.lanes.iter().any(red) || self.lanes.iter().all(none) || self.is_unjudged();
                return Ok(if bad { Ending::Bad } else { Ending::Good });
            }
        }
    }

    /// Checks if there are tests that run on no path, such as frames if `cpu` is the only path.
    fn is_unjudged(&self) -> bool {
        let of = |lane: &Lane| lane.resident.source.folder().to_owned();
        self.lanes.iter().any(|lane| {
            let mut same = self.lanes.iter().filter(|other| of(other) == of(lane));
            same.all(|other| other.verdicts.idle > 0)
        })
    }

    /// Checks if an edit of the file may change a verdict.
    fn concerns(&self, file: &Path) -> bool {
        let name = file.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        let ending = file.extension().unwrap_or_default();
        let is_cargo = |lane: &Lane| matches!(lane.resident.source, Source::Cargo(_));
        let is_source = ["wgsl", "wesl"].iter().any(|known| ending == *known)
            || (["rs", "lock"].iter().any(|known| ending == *known)
                && self.lanes.iter().any(is_cargo))
            // The file is a manifest, or declares tests.
            || name.contains("toml")
            || karat_suite::is_meant(file);
        // A removed path may have been a folder.
        let is_folder = file.is_dir() || (ending.is_empty() && !file.exists());
        let reads = |lane: &Lane| match &lane.reads {
            Reads::Any => true,
            Reads::These(files) => files.contains(&resolved(file)),
        };
        is_source || is_folder || self.lanes.iter().any(reads)
    }

    fn view(&self) -> screen::View<'_> {
        screen::View {
            folder: &self.folder,
            filter: &self.filter,
            prompt: self.typing.as_ref().map(Typing::prompt),
            notice: self.notice.as_deref(),
            changed: &self.changed,
            lanes: &self.lanes,
        }
    }

    /// Asks the process of a path to run the tests that an edit affects, or all tests.
    fn ask(&mut self, index: usize, request: Request) -> anyhow::Result<()> {
        let lane = &mut self.lanes[index];
        let request = Request { filter: self.filter.clone(), validate: lane.validates, ..request };
        let sender = self.sender.clone();
        let tell = move |said| sender.send(Event::Worker(index, said)).is_ok();
        if lane.resident.ask(request, tell)? {
            lane.began = Instant::now();
            lane.verdicts.ran = 0;
        }
        Ok(())
    }

    fn hear(&mut self, index: usize, said: Said, out: &mut dyn Write) -> anyhow::Result<()> {
        let lane = &mut self.lanes[index];
        lane.resident.hear(&said);
        match said {
            Said::Test { name, wrong } => {
                lane.verdicts.ran += 1;
                if let Some(Wrong { message, .. }) = wrong {
                    self.screen.say_failed(&lane.name, &name, &message, out)?;
                }
                return Ok(());
            }
            Said::Done { broken, idle, invalid, remarks, reads, .. } => {
                lane.verdicts.idle = idle;
                lane.verdicts.invalid = invalid;
                lane.verdicts.remarks = remarks;
                lane.reads = reads;
                lane.verdicts.took = lane.began.elapsed();
                let broken: Vec<String> = broken.into_iter().map(|wrong| wrong.message).collect();
                lane.verdicts.broken = (!broken.is_empty()).then(|| broken.join("\n"));
                self.screen.say_done(lane, out)?;
            }
            Said::Reported { error } => {
                let left = self.reports.unwrap_or(1) - 1;
                self.reports = (left > 0).then_some(left);
                self.notice = error.or_else(|| self.notice.take());
                if left == 0 {
                    self.notice = Some(self.open_report());
                }
                return Ok(());
            }
            Said::Ended { why } => {
                self.reports = None;
                lane.verdicts.took = lane.began.elapsed();
                lane.verdicts.broken = Some(why);
                self.screen.say_done(lane, out)?;
            }
        }
        if let Some(request) = self.lanes[index].resident.waited() {
            self.ask(index, request)?;
        }
        Ok(())
    }

    /// Handles a key. Returns `false` to end the command.
    fn press(&mut self, key: KeyEvent) -> anyhow::Result<bool> {
        let control = key.modifiers.contains(KeyModifiers::CONTROL);
        if control && matches!(key.code, KeyCode::Char('c' | 'd')) {
            return Ok(false);
        }
        if let Some(mut typing) = self.typing.take() {
            match (key.code, &mut typing) {
                (KeyCode::Enter, Typing::Filter(filter)) => {
                    self.filter = std::mem::take(filter);
                    return self.all_again();
                }
                (KeyCode::Enter, Typing::Reason(_, because)) if because.trim().is_empty() => {
                    self.notice = Some("no frame was accepted: a reason is required".to_owned());
                    return Ok(true);
                }
                // The goldens are watched files, so the tests that compare with them run again.
                (KeyCode::Enter, Typing::Reason(frames, because)) => {
                    self.notice = Some(keys::accept(&self.project, frames, because.trim()));
                    return Ok(true);
                }
                (KeyCode::Esc, _) => return Ok(true),
                (KeyCode::Backspace, typing) => drop(typing.text().pop()),
                (KeyCode::Char(letter), typing) => typing.text().push(letter),
                _ => {}
            }
            self.typing = Some(typing);
            return Ok(true);
        }
        self.notice = None;
        match key.code {
            KeyCode::Char('q') => return Ok(false),
            KeyCode::Char('r') => return self.all_again(),
            KeyCode::Char('f') => self.typing = Some(Typing::Filter(String::new())),
            KeyCode::Char('a') => match self.pending() {
                none if none.is_empty() => {
                    self.notice = Some("no frame is pending".to_owned());
                }
                frames => self.typing = Some(Typing::Reason(frames, String::new())),
            },
            KeyCode::Char('o') => self.ask_for_records(),
            KeyCode::Char('n') => self.screen.turn(),
            KeyCode::Up | KeyCode::Char('k') => self.screen.scroll(-1),
            KeyCode::Down | KeyCode::Char('j') => self.screen.scroll(1),
            KeyCode::PageUp => self.screen.scroll(-PAGE),
            KeyCode::PageDown | KeyCode::Char(' ') => self.screen.scroll(PAGE),
            _ => {}
        }
        Ok(true)
    }

    fn pending(&self) -> keys::Waiting {
        let shaders = self.lanes.iter().filter_map(|lane| match &lane.resident.source {
            Source::Shaders(folder) => Some(folder.clone()),
            Source::Cargo(_) => None,
        });
        keys::pending(&self.project, shaders)
    }

    /// Asks the process of each path for its records. The report opens after the last reply.
    fn ask_for_records(&mut self) {
        let asked = self.lanes.iter_mut().map(|lane| lane.resident.ask_for_records());
        let asked = asked.filter(|asked| *asked).count();
        self.reports = (asked > 0).then_some(asked);
        let wait = "the report opens after the tests have run";
        self.notice = Some(if asked > 0 { wait } else { "no test has run" }.to_owned());
    }

    fn open_report(&self) -> String {
        let files: Vec<PathBuf> = self.lanes.iter().map(|lane| lane.resident.report()).collect();
        let files: Vec<PathBuf> = files.into_iter().filter(|file| file.is_file()).collect();
        let page = self.project.output().join("watch.html");
        match keys::open_report(&self.project, &files, &page) {
            Ok(()) => format!("the report is `{}`", page.display()),
            Err(error) => format!("error: {error:#}"),
        }
    }

    fn all_again(&mut self) -> anyhow::Result<bool> {
        for index in 0..self.lanes.len() {
            self.lanes[index].resident.failing.clear();
            self.ask(index, all())?;
        }
        Ok(true)
    }
}

impl Lane {
    fn new(index: usize, of: &str, path: &str, source: &Source, records: &Path) -> Self {
        Self {
            name: format!("{path}{of}"),
            resident: Resident::new(path, source.clone(), records.join(index.to_string())),
            verdicts: Verdicts::default(),
            alone: true,
            validates: false,
            reads: Reads::Any,
            began: Instant::now(),
        }
    }
}

fn all() -> Request {
    Request { all: true, ..Request::default() }
}

/// Returns the watched folder `whole`, and the folders outside of it from which packages import modules.
fn outermost(whole: &Path, sources: &[Source]) -> Vec<PathBuf> {
    let mut folders = vec![whole.to_owned()];
    let shaders = sources.iter().filter_map(|source| match source {
        Source::Shaders(folder) => Package::open(folder).ok(),
        Source::Cargo(_) => None,
    });
    let places = shaders.flat_map(|package| package.places());
    let mut places: Vec<PathBuf> = places.filter_map(|place| place.canonicalize().ok()).collect();
    places.sort();
    for place in places {
        if !folders.iter().any(|folder| place.starts_with(folder)) {
            folders.push(place);
        }
    }
    folders
}

/// Returns the path of a file relative to the watched folder.
fn shown(file: &Path, folder: &Path) -> String {
    match file.strip_prefix(folder) {
        Ok(below) if below == Path::new("") => ".".to_owned(),
        Ok(below) => below.display().to_string(),
        Err(_) => file.display().to_string(),
    }
}

/// Sends an event if Ctrl-C or the system asks the command to end, so that the command deletes its temporary folders
/// before it ends. A second signal ends the command at once.
fn tell_when_stopped(sender: Sender<Event>) -> anyhow::Result<()> {
    const INTERRUPTED: i32 = 130; // 128 and the number of SIGINT, as shells have it
    let told = AtomicBool::new(false);
    let stop = move || {
        if told.swap(true, Ordering::Relaxed) || sender.send(Event::Stopped).is_err() {
            std::process::exit(INTERRUPTED);
        }
    };
    ctrlc::set_handler(stop).context("can't wait for Ctrl-C")
}

/// Sends an event when the program that reads the output has ended. The command may write nothing for hours, so it
/// can't wait for the error of the next write.
#[cfg(unix)]
fn tell_when_unread(sender: Sender<Event>) {
    use rustix::event::{PollFd, PollFlags, poll};
    std::thread::spawn(move || {
        let stdout = std::io::stdout();
        // The poll requests no event, so it reports only errors and the end.
        let mut watched = [PollFd::new(&stdout, PollFlags::empty())];
        while let Err(rustix::io::Errno::INTR) = poll(&mut watched, None) {}
        if watched[0].revents().intersects(PollFlags::ERR | PollFlags::HUP) {
            drop(sender.send(Event::Unread));
        }
    });
}

/// Does nothing: after the program that reads the output has ended, the next write fails.
#[cfg(not(unix))]
fn tell_when_unread(_: Sender<Event>) {}

/// Sends events for keys, as long as there is a receiver.
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
