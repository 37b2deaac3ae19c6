//! Compares the page's display with the content of the files.

use karat::Image;
use karat::unstable::value::format_f32;

use crate::browser::{Browser, Tab};
use crate::project::{Project, provenance, tiny};
use crate::shots::shoot;

/// The sRGB colour (IEC 61966-2-1) that the page should show for a pixel, with an exposure of `stops`.
fn srgb([r, g, b, _]: [f32; 4], stops: f32) -> [u8; 3] {
    [r, g, b].map(|value| {
        let x = (f64::from(value) * f64::from(stops).exp2()).clamp(0.0, 1.0);
        let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (255.0 * encoded).round() as u8
    })
}

fn close(a: [u8; 3], b: [u8; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 1)
}

/// The screen position of the middle of a texel in a pane.
fn place(browser: &mut Browser, tab: &Tab, pane: usize, x: u32, y: u32) -> (usize, usize) {
    let at = browser.value(tab, &format!(
        "(() => {{ const p = karat.stage.panes()[{pane}]; const [l, t] = karat.stage.origin(p); const s = karat.state.scale; const b = karat.stage.canvas.getBoundingClientRect(); return [b.x + l + ({x} + 0.5) * s, b.y + t + ({y} + 0.5) * s]; }})()"
    ));
    let side = |index: usize| at[index].as_f64().expect("a number") as usize;
    (side(0), side(1))
}

/// The colour of a texel in a pane on the screen.
fn seen(browser: &mut Browser, tab: &Tab, pane: usize, x: u32, y: u32) -> [u8; 3] {
    let (x, y) = place(browser, tab, pane, x, y);
    browser.screen(tab, None).rgb(x, y)
}

fn open(project: &Project) -> (crate::project::Server, Browser, Tab) {
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    // The function reads colours in the middle of texels, where the page would write values.
    browser.value(&tab, "karat.change({ values: false, outlines: false })");
    browser.settle(&tab);
    (server, browser, tab)
}

#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn all_cases_are_listed_and_keys_move_between_them() {
    let project = Project::with_frames();
    let (_server, mut browser, tab) = open(&project);
    let names = browser
        .value(&tab, "[...document.querySelectorAll('#cases .name')].map(name => name.innerText)");
    assert_eq!(names, serde_json::json!(["diffuse", "furnace", "scene", "layered"]));
    assert_eq!(browser.text(&tab, "#cases .folder"), "rooms/");
    let causes = [
        ("diffuse", "only the driver changed"),
        (
            "furnace",
            "shader and driver are the same: the frame isn't deterministic, or its inputs changed",
        ),
        ("scene", "the shader changed"),
        ("rooms/layered", "new: there is no golden yet"),
    ];
    for (position, (name, cause)) in causes.into_iter().enumerate() {
        if position > 0 {
            browser.press(&tab, "j");
        }
        assert_eq!(
            (browser.text(&tab, "#name"), browser.text(&tab, "#cause")),
            (name.into(), cause.into())
        );
    }
    browser.press(&tab, "j");
    assert_eq!(browser.text(&tab, "#name"), "rooms/layered", "the last stays");
    browser.press(&tab, "k");
    assert_eq!(browser.text(&tab, "#name"), "scene");
    for (key, view) in
        [("1", "golden"), ("2", "actual"), ("3", "difference"), ("4", "side"), ("5", "swipe")]
    {
        browser.press(&tab, key);
        assert_eq!(browser.value(&tab, "karat.state.view"), view);
    }
    browser.press(&tab, "f");
    browser.press(&tab, "t");
    browser.press(&tab, "z");
    let now = browser.value(&tab, "[karat.state.falseColor, karat.state.grid, karat.state.scale]");
    assert_eq!(now, serde_json::json!([true, true, 1]));
    browser.press(&tab, "?");
    assert_eq!(browser.value(&tab, "document.getElementById('help').open"), true);
    // The help names all keys.
    let missing = browser.value(&tab, "(() => { const names = { Escape: 'Esc', ' ': 'space', '-': '−', '=': '+', ArrowLeft: '←', ArrowRight: '→', ArrowUp: '↑', ArrowDown: '↓' };
        const told = [...document.querySelectorAll('#help kbd')].map(key => key.innerText);
        return karat.keys.filter(key => !told.includes(names[key] ?? key)); })()");
    assert_eq!(missing, serde_json::json!(["?"]), "but the one that shows them");
    let keys = browser.text(&tab, "#help");
    assert!(keys.contains("filter the list") && keys.contains("next, previous frame"), "{keys}");
    browser.press(&tab, "j");
    assert_eq!(browser.text(&tab, "#name"), "scene", "keys wait for the dialog");
}

