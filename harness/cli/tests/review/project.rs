//! A folder with goldens and pending frames, and the server for their review.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use karat::Image;
use karat::golden::FrameTolerance::{self, FlipMean, FlipTile};
use karat::image::Precision;
use karat::unstable::golden::FrameFinding;
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::files::write;
use crate::program::program;
use crate::repository::git;

/// The longest wait for the server. This is shorter than the server's timeout for silent clients, so a test fails if
/// a silent client blocks the server.
pub(crate) const PATIENCE: Duration = Duration::from_secs(8);

/// A project with its goldens in `golden/`.
pub(crate) struct Project {
    folder: TempDir,
}

/// The folder of this repository, which has real goldens.
fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../golden")
}

/// The provenance of a golden of this repository.
pub(crate) fn provenance() -> Value {
    let (_, metadata) = Image::read_exr(&repository().join("furnace.exr")).expect("a golden");
    serde_json::from_str(&metadata.expect("provenance")).expect("JSON")
}

/// An image of four by four pixels. Alpha is 1, and all values of the colour channels are different.
pub(crate) fn tiny() -> Image {
    let value = |index: u8| f32::from(index + 1) * 0.01;
    let pixel = |i: u8| [value(4 * i), value(4 * i + 1), value(4 * i + 2), 1.0];
    Image::new(4, 4, (0..16).map(pixel).collect())
}

