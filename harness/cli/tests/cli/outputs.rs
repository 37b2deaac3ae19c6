//! Tests the files that commands write. A command never overwrites its input, and writes a file completely or not at
//! all.

use super::pending::pending_frame;
use super::report::function;
use super::*;

// Lesson 59
#[test]
fn a_table_replaces_no_input() {
    let project = project();
    let folder = project.path();
    let path = |name: &str| folder.join(name);
    write(folder, "x.csv", "x\n1\n2\n");
    std::fs::create_dir(path("sub")).expect("a folder");
    std::fs::hard_link(path("x.csv"), path("hard.csv")).expect("a link");
    #[cfg(unix)]
    std::os::unix::fs::symlink("x.csv", path("soft.csv")).expect("a link");
    let names = ["x.csv", "./sub/../x.csv", "hard.csv", "soft.csv"];
    // On other systems, making links needs privileges.
    for name in names.into_iter().filter(|name| cfg!(unix) || *name != "soft.csv") {
        let arguments = ["call", "calc::double", "--table", "x.csv", "--out", name];
        let error = karat(folder, &arguments).error();
        let message =
            format!("the table `{name}` would overwrite `x.csv`, which the command reads");
        assert!(error.contains(&message) && error.contains("name another file"), "{error}");
        assert_eq!(std::fs::read_to_string(path("x.csv")).expect("there"), "x\n1\n2\n");
    }
    // The shader is also an input.
    let shader = "fn twice(x: f32) -> f32 { return 2.0 * x; }\n";
    write(folder, "my.wgsl", shader);
    let arguments = ["--shaders", "my.wgsl", "--table", "x.csv", "--out", "my.wgsl"];
    let error = karat(folder, &[&["call", "twice"][..], &arguments].concat()).error();
    assert!(error.contains("the table `my.wgsl` would overwrite `my.wgsl`"), "{error}");
    assert_eq!(std::fs::read_to_string(path("my.wgsl")).expect("there"), shader);
}

// Lesson 59
#[test]
fn a_preview_replaces_no_input() {
    let project = project();
    let folder = project.path();
    pending_frame(folder, "scene", "any");
    std::fs::rename(folder.join("scene.new.exr"), folder.join("a.exr")).expect("renamed");
    std::fs::hard_link(folder.join("a.exr"), folder.join("b.png")).expect("a link");
    let before = std::fs::read(folder.join("a.exr")).expect("there");
    for out in ["a.exr", "b.png"] {
        let error = karat(folder, &["preview", "a.exr", "--out", out]).error();
        assert!(error.contains(&format!("the preview `{out}` would overwrite `a.exr`")), "{error}");
        assert!(std::fs::read(folder.join(out)).expect("there") == before, "{out}");
    }
    // The default output doesn't overwrite the image either: an image may have another format's extension.
    std::fs::copy(folder.join("a.exr"), folder.join("c.png")).expect("copied");
    let error = karat(folder, &["preview", "c.png"]).error();
    assert!(error.contains("the preview `c.png` would overwrite `c.png`"), "{error}");
}