#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn exposure_changes_the_canvas_as_computed() {
    let project = Project::with_tiny();
    let (_server, mut browser, tab) = open(&project);
    let (golden, actual) = (tiny(), Image::read_exr(&project.pending("tiny")).expect("pending").0);
    for (keys, stops) in [(&[][..], 0.0), (&["e"][..], 1.0), (&["E", "E", "E"][..], -2.0)] {
        for key in keys {
            browser.press(&tab, key);
        }
        for (x, y) in [(0, 0), (3, 0), (1, 2), (3, 3)] {
            for (pane, image) in [(0, &golden), (1, &actual)] {
                let pixel = image.pixels()[(4 * y + x) as usize];
                let (found, expected) = (seen(&mut browser, &tab, pane, x, y), srgb(pixel, stops));
                assert!(close(found, expected), "({x}, {y}) at {stops}: {found:?}, {expected:?}");
            }
        }
    }
}

#[test]
fn the_canvas_is_what_the_formulas_give() {
    let project = Project::with_tiny();
    let (_server, mut browser, tab) = open(&project);
    browser.press(&tab, "2");
    for tone in 0..4 {
        let name = browser.value(&tab, &format!("karat.tones.all[{tone}].name"));
        for (x, y) in [(0, 0), (2, 1), (3, 3)] {
            let expected = browser.value(&tab, &format!(
                "karat.tones.all[{tone}].map([...karat.state.cases[0].data.parts[0].actual.values.slice(4 * ({y} * 4 + {x}), 4 * ({y} * 4 + {x}) + 3)]).map(v => Math.round(255 * v))"
            ));
            let expected = [0, 1, 2].map(|c| expected[c].as_u64().expect("a byte") as u8);
            let found = seen(&mut browser, &tab, 0, x, y);
            assert!(close(found, expected), "{name} ({x}, {y}): {found:?}, {expected:?}");
        }
        browser.press(&tab, "m");
    }
    // In false colour, 0.18 is in the middle of the scale, where the polynomials are 0.588, 0.982 and 0.313 by hand.
    let middle = browser.value(&tab, "karat.tones.falseColor(0.18).map(v => Math.round(255 * v))");
    assert_eq!(middle, serde_json::json!([150, 250, 80]));
    browser.press(&tab, "f");
    let expected = browser.value(&tab, "karat.tones.falseColor(karat.tones.luminance(karat.state.cases[0].data.parts[0].actual.values.slice(20, 23))).map(v => Math.round(255 * v))");
    let expected = [0, 1, 2].map(|c| expected[c].as_u64().expect("a byte") as u8);
    let found = seen(&mut browser, &tab, 0, 1, 1);
    assert!(close(found, expected), "{found:?}, {expected:?}");
}

#[test]
fn the_difference_is_black_where_bits_are_equal() {
    let project = Project::new();
    project.put_golden("tiny", &tiny());
    let mut actual = tiny();
    actual.pixels_mut()[5][1] += 0.125;
    actual.pixels_mut()[6][0] -= 0.03125;
    project.put_pending("tiny", &actual, |_| {});
    let (_server, mut browser, tab) = open(&project);
    browser.press(&tab, "3");
    let from = browser.value(&tab, "karat.state.relative");
    assert_eq!(from, true, "differences are relative, as they are judged");
    browser.click(&tab, "#relative");
    browser.settle(&tab);
    assert_eq!(browser.value(&tab, "karat.state.gain"), 3, "1/8 is at the end of the scale");
    let [equal, more, less] =
        [(0, 0), (1, 1), (2, 1)].map(|(x, y)| seen(&mut browser, &tab, 0, x, y));
    assert_eq!(equal, [0, 0, 0]);
    assert!(close(more, [255, 128, 26]), "{more:?}");
    assert!(close(less, [26, 70, 128]), "{less:?}: a quarter of the scale, its root of the colour");
}

