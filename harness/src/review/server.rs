//! The review served to this machine alone.
//!
//! Who can reach the port isn't yet who may decide: every request needs the token of the URL, a
//! `Host` that is ours (so that no other name was rebound to 127.0.0.1) and, if it names one, an
//! `Origin` that is ours. Changes are POSTs of JSON. A frame is chosen by a name that is compared
//! with those that are pending; nothing of a request becomes a path.

use std::io::Read;
use std::sync::{Arc, Mutex, PoisonError};

use serde::Deserialize;
use serde_json::json;
use tiny_http::{Header, Method, Request, Response};

use super::{Review, ReviewError, data, page};
use crate::golden::{AcceptError, Acceptance, Pending, PendingFrames};

/// Longest decision that is read; a reason is a sentence.
const LONGEST_BODY: u64 = 64 << 10;

/// A review page that is being served.
pub struct Server {
    review: Review,
    http: Arc<tiny_http::Server>,
    port: u16,
    token: String,
    /// Names by the number of their data file, which stays what it is while the server runs.
    numbered: Mutex<Vec<String>>,
}

/// Stops a [`Server`], from any thread.
#[derive(Clone)]
pub struct Stop(Arc<tiny_http::Server>);

impl Stop {
    /// Ends [`Server::run`].
    pub fn stop(&self) {
        self.0.unblock();
    }
}

/// What the page sends to accept or to reject.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Decision {
    /// Name of the frame.
    case: String,
    /// Hash of the pixels that were looked at.
    pixels: String,
    #[serde(default)]
    because: String,
    /// Whether it becomes the golden of its own profile.
    #[serde(default)]
    profile: bool,
    #[serde(default)]
    any_adapter: bool,
}

/// Why a decision isn't carried out.
#[derive(Debug, thiserror::Error)]
enum Refused {
    #[error(transparent)]
    Goldens(#[from] AcceptError),
    #[error("frame `{0}` was rendered again since this page loaded it; reload to see it")]
    Unseen(String),
}

/// An answer: status, content type, body.
struct Answer(u16, &'static str, String);

impl Answer {
    fn text(status: u16, text: &str) -> Self {
        Self(status, "text/plain; charset=utf-8", format!("{text}\n"))
    }
}

impl Server {
    pub(super) fn bind(review: Review, port: u16) -> Result<Self, ReviewError> {
        let failed = |reason: String| ReviewError::Serve { port, reason };
        let http = tiny_http::Server::http(("127.0.0.1", port))
            .map_err(|error| failed(error.to_string()))?;
        let address = http.server_addr().to_ip();
        let port = address.ok_or_else(|| failed("it has no address".to_owned()))?.port();
        let mut random = [0; 16];
        getrandom::fill(&mut random).map_err(|error| failed(error.to_string()))?;
        let token = random.iter().map(|byte| format!("{byte:02x}")).collect();
        let numbered = Mutex::default();
        Ok(Self { review, http: Arc::new(http), port, token, numbered })
    }

    /// Where the page is. Whoever knows this can accept and reject.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/{}/", self.port, self.token)
    }

    /// What stops it.
    #[must_use]
    pub fn stop(&self) -> Stop {
        Stop(Arc::clone(&self.http))
    }

    /// What is pending now.
    #[must_use]
    pub fn pending(&self) -> PendingFrames {
        self.review.pending()
    }

    /// Answers until it is stopped.
    pub fn run(&self) {
        while let Ok(mut request) = self.http.recv() {
            let Answer(status, kind, body) = self.answer(&mut request);
            let mut response = Response::from_string(body).with_status_code(status);
            for (name, value) in [
                ("Content-Type", kind),
                ("Cache-Control", "no-store"),
                ("X-Content-Type-Options", "nosniff"),
                ("Cross-Origin-Resource-Policy", "same-origin"),
                ("Cross-Origin-Opener-Policy", "same-origin"),
                ("Referrer-Policy", "same-origin"),
                ("Content-Security-Policy", "frame-ancestors 'none'"),
            ] {
                let header = Header::from_bytes(name, value).expect("ASCII");
                response.add_header(header);
            }
            // A reader that has gone needs no answer.
            drop(request.respond(response));
        }
    }

    fn answer(&self, request: &mut Request) -> Answer {
        if let Err(refusal) = self.admit(request) {
            return refusal;
        }
        let url = request.url().split('?').next().unwrap_or_default();
        let place = url.get(self.token.len() + 2..).unwrap_or_default().to_owned();
        let number = place.strip_prefix("data/").and_then(|file| file.strip_suffix(".js"));
        let number = number.and_then(|number| number.parse().ok());
        match (request.method(), place.as_str(), number) {
            (Method::Get, "", _) => self.page(),
            (Method::Get, _, Some(number)) => self.data(number),
            (Method::Post, "accept", _) => self.decide(request, Self::accept),
            (Method::Post, "reject", _) => self.decide(request, Self::reject),
            (_, "" | "accept" | "reject", _) | (_, _, Some(_)) => {
                Answer::text(405, "this takes another method")
            }
            _ => Answer::text(404, "there is nothing here"),
        }
    }

    /// Whether a request comes from somebody who was given the URL, and from our own page.
    fn admit(&self, request: &Request) -> Result<(), Answer> {
        let refused = |what| Err(Answer::text(403, what));
        let value = |name: &'static str| {
            let mut headers = request.headers().iter().filter(|header| header.field.equiv(name));
            (headers.next().map(|header| header.value.as_str()), headers.next().is_none())
        };
        let ours = ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", self.port));
        let (Some(host), true) = value("Host") else { return refused("a request needs one Host") };
        if !ours.iter().any(|name| name == host) {
            return refused("this Host isn't ours");
        }
        let (origin, single) = value("Origin");
        let foreign = origin.is_some_and(|origin| origin != format!("http://{host}"));
        if foreign || !single || (origin.is_none() && *request.method() != Method::Get) {
            return refused("this Origin isn't ours");
        }
        let token = request.url().split(['/', '?']).nth(1).unwrap_or_default();
        // Hashes are compared in constant time.
        if blake3::hash(token.as_bytes()) != blake3::hash(self.token.as_bytes()) {
            return refused("open the URL that `karat review` printed");
        }
        Ok(())
    }

