//! Where a case comes from: its test, what changed since its golden, the golden's versions; functions
//! that fail, and goldens that nothing is pending for.

use std::process::Command;

use serde_json::{Value, json};

use crate::browser::{Browser, Tab};
use crate::project::{Project, Server, tiny};

fn open(project: &Project, arguments: &[&str]) -> (Server, Browser, Tab) {
    let server = project.serve_with(arguments);
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    (server, browser, tab)
}

fn git(project: &Project, arguments: &[&str]) {
    let mut command = Command::new("git");
    command.args(["-c", "user.name=Ada", "-c", "user.email=ada@example.org"]);
    let ran = command.args(arguments).current_dir(project.folder()).output().expect("git is there");
    assert!(ran.status.success(), "{ran:?}");
}

/// The record of the project's last run.
fn put_record(project: &Project, records: &[Value]) {
    let folder = project.folder().join("target/karat/record");
    std::fs::create_dir_all(&folder).expect("a folder");
    let lines: String = records.iter().map(|record| format!("{record}\n")).collect();
    std::fs::write(folder.join("1.jsonl"), lines).expect("written");
    let run = json!({ "schema": 2, "selected": [], "passed": false });
    std::fs::write(folder.join("run.json"), run.to_string()).expect("written");
}

fn frame_record(project: &Project) -> Value {
    let module = project.folder().join("shaders/light.wgsl");
    json!({
        "schema": 2, "test": "frames::the <b>tiny</b> one", "verdict": "fail", "paths": [],
        "subject": { "kind": "frame", "golden": "tiny", "folder": "golden", "location": "tests/frames.rs:7:5" },
        "message": "error: it differs\n  replay: KARAT_PATHS=vulkan cargo test frames",
        "read": [{ "file": module, "hash": "" }],
    })
}

fn function_record() -> Value {
    let points = (0..400).map(|k| (f64::from(k % 20) / 19.0, f64::from(k / 20) / 19.0));
    let rows: Vec<_> = points.map(|(x, y)| [x, y, 40.0 * x * y]).collect();
    json!({
        "schema": 2, "test": "lobes", "verdict": "fail",
        "subject": { "kind": "function", "package": "shaders", "function": "lobe::ggx", "check": "agrees_with",
            "assertion": "1 ulp", "location": "shaders/a.wgsl:1:1", "seed": 1 },
        "message": "error: `lobe::ggx` fails <script>window.injected = 1</script>\n  replay: KARAT_SEED=1 cargo test lobes",
        "paths": [{
            "adapter": { "path": "cpu", "name": "an adapter", "driver": "", "software": true },
            "cases": 400, "failures": 1, "worst": "3 ulp", "ratio": 40.0, "asserted": "1 ulp", "known_issue": null,
            "plot": { "arguments": ["alpha", "n_dot_v"], "rows": rows },
        }],
    })
}

/// A repository in which the scene's shader changed, and a run that also failed a function.
pub(crate) fn with_origins(project: &Project) {
    std::fs::create_dir(project.folder().join("shaders")).expect("a folder");
    let module = project.folder().join("shaders/light.wgsl");
    let text = "// The sun.\nconst SUN = 1.0;\n\nfn sun(cosine: f32) -> f32 {\n    return SUN * max(cosine, 0.0);\n}\n";
    std::fs::write(&module, text).expect("written");
    let repository = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../golden");
    for file in ["scene.toml", "environment.toml", "environment.exr"] {
        std::fs::copy(repository.join(file), project.folder().join("golden").join(file))
            .expect("copied");
    }
    git(project, &["init", "-q"]);
    git(
        project,
        &[
            "add",
            "golden/scene.exr",
            "golden/scene.toml",
            "golden/environment.exr",
            "golden/environment.toml",
            "shaders",
        ],
    );
    git(project, &["commit", "-q", "-m", "golden: the first frames"]);
    std::fs::write(&module, text.replace("max(cosine, 0.0)", "clamp(cosine, 0.0, 0.5)"))
        .expect("written");
    let mut frame = frame_record(project);
    frame["subject"]["golden"] = "scene".into();
    frame["test"] = "scene_agrees_with_its_golden".into();
    put_record(project, &[frame, function_record()]);
}