#[test]
fn swipe_shows_golden_left_and_actual_right_of_its_handle() {
    let project = Project::with_tiny();
    let (_server, mut browser, tab) = open(&project);
    browser.press(&tab, "5");
    let (golden, actual) = (tiny(), Image::read_exr(&project.pending("tiny")).expect("pending").0);
    let expected = |image: &Image, x: usize| srgb(image.pixels()[x], 0.0);
    let (left, right) = (seen(&mut browser, &tab, 0, 0, 0), seen(&mut browser, &tab, 0, 3, 0));
    assert!(
        close(left, expected(&golden, 0)) && close(right, expected(&actual, 3)),
        "{left:?} {right:?}"
    );
    let (x, y) = place(&mut browser, &tab, 0, 3, 3);
    let handle = browser.value(&tab, "(() => { const b = document.getElementById('handle').getBoundingClientRect(); return [b.x + b.width / 2, b.y + 20]; })()");
    let from = (handle[0].as_f64().expect("x"), handle[1].as_f64().expect("y"));
    browser.pointer(&tab, "mousePressed", from);
    browser.pointer(&tab, "mouseMoved", (x as f64 + 100.0, y as f64));
    browser.pointer(&tab, "mouseReleased", (x as f64 + 100.0, y as f64));
    browser.settle(&tab);
    let right = seen(&mut browser, &tab, 0, 3, 0);
    assert!(close(right, expected(&golden, 3)), "the handle is to its right now: {right:?}");
}

#[test]
fn zoom_and_pan_are_linked_and_a_click_pins() {
    let project = Project::with_tiny();
    let (_server, mut browser, tab) = open(&project);
    let at = |(x, y): (usize, usize)| (x as f64, y as f64);
    let scale = |browser: &mut Browser| browser.value(&tab, "karat.state.scale").as_f64();
    let (before, from) = (scale(&mut browser), place(&mut browser, &tab, 1, 3, 2));
    browser.wheel(&tab, at(from), -200.0);
    browser.wait(&tab, "karat.state.fit === false");
    browser.settle(&tab);
    assert!(scale(&mut browser) > before, "away from the person is nearer to the image");
    let now = place(&mut browser, &tab, 1, 3, 2);
    let near = |a: usize, b: usize| a.abs_diff(b) <= 2;
    assert!(
        near(now.0, from.0) && near(now.1, from.1),
        "{now:?} {from:?}: what is pointed at stays"
    );

    let golden = place(&mut browser, &tab, 0, 3, 2);
    browser.pointer(&tab, "mousePressed", at(now));
    browser.pointer(&tab, "mouseMoved", (now.0 as f64 - 40.0, now.1 as f64 + 10.0));
    browser.pointer(&tab, "mouseReleased", (now.0 as f64 - 40.0, now.1 as f64 + 10.0));
    browser.settle(&tab);
    let moved = place(&mut browser, &tab, 0, 3, 2);
    assert!(near(moved.0 + 40, golden.0) && near(moved.1, golden.1 + 10), "{moved:?} {golden:?}");
    assert!(browser.value(&tab, "karat.state.pinned").is_null(), "a drag is no click");

    let pinned = place(&mut browser, &tab, 1, 3, 2);
    browser.pointer(&tab, "mousePressed", at(pinned));
    browser.pointer(&tab, "mouseReleased", at(pinned));
    browser.press(&tab, "ArrowLeft");
    assert!(browser.text(&tab, "#where").starts_with("(2, 2) pinned"));
}

#[test]
fn the_flip_view_alternates_both_images_and_can_be_stopped() {
    let project = Project::with_tiny();
    let (_server, mut browser, tab) = open(&project);
    browser.press(&tab, " ");
    browser.wait(&tab, "document.querySelector('#overlay .pane').innerText === 'Actual'");
    browser.wait(&tab, "document.querySelector('#overlay .pane').innerText === 'Golden'");
    browser.press(&tab, " ");
    assert_eq!(browser.value(&tab, "karat.state.flipping"), false);
    browser.click(&tab, "#view-side");
    browser.click(&tab, "#view-flip");
    browser.settle(&tab);
    assert_eq!(browser.value(&tab, "karat.state.flipping"), true);
    assert_eq!(browser.text(&tab, "#hz-value"), "3 a second");
}

