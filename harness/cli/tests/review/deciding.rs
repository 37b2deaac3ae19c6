//! Tests accepting and rejecting frames in the page.

use karat::frame::{FrameAgreement, FrameError};
use karat::golden::GoldenError;
use karat::image::Precision;
use karat::{Goldens, Image, Package, Path};
use serde_json::Value;

use crate::browser::{Browser, Tab};
use crate::project::{Project, tiny};

/// Accepts the selected case with the keyboard, as a person does.
fn accept(browser: &mut Browser, tab: &Tab, because: &str) {
    decide(browser, tab, because);
    browser.press(tab, "Enter");
}

/// Accepts a frame as the golden for all drivers, even if another driver than lavapipe drew the frame.
fn accept_for_all(browser: &mut Browser, tab: &Tab, because: &str) {
    decide(browser, tab, because);
    for (choice, shown) in [("any-adapter", "any-adapter-line"), ("of-all", "of-which")] {
        let [choice, shown] = [choice, shown].map(|id| format!("document.getElementById('{id}')"));
        browser.value(tab, &format!("if (!{shown}.hidden) {choice}.checked = true"));
    }
    browser.press(tab, "Enter");
}

fn decide(browser: &mut Browser, tab: &Tab, because: &str) {
    browser.press(tab, "a");
    browser.wait(tab, "document.getElementById('accept-dialog').open");
    browser.write(tab, because);
}

fn problem(browser: &mut Browser, tab: &Tab) -> String {
    browser.wait(tab, "document.querySelector('dialog[open] .problem').textContent !== ''");
    browser.text(tab, "dialog[open] .problem")
}

fn facts(project: &Project, case: &str) -> (Image, Value) {
    let (image, metadata) = Image::read_exr(&project.golden(case)).expect("a golden");
    (image, serde_json::from_str(&metadata.expect("provenance")).expect("JSON"))
}

// Lesson 42
#[test]
fn a_frame_is_looked_at_and_accepted() {
    let project = Project::with_tiny();
    project.put_tiny("zebra");
    let (frame, _) = Image::read_exr(&project.pending("tiny")).expect("pending");
    assert_ne!(facts(&project, "tiny").0, frame);
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    assert_eq!(browser.text(&tab, "#count"), "2 pending");

    browser.press(&tab, "a");
    browser.press(&tab, "Enter");
    let text = problem(&mut browser, &tab);
    assert!(text.contains("accepting `tiny` needs a reason that a reviewer can check"), "{text}");
    assert!(project.pending("tiny").is_file(), "nothing is accepted without a reason");

    browser.write(&tab, "the light is twice as bright, as the plan says");
    browser.press(&tab, "Enter");
    browser.wait(&tab, "document.getElementById('name').textContent === 'zebra'");
    assert!(
        !browser
            .value(&tab, "Boolean(document.querySelector('dialog[open]'))")
            .as_bool()
            .expect("a bool")
    );
    assert_eq!(browser.text(&tab, "#count"), "1 pending");
    assert_eq!(browser.text(&tab, "#cases .accepted .status"), "accepted");

    let (golden, facts) = facts(&project, "tiny");
    assert_eq!(golden, frame, "the golden is the frame");
    assert_eq!(facts["because"], "the light is twice as bright, as the plan says");
    assert_eq!(facts["shader"], "changed");
    assert!(facts["accepted_at"].as_str().is_some_and(|at| at.starts_with("20")), "{facts}");
    assert!(facts["accepted_by"].as_str().is_some_and(|by| !by.is_empty()), "{facts}");
    assert!(!project.pending("tiny").exists());
    let sidecar = std::fs::read_to_string(project.folder().join("golden/tiny.toml"));
    assert!(sidecar.expect("written").contains("twice as bright"));

    browser.press(&tab, "r");
    browser.press(&tab, "Tab");
    browser.press(&tab, "Enter");
    browser.wait(&tab, "document.getElementById('count').textContent === 'nothing to review'");
    assert!(!project.pending("zebra").exists() && project.golden("zebra").is_file());
    let (code, _) = server.interrupt();
    assert_eq!(code, Some(0));
}

