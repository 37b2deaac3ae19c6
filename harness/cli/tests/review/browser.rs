//! Drives a headless Chromium by its own protocol (CDP) over a WebSocket.

use std::io::BufRead;
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

use base64::Engine;
use serde_json::{Value, json};
use tempfile::TempDir;
use tungstenite::{Message, WebSocket};

/// The longest wait for any action of the browser: SwiftShader on a busy machine is slow.
const PATIENCE: Duration = Duration::from_secs(180);

/// The process of a browser. It ends with the last test that uses this process.
struct Process {
    child: Child,
    _profile: TempDir,
    /// The URL on which the browser listens.
    url: String,
}

/// The browser process that concurrent tests share. Starting another process would keep two CPU cores busy for half a
/// second.
static SHARED: Mutex<Weak<Process>> = Mutex::new(Weak::new());

/// A browser that reaches only this machine, with its own tabs and storage.
pub(crate) struct Browser {
    _process: Arc<Process>,
    /// The browser profile of this test. Other tests don't use this profile.
    context: String,
    socket: WebSocket<TcpStream>,
    calls: u64,
    /// The session id of the tab in the foreground. The browser draws only this tab.
    front: String,
    /// `true` while the pointer's left button is down.
    pressed: bool,
}

/// A tab of a [`Browser`].
pub(crate) struct Tab {
    session: String,
}

/// The path of the browser's program. If no browser is installed, the function panics and says how to install one, so
/// that no test is skipped silently.
fn program() -> PathBuf {
    if let Some(named) = std::env::var_os("KARAT_BROWSER") {
        return named.into();
    }
    // `ci/src/setup/browser.rs`, which installs a browser, has the same names.
    let names = [
        "chromium",
        "chromium-browser",
        "google-chrome",
        "google-chrome-stable",
        "chrome",
        "Google Chrome",
        "chrome.exe",
    ];
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    folders.push("/usr/bin".into());
    folders.push("/Applications/Google Chrome.app/Contents/MacOS".into());
    folders.push(r"C:\Program Files\Google\Chrome\Application".into());
    let mut found = folders.iter().flat_map(|folder| names.map(|name| folder.join(name)));
    found.find(|file| file.is_file()).expect(
        "no Chromium: install it (`cargo ci setup`, or `apt-get install chromium`), or name its \
         program in KARAT_BROWSER",
    )
}

impl Process {
    fn start(arguments: &[&str]) -> Self {
        let profile = tempfile::tempdir().expect("a temporary folder");
        let mut command = Command::new(program());
        command.args([
            "--headless",
            "--remote-debugging-port=0",
            // The browser draws frames in software, so any machine can run it.
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            // Only WebGL needs the graphics process: the browser draws pages faster without it.
            "--disable-gpu-compositing",
            "--disable-gpu-rasterization",
            // Without this flag, the browser starts a process for a later page, which keeps a core busy.
            "--disable-features=SpareRendererForSitePerProcess",
            // As root there is no sandbox. All loaded pages are Karat's.
            "--no-sandbox",
            "--disable-dev-shm-usage",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-quic",
            "--disable-sync",
            "--no-first-run",
            "--no-default-browser-check",
            "--hide-scrollbars",
            "--force-color-profile=srgb",
            "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
        ]);
        command.arg(format!("--user-data-dir={}", profile.path().display()));
        command.args(arguments).arg("about:blank");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the browser starts");
        let stderr = child.stderr.take().expect("it is piped");
        let (sender, receiver) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            // Reads all of standard error, because a full pipe would stop the browser.
            for line in std::io::BufReader::new(stderr).lines().map_while(Result::ok) {
                if let Some(url) = line.strip_prefix("DevTools listening on ") {
                    drop(sender.send(url.to_owned()));
                }
            }
        });
        let url = receiver.recv_timeout(PATIENCE).expect("the browser opens its port");
        Self { child, _profile: profile, url }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

impl Browser {
    pub(crate) fn start() -> Self {
        let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        let process = shared.upgrade().unwrap_or_else(|| Arc::new(Process::start(&[])));
        *shared = Arc::downgrade(&process);
        drop(shared);
        Self::of(process)
    }

    /// Starts a separate browser process with additional arguments.
    pub(crate) fn with(arguments: &[&str]) -> Self {
        Self::of(Arc::new(Process::start(arguments)))
    }

