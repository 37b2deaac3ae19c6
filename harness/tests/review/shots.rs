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
