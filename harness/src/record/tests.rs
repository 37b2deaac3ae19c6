use super::*;

fn record(time: Option<Time>) -> Record {
    let subject =
        Subject::Frame { golden: String::new(), folder: String::new(), location: String::new() };
    Record {
        schema: SCHEMA,
        test: "t".to_owned(),
        cargo_package: String::new(),
        subject,
        verdict: Verdict::Pass,
        paths: Vec::new(),
        message: None,
        watched: None,
        details: None,
        overlay: None,
        read: Vec::new(),
        time,
    }
}

#[test]
fn records_have_a_time_or_none() {
    for time in [None, Some(Stopwatch::start().time())] {
        let line = serde_json::to_string(&record(time.clone())).expect("plain data");
        assert_eq!(line.contains(r#""seconds":"#), time.is_some(), "{line}");
        let read: Record = serde_json::from_str(&line).expect("a record");
        assert_eq!(read, record(time));
    }
}

/// Writes a record with one verdict in the folder of a run.
fn written(running: &Running, test: &str) -> PathBuf {
    let line = serde_json::to_string(&Record { test: test.into(), ..record(None) });
    std::fs::write(running.folder().join("1.jsonl"), line.expect("plain data")).expect("written");
    let run = Run { selected: vec![test.into()], ..Run::default() };
    run.write(running.folder()).expect("written");
    running.folder().to_owned()
}

fn last(folder: &Path) -> Option<String> {
    let Recorded { records, run, .. } = Recorded::read(folder).expect("readable")?;
    let run = run.expect("it says how it was made");
    assert_eq!((records.len(), &run.selected), (1, &vec![records[0].test.clone()]));
    Some(records[0].test.clone())
}

// Lesson 58
#[test]
fn the_last_run_that_ended_is_read() {
    let temporary = tempfile::tempdir().expect("a temporary folder");
    let folder = &temporary.path().join("record");
    assert_eq!(last(folder), None);
    let [a, b, c] = [(); 3].map(|()| Running::begin(folder).expect("a folder"));
    let folders = [written(&a, "a"), written(&b, "b"), written(&c, "c")];
    assert_eq!(last(folder), None, "none has ended");
    assert!(read(folder).expect("readable").is_empty());
    b.end().expect("ended");
    assert_eq!(last(folder).as_deref(), Some("b"));
    drop(a);
    assert_eq!(folders.each_ref().map(|folder| folder.exists()), [false, true, true]);
    c.end().expect("ended");
    assert_eq!(last(folder).as_deref(), Some("c"));
    assert_eq!(folders.each_ref().map(|folder| folder.exists()), [false, false, true]);
}

// Lesson 58
#[test]
fn leftovers_of_a_killed_run_are_removed_and_a_live_run_is_kept() {
    let temporary = tempfile::tempdir().expect("a temporary folder");
    let folder = temporary.path();
    let live = Running::begin(folder).expect("a folder");
    written(&live, "live");
    // No process locks `run-1-0`. Tests that outlived their run created `run-1-1` again.
    let [held, bare, foreign] = ["run-1-0", "run-1-1", "mine"].map(|name| folder.join(name));
    for folder in [&held, &bare, &foreign] {
        std::fs::create_dir(folder).expect("a folder");
    }
    std::fs::write(held.join("running"), "").expect("written");
    let next = Running::begin(folder).expect("a folder");
    assert!(!held.exists() && !bare.exists() && foreign.exists());
    assert!(live.folder().join("1.jsonl").exists());
    written(&next, "next");
    next.end().expect("ended");
    live.end().expect("its folder is there");
    assert_eq!(last(folder).as_deref(), Some("live"));
}

/// If the user sets KARAT_RECORD and runs `cargo test`, the folder has records, but no folders of runs.
#[test]
fn a_folder_without_runs_is_a_record_itself() {
    let temporary = tempfile::tempdir().expect("a temporary folder");
    let line = serde_json::to_string(&record(None)).expect("plain data");
    std::fs::write(temporary.path().join("1.jsonl"), line).expect("written");
    assert_eq!(read(temporary.path()).expect("readable").len(), 1);
    // Karat ignores a name that isn't the name of a run's folder.
    for name in ["../elsewhere", "run-1/../..", "run-", ""] {
        std::fs::write(temporary.path().join("last"), name).expect("written");
        assert_eq!(read(temporary.path()).expect("readable").len(), 1, "{name}");
    }
    let missing = read(&temporary.path().join("nowhere")).expect_err("no folder");
    assert!(missing.to_string().starts_with("can't read the record `"), "{missing}");
}

#[test]
fn a_stopwatch_measures() {
    let stopwatch = Stopwatch::start();
    std::thread::sleep(std::time::Duration::from_millis(20));
    let time = stopwatch.time();
    assert!(time.seconds >= 0.02, "{time:?}");
    let started = humantime::parse_rfc3339(&time.started).expect("RFC 3339");
    assert!(started <= SystemTime::now(), "{time:?}");
}

/// Karat refuses records of another version. The error names the file and the line.
#[test]
fn another_version_is_refused() {
    let temporary = tempfile::tempdir().expect("a temporary folder");
    let folder = temporary.path();
    let line = |schema: u32| {
        serde_json::to_string(&Record { schema, ..record(None) }).expect("plain data") + "\n"
    };
    let wrong = |part: &str| {
        let error = Recorded::read(folder).expect_err("another version").to_string();
        assert!(error.contains(part) && error.contains("it has version"), "{error}");
    };
    std::fs::write(folder.join("1.jsonl"), line(SCHEMA) + &line(SCHEMA - 1)).expect("written");
    wrong("1.jsonl` line 2");
    std::fs::write(folder.join("1.jsonl"), line(SCHEMA) + &line(SCHEMA)).expect("written");
    assert_eq!(read(folder).expect("readable").len(), 2);
    Run { schema: SCHEMA - 1, ..Run::default() }.write(folder).expect("written");
    wrong("run.json` line 1");
}

#[test]
fn allowances_add_up() {
    let part = |wider, worst, unbounded| Allowance { cases: 10, wider, worst, unbounded };
    let sum = part(1, Some(2.0), 3).merge(part(4, Some(0.5), 5));
    assert_eq!(sum, Allowance { cases: 20, wider: 5, worst: Some(2.0), unbounded: 8 });
    assert_eq!(
        part(1, Some(2.0), 0).merge(part(0, None, 0)).worst,
        None,
        "one of them is no number"
    );
}

#[test]
fn tests_whose_frames_were_left_out_are_known() {
    let temporary = tempfile::tempdir().expect("a temporary folder");
    let folder = temporary.path();
    std::fs::write(folder.join("1.left-out"), "scene\nroom\n").expect("written");
    std::fs::write(folder.join("2.left-out"), "scene\n").expect("written");
    std::fs::write(folder.join("2.jsonl"), "").expect("written");
    let known: Vec<String> = left_out(folder).expect("readable").into_iter().collect();
    assert_eq!(known, ["room", "scene"]);
}

/// Karat ignores the file `last` if its text isn't the name of a run's folder, for example if the text is `../x`.
#[test]
fn the_file_last_can_only_name_a_folder_beside_it() {
    let temporary = tempfile::tempdir().expect("a temporary folder");
    let records = temporary.path().join("record");
    for (name, is_run) in [("run-12-0", true), ("run-../x", false), ("../x", false), ("", false)] {
        std::fs::create_dir_all(&records).expect("made");
        std::fs::write(records.join("last"), name).expect("written");
        let found = folder::last(&records);
        assert_eq!(found, is_run.then(|| records.join(name)), "{name}");
    }
}
