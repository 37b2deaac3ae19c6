//! Tests the trace of a pixel in the page.

use karat::Image;

use crate::browser::Browser;
use crate::project::Project;

const SHADER: &str = "@fragment
fn shade(@location(0) uv: vec2f) -> @location(0) vec4f {
    let near = 1.0 - uv.x;
    let broken = sqrt(uv.y - 0.5);
    return vec4f(near, near * near, broken, 1.0);
}
";

/// A project with a frame of 4 x 4 pixels. Its golden is white.
fn project() -> Project {
    let project = Project::new();
    project.put("shaders/m.wgsl", SHADER);
    let frame = "[[frame]]\nname = \"disc\"\nfragment = \"shade\"\nsize = [4, 4]\n";
    project.put("shaders/m.test.toml", frame);
    let golden = Image::new(4, 4, vec![[1.0; 4]; 16]);
    project.put_golden("disc", &golden);
    let mut actual = golden;
    actual.pixels_mut()[5] = [0.5, 0.25, 0.0, 1.0];
    project.put_pending("disc", &actual, |_| {});
    project.put_tiny("gone");
    project
}

/// A page that was written to files has no server to trace pixels. So the page contains and lists the traces of the
/// pixels that differ most.
#[test]
fn a_page_of_files_has_the_pixels_that_differ_most() {
    let project = project();
    let report = project.folder().join("report");
    let ran = project.karat(&["review", "--static"]).arg(&report).output().expect("it was built");
    assert_eq!(ran.status.code(), Some(0), "{ran:?}");
    let mut browser = Browser::start();
    let tab = browser.open(&format!("file://{}/index.html#disc", report.display()));
    browser.settle(&tab);
    browser.wait(&tab, "document.getElementById('told').options.length === 2");
    assert!(browser.text(&tab, "#told").contains("pixel (1, 1)"));
    browser.value(&tab, "karat.change({ pinned: [0, 3] })");
    browser.settle(&tab);
    browser.click(&tab, "#trace");
    let said = "document.getElementById('pixel-state').innerText.includes('the steps of (1, 1)')";
    browser.wait(&tab, said);
    let choose = "(() => { const told = document.getElementById('told'); told.value = '1,1'; \
                  told.dispatchEvent(new Event('change')); })()";
    browser.value(&tab, choose);
    browser.wait(&tab, "document.getElementById('steps').innerText.includes('shade at (1, 1)')");
    assert!(browser.text(&tab, "#steps").contains("near = 1.0 - uv.x"));
    // A frame that no shader draws has no steps.
    browser.press(&tab, "j");
    browser.wait(&tab, "document.getElementById('pixel').hidden");
}

// Lesson 39
#[test]
fn a_click_on_a_pixel_shows_its_steps_and_values_become_maps() {
    let project = project();
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&format!("{}#disc", server.url));
    browser.settle(&tab);
    // A click traces a pixel that doesn't differ.
    browser.value(&tab, "karat.change({ pinned: [0, 3] })");
    browser.settle(&tab);
    assert_eq!(browser.text(&tab, "#steps"), "");
    browser.click(&tab, "#trace");
    browser.wait(&tab, "document.getElementById('steps').innerText.includes('(0, 3)')");
    browser.value(&tab, "karat.change({ pinned: [1, 1] })");
    browser.wait(&tab, "document.getElementById('steps').innerText.includes('shade at (1, 1)')");
    let steps = browser.text(&tab, "#steps");
    for part in [
        "uv = (0.375, 0.375)",
        "m.wgsl:3",
        "near = 1.0 - uv.x",
        "0.625",
        "the driver drew (0.625, 0.390625, ",
    ] {
        assert!(steps.contains(part), "no `{part}` in {steps}");
    }
    let strange = "document.querySelector('#steps .strange')?.innerText ?? ''";
    assert!(browser.value(&tab, strange).as_str().is_some_and(|row| row.contains("NaN")));

    browser.wait(&tab, "document.getElementById('told').options.length === 4");
    let choose = |value: &str| {
        format!("(() => {{ told.value = '{value}'; told.dispatchEvent(new Event('change')); }})()")
            .replace("told", "document.getElementById('told')")
    };
    browser.value(&tab, &choose("m::shade::near"));
    browser.wait(&tab, "karat.state.view === 'map'");
    browser.settle(&tab);
    let map = "karat.loaded().maps[karat.state.map]";
    assert_eq!(browser.value(&tab, &format!("{map}.name")), "m::shade::near");
    assert_eq!(browser.value(&tab, &format!("[...{map}.image.values].slice(0, 4)"))[0], 0.875);
    assert_eq!(browser.value(&tab, &format!("{map}.range")), serde_json::json!([0.125, 0.875]));
    assert!(browser.text(&tab, "#map-about").contains("0.125 at (3, 0) to 0.875 at (0, 0)"));
    assert!(browser.text(&tab, "#map-value").contains("0.625"), "the pinned pixel's");
    // A second click on the same value shows the same map.
    let count = browser.value(&tab, "karat.loaded().maps.length");
    browser.value(&tab, &choose("m::shade::broken"));
    browser.wait(&tab, &format!("{map}.name === 'm::shade::broken'"));
    browser.value(&tab, &choose("m::shade::near"));
    browser.wait(&tab, &format!("{map}.name === 'm::shade::near'"));
    assert_eq!(
        browser.value(&tab, "karat.loaded().maps.length"),
        count.as_i64().expect("a count") + 1
    );
    browser
        .screen(&tab, Some(&std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("pixels.png")));

    // In the golden's commit, the shader was different.
    project.commit("first");
    project.put("shaders/m.wgsl", &SHADER.replace("near * near", "near * uv.y"));
    let tab = browser.open(&format!("{}#disc", server.url));
    browser.settle(&tab);
    browser.value(&tab, "karat.change({ pinned: [1, 1] })");
    browser.wait(
        &tab,
        "document.getElementById('steps').innerText.includes('the first step that differs')",
    );
    let steps = browser.text(&tab, "#steps");
    assert!(steps.contains("was near * near: 0.390625"), "{steps}");
    assert!(browser.text(&tab, "#steps .parted").contains("near * uv.y"), "{steps}");

    // If no test declares a frame for the golden, the page says so.
    browser.press(&tab, "j");
    browser.wait(
        &tab,
        "document.getElementById('pixel-state').innerText.includes('there is no frame `gone`')",
    );
}