#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn the_inspector_s_values_are_those_of_the_files() {
    let project = Project::with_frames();
    let (_server, mut browser, tab) = open(&project);
    for _ in 0..2 {
        browser.press(&tab, "j");
    }
    let read = |path| Image::read_exr(path).expect("an image").0;
    let (golden, actual) = (read(&project.golden("scene")), read(&project.pending("scene")));
    browser.press(&tab, "z");
    for (x, y) in [(292, 19), (320, 180), (301, 150)] {
        browser.value(&tab, &format!("karat.change({{ center: [{x}, {y}], pinned: null }})"));
        browser.settle(&tab);
        let (left, top) = place(&mut browser, &tab, 1, x, y);
        browser.pointer(&tab, "mouseMoved", (left as f64, top as f64));
        browser.settle(&tab);
        let rows = browser.value(&tab, "[...document.querySelectorAll('#inspector tbody tr')].map(row => [...row.cells].map(cell => cell.innerText))");
        let index = (y * golden.width() + x) as usize;
        let (g, a) = (golden.pixels()[index], actual.pixels()[index]);
        for channel in 0..4 {
            let row = &rows[channel];
            assert_eq!(row[1], format_f32(g[channel]), "({x}, {y}) {row}");
            assert_eq!(row[2], format_f32(a[channel]), "({x}, {y}) {row}");
        }
        let text = browser.text(&tab, "#where");
        assert!(text.starts_with(&format!("({x}, {y}), tile ({}, {})", x / 16, y / 16)), "{text}");
    }
}

#[test]
fn numbers_in_the_page_are_printed_as_in_rust() {
    let project = Project::with_tiny();
    let (_server, mut browser, tab) = open(&project);
    let powers = (-149..128).map(|exponent| f64::from(exponent).exp2() as f32);
    let spread = (0..3000_u32).map(|index| f32::from_bits(index.wrapping_mul(2_654_435_761)));
    let few = [
        0.0,
        -0.0,
        f32::MIN_POSITIVE,
        f32::MAX,
        f32::INFINITY,
        -f32::INFINITY,
        1e7,
        9_999_999.0,
        1e-4,
    ];
    let values: Vec<f32> =
        powers.chain(spread).chain(few).filter(|value| !value.is_nan()).collect();
    let bits: Vec<u32> = values.iter().map(|value| value.to_bits()).collect();
    let floats = format!("new Float32Array(new Uint32Array({bits:?}).buffer)");
    let printed = browser.value(&tab, &format!("[...{floats}].map(karat.numbers.shortest)"));
    let ulps = browser.value(&tab, &format!("[...{floats}].map((value, i, all) => karat.numbers.ulps(value, all[(i + 1) % all.length]))"));
    for (index, value) in values.iter().enumerate() {
        assert_eq!(printed[index], format_f32(*value), "{value:e}");
        let next = values[(index + 1) % values.len()];
        assert_eq!(
            ulps[index].as_u64(),
            karat::unstable::tolerance::ulp_distance(*value, next),
            "{value:e} {next:e}"
        );
    }
    let halves = browser.value(&tab, "Array.from({ length: 65536 }, (_, word) => karat.numbers.half(word)).map(value => Number.isNaN(value) ? 'NaN' : Object.is(value, -0) ? '-0' : String(value))");
    for word in 0..=u16::MAX {
        let expected = half::f16::from_bits(word).to_f64();
        let text = halves[usize::from(word)].as_str().expect("text");
        let found: f64 = text.replace("Infinity", "inf").parse().expect("a number");
        assert!(
            found == expected && found.is_sign_negative() == expected.is_sign_negative()
                || (found.is_nan() && expected.is_nan()),
            "{word:04x}: {text}"
        );
    }
}

