//! Serves the review to this machine only.
//!
//! A client that reaches the port can't accept or reject frames without the token. Every request needs the token of the
//! URL. Every request also needs this server's `Host`, so an attacker can't use another host name that resolves to
//! 127.0.0.1 (DNS rebinding). If a request has an `Origin`, the origin must be this server's. Requests that change
//! something are POSTs of JSON. A decision names a frame, which must be pending. No part of a request becomes a file
//! path.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::Deserialize;
use serde_json::json;

use super::http::{Answer, Door, Http, Request, Stopper};
use super::{Entry, Review, ReviewError, data, page, version_script};
use karat::unstable::golden::{AcceptError, Acceptance, Pending, PendingFrames};

/// The largest size of a decision, in bytes. The longest part of a decision is its reason, which is about a sentence.
const LONGEST_BODY: u64 = 64 << 10;

/// A review page that is being served.
pub struct Server {
    http: Http,
    desk: Arc<Desk>,
}

/// A handle that stops a [`Server`] from any thread.
#[derive(Clone)]
pub struct Stop(Stopper);

impl Stop {
    /// Makes [`Server::run`] return.
    pub fn stop(&self) {
        self.0.stop();
    }
}

/// The state that the server needs to reply to requests. Many threads use it.
struct Desk {
    review: Review,
    door: Door,
    /// The entries, by the numbers of their data files. The numbers don't change while the server runs.
    numbered: Mutex<Vec<Entry>>,
    /// The lock that a thread holds while it carries out a decision. The value is `true` after the review has ended:
    /// from then on, the server accepts no decision.
    ended: Mutex<bool>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Decision {
    /// The name of the frame to accept or reject.
    case: String,
    /// The hash of the pixels that the page showed.
    pixels: String,
    #[serde(default)]
    because: String,
    /// `true` if the frame becomes the golden of its profile, even if Karat compared the frame with the shared golden.
    #[serde(default)]
    profile: bool,
    #[serde(default)]
    any_adapter: bool,
}

/// The reason why the server refuses a decision.
#[derive(Debug, thiserror::Error)]
enum Refused {
    #[error(transparent)]
    Goldens(#[from] AcceptError),
    #[error("frame `{0}` was rendered again after this page loaded the frame: reload the page")]
    Unseen(String),
}

impl Server {
    pub(super) fn bind(review: Review, port: u16) -> Result<Self, ReviewError> {
        let failed = |reason: String| ReviewError::Serve { port, reason };
        let http = Http::bind(port, review.in_editor).map_err(|error| failed(error.to_string()))?;
        let door = Door::new(&http).map_err(|error| failed(error.to_string()))?;
        let (numbered, ended) = Default::default();
        let desk = Desk { review, door, numbered, ended };
        Ok(Self { http, desk: Arc::new(desk) })
    }

    /// Returns the URL of the page. A client that knows the URL can accept and reject.
    #[must_use]
    pub fn url(&self) -> String {
        self.desk.door.url()
    }

    /// Returns a handle that stops the server.
    #[must_use]
    pub fn stop(&self) -> Stop {
        Stop(self.http.stopper())
    }

    /// Returns the currently pending frames.
    #[must_use]
    pub fn pending(&self) -> PendingFrames {
        self.desk.review.pending()
    }

    /// Answers requests until another thread stops the server. After that, the server completes a decision that has
    /// begun, begins no other decision, and doesn't wait for clients.
    pub fn run(&self) {
        let desk = Arc::clone(&self.desk);
        self.http.run(move |request| desk.answer(request));
        *locked(&self.desk.ended) = true;
    }
}

/// Locks a mutex. Ignores poisoning, because a panicking thread leaves the values consistent.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Desk {
    fn answer(&self, request: &mut Request<'_>) -> Answer {
        let place = match self.door.enter(request, "karat review") {
            Ok(place) => place.to_owned(),
            Err(refusal) => return refusal,
        };
        let file = place.strip_prefix("data/").and_then(|file| file.strip_suffix(".js"));
        let (number, commit) = match file.and_then(|file| file.split_once('-')) {
            Some((number, commit)) => (Some(number), Some(commit)),
            None => (file, None),
        };
        let number = number.and_then(|number| number.parse().ok());
        match (request.method.as_str(), place.as_str(), number) {
            ("GET", "", _) => self.page(),
            ("GET", _, Some(number)) => self.data(number, commit),
            ("GET", asked, _) if asked.starts_with("ask/") => self.told(&asked[4..]),
            ("POST", "accept", _) => self.decide(request, Self::accept),
            ("POST", "reject", _) => self.decide(request, Self::reject),
            (_, "" | "accept" | "reject", _) | (_, _, Some(_)) => {
                Answer::text(405, "this URL doesn't accept the request's HTTP method")
            }
            _ => Answer::text(404, "this URL doesn't exist"),
        }
    }

