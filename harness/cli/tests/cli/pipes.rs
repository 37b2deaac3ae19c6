//! Tests that the verdict is the same if the output has no reader, or if its reader stops early.

use super::pending::{LAVAPIPE, pending_frame, write_frame};
use super::report::function;
use super::*;

/// A project in which each command prints something: two pending frames, two images that differ, and the record of a
/// run that failed.
fn eventful() -> TempDir {
    let project = project();
    let folder = project.path();
    let golden = folder.join("golden");
    pending_frame(&golden, "scene", LAVAPIPE);
    karat(folder, &["accept", "scene", "--because", "why"]).good();
    write(&golden, "stray.txt", "");
    pending_frame(&golden, "new", LAVAPIPE);
    write_frame(&golden, "room", "room", LAVAPIPE, "of another image");
    for (name, value) in [("a.exr", 0.25), ("b.exr", 0.5)] {
        let image = karat::Image::new(1, 1, vec![[value; 4]]);
        image.write_exr(&folder.join(name), karat::image::Precision::Float, None).expect("written");
    }
    write(folder, "passed/1.jsonl", &function("calc::double", "gl", "pass", None));
    write(folder, "passed/run.json", r#"{"passed":true,"schema":5,"selected":[]}"#);
    write(folder, "failed/1.jsonl", &function("calc::double", "gl", "fail", Some("it fails")));
    write(folder, "failed/run.json", r#"{"passed":false,"schema":5,"selected":[]}"#);
    project
}

/// Commands, each with its exit code in the project of [`eventful`].
const COMMANDS: [(&[&str], i32); 27] = [
    (&["list"], 0),
    (&["list", "--json"], 0),
    (&["show", "calc::double"], 0),
    (&["show", "calc::duoble"], 2),
    (&["call", "calc::double", "1"], 0),
    (&["call", "calc::double"], 2),
    (&["doctor"], 0),
    (&["doctor", "--json"], 0),
    (&["doctor", "--require", "vulkan,gl,metal,dx12"], 1),
    (&["completions", "bash"], 0),
    (&["--help"], 0),
    (&["pending", "--help"], 0),
    (&["--version"], 0),
    (&["pending"], 1),
    (&["pending", "--json"], 1),
    (&["pending", "--goldens", "shaders"], 0),
    (&["diff", "a.exr", "b.exr"], 1),
    (&["diff", "a.exr", "b.exr", "--json"], 1),
    (&["diff", "a.exr", "a.exr"], 0),
    (&["diff", "a.exr", "none.exr"], 3),
    (&["unreferenced", "--record", "passed"], 1),
    (&["unreferenced", "--record", "failed"], 3),
    (&["report", "--record", "passed", "--github"], 0),
    (&["report", "--record", "failed", "--github"], 1),
    (&["review", "--static", "page"], 0),
    (&["preview", "a.exr"], 0),
    (&["render", "scene"], 2),
];

/// The exit code of a command with closed pipes for standard output and standard error.
fn into_a_broken_pipe(command: &mut Command) -> Option<i32> {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    command.stdout(writer.try_clone().expect("a copy")).stderr(writer);
    command.status().expect("the binary was built with this test").code()
}

// Lesson 57
#[test]
fn a_closed_pipe_does_not_change_the_exit_code() {
    let project = eventful();
    for (arguments, code) in COMMANDS {
        let read = karat(project.path(), arguments);
        assert_eq!(read.code, Some(code), "{arguments:?}: {read:?}");
        let unread = into_a_broken_pipe(&mut command(project.path(), arguments));
        assert_eq!(unread, Some(code), "{arguments:?}");
    }
}

/// If no program reads the output of a command, the command still changes its files and returns its usual exit code.
// Lesson 57
#[test]
fn a_closed_pipe_does_not_stop_a_command() {
    let project = eventful();
    let (folder, golden) = (project.path(), project.path().join("golden"));
    let run = |arguments: &[&str]| into_a_broken_pipe(&mut command(folder, arguments));
    assert_eq!(run(&["accept", "*", "--because", "why", "--json"]), Some(1), "room is stale");
    assert!(golden.join("new.exr").is_file() && golden.join("room.new.exr").is_file());
    assert_eq!(run(&["reject", "*"]), Some(0));
    assert!(!golden.join("room.new.exr").exists());
    write(folder, "in.csv", "1\n");
    assert_eq!(run(&["call", "calc::double", "--table", "in.csv", "--out", "out.csv"]), Some(0));
    assert!(folder.join("out.csv").is_file());
    assert_eq!(run(&["diff", "a.exr", "b.exr", "--heatmap", "flip.png"]), Some(1));
    assert!(folder.join("flip.png").is_file());
}

/// In a shell's pipe, a command keeps its usual exit code, even if the reader ends at once or after the first line.
// Lesson 57
#[cfg(unix)]
#[test]
fn a_shell_pipe_that_closes_early_keeps_the_exit_code() {
    let project = eventful();
    for (line, code) in [
        ("pending --json | true", "1"),
        ("pending | head -1", "1"),
        ("diff a.exr b.exr | true", "1"),
        ("diff a.exr b.exr 2>&1 | head -1", "1"),
        ("report --record failed | head -1", "1"),
        ("list | head -1", "0"),
    ] {
        let (karat, reader) = line.split_once('|').expect("a pipe");
        let script = format!("{{ \"$KARAT\" {karat}; echo $? > code; }} | {reader}");
        let mut shell = command(project.path(), &[]);
        let karat = shell.get_program().to_owned();
        let mut shell = {
            let mut fresh = Command::new("sh");
            for (name, value) in shell.current_dir(project.path()).get_envs() {
                match value {
                    Some(value) => fresh.env(name, value),
                    None => fresh.env_remove(name),
                };
            }
            fresh
        };
        let ran = shell.current_dir(project.path()).env("KARAT", karat).args(["-c", &script]);
        output(ran);
        let told = std::fs::read_to_string(project.path().join("code")).expect("written");
        assert_eq!(told.trim(), code, "{line}");
    }
}

/// If the reader of `karat test` closes the pipe, Cargo's run still completes, and Karat writes records and reports.
// Lesson 57
#[cfg(unix)]
#[test]
fn a_closed_pipe_does_not_stop_a_run() {
    let project = project();
    let folder = project.path();
    // The script prints much text on both streams before it records the verdict. `sh test ...` runs this file.
    let script = "i=0\nwhile [ $i -lt 300 ]; do\n  echo \"test t$i ... FAILED\"\n  \
                  echo Compiling >&2\n  i=$((i + 1))\ndone\n\
                  mkdir -p \"$KARAT_RECORD\"\ncp lines.jsonl \"$KARAT_RECORD/1.jsonl\"\nexit $STATUS\n";
    write(folder, "test", script);
    for (verdict, status, code) in [("fail", "101", 1), ("pass", "0", 0), ("pass", "101", 1)] {
        write(folder, "lines.jsonl", &function("calc::double", "gl", verdict, None));
        let junit = folder.join("junit.xml");
        drop(std::fs::remove_file(&junit));
        let mut test = command(folder, &["test", "--junit", "junit.xml"]);
        test.env("CARGO", "/bin/sh").env("STATUS", status);
        assert_eq!(into_a_broken_pipe(&mut test), Some(code), "{verdict}, {status}");
        assert!(junit.is_file(), "{verdict}");
        let ran = karat(folder, &["report"]);
        assert_eq!(ran.code, Some(code), "{ran:?}");
        assert!(ran.out.contains("1 check"), "{ran:?}");
    }
}

/// If a command can't print its output because the disk is full, the command fails, but still does its work.
// Lesson 57
#[cfg(target_os = "linux")]
#[test]
fn an_output_that_cannot_be_written_is_an_error() {
    let project = eventful();
    let folder = project.path();
    let full = || std::fs::File::options().write(true).open("/dev/full").expect("it is there");
    let run = |arguments: &[&str]| {
        let mut command = command(folder, arguments);
        let ran = command.stdout(full()).stderr(Stdio::piped()).spawn().expect("it runs");
        let ran = ran.wait_with_output().expect("it ends");
        (ran.status.code(), String::from_utf8_lossy(&ran.stderr).into_owned())
    };
    for (arguments, code) in COMMANDS {
        // A command that fails before it prints has its own exit code.
        let silent = karat(folder, arguments).out.is_empty();
        let (ran, err) = run(arguments);
        assert_eq!(ran, Some(if silent { code } else { 2 }), "{arguments:?}: {err}");
        let told = err.contains("error: can't write the output: ");
        assert!(told || silent, "{arguments:?}: {err}");
    }
    let (code, err) = run(&["accept", "new", "--because", "why"]);
    assert_eq!(code, Some(2), "{err}");
    assert!(folder.join("golden/new.exr").is_file() && !folder.join("golden/new.new.exr").exists());
    // If standard error has no reader, the verdict is the same.
    let ran = command(folder, &["accept", "room", "--because", "why"]).stderr(full()).status();
    assert_eq!(ran.expect("it runs").code(), Some(1));
}
