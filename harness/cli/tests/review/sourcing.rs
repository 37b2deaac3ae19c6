//! Tests the page's view of a frame's origin: the frame's test, the changes since its golden, and the golden's
//! versions. Also tests functions that fail, and goldens without a pending frame.

use karat::Image;
use karat::unstable::record::FileRead;
use serde_json::{Value, json};

use crate::browser::{Browser, Tab};
use crate::faults::fault;
use crate::project::{Project, Server, tiny};

fn open(project: &Project, arguments: &[&str]) -> (Server, Browser, Tab) {
    let server = project.serve_with(arguments);
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    (server, browser, tab)
}

/// Writes the record of the project's last run.
fn put_record(project: &Project, records: &[Value]) {
    let folder = project.folder().join("target/karat/record");
    std::fs::create_dir_all(&folder).expect("a folder");
    let lines: String = records.iter().map(|record| format!("{record}\n")).collect();
    std::fs::write(folder.join("1.jsonl"), lines).expect("written");
    let run = json!({ "schema": 5, "selected": [], "passed": false });
    std::fs::write(folder.join("run.json"), run.to_string()).expect("written");
}

fn frame_record(project: &Project) -> Value {
    let module = project.folder().join("shaders/light.wgsl");
    let message = "error: it differs\n  replay: KARAT_PATHS=vulkan cargo test frames";
    json!({
        "schema": 5, "test": "frames::the <b>tiny</b> one", "verdict": "fail", "paths": [],
        "subject": { "kind": "frame", "golden": "tiny", "folder": "golden", "location": "tests/frames.rs:7:5" },
        "message": message, "details": fault(message),
        "read": [{ "file": module, "hash": "" }],
    })
}

fn function_record() -> Value {
    let points = (0..400).map(|k| (f64::from(k % 20) / 19.0, f64::from(k / 20) / 19.0));
    let rows: Vec<_> = points.map(|(x, y)| [x, y, 40.0 * x * y]).collect();
    let message = "error: `lobe::ggx` fails <script>window.injected = 1</script>\n  \
                   replay: KARAT_SEED=1 cargo test lobes";
    json!({
        "schema": 5, "test": "lobes", "verdict": "fail",
        "subject": { "kind": "function", "package": "shaders", "function": "lobe::ggx", "check": "agrees_with",
            "assertion": "1 ulp", "location": "shaders/a.wgsl:1:1", "seed": 1 },
        "message": message, "details": fault(message),
        "paths": [{
            "adapter": { "path": "cpu", "name": "an adapter", "driver": "", "software": true },
            "cases": 400, "failures": 1, "worst": "3 ulp", "ratio": 40.0, "asserted": "1 ulp", "known_issue": null,
            "plot": { "arguments": ["alpha", "n_dot_v"], "rows": rows },
        }],
    })
}

/// Makes a repository in which the scene's shader was edited, and the record of a run in which the frame and a function
/// failed.
pub(crate) fn with_origins(project: &Project) {
    let text = "// The sun.\nconst SUN = 1.0;\n\nfn sun(cosine: f32) -> f32 {\n    return SUN * max(cosine, 0.0);\n}\n";
    project.put("shaders/light.wgsl", text);
    let repository = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../golden");
    for file in ["environment.toml", "environment.exr"] {
        std::fs::copy(repository.join(file), project.folder().join("golden").join(file))
            .expect("copied");
    }
    project.put("Cargo.lock", "");
    let pending = Image::read_exr(&project.pending("scene")).expect("pending").0;
    let scene = Image::read_exr(&project.golden("scene")).expect("a golden").0;
    let hash = |text: &str| FileRead::of(std::path::Path::new(""), text.as_bytes()).hash;
    let commit = |warmth: f32, because: &str| {
        let mut image = scene.clone();
        image.pixels_mut().iter_mut().for_each(|pixel| pixel[2] *= warmth);
        project.put_golden_with("scene", &image, |facts| {
            facts["modules"] = json!({ "shaders/light.wgsl": hash(text) });
            (facts["width"], facts["height"]) = (image.width().into(), image.height().into());
            facts["because"] = because.into();
        });
        let hash = image.hash();
        let facts =
            format!("because = \"{because}\"\naccepted_by = \"Ada\"\npixels = \"{hash}\"\n");
        project.put("golden/scene.toml", &facts);
        project.git(&["add", "golden/scene.exr", "golden/scene.toml"]);
        project.git(&["add", "golden/environment.exr", "golden/environment.toml", "shaders"]);
        project.git(&["commit", "-q", "-m", "golden: the scene"]);
    };
    project.git(&["init", "-q"]);
    commit(0.7, "the first frame: each sphere is where the article has it");
    commit(1.0, "the light is no longer yellow: the sky is in it, too");
    let now = text.replace("max(cosine, 0.0)", "clamp(cosine, 0.0, 0.5)");
    project.put("shaders/light.wgsl", &now);
    project.put_pending("scene", &pending, |facts| {
        facts["shader"] = "5f".repeat(32).into();
        facts["modules"] = json!({ "shaders/light.wgsl": hash(&now) });
    });
    let mut frame = frame_record(project);
    frame["subject"]["golden"] = "scene".into();
    frame["test"] = "scene_agrees_with_its_golden".into();
    put_record(project, &[frame, function_record()]);
}

