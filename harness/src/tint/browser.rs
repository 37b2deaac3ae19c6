//! Asks Tint in Chromium, through the DevTools protocol (CDP) over a pipe. The browser ends when the pipe closes.
//!
//! The browser's first page is empty and has no WebGPU. So Karat opens an empty HTML file in the browser, and runs its
//! script in this file's page.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::NoVerdict;
use crate::lines::{Answers, Broken, Lines};

/// The shell command that starts the browser. The browser reads commands from descriptor 3 and answers on descriptor 4,
/// which the shell connects to stdin and stdout. The browser's profile is a temporary folder, which the shell removes
/// at the end.
const SHELL: &str = "d=$(mktemp -d) && : > \"$d/page.html\" && \
    \"$0\" \"$@\" --user-data-dir=\"$d/profile\" \"file://$d/page.html\" 3<&0 4>&1 </dev/null >/dev/null; \
    rm -rf \"$d\"";

/// The time limit for opening the empty HTML file. On a busy machine, opening the file takes several seconds.
const LOADING: Duration = Duration::from_secs(5);
const POLL: Duration = Duration::from_millis(20);

/// The JavaScript that asks Tint in the browser's page. The script checks texts one after another, because concurrent
/// checks would share the device's error scopes.
pub(super) const PAGE: &str = "let last = navigator.gpu ? deviceOf(navigator.gpu, false) \
    : Promise.reject('this browser has no WebGPU'); \
    const ask = (question) => last = last.then(() => judge(navigator.gpu, question)).then(JSON.stringify); \
    const version = navigator.userAgent.match(/Chrom\\w*\\/[\\d.]+/)?.[0] ?? navigator.userAgent; \
    last.then(() => JSON.stringify({ version: version.replace('/', ' ') }), \
        (error) => JSON.stringify({ error: String(error?.message ?? error) }))";

#[derive(Debug)]
pub(crate) struct Page {
    lines: Lines,
    session: String,
    calls: u64,
}

impl Page {
    /// Starts a browser, and evaluates a script in a page. The script's value must be a `Promise` of the first reply.
    /// The script must declare the function `ask`, which answers each later request.
    pub(crate) fn open(
        program: &Path,
        patience: Duration,
        (script, longest): (&str, u64),
    ) -> Result<Self, NoVerdict> {
        if cfg!(windows) {
            let reason = "on Windows, Karat can't talk to a browser through a pipe".to_owned();
            return Err(Broken::Start(reason).into());
        }
        let mut command = Command::new("sh");
        command.args(["-c", SHELL]).arg(program).args([
            "--headless",
            "--remote-debugging-pipe",
            "--enable-unsafe-webgpu",
            "--use-webgpu-adapter=swiftshader",
            "--disable-dev-shm-usage",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-quic",
            "--disable-sync",
            "--no-first-run",
            "--no-default-browser-check",
            "--host-resolver-rules=MAP * ~NOTFOUND",
        ]);
        #[cfg(target_os = "linux")]
        if is_root() {
            command.arg("--no-sandbox");
        }
        let lines = Lines::start(&mut command, Answers::Stdout, 0, longest)?;
        let mut page = Self { lines, session: String::new(), calls: 0 };
        page.call("Target.getTargets", &json!({}))?;
        let found = page.answer(patience)?;
        let targets = found["targetInfos"].as_array().into_iter().flatten();
        let mut pages = targets.filter(|target| target["type"] == "page");
        let target = pages.next().map(|page| page["targetId"].clone());
        let target =
            target.ok_or_else(|| Broken::Start("the browser didn't open a page".to_owned()))?;
        page.call("Target.attachToTarget", &json!({ "targetId": target, "flatten": true }))?;
        let attached = page.answer(patience)?;
        let session = attached["sessionId"].as_str();
        let session =
            session.ok_or_else(|| Broken::Start("the browser didn't open a session".to_owned()))?;
        page.session = session.to_owned();
        page.load(patience)?;
        page.evaluate(script)?;
        Ok(page)
    }

    /// Waits until the browser's page has WebGPU. Stops waiting after [`LOADING`].
    fn load(&mut self, patience: Duration) -> Result<(), NoVerdict> {
        let until = Instant::now() + LOADING;
        while Instant::now() < until {
            self.evaluate("!!navigator.gpu")?;
            // A page that is being replaced doesn't answer.
            if self.answer(patience).is_ok_and(|answer| answer["result"]["value"] == true) {
                break;
            }
            std::thread::sleep(POLL);
        }
        Ok(())
    }

    pub(crate) fn send(&mut self, question: &str) -> Result<(), NoVerdict> {
        self.evaluate(&format!("ask({question})"))
    }

    pub(crate) fn receive(&mut self, patience: Duration) -> Result<String, NoVerdict> {
        let answer = self.answer(patience)?;
        match answer["result"]["value"].as_str() {
            Some(text) => Ok(text.to_owned()),
            None => Err(NoVerdict::Garbage(crate::diagnostic::one_line(&answer.to_string()))),
        }
    }

    fn evaluate(&mut self, expression: &str) -> Result<(), NoVerdict> {
        let parameters =
            json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        self.call("Runtime.evaluate", &parameters)
    }

    fn call(&mut self, method: &str, parameters: &Value) -> Result<(), NoVerdict> {
        self.calls += 1;
        let mut message = json!({ "id": self.calls, "method": method, "params": parameters });
        if !self.session.is_empty() {
            message["sessionId"] = self.session.clone().into();
        }
        Ok(self.lines.send(&message.to_string())?)
    }

    /// Returns the next answer. Skips events.
    fn answer(&mut self, patience: Duration) -> Result<Value, NoVerdict> {
        loop {
            let text = self.lines.receive(patience)?;
            let garbage = || NoVerdict::Garbage(crate::diagnostic::one_line(&text));
            let mut message: Value = serde_json::from_str(&text).map_err(|_| garbage())?;
            match (message.get("id"), message.get("result")) {
                (None, _) => {}
                (Some(_), Some(_)) => return Ok(message["result"].take()),
                (Some(_), None) => return Err(garbage()),
            }
        }
    }
}

/// Checks if the user is root. On Linux, root must run Chromium without a sandbox. This is safe, because Chromium
/// evaluates only Karat's code.
#[cfg(target_os = "linux")]
fn is_root() -> bool {
    use std::os::unix::fs::MetadataExt;
    std::fs::metadata("/proc/self").is_ok_and(|own| own.uid() == 0)
}
