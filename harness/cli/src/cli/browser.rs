//! `karat browser`: serves a page, and runs the tests in the browser that opens this page.
//!
//! `karat test` and the test programs start `karat` again as an executor (`KARAT_EXECUTORS`). The executor passes each
//! job to the `karat browser` that serves the page. The executor reads the port and the secret of `karat browser` from
//! a file that only the current user can read.

use std::io::{BufRead, BufReader, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, bail, ensure};
use karat::unstable::output::tell;
use karat::unstable::path::BROWSER_SCRIPTS;
use karat_review::http::{Answer, Door, Http, Request};
use serde::Deserialize;

use super::{Ending, Outcome, child};

/// The largest size of a page's reply, in bytes. A frame of 4096 by 4096 pixels fits into this size. The replies of
/// other executors have the same limit.
const LONGEST: u64 = 1 << 30;

/// The longest time that a page's request for a job waits. If there is no job by then, the server replies that there is
/// no job, and the page asks again. This time is short, because proxies and browsers may abort a request after 30
/// seconds.
const POLL: Duration = Duration::from_secs(5);

/// The time after which Karat treats a silent page as closed. This time is long, because a page in a background tab may
/// ask late for its next job.
const GONE: Duration = Duration::from_secs(30);

#[derive(clap::Args)]
pub(super) struct Args {
    /// Serves the page on this port of 127.0.0.1 [default: any free port]
    #[arg(long, value_name = "PORT", default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Opens the page in your default browser
    #[arg(long)]
    open: bool,
    /// Waits this many seconds for a browser to open the page
    #[arg(long, value_name = "SECONDS", default_value_t = 120)]
    wait: u64,
    /// Arguments for `karat test`
    #[arg(value_name = "TEST ARGUMENTS", trailing_var_arg = true, allow_hyphen_values = true)]
    words: Vec<String>,
    /// Passes jobs to the `karat browser` whose port and secret this file holds
    #[arg(long, hide = true, value_name = "FILE")]
    relay: Option<PathBuf>,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    if let Some(file) = &args.relay {
        return relay(file, out);
    }
    let http = Http::bind(args.port, false).context("can't serve the page")?;
    let desk = Arc::new(Desk {
        door: Door::new(&http)?,
        turn: Mutex::default(),
        state: Mutex::default(),
        changed: Condvar::new(),
    });
    let stop = http.stopper();
    writeln!(out, "open this page in the browser that should run the tests:\n{}", desk.door.url())?;
    out.flush()?;
    if args.open
        && let Err(error) = open::that_detached(desk.door.url())
    {
        tell(&format!("can't open a browser ({error}); open the URL yourself"));
    }
    let serving = Arc::clone(&desk);
    std::thread::spawn(move || http.run(move |request| serving.answer(request)));
    let is_greeted = desk.is_greeted(Duration::from_secs(args.wait));
    if let Some(failed) = &locked(&desk.state).failed {
        bail!("this browser can't run tests: {failed}; open the page in another browser");
    }
    ensure!(
        is_greeted,
        "no browser opened the page within {} s: open the page sooner, or give a longer time with --wait SECONDS",
        args.wait
    );
    let scratch = tempfile::tempdir().context("can't make a temporary folder")?;
    let file = scratch.path().join("page");
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))
        .context("can't open a port for the tests' jobs")?;
    std::fs::write(&file, format!("{} {}", listener.local_addr()?.port(), desk.door.token()))?;
    let relaying = Arc::clone(&desk);
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let desk = Arc::clone(&relaying);
            std::thread::spawn(move || drop(desk.relay(&stream)));
        }
    });
    let program = std::env::current_exe().context("can't find karat's executable file")?;
    let relay = format!("{} browser --relay {}", program.display(), file.display());
    ensure!(
        relay.split_whitespace().count() == 4 && !relay.contains(';'),
        "the path of the program `{}` or of the temporary file `{}` has a blank or a semicolon: move karat, or set TMPDIR",
        program.display(),
        file.display()
    );
    let mut command = Command::new(program);
    command.arg("test").args(&args.words);
    command
        .env("KARAT_EXECUTORS", format!("browser={relay}"))
        .env("KARAT_PATHS", "process@browser");
    let status = child::pass_on(&mut command, out)?;
    stop.stop();
    match status.code() {
        Some(0) => Ok(Ending::Good),
        Some(1) => Ok(Ending::Bad),
        Some(3) => Ok(Ending::Missing),
        // The program has printed its error.
        Some(_) => Err(super::Reported.into()),
        None => bail!("the tests ended ({status})"),
    }
}

