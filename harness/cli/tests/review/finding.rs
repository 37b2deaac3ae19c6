//! Tests the list of many frames: its order, its filter, and links to a frame.

use serde_json::{Value, json};

use crate::browser::{Browser, Tab};
use crate::project::{Project, Server};

fn with(names: &[&str]) -> Project {
    let project = Project::new();
    names.iter().for_each(|name| project.put_tiny(name));
    project
}

fn open(project: &Project, fragment: &str) -> (Server, Browser, Tab) {
    let server = project.serve();
    let mut browser = Browser::start();
    let tab = browser.open(&format!("{}{fragment}", server.url));
    browser.settle(&tab);
    (server, browser, tab)
}

fn list(browser: &mut Browser, tab: &Tab) -> Value {
    browser.settle(tab);
    browser.value(
        tab,
        "[...document.querySelectorAll('#cases .folder, #cases .name')].map(row => row.innerText)",
    )
}

#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn numbers_are_ordered_by_value_and_folders_have_their_frames() {
    let names = ["f10", "f2", "f1", "f100", "a/f10", "a/f9", "a/b/f1", "a-b/f1", "a1", "f02"];
    let project = with(&names);
    let (_server, mut browser, tab) = open(&project, "");
    let expected =
        ["a1", "f1", "f02", "f2", "f10", "f100", "a-b/", "f1", "a/", "f9", "f10", "a/b/", "f1"];
    assert_eq!(list(&mut browser, &tab), json!(expected));
    assert_eq!(browser.text(&tab, "#name"), "a1", "the first on the list is shown first");
    for name in ["f1", "f02", "f2", "f10", "f100", "a-b/f1", "a/f9"] {
        browser.press(&tab, "j");
        assert_eq!(browser.text(&tab, "#name"), name);
        assert_eq!(browser.value(&tab, "karat.state.cases[karat.state.selected].data.name"), name);
    }
    assert_eq!(browser.value(&tab, "document.getElementById('find').hidden"), true, "they are few");
}

#[test]
#[ignore = "seconds of a browser: `cargo ci full` runs it"]
fn the_filter_lists_only_frames_that_contain_all_of_its_words() {
    let names: Vec<String> = (1..=12).map(|index| format!("room/f{index}")).collect();
    let mut names: Vec<&str> = names.iter().map(String::as_str).collect();
    names.extend(["Lamp", "room/lamp"]);
    let project = with(&names);
    let (_server, mut browser, tab) = open(&project, "");
    browser.press(&tab, "/");
    assert_eq!(browser.value(&tab, "document.activeElement.id"), "filter");
    browser.write(&tab, "lamp");
    assert_eq!(list(&mut browser, &tab), json!(["Lamp", "room/", "lamp"]));
    assert_eq!(browser.text(&tab, "#found"), "2 of 14");
    browser.write(&tab, " ROO");
    assert_eq!(list(&mut browser, &tab), json!(["room/", "lamp"]));
    assert_eq!(browser.text(&tab, "#name"), "Lamp", "what is looked at stays");
    browser.press(&tab, "Enter");
    assert_eq!(browser.text(&tab, "#name"), "room/lamp", "the first that is left");
    browser.press(&tab, "/");
    browser.write(&tab, "nothing has this");
    assert_eq!(list(&mut browser, &tab), json!([]));
    assert_eq!(browser.text(&tab, "#none-found"), "No name contains all of these words.");
    browser.press(&tab, "Escape");
    assert_eq!(
        browser.value(&tab, "[karat.state.filter, document.activeElement.id]"),
        json!(["", ""])
    );

    // Keys and decisions use only the filtered frames.
    browser.press(&tab, "/");
    browser.write(&tab, "f1");
    browser.press(&tab, "Enter");
    for name in ["room/f10", "room/f11", "room/f12", "room/f12"] {
        browser.press(&tab, "j");
        assert_eq!(browser.text(&tab, "#name"), name);
    }
    for name in ["room/f11", "room/f10", "room/f1", "room/f1"] {
        browser.press(&tab, "k");
        assert_eq!(browser.text(&tab, "#name"), name);
    }
    browser.press(&tab, "r");
    browser.press(&tab, "Tab");
    browser.press(&tab, "Enter");
    browser.wait(&tab, "document.getElementById('name').textContent === 'room/f10'");
    assert!(!project.pending("room/f1").exists() && project.pending("room/f2").is_file());
    browser.press(&tab, "Escape");
    assert_eq!(browser.value(&tab, "karat.state.filter"), "", "all are listed again");
}

