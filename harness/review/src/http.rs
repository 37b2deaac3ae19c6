//! HTTP/1.1 for a page on this machine: one request per connection, each on a thread of its own.
//!
//! Everybody on this machine can connect, so the server never waits long for a client. A request
//! has to arrive within a time, its head and body have a largest size, and the lengths that it
//! announces aren't trusted. If there are too many connections, the oldest one that hasn't sent a
//! useful request is closed, so silent clients make room for others. Stopping waits for no client.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Longest head that is read: it has the cookies of every server on this machine, whatever its
/// port.
const LONGEST_HEAD: usize = 16 << 10;
/// Most headers that are read; browsers send about twenty.
const MOST_HEADERS: usize = 100;
/// Longest time in which a request comes, and in which a client takes some of its answer. Both
/// are on one machine.
const PATIENCE: Duration = Duration::from_secs(10);
/// Longest time in which the rest of a request that is answered already is read and thrown away.
const LINGER: Duration = Duration::from_secs(2);
/// Most connections at a time. A browser opens six, and another that it may need soon.
const MOST_OPEN: usize = 64;
/// Pause after a connection that couldn't be had, so that an error that stays isn't asked for at
/// once.
const PAUSE: Duration = Duration::from_millis(50);

/// Sent with each answer: browsers use it for nothing else, and don't keep it.
const HEADERS: &str = "Cache-Control: no-store\r\n\
    X-Content-Type-Options: nosniff\r\n\
    Cross-Origin-Resource-Policy: same-origin\r\n\
    Cross-Origin-Opener-Policy: same-origin\r\n\
    Referrer-Policy: same-origin\r\n\
    Connection: close\r\n";

/// The policy for frames: no page may frame this one.
const UNFRAMED: &str = "'none'";
/// An editor that asked for the page, in a panel: VS Code's windows have schemes of their own, and are pages of this
/// machine where it runs in a browser. Another page that would frame it has to know the token.
const FRAMED: &str = "vscode-file: vscode-webview: http://127.0.0.1:* http://localhost:*";

/// An answer: status, content type, body.
pub struct Answer(pub u16, pub &'static str, pub String);

impl Answer {
    /// Plain text, with a line end.
    #[must_use]
    pub fn text(status: u16, text: &str) -> Self {
        Self(status, "text/plain; charset=utf-8", format!("{text}\n"))
    }
}

/// A port on 127.0.0.1.
pub struct Http {
    listener: TcpListener,
    address: SocketAddr,
    stopped: Arc<AtomicBool>,
    open: Arc<Open>,
    ancestors: &'static str,
}

/// Stops an [`Http`].
#[derive(Clone)]
pub struct Stopper {
    address: SocketAddr,
    stopped: Arc<AtomicBool>,
}

impl Stopper {
    /// Ends [`Http::run`].
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::SeqCst);
        // Whoever waits for a connection gets one. If there is none to be had, it isn't waiting.
        drop(TcpStream::connect_timeout(&self.address, PATIENCE));
    }
}

impl Http {
    /// Takes a port, any that is free if it is 0. An editor may show the page in a frame.
    ///
    /// # Errors
    /// If the port is taken.
    pub fn bind(port: u16, in_editor: bool) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        let address = listener.local_addr()?;
        let (stopped, open) = Default::default();
        let ancestors = if in_editor { FRAMED } else { UNFRAMED };
        Ok(Self { listener, address, stopped, open, ancestors })
    }

    /// The port.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.address.port()
    }

    /// A way to stop it from another thread.
    #[must_use]
    pub fn stopper(&self) -> Stopper {
        Stopper { address: self.address, stopped: Arc::clone(&self.stopped) }
    }

    /// Answers until it is stopped; threads that are answering then are left to themselves.
    pub fn run(&self, answer: impl Fn(&mut Request) -> Answer + Send + Sync + 'static) {
        let answer = Arc::new(answer);
        while !self.stopped.load(Ordering::SeqCst) {
            let Ok((stream, _)) = self.listener.accept() else {
                thread::sleep(PAUSE);
                continue;
            };
            let connection = Open::enter(&self.open, stream);
            let (answer, ancestors) = (Arc::clone(&answer), self.ancestors);
            let serve = move || {
                // A client that has gone, or never spoke, needs no answer.
                drop(connection.serve(&*answer, ancestors));
            };
            if thread::Builder::new().name("review".to_owned()).spawn(serve).is_err() {
                thread::sleep(PAUSE);
            }
        }
    }
}

