//! Tests the server without a browser: the server refuses requests that don't come from its own page. Refused requests
//! don't change files, and neither do GET requests.

use serde_json::json;

use crate::project::{Project, Server, decision, tiny};

/// Returns the hash of the tiny pending frame's pixels.
fn bright() -> String {
    let mut image = tiny();
    for pixel in image.pixels_mut() {
        pixel[..3].iter_mut().for_each(|value| *value *= 2.0);
    }
    image.hash()
}

#[test]
fn requests_without_the_secret_url_are_refused() {
    let project = Project::with_tiny();
    let server = project.serve();
    assert_eq!(server.get("").status, 200);
    let (host, path) = (server.host(), server.path());
    let status = |head: &str| server.raw(head, "").status;
    for wrong in ["/", "/00000000000000000000000000000000/", "/favicon.ico", "//", "/.."] {
        assert_eq!(status(&format!("GET {wrong} HTTP/1.1\r\nHost: {host}")), 403, "{wrong}");
    }
    let shorter = &path[..path.len() - 2];
    assert_eq!(status(&format!("GET {shorter}/ HTTP/1.1\r\nHost: {host}")), 403);
    for foreign in ["evil.example", "127.0.0.1", "127.0.0.1:1", &format!("x.{host}")] {
        assert_eq!(status(&format!("GET {path} HTTP/1.1\r\nHost: {foreign}")), 403, "{foreign}");
    }
    assert_eq!(status(&format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nHost: evil.example")), 403);
    assert_eq!(status(&format!("GET {path} HTTP/1.0\r\nX-Nothing: x")), 403);
    let foreign = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://evil.example");
    assert_eq!(status(&foreign), 403);
    let policy = server.get("").text;
    assert!(policy.contains("default-src 'none'"), "{policy}");
    assert!(policy.contains("frame-ancestors 'none'"), "{policy}");
    let framed = project.serve_with(&["--in-editor"]).get("").text;
    let own =
        "frame-ancestors vscode-file: vscode-webview: http://127.0.0.1:* http://localhost:*\r\n";
    assert!(framed.contains(own), "{framed}");
    assert!(policy.contains("Cross-Origin-Resource-Policy: same-origin"), "{policy}");
}

#[test]
fn other_origins_cannot_decide() {
    let project = Project::with_tiny();
    let server = project.serve();
    let (host, path) = (server.host(), server.path());
    let body = decision("tiny", &bright()).to_string();
    let post = |path: &str, origin: &str, kind: &str| {
        let head = format!("POST {path}accept HTTP/1.1\r\nHost: {host}{origin}{kind}");
        server.raw(&head, &body).status
    };
    let ours = format!("\r\nOrigin: http://{host}");
    let json = "\r\nContent-Type: application/json";
    assert_eq!(post(&path, "", json), 403, "no origin");
    assert_eq!(post(&path, "\r\nOrigin: null", json), 403);
    assert_eq!(post(&path, "\r\nOrigin: http://evil.example", json), 403);
    assert_eq!(post(&path, &format!("\r\nOrigin: https://{host}"), json), 403);
    assert_eq!(post("/00000000000000000000000000000000/", &ours, json), 403);
    assert_eq!(post(&path, &ours, "\r\nContent-Type: text/plain"), 415, "a form could send it");
    assert!(project.pending("tiny").is_file());
    assert_eq!(post(&path, &ours, json), 200, "the same request from our page");
    assert!(!project.pending("tiny").exists());
}

/// All files of the goldens' folder with their content.
fn snapshot(project: &Project) -> Vec<(String, Vec<u8>)> {
    let entries = std::fs::read_dir(project.folder().join("golden")).expect("a folder");
    let mut files: Vec<_> = entries
        .map(|entry| entry.expect("an entry").path())
        .map(|path| (path.display().to_string(), std::fs::read(&path).expect("a file")))
        .collect();
    files.sort();
    files
}

fn refused(server: &Server, place: &str, body: &serde_json::Value) -> String {
    let answer = server.post(place, body);
    assert!((400..500).contains(&answer.status), "{body}: {answer:?}");
    answer.text
}

#[test]
fn refused_requests_and_file_paths_as_names_change_no_file() {
    let project = Project::with_tiny();
    let outside = project.folder().join("outside.new.exr");
    std::fs::copy(project.pending("tiny"), &outside).expect("copied");
    let before = snapshot(&project);
    let server = project.serve();
    let places = ["", "accept", "reject", "data/0.js", "accept?case=tiny", "reject?case=tiny"];
    for place in places.into_iter().chain(["data/../../golden/tiny.exr", "golden/tiny.exr"]) {
        let answer = server.get(place);
        let page = ["", "data/0.js"].contains(&place);
        assert_eq!(answer.status == 200, page, "{place}: {}", answer.status);
    }
    for number in ["1", "-1", "0x0", "00000000000000000000000000", "%2e%2e"] {
        let answer = server.get(&format!("data/{number}.js"));
        assert!(answer.status == 404 || number.starts_with("00"), "{number}: {}", answer.status);
    }
    for name in ["../outside", "..\\outside", "/etc/passwd", "*", "tin?", "", "tiny.new", "Tiny"] {
        for place in ["accept", "reject"] {
            let text = refused(&server, place, &decision(name, &bright()));
            assert!(text.contains("isn't pending"), "{text}");
        }
    }
    refused(&server, "accept", &json!({ "case": "tiny" }));
    refused(&server, "accept", &json!({ "case": ["tiny"], "pixels": 1 }));
    let extra = json!({ "case": "tiny", "pixels": bright(), "because": "x", "path": "/tmp" });
    refused(&server, "accept", &extra);
    let long = decision("tiny", &"x".repeat(100_000));
    assert_eq!(server.post("accept", &long).status, 413);
    let text = refused(&server, "accept", &decision("tiny", "another frame"));
    assert!(text.contains("was rendered again after this page loaded"), "{text}");
    assert_eq!(before, snapshot(&project));
    assert!(outside.is_file());
}

#[test]
fn a_pending_file_that_names_another_place_is_refused() {
    let project = Project::with_tiny();
    let golden = tiny();
    project.put_pending("other", &golden, |facts| facts["case"] = "../outside".into());
    let server = project.serve();
    let page = server.get("").text;
    assert!(page.contains("says that the file is frame `../outside`"), "{page}");
    for name in ["../outside", "other"] {
        let text = refused(&server, "accept", &decision(name, &golden.hash()));
        assert!(text.contains("isn't pending"), "{text}");
    }
}

#[test]
fn the_exit_code_is_one_while_frames_are_pending() {
    let project = Project::with_tiny();
    let (code, text) = project.serve().interrupt();
    assert_eq!((code, text.as_str()), (Some(1), "1 frame left pending\n"));

    let server = project.serve();
    let answer = server.post("reject", &decision("tiny", &bright()));
    assert_eq!(answer.status, 200, "{answer:?}");
    assert!(!project.pending("tiny").exists() && project.golden("tiny").is_file());
    let (code, text) = server.interrupt();
    assert_eq!((code, text.as_str()), (Some(0), "nothing is left pending\n"));

    let ran = project.karat(&["review"]).output().expect("it was built");
    assert_eq!((ran.status.code(), ran.stdout.as_slice()), (Some(0), &b"nothing is pending\n"[..]));
    let ran = project.karat(&["review", "--goldens", "nowhere"]).output().expect("it was built");
    assert_eq!(ran.status.code(), Some(2));
    let help = project.karat(&["review", "--help"]).output().expect("it was built");
    let help = String::from_utf8_lossy(&help.stdout).into_owned();
    assert!(help.contains("karat review --static report") && help.contains("Exit codes"), "{help}");
    assert!(
        help.contains("/ filters the frames") && help.contains("the page opens at this frame"),
        "{help}"
    );
}

#[test]
fn a_port_that_is_taken_is_an_error_that_names_it() {
    let project = Project::with_tiny();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = taken.local_addr().expect("an address").port().to_string();
    let ran = project.karat(&["review", "--port", &port]).output().expect("it was built");
    let error = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert_eq!(ran.status.code(), Some(2), "{error}");
    assert!(error.contains(&format!("can't serve the review on 127.0.0.1:{port}")), "{error}");
}