// Lesson 59
#[test]
fn a_report_replaces_no_record() {
    let project = project();
    let folder = project.path();
    write(folder, "run/1.jsonl", &function("calc::double", "gl", "pass", None));
    write(folder, "run/run.json", r#"{"passed":true,"schema":5,"selected":[]}"#);
    for file in ["run/run.json", "run/1.jsonl"] {
        let error = karat(folder, &["report", "--record", "run", "--junit", file]).error();
        assert!(error.contains(&format!("the report `{file}` would overwrite `")), "{error}");
    }
    karat(folder, &["report", "--record", "run", "--junit", "run/junit.xml"]).good();
}

/// Karat writes a temporary file beside the old file, then renames the temporary file. A program that is reading the
/// old file can read it to its end.
// Lesson 59
#[test]
fn every_output_is_written_whole() {
    let project = project();
    let folder = project.path();
    pending_frame(folder, "scene", "any");
    write(folder, "in.csv", "1\n");
    write(folder, "record/1.jsonl", &function("calc::double", "gl", "pass", None));
    write(folder, "record/run.json", r#"{"passed":true,"schema":5,"selected":[]}"#);
    for (file, arguments) in [
        ("out.csv", &["call", "calc::double", "--table", "in.csv", "--out", "out.csv"][..]),
        ("a.png", &["preview", "scene.new.exr", "--out", "a.png"]),
    ] {
        let old = folder.join(format!("old-{file}"));
        write(folder, file, "of the run before");
        std::fs::hard_link(folder.join(file), &old).expect("a link");
        karat(folder, arguments).good();
        assert_eq!(std::fs::read_to_string(&old).expect("there"), "of the run before", "{file}");
        let bytes = std::fs::read(folder.join(file)).expect("there");
        assert_ne!(bytes, b"of the run before", "{file}");
    }
    karat(folder, &["report", "--record", "record", "--junit", "new/junit.xml"]).good();
    for below in [folder.to_owned(), folder.join("new")] {
        for entry in std::fs::read_dir(below).expect("a folder") {
            let name = entry.expect("readable").file_name().to_string_lossy().into_owned();
            assert!(!name.ends_with(".tmp"), "{name}");
        }
    }
}

/// If the disk is full, the old file stays. This test doesn't fill a disk: it limits files to 512 bytes.
// Lesson 59
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_the_table_of_before() {
    let project = project();
    let folder = project.path();
    write(folder, "in.csv", &"0.333333333\n".repeat(400));
    write(folder, "out.csv", "of the run before");
    let karat = command(folder, &[]).get_program().to_owned();
    let limited = "trap '' XFSZ; ulimit -f 1; exec \"$0\" \"$@\"";
    let mut shell = Command::new("sh");
    shell.current_dir(folder).env("NODEVICE_SELECT", "1").env("MESA_SHADER_CACHE_DISABLE", "true");
    shell.args(["-c", limited]).arg(karat);
    // Drivers write their own files, and Karat opens a required driver.
    shell.env_remove("KARAT_PATHS").env_remove("KARAT_REQUIRE");
    let call = ["call", "calc::double", "--path", "cpu", "--table", "in.csv", "--out", "out.csv"];
    let ran = output(shell.args(call));
    assert!(ran.code == Some(2) && ran.err.contains("can't write `out.csv`"), "{ran:?}");
    let kept = std::fs::read_to_string(folder.join("out.csv")).expect("there");
    assert_eq!(kept, "of the run before");
}

/// If the output file is a pipe, a link or a device file such as `/dev/stdout`, Karat writes into this file, and
/// doesn't replace it by a new file.
// Lesson 59
#[cfg(unix)]
#[test]
fn output_to_a_device_or_link_does_not_replace_the_device_or_link() {
    use std::os::unix::fs::{FileTypeExt, MetadataExt};
    let project = project();
    let folder = project.path();
    write(folder, "in.csv", "1\n");
    let table = |out: &str| {
        karat(folder, &["call", "calc::double", "--table", "in.csv", "--out", out]).good()
    };
    // The test makes its own pipe, because a fault must not replace a device of this machine.
    let pipe = folder.join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().expect("it runs").success());
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || std::fs::read_to_string(pipe).expect("text")
    });
    table("pipe");
    let is_pipe = std::fs::symlink_metadata(&pipe).expect("there").file_type().is_fifo();
    if !is_pipe {
        // Opening the pipe for reading waits for a writer.
        panic!("the pipe was replaced");
    }
    assert!(reader.join().expect("no panic").starts_with("x,"));
    // The file is open, because standard output goes to it.
    let file = std::fs::File::create(folder.join("stdout.csv")).expect("created");
    let mut command =
        command(folder, &["call", "calc::double", "--table", "in.csv", "--out", "/dev/stdout"]);
    assert!(command.stdout(file.try_clone().expect("a copy")).status().expect("it runs").success());
    assert!(file.metadata().expect("there").nlink() == 1, "the file was replaced");
    assert!(std::fs::read_to_string(folder.join("stdout.csv")).expect("there").starts_with("x,"));
    std::os::unix::fs::symlink("real.csv", folder.join("link.csv")).expect("a link");
    write(folder, "real.csv", "old");
    table("link.csv");
    assert!(folder.join("link.csv").symlink_metadata().expect("there").is_symlink());
    assert!(std::fs::read_to_string(folder.join("real.csv")).expect("there").starts_with("x,"));
    // Karat deletes a report of an earlier run before it writes a new one. It keeps a file that isn't a report.
    std::fs::create_dir(folder.join("own")).expect("a folder");
    write(
        &folder.join("own"),
        "m.wgsl",
        "import karat::expect_true;\n@test fn t() { expect_true(true); }\n",
    );
    std::os::unix::fs::symlink("real.xml", folder.join("link.xml")).expect("a link");
    write(folder, "real.xml", "old");
    let report = ["test", "own", "--paths", "cpu", "--junit", "link.xml"];
    karat(folder, &report).good();
    assert!(folder.join("link.xml").symlink_metadata().expect("there").is_symlink());
    assert!(
        std::fs::read_to_string(folder.join("real.xml")).expect("there").contains("<testsuite")
    );
}

// Lesson 59
#[cfg(target_os = "linux")]
#[test]
fn a_table_without_an_end_is_refused() {
    let project = project();
    let folder = project.path();
    let call = |table: &str| karat(folder, &["call", "calc::double", "--table", table]).error();
    let error = call("/dev/zero");
    assert!(error.contains("`/dev/zero` is longer than 256 MB"), "{error}");
    let sparse = std::fs::File::create(folder.join("huge.csv")).expect("created");
    sparse.set_len(1 << 40).expect("a sparse file");
    let error = call("huge.csv");
    assert!(error.contains("`huge.csv` is longer than 256 MB"), "{error}");
    write(folder, "many.csv", &"1\n".repeat((1 << 22) + 1));
    let error = call("many.csv");
    assert!(error.contains("`many.csv` has more than 4194304 cases"), "{error}");
}