    fn of(process: Arc<Process>) -> Self {
        let url = &process.url;
        let place = url.strip_prefix("ws://").and_then(|rest| rest.split('/').next());
        let stream = TcpStream::connect(place.expect("a URL")).expect("it listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("a time");
        let (socket, _) = tungstenite::client(url, stream).expect("a WebSocket");
        let (context, front) = Default::default();
        let mut browser =
            Self { _process: process, context, socket, calls: 0, front, pressed: false };
        let context = browser.call(None, "Target.createBrowserContext", json!({}));
        browser.context = context["browserContextId"].as_str().expect("a context").to_owned();
        browser
    }

    fn call(&mut self, session: Option<&str>, method: &str, parameters: Value) -> Value {
        self.calls += 1;
        let mut message = json!({ "id": self.calls, "method": method, "params": parameters });
        if let Some(session) = session {
            message["sessionId"] = session.into();
        }
        self.socket.send(Message::text(message.to_string())).expect("the browser listens");
        loop {
            let Message::Text(text) = self.socket.read().expect("the browser answers") else {
                continue;
            };
            let mut answer: Value = serde_json::from_str(&text).expect("JSON");
            if answer["method"] == "Runtime.exceptionThrown" {
                panic!("the page threw: {}", answer["params"]["exceptionDetails"]);
            }
            if answer["id"] == self.calls {
                assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
                return answer["result"].take();
            }
        }
    }

    /// Opens a tab of 1280 by 720 pixels, and waits until it has loaded a page.
    pub(crate) fn open(&mut self, url: &str) -> Tab {
        let target = self.call(
            None,
            "Target.createTarget",
            json!({
                "url": "about:blank", "browserContextId": self.context,
            }),
        );
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let attached = self.call(None, "Target.attachToTarget", attach);
        let session = attached["sessionId"].as_str().expect("a session").to_owned();
        let tab = Tab { session };
        self.on(&tab, "Page.enable", json!({}));
        self.on(&tab, "Runtime.enable", json!({}));
        self.resize(&tab, 1280, 720, 1.0);
        self.on(&tab, "Page.navigate", json!({ "url": url }));
        self.wait(&tab, "document.readyState === 'complete' && location.href !== 'about:blank'");
        tab
    }

    fn on(&mut self, tab: &Tab, method: &str, parameters: Value) -> Value {
        self.call(Some(&tab.session), method, parameters)
    }

    pub(crate) fn resize(&mut self, tab: &Tab, width: u32, height: u32, ratio: f64) {
        let size = json!({
            "width": width, "height": height, "deviceScaleFactor": ratio, "mobile": false,
        });
        self.on(tab, "Emulation.setDeviceMetricsOverride", size);
    }

    /// Makes the tab behave as on a telephone or tablet with a touch screen of the given size.
    pub(crate) fn touch(&mut self, tab: &Tab, width: u32, height: u32) {
        let size =
            json!({ "width": width, "height": height, "deviceScaleFactor": 1.0, "mobile": true });
        self.on(tab, "Emulation.setDeviceMetricsOverride", size);
        let touch = json!({ "enabled": true, "maxTouchPoints": 2 });
        self.on(tab, "Emulation.setTouchEmulationEnabled", touch);
    }

    /// Puts down, moves or lifts several fingers at once.
    pub(crate) fn fingers(&mut self, tab: &Tab, kind: &str, places: &[(f64, f64)]) {
        let points: Vec<_> = places
            .iter()
            .enumerate()
            .map(|(id, (x, y))| json!({ "x": x, "y": y, "id": id }))
            .collect();
        let event = json!({ "type": kind, "touchPoints": points });
        self.on(tab, "Input.dispatchTouchEvent", event);
    }

    /// Sets whether the user prefers dark pages.
    pub(crate) fn prefer_dark(&mut self, tab: &Tab, dark: bool) {
        let value = if dark { "dark" } else { "light" };
        let feature = json!({ "name": "prefers-color-scheme", "value": value });
        self.on(tab, "Emulation.setEmulatedMedia", json!({ "features": [feature] }));
    }

    /// Returns the value of a JavaScript expression.
    #[track_caller]
    pub(crate) fn value(&mut self, tab: &Tab, expression: &str) -> Value {
        let parameters = json!({
            "expression": expression, "returnByValue": true, "awaitPromise": true,
        });
        let mut answer = self.on(tab, "Runtime.evaluate", parameters);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].take()
    }

    /// The displayed text of the first element that a selector matches.
    #[track_caller]
    pub(crate) fn text(&mut self, tab: &Tab, selector: &str) -> String {
        let text = self.value(tab, &format!("document.querySelector({selector:?})?.innerText"));
        text.as_str().unwrap_or_else(|| panic!("nothing matches {selector}")).to_owned()
    }