/// Renders a frame of one colour, and compares it with the project's golden. If Karat wrote the pending frame into
/// another folder, as in CI, the function copies the frame beside the golden, where `karat review` searches.
fn rendered(project: &Project, red: &str) -> Result<FrameAgreement, FrameError> {
    let wgsl = format!(
        "@vertex fn corners(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {{\n    \
            return vec4f(4.0 * f32(index & 1u) - 1.0, 4.0 * f32(index >> 1u) - 1.0, 1.0, 1.0);\n}}\n\
         @fragment fn plain() -> @location(0) vec4f {{ return vec4f({red}, 0.5, 0.25, 1.0); }}\n"
    );
    let package = Package::from_source("plain", &wgsl);
    let frame = package.frame("", 32, 16).fullscreen("corners", "plain");
    let goldens = Goldens::open(&project.folder().join("golden"));
    let result = frame.unrecorded().try_matches(&goldens, "review_loop");
    let first = match &result {
        Err(FrameError::Paths(paths)) => paths.failures.first(),
        result => result.as_ref().err(),
    };
    if let Some(FrameError::Golden { cause, .. }) = first
        && let GoldenError::Missing { pending, .. } | GoldenError::Differs { pending, .. } =
            &**cause
    {
        let beside = project.pending("review_loop");
        if !beside.exists() {
            std::fs::copy(pending, &beside).expect("copied");
        }
    }
    result
}

/// A test fails, a person accepts the frame in the page, and the test passes. The frame is new, or an edited shader has
/// changed it.
#[test]
fn a_failing_frame_is_accepted_in_the_page_and_passes() {
    let project = Project::new();
    assert!(
        Path::ALL.into_iter().any(|path| karat::unstable::path::adapter(path).is_ok()),
        "a path opens"
    );
    for (red, because) in [("1.0", "the first one"), ("2.0", "twice as red, as planned")] {
        let failure = rendered(&project, red).expect_err("not accepted yet").to_string();
        assert!(failure.contains("review_loop"), "{failure}");
        let server = project.serve();
        let mut browser = Browser::start();
        let tab = browser.open(&server.url);
        browser.settle(&tab);
        accept_for_all(&mut browser, &tab, because);
        let done = "document.getElementById('count').textContent === 'nothing to review'";
        browser.wait(&tab, done);
        assert_eq!(server.interrupt().0, Some(0));
        assert_eq!(facts(&project, "review_loop").1["because"], because);
        let agreement = rendered(&project, red).expect("it is the golden now");
        assert!(!agreement.paths.is_empty());
    }
    rendered(&project, "1.0").expect_err("it was another");
}

#[test]
fn a_second_tab_learns_that_the_frame_was_decided() {
    let project = Project::with_tiny();
    project.put_tiny("zebra");
    let server = project.serve();
    let mut browser = Browser::start();
    let (first, second) = (browser.open(&server.url), browser.open(&server.url));
    browser.settle(&first);
    browser.settle(&second);
    accept(&mut browser, &first, "why");
    browser.wait(&first, "document.getElementById('name').textContent === 'zebra'");
    let golden = std::fs::read(project.golden("tiny")).expect("a golden");

    accept(&mut browser, &second, "another reason");
    let text = problem(&mut browser, &second);
    assert_eq!(text, "`tiny` isn't pending");
    assert_eq!(std::fs::read(project.golden("tiny")).expect("a golden"), golden);
    browser.press(&second, "Escape");
    assert_eq!(browser.text(&second, "#cases .gone .status"), "no longer pending");
    assert_eq!(browser.text(&second, "#count"), "1 pending");
}

