//! Tests the list of frames: its thumbnails and its order, the contact sheet, and decisions on several frames at once.

use karat::Image;
use serde_json::json;

use crate::browser::{Browser, Tab};
use crate::project::{Project, Server, tiny};

fn open(project: &Project) -> (Server, Browser, Tab) {
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    (server, browser, tab)
}

/// A project of tiny frames: some differ a little or much, and others have another size, are new, or contain NaN.
fn various() -> Project {
    let project = Project::new();
    for (case, factor) in [("a-little", 1.004), ("b-far", 3.0)] {
        let mut actual = tiny();
        actual.pixels_mut().iter_mut().for_each(|pixel| pixel[1] *= factor);
        project.put_golden(case, &tiny());
        project.put_pending(case, &actual, |_| {});
    }
    project.put_golden("c-size", &tiny());
    project.put_pending("c-size", &Image::new(6, 4, vec![[0.5; 4]; 24]), |_| {});
    project.put_pending("d-new", &tiny(), |_| {});
    let mut actual = tiny();
    actual.pixels_mut()[3][0] = f32::NAN;
    project.put_golden("e-nan", &tiny());
    project.put_pending("e-nan", &actual, |_| {});
    project
}

const THUMBS: &str = "document.querySelectorAll('#cases canvas.thumb').length === 5";

#[test]
fn the_list_shows_and_sorts_frames_by_their_error() {
    let project = various();
    let (_server, mut browser, tab) = open(&project);
    browser.wait(&tab, THUMBS);
    let column = |class: &str| {
        format!(
            "[...document.querySelectorAll('#cases li button')].map(row => [...row.querySelectorAll('{class}')].map(mark => mark.innerText).join())"
        )
    };
    assert_eq!(browser.value(&tab, &column(".badge")), json!(["", "", "size", "", "NaN"]));
    assert_eq!(browser.value(&tab, &column(".status")), json!(["", "", "", "new", ""]));
    let far = browser.value(&tab, &column(".severity"));
    assert_eq!((&far[2], &far[3]), (&json!("∞"), &json!("")));
    let times = |text: &serde_json::Value| {
        text.as_str().and_then(|text| text.strip_suffix(" ×")?.parse().ok()).unwrap_or(f64::NAN)
    };
    assert!((times(&far[0]) - 4.0).abs() < 0.1 && times(&far[1]) > 1000.0, "{far}");
    // A thumbnail has the colours of its frame: pale for three equal channels, and the colour of NaN.
    let pixel = "(() => { const c = document.querySelectorAll('#cases canvas.thumb')[4]; const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; for (let i = 0; i < d.length; i += 4) if (d[i] === 255 && d[i + 1] === 0 && d[i + 2] === 255) return true; return false; })()";
    assert_eq!(browser.value(&tab, pixel), true, "NaN is magenta");
    // The page doesn't keep the data that it loaded for a thumbnail.
    let kept = browser.value(&tab, "karat.state.cases.map(({ data }) => data !== null)");
    assert_eq!(kept, json!([true, false, false, false, false]));

    assert_eq!(browser.text(&tab, "#position"), "1 of 5");
    browser.press(&tab, "l");
    let names = "[...document.querySelectorAll('#cases .name')].map(name => name.innerText)";
    assert_eq!(
        browser.value(&tab, names),
        json!(["c-size", "e-nan", "b-far", "a-little", "d-new"])
    );
    assert_eq!(browser.text(&tab, "#position"), "4 of 5");
    browser.press(&tab, "k");
    assert_eq!(browser.text(&tab, "#name"), "b-far", "keys follow the order that is shown");
    browser.click(&tab, "#sort");
    browser.settle(&tab);
    assert_eq!(browser.text(&tab, "#position"), "2 of 5");
}

#[test]
fn the_contact_sheet_shows_and_opens_each_frame() {
    let project = various();
    let (_server, mut browser, tab) = open(&project);
    browser.press(&tab, "s");
    browser.wait(&tab, "document.querySelectorAll('#sheet canvas.thumb').length === 13");
    let about = browser
        .value(&tab, "[...document.querySelectorAll('#sheet .about')].map(a => a.innerText)");
    assert_eq!(about[2], "can't be compared, another size");
    assert_eq!(about[3], "new");
    assert!(about[4].as_str().is_some_and(|text| text.ends_with("NaN")), "{about}");
    browser.click(&tab, "#sheet .card:nth-child(2)");
    browser.settle(&tab);
    assert_eq!(browser.text(&tab, "#name"), "b-far");
    assert_eq!(browser.value(&tab, "document.getElementById('sheet').hidden"), true);
    browser.press(&tab, "s");
    browser.press(&tab, "Escape");
    assert_eq!(browser.value(&tab, "document.getElementById('sheet').hidden"), true);
}