/// The page shows the edited lines of each module, and each version of the golden with the reason for accepting it.
#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn changes_since_the_golden_are_shown() {
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
    assert!(told.contains("are unknown: the golden isn't in a git repository"), "{told}");
    assert_eq!(browser.value(&tab, "document.getElementById('versions').hidden"), true);

    project.git(&["init", "-q"]);
    project.git(&["add", "golden/tiny.exr", "golden/tiny.toml", "shaders"]);
    project.git(&["commit", "-q", "-m", "the frame of the sun"]);
    std::fs::write(module("light.wgsl"), "const SUN = 2.0; // <u>brighter</u>\nconst SKY = 0.5;\n")
        .expect("written");
    std::fs::write(module("other.wgsl"), "const OTHER = 2.0;\n").expect("written");
    // Without a record, Karat doesn't know which modules the frame uses.
    let (_server, mut browser, tab) = open(&project, &[]);
    let names = "[...document.querySelectorAll('#modules summary')].map(name => name.innerText)";
    assert_eq!(browser.value(&tab, names), json!(["shaders/light.wgsl", "shaders/other.wgsl"]));
    assert!(browser.text(&tab, "#modules").contains("Without the record of a run"));
    assert_eq!(browser.value(&tab, "document.getElementById('test').hidden"), true);

    // Another crate of the workspace may have a frame with the same name.
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
    // The button copies the line. If the browser forbids copying, the button selects the line. The page says which
    // happened.
    browser.click(&tab, "#test .line:nth-child(3) button");
    browser.wait(&tab, "['Copied', 'Selected'].includes(document.querySelector('#test .line:nth-child(3) button').innerText)");
    // A golden that was accepted and isn't committed yet belongs to no commit.
    let mut other = tiny();
    other.pixels_mut()[0][0] = 5.0;
    project.put_golden("tiny", &other);
    let (_server, mut browser, tab) = open(&project, &[]);
    assert!(browser.text(&tab, "#modules").contains("the golden isn't committed"));
}