/// Runs as an executor from `KARAT_EXECUTORS`: passes each job from standard input to `karat browser`, and prints the
/// reply.
fn relay(file: &Path, out: &mut dyn Write) -> Outcome {
    let told = std::fs::read_to_string(file).context("`karat browser` has ended")?;
    let (port, token) =
        told.split_once(' ').context("the file of --relay doesn't contain a port and a secret")?;
    let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port.parse()?))
        .context("`karat browser` has ended")?;
    writeln!(stream, "{token}")?;
    let mut replies = BufReader::new(stream.try_clone()?).lines();
    let mut jobs = std::io::stdin().lock().lines();
    loop {
        let reply = replies.next().context("`karat browser` has ended")??;
        if let Some(why) = reply.strip_prefix('!') {
            bail!("{why}");
        }
        writeln!(out, "{reply}")?;
        out.flush()?;
        let Some(job) = jobs.next() else { return Ok(Ending::Good) };
        writeln!(stream, "{}", job?)?;
    }
}

/// A message from the page. The first message has the page's `greeting`. In each later message, `answer` is the page's
/// reply to the job `number`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Said {
    page: String,
    #[serde(default)]
    greeting: Option<String>,
    #[serde(default)]
    number: u64,
    #[serde(default)]
    answer: Option<String>,
    #[serde(default)]
    closed: bool,
    /// The reason why this page can't run jobs, for example because the browser lacks WebGPU.
    #[serde(default)]
    failed: Option<String>,
}

#[derive(Default)]
struct State {
    page: Option<(String, Instant)>,
    greeting: String,
    /// The number of jobs so far, which is also the number of the last job.
    jobs: u64,
    /// The last job, until the page fetches it.
    waiting: Option<String>,
    /// The page's reply to the last job.
    answer: Option<String>,
    /// `true` while the page runs the last job.
    is_taken: bool,
    /// The reason why the opened page can't run jobs.
    failed: Option<String>,
}

struct Desk {
    door: Door,
    /// The lock that lets only one program at a time send a job and wait for the reply.
    turn: Mutex<()>,
    state: Mutex<State>,
    changed: Condvar,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Checks if the stream is still open at the other end.
fn is_open(stream: &TcpStream) -> bool {
    let peeked = stream.set_nonblocking(true).and_then(|()| stream.peek(&mut [0]));
    let is_blocking = stream.set_nonblocking(false).is_ok();
    is_blocking && peeked.is_err_and(|error| error.kind() == std::io::ErrorKind::WouldBlock)
}

impl Desk {
    /// Waits until a page opens. Returns `false` if no page opens in time.
    fn is_greeted(&self, patience: Duration) -> bool {
        let is_alone = |state: &mut State| state.page.is_none() && state.failed.is_none();
        let waited = self.changed.wait_timeout_while(locked(&self.state), patience, is_alone);
        waited.unwrap_or_else(PoisonError::into_inner).0.page.is_some()
    }

    fn answer(&self, request: &mut Request<'_>) -> Answer {
        let place = match self.door.enter(request, "karat browser") {
            Ok(place) => place.to_owned(),
            Err(refusal) => return refusal,
        };
        match (request.method.as_str(), place.as_str()) {
            ("GET", "") => {
                let head = "<!doctype html><meta charset=utf-8><title>Karat</title><p>One moment.</p><script type=module>";
                Answer(
                    200,
                    "text/html; charset=utf-8",
                    format!("{head}{BROWSER_SCRIPTS}</script>\n"),
                )
            }
            ("POST", "next") => match request.body(LONGEST) {
                Some(Ok(body)) => match serde_json::from_str(&body) {
                    Ok(said) => self.next(said),
                    Err(error) => Answer::text(400, &format!("can't read the reply: {error}")),
                },
                _ => Answer::text(400, "can't read the reply"),
            },
            _ => Answer::text(404, "there is nothing here"),
        }
    }