#[test]
fn the_library_s_refusals_are_shown() {
    let project = Project::with_tiny();
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);

    let mut other = tiny();
    other.pixels_mut()[0][0] = 5.0;
    project.put_golden("tiny", &other);
    accept(&mut browser, &tab, "why");
    let text = problem(&mut browser, &tab);
    assert!(
        text.contains("has changed since the pending frame was rendered; run the test again"),
        "{text}"
    );
    assert_eq!(facts(&project, "tiny").0, other, "the other golden isn't lost");

    // The test renders the frame again, so the page shows an outdated frame.
    browser.press(&tab, "Escape");
    project.put_pending("tiny", &tiny(), |_| {});
    accept(&mut browser, &tab, "why");
    let text = problem(&mut browser, &tab);
    assert!(text.contains("was rendered again after this page loaded"), "{text}");

    let elsewhere = Project::new();
    elsewhere.put_pending("card", &tiny(), |facts| {
        facts["adapter"]["name"] = "GeForce".into();
        facts["adapter"]["driver"] = "NVIDIA 550.1".into();
    });
    let server = elsewhere.serve();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    accept(&mut browser, &tab, "why");
    let text = problem(&mut browser, &tab);
    assert!(text.contains("was rendered on vulkan: GeForce"), "{text}");
    assert!(!elsewhere.golden("card").exists());
    let offered = browser.text(&tab, "#any-adapter-line");
    assert!(offered.contains("vulkan-nvidia"), "{offered}");
    browser.click(&tab, "#any-adapter");
    browser.click(&tab, "#accept-dialog .main");
    browser.wait(&tab, "document.querySelector('#cases .accepted') !== null");
    let stored = facts(&elsewhere, "card").0;
    assert_eq!(stored, tiny().rounded_to(Precision::Half));
}

fn on_gl(facts: &mut Value) {
    facts["adapter"]["path"] = "gl".into();
}

/// If a frame of one profile differs from the golden for all drivers, and the reviewer accepts the frame, it becomes
/// the golden of this profile only. The reviewer can choose to replace the golden for all drivers instead.
#[test]
fn a_frame_of_another_profile_becomes_its_golden() {
    let project = Project::with_tiny();
    let mut other = tiny();
    other.pixels_mut()[0] = [3.0, 3.0, 3.0, 1.0];
    project.put_pending("tiny", &other, on_gl);
    project.put_golden("zebra", &tiny());
    project.put_pending("zebra", &other, on_gl);
    let own = |case: &str| project.folder().join(format!("golden/@gl-llvmpipe/{case}.exr"));
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    accept(&mut browser, &tab, "GL rounds to 16 bits");
    browser.wait(&tab, "document.getElementById('name').textContent === 'zebra'");
    assert!(own("tiny").is_file(), "the default harms no other profile");
    assert_eq!(facts(&project, "tiny").0, tiny());

    // A frame can't be accepted before it's loaded.
    browser.settle(&tab);
    browser.press(&tab, "a");
    browser.wait(&tab, "document.getElementById('accept-dialog').open");
    browser.click(&tab, "#of-all");
    browser.click(&tab, "#because");
    browser.write(&tab, "it is right for all");
    browser.press(&tab, "Enter");
    browser.wait(&tab, "document.getElementById('count').textContent === 'nothing to review'");
    assert!(!own("zebra").exists());
    assert_eq!(facts(&project, "zebra").0, other);
}

/// The list of frames shows an unreadable file with the reason. A person can still review the other frames.
#[test]
fn a_file_that_cannot_be_used_is_shown_with_its_reason() {
    let project = Project::with_tiny();
    std::fs::write(project.pending("broken"), b"no image").expect("written");
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    assert_eq!(browser.text(&tab, "#count"), "1 pending");
    assert_eq!(browser.text(&tab, "#cases .folder"), "can't be used");
    assert!(browser.text(&tab, "#cases .unusable").contains("broken.new.exr"));
    browser.press(&tab, "j");
    browser.wait(&tab, "document.getElementById('message').innerText.includes('broken.new.exr')");
    assert_eq!(browser.value(&tab, "document.getElementById('accept').disabled"), true);
    assert_eq!(browser.value(&tab, "document.getElementById('judged').hidden"), true);
    browser.press(&tab, "a");
    assert_eq!(browser.value(&tab, "document.getElementById('accept-dialog').open"), false);
    browser.press(&tab, "k");
    accept(&mut browser, &tab, "why");
    browser.wait(&tab, "document.querySelector('#cases .accepted') !== null");
    assert!(project.pending("broken").is_file());
}

