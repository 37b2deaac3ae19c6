//! Draws pictures of each view at several sizes into `target/karat/review`, for people to look at. `cargo ci full` and
//! `cargo test --test review -- --ignored shots::` run these tests.

use std::path::Path;

use crate::browser::{Browser, Tab};
use crate::looking::{accept_values, left_values};
use crate::project::Project;

pub(crate) fn shoot(browser: &mut Browser, tab: &Tab, name: &str) {
    browser.settle(tab);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("../karat/review");
    browser.screen(tab, Some(&folder.join(format!("{name}.png"))));
}

#[test]
#[ignore = "pictures to be looked at: `cargo ci full` runs it"]
fn files_and_maps_are_drawn() {
    let project = Project::with_frames();
    let report = project.folder().join("report");
    let ran = project.karat(&["review", "--static"]).arg(&report).output().expect("it was built");
    assert!(ran.status.success(), "{ran:?}");
    let mut browser = Browser::start();
    let tab = browser.open(&format!("file://{}/index.html", report.display()));
    shoot(&mut browser, &tab, "files-1280");
    for key in ["j", "j"] {
        browser.press(&tab, key);
    }
    // Adds the map of another metric: half of the golden's red channel.
    browser.value(
        &tab,
        r#"(() => {
            const { data } = karat.state.cases[2];
            const { width, height, values } = data.parts[0].golden;
            const grey = values.map((value, i) => (i % 4 === 3 ? 1 : values[i - (i % 4)] / 2));
            data.maps.push({ name: "a map", about: "what its values are", range: [0, 1], scalar: true,
                image: { width, height, values: grey } });
            karat.change();
        })()"#,
    );
    for name in ["map-1280", "worst-exposure-1280", "other-map-1280"] {
        browser.press(&tab, "6");
        shoot(&mut browser, &tab, name);
    }
}

#[test]
#[ignore = "pictures to be looked at: `cargo ci full` runs it"]
fn every_view_is_drawn() {
    let project = Project::with_frames();
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    for (width, height) in [(1920, 1080), (1280, 720)] {
        browser.resize(&tab, width, height, 1.0);
        let views: [(&str, &[&str]); 11] = [
            ("diffuse-side", &["4"]),
            ("furnace-actual", &["j", "2"]),
            ("new", &["j", "j", "4"]),
            ("scene-side", &["k"]),
            ("scene-swipe", &["5", "m"]),
            ("scene-difference", &["3", "m", "m", "m"]),
            ("scene-false-colour", &["4", "f"]),
            ("scene-worst", &["f", "w", "t"]),
            ("scene-pixels", &["t", "z", "1"]),
            ("help", &["Z", "4", "?"]),
            ("accept", &["Escape", "a"]),
        ];
        for (name, keys) in views {
            for key in keys {
                browser.press(&tab, key);
            }
            shoot(&mut browser, &tab, &format!("{name}-{width}"));
        }
        for key in ["Escape", "k", "k"] {
            browser.press(&tab, key);
        }
    }
}

/// Draws the choices of the accept dialog, unusable files, and many frames.
#[test]
#[ignore = "pictures to be looked at: `cargo ci full` runs it"]
fn choices_faults_and_many_frames_are_drawn() {
    let project = Project::with_frames();
    let scene = karat::Image::read_exr(&project.pending("scene")).expect("pending").0;
    project.put_pending("scene", &scene, |facts| facts["adapter"]["path"] = "gl".into());
    std::fs::write(project.pending("broken"), b"no image").expect("written");
    for index in 1..=20 {
        project.put_tiny(&format!("rooms/exhibition-hall-{index}"));
        project.put_tiny(&format!("rooms/night/a-frame-whose-name-is-rather-long-{index}"));
    }
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&format!("{}#scene", server.url));
    browser.press(&tab, "a");
    shoot(&mut browser, &tab, "accept-profile-1280");
    browser.press(&tab, "Escape");
    browser.value(&tab, "location.hash = '#rooms/night/a-frame-whose-name-is-rather-long-12'");
    browser.wait(&tab, "document.getElementById('name').innerText.endsWith('12')");
    shoot(&mut browser, &tab, "many-1280");
    browser.press(&tab, "/");
    browser.write(&tab, "hall -1");
    shoot(&mut browser, &tab, "filter-1280");
    browser.press(&tab, "Escape");
    browser.value(&tab, "location.hash = '#golden/broken.new.exr'");
    browser.wait(&tab, "karat.state.selected === karat.state.cases.length - 1");
    shoot(&mut browser, &tab, "unusable-1280");
    browser.value(&tab, "location.hash = '#not here'");
    browser.wait(&tab, "karat.state.selected < 0");
    shoot(&mut browser, &tab, "absent-1280");
}

