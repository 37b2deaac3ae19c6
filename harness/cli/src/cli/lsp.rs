//!
//! `karat lsp`: a language server. It shows invalid modules, failing tests, and a lens beside each function.
//!
//! A verdict depends on the files that its test read. When one of these files changes, the server hides the verdict.
//! Standard output contains only messages of the protocol. After an invalid message, the session continues.

mod documents;
mod findings;
mod lenses;
mod live;
mod place;
mod root;
mod run;
mod server;
mod shown;
mod wire;

use std::io::Write;
use std::path::PathBuf;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use self::server::Server;
use self::wire::{Client, Heard, hear};
use super::watch::Said;
use super::{Ending, Outcome};

/// The pause in typing after which the server validates modules.
const PAUSE: Duration = Duration::from_millis(60);

/// The longest time after an edit until the server validates modules, even without a pause in typing.
const LONGEST: Duration = Duration::from_millis(400);

/// The interval at which the server checks if another process, such as `karat test` in a terminal, has ended a run.
const LOOK: Duration = Duration::from_millis(500);

#[derive(clap::Args)]
pub(super) struct Args {
    /// After each save, uses these paths to run the tests that aren't in Rust, with one process per path
    #[arg(long, value_name = "PATHS", default_value = "cpu", env = "KARAT_PATHS")]
    paths: String,
    /// Does nothing: editors pass it, and the server always uses standard input and output
    #[arg(long, hide = true)]
    stdio: bool,
}

enum Event {
    Heard(Heard),
    Files(Vec<PathBuf>),
    /// A process that runs tests wrote a line, or ended.
    Worker(usize, Said),
    /// The tests that the user started with a lens have ended.
    Ran(run::Ended),
}

pub(super) fn run(args: &Args, _: &mut dyn Write) -> Outcome {
    let paths = karat::unstable::path::named("--paths", &args.paths)?;
    let paths = paths.iter().map(ToString::to_string).collect();
    let (sender, events) = channel();
    let heard = sender.clone();
    std::thread::spawn(move || {
        let mut from = std::io::stdin().lock();
        loop {
            let message = hear(&mut from);
            let is_last = message == Heard::End;
            if heard.send(Event::Heard(message)).is_err() || is_last {
                return;
            }
        }
    });
    // The output of other commands escapes control characters. This output must not, because the protocol counts bytes.
    let client = Client::new(Box::new(std::io::stdout()));
    let mut server = Server::new(client, paths, sender)?;
    let (mut waits_since, mut looked): (Option<Instant>, _) = (None, Instant::now());
    loop {
        let patience = match waits_since {
            Some(since) => PAUSE.min(LONGEST.saturating_sub(since.elapsed())),
            None => LOOK.saturating_sub(looked.elapsed()),
        };
        match events.recv_timeout(patience) {
            Ok(event) => {
                if let Some(ended_well) = server.take(event) {
                    return Ok(if ended_well { Ending::Good } else { Ending::Bad });
                }
            }
            Err(RecvTimeoutError::Timeout) => server.settle(),
            Err(RecvTimeoutError::Disconnected) => return Ok(Ending::Bad),
        }
        // This check runs even if requests never pause.
        if looked.elapsed() >= LOOK {
            server.look();
            looked = Instant::now();
        }
        if server.is_gone() {
            return Ok(Ending::Bad);
        }
        waits_since = server.is_unsettled().then(|| waits_since.unwrap_or_else(Instant::now));
    }
}