/// With `--from`, the page shows the frames of a CI run. Accepted frames become goldens of this project.
#[test]
fn frames_of_a_ci_run_are_reviewed() {
    let project = Project::with_tiny();
    let artefact = project.folder().join("ci run/pending");
    std::fs::create_dir_all(&artefact).expect("a folder");
    std::fs::rename(project.pending("tiny"), artefact.join("tiny.new.exr")).expect("moved");
    let report = project.folder().join("report");
    std::fs::create_dir_all(report.join("data")).expect("a folder");
    for file in ["7.js", "notes.js"] {
        std::fs::write(report.join("data").join(file), "old").expect("written");
    }
    let mut command = project.karat(&["review", "--from", "ci run", "--static"]);
    let ran = command.arg(&report).output().expect("it was built");
    assert_eq!(ran.status.code(), Some(0), "{ran:?}");
    let page = std::fs::read_to_string(report.join("index.html")).expect("written");
    assert!(page.contains(r#" --from 'ci run'"#), "the commands need it, too");
    assert!(!report.join("data/7.js").exists() && report.join("data/notes.js").is_file());

    let server = project.serve_with(&["--from", "ci run"]);
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    accept(&mut browser, &tab, "as CI has it");
    browser.wait(&tab, "document.getElementById('count').textContent === 'nothing to review'");
    assert_eq!(facts(&project, "tiny").1["because"], "as CI has it");
    assert!(!artefact.join("tiny.new.exr").exists());
}

#[test]
fn a_server_that_has_gone_is_named() {
    let project = Project::with_tiny();
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    drop(server);
    accept(&mut browser, &tab, "why");
    let text = problem(&mut browser, &tab);
    assert_eq!(text, "The server doesn't answer: is `karat review` still running?");
}

#[test]
fn files_show_the_frames_without_any_network() {
    let project = Project::with_tiny();
    let report = project.folder().join("a report");
    let mut command = project.karat(&["review", "--goldens", "golden", "--static"]);
    let ran = command.arg(&report).output().expect("it was built");
    assert_eq!(ran.status.code(), Some(0), "{ran:?}");
    let text = String::from_utf8_lossy(&ran.stdout).into_owned();
    assert!(text.ends_with("index.html: 1 pending frame\n"), "{text}");

    let mut browser = Browser::with(&["--proxy-server=127.0.0.1:9"]);
    let url = format!("file://{}/index.html", report.display()).replace(' ', "%20");
    let tab = browser.open(&url);
    browser.settle(&tab);
    assert_eq!(
        browser.value(
            &tab,
            "Array.from(karat.state.cases[0].data.parts[0].golden.values.slice(0, 2))"
        )[1],
        f64::from(0.02_f32)
    );
    assert_eq!(
        browser.text(&tab, "#accept-command"),
        "karat accept tiny --goldens golden --because \"…\""
    );
    assert_eq!(browser.text(&tab, "#reject-command"), "karat reject tiny --goldens golden");
    assert_eq!(browser.value(&tab, "document.getElementById('accept').checkVisibility()"), false);
    browser.press(&tab, "a");
    assert_eq!(browser.value(&tab, "document.activeElement.id"), "accept-command");
    // The content security policy allows no other requests, and no inline code.
    let blocked =
        browser.value(&tab, "fetch('http://127.0.0.1:9/').then(() => 'sent', error => error.name)");
    assert_eq!(blocked, "TypeError");
    let injected = "(() => { const s = document.createElement('script'); s.textContent = 'window.injected = 1'; document.head.append(s); return window.injected ?? 'blocked'; })()";
    assert_eq!(browser.value(&tab, injected), "blocked");
    assert!(project.pending("tiny").is_file());
}
