//! What a person sees on a terminal while tests run, and on one that is narrow.

use std::io::Read;

use portable_pty::{CommandBuilder, PtySize, native_pty_system};

use super::report::function;
use super::*;

/// A terminal of this width in which a command ran: its exit code, and its lines as they stand at last.
fn shown(
    folder: &FilePath,
    columns: u16,
    arguments: &[&str],
    env: &[(&str, &str)],
) -> (u32, Vec<String>) {
    let rows = 60;
    let size = PtySize { rows, cols: columns, ..PtySize::default() };
    let pair = native_pty_system().openpty(size).expect("a terminal");
    let like = command(folder, &[]);
    let mut command = CommandBuilder::new(like.get_program());
    for (name, value) in like.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        }
    }
    command.env_remove("COLUMNS");
    command.env("TERM", "xterm");
    for (name, value) in env {
        command.env(name, value);
    }
    command.args(arguments);
    command.cwd(folder);
    let mut child = pair.slave.spawn_command(command).expect("it starts");
    drop(pair.slave);
    let mut reader = pair.master.try_clone_reader().expect("its output");
    let reader = std::thread::spawn(move || {
        let (mut all, mut bytes) = (Vec::new(), [0; 4096]);
        // A terminal whose last program ended is an error on Linux.
        while let Ok(count @ 1..) = reader.read(&mut bytes) {
            all.extend_from_slice(&bytes[..count]);
        }
        all
    });
    let code = child.wait().expect("it ends").exit_code();
    let mut screen = vt100::Parser::new(rows, columns, 0);
    screen.process(&reader.join().expect("it only reads"));
    (code, screen.screen().rows(0, columns).map(|row| row.trim_end().to_owned()).collect())
}

/// A project in which `cargo test` is this script.
fn scripted(script: &str, lines: &[String]) -> TempDir {
    let project = project();
    let begin = "mkdir -p \"$KARAT_RECORD\"\ncp lines.jsonl \"$KARAT_RECORD/1.jsonl\"\n";
    // `sh test --no-fail-fast ...` runs the file `test`.
    write(project.path(), "test", &format!("{begin}{script}"));
    write(project.path(), "lines.jsonl", &lines.concat());
    project
}

#[test]
fn what_cargo_says_stands_on_lines_of_its_own() {
    // Enough of them that the line of progress is drawn in between.
    let script = "echo '   Compiling a v0.1.0' >&2\n\
        for program in a b c; do\n  echo \"     Running tests/$program.rs\" >&2\n  echo 'running 9 tests'\n  \
        for n in 1 2 3 4 5 6 7 8 9; do echo \"test $program::t$n ... ok\"; sleep 0.02; done\n  \
        echo \"warning: in $program\" >&2\n  sleep 0.05\n  echo\n  echo 'test result: ok. 9 passed'\n\
        done\n";
    let project = scripted(script, &[function("calc::same", "gl", "pass", None)]);
    let (code, lines) = shown(project.path(), 80, &["test"], &[("CARGO", "/bin/sh")]);
    let text = lines.join("\n");
    assert_eq!(code, 0, "{text}");
    for own in [
        "   Compiling a v0.1.0",
        "     Running tests/b.rs",
        "warning: in b",
        "     Running tests/c.rs",
    ] {
        assert!(lines.iter().any(|line| line == own), "`{own}` has no line of its own:\n{text}");
    }
    assert!(
        !text.contains("of 27 tests") && !text.contains("::t9"),
        "nothing is left of it:\n{text}"
    );
}

#[test]
fn tables_fit_a_narrow_terminal() {
    let line = function("calc::double", "gl", "pass", None).replace(
        "7 ulp | more",
        "FAIL the gate is exceeded by 12 pixels, largest FLIP tile 0.0010 of 0.01",
    );
    let project = scripted("", &[line]);
    let run = [("CARGO", "/bin/sh")];
    for (columns, env) in [(80, &run[..]), (120, &[run[0], ("COLUMNS", "80")])] {
        let (_, lines) = shown(project.path(), columns, &["test"], env);
        let row = lines.iter().position(|line| line.starts_with("calc::double"));
        let row = row.unwrap_or_else(|| panic!("{}", lines.join("\n")));
        assert!(lines[row].contains("FAIL the") && lines[row].contains(".."), "{}", lines[row]);
        assert!(
            lines[row].ends_with("1 ulp") && lines[row].chars().count() <= 80,
            "{}",
            lines[row]
        );
    }
    // Who reads a pipe has all of it.
    let ran = output(command(project.path(), &["test"]).env("CARGO", "/bin/sh"));
    assert!(ran.out.contains("largest FLIP tile 0.0010 of 0.01"), "{ran:?}");
    // Without colours there are none.
    let (_, lines) =
        shown(project.path(), 80, &["test"], &[run[0], ("NO_COLOR", "1"), ("TERM", "dumb")]);
    assert!(lines.iter().any(|line| line.starts_with("1 check, 0 failed")), "{}", lines.join("\n"));
}
