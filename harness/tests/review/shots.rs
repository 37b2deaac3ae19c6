//! Pictures of each view at both sizes, in `target/karat/review`, to be looked at.

use std::path::Path;

use crate::browser::{Browser, Tab};
use crate::project::Project;

fn shoot(browser: &mut Browser, tab: &Tab, name: &str) {
    browser.settle(tab);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("../karat/review");
    browser.screen(tab, Some(&folder.join(format!("{name}.png"))));
}

#[test]
fn files_and_maps_are_drawn() {
    let project = Project::with_frames();
    let report = project.folder().join("report");
    let ran = project.karat(&["review", "--static"]).arg(&report).output().expect("it was built");
    assert!(ran.status.success(), "{ran:?}");
    let mut browser = Browser::start();
    let tab = browser.open(&format!("file://{}/index.html", report.display()));
    shoot(&mut browser, &tab, "files-1280");
    for key in ["j", "j", "j"] {
        browser.press(&tab, key);
    }
    // A map as another metric would hand it over: here, half of the golden's red channel.
    browser.value(
        &tab,
        r#"(() => {
            const { data } = karat.state.cases[3];
            const { width, height, values } = data.parts[0].golden;
            const grey = values.map((value, i) => (i % 4 === 3 ? 1 : values[i - (i % 4)] / 2));
            data.maps.push({ name: "a map", about: "what its values are", full: 1, scalar: true,
                image: { width, height, values: grey } });
            karat.change();
        })()"#,
    );
    browser.press(&tab, "6");
    shoot(&mut browser, &tab, "map-1280");
}

#[test]
fn every_view_is_drawn() {
    let project = Project::with_frames();
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&server.url);
    for (width, height) in [(1280, 720), (1920, 1080)] {
        browser.resize(&tab, width, height, 1.0);
        let views: [(&str, &[&str]); 11] = [
            ("diffuse-side", &["4"]),
            ("furnace-actual", &["j", "2"]),
            ("new", &["j", "4"]),
            ("scene-side", &["j"]),
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
        for key in ["Escape", "k", "k", "k"] {
            browser.press(&tab, key);
        }
    }
}
