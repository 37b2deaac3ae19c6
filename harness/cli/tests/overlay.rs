//! Tests the environment variable `KARAT_OVERLAY`, which names a folder of files that replace modules.

#[path = "given/files.rs"]
mod files;

use std::process::Command;

use self::files::write;
use tempfile::TempDir;

struct Project {
    folder: TempDir,
}

impl Project {
    fn new(overlay: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        write(folder.path(), "project/Cargo.toml", "[workspace]\n");
        write(folder.path(), "project/shaders/math.wgsl", "const PI: f32 = 3.14159265;\n");
        write(
            folder.path(),
            "project/shaders/area.wgsl",
            "import package::math::PI;\nfn disk(r: f32) -> f32 { return PI * r * r; }\n",
        );
        std::fs::create_dir(folder.path().join("overlay")).expect("a folder");
        for (file, text) in overlay {
            write(&folder.path().join("overlay"), file, text);
        }
        Self { folder }
    }

    /// Runs `karat show area::disk`. Returns its exit code, and the output of both streams.
    fn show(&self, overlay: Option<&str>) -> (Option<i32>, String, String) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_karat"));
        command.env_remove("KARAT_OVERLAY").env("NO_COLOR", "1").args(["show", "area::disk"]);
        if let Some(overlay) = overlay {
            command.env("KARAT_OVERLAY", self.folder.path().join(overlay));
        }
        let output = command.current_dir(self.folder.path().join("project")).output();
        let output = output.expect("the binary was built with this test");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (output.status.code(), text(&output.stdout), text(&output.stderr))
    }

    /// Returns the reason why Karat refuses the overlay.
    #[track_caller]
    fn refused(&self, overlay: &str) -> String {
        let (code, out, err) = self.show(Some(overlay));
        assert_eq!(code, Some(2), "{out}\n{err}");
        err
    }
}

#[test]
fn a_file_stands_in_for_a_module() {
    for file in ["math.wgsl", "shaders/math.wgsl"] {
        let project = Project::new(&[(file, "const PI: f32 = 3.0;\n")]);
        let (code, out, err) = project.show(Some("overlay"));
        assert_eq!(code, Some(0), "{err}");
        assert!(out.contains("= 3.0") && !out.contains("3.14159265"), "{out}");
        let notes: Vec<&str> = err.lines().filter(|line| line.starts_with("note: ")).collect();
        let [note] = notes[..] else { panic!("one note was expected:\n{err}") };
        assert!(note.starts_with("note: KARAT_OVERLAY=") && note.ends_with("math.wgsl"), "{note}");

        let (code, out, err) = project.show(None);
        assert_eq!(code, Some(0), "{err}");
        assert!(out.contains("3.14159265") && !err.contains("note: "), "{out}\n{err}");
    }
}

/// An error in a file of the overlay has the path of this file, not the path of the replaced module.
#[test]
fn errors_are_shown_in_the_overlay() {
    let project = Project::new(&[("area.wgsl", "fn disk(r: f32) -> f32 { return r * ; }\n")]);
    let err = project.refused("overlay");
    assert!(err.contains("expected expression") && err.contains("overlay/area.wgsl:1:"), "{err}");
}

#[test]
fn a_file_that_replaces_nothing_is_an_error() {
    let slip = [("shaders/maths.wgsl", "const PI: f32 = 3.0;\n")];
    let err = Project::new(&slip).refused("overlay");
    assert!(
        err.contains("(KARAT_OVERLAY) has `shaders/maths.wgsl`, which isn't a module of"),
        "{err}"
    );
    assert!(err.contains("package `shaders`; did you mean `math.wgsl`?"), "{err}");
    let err = Project::new(&[("math.txt", "")]).refused("overlay");
    assert!(err.contains("has `math.txt`, which isn't a module of package `shaders`"), "{err}");
}

#[test]
fn an_overlay_without_files_is_an_error() {
    let project = Project::new(&[]);
    let err = project.refused("overlay");
    assert!(err.contains("has no files, so it replaces no module"), "{err}");
    let err = project.refused("elsewhere");
    assert!(err.contains("elsewhere` (KARAT_OVERLAY) isn't a folder in `"), "{err}");
}