#[test]
fn several_frames_are_accepted_with_one_reason() {
    let project = various();
    let (_server, mut browser, tab) = open(&project);
    browser.wait(&tab, THUMBS);
    browser.press(&tab, "y");
    browser.press(&tab, "j");
    browser.press(&tab, "y");
    assert_eq!(browser.text(&tab, "#chosen"), "2 chosen");
    assert_eq!(browser.text(&tab, "#accept-label"), "Accept 2");
    browser.press(&tab, "a");
    assert_eq!(browser.text(&tab, "#accept-dialog .subject"), "2 frames");
    assert_eq!(browser.text(&tab, "#accept-dialog .subjects"), "a-little\nb-far");
    assert_eq!(browser.value(&tab, "document.getElementById('last-reason').hidden"), true);
    browser.write(&tab, "the light is warmer, as planned");
    browser.press(&tab, "Enter");
    browser.wait(&tab, "document.getElementById('news').textContent === 'accepted 2 frames'");
    for case in ["a-little", "b-far"] {
        assert!(!project.pending(case).exists());
        let facts = std::fs::read_to_string(project.folder().join(format!("golden/{case}.toml")));
        assert!(facts.expect("written").contains("the light is warmer, as planned"));
    }
    assert!(project.pending("c-size").is_file(), "it wasn't chosen");
    browser.wait(&tab, "document.getElementById('name').textContent === 'c-size'");

    // The page offers the last reason again. Enter doesn't accept it without another key.
    browser.settle(&tab);
    browser.press(&tab, "a");
    assert!(browser.text(&tab, "#last-reason").contains("the light is warmer, as planned"));
    browser.press(&tab, "Enter");
    browser.wait(&tab, "document.querySelector('#accept-dialog .problem').textContent !== ''");
    assert!(project.pending("c-size").is_file());
    browser.press(&tab, "ArrowUp");
    browser.press(&tab, "Enter");
    browser.wait(&tab, "document.getElementById('name').textContent === 'd-new'");
    assert!(!project.pending("c-size").exists());

    // The key rejects all listed frames. The page asks first, and Enter deletes nothing.
    browser.press(&tab, "Y");
    assert_eq!(browser.text(&tab, "#reject-label"), "Reject 2");
    browser.press(&tab, "r");
    assert_eq!(browser.value(&tab, "document.activeElement.textContent"), "Cancel");
    browser.press(&tab, "Enter");
    assert!(project.pending("d-new").is_file() && project.pending("e-nan").is_file());
    browser.press(&tab, "r");
    browser.press(&tab, "Tab");
    browser.press(&tab, "Enter");
    browser.wait(&tab, "document.getElementById('count').textContent === 'nothing to review'");
    assert!(!project.pending("d-new").exists() && !project.pending("e-nan").exists());
}

/// If the server refuses some of several decisions, the page reports the refused decisions, and the server carries out
/// all others.
#[test]
fn refused_frames_stay_pending() {
    let project = various();
    let (_server, mut browser, tab) = open(&project);
    browser.wait(&tab, THUMBS);
    let mut other = tiny();
    other.pixels_mut()[0][0] = 5.0;
    project.put_golden("b-far", &other);
    browser.press(&tab, "Y");
    browser.press(&tab, "a");
    browser.write(&tab, "why");
    browser.press(&tab, "Enter");
    browser.wait(&tab, "document.querySelector('#accept-dialog .problem').textContent !== ''");
    browser.wait(&tab, "!document.querySelector('#accept-dialog button').disabled");
    let problem = browser.text(&tab, "#accept-dialog .problem");
    assert!(problem.contains("b-far") && problem.contains("has changed since"), "{problem}");
    assert!(project.pending("b-far").is_file());
    assert!(!project.pending("a-little").exists() && !project.pending("d-new").exists());
}
