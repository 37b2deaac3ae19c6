//! An HTTP/1.1 server for a page on this machine: one request per connection, each in a thread of its own.
//!
//! Every program on this machine can connect, so the server never waits long for a client. A request must arrive within
//! a time limit, the sizes of its head and its body are limited, and the server doesn't trust announced lengths. If
//! there are too many connections, the server closes the oldest connection that hasn't sent a valid request. So silent
//! clients can't block others. Stopping doesn't wait for clients.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// The largest size of a head, in bytes. The head contains the cookies of every server on this machine, on any port.
const LONGEST_HEAD: usize = 16 << 10;
/// The largest number of headers. Browsers send about twenty.
const MOST_HEADERS: usize = 100;
/// The time limit for a request to arrive, and for a client to accept a part of the response. Client and server are on
/// the same machine, so a longer wait would be useless.
const PATIENCE: Duration = Duration::from_secs(10);
/// The longest time that the server, after its response, spends on reading and dropping the rest of a request.
const LINGER: Duration = Duration::from_secs(2);
/// The largest number of connections at a time. A browser opens six connections, and one more in advance.
const MOST_OPEN: usize = 64;
/// The pause after a connection that couldn't be accepted. Without this pause, a lasting error would make the server
/// spin.
const PAUSE: Duration = Duration::from_millis(50);

/// The headers of each response: they tell browsers to trust the stated content type, and not to store the response.
const HEADERS: &str = "Cache-Control: no-store\r\n\
    X-Content-Type-Options: nosniff\r\n\
    Cross-Origin-Resource-Policy: same-origin\r\n\
    Cross-Origin-Opener-Policy: same-origin\r\n\
    Referrer-Policy: same-origin\r\n\
    Connection: close\r\n";

/// The policy for HTML frames if no editor shows the page: no other page may show this page in an HTML frame.
const UNFRAMED: &str = "'none'";
/// The policy for HTML frames if an editor shows the page in a panel. The windows of the desktop program VS Code have
/// their own URL schemes. If VS Code runs in a browser, its windows are pages from this machine. Without the secret in
/// the URL, other pages on this machine can't load the page.
const FRAMED: &str = "vscode-file: vscode-webview: http://127.0.0.1:* http://localhost:*";

/// A response: status, content type, body.
pub struct Answer(pub u16, pub &'static str, pub String);

impl Answer {
    /// Returns a response with plain text and a line end.
    #[must_use]
    pub fn text(status: u16, text: &str) -> Self {
        Self(status, "text/plain; charset=utf-8", format!("{text}\n"))
    }
}

/// A server on a port of 127.0.0.1.
pub struct Http {
    listener: TcpListener,
    address: SocketAddr,
    stopped: Arc<AtomicBool>,
    open: Arc<Open>,
    ancestors: &'static str,
}

/// A handle that stops an [`Http`].
#[derive(Clone)]
pub struct Stopper {
    address: SocketAddr,
    stopped: Arc<AtomicBool>,
}

impl Stopper {
    /// Makes [`Http::run`] return.
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::SeqCst);
        // If `run` waits for a connection, this connection wakes it. If no connection is possible, `run` isn't waiting.
        drop(TcpStream::connect_timeout(&self.address, PATIENCE));
    }
}

impl Http {
    /// Binds a port, or any free port if `port` is 0. If `in_editor` is `true`, an editor may show the page in an HTML
    /// frame.
    ///
    /// # Errors
    /// Returns an error if the port is taken.
    pub fn bind(port: u16, in_editor: bool) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        let address = listener.local_addr()?;
        let (stopped, open) = Default::default();
        let ancestors = if in_editor { FRAMED } else { UNFRAMED };
        Ok(Self { listener, address, stopped, open, ancestors })
    }

    /// Returns the port.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.address.port()
    }

    /// Returns a handle that stops the server from another thread.
    #[must_use]
    pub fn stopper(&self) -> Stopper {
        Stopper { address: self.address, stopped: Arc::clone(&self.stopped) }
    }

    /// Answers requests until a [`Stopper`] stops the server. After that, the function doesn't wait for threads that
    /// are still answering.
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
                // A client that has closed the connection, or never sent anything, needs no response.
                drop(connection.serve(&*answer, ancestors));
            };
            if thread::Builder::new().name("review".to_owned()).spawn(serve).is_err() {
                thread::sleep(PAUSE);
            }
        }
    }
}

/// The open connections, the oldest first.
#[derive(Default)]
struct Open(Mutex<Vec<Entry>>);

