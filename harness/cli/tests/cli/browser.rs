//! Tests `karat browser` with fake pages: a page that sends wrong replies, a second page, and a page of another site.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, Stdio};
use std::thread::JoinHandle;

use super::*;

const TEST: &str = "fn half(x: f32) -> f32 { return 0.5 * x; }\n\
                    @test fn one() { expect_near(half(2.0), 1.0, 0.0); }\nimport karat::expect_near;\n";

/// A running `karat browser` that waits for pages.
struct Served {
    child: Child,
    /// The host and the port, as `127.0.0.1:PORT`.
    host: String,
    token: String,
    /// The thread that reads the output after the URL.
    rest: Option<JoinHandle<String>>,
}

impl Served {
    fn start(folder: &FilePath, words: &[&str]) -> Self {
        let mut browser = command(folder, &["browser", "--wait", "20"]);
        // The deadline ends a job that gets no reply.
        browser.env("KARAT_TIMEOUT", "3");
        let piped = browser.args(words).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = piped.spawn().expect("it starts");
        let mut lines = BufReader::new(child.stdout.take().expect("it is piped")).lines();
        let url = lines.find_map(|line| Some(line.ok()?.strip_prefix("http://")?.to_owned()));
        let rest =
            std::thread::spawn(move || lines.map_while(Result::ok).collect::<Vec<_>>().join("\n"));
        let url = url.expect("it prints a URL");
        let (host, token) = url.split_once('/').expect("it has a secret");
        let (host, token) = (host.to_owned(), token.trim_end_matches('/').to_owned());
        Self { child, host, token, rest: Some(rest) }
    }

    /// Sends a request. Returns the status and the body of the reply, or status 0 if `karat browser` has ended.
    fn ask(&self, method: &str, place: &str, origin: Option<&str>, body: &str) -> (u16, String) {
        let Ok(mut stream) = TcpStream::connect(&self.host) else { return (0, String::new()) };
        let origin = origin.map_or(String::new(), |origin| format!("Origin: {origin}\r\n"));
        let (host, length) = (&self.host, body.len());
        let head = format!(
            "{method} {place} HTTP/1.1\r\nHost: {host}\r\n{origin}Content-Length: {length}\r\n\r\n"
        );
        let mut answer = String::new();
        let sent = stream.write_all((head + body).as_bytes());
        drop(sent.and_then(|()| stream.read_to_string(&mut answer)));
        let Some((head, body)) = answer.split_once("\r\n\r\n") else { return (0, String::new()) };
        let status = head.split(' ').nth(1).and_then(|status| status.parse().ok());
        (status.expect("it has a status"), body.to_owned())
    }

    /// Posts a message with the origin and the secret of the server's own page.
    fn say(&self, said: &serde_json::Value) -> (u16, String) {
        let own = format!("http://{}", self.host);
        self.ask("POST", &format!("/{}/next", self.token), Some(&own), &said.to_string())
    }