    fn page(&self) -> Answer {
        let pending = self.review.pending();
        let mut numbered = self.numbered.lock().unwrap_or_else(PoisonError::into_inner);
        let mut numbers = Vec::new();
        for frame in &pending.frames {
            let known = numbered.iter().position(|name| *name == frame.case);
            numbers.push(known.unwrap_or(numbered.len()));
            if known.is_none() {
                numbered.push(frame.case.clone());
            }
        }
        let mode = page::Mode::Served { token: self.token.clone() };
        let html = page::html(&pending, &numbers, &self.review.arguments, &mode);
        Answer(200, "text/html; charset=utf-8", html)
    }

    fn data(&self, number: usize) -> Answer {
        let name = {
            let numbered = self.numbered.lock().unwrap_or_else(PoisonError::into_inner);
            numbered.get(number).cloned()
        };
        let Some(name) = name else { return Answer::text(404, "there is no such case") };
        // The page can't read the status of a script, so what is wrong is told by one.
        let script = match self.find(&name) {
            Ok(pending) => self.review.script(number, &pending),
            Err(error) => data::failure(number, &error.to_string()),
        };
        Answer(200, "text/javascript; charset=utf-8", script)
    }

    /// The pending frame of exactly this name.
    fn find(&self, name: &str) -> Result<Pending, Refused> {
        let pending = self.review.pending().frames;
        let found = pending.into_iter().find(|pending| pending.case == name);
        let gone = || AcceptError::NotPending { case: name.to_owned(), nearest: None };
        Ok(found.ok_or_else(gone)?)
    }

    fn decide(
        &self,
        request: &mut Request,
        carry_out: impl Fn(&Self, &Pending, &Decision) -> Result<(), AcceptError>,
    ) -> Answer {
        let kind = request.headers().iter().find(|header| header.field.equiv("Content-Type"));
        if !kind.is_some_and(|kind| kind.value.as_str().starts_with("application/json")) {
            return Answer::text(415, "a decision is JSON");
        }
        if request.body_length().is_none_or(|length| length as u64 > LONGEST_BODY) {
            return Answer::text(413, "a decision is short, and says how long it is");
        }
        let mut body = String::new();
        if request.as_reader().take(LONGEST_BODY).read_to_string(&mut body).is_err() {
            return Answer::text(400, "a decision is UTF-8");
        }
        let decision: Decision = match serde_json::from_str(&body) {
            Ok(decision) => decision,
            Err(error) => return Answer::text(400, &format!("this is no decision: {error}")),
        };
        let outcome = self.find(&decision.case).and_then(|pending| {
            if pending.provenance.pixels != decision.pixels {
                return Err(Refused::Unseen(decision.case.clone()));
            }
            Ok(carry_out(self, &pending, &decision)?)
        });
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
            // The golden of a profile that it was compared with is what it replaces.
            profile: (decision.profile || !pending.provenance.compared_profile.is_empty())
                .then(|| pending.profile().to_string()),
        };
        let accepted = self.review.goldens.accept(pending, &acceptance)?;
        for warning in accepted.warnings {
            eprintln!("note: {}: {warning}", pending.case);
        }
        Ok(())
    }

    fn reject(&self, pending: &Pending, _: &Decision) -> Result<(), AcceptError> {
        self.review.goldens.reject(pending)
    }
}