/// A golden and a pending frame store the hashes of the modules that drew them. To find the
/// changed modules, Karat compares these hashes, and doesn't need the golden's commit.
#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn modules_that_changed_are_known_by_their_hashes() {
    let project = Project::new();
    project.put("Cargo.lock", "");
    let hash = |text: &str| FileRead::of(std::path::Path::new(""), text.as_bytes()).hash;
    let lights = ["const SUN = 1.0;\n", "const SUN = 2.0;\n", "const SUN = 3.0;\n"];
    project.put("shaders/other.wgsl", "const OTHER = 1.0;\n");
    for (at, light) in lights[..2].iter().enumerate() {
        project.put("shaders/light.wgsl", light);
        project.commit(&format!("light {at}"));
    }
    project.put("shaders/light.wgsl", lights[2]);
    project.put("shaders/other.wgsl", "const OTHER = 2.0;\n");
    let put = |old: Value, new: Value| {
        project.put_golden_with("tiny", &tiny(), |facts| facts["modules"] = old.clone());
        let mut actual = tiny();
        actual.pixels_mut()[0][0] = 5.0;
        project.put_pending("tiny", &actual, |facts| {
            facts["shader"] = "changed".into();
            facts["modules"] = new.clone();
        });
    };
    let shown = |project: &Project| {
        let (_server, mut browser, tab) = open(project, &[]);
        let opened =
            "document.querySelectorAll('#modules details').forEach(d => { d.open = true; })";
        browser.value(&tab, opened);
        assert_eq!(
            browser.value(
                &tab,
                "karat.loaded().facts.filter(({ name }) => name.startsWith('modules')).length"
            ),
            0
        );
        browser.text(&tab, "#modules .body")
    };
    // The golden was drawn with an older version of the light than git's newest version.
    let (light, other) = ("shaders/light.wgsl", "shaders/other.wgsl");
    put(
        json!({ light: hash(lights[0]), other: hash("a"), "noise::value": hash("b") }),
        json!({ light: hash(lights[2]), other: hash("a"), "shaders/new.wgsl": hash("c") }),
    );
    assert_eq!(
        shown(&project).lines().filter(|line| !line.is_empty()).collect::<Vec<_>>(),
        [
            "The hashes show that these modules changed since the golden:",
            "noise::value: the frame no longer uses this module",
            light,
            "@@ -1 +1 @@",
            "-const SUN = 1.0;",
            "+const SUN = 3.0;",
            "shaders/new.wgsl: the golden didn't use this module",
        ]
    );
    // The module was edited and never committed.
    put(
        json!({ light: hash(lights[1]), other: hash("never") }),
        json!({ light: hash("a draft"), other: hash("now") }),
    );
    let told = shown(&project);
    assert!(
        told.contains("light.wgsl: the module was edited again after the frame was drawn"),
        "{told}"
    );
    assert!(told.contains("-const SUN = 2.0;"), "{told}");
    assert!(
        told.contains(
            "other.wgsl: git doesn't have the version of this module that drew the golden"
        ),
        "{told}"
    );
    // A checkout with other line ends isn't an edit.
    project.put("shaders/light.wgsl", &lights[2].replace('\n', "\r\n"));
    put(json!({ light: hash(lights[0]) }), json!({ light: hash(lights[2]) }));
    let told = shown(&project);
    assert!(told.contains("+const SUN = 3.0;") && !told.contains("edited"), "{told}");
    project.put("shaders/light.wgsl", lights[2]);
    // All modules are equal, so something else changed the linked program.
    put(json!({ light: hash(lights[0]) }), json!({ light: hash(lights[0]) }));
    let told = shown(&project);
    assert!(told.contains("The hashes show that no module changed since the golden."), "{told}");
    assert!(told.contains("features, overrides or Karat changed"), "{told}");
    // An old golden has no hashes. The page shows the changes that git knows.
    put(json!({}), json!({ light: hash(lights[2]) }));
    assert!(shown(&project).contains("the golden isn't committed"));
    project.git(&["add", "golden/tiny.exr"]);
    project.git(&["commit", "-q", "-m", "an old golden"]);
    let told = shown(&project);
    assert!(
        told.contains("since the golden's commit") && told.contains("+const SUN = 3.0;"),
        "{told}"
    );
    assert!(!told.contains("other.wgsl"), "the frame says which modules are its own: {told}");
}