#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn nan_has_its_colour_at_any_zoom() {
    let project = Project::with_frames();
    let (_server, mut browser, tab) = open(&project);
    browser.press(&tab, "j");
    browser.press(&tab, "2");
    let found = [(63, 43), (83, 43), (103, 43)].map(|(x, y)| seen(&mut browser, &tab, 0, x, y));
    assert_eq!(found, [[255, 0, 255], [255, 255, 0], [0, 255, 255]]);
    browser.press(&tab, "n");
    assert_ne!(seen(&mut browser, &tab, 0, 103, 43), [0, 255, 255], "marks of negatives can go");
    assert_eq!(seen(&mut browser, &tab, 0, 63, 43), [255, 0, 255], "NaN's can't");
    browser.press(&tab, "3");
    assert_eq!(seen(&mut browser, &tab, 0, 63, 43), [255, 0, 255], "a difference from NaN is NaN");
    browser.press(&tab, "2");
    browser.value(&tab, "karat.change({ scale: 0.13, fit: false })");
    browser.settle(&tab);
    assert_eq!(seen(&mut browser, &tab, 0, 64, 44), [255, 0, 255], "a few pixels, averaged away");
    browser.press(&tab, "w");
    let pinned = browser.value(&tab, "karat.state.pinned");
    assert_eq!(pinned, serde_json::json!([60, 40]), "its key finds the first one");
    let text = browser.text(&tab, "#verdict");
    assert!(
        text.contains("64 pixels with NaN and 64 with infinities, first at (60, 40)"),
        "{text}"
    );
}

#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn facts_are_side_by_side_with_what_differs_first() {
    let project = Project::with_frames();
    let (_server, mut browser, tab) = open(&project);
    let rows = browser.value(&tab, "[...document.querySelectorAll('#facts .differs')].map(row => [...row.cells].map(cell => cell.title || cell.innerText))");
    let old = provenance()["adapter"]["driver"].as_str().expect("a driver").to_owned();
    assert_eq!(rows.as_array().map(Vec::len), Some(2), "{rows}");
    assert_eq!(rows[1], serde_json::json!(["driver", old, "llvmpipe Mesa 25.0.7 (LLVM 19.1.7)"]));
    let gate = browser.text(&tab, "#gates li");
    assert!(gate.contains("gate rel 1e-3") && gate.contains("fails"), "{gate}");
    // Parts that belong together share a line, and the lines of all gates have the same form.
    let parts = "[...document.querySelectorAll('#gates .values, #gates .margin, #gates .place, #verdict .number')]";
    let broken = format!(
        "{parts}.filter(part => part.getBoundingClientRect().height > 24).map(part => part.innerText)"
    );
    assert_eq!(browser.value(&tab, &broken), serde_json::json!([]));
    let above = "[...document.querySelectorAll('#gates li')].every(gate => gate.querySelector('.name').getBoundingClientRect().bottom <= gate.querySelector('.margin').getBoundingClientRect().top + 1)";
    assert_eq!(browser.value(&tab, above), true);
    assert_eq!(
        browser.value(&tab, "document.querySelector('#verdict .number').innerText"),
        "1e-3,"
    );
    browser.press(&tab, "w");
    assert_eq!(browser.value(&tab, "karat.state.pinned !== null && karat.state.scale >= 1"), true);
}

#[test]
fn the_canvas_uses_the_full_resolution_of_a_high_density_screen() {
    let project = Project::with_tiny();
    let (_server, mut browser, tab) = open(&project);
    browser.resize(&tab, 1280, 720, 2.0);
    assert_eq!(browser.value(&tab, "devicePixelRatio"), 2);
    browser.press(&tab, "t");
    let full = "karat.stage.canvas.width === 2 * karat.stage.canvas.clientWidth";
    assert_eq!(browser.value(&tab, full), true);
}