#[test]
fn the_address_names_the_frame() {
    let project = with(&["a", "rooms/dark", "z"]);
    let (_server, mut browser, tab) = open(&project, "#rooms%2Fdark");
    assert_eq!(browser.text(&tab, "#name"), "rooms/dark");
    let before = browser.value(&tab, "history.length");
    browser.press(&tab, "k");
    browser.wait(&tab, "location.hash === '#z'");
    browser.press(&tab, "j");
    browser.wait(&tab, "location.hash === '#rooms/dark'");
    assert_eq!(browser.value(&tab, "history.length"), before, "going back leaves the page");
    browser.value(&tab, "location.hash = '#a'");
    browser.wait(&tab, "document.getElementById('name').textContent === 'a'");
}

/// The page updates its URL a moment after a key press. If a person edits the URL in that moment, the page keeps the
/// person's URL.
#[test]
fn a_typed_address_is_never_written_over() {
    let project = with(&["a", "rooms/dark", "z"]);
    let (_server, mut browser, tab) = open(&project, "#a");
    browser.press(&tab, "j");
    browser.value(
        &tab,
        "(() => {
            // Both timers are due when the loop ends: this timer runs first, then the page's timer, then the event.
            setTimeout(() => { location.hash = '#rooms/dark'; }, 0);
            const end = performance.now() + 600; // longer than the page waits
            while (performance.now() < end);
        })()",
    );
    browser.wait(&tab, "document.getElementById('name').textContent === 'rooms/dark'");
    assert_eq!(browser.value(&tab, "location.hash"), "#rooms/dark");
}

#[test]
fn an_address_of_an_unknown_frame_is_reported() {
    let project = with(&["a", "b"]);
    let (_server, mut browser, tab) = open(&project, "#rooms/gone%");
    let message = browser.text(&tab, "#message");
    assert!(
        message.starts_with("`rooms/gone%` isn't pending: it was accepted or rejected"),
        "{message}"
    );
    assert_eq!(browser.text(&tab, "#name"), "", "no other takes its place");
    for id in ["accept", "reject"] {
        let disabled = format!("document.getElementById('{id}').disabled");
        assert_eq!(browser.value(&tab, &disabled), true, "{id}");
    }
    browser.press(&tab, "a");
    assert_eq!(browser.value(&tab, "document.querySelector('dialog[open]') === null"), true);
    browser.press(&tab, "j");
    assert_eq!(browser.text(&tab, "#name"), "a");
    assert_eq!(browser.value(&tab, "document.getElementById('message').hidden"), true);
    browser.wait(&tab, "location.hash === '#a'");
}

#[test]
fn links_lead_into_a_page_of_files() {
    let project = with(&["a", "rooms/dark"]);
    let report = project.folder().join("report");
    let ran = project.karat(&["review", "--static"]).arg(&report).output().expect("it was built");
    assert!(ran.status.success(), "{ran:?}");
    let mut browser = Browser::start();
    let page = format!("file://{}/index.html", report.display());
    let tab = browser.open(&format!("{page}#rooms/dark"));
    browser.settle(&tab);
    assert_eq!(browser.text(&tab, "#name"), "rooms/dark");
    assert!(browser.text(&tab, "#accept-command").starts_with("karat accept rooms/dark "));
    browser.press(&tab, "k");
    browser.wait(&tab, "location.hash === '#a'");
    let tab = browser.open(&format!("{page}#rooms/bright"));
    browser.settle(&tab);
    let message = browser.text(&tab, "#message");
    assert!(message.contains("`rooms/bright`"), "{message}");
    assert_eq!(browser.value(&tab, "document.getElementById('typed').hidden"), true);
}