    /// Acts as a page: sends the first message, and then a reply from `answer` to each job, until no jobs are left.
    /// Returns the exit code and the output.
    fn answering(
        mut self,
        page: &str,
        answer: impl Fn(u64, &serde_json::Value) -> serde_json::Value,
    ) -> (Option<i32>, String) {
        let greeting =
            serde_json::json!({ "jobs": 1, "name": "a liar", "can": ["textures"] }).to_string();
        let mut said = serde_json::json!({ "page": page, "greeting": greeting });
        while self.child.try_wait().expect("it is a process").is_none() {
            let (status, body) = self.say(&said);
            said = serde_json::json!({ "page": page });
            if status == 200 && !body.is_empty() {
                let next: serde_json::Value = serde_json::from_str(&body).expect("JSON");
                let job = next["job"].as_str().expect("a job is a text");
                let job = serde_json::from_str(job).expect("a job is JSON");
                let number = next["number"].as_u64().expect("it has a number");
                let told = answer(number, &job);
                said.as_object_mut()
                    .expect("an object")
                    .extend(told.as_object().expect("an object").clone());
                if said["closed"] == true {
                    self.say(&said);
                    break;
                }
            }
        }
        let code = self.child.wait().expect("it ends").code();
        let rest = self.rest.take().expect("it is asked once").join();
        (code, rest.expect("it reads lines"))
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

fn greeting() -> String {
    serde_json::json!({ "jobs": 1, "name": "a liar", "can": ["textures"] }).to_string()
}

fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(&folder.path().join("shaders"), "m_test.wgsl", TEST);
    folder
}

/// A page of another site, a page without the secret, and a second page can't run jobs.
// Lesson 208
#[test]
fn only_the_page_of_the_printed_url_can_run_jobs() {
    let folder = folder();
    let served = Served::start(folder.path(), &["shaders"]);
    let (own, next) = (format!("http://{}", served.host), format!("/{}/next", served.token));
    let first = serde_json::json!({ "page": "1", "greeting": greeting() }).to_string();
    let wrong = format!("/{}/next", "0".repeat(served.token.len()));
    for (place, origin) in [
        (&wrong, Some(&*own)),
        (&next, Some("http://elsewhere.example")),
        (&next, None),
        (&"/next".to_owned(), Some(&*own)),
    ] {
        let (status, body) = served.ask("POST", place, origin, &first);
        assert_eq!(status, 403, "{place} {origin:?}: {body}");
    }
    assert_eq!(served.ask("GET", &format!("/{}/else", served.token), None, "").0, 404);
    let (status, page) = served.ask("GET", &format!("/{}/", served.token), None, "");
    assert!(status == 200 && page.contains("requestAdapter"), "{page}");
    // The server ignores the first page before it has greeted, and always ignores a second page.
    let early = served.say(&serde_json::json!({ "page": "1", "number": 1, "answer": "{}" }));
    assert_eq!(early.0, 409, "{early:?}");
    assert_eq!(served.say(&serde_json::json!({ "page": "1", "greeting": "{}", "more": 1 })).0, 400);
    let first = std::thread::scope(|scope| {
        let first =
            scope.spawn(|| served.say(&serde_json::json!({ "page": "1", "greeting": greeting() })));
        std::thread::sleep(std::time::Duration::from_millis(300));
        let second = served.say(&serde_json::json!({ "page": "2", "greeting": "{}" }));
        assert!(second.0 == 409 && second.1.contains("Another page runs the tests"), "{second:?}");
        first.join().expect("it is answered")
    });
    assert!(matches!(first.0, 200 | 204), "{first:?}");
}

/// Tests fail if a reply is too short, belongs to another job or isn't a reply. The tests also fail if the page is
/// closed.
// Lesson 208
#[test]
fn wrong_answers_of_a_browser_page_fail_the_tests() {
    let folder = folder();
    let done = |job: &serde_json::Value, words: Vec<u32>| {
        serde_json::json!({ "id": job["id"], "reply": { "done": [words] } }).to_string()
    };
    type Answer<'a> = &'a dyn Fn(u64, &serde_json::Value) -> serde_json::Value;
    let told =
        |number: u64, answer: String| serde_json::json!({ "number": number, "answer": answer });
    let answers: [(&str, Answer<'_>); 6] = [
        ("outputs of [1] words, but the job needs [3]", &|number, job| {
            told(number, done(job, vec![0]))
        }),
        ("outputs of [65536] words", &|number, job| told(number, done(job, vec![0; 1 << 16]))),
        ("wrote no result for 1 of 1 cases", &|number, job| told(number, done(job, vec![0; 3]))),
        ("a line that isn't an answer: yes", &|number, _| told(number, "yes".to_owned())),
        // The reply belongs to no job, so the job's deadline passes.
        ("did not finish within 3 s", &|number, job| told(number - 1, done(job, vec![0; 3]))),
        ("the page was closed", &|_, _| serde_json::json!({ "closed": true })),
    ];
    for (wrong, answer) in answers {
        let served = Served::start(folder.path(), &["shaders"]);
        let (code, told) = served.answering("1", answer);
        assert!(code == Some(1) && told.contains(wrong), "no `{wrong}` in {told}");
    }
}

/// If no browser opens the page in time, `karat browser` fails, and no test runs.
// Lesson 208
#[test]
fn no_page_is_an_error() {
    let folder = folder();
    let ran = karat(folder.path(), &["browser", "--wait", "0", "shaders"]);
    assert_eq!(ran.code, Some(2), "{ran:?}");
    assert!(ran.err.contains("no browser opened the page within 0 s"), "{ran:?}");
}