impl Project {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(folder.path().join("Cargo.toml"), "[workspace]\n").expect("written");
        std::fs::create_dir(folder.path().join("golden")).expect("a folder");
        Self { folder }
    }

    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn golden(&self, case: &str) -> PathBuf {
        self.folder.path().join(format!("golden/{case}.exr"))
    }

    pub(crate) fn pending(&self, case: &str) -> PathBuf {
        self.folder.path().join(format!("golden/{case}.new.exr"))
    }

    pub(crate) fn put(&self, file: &str, text: &str) {
        write(self.folder(), file, text);
    }

    /// Runs git in the project. Returns its output.
    pub(crate) fn git(&self, arguments: &[&str]) -> String {
        git(self.folder(), arguments)
    }

    /// Commits all files. Returns the commit's name.
    pub(crate) fn commit(&self, subject: &str) -> String {
        self.git(&["init", "-q"]);
        self.git(&["add", "-A"]);
        self.git(&["commit", "-q", "-m", subject]);
        self.git(&["log", "-n", "1", "--format=%h"])
    }

    pub(crate) fn put_golden(&self, case: &str, image: &Image) {
        self.put_golden_with(case, image, |_| {});
    }

    /// Writes a golden with changed provenance.
    pub(crate) fn put_golden_with(&self, case: &str, image: &Image, change: impl Fn(&mut Value)) {
        let mut facts = provenance();
        facts["case"] = case.into();
        facts["pixels"] = image.hash().into();
        facts["precision"] = "float".into();
        change(&mut facts);
        let text = facts.to_string();
        image.write_exr(&self.golden(case), Precision::Float, Some(&text)).expect("written");
    }

    /// Writes a pending frame that was compared with the current golden.
    pub(crate) fn put_pending(&self, case: &str, image: &Image, change: impl Fn(&mut Value)) {
        let golden = Image::read_exr(&self.golden(case)).ok();
        let own = golden.as_ref().and_then(|(_, metadata)| metadata.as_ref());
        let mut facts = own.map_or_else(provenance, |own| serde_json::from_str(own).expect("JSON"));
        let members = facts.as_object_mut().expect("an object");
        for accepted in ["accepted_by", "accepted_at", "because"] {
            members.remove(accepted);
        }
        facts["case"] = case.into();
        facts["width"] = image.width().into();
        facts["height"] = image.height().into();
        if let Some((golden, _)) = golden {
            facts["compared_with"] = golden.hash().into();
            // The margins that a test with all these tolerances would find.
            let bounds = [FrameTolerance::gate(1e-3), FlipTile(0.01), FlipMean(0.005)];
            let found = FrameTolerance::All(bounds.into()).compare(&golden, image, None);
            let found = found.as_ref().err().map(FrameFinding::from);
            facts["finding"] = serde_json::to_value(found).expect("plain data");
        }
        change(&mut facts);
        let precision =
            if facts["precision"] == "half" { Precision::Half } else { Precision::Float };
        facts["pixels"] = image.rounded_to(precision).hash().into();
        let text = facts.to_string();
        image.write_exr(&self.pending(case), precision, Some(&text)).expect("written");
    }

    /// A project with the tiny golden, and a pending frame twice as bright.
    pub(crate) fn with_tiny() -> Self {
        let project = Self::new();
        project.put_tiny("tiny");
        project
    }

    pub(crate) fn put_tiny(&self, case: &str) {
        let golden = tiny();
        self.put_golden(case, &golden);
        let mut actual = golden;
        for pixel in actual.pixels_mut() {
            pixel[..3].iter_mut().for_each(|value| *value *= 2.0);
        }
        self.put_pending(case, &actual, |facts| facts["shader"] = "changed".into());
    }

    /// A project with frames of this repository: the first has a changed shader, the second a changed driver, the third
    /// contains NaN, and the fourth is new.
    pub(crate) fn with_frames() -> Self {
        let project = Self::new();
        let read = |case: &str| {
            let from = repository().join(format!("{case}.exr"));
            Image::read_exr(&from).expect("a golden").0
        };
        for case in ["scene", "diffuse", "furnace"] {
            let from = repository().join(format!("{case}.exr"));
            std::fs::copy(from, project.golden(case)).expect("copied");
        }
        let mut scene = read("scene");
        let width = scene.width() as usize;
        for (index, pixel) in scene.pixels_mut().iter_mut().enumerate() {
            let (x, y) = (index % width, index / width);
            // Halves highlights, and makes a part of the picture 5 % brighter and warmer.
            let bright = pixel[0] > 2.0;
            let inside = (260..330).contains(&x) && (120..190).contains(&y);
            for (value, warm) in pixel.iter_mut().zip([1.06, 1.05, 1.03]) {
                *value *= if bright {
                    0.5
                } else if inside {
                    warm
                } else {
                    1.0
                };
            }
        }
        let scene = scene.rounded_to(Precision::Half);
        project.put_pending("scene", &scene, |facts| facts["shader"] = "5f".repeat(32).into());

        let mut diffuse = read("diffuse");
        for (index, pixel) in diffuse.pixels_mut().iter_mut().enumerate() {
            let noise = 1.0 + 0.004 * ((index * 7919 % 101) as f32 / 50.0 - 1.0);
            pixel[..3].iter_mut().for_each(|value| *value *= noise);
        }
        let diffuse = diffuse.rounded_to(Precision::Half);
        project.put_pending("diffuse", &diffuse, |facts| {
            facts["adapter"]["name"] = "llvmpipe (LLVM 19.1.7, 256 bits)".into();
            facts["adapter"]["driver"] = "llvmpipe Mesa 25.0.7 (LLVM 19.1.7)".into();
        });

        let mut furnace = read("furnace");
        let width = furnace.width() as usize;
        for y in 40..48 {
            for x in 60..68 {
                furnace.pixels_mut()[y * width + x][0] = f32::NAN;
                furnace.pixels_mut()[y * width + x + 20][1] = f32::INFINITY;
                furnace.pixels_mut()[y * width + x + 40][2] = -0.25;
            }
        }
        project.put_pending("furnace", &furnace, |facts| facts["precision"] = "float".into());
        project.put_pending("rooms/layered", &read("layered"), |_| {});
        project
    }

    pub(crate) fn karat(&self, arguments: &[&str]) -> Command {
        let mut command = program(self.folder());
        command.args(arguments);
        command
    }

    pub(crate) fn serve(&self) -> Server {
        self.serve_with(&[])
    }

    pub(crate) fn serve_with(&self, arguments: &[&str]) -> Server {
        let mut command = self.karat(&["review"]);
        command.args(arguments);
        let mut child = command.stdout(Stdio::piped()).spawn().expect("it was built");
        let mut out = BufReader::new(child.stdout.take().expect("it is piped"));
        let mut line = || {
            let mut line = String::new();
            out.read_line(&mut line).expect("UTF-8");
            line.trim_end().to_owned()
        };
        let (greeting, url) = (line(), line());
        assert!(greeting.ends_with("stop with Ctrl-C"), "{greeting}");
        Server { child, url, out }
    }
}