#[test]
fn the_page_shows_the_parts_maps_and_gates_of_the_data() {
    let project = Project::with_tiny();
    let (_server, mut browser, tab) = open(&project);
    // The map of FLIP is available.
    assert_eq!(browser.value(&tab, "document.getElementById('view-map').disabled"), false);
    let maps = browser.value(&tab, "karat.state.cases[0].data.maps.map((map) => map.name)");
    assert_eq!(maps, serde_json::json!(["HDR-FLIP", "worst exposure in stops"]));
    // A data file may contain more than one image.
    browser.value(&tab, r#"(() => {
        const data = { ...karat.state.cases[0].data };
        const image = (...values) => ({ width: 4, height: 4, format: "f32", data:
            btoa(String.fromCharCode(...new Uint8Array(new Float32Array(Array.from({ length: 16 }, () => values).flat()).buffer))) });
        karat.receive({ ...data,
            parts: [{ name: "color", golden: image(1, 0, 0, 1), actual: image(0, 1, 0, 1) },
                    { name: "variance", golden: image(0, 0, 1, 1), actual: null }],
            maps: [{ name: "HDR-FLIP", about: "perceived error", range: [0, 0.1], image: image(0.05, 0.05, 0.05, 1) },
                   { name: "exposure", about: "the worst one", range: [0, 1], image: image(1, 0, 1, 1) }],
            gates: [{ name: "mean FLIP", value: 0.002, bound: 0.005, place: null, passes: true, note: "of all pixels" },
                    { name: "worst tile", value: 0.094, bound: 0.01, place: [0, 0, 3, 3], passes: false }] });
    })()"#);
    browser.press(&tab, "1");
    assert_eq!(seen(&mut browser, &tab, 0, 1, 1), [255, 0, 0]);
    browser.value(&tab, "(() => { const p = document.getElementById('part'); p.value = '1'; p.dispatchEvent(new Event('change')); })()");
    browser.settle(&tab);
    assert_eq!(seen(&mut browser, &tab, 0, 1, 1), [0, 0, 255]);
    browser.press(&tab, "6");
    assert_eq!(seen(&mut browser, &tab, 0, 1, 1), [150, 250, 80], "0.05 of 0.1 is in the middle");
    assert_eq!(browser.text(&tab, "#map-about"), "perceived error");
    browser.press(&tab, "6");
    assert_eq!(seen(&mut browser, &tab, 0, 1, 1), [255, 0, 255], "colours stay as they are");
    let gates = browser.text(&tab, "#gates");
    assert!(gates.contains("0.002 of 0.005") && gates.contains("passes, 0.4 × bound"), "{gates}");
    assert!(gates.contains("of all pixels"), "{gates}");
    assert!(
        gates.contains("fails, 9.4 × bound") && gates.contains("worst at (0, 0), 4 × 4"),
        "{gates}"
    );
}

/// A map shows one number for each pixel as a colour. The colours extend over the range of numbers that the map
/// declares. Pixels without a value are black.
#[test]
fn a_map_has_its_range_and_holes() {
    let project = Project::with_tiny();
    let (_server, mut browser, tab) = open(&project);
    browser.value(&tab, r#"(() => {
        const data = { ...karat.state.cases[0].data };
        const values = Array.from({ length: 16 }, (_, i) => i < 8 ? [-4, -4, -4, 1] : [0, 0, 0, 0]).flat();
        const image = { width: 4, height: 4, format: "f32", data:
            btoa(String.fromCharCode(...new Uint8Array(new Float32Array(values).buffer))) };
        karat.receive({ ...data, parts: [{ name: "color", golden: image, actual: image }],
            maps: [{ name: "worst exposure", about: "stops", range: [-6, -2], image }] });
    })()"#);
    browser.press(&tab, "6");
    assert_eq!(
        seen(&mut browser, &tab, 0, 1, 1),
        [150, 250, 80],
        "-4 of -6 to -2 is in the middle"
    );
    assert_eq!(seen(&mut browser, &tab, 0, 1, 3), [0, 0, 0], "there is no value");
    let ticks = browser.text(&tab, "#legend .ticks");
    assert_eq!(ticks.split_whitespace().collect::<Vec<_>>(), ["−6", "−4", "−2"]);
}

/// A browser may take the graphics memory away from the page. When the browser returns the memory, the page draws its
/// images again.
#[test]
fn a_lost_webgl_context_is_restored() {
    let project = Project::with_tiny();
    let (_server, mut browser, tab) = open(&project);
    browser.press(&tab, "1");
    let before = seen(&mut browser, &tab, 0, 1, 1);
    browser.value(&tab, "(() => { window.losing = karat.stage.gl.getExtension('WEBGL_lose_context'); losing.loseContext(); })()");
    browser.wait(
        &tab,
        "document.getElementById('message').innerText.includes('taken the graphics memory back')",
    );
    browser.value(&tab, "losing.restoreContext()");
    browser.wait(&tab, "document.getElementById('message').hidden");
    browser.press(&tab, "2");
    browser.press(&tab, "1");
    assert_eq!(seen(&mut browser, &tab, 0, 1, 1), before);
}