    fn page(&self) -> Answer {
        let pending = self.review.pending();
        let mut numbered = locked(&self.numbered);
        let frames = pending.frames.iter().map(|frame| Entry::Pending(frame.case.clone()));
        let mut entries = Vec::new();
        for entry in frames.chain(self.review.others(&pending)) {
            let known = numbered.iter().position(|other| *other == entry);
            entries.push((known.unwrap_or(numbered.len()), entry.clone()));
            if known.is_none() {
                numbered.push(entry);
            }
        }
        let mode = page::Mode::Served { token: self.door.token().to_owned() };
        let html = page::html(&self.review, &pending, &entries, &mode);
        Answer(200, "text/html; charset=utf-8", html)
    }

    /// Returns the data of an entry. With a commit, returns an older version of the entry's golden.
    fn data(&self, number: usize, commit: Option<&str>) -> Answer {
        let entry = {
            let numbered = locked(&self.numbered);
            numbered.get(number).cloned()
        };
        let Some(entry) = entry else {
            return Answer::text(404, "the review has no entry with this number");
        };
        // The page can't read the status of a script, so a script reports the error.
        let pending = match &entry {
            Entry::Pending(name) => Some(self.find(name)),
            _ => None,
        };
        let script = match (commit, pending) {
            (Some(commit), pending) => {
                let pending = pending.and_then(Result::ok);
                match self.review.golden_of(&entry, pending.as_ref()) {
                    Some((golden, now)) => version_script(number, &golden, &now, commit),
                    None => return Answer::text(404, "the golden has no version from this commit"),
                }
            }
            (None, Some(Ok(pending))) => self.review.script(number, &pending, false),
            (None, Some(Err(error))) => data::failure(number, &error.to_string()),
            (None, None) => self.review.other_script(number, &entry),
        };
        Answer(200, "text/javascript; charset=utf-8", script)
    }

    /// Replies to a question about an entry's pixels: `asked` has the number of the entry, and the question.
    fn told(&self, asked: &str) -> Answer {
        let (number, question) = asked.split_once('/').unwrap_or((asked, ""));
        let entry = {
            let numbered = locked(&self.numbered);
            number.parse().ok().and_then(|number: usize| numbered.get(number).cloned())
        };
        match entry.and_then(|entry| self.review.asked.answer(&entry, question)) {
            Some(told) => Answer(200, "application/json", told.to_string()),
            None => Answer::text(404, "this URL doesn't exist"),
        }
    }

    /// Returns the pending frame with exactly this name.
    fn find(&self, name: &str) -> Result<Pending, Refused> {
        let pending = self.review.pending().frames;
        let found = pending.into_iter().find(|pending| pending.case == name);
        let gone = || AcceptError::NotPending { case: name.to_owned(), nearest: None };
        Ok(found.ok_or_else(gone)?)
    }

    fn decide(
        &self,
        request: &mut Request<'_>,
        carry_out: impl Fn(&Self, &Pending, &Decision) -> Result<(), AcceptError>,
    ) -> Answer {
        let kind = request.header("Content-Type").ok().flatten();
        if !kind.is_some_and(|kind| kind.starts_with("application/json")) {
            return Answer::text(415, "a decision must be JSON");
        }
        let body = match request.body(LONGEST_BODY) {
            Some(Ok(body)) => body,
            Some(Err(error)) => {
                return Answer::text(400, &format!("can't read the decision: {error}"));
            }
            None => {
                return Answer::text(
                    413,
                    "a decision must be short, and needs a `Content-Length` header",
                );
            }
        };
        let decision: Decision = match serde_json::from_str(&body) {
            Ok(decision) => decision,
            Err(error) => return Answer::text(400, &format!("can't parse the decision: {error}")),
        };
        let ended = locked(&self.ended);
        if *ended {
            return Answer::text(503, "the review has ended");
        }
        let outcome = self.find(&decision.case).and_then(|pending| {
            if pending.provenance.pixels != decision.pixels {
                return Err(Refused::Unseen(decision.case.clone()));
            }
            Ok(carry_out(self, &pending, &decision)?)
        });
        drop(ended);
        let frames = self.review.pending().frames;
        let names: Vec<String> = frames.into_iter().map(|frame| frame.case).collect();
        let (status, error) = match &outcome {
            Ok(()) => (200, None),
            Err(refused) => (409, Some(refused.to_string())),
        };
        let body = json!({ "error": error, "pending": names });
        Answer(status, "application/json", body.to_string())
    }

    fn accept(&self, pending: &Pending, decision: &Decision) -> Result<(), AcceptError> {
        let acceptance = Acceptance {
            because: decision.because.clone(),
            by: None,
            any_adapter: decision.any_adapter,
            // If the frame was compared with a profile's golden, the frame replaces that golden.
            profile: (decision.profile || !pending.provenance.compared_profile.is_empty())
                .then(|| pending.profile().to_string()),
            ci_may_write: self.review.ci_may_write,
        };
        let accepted = self.review.goldens.accept(pending, &acceptance)?;
        for warning in accepted.warnings {
            karat::unstable::output::tell(&format!("note: {}: {warning}", pending.case));
        }
        Ok(())
    }

    fn reject(&self, pending: &Pending, _: &Decision) -> Result<(), AcceptError> {
        self.review.goldens.reject(pending)
    }
}