    #[track_caller]
    pub(crate) fn wait(&mut self, tab: &Tab, condition: &str) {
        let start = Instant::now();
        while self.value(tab, condition) != true {
            if start.elapsed() > PATIENCE {
                let page = self.value(tab, "document.body.innerText");
                panic!("never true: {condition}\n{page}");
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits until the page shows the selected case and has drawn its current state.
    #[track_caller]
    pub(crate) fn settle(&mut self, tab: &Tab) {
        // The browser doesn't draw a tab behind another tab.
        if self.front != tab.session {
            self.on(tab, "Page.bringToFront", json!({}));
            self.front.clone_from(&tab.session);
        }
        // The first frame draws all changes so far. The second frame follows the first.
        let frames = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))";
        self.value(tab, frames);
        let ready = "window.karat?.stage.canvas.dataset.ready === 'true'";
        if self.value(tab, ready) != true {
            self.wait(tab, ready);
            self.value(tab, frames);
        }
    }

    /// Presses and releases a key.
    pub(crate) fn press(&mut self, tab: &Tab, key: &str) {
        let (code, text) = match key {
            "Enter" => (13, "\r"),
            "Escape" => (27, ""),
            "Tab" => (9, ""),
            "ArrowLeft" => (37, ""),
            "ArrowUp" => (38, ""),
            _ => (0, key),
        };
        let shift = if key.len() == 1 && key.to_lowercase() != key { 8 } else { 0 };
        for kind in ["keyDown", "keyUp"] {
            let mut event = json!({ "type": kind, "key": key, "modifiers": shift });
            if code != 0 {
                event["windowsVirtualKeyCode"] = code.into();
            }
            if kind == "keyDown" && !text.is_empty() {
                event["text"] = text.into();
            }
            self.on(tab, "Input.dispatchKeyEvent", event);
        }
        self.settle(tab);
    }

    /// Types text into the focused element.
    pub(crate) fn write(&mut self, tab: &Tab, text: &str) {
        self.on(tab, "Input.insertText", json!({ "text": text }));
    }

    /// Sends a pointer event. `kind` is `mouseMoved`, `mousePressed` or `mouseReleased`, and the button is the left
    /// button.
    pub(crate) fn pointer(&mut self, tab: &Tab, kind: &str, (x, y): (f64, f64)) {
        self.pressed = kind == "mousePressed" || (kind == "mouseMoved" && self.pressed);
        let button = if kind == "mouseMoved" && !self.pressed { "none" } else { "left" };
        let event = json!({
            "type": kind, "x": x, "y": y, "button": button, "clickCount": 1,
            "buttons": u8::from(self.pressed),
        });
        self.on(tab, "Input.dispatchMouseEvent", event);
    }

    /// Turns the mouse wheel. If `by` is negative, the wheel turns away from the user.
    pub(crate) fn wheel(&mut self, tab: &Tab, (x, y): (f64, f64), by: f64) {
        let event = json!({ "type": "mouseWheel", "x": x, "y": y, "deltaX": 0, "deltaY": by });
        self.on(tab, "Input.dispatchMouseEvent", event);
    }

    pub(crate) fn click(&mut self, tab: &Tab, selector: &str) {
        let at = self.value(tab, &format!(
            "(() => {{ const b = document.querySelector({selector:?}).getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; }})()"
        ));
        let at = (at[0].as_f64().expect("a place"), at[1].as_f64().expect("a place"));
        self.pointer(tab, "mousePressed", at);
        self.pointer(tab, "mouseReleased", at);
    }

    /// The picture on the screen, as rows of RGB. `save` also writes the picture to a file.
    pub(crate) fn screen(&mut self, tab: &Tab, save: Option<&Path>) -> Screen {
        let shot = self.on(tab, "Page.captureScreenshot", json!({ "format": "png" }));
        let data = shot["data"].as_str().expect("a picture");
        let bytes = base64::engine::general_purpose::STANDARD.decode(data).expect("base64");
        if let Some(path) = save {
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            std::fs::write(path, &bytes).expect("written");
        }
        let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
        decoder.set_transformations(png::Transformations::STRIP_16);
        let mut reader = decoder.read_info().expect("a PNG");
        let mut pixels = vec![0; reader.output_buffer_size().expect("it fits")];
        let info = reader.next_frame(&mut pixels).expect("an image");
        let channels = info.color_type.samples();
        Screen { width: info.width as usize, channels, pixels }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let parameters = json!({ "browserContextId": self.context });
        let message =
            json!({ "id": 0, "method": "Target.disposeBrowserContext", "params": parameters });
        drop(self.socket.send(Message::text(message.to_string())));
        drop(self.socket.close(None));
    }
}

/// A picture of a tab.
pub(crate) struct Screen {
    width: usize,
    channels: usize,
    pixels: Vec<u8>,
}

impl Screen {
    pub(crate) fn rgb(&self, x: usize, y: usize) -> [u8; 3] {
        let start = (y * self.width + x) * self.channels;
        [self.pixels[start], self.pixels[start + 1], self.pixels[start + 2]]
    }
}