/// The connections that are open, the oldest first.
#[derive(Default)]
struct Open(Mutex<Vec<Entry>>);

struct Entry {
    stream: Arc<TcpStream>,
    /// `true` if it has sent a request that we answer.
    admitted: bool,
}

impl Open {
    /// Takes a connection in, and closes another if there are too many.
    fn enter(open: &Arc<Self>, stream: TcpStream) -> Connection {
        let stream = Arc::new(stream);
        open.change(|entries| {
            if entries.len() == MOST_OPEN {
                let silent = entries.iter().position(|entry| !entry.admitted);
                let oldest = entries.remove(silent.unwrap_or(0));
                // Its thread ends, as nothing more can be read or written.
                drop(oldest.stream.shutdown(Shutdown::Both));
            }
            entries.push(Entry { stream: Arc::clone(&stream), admitted: false });
        });
        Connection { stream, open: Arc::clone(open) }
    }

    fn change(&self, change: impl FnOnce(&mut Vec<Entry>)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

/// A connection, which is closed and forgotten when it is dropped.
struct Connection {
    stream: Arc<TcpStream>,
    open: Arc<Open>,
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.open
            .change(|entries| entries.retain(|entry| !Arc::ptr_eq(&entry.stream, &self.stream)));
    }
}

impl Connection {
    fn serve(self, answer: &impl Fn(&mut Request) -> Answer, ancestors: &str) -> io::Result<()> {
        self.stream.set_write_timeout(Some(PATIENCE))?;
        let source = Timed { stream: Arc::clone(&self.stream), end: Instant::now() + PATIENCE };
        let (head_only, answer) = match Request::read(&self, source)? {
            Ok(mut request) => (request.method == "HEAD", answer(&mut request)),
            Err(refusal) => (false, refusal),
        };
        self.send(&answer, head_only, ancestors)?;
        self.linger()
    }

    fn send(
        &self,
        Answer(status, kind, body): &Answer,
        head_only: bool,
        ancestors: &str,
    ) -> io::Result<()> {
        let length = body.len();
        let head = format!(
            "HTTP/1.1 {status} \r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n\
             Content-Security-Policy: frame-ancestors {ancestors}\r\n{HEADERS}\r\n"
        );
        let mut stream = &*self.stream;
        stream.write_all(head.as_bytes())?;
        if !head_only {
            stream.write_all(body.as_bytes())?;
        }
        stream.shutdown(Shutdown::Write)
    }

    /// Reads what the client still sends. Closing before would make the system reset the
    /// connection, and the answer might be lost with it.
    fn linger(self) -> io::Result<()> {
        let mut rest = Timed { stream: Arc::clone(&self.stream), end: Instant::now() + LINGER };
        io::copy(&mut rest, &mut io::sink()).map(drop)
    }
}

/// What a client sends, up to some time.
struct Timed {
    stream: Arc<TcpStream>,
    end: Instant,
}

impl Read for Timed {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = self.end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.stream.set_read_timeout(Some(left))?;
        (&*self.stream).read(buffer)
    }
}

/// The secret in the URL of a page: the URL is the key.
pub struct Door {
    port: u16,
    token: String,
}

