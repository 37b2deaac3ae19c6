//! Tests the display of differences: gain and colours, failing areas, values of pixels, and histograms.

use karat::Image;
use serde_json::{Value, json};

use crate::browser::{Browser, Tab};
use crate::project::{Project, Server};

fn open(project: &Project) -> (Server, Browser, Tab) {
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    (server, browser, tab)
}

/// Writes a grey frame of 64 by 32 pixels as golden, and a pending frame in which `change` sets some pixels.
fn grey(project: &Project, case: &str, change: impl Fn(usize, usize, &mut [f32; 4])) {
    let golden = Image::new(64, 32, vec![[0.5, 0.5, 0.5, 1.0]; 64 * 32]);
    project.put_golden(case, &golden);
    let mut actual = golden;
    for (index, pixel) in actual.pixels_mut().iter_mut().enumerate() {
        change(index % 64, index / 64, pixel);
    }
    project.put_pending(case, &actual, |_| {});
}

/// The colour that the page's canvas shows for a texel. The page must show only one image.
fn colour(browser: &mut Browser, tab: &Tab, x: u32, y: u32) -> [u8; 3] {
    browser.settle(tab);
    let found = browser.value(tab, &format!(
        "(() => {{ const p = karat.stage.panes()[0]; const [l, t] = karat.stage.origin(p); const s = karat.state.scale;
          const at = [Math.floor(l + ({x} + 0.5) * s), karat.stage.canvas.height - 1 - Math.floor(t + ({y} + 0.5) * s)];
          const out = new Uint8Array(4); const gl = karat.stage.gl;
          gl.readPixels(at[0], at[1], 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, out); return [...out]; }})()"
    ));
    [0, 1, 2].map(|channel| found[channel].as_u64().expect("a byte") as u8)
}

fn gain(browser: &mut Browser, tab: &Tab) -> Value {
    browser.settle(tab);
    browser.value(
        tab,
        "[document.getElementById('gain-value').innerText, document.getElementById('gain-auto').getAttribute('aria-pressed')]",
    )
}

/// Each frame has its own gain: the factor by which the page multiplies the differences. If all frames had the same
/// gain, the differences of some frames would be too dark or too bright to see.
#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn each_frame_has_its_own_gain() {
    let project = Project::new();
    grey(&project, "faint", |_, _, pixel| pixel[1] *= 1.0 + 1.0 / 512.0);
    grey(&project, "noisy", |x, y, pixel| {
        pixel[0] *= if (x + y) % 2 == 0 { 1.2 } else { 0.8 };
    });
    let (_server, mut browser, tab) = open(&project);
    browser.press(&tab, "3");
    assert_eq!(gain(&mut browser, &tab), json!(["× 512", "true"]));
    browser.press(&tab, "[");
    assert_eq!(gain(&mut browser, &tab), json!(["× 256", "false"]), "chosen");
    browser.press(&tab, "j");
    assert_eq!(gain(&mut browser, &tab), json!(["× 4", "true"]), "20 % are within 1/4");
    let [red, _, blue] = colour(&mut browser, &tab, 3, 4);
    assert!(red < 100 && blue > 200, "0.8 of 1 is bright blue");
    browser.press(&tab, "k");
    assert_eq!(gain(&mut browser, &tab), json!(["× 512", "true"]), "not the 256 of before");
    browser.press(&tab, "]");
    browser.press(&tab, "g");
    assert_eq!(gain(&mut browser, &tab), json!(["× 512", "true"]));
    // Only green differs, so red has nothing to amplify.
    browser.press(&tab, "c");
    assert_eq!(gain(&mut browser, &tab), json!(["× 1", "true"]));
}