/// A running `karat review`.
pub(crate) struct Server {
    child: Child,
    pub(crate) url: String,
    out: BufReader<ChildStdout>,
}

/// The reply to a raw request.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) text: String,
}

impl Answer {
    /// Reads the reply from a connection until it closes.
    #[track_caller]
    pub(crate) fn of(stream: &mut TcpStream) -> Self {
        let mut text = String::new();
        stream.read_to_string(&mut text).expect("an answer in time");
        let status = text.split(' ').nth(1).and_then(|status| status.parse().ok());
        Self { status: status.unwrap_or_else(|| panic!("no status in {text}")), text }
    }
}

impl Server {
    /// The host as `127.0.0.1:port`.
    pub(crate) fn host(&self) -> String {
        self.url.split('/').nth(2).expect("a host").to_owned()
    }

    /// Returns the path of the URL, with the token.
    pub(crate) fn path(&self) -> String {
        format!("/{}/", self.url.split('/').nth(3).expect("a token"))
    }

    /// Sends a request with any headers, and returns the reply. A browser would refuse to send some of these headers.
    pub(crate) fn raw(&self, head: &str, body: &str) -> Answer {
        let length = body.len();
        let request =
            format!("{head}\r\nConnection: close\r\nContent-Length: {length}\r\n\r\n{body}");
        Answer::of(&mut self.send(&request))
    }

    /// Opens a connection and sends these bytes. The connection stays open.
    pub(crate) fn send(&self, text: &str) -> TcpStream {
        let mut stream = TcpStream::connect(self.host()).expect("it listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("a time");
        stream.write_all(text.as_bytes()).expect("sent");
        stream
    }

    pub(crate) fn get(&self, place: &str) -> Answer {
        self.raw(&format!("GET {}{place} HTTP/1.1\r\nHost: {}", self.path(), self.host()), "")
    }

    /// Posts a decision as Karat's own page does.
    pub(crate) fn post(&self, place: &str, decision: &Value) -> Answer {
        let (path, host) = (self.path(), self.host());
        let head = format!(
            "POST {path}{place} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n\
             Content-Type: application/json"
        );
        self.raw(&head, &decision.to_string())
    }

    pub(crate) fn signal(&self) {
        // Uses the shell's own `kill`, because some machines lack the program.
        let script = format!("kill -INT {}", self.child.id());
        assert!(Command::new("sh").args(["-c", &script]).status().expect("a shell").success());
    }

    pub(crate) fn is_running(&mut self) -> bool {
        self.child.try_wait().expect("a child").is_none()
    }

    /// Stops the server with Ctrl-C. Returns its exit code and its last output.
    pub(crate) fn interrupt(mut self) -> (Option<i32>, String) {
        self.signal();
        let start = Instant::now();
        let code = loop {
            if let Some(status) = self.child.try_wait().expect("a child") {
                break status.code();
            }
            assert!(start.elapsed() < PATIENCE, "it doesn't end");
            std::thread::sleep(Duration::from_millis(5));
        };
        let mut rest = String::new();
        self.out.read_to_string(&mut rest).expect("UTF-8");
        (code, rest)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// The message that the page sends to accept a case with these pixels.
pub(crate) fn decision(case: &str, pixels: &str) -> Value {
    json!({ "case": case, "pixels": pixels, "because": "why" })
}
