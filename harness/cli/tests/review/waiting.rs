//! Tests that the server still replies if other clients are silent, announce a body that never arrives, or open
//! hundreds of connections.

use std::net::Shutdown;
use std::time::Duration;

use crate::project::{Answer, Project, Server, decision, tiny};

/// The hash of the pending frame from [`Project::put_tiny`].
fn pixels(project: &Project) -> String {
    karat::Image::read_exr(&project.pending("tiny")).expect("pending").0.hash()
}

/// A POST as Karat's page sends it, with a content length but without a body.
fn announced(server: &Server, length: &str) -> String {
    let (path, host) = (server.path(), server.host());
    format!(
        "POST {path}accept HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n\
         Content-Type: application/json\r\nContent-Length: {length}\r\n\r\n"
    )
}

#[test]
fn a_client_that_never_sends_its_body_blocks_no_other() {
    let project = Project::with_tiny();
    // The page gets 22 MB for this frame.
    let large = karat::Image::new(1024, 1024, vec![[0.1, 0.2, 0.3, 1.0]; 1 << 20]);
    project.put_pending("large", &large, |facts| facts["precision"] = "float".into());
    let server = project.serve();
    assert_eq!(server.get("").status, 200);
    let stranger = "POST /nothing HTTP/1.1\r\nHost: x\r\nContent-Length: 1000000\r\n\r\n";
    let mut refused = server.send(stranger);
    assert_eq!(Answer::of(&mut refused).status, 403, "it is told without its body");
    let _silent = ["", "G", "GET / HTTP/1.1\r\nHost: ", stranger, &announced(&server, "200")]
        .map(|begun| server.send(begun));
    // The client reads nothing of the reply, which is larger than the system's buffer.
    let (path, host) = (server.path(), server.host());
    let data = format!("GET {path}data/0.js HTTP/1.1\r\nHost: {host}\r\n\r\n");
    let _greedy = [(); 3].map(|()| server.send(&data));
    assert_eq!(server.get("").status, 200);
    let small = server.get("data/1.js");
    assert!(small.status == 200 && small.text.contains("\"tiny\""), "{small:?}");
    let (code, text) = server.interrupt();
    assert_eq!((code, text.as_str()), (Some(1), "2 frames left pending\n"));
}

/// The test opens 300 silent connections, more than the server keeps open.
#[test]
fn silent_connections_are_closed_for_new_requests() {
    let project = Project::with_tiny();
    let server = project.serve();
    let mut slow = server.send(&format!("GET {}", server.path()));
    let silent: Vec<_> = (0..300).map(|_| server.send("GET / HT")).collect();
    assert_eq!(server.get("").status, 200);
    assert_eq!(server.post("reject", &decision("tiny", &pixels(&project))).status, 200);
    let closed = std::io::Read::read(&mut slow, &mut [0; 64]);
    assert!(matches!(closed, Ok(0) | Err(_)), "the oldest goes first");
    drop(silent);
    assert_eq!(server.interrupt().0, Some(0));
}

#[test]
fn a_wrong_content_length_is_refused() {
    let project = Project::with_tiny();
    let server = project.serve();
    let huge = ["65537", "1000000000000000", "18446744073709551615", "99999999999999999999999"];
    for length in huge.into_iter().chain(["-1", "+1", "0x10", "", "1, 1", "1\r\nContent-Length: 2"])
    {
        let mut stream = server.send(&announced(&server, length));
        assert_eq!(Answer::of(&mut stream).status, 413, "{length}");
        drop(stream);
    }
    let chunked = announced(&server, "2\r\nTransfer-Encoding: chunked");
    assert_eq!(Answer::of(&mut server.send(&chunked)).status, 413);
    // The server reads nothing from strangers.
    for length in huge {
        let head = format!("POST / HTTP/1.1\r\nHost: x\r\nContent-Length: {length}\r\n\r\n");
        assert_eq!(Answer::of(&mut server.send(&head)).status, 403, "{length}");
    }
    // The client closes its connection before the end.
    let mut stream = server.send(&announced(&server, "200"));
    stream.shutdown(Shutdown::Write).expect("open");
    assert_eq!(Answer::of(&mut stream).status, 400);
    assert_eq!(server.get("").status, 200);
    assert!(project.pending("tiny").is_file());
}