/// The module that changed is named with its lines, and the golden's versions with their reasons.
#[test]
fn what_changed_since_the_golden_is_shown() {
    let project = Project::new();
    let module = |name: &str| project.folder().join("shaders").join(name);
    std::fs::create_dir(project.folder().join("shaders")).expect("a folder");
    std::fs::write(module("light.wgsl"), "const SUN = 1.0;\nconst SKY = 0.5;\n").expect("written");
    std::fs::write(module("other.wgsl"), "const OTHER = 1.0;\n").expect("written");
    project.put_tiny("tiny");
    std::fs::write(
        project.folder().join("golden/tiny.toml"),
        "because = \"the first <i>light</i>\"\naccepted_by = \"Grace\"\n",
    )
    .expect("written");
    let (_server, mut browser, tab) = open(&project, &[]);
    let told = browser.text(&tab, "#modules");
    assert!(told.contains("can't be told: the golden is in no git repository"), "{told}");
    assert_eq!(browser.value(&tab, "document.getElementById('versions').hidden"), true);

    git(&project, &["init", "-q"]);
    git(&project, &["add", "golden/tiny.exr", "golden/tiny.toml", "shaders"]);
    git(&project, &["commit", "-q", "-m", "the frame of the sun"]);
    std::fs::write(module("light.wgsl"), "const SUN = 2.0; // <u>brighter</u>\nconst SKY = 0.5;\n")
        .expect("written");
    std::fs::write(module("other.wgsl"), "const OTHER = 2.0;\n").expect("written");
    // Without a record it isn't known which modules are the frame's.
    let (_server, mut browser, tab) = open(&project, &[]);
    let names = "[...document.querySelectorAll('#modules summary')].map(name => name.innerText)";
    assert_eq!(browser.value(&tab, names), json!(["shaders/light.wgsl", "shaders/other.wgsl"]));
    assert!(browser.text(&tab, "#modules").contains("No record of a run says which"));
    assert_eq!(browser.value(&tab, "document.getElementById('test').hidden"), true);

    // Another crate of the workspace may have a frame of this name.
    let mut other = frame_record(&project);
    std::fs::create_dir_all(project.folder().join("crates/golden")).expect("a folder");
    other["subject"]["folder"] = "crates/golden".into();
    other["test"] = "another".into();
    put_record(&project, &[frame_record(&project), other]);
    let (_server, mut browser, tab) = open(&project, &[]);
    assert_eq!(browser.value(&tab, names), json!(["shaders/light.wgsl"]));
    browser.value(&tab, "document.querySelector('#modules details').open = true");
    let lines = browser.value(&tab, "['removed', 'added'].map(kind => [...document.querySelectorAll(`#modules .${kind}`)].map(line => line.innerText.trimEnd()))");
    assert_eq!(lines, json!([["-const SUN = 1.0;"], ["+const SUN = 2.0; // <u>brighter</u>"]]));
    let version = browser.text(&tab, "#versions li");
    for text in ["Ada", "the first <i>light</i>", "accepted by Grace", "the frame of the sun"] {
        assert!(version.contains(text), "{version}");
    }
    let test = browser
        .value(&tab, "[...document.querySelectorAll('#test code')].map(code => code.innerText)");
    assert_eq!(
        test,
        json!([
            "frames::the <b>tiny</b> one",
            "tests/frames.rs:7:5",
            "KARAT_PATHS=vulkan cargo test frames"
        ])
    );
    // The button copies, or selects where the browser forbids it; it says which.
    browser.click(&tab, "#test .line:nth-child(3) button");
    browser.wait(&tab, "['Copied', 'Selected'].includes(document.querySelector('#test .line:nth-child(3) button').innerText)");
    // A golden that was accepted and isn't committed yet is of no commit.
    let mut other = tiny();
    other.pixels_mut()[0][0] = 5.0;
    project.put_golden("tiny", &other);
    let (_server, mut browser, tab) = open(&project, &[]);
    assert!(browser.text(&tab, "#modules").contains("the golden isn't committed"));
}

/// Facts that the test declares are named where everybody looks.
#[test]
fn declared_facts_that_changed_are_in_the_header() {
    let project = Project::new();
    project.put_golden("tiny", &tiny());
    let mut actual = tiny();
    actual.pixels_mut()[0][0] = 5.0;
    project.put_pending("tiny", &actual, |facts| facts["facts"]["seed"] = "<8>".into());
    let (_server, mut browser, tab) = open(&project, &[]);
    assert_eq!(browser.text(&tab, "#cause"), "only declared facts changed");
    assert_eq!(browser.text(&tab, "#declared"), "seed: none → <8>");
}