#[test]
fn without_webgl_2_the_page_says_so() {
    let project = Project::with_tiny();
    let server = project.serve();
    let mut browser = Browser::with(&["--disable-3d-apis"]);
    let tab = browser.open(&server.url);
    browser.wait(&tab, "document.getElementById('message').innerText.includes('no WebGL 2')");
    let names = browser.text(&tab, "#cases");
    assert!(names.contains("tiny"), "{names}");
}

/// Writes a pending table with the values of `x * gain`, as a test does.
pub(crate) fn left_values(project: &Project, case: &str, gain: &str) {
    let package =
        karat::Package::from_source("m", format!("fn f(x: f32) -> f32 {{ return x * {gain}; }}"));
    let (checked, folder) =
        (package.function("f").over(1.0..=2.0_f32), project.folder().join("golden"));
    let goldens = karat::Goldens::open(&folder);
    checked
        .cases(24)
        .unrecorded()
        .try_matches(&goldens, case, karat::Ulp(1.0))
        .expect_err("nothing to agree with");
    // In CI, pending tables lie in another folder, together with those of other tests.
    let elsewhere = karat::unstable::golden::build_output()
        .join(format!("karat/pending/golden/{case}.new.csv"));
    if karat::unstable::golden::in_ci() {
        std::fs::rename(elsewhere, folder.join(format!("{case}.new.csv"))).expect("moved");
    }
}

/// Accepts the pending values from [`left_values`]: they become the golden.
pub(crate) fn accept_values(project: &Project, case: &str) {
    let goldens = karat::Goldens::open(&project.folder().join("golden"));
    let because = "the first".to_owned();
    let acceptance = karat::unstable::golden::Acceptance {
        because,
        any_adapter: true,
        ci_may_write: true,
        ..Default::default()
    };
    let pending = goldens.select(case).expect("it waits").frames;
    goldens.accept(&pending[0], &acceptance).expect("accepted");
}

#[test]
fn values_that_are_accepted_stand_among_the_goldens() {
    let project = Project::new();
    project.put("Cargo.lock", "");
    let case = "review_of_accepted_values";
    left_values(&project, case, "0.5");
    accept_values(&project, case);
    let facts =
        karat::unstable::golden::Table::read(&project.folder().join(format!("golden/{case}.csv")));
    let hash = karat::unstable::record::FileRead::of(
        std::path::Path::new(""),
        b"fn f(x: f32) -> f32 { return x * 0.5; }",
    );
    assert_eq!(facts.expect("a table").1.modules["package"], hash.hash, "of a module in memory");
    project.put_golden("tiny", &tiny());
    project.commit("the values of f");
    let server = project.serve_with(&["--all-goldens"]);
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    assert_eq!(browser.text(&tab, "#cases .folder"), "accepted goldens");
    assert_eq!(browser.text(&tab, "#name"), case);
    assert_eq!(browser.text(&tab, "#size"), "24 rows");
    assert_eq!(browser.text(&tab, "#table-count"), "24 rows");
    let rows = "[...document.querySelectorAll('#table tr')].slice(0, 2).map(row => [...row.cells].map(cell => cell.innerText))";
    assert_eq!(
        browser.value(&tab, rows),
        serde_json::json!([["row", "x", "result"], ["1", "1", "0.5"]])
    );
    assert_eq!(browser.text(&tab, "#verdict"), "accepted: the first");
    assert!(browser.text(&tab, "#facts").contains("accepted by"));
    let version = browser.text(&tab, "#versions li");
    assert!(version.contains("the first") && version.contains("the values of f"), "{version}");
    assert_eq!(browser.value(&tab, "document.querySelectorAll('#versions .version').length"), 0);
    browser.press(&tab, "a");
    assert_eq!(browser.value(&tab, "document.querySelector('dialog[open]') === null"), true);
    browser.press(&tab, "j");
    browser.settle(&tab);
    assert_eq!(browser.text(&tab, "#name"), "tiny");
    assert_eq!(browser.value(&tab, "document.getElementById('table').hidden"), true);
}