#[test]
fn malformed_requests_have_an_error_status() {
    let project = Project::with_tiny();
    let server = project.serve();
    let long = "x".repeat(40_000);
    let many = "X: x\r\n".repeat(200);
    for (request, status) in [
        ("\0\r\n\r\n".to_owned(), 400),
        ("GET\r\n\r\n".to_owned(), 400),
        ("GET / HTTP/2.0\r\n\r\n".to_owned(), 400),
        (format!("GET /{long} HTTP/1.1\r\n\r\n"), 431),
        (format!("GET / HTTP/1.1\r\nX: {long}\r\n\r\n"), 431),
        (format!("GET / HTTP/1.1\r\n{many}\r\n"), 431),
    ] {
        let answer = Answer::of(&mut server.send(&request));
        assert_eq!(answer.status, status, "{}: {answer:?}", &request[..request.len().min(40)]);
    }
    let head = Answer::of(&mut server.send("HEAD / HTTP/1.1\r\nHost: x\r\n\r\n"));
    assert!(head.status == 403 && head.text.ends_with("\r\n\r\n"), "without a body: {head:?}");
    // A client that sends an unread megabyte still gets its reply.
    assert_eq!(server.raw("POST / HTTP/1.1\r\nHost: x", &"x".repeat(1 << 20)).status, 403);
    assert_eq!(server.get("").status, 200);
}

/// Of many concurrent decisions on a frame, the server carries out one, and refuses the others with a message.
#[test]
fn decisions_at_once_are_one_after_the_other() {
    let project = Project::with_tiny();
    let names: Vec<String> = (0..4).map(|index| format!("other{index}")).collect();
    names.iter().for_each(|name| project.put_tiny(name));
    let server = project.serve();
    let pixels = pixels(&project);
    let post = |place: &str, name: &str| server.post(place, &decision(name, &pixels)).status;
    let (mut same, others) = std::thread::scope(|scope| {
        let same = [(); 8].map(|()| scope.spawn(|| post("accept", "tiny")));
        let others: Vec<_> =
            names.iter().map(|name| scope.spawn(|| post("accept", name))).collect();
        let ended = |thread: std::thread::ScopedJoinHandle<'_, u16>| thread.join().expect("ended");
        (same.map(ended), others.into_iter().map(ended).collect::<Vec<_>>())
    });
    same.sort_unstable();
    assert_eq!(same, [200, 409, 409, 409, 409, 409, 409, 409]);
    assert_eq!(others, [200; 4]);
    let mut accepted = tiny();
    for pixel in accepted.pixels_mut() {
        pixel[..3].iter_mut().for_each(|value| *value *= 2.0);
    }
    for name in names.iter().map(String::as_str).chain(["tiny"]) {
        let (golden, _) = karat::Image::read_exr(&project.golden(name)).expect("a golden");
        assert_eq!(golden, accepted, "{name}");
    }
    assert_eq!(server.interrupt().0, Some(0));
}

/// If the server is stopped during a decision, the server completes the decision first, so that golden and provenance
/// are never half written. But the server doesn't wait for clients.
#[test]
fn a_decision_is_completed_before_the_end() {
    let project = Project::with_tiny();
    // Karat holds this lock during an acceptance, so each folder has one acceptance at a time.
    let folder = project.folder().join("golden").canonicalize().expect("a folder");
    let hash = blake3::hash(folder.as_os_str().as_encoded_bytes()).to_hex();
    let lock = std::env::temp_dir().join(format!("karat-{}.lock", &hash[..16]));
    let lock = std::fs::File::create(lock).expect("a file");
    lock.lock().expect("nobody else has it");
    let mut server = project.serve();
    let body = decision("tiny", &pixels(&project)).to_string();
    let _deciding = server.send(&format!("{}{body}", announced(&server, &body.len().to_string())));
    // After this time, the server's thread waits for the lock, even on a busy machine.
    std::thread::sleep(Duration::from_secs(2));
    server.signal();
    std::thread::sleep(Duration::from_millis(500));
    assert!(server.is_running() && project.pending("tiny").is_file());
    lock.unlock().expect("it was locked");
    let (code, text) = server.interrupt();
    assert_eq!((code, text.as_str()), (Some(0), "nothing is left pending\n"));
    let facts = std::fs::read_to_string(project.golden("tiny").with_extension("toml"));
    assert!(facts.expect("written").contains("because = \"why\""));
}
