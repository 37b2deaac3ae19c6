//! Tests narrow windows and touch screens.

use serde_json::json;

use crate::browser::Browser;
use crate::project::Project;

/// The page is never wider than the screen, and on a touch screen each button is large enough for a finger.
#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn the_page_fits_narrow_touch_screens_with_large_buttons() {
    let project = Project::with_frames();
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    for (width, touch) in [(1000, false), (700, false), (700, true), (390, true)] {
        if touch {
            browser.touch(&tab, width, 900);
        } else {
            browser.resize(&tab, width, 900, 1.0);
        }
        for key in ["4", "3", "6", "s", "s"] {
            browser.press(&tab, key);
            let wide = browser.value(&tab, "[document.documentElement.scrollWidth, innerWidth]");
            assert_eq!(wide[0], wide[1], "{width} {key}: nothing is to its right");
        }
        let stage = browser.value(&tab, "[stage => stage.width, stage => stage.height].map(side => side(document.getElementById('canvas').getBoundingClientRect()))");
        let least = if width > 800 { 400 } else { width - 2 };
        assert!(stage[0].as_f64().expect("a width") >= f64::from(least), "{stage}");
        assert!(stage[1].as_f64().expect("a height") >= 300.0, "{stage}");
        if touch {
            let small = browser.value(&tab, "[...document.querySelectorAll('button, select, summary, input')].filter(e => e.checkVisibility())
                .map(e => [e.id || e.className, (e.closest('.choose') ?? e).getBoundingClientRect()]).filter(([, { width, height }]) => width < 40 || height < 40)
                .map(([name, { width, height }]) => `${name} ${width} x ${height}`)");
            assert_eq!(small, json!([]));
        }
    }
}

/// On a telephone, the toolbar is one line, in which the buttons of the views scroll sideways. A person can unfold the
/// toolbar's other parts.
#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn the_toolbar_is_one_line_on_a_telephone() {
    let project = Project::with_frames();
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.touch(&tab, 390, 844);
    browser.settle(&tab);
    let look = "['tools', 'canvas'].map(id => document.getElementById(id).getBoundingClientRect()).map(({ top, height }) => [top, height])";
    let measure = |browser: &mut Browser| -> [[f64; 2]; 2] {
        browser.settle(&tab);
        serde_json::from_value(browser.value(&tab, look)).expect("numbers")
    };
    let [[_, tools], [top, height]] = measure(&mut browser);
    assert!(tools <= 60.0, "{tools}");
    assert!(top <= 300.0 && top + height <= 844.0 && height >= 400.0, "{top} {height}");
    let shown = |browser: &mut Browser, id: &str| {
        browser.value(&tab, &format!("document.getElementById('{id}').checkVisibility()"))
    };
    assert_eq!(shown(&mut browser, "exposure"), false);
    // The selected view is visible, whichever key or tap selected it.
    browser.press(&tab, "6");
    let inside = "(() => { const [view, row] = ['#view-map', '#tools .views'].map(of => document.querySelector(of).getBoundingClientRect()); return view.left >= row.left && view.right <= row.right + 1; })()";
    browser.wait(&tab, inside);
    browser.press(&tab, "4");
    browser.click(&tab, "#tools-more");
    browser.settle(&tab);
    assert_eq!(shown(&mut browser, "exposure"), true);
    let expanded = "document.getElementById('tools-more').getAttribute('aria-expanded')";
    assert_eq!(browser.value(&tab, expanded), "true");
    let wide = browser.value(&tab, "[document.documentElement.scrollWidth, innerWidth]");
    assert_eq!(wide[0], wide[1]);
    browser.click(&tab, "#tools-more");
    let [[_, folded], _] = measure(&mut browser);
    assert!((folded - tools).abs() < 1.0, "{folded}");
}

#[test]
fn fingers_drag_and_pinch() {
    let project = Project::with_tiny();
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.touch(&tab, 700, 900);
    browser.press(&tab, "1");
    browser.value(&tab, "karat.change({ scale: 60, fit: false })");
    let look = "(() => { const b = karat.stage.canvas.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2, karat.state.scale, ...karat.state.center]; })()";
    let read = |browser: &mut Browser| -> Vec<f64> {
        browser.settle(&tab);
        serde_json::from_value(browser.value(&tab, look)).expect("numbers")
    };
    let [x, y, scale, ..] = read(&mut browser)[..] else { panic!("five numbers") };
    // If the distance of two fingers doubles, the image doubles its size, and the point between the fingers stays.
    browser.fingers(&tab, "touchStart", &[(x - 40.0, y)]);
    browser.fingers(&tab, "touchStart", &[(x - 40.0, y), (x + 40.0, y)]);
    browser.fingers(&tab, "touchMove", &[(x - 60.0, y), (x + 60.0, y)]);
    browser.fingers(&tab, "touchMove", &[(x - 80.0, y), (x + 80.0, y)]);
    browser.fingers(&tab, "touchEnd", &[]);
    let [_, _, larger, across, down] = read(&mut browser)[..] else { panic!("five numbers") };
    assert!((larger / scale - 2.0).abs() < 0.01, "{scale} {larger}");
    assert!((across - 2.0).abs() < 0.05 && (down - 2.0).abs() < 0.05, "{across} {down}");
    assert!(browser.value(&tab, "karat.state.pinned").is_null(), "a pinch is no tap");
    // One finger drags the image, and a tap pins a pixel.
    browser.fingers(&tab, "touchStart", &[(x, y)]);
    browser.fingers(&tab, "touchMove", &[(x + 50.0, y + 20.0)]);
    browser.fingers(&tab, "touchMove", &[(x + 100.0, y + 40.0)]);
    browser.fingers(&tab, "touchEnd", &[]);
    let [_, _, same, left, up] = read(&mut browser)[..] else { panic!("five numbers") };
    assert!((same - larger).abs() < 1e-6);
    assert!((across - left - 100.0 / larger).abs() < 0.02, "{across} {left}");
    assert!((down - up - 40.0 / larger).abs() < 0.02, "{down} {up}");
    browser.fingers(&tab, "touchStart", &[(x, y)]);
    browser.fingers(&tab, "touchEnd", &[]);
    browser.settle(&tab);
    assert!(!browser.value(&tab, "karat.state.pinned").is_null());
}