#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn differences_have_the_hues_of_their_channels() {
    let project = Project::new();
    grey(&project, "hues", |x, y, pixel| {
        if y < 3 && x < 3 {
            pixel[x] += 0.25 * if y == 0 { 1.0 } else { -1.0 };
        }
    });
    let (_server, mut browser, tab) = open(&project);
    browser.press(&tab, "3");
    browser.value(&tab, "karat.change({ gain: 1, gainAuto: false })");
    browser.press(&tab, "d");
    let about = |browser: &mut Browser| {
        browser.settle(&tab);
        browser.text(&tab, "#legend")
    };
    let text = about(&mut browser);
    assert!(text.contains("difference relative to golden, R, G and B"), "{text}");
    let ticks: Vec<_> = text.split_whitespace().rev().take(5).collect();
    assert_eq!(ticks, ["+0.5", "+0.25", "equal", "−0.25", "−0.5"]);
    assert_eq!(colour(&mut browser, &tab, 9, 9), [128, 128, 128], "equal is grey");
    for (x, y, expected) in [
        (0, 0, [255, 128, 128]),
        (1, 0, [128, 255, 128]),
        (2, 0, [128, 128, 255]),
        (0, 1, [0, 128, 128]),
        (2, 1, [128, 128, 0]),
    ] {
        let found = colour(&mut browser, &tab, x, y);
        assert!(found.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 1), "{x} {y} {found:?}");
    }
    browser.press(&tab, "d");
    assert!(about(&mut browser).contains("size of difference relative to golden, R, G and B"));
    assert_eq!(colour(&mut browser, &tab, 9, 9), [0, 0, 0], "equal is black");
    assert_eq!(colour(&mut browser, &tab, 1, 1), [0, 255, 0], "less or more");
    browser.press(&tab, "c");
    assert_eq!(colour(&mut browser, &tab, 0, 1), [255, 38, 38], "red in its hue");
    assert_eq!(colour(&mut browser, &tab, 1, 1), [0, 0, 0], "green isn't looked at");
    // The canvas shows the values that the formulas give.
    let expected =
        browser.value(&tab, "karat.tones.absolute([1, 1, 1], 1).map(v => Math.round(255 * v))");
    assert_eq!(expected, json!([255, 38, 38]));
    browser.press(&tab, "d");
    assert_eq!(browser.value(&tab, "document.getElementById('how').value"), "0");
}

#[test]
fn failing_areas_are_outlined_and_single_pixels_enlarged() {
    let project = Project::new();
    grey(&project, "areas", |x, y, pixel| {
        if (10..20).contains(&x) && (8..14).contains(&y) {
            pixel[2] *= 1.5;
        }
        if (x, y) == (50, 25) || (x, y) == (51, 26) {
            pixel[0] *= 3.0;
        }
        if (x, y) == (60, 3) {
            pixel[0] *= 1.0009; // allowed
        }
    });
    let (_server, mut browser, tab) = open(&project);
    let boxes = browser.value(&tab, "karat.failing.of(karat.loaded()).boxes.map(({ left, top, right, bottom, count }) => [left, top, right, bottom, count])");
    assert_eq!(boxes, json!([[50, 25, 51, 26, 2], [10, 8, 19, 13, 60]]), "worst first");
    // At a scale of 1, a person would overlook two pixels.
    browser.value(&tab, "karat.change({ scale: 1, fit: false, center: [32, 16], view: 'actual' })");
    browser.settle(&tab);
    let sizes = "[...document.querySelectorAll('#overlay .area')].map(area => [area.className, area.offsetWidth, area.offsetHeight])";
    assert_eq!(browser.value(&tab, sizes), json!([["area small", 13, 13], ["area small", 13, 13]]));
    browser.value(&tab, "karat.change({ scale: 4, fit: false })");
    browser.settle(&tab);
    assert_eq!(
        browser.value(&tab, sizes),
        json!([["area small", 13, 13], ["area", 40, 24]]),
        "what is large has its own size"
    );
    browser.press(&tab, "w");
    let pinned = browser.value(&tab, "karat.state.pinned");
    assert!([json!([50, 25]), json!([51, 26])].contains(&pinned), "{pinned}");
    browser.press(&tab, "W");
    let [x, y] = [0, 1].map(|side| browser.value(&tab, &format!("karat.state.pinned[{side}]")));
    assert!(
        (10..20).contains(&x.as_u64().expect("x")) && (8..14).contains(&y.as_u64().expect("y"))
    );
    browser.press(&tab, "o");
    assert_eq!(browser.value(&tab, sizes), json!([]));
    browser.press(&tab, "o");
    browser.press(&tab, "1");
    assert_eq!(browser.value(&tab, sizes), json!([]), "the golden itself fails nowhere");
}

/// If many scattered pixels fail, the page groups these pixels into a few outlines. An outline for each pixel would
/// hide the image.
#[test]
fn noise_has_few_outlines() {
    let project = Project::new();
    grey(&project, "noise", |x, y, pixel| {
        if x % 3 == 0 && y % 3 == 0 {
            pixel[0] *= 1.1;
        }
    });
    let (_server, mut browser, tab) = open(&project);
    let found = browser.value(&tab, "(({ count, boxes }) => [count, boxes.length, boxes.reduce((sum, box) => sum + box.count, 0)])(karat.failing.of(karat.loaded()))");
    assert_eq!(found, json!([242, 1, 242]), "each is in one");
    // An outline around the whole image would say nothing, so the page says it in words.
    assert_eq!(browser.value(&tab, "document.querySelectorAll('#overlay .area').length"), 0);
    let label = "[...document.querySelectorAll('#overlay .pane')].map(pane => pane.innerText)";
    assert_eq!(
        browser.value(&tab, label),
        json!(["Golden", "Actual fails all over: 11.8 % of its pixels"])
    );
    browser.press(&tab, "W");
    let pinned = browser.value(&tab, "karat.state.pinned.map(side => side % 3)");
    assert_eq!(pinned, json!([0, 0]), "a pixel that fails, and not all of them");
    browser.press(&tab, "o");
    assert_eq!(browser.value(&tab, label), json!(["Golden", "Actual"]));
}

