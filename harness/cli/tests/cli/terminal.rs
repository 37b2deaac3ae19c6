//! Tests the output on a terminal while tests run, also on a narrow terminal.

use std::io::Read;

use portable_pty::{CommandBuilder, PtySize, native_pty_system};

use super::report::function;
use super::*;

/// Runs a command in a terminal of this width. Returns its exit code, and the final lines on the screen.
fn shown(
    folder: &FilePath,
    columns: u16,
    arguments: &[&str],
    env: &[(&str, &str)],
) -> (u32, Vec<String>) {
    let (code, written) = written(folder, columns, arguments, env);
    let mut screen = vt100::Parser::new(ROWS, columns, 0);
    screen.process(&written);
    (code, screen.screen().rows(0, columns).map(|row| row.trim_end().to_owned()).collect())
}

const ROWS: u16 = 60;

/// Everything that a command writes to a terminal, and its exit code.
fn written(
    folder: &FilePath,
    columns: u16,
    arguments: &[&str],
    env: &[(&str, &str)],
) -> (u32, Vec<u8>) {
    let rows = ROWS;
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
        // On Linux, reading from a terminal is an error after its last program has ended.
        while let Ok(count @ 1..) = reader.read(&mut bytes) {
            all.extend_from_slice(&bytes[..count]);
        }
        all
    });
    let code = child.wait().expect("it ends").exit_code();
    (code, reader.join().expect("it only reads"))
}

fn scripted(script: &str, lines: &[String]) -> TempDir {
    let project = project();
    let begin = "mkdir -p \"$KARAT_RECORD\"\ncp lines.jsonl \"$KARAT_RECORD/1.jsonl\"\n";
    // `sh test --no-fail-fast ...` runs the file `test`.
    write(project.path(), "test", &format!("{begin}{script}"));
    write(project.path(), "lines.jsonl", &lines.concat());
    project
}

#[test]
fn output_of_cargo_has_its_own_lines() {
    // The script prints many lines, so that Karat draws the line of progress between them.
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
        "FAIL the gate is exceeded at 12 pixels, largest FLIP tile 0.0010 of 0.01",
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
    // On narrower terminals, columns are left out: with 60 columns no row needs two lines.
    let long = |at: usize| {
        let line = function(&format!("tone::narrow_table_{at}"), "vulkan", "pass", None);
        line.replace("7 ulp | more", "0.49999997 ulp")
    };
    let passing = scripted("", &[long(1), long(2), long(3)]);
    let (_, lines) = shown(passing.path(), 60, &["test", "--all"], &run);
    let rows: Vec<&String> = lines.iter().filter(|line| line.contains("narrow_table")).collect();
    assert_eq!(rows.len(), 3, "{}", lines.join("\n"));
    let at = lines.iter().position(|line| line == rows[0]).expect("it is there");
    assert!(lines[at - 1].starts_with("function  "), "{}", lines.join("\n"));
    assert!(lines[at + 1].starts_with("tone::narrow_table_2"), "{}", lines.join("\n"));
    assert!(rows[0].contains("vulkan") && rows[0].contains("0.49999"), "{}", rows[0]);
    // Through a pipe, the output has all columns.
    let ran = output(command(project.path(), &["test"]).env("CARGO", "/bin/sh"));
    assert!(ran.out.contains("largest FLIP tile 0.0010 of 0.01"), "{ran:?}");
    // If colours are off, the output has no colours.
    let (_, lines) =
        shown(project.path(), 80, &["test"], &[run[0], ("NO_COLOR", "1"), ("TERM", "dumb")]);
    assert!(lines.iter().any(|line| line.starts_with("1 check, 0 failed")), "{}", lines.join("\n"));
}

/// On a terminal, Karat shows a count of rows while it works, and then removes the count.
#[test]
fn the_matrix_counts_its_rows_on_a_terminal() {
    let folder = translations::shaders();
    let arguments = ["matrix", "--only", "maths", "--columns", "cpu", "--cases", "16"];
    let (_, written) = written(folder.path(), 100, &arguments, &[]);
    let written = String::from_utf8_lossy(&written);
    assert!(written.contains("shaders: ") && written.contains(" of 3 rows"), "{written}");
    let (_, lines) = shown(folder.path(), 100, &arguments, &[]);
    assert!(lines.iter().any(|line| line.starts_with("maths::blend")), "{}", lines.join("\n"));
    assert!(!lines.iter().any(|line| line.contains(" of 3 rows")), "{}", lines.join("\n"));
    let ran = karat(folder.path(), &arguments);
    assert!(!ran.err.contains(" of 3 rows"), "{ran:?}");
}