#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn older_versions_of_values_are_compared_row_by_row() {
    let project = Project::new();
    project.put("Cargo.lock", "");
    let case = "review_of_older_values";
    for gain in ["0.5", "(0.5 + select(0.0, 0.25, x == 1.0))"] {
        left_values(&project, case, gain);
        accept_values(&project, case);
        project.commit(&format!("a gain of {gain}"));
    }
    let row =
        "[...document.querySelector('#table tbody').rows[0].cells].map(cell => cell.innerText)";
    let button = "document.querySelector('#versions .version')";
    let rows = "document.querySelector('#table tbody').rows.length";
    let choose = |browser: &mut Browser, tab: &Tab| {
        browser.wait(tab, &format!("{button}?.innerText.includes('differ')"));
        browser.value(tab, &format!("{button}.click()"));
        browser.settle(tab);
    };

    let server = project.serve_with(&["--all-goldens"]);
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.settle(&tab);
    assert_eq!(browser.value(&tab, rows), 24);
    choose(&mut browser, &tab);
    let history = browser.text(&tab, "#versions");
    assert!(history.contains("as now") && history.contains("4 rows differ"), "{history}");
    // The function is sampled often at the end of a range.
    assert_eq!(browser.value(&tab, rows), 4);
    assert_eq!(browser.value(&tab, row), serde_json::json!(["1", "1", "0.5", "0.75", "0.5"]));
    let count = browser.text(&tab, "#table-count");
    assert!(count.ends_with("then the golden now"), "{count}");
    assert_eq!(browser.value(&tab, &format!("{button}.ariaPressed")), "true");
    shoot(&mut browser, &tab, "version-of-values");
    browser.value(&tab, &format!("{button}.click()"));
    browser.settle(&tab);
    assert_eq!(browser.text(&tab, "#table-count"), "24 rows");
    drop(server);

    // Shows pending values, also in a report without a server.
    left_values(&project, case, "(0.5 + select(0.0, 0.5, x <= 1.0))");
    let report = project.folder().join("report");
    let ran = project.karat(&["review", "--static"]).arg(&report).output().expect("it was built");
    assert!(ran.status.success(), "{ran:?}");
    let tab = browser.open(&format!("file://{}/index.html", report.display()));
    browser.settle(&tab);
    assert_eq!(browser.value(&tab, row), serde_json::json!(["1", "1", "0.75", "1", "0.333"]));
    choose(&mut browser, &tab);
    assert_eq!(browser.value(&tab, row), serde_json::json!(["1", "1", "0.5", "1", "1"]));
    assert!(browser.text(&tab, "#table-count").ends_with("then actual"));
}

#[test]
fn values_are_shown_as_rows_and_decided_like_frames() {
    let project = Project::new();
    project.put("Cargo.lock", "");
    let case = "review_of_values";
    left_values(&project, case, "0.5");
    accept_values(&project, case);
    left_values(&project, case, "(0.5 + select(0.0, 0.25, x == 1.0))");
    project.put_golden("tiny", &tiny());
    project.put_pending("tiny", &Image::new(4, 4, vec![[1.0; 4]; 16]), |_| ());
    let (_server, mut browser, tab) = open(&project);
    let shown = "[document.getElementById('table').hidden, document.getElementById('tools').offsetHeight > 0]";
    assert_eq!(browser.text(&tab, "#name"), case);
    assert_eq!(browser.value(&tab, shown), serde_json::json!([false, false]));
    assert_eq!(browser.text(&tab, "#size"), "24 rows");
    assert_eq!(browser.text(&tab, "#cause"), "the shader changed");
    let cells = browser.value(
        &tab,
        "[...document.querySelector('#table tbody tr').cells].map(cell => cell.innerText).slice(1)",
    );
    assert_eq!(cells, serde_json::json!(["1", "0.5", "0.75", "0.5"]));
    assert!(browser.text(&tab, "#table-count").ends_with("rows differ"));
    // A frame's images are shown again.
    browser.press(&tab, "j");
    browser.settle(&tab);
    assert_eq!(browser.text(&tab, "#name"), "tiny");
    assert_eq!(browser.value(&tab, shown), serde_json::json!([true, true]));
    browser.press(&tab, "k");
    browser.settle(&tab);
    assert_eq!(browser.value(&tab, shown), serde_json::json!([false, false]));
    browser.press(&tab, "r");
    browser.value(&tab, "document.getElementById('reject-form').requestSubmit()");
    browser.wait(&tab, "document.getElementById('news').innerText.includes('rejected')");
    assert!(!project.folder().join(format!("golden/{case}.new.csv")).exists());
}