    /// Stores the reply that a page's message contains, and then answers with the next job. Waits for this job at most
    /// [`POLL`].
    fn next(&self, said: Said) -> Answer {
        let mut state = locked(&self.state);
        if let (None, Some(failed)) = (&state.page, said.failed) {
            state.failed = Some(failed);
            self.changed.notify_all();
            return Answer::text(200, "");
        }
        let is_own = state.page.as_ref().is_some_and(|(page, _)| *page == said.page);
        match (is_own, said.greeting) {
            (true, _) if said.closed => {
                *state = State { jobs: state.jobs, ..State::default() };
                self.changed.notify_all();
                return Answer::text(200, "");
            }
            (true, _) => {}
            (false, Some(greeting))
                if state.page.as_ref().is_none_or(|(_, seen)| seen.elapsed() > GONE) =>
            {
                let jobs = state.jobs;
                *state = State { jobs, greeting, ..State::default() };
            }
            (false, Some(_)) => {
                return Answer::text(
                    409,
                    "Another page runs the tests. Close the other page, and reload this page.",
                );
            }
            (false, None) => {
                return Answer::text(
                    409,
                    "Another page runs the tests, or has already run the tests. Reload this page.",
                );
            }
        }
        state.page = Some((said.page, Instant::now()));
        // A late reply belongs to a job that Karat gave up.
        if let Some(answer) = said.answer
            && state.is_taken
            && said.number == state.jobs
        {
            (state.answer, state.is_taken) = (Some(answer), false);
        }
        self.changed.notify_all();
        let waited = self.changed.wait_timeout_while(state, POLL, |state| state.waiting.is_none());
        let mut state = waited.unwrap_or_else(PoisonError::into_inner).0;
        let Some(job) = state.waiting.take() else {
            return Answer(204, "text/plain", String::new());
        };
        state.is_taken = true;
        let next = serde_json::json!({ "number": state.jobs, "job": job });
        Answer(200, "application/json", next.to_string())
    }

    fn relay(&self, stream: &TcpStream) -> std::io::Result<()> {
        let mut lines = BufReader::new(stream.try_clone()?).lines();
        let mut stream = stream;
        let token = lines.next().unwrap_or_else(|| Ok(String::new()))?;
        if blake3::hash(token.as_bytes()) != blake3::hash(self.door.token().as_bytes()) {
            return Ok(());
        }
        let greeting = match self.is_greeted(GONE) {
            true => locked(&self.state).greeting.clone(),
            false => "!the page in the browser was closed: run `karat browser` again".to_owned(),
        };
        writeln!(stream, "{}", greeting.replace('\n', " "))?;
        for job in lines {
            let reply = self.ask(job?, stream).unwrap_or_else(|why| format!("!{why}"));
            writeln!(stream, "{}", reply.replace('\n', " "))?;
        }
        Ok(())
    }

    /// Sends a job to the page, and returns the page's reply. The program that sent the job has a deadline. If the job
    /// hangs, the program closes the stream `asking`, and this function stops waiting.
    fn ask(&self, job: String, asking: &TcpStream) -> Result<String, &'static str> {
        let _turn = locked(&self.turn);
        let mut state = locked(&self.state);
        state.jobs += 1;
        (state.waiting, state.answer, state.is_taken) = (Some(job), None, false);
        self.changed.notify_all();
        loop {
            if let Some(answer) = state.answer.take() {
                return Ok(answer);
            }
            let is_gone = match &state.page {
                None => true,
                Some((_, seen)) => !state.is_taken && seen.elapsed() > GONE,
            };
            if !is_open(asking) {
                return Err("the program that sent the job no longer waits for the reply");
            }
            if is_gone {
                state.waiting = None;
                return Err("the page was closed or doesn't answer: run `karat browser` again");
            }
            let waited = self.changed.wait_timeout(state, POLL);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}