#[test]
fn functions_that_fail_are_on_the_list() {
    let project = Project::with_tiny();
    put_record(&project, &[function_record()]);
    let (_server, mut browser, tab) = open(&project, &[]);
    assert_eq!(browser.text(&tab, "#cases .folder"), "functions that fail");
    browser.press(&tab, "j");
    assert_eq!(browser.text(&tab, "#name"), "lobe::ggx agrees_with");
    assert!(browser.text(&tab, "#cases .function .severity").starts_with("40"));
    assert!(browser.text(&tab, "#function pre").contains("<script>window.injected = 1</script>"));
    assert_eq!(browser.value(&tab, "document.querySelectorAll('#function svg').length"), 3);
    assert_eq!(
        browser.value(&tab, "document.querySelectorAll('#function svg circle').length > 100"),
        true
    );
    assert_eq!(browser.value(&tab, "window.injected ?? 'none'"), "none");
    assert!(browser.text(&tab, "#test").contains("KARAT_SEED=1 cargo test lobes"));
    for id in ["served", "inspector", "tools"] {
        let shown = format!("document.getElementById('{id}').checkVisibility()");
        assert_eq!(browser.value(&tab, &shown), false, "{id}: there are no images");
    }
    browser.press(&tab, "a");
    assert_eq!(browser.value(&tab, "document.querySelector('dialog[open]') === null"), true);
    browser.press(&tab, "k");
    assert_eq!(browser.text(&tab, "#name"), "tiny");
    assert_eq!(browser.value(&tab, "document.getElementById('function').hidden"), true);

    // From files, too.
    let report = project.folder().join("report");
    let ran = project.karat(&["review", "--static"]).arg(&report).output().expect("it was built");
    assert!(ran.status.success(), "{ran:?}");
    let tab = browser.open(
        &format!("file://{}/index.html#lobe::ggx agrees_with", report.display())
            .replace(' ', "%20"),
    );
    browser.wait(&tab, "document.querySelectorAll('#function svg').length === 3");
}

#[test]
fn goldens_are_looked_at_without_anything_pending() {
    let project = Project::with_tiny();
    project.put_golden("rooms/dark", &tiny());
    let ran = project.karat(&["reject", "tiny"]).output().expect("it was built");
    assert!(ran.status.success(), "{ran:?}");
    git(&project, &["init", "-q"]);
    git(&project, &["add", "golden"]);
    git(&project, &["commit", "-q", "-m", "both"]);
    let (_server, mut browser, tab) = open(&project, &["--goldens"]);
    let names = "[...document.querySelectorAll('#cases .name')].map(name => name.innerText)";
    assert_eq!(browser.value(&tab, names), json!(["tiny", "rooms/dark"]));
    assert_eq!(browser.text(&tab, "#cases .folder"), "accepted goldens");
    assert_eq!(browser.text(&tab, "#count"), "nothing is left to review");
    let value = browser.value(&tab, "karat.loaded().parts[0].golden.values[1]");
    assert_eq!(value, f64::from(0.02_f32));
    assert_eq!(browser.text(&tab, "#overlay"), "Golden");
    assert!(browser.text(&tab, "#versions").contains("both"));
    assert_eq!(browser.value(&tab, "document.getElementById('accept').disabled"), true);
    browser.press(&tab, "3");
    assert_eq!(browser.text(&tab, "#message"), "Nothing is pending for this golden.");
    browser.press(&tab, "s");
    browser.wait(&tab, "document.querySelectorAll('#sheet canvas.thumb').length === 2");
}

/// A report is mailed and kept: a frame of 480 by 270 takes less than 1 MB, even if all of it is noise.
#[test]
fn a_frame_takes_less_than_a_megabyte() {
    let project = Project::with_frames();
    let report = project.folder().join("report");
    let ran = project.karat(&["review", "--static"]).arg(&report).output().expect("it was built");
    assert!(ran.status.success(), "{ran:?}");
    // In the order of names: diffuse has noise all over, and is a picture of 480 by 270.
    let length = |index: usize| {
        std::fs::metadata(report.join(format!("data/{index}.js"))).expect("written").len()
    };
    let lengths: Vec<u64> = (0..4).map(length).collect();
    println!("bytes: {lengths:?}");
    assert!(lengths.iter().all(|length| *length < 1_000_000), "{lengths:?}");
    // And the browser has every bit of it.
    let mut browser = Browser::start();
    let tab = browser.open(&format!("file://{}/index.html", report.display()));
    browser.settle(&tab);
    let found = browser.value(&tab, "['golden', 'actual'].map(side => { let sum = 0; for (const word of new Uint32Array(karat.loaded().parts[0][side].values.buffer)) sum = (Math.imul(sum, 31) + word) >>> 0; return sum; })");
    let read = |path: &std::path::Path| karat::Image::read_exr(path).expect("an image").0;
    let sum = |image: karat::Image| {
        let words =
            image.pixels().iter().flatten().map(|value| value.to_bits()).collect::<Vec<_>>();
        words.into_iter().fold(0_u32, |sum, word| sum.wrapping_mul(31).wrapping_add(word))
    };
    let expected =
        [project.golden("diffuse"), project.pending("diffuse")].map(|path| sum(read(&path)));
    assert_eq!(found, json!(expected));
}