impl Door {
    /// A new one.
    ///
    /// # Errors
    /// If the system has no random numbers.
    pub fn new(http: &Http) -> io::Result<Self> {
        let mut random = [0; 16];
        getrandom::fill(&mut random).map_err(io::Error::other)?;
        let token = random.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Self { port: http.port(), token })
    }

    /// The secret.
    #[must_use]
    pub fn token(&self) -> &str {
        &self.token
    }

    /// The page's URL.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/{}/", self.port, self.token)
    }

    /// The place behind the secret that a request asks for: empty is the page itself. `printed` names the command that
    /// printed the URL.
    ///
    /// # Errors
    /// If it lacks the secret, or comes from a page of another origin.
    pub fn enter<'r>(&self, request: &'r Request<'_>, printed: &str) -> Result<&'r str, Answer> {
        let refused = |what: &str| Err(Answer::text(403, what));
        let ours = ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", self.port));
        let Ok(Some(host)) = request.header("Host") else {
            return refused("a request needs one Host");
        };
        if !ours.iter().any(|name| name == host) {
            return refused("this Host isn't ours");
        }
        let own = match request.header("Origin") {
            Ok(Some(origin)) => origin == format!("http://{host}"),
            Ok(None) => request.method == "GET",
            Err(_) => false,
        };
        if !own {
            return refused("this Origin isn't ours");
        }
        let token = request.url.split(['/', '?']).nth(1).unwrap_or_default();
        // Hashes are compared in constant time.
        if blake3::hash(token.as_bytes()) != blake3::hash(self.token.as_bytes()) {
            return refused(&format!("open the URL that `{printed}` printed"));
        }
        request.admit();
        let url = request.url.split('?').next().unwrap_or_default();
        Ok(url.get(self.token.len() + 2..).unwrap_or_default())
    }
}

/// A request whose head has been read.
pub struct Request<'a> {
    /// `GET`, `POST`, ...
    pub method: String,
    /// Path and query.
    pub url: String,
    headers: Vec<(String, String)>,
    /// What of the body came with the head.
    begun: Vec<u8>,
    rest: Timed,
    connection: &'a Connection,
}

impl<'a> Request<'a> {
    /// Reads a head, or says what is wrong with it.
    fn read(connection: &'a Connection, mut rest: Timed) -> io::Result<Result<Self, Answer>> {
        let mut begun = Vec::new();
        loop {
            let mut piece = [0; 4096];
            let length = rest.read(&mut piece)?;
            if length == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            begun.extend_from_slice(&piece[..length]);
            let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
            let mut parsed = httparse::Request::new(&mut headers);
            let end = match parsed.parse(&begun) {
                Ok(httparse::Status::Complete(end)) => end,
                Ok(httparse::Status::Partial) if begun.len() < LONGEST_HEAD => continue,
                Ok(httparse::Status::Partial) | Err(httparse::Error::TooManyHeaders) => {
                    return Ok(Err(Answer::text(431, "a request has a short head")));
                }
                Err(error) => {
                    return Ok(Err(Answer::text(400, &format!("this is no request: {error}"))));
                }
            };
            let text = |value: &[u8]| String::from_utf8_lossy(value).into_owned();
            let header = |header: &httparse::Header| (header.name.to_owned(), text(header.value));
            let method = parsed.method.unwrap_or_default().to_owned();
            let url = parsed.path.unwrap_or_default().to_owned();
            let headers = parsed.headers.iter().map(header).collect();
            begun.drain(..end);
            return Ok(Ok(Self { method, url, headers, begun, rest, connection }));
        }
    }

    /// The value of a header that is there once.
    ///
    /// # Errors
    /// If it is there more often.
    pub fn header(&self, name: &str) -> Result<Option<&str>, Repeated> {
        let mut named = self.headers.iter().filter(|(other, _)| other.eq_ignore_ascii_case(name));
        let first = named.next().map(|(_, value)| value.as_str());
        if named.next().is_some() { Err(Repeated) } else { Ok(first) }
    }

    /// Keeps this connection from being closed in favour of one that hasn't said anything yet.
    pub fn admit(&self) {
        self.connection.open.change(|entries| {
            for entry in entries {
                entry.admitted |= Arc::ptr_eq(&entry.stream, &self.connection.stream);
            }
        });
    }

    /// Reads the body, if the request says how long it is and that isn't more than `longest`.
    pub fn body(&mut self, longest: u64) -> Option<io::Result<String>> {
        let said = match (self.header("Transfer-Encoding"), self.header("Content-Length")) {
            (Ok(None), Ok(Some(said))) if said.bytes().all(|byte| byte.is_ascii_digit()) => said,
            _ => return None,
        };
        let length = said.parse().ok().filter(|length| *length <= longest)?;
        let mut body = String::new();
        let read = self.begun.chain(&mut self.rest).take(length).read_to_string(&mut body);
        Some(read.map(|_| body))
    }
}

/// A header that may be there once is there more often.
#[derive(Debug)]
pub struct Repeated;