/// The page outlines no pixels outside of the mask, and no pixels with a difference within the gate's tolerance.
#[test]
fn masked_pixels_do_not_fail() {
    let project = Project::new();
    grey(&project, "masked", |x, y, pixel| {
        if (x, y) == (5, 5) || (x, y) == (40, 20) {
            pixel[1] *= 1.5;
        }
        if (x, y) == (30, 3) {
            pixel[3] = 0.9995; // for alpha, a thousandth is allowed
        }
    });
    let (_server, mut browser, tab) = open(&project);
    let count = |browser: &mut Browser, data: &str| {
        let found = format!(
            "(({{ count, boxes }}) => [count, ...boxes.map(box => box.at)])(karat.failing.of({{ ...karat.loaded(), refused: undefined, {data} }}))"
        );
        browser.value(&tab, &found)
    };
    let both = json!([2, [5, 5], [40, 20]]);
    assert_eq!(count(&mut browser, ""), both);
    let mask = "parts: [...karat.loaded().parts, { name: 'mask', actual: { values: new Float32Array(64 * 32 * 4).map((_, i) => Math.floor(i / 4) % 64 < 20 ? 0 : 1) } }]";
    assert_eq!(count(&mut browser, mask), json!([1, [40, 20]]));
    assert_eq!(count(&mut browser, "gate: { relative: 0.6, absolute: null }"), json!([0]));
    assert_eq!(count(&mut browser, "gate: { relative: 1e-4, absolute: null }")[0], 3);
    assert_eq!(count(&mut browser, "gate: { relative: 1e-4, absolute: 1 }"), json!([0]));
    let gate = browser.value(&tab, "karat.loaded().gate");
    assert!((gate["relative"].as_f64().expect("a number") - 1e-3).abs() < 1e-9, "{gate}");
}

#[test]
fn values_are_written_on_large_pixels() {
    let project = Project::with_tiny();
    let (_server, mut browser, tab) = open(&project);
    let drawn = "(() => { const c = document.getElementById('values'); if (c.hidden) return 0;
        return c.getContext('2d').getImageData(0, 0, c.width, c.height).data.filter((v, i) => i % 4 === 3 && v).length; })()";
    browser.press(&tab, "1");
    let all = browser.value(&tab, drawn).as_u64().expect("a number");
    assert!(all > 1000, "{all}: 16 pixels have four values each");
    browser.press(&tab, "c");
    let red = browser.value(&tab, drawn).as_u64().expect("a number");
    assert!(red > 200 && red < all / 2, "{red} of {all}: of red one line");
    browser.press(&tab, "v");
    assert_eq!(browser.value(&tab, drawn), 0, "they can go");
    browser.press(&tab, "v");
    browser.value(&tab, "karat.change({ scale: 20, fit: false })");
    browser.settle(&tab);
    assert_eq!(browser.value(&tab, drawn), 0, "there is no room");
}

#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn histograms_count_each_pixel_of_both_sides() {
    let project = Project::new();
    grey(&project, "grey", |x, y, pixel| {
        if y == 0 {
            pixel[0] = [0.0, 8.0][usize::from(x < 32)];
        }
    });
    let (_server, mut browser, tab) = open(&project);
    let counts = "['golden', 'actual'].map(side => { const { bins, none } = karat.histogram.of(karat.loaded().parts[0][side], 1);
        return [bins.reduce((a, b) => a + b), none, bins.filter(Boolean).length]; })";
    assert_eq!(browser.value(&tab, counts), json!([[2048, 0, 1], [2016, 32, 2]]));
    browser.press(&tab, "c");
    assert_eq!(browser.text(&tab, "#histogram-of"), "R");
    assert_eq!(browser.text(&tab, "#histogram-most"), "2048 pixels");
    assert_eq!(browser.text(&tab, "#histogram-none"), "without a logarithm: golden 0, actual 32");
    let drawn = "(() => { const c = document.querySelector('#histogram canvas');
        return new Set(new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer)).size; })()";
    assert!(browser.value(&tab, drawn).as_u64().expect("colours") > 3);
    browser.press(&tab, "h");
    assert_eq!(browser.value(&tab, "document.getElementById('histogram').open"), false);
}