/// Draws the page at usual widths, dark and light, and with touch.
#[test]
#[ignore = "pictures to be looked at: `cargo ci full` runs it"]
fn every_width_is_drawn() {
    let project = Project::with_frames();
    let mut scene = karat::Image::read_exr(&project.golden("scene")).expect("a golden").0;
    let width = scene.width() as usize;
    for (x, y) in [(40, 300), (41, 300), (500, 40), (320, 200)] {
        scene.pixels_mut()[y * width + x][1] += 4.0;
    }
    project.put_golden(
        "corners/few",
        &karat::Image::read_exr(&project.golden("scene")).expect("a golden").0,
    );
    project.put_pending("corners/few", &scene, |_| {});
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    browser.wait(&tab, "karat.state.cases.every(({ thumb }) => thumb)");
    for (width, height) in [(1400, 900), (1000, 700), (700, 900)] {
        browser.resize(&tab, width, height, 1.0);
        for (name, keys) in [
            ("side", &["4"][..]),
            ("few", &["j", "j", "j", "2"]),
            ("few-values", &["w"]),
            ("noise-difference", &["k", "k", "k", "3"]),
            ("nan-difference", &["j"]),
            ("scene-by-channel", &["j", "d", "o"]),
            ("scene-absolute", &["d"]),
            ("sheet", &["d", "o", "s"]),
            ("accept-several", &["s", "y", "k", "y", "a"]),
        ] {
            for key in keys {
                browser.press(&tab, key);
            }
            shoot(&mut browser, &tab, &format!("edition-{name}-{width}"));
        }
        for key in ["Escape", "Escape", "Escape", "k", "k", "k"] {
            browser.press(&tab, key);
        }
        browser.prefer_dark(&tab, false);
        shoot(&mut browser, &tab, &format!("edition-light-{width}"));
        browser.prefer_dark(&tab, true);
    }
    browser.touch(&tab, 700, 900);
    browser.press(&tab, "4");
    shoot(&mut browser, &tab, "edition-touch-700");
    browser.touch(&tab, 390, 844);
    shoot(&mut browser, &tab, "edition-touch-390");
    browser.press(&tab, "3");
    browser.click(&tab, "#tools-more");
    shoot(&mut browser, &tab, "edition-touch-unfolded-390");
    browser.click(&tab, "#tools-more");
    browser.press(&tab, "s");
    shoot(&mut browser, &tab, "edition-touch-sheet-390");
    browser.press(&tab, "s");
    browser.prefer_dark(&tab, false);
    browser.value(&tab, "document.querySelector('aside').scrollIntoView()");
    shoot(&mut browser, &tab, "edition-touch-below-390");
}

/// Draws the page's view of a frame's origin, for a repository with a record, goldens, and functions that fail.
#[test]
#[ignore = "pictures to be looked at: `cargo ci full` runs it"]
fn origins_are_drawn() {
    let project = Project::with_frames();
    crate::sourcing::with_origins(&project);
    let case = "sun_by_angle";
    left_values(&project, case, "0.5");
    accept_values(&project, case);
    let server = project.serve_with(&["--all-goldens"]);
    let mut browser = Browser::start();
    let tab = browser.open(&format!("{}#{case}", server.url));
    browser.prefer_dark(&tab, true);
    shoot(&mut browser, &tab, "table-1280");
    browser.resize(&tab, 390, 844, 1.0);
    shoot(&mut browser, &tab, "table-390");
    browser.resize(&tab, 1400, 900, 1.0);
    browser.value(&tab, "location.hash = '#scene'");
    browser.wait(&tab, "document.getElementById('name').innerText === 'scene'");
    browser.wait(&tab, "karat.state.cases.every(entry => entry.thumb || entry.table || entry.status === 'function')");
    let older = "document.querySelectorAll('#versions .version')";
    browser.wait(&tab, &format!("{older}.length === 1"));
    browser.value(&tab, &format!("{older}[0].click()"));
    browser.wait(&tab, "karat.state.part > 0");
    browser.value(&tab, "document.getElementById('versions').scrollIntoView()");
    shoot(&mut browser, &tab, "version-1400");
    browser.press(&tab, "3");
    shoot(&mut browser, &tab, "version-difference-1400");
    browser.press(&tab, "4");
    browser.value(&tab, &format!("{older}[0].click()"));
    browser.wait(&tab, "karat.state.part === 0");
    // This picture is `docs/guide/review.png`.
    browser.resize(&tab, 1280, 800, 1.0);
    browser.value(&tab, "document.querySelector('#modules details').open = true");
    browser.value(&tab, "document.getElementById('judged').scrollIntoView()");
    shoot(&mut browser, &tab, "guide-1280");
    for (width, height) in [(1400, 900), (700, 900)] {
        browser.resize(&tab, width, height, 1.0);
        for name in ["scene", "lobe::ggx%20agrees_with", "environment"] {
            browser.value(&tab, &format!("location.hash = '#{name}'"));
            browser.wait(
                &tab,
                &format!(
                    "document.getElementById('name').innerText === decodeURIComponent('{name}')"
                ),
            );
            browser.settle(&tab);
            browser.value(
                &tab,
                "document.querySelectorAll('#modules details').forEach(d => { d.open = true; })",
            );
            let file = name.split([':', '%']).next().expect("a name");
            shoot(&mut browser, &tab, &format!("origin-{file}-{width}"));
            let aside = "document.querySelector('#versions:not([hidden]), #test').scrollIntoView()";
            browser.value(&tab, aside);
            // The page loads versions of the history when they become visible.
            browser.wait(&tab, "[...document.querySelectorAll('#versions .version')].every(version => version.querySelector('canvas'))");
            shoot(&mut browser, &tab, &format!("origin-{file}-below-{width}"));
            browser.value(&tab, "document.querySelector('header').scrollIntoView()");
            browser.value(&tab, "document.querySelector('aside').scrollTop = 0");
        }
    }
}