struct Entry {
    stream: Arc<TcpStream>,
    /// `true` if the client has sent a valid request.
    admitted: bool,
}

impl Open {
    /// Adds a connection. If there are too many connections, closes the oldest connection that hasn't sent a valid
    /// request, or else the oldest connection.
    fn enter(open: &Arc<Self>, stream: TcpStream) -> Connection {
        let stream = Arc::new(stream);
        open.change(|entries| {
            if entries.len() == MOST_OPEN {
                let silent = entries.iter().position(|entry| !entry.admitted);
                let oldest = entries.remove(silent.unwrap_or(0));
                // The thread of that connection ends, because it can no longer read or write.
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

/// A connection. When this value is dropped, the connection closes, and leaves the list of open connections.
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

    /// Reads the rest of the client's data. If the server closed the connection before the rest arrived, the system
    /// would reset the connection, and the response might be lost.
    fn linger(self) -> io::Result<()> {
        let mut rest = Timed { stream: Arc::clone(&self.stream), end: Instant::now() + LINGER };
        io::copy(&mut rest, &mut io::sink()).map(drop)
    }
}

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

/// A guard that checks the secret in a page's URL, so that only clients that know the URL can use the page.
pub struct Door {
    port: u16,
    token: String,
}

impl Door {
    /// Makes a new secret.
    ///
    /// # Errors
    /// Returns an error if the system can't provide random numbers.
    pub fn new(http: &Http) -> io::Result<Self> {
        let mut random = [0; 16];
        getrandom::fill(&mut random).map_err(io::Error::other)?;
        let token = random.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Self { port: http.port(), token })
    }

    /// Returns the secret.
    #[must_use]
    pub fn token(&self) -> &str {
        &self.token
    }

    /// Returns the URL of the page.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/{}/", self.port, self.token)
    }

    /// Returns the part of a request's path that follows the secret. In a request for the page itself, this part is
    /// empty. The error message names `printed`, the command that printed the URL.
    ///
    /// # Errors
    /// Returns a response with an error if the request lacks the secret, or comes from a page of another origin.
    pub fn enter<'r>(&self, request: &'r Request<'_>, printed: &str) -> Result<&'r str, Answer> {
        let refused = |what: &str| Err(Answer::text(403, what));
        let ours = ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", self.port));
        let Ok(Some(host)) = request.header("Host") else {
            return refused("a request needs exactly one `Host` header");
        };
        if !ours.iter().any(|name| name == host) {
            return refused("the request's `Host` header names another server");
        }
        let own = match request.header("Origin") {
            Ok(Some(origin)) => origin == format!("http://{host}"),
            Ok(None) => request.method == "GET",
            Err(_) => false,
        };
        if !own {
            return refused("the request's `Origin` header names another server");
        }
        let token = request.url.split(['/', '?']).nth(1).unwrap_or_default();
        // Comparing hashes takes constant time.
        if blake3::hash(token.as_bytes()) != blake3::hash(self.token.as_bytes()) {
            return refused(&format!(
                "this URL lacks the review's secret: open the URL that `{printed}` printed"
            ));
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
    /// The path and the query.
    pub url: String,
    headers: Vec<(String, String)>,
    /// The part of the body that arrived with the head.
    begun: Vec<u8>,
    rest: Timed,
    connection: &'a Connection,
}

impl<'a> Request<'a> {
    /// Reads the head of a request. If the head is invalid, returns the response that reports the error.
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
                    return Ok(Err(Answer::text(431, "the request's headers are too long")));
                }
                Err(error) => {
                    return Ok(Err(Answer::text(
                        400,
                        &format!("can't parse the request: {error}"),
                    )));
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

    /// Returns the value of a header that occurs at most once.
    ///
    /// # Errors
    /// Returns an error if the header occurs more than once.
    pub fn header(&self, name: &str) -> Result<Option<&str>, Repeated> {
        let mut named = self.headers.iter().filter(|(other, _)| other.eq_ignore_ascii_case(name));
        let first = named.next().map(|(_, value)| value.as_str());
        if named.next().is_some() { Err(Repeated) } else { Ok(first) }
    }

    /// Marks this request as valid. If there are too many connections, the server first closes connections that haven't
    /// sent a valid request.
    pub fn admit(&self) {
        self.connection.open.change(|entries| {
            for entry in entries {
                entry.admitted |= Arc::ptr_eq(&entry.stream, &self.connection.stream);
            }
        });
    }

    /// Reads the body. Returns `None` if the request doesn't state its length, or if the length is above `longest`.
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

/// The error for a header that occurs more than once.
#[derive(Debug)]
pub struct Repeated;