/// An older version of a golden has a thumbnail in the history, and can be compared.
#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn older_versions_of_a_golden_are_seen_and_compared() {
    let project = Project::new();
    let version = |red: f32, because: &str| {
        let mut image = tiny();
        image.pixels_mut()[0][0] = red;
        project.put_golden("tiny", &image);
        let facts = format!("pixels = \"{}\"\nbecause = \"{because}\"\n", image.hash());
        project.put("golden/tiny.toml", &facts);
        project.commit(because)
    };
    let first = version(7.0, "the first");
    // The provenance may change without the image.
    let (same, second) = (version(8.0, "the second"), version(8.0, "for another reason"));
    let commits = [first, second];
    version(9.0, "now");
    project.put_pending("tiny", &tiny(), |_| {});
    let (server, mut browser, tab) = open(&project, &[]);
    let buttons = "[...document.querySelectorAll('#versions li')].map(row => row.querySelector('.version')?.dataset.commit ?? row.querySelector('.now').innerText)";
    assert_eq!(
        browser.value(&tab, buttons),
        json!(["as now", commits[1], format!("as {}", commits[1]), commits[0]])
    );
    assert_ne!(same, commits[1]);
    let pictures = "document.querySelectorAll('#versions canvas').length";
    assert_eq!(browser.value(&tab, pictures), 0, "they are below what is seen");
    browser.value(&tab, "document.getElementById('versions').scrollIntoView()");
    browser.wait(&tab, &format!("{pictures} === 2"));
    let choose =
        |commit: &str| format!("document.querySelector('[data-commit=\"{commit}\"]').click()");
    browser.value(&tab, &choose(&commits[0]));
    browser.wait(&tab, "karat.state.part === 1");
    browser.settle(&tab);
    let sides = "(({ golden, actual }) => [golden.values[0], actual.values[0]])(karat.loaded().parts[karat.state.part])";
    let red = |value: f32| f64::from(value);
    assert_eq!(browser.value(&tab, sides), json!([7, red(0.01)]));
    let label = browser.text(&tab, "#overlay");
    assert!(label.contains(&format!("Golden of {}", commits[0])), "{label}");
    let pressed = "document.querySelector('.version[aria-pressed=true]')?.dataset.commit ?? 'none'";
    assert_eq!(browser.value(&tab, pressed), commits[0].as_str());
    // Choosing another version replaces the first version. Choosing the same version again shows the golden.
    browser.value(&tab, &choose(&commits[1]));
    browser.wait(&tab, "karat.loaded().parts[1].golden.values[0] === 8");
    assert_eq!(browser.value(&tab, "karat.loaded().parts.length"), 2);
    browser.value(&tab, &choose(&commits[1]));
    browser.wait(&tab, "karat.state.part === 0");
    assert_eq!(browser.value(&tab, sides), json!([9, red(0.01)]));

    // The server only accepts versions that git has listed.
    for (place, status, text) in [
        ("data/0-HEAD.js", 200, "the requested commit isn't a version of the golden"),
        ("data/0---output=x.js", 200, "the requested commit isn't a version of the golden"),
        ("data/9-0.js", 404, ""),
    ] {
        let answer = server.get(place);
        assert!(answer.status == status && answer.text.contains(text), "{answer:?}");
    }

    // A golden without a pending frame is compared with its older version.
    std::fs::remove_file(project.pending("tiny")).expect("there");
    let (_server, mut browser, tab) = open(&project, &["--all-goldens"]);
    browser.value(&tab, &choose(&commits[0]));
    browser.wait(&tab, "karat.state.part === 1");
    browser.press(&tab, "3");
    assert_eq!(browser.value(&tab, sides), json!([7, 9]));
    assert_eq!(browser.text(&tab, "#message"), "");
    let label = browser.text(&tab, "#overlay");
    assert_eq!(label, format!("Golden now − golden of {}", commits[0]));

    // A report without a server has the versions, too.
    let report = project.folder().join("report");
    let ran = project.karat(&["review", "--all-goldens", "--static"]).arg(&report).output();
    assert!(ran.expect("it was built").status.success());
    let tab = browser.open(&format!("file://{}/index.html", report.display()));
    browser.settle(&tab);
    browser.value(&tab, &choose(&commits[1]));
    browser.wait(&tab, "karat.state.part === 1");
    assert_eq!(browser.value(&tab, sides), json!([8, 9]));
    assert!(report.join(format!("data/0-{}.js", commits[0])).is_file());
    // The files of an older report are deleted.
    std::fs::remove_dir_all(project.folder().join(".git")).expect("there");
    let ran = project.karat(&["review", "--all-goldens", "--static"]).arg(&report).output();
    assert!(ran.expect("it was built").status.success());
    assert!(!report.join(format!("data/0-{}.js", commits[0])).exists());
}

/// A report contains only as many older versions of goldens as fit into the report's size limit.
#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn older_versions_leave_a_report_small() {
    let project = Project::with_frames();
    let golden = Image::read_exr(&project.golden("diffuse")).expect("a golden").0;
    let noisy = |seed: usize| {
        let mut image = golden.clone();
        for (index, pixel) in image.pixels_mut().iter_mut().enumerate() {
            let noise = 1.0 + 0.01 * (((index + seed) * 7919 % 101) as f32 / 50.0 - 1.0);
            pixel[..3].iter_mut().for_each(|value| *value *= noise);
        }
        image.rounded_to(karat::image::Precision::Half)
    };
    for seed in 1..6 {
        project.put_golden("diffuse", &noisy(seed));
        project.commit(&format!("diffuse {seed}"));
    }
    let frame = noisy(0);
    project.put_pending("diffuse", &frame, |facts| facts["precision"] = "half".into());
    let report = project.folder().join("report");
    let ran = project.karat(&["review", "--static"]).arg(&report).output().expect("it was built");
    assert!(ran.status.success(), "{ran:?}");
    let files = std::fs::read_dir(report.join("data")).expect("a folder").filter_map(Result::ok);
    let of_first: Vec<(String, u64)> = files
        .map(|file| (file.file_name().to_string_lossy().into_owned(), file))
        .filter(|(name, _)| name == "0.js" || name.starts_with("0-"))
        .map(|(name, file)| (name, file.metadata().expect("written").len()))
        .collect();
    println!("bytes: {of_first:?}");
    let all: u64 = of_first.iter().map(|(_, length)| length).sum();
    assert!(all <= 1_000_000 && of_first.len() > 1 && of_first.len() < 5, "{of_first:?}");
    let mut browser = Browser::start();
    let tab = browser.open(&format!("file://{}/index.html", report.display()));
    browser.settle(&tab);
    browser.value(&tab, "document.getElementById('versions').scrollIntoView()");
    browser.wait(&tab, "document.getElementById('versions').innerText.includes('left out to keep this report small')");
}

