//! Programs that run jobs: an honest one agrees, and one that doesn't do its work is found out.

use std::process::Command;

/// The output of `planted pipe` with `planted executor` as their path, on a path of its own and with a
/// fault.
fn piped(path: &str, fault: &str) -> String {
    let executor = format!("mine={} executor {path} {fault}", env!("CARGO_BIN_EXE_planted"));
    told(&executor, "process@mine", &[])
}

fn told(executors: &str, paths: &str, environment: &[(&str, &str)]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_planted"));
    command.arg("pipe").env("KARAT_EXECUTORS", executors).env("KARAT_PATHS", paths);
    command.env_remove("KARAT_REQUIRE").env_remove("KARAT_RECORD");
    let output = command.envs(environment.iter().copied()).output().expect("it runs");
    String::from_utf8(output.stderr).expect("it is text")
}

/// The engine behind a pipe calls functions and dispatches passes as it does here, and refuses frames.
#[test]
fn the_engine_behind_a_pipe_is_a_path() {
    let text = piped("cpu", "");
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[..3], ["function: agrees", "texture: agrees", "pass: agrees"], "{text}");
    assert!(lines[3].starts_with("frame: path `process@mine` draws no frames"), "{text}");
    assert_eq!(lines[4], "load: agrees", "{text}");
    assert!(
        lines[5].contains(
            "it takes derivatives, or discards and writes, for which pixels have to be drawn"
        ),
        "{text}"
    );
}

/// A driver behind a pipe draws, too.
#[test]
fn a_driver_behind_a_pipe_draws_frames() {
    let text = piped("vulkan", "");
    let agrees = text.lines().filter(|line| line.ends_with(": agrees")).count();
    assert_eq!(agrees, 5, "{text}");
    assert!(text.contains("frame: agrees"), "{text}");
}

/// Evidence is looked at above the executor, whichever it is.
#[test]
fn a_program_that_does_not_do_its_work_is_found_out() {
    for (fault, function, pass) in [
        (
            "idle",
            "the kernel of `half` wrote no result for 4096 of 4096 cases on path `process@mine`",
            "`data` after `add` fails",
        ),
        // The pass leaves its first word as it was, and two rotated words of two are themselves.
        ("dropped", "never wrote 1 of 4096 result words", "pass: agrees"),
        ("shifted", "wrote no result for", "pass: agrees"),
        ("wrong", "`half` fails agrees_with", "`data` after `add` fails"),
        (
            "short",
            "it returned outputs of [8191] words, and [8192] are wanted",
            "it returned outputs of [1] words, and [2] are wanted",
        ),
        ("few", "it returned outputs of [] words, and [", "it returned outputs of [] words, and ["),
        ("refuses", "it is too beautiful (<piped>:1:1)", "it is too beautiful (<piped>:6:"),
        ("fails", "it is too beautiful (<piped>:1:1)", "it is too beautiful (<piped>:6:"),
        ("garbage", "its answer is none: all went well", "its answer is none: all went well"),
        (
            "dies",
            "it ended (exit status: 3): out of memory",
            "it ended (exit status: 3): out of memory",
        ),
    ] {
        let text = piped("cpu", fault);
        let of = |name: &str| {
            let from = text.find(&format!("{name}: ")).expect("each has a line");
            let next = ["\ntexture: ", "\npass: ", "\nframe: ", "\nload: "]
                .map(|next| text[from..].find(next));
            &text[from..from + next.into_iter().flatten().min().unwrap_or(text.len() - from)]
        };
        assert!(of("function").contains(function), "{fault}: {text}");
        assert!(of("pass").contains(pass), "{fault}: {text}");
        assert!(!text.contains("function: agrees"), "{fault}: {text}");
    }
}

/// A program that hangs is ended by the deadline, and the check fails with the setting's name.
#[test]
fn a_program_that_hangs_is_ended() {
    // The second one takes no job at all, and its pipe is full. They are waited for beside each other.
    let is_ended = |fault: &str| {
        let executor = format!("mine={} executor cpu {fault}", env!("CARGO_BIN_EXE_planted"));
        let text = told(&executor, "process@mine", &[("KARAT_TIMEOUT", "0.5")]);
        assert_eq!(text.matches("did not finish within 0.5 s").count(), 4, "{fault}: {text}");
    };
    std::thread::scope(|scope| {
        scope.spawn(|| is_ended("hangs"));
        is_ended("deaf");
    });
}

/// A line too many, a reply to another job and a place that is none are errors, and no verdict is another job's.
#[test]
fn a_line_belongs_to_its_job() {
    let text = piped("cpu", "noisy");
    assert!(
        text.contains("function: the driver of path `process@mine` reports: its answer is none"),
        "{text}"
    );
    // Another process is started, and it is noisy, too.
    assert_eq!(text.matches("its answer is none: by the way").count(), 4, "{text}");
    let text = piped("cpu", "other");
    assert_eq!(text.matches("reports: it answers job ").count(), 4, "{text}");
    let text = piped("cpu", "late");
    assert!(!text.contains(": agrees"), "{text}");
    let text = piped("cpu", "backwards");
    assert_eq!(text.matches("look there").count(), 4, "{text}");
}

/// Another program doesn't open, and the reason says why.
#[test]
fn what_runs_no_jobs_does_not_open() {
    let planted = env!("CARGO_BIN_EXE_planted");
    for (executors, paths, message) in [
        (
            "mine=/nowhere/at/all",
            "process@mine",
            "`/nowhere/at/all`, which KARAT_EXECUTORS names: it can't be run",
        ),
        (
            "mine=PLANTED executor cpu",
            "process@mien",
            "KARAT_EXECUTORS names no `mien`; did you mean `mine`?",
        ),
        (
            "mine=PLANTED executor cpu",
            "process",
            "`process@NAME` is a program that KARAT_EXECUTORS names",
        ),
        ("mine=PLANTED executor cpu", "process:hlsl@mine", "takes WGSL, without a route"),
        (
            "mine=PLANTED executor cpu silent",
            "process@mine",
            "it ended (exit status: 0): it says nothing",
        ),
        (
            "mine=PLANTED executor cpu old",
            "process@mine",
            "it reads jobs of version 0, and this Karat writes version 1",
        ),
        (
            "mine=PLANTED executor cpu rude",
            "process@mine",
            "its first line is no greeting: good morning",
        ),
        ("mine", "process@mine", "KARAT_EXECUTORS=mine isn't a list of NAME=PROGRAM ARGUMENTS"),
    ] {
        let text = told(&executors.replace("PLANTED", planted), paths, &[]);
        assert!(text.contains(message), "{executors}: {text}");
        assert!(!text.contains(": agrees"), "{executors}: {text}");
    }
}

/// A check that needs more than a program says that it can is refused before anything runs.
#[test]
fn a_check_that_needs_more_is_refused() {
    let text = piped("cpu", "plain");
    for needs in
        ["texture: `first` needs textures, which path", "load: `load` needs textures, which path"]
    {
        assert!(text.contains(needs), "{text}");
    }
    assert!(text.contains("function: agrees"), "{text}");
}
