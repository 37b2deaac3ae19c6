//! Tests the page of a run in a browser.

use std::path::Path;

use serde_json::json;

use crate::browser::Browser;
use crate::faults::fault;
use crate::project::Project;

/// Writes a record of two functions. One of the functions fails, and has two arguments.
fn record(folder: &Path) {
    let line = |name: &str, fails: bool| {
        let ratio = |x: f64, y: f64| if fails { 40.0 * x * y } else { 0.1 };
        let points = (0..400).map(|k| (f64::from(k % 20) / 19.0, f64::from(k / 20) / 19.0));
        let rows: Vec<_> = points.map(|(x, y)| [x, y, ratio(x, y)]).collect();
        let verdict = if fails { "fail" } else { "pass" };
        let message = fails.then_some("error: `f` fails\n  replay: KARAT_SEED=1 cargo test");
        let mut path = json!({
            "adapter": { "path": "cpu", "name": "an adapter", "driver": "", "software": true },
            "cases": 400, "failures": u8::from(fails), "worst": "3 ulp", "ratio": 3.0,
            "asserted": "1 ulp", "known_issue": null,
            "errors": { "exact": 100, "powers": { "-3": 250, "2": 50 }, "not_finite": 0 }
        });
        if fails {
            path["plot"] = json!({ "arguments": ["alpha", "n_dot_v"], "rows": rows });
        }
        let subject = json!({
            "kind": "function", "package": "shaders", "function": name, "check": "agrees_with",
            "assertion": "1 ulp", "location": "shaders/a.wgsl:1:1", "seed": 1
        });
        let record = json!({
            "schema": 5, "test": format!("test_of_{name}"), "subject": subject, "verdict": verdict,
            "paths": [path], "message": message, "details": message.map(fault)
        });
        format!("{record}\n")
    };
    let text = line("lobe::ggx", true) + &line("fresnel::schlick", false);
    std::fs::write(folder.join("1.jsonl"), text).expect("written");
    let run = json!({ "schema": 5, "selected": [], "passed": false });
    std::fs::write(folder.join("run.json"), run.to_string()).expect("written");
}

/// Search, links and plots of the page work without a server, at any width, with light and with dark colours.
#[test]
fn a_report_page_can_be_searched_and_fits_any_width() {
    let project = Project::new();
    let folder = project.folder().join("record");
    std::fs::create_dir(&folder).expect("a folder");
    record(&folder);
    let file = project.folder().join("report.html");
    let mut command = project.karat(&["report", "--record", "record", "--html", "report.html"]);
    let ran = command.output().expect("it was built");
    assert_eq!(ran.status.code(), Some(1), "{ran:?}");
    let mut browser = Browser::start();
    let link = "#fresnel::schlick-agrees_with-test_of_fresnel::schlick";
    let tab = browser.open(&format!("file://{}{link}", file.display()));
    let target = "document.querySelector(':target th a').textContent";
    assert_eq!(browser.value(&tab, target), "fresnel::schlick");
    let shown = "[...document.querySelectorAll('.row')].filter(r => !r.hidden).length";
    assert_eq!(browser.value(&tab, shown), 3, "what fails is shown in full, and in the table");
    let search = |words: &str| {
        format!(
            "(() => {{ search.value = {words:?}; search.dispatchEvent(new Event('input')); return {shown}; }})()"
        )
    };
    assert_eq!(browser.value(&tab, &search("SCHLICK cpu")), 1);
    assert_eq!(browser.value(&tab, "document.getElementById('none').hidden"), true);
    assert_eq!(browser.value(&tab, &search("schlick ggx")), 0);
    assert_eq!(browser.value(&tab, "document.getElementById('none').hidden"), false);
    assert_eq!(browser.value(&tab, &search("")), 3);
    let failing = format!("(() => {{ failing.click(); return {shown}; }})()");
    assert_eq!(browser.value(&tab, &failing), 2);
    // The page has two plots and their map, with points of both colours.
    assert_eq!(browser.value(&tab, "document.querySelectorAll('figure svg').length"), 3);
    let colours = "new Set([...document.querySelectorAll('figure circle')].map(c => c.getAttribute('fill'))).size";
    assert_eq!(browser.value(&tab, colours), 2);
    let shots = Path::new(env!("CARGO_TARGET_TMPDIR")).join("../karat/review");
    for (width, dark) in [(1400, false), (1400, true), (390, false)] {
        browser.resize(&tab, width, 900, 1.0);
        browser.prefer_dark(&tab, dark);
        let fits = "document.documentElement.scrollWidth <= window.innerWidth";
        assert_eq!(browser.value(&tab, fits), true, "{width} pixels");
        let paper = browser.value(&tab, "getComputedStyle(document.body).backgroundColor");
        assert_eq!(paper == "rgb(255, 255, 255)", !dark, "{paper}");
        let name = format!("report-{width}-{}.png", if dark { "dark" } else { "light" });
        browser.screen(&tab, Some(&shots.join(name)));
    }
}