/// A test can add facts to a frame's provenance, such as a seed. If such a fact has changed, the page's header shows
/// the old and the new value.
#[test]
fn declared_facts_that_changed_are_in_the_header() {
    let project = Project::new();
    project.put_golden("tiny", &tiny());
    let mut actual = tiny();
    actual.pixels_mut()[0][0] = 5.0;
    project.put_pending("tiny", &actual, |facts| facts["facts"]["seed"] = "<8>".into());
    let (_server, mut browser, tab) = open(&project, &[]);
    assert_eq!(
        browser.text(&tab, "#cause"),
        "in the provenance, only the facts that the test adds have changed"
    );
    assert_eq!(browser.text(&tab, "#declared"), "seed: none → <8>");
}

#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn functions_that_fail_are_on_the_list() {
    let project = Project::with_tiny();
    put_record(&project, &[function_record()]);
    let (_server, mut browser, tab) = open(&project, &[]);
    assert_eq!(browser.text(&tab, "#cases .folder"), "failing functions");
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

    // A report without a server names the changed facts, too.
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
    project.git(&["init", "-q"]);
    project.git(&["add", "golden"]);
    project.git(&["commit", "-q", "-m", "both"]);
    let (_server, mut browser, tab) = open(&project, &["--all-goldens"]);
    let names = "[...document.querySelectorAll('#cases .name')].map(name => name.innerText)";
    assert_eq!(browser.value(&tab, names), json!(["tiny", "rooms/dark"]));
    assert_eq!(browser.text(&tab, "#cases .folder"), "accepted goldens");
    assert_eq!(browser.text(&tab, "#count"), "nothing to review");
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

/// In a report, a frame of 480 by 270 takes less than 1 MB, even if all its pixels are noise.
#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn a_frame_takes_less_than_a_megabyte() {
    let project = Project::with_frames();
    let report = project.folder().join("report");
    let ran = project.karat(&["review", "--static"]).arg(&report).output().expect("it was built");
    assert!(ran.status.success(), "{ran:?}");
    // Files are in the order of names. `diffuse` is a picture of 480 by 270 in which all pixels have noise.
    let length = |index: usize| {
        std::fs::metadata(report.join(format!("data/{index}.js"))).expect("written").len()
    };
    let lengths: Vec<u64> = (0..4).map(length).collect();
    println!("bytes: {lengths:?}");
    assert!(lengths.iter().all(|length| *length < 1_000_000), "{lengths:?}");
    // The browser reads every bit of the frame.
    let mut browser = Browser::start();
    let tab = browser.open(&format!("file://{}/index.html", report.display()));
    browser.settle(&tab);
    let found = browser.value(&tab, "['golden', 'actual'].map(side => { let sum = 0; for (const word of new Uint32Array(karat.loaded().parts[0][side].values.buffer)) sum = (Math.imul(sum, 31) + word) >>> 0; return sum; })");
    let read = |path: &std::path::Path| Image::read_exr(path).expect("an image").0;
    let sum = |image: Image| {
        let words =
            image.pixels().iter().flatten().map(|value| value.to_bits()).collect::<Vec<_>>();
        words.into_iter().fold(0_u32, |sum, word| sum.wrapping_mul(31).wrapping_add(word))
    };
    let expected =
        [project.golden("diffuse"), project.pending("diffuse")].map(|path| sum(read(&path)));
    assert_eq!(found, json!(expected));
}
