//! Tests `karat render` in a separate Cargo project. The command builds and runs the project's gallery.

use std::path::Path as FilePath;
use std::process::Command;

use karat::Image;
use tempfile::TempDir;

const SHADER: &str = "\
@vertex
fn cover(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 1.0, 1.0);
}

@fragment
fn dim() -> @location(0) vec4f { return vec4f(0.25, 0.5, 1.0, 1.0); }

@fragment
fn bright() -> @location(0) vec4f { return vec4f(2.0, 4.0, 8.0, 1.0); }
";

const GALLERY: &str = r#"
static SHADERS: karat::Package = karat::package!("shaders");

fn main() -> std::process::ExitCode {
    karat_gallery::Gallery::new()
        .frame("flat", "one colour, which the samples choose", |options| {
            let (width, height) = options.size_or(3, 2);
            let fragment = if options.samples_or(1) == 1 { "dim" } else { "bright" };
            Ok(SHADERS.frame("flat", width, height).fullscreen("cover", fragment))
        })
        .frame("dark/sky", "a sky that isn't there", |options| match &options.environment {
            Some(sky) => Err(format!("no light in {}", sky.display()).into()),
            None => Err("no sky".into()),
        })
        .main()
}
"#;

/// Dependencies of the test project, with the features that Karat's own workspace enables. Other features would make
/// Cargo compile these libraries again. `tests/stranger.rs` does the same.
const SHARED: &str = "\
    indexmap = \"2\"\n\
    libc = { version = \"0.2\", features = [\"extra_traits\"] }\n\
    memchr = \"2\"\n\
    naga = { version = \"30\", features = [\"msl-out\", \"spv-in\", \"wgsl-out\"] }\n\
    num-traits = \"0.2\"\n\
    rustix = { version = \"1\", features = [\"event\", \"fs\", \"process\", \"stdio\", \"termios\"] }\n\
    serde_core = \"1\"\n\
    serde_json = { version = \"1\", features = [\"unbounded_depth\"] }\n\n\
    [build-dependencies]\n\
    syn = { version = \"2\", features = [\"extra-traits\"] }\n\
    syn-3 = { package = \"syn\", version = \"3\", features = [\"extra-traits\"] }\n";

const DECLARED: &str = "[workspace.metadata.karat]\ngallery = \"gallery\"\n";

fn read(path: &FilePath) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

struct Project {
    folder: TempDir,
    manifest: String,
}

impl Project {
    fn new() -> Self {
        let command_line = FilePath::new(env!("CARGO_MANIFEST_DIR"));
        let karat = command_line.parent().expect("this package lies in the library's folder");
        let gallery = karat.join("gallery");
        let repository = karat.parent().expect("it is in the workspace");
        let root = read(&repository.join("Cargo.toml"));
        // The project has this repository's profiles, lock file, features and folder of intermediate output, so Cargo
        // compiles only Karat again, without optimisation to save time: as in `tests/stranger.rs`.
        let profiles = root.find("[profile.dev]").map(|at| &root[at..]).expect("it has profiles");
        // The test doesn't use the engine. Compiling it with optimisation would take longer than all other steps.
        let engine = "[profile.dev.package.karat-engine]\nopt-level = 3\ncodegen-units = 1\n";
        assert!(profiles.contains(engine), "the profile of the engine has changed");
        let quick = "[profile.dev.package.karat-engine]\nopt-level = 1\n";
        let library = "[profile.dev.package.karat]\nopt-level = 2\n\
                       [profile.dev.package.karat-core]\nopt-level = 2\n";
        assert!(profiles.contains(library), "the profile of the library has changed");
        let profiles = profiles.replace(engine, quick).replace(
            library,
            "[profile.dev.package.karat]\nopt-level = 0\n\
                           [profile.dev.package.karat-core]\nopt-level = 0\n",
        );
        let manifest = format!(
            "[package]\nname = \"pictures\"\nedition = \"2024\"\n\n[workspace]\n\n\
             [dependencies]\nkarat = {{ path = {karat:?} }}\n\
             karat-gallery = {{ path = {gallery:?} }}\n{SHARED}\n\
             [[bin]]\nname = \"gallery\"\npath = \"frames/main.rs\"\n\n\
             {profiles}\n\n"
        );
        let folder = tempfile::tempdir().expect("a temporary folder");
        let project = Self { folder, manifest };
        project.declare(DECLARED);
        project.write("Cargo.lock", &read(&repository.join("Cargo.lock")));
        project.write("frames/main.rs", GALLERY);
        project.write("shaders/flat.wgsl", SHADER);
        project
    }

    fn declare(&self, settings: &str) {
        self.write("Cargo.toml", &format!("{}{settings}", self.manifest));
    }

    fn write(&self, file: &str, text: &str) {
        let path = self.folder.path().join(file);
        std::fs::create_dir_all(path.parent().expect("in the folder")).expect("a folder");
        std::fs::write(path, text).expect("written");
    }

    fn run(&self, program: &FilePath, folder: &str, arguments: &[&str]) -> Ran {
        let mut command = Command::new(program);
        for (name, _) in std::env::vars_os() {
            let text = name.to_string_lossy();
            if ["KARAT_", "CARGO_PKG_", "CARGO_MANIFEST_", "CARGO_BIN_"]
                .iter()
                .any(|prefix| text.starts_with(prefix))
            {
                command.env_remove(name);
            }
        }
        for name in ["CI", "CARGO_TARGET_DIR", "CARGO_CRATE_NAME", "CARGO_PRIMARY_PACKAGE"] {
            command.env_remove(name);
        }
        let built = FilePath::new(env!("CARGO_TARGET_TMPDIR")).parent().expect("in the output");
        command.env("CARGO_BUILD_BUILD_DIR", built).env("CARGO_NET_OFFLINE", "true");
        command.env("CARGO_TERM_COLOR", "never").env("NO_COLOR", "1").env("NODEVICE_SELECT", "1");
        command.current_dir(self.folder.path().join(folder)).args(arguments);
        let output = command.output().unwrap_or_else(|e| panic!("{}: {e}", program.display()));
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Ran { code: output.status.code(), out: text(&output.stdout), err: text(&output.stderr) }
    }

    fn render(&self, folder: &str, arguments: &[&str]) -> Ran {
        let karat = FilePath::new(env!("CARGO_BIN_EXE_karat"));
        self.run(karat, folder, &[&["render"], arguments].concat())
    }

    /// Reads the frame's EXR file, and checks that the folder also contains a PNG of the frame.
    fn frame(&self, folder: &str, name: &str) -> Image {
        let folder = self.folder.path().join(folder);
        let png = std::fs::read(folder.join(name).with_extension("png")).expect("written");
        assert!(png.starts_with(b"\x89PNG\r\n\x1a\n"));
        let exr = Image::read_exr(&folder.join(name).with_extension("exr"));
        exr.expect("written").0
    }

    fn has(&self, file: &str) -> bool {
        self.folder.path().join(file).exists()
    }
}

#[derive(Debug)]
struct Ran {
    code: Option<i32>,
    out: String,
    err: String,
}

impl Ran {
    #[track_caller]
    fn gives(&self, code: i32, out: &str, err: &str) {
        assert_eq!((self.code, &*self.out, &*self.err), (Some(code), out, err));
    }

    #[track_caller]
    fn says(&self, code: i32, part: &str) {
        assert_eq!(self.code, Some(code), "{self:?}");
        assert!(self.out.contains(part) || self.err.contains(part), "no `{part}` in: {self:?}");
    }

    /// The output's only line about a rendered frame, without the seconds, which vary.
    #[track_caller]
    fn line(&self) -> String {
        let (before, after) = self.out.split_once(" s  ").unwrap_or_else(|| panic!("{self:?}"));
        let (before, seconds) = before.rsplit_once("  ").unwrap_or_else(|| panic!("{self:?}"));
        assert!(seconds.parse::<f32>().is_ok_and(|seconds| seconds >= 0.0), "{self:?}");
        format!("{before}  {after}")
    }
}

const FLAT_DIM: [f32; 4] = [0.25, 0.5, 1.0, 1.0];
const FLAT_BRIGHT: [f32; 4] = [2.0, 4.0, 8.0, 1.0];

/// All steps are one test, because compiling the project takes most of the time.
#[test]
fn a_project_renders_its_own_frames() {
    let project = Project::new();
    let list = "flat      one colour, which the samples choose\n\
                dark/sky  a sky that isn't there\n";
    project.render("", &["--list"]).gives(0, list, "");

    let ran = project.render("", &["flat"]);
    let line = ran.line();
    let path = line.split("  ").nth(2).expect("a path").to_owned();
    let files = |folder: &str| {
        let file = |kind| FilePath::new(folder).join(format!("flat.{kind}")).display().to_string();
        format!("{}  {}\n", file("exr"), file("png"))
    };
    assert_eq!(line, format!("flat  3 x 2  {path}  {}", files("target/karat/frames")));
    assert_eq!((ran.code, &*ran.err), (Some(0), ""));
    let image = project.frame("target/karat/frames", "flat");
    assert_eq!((image.width(), image.pixels()), (3, &[FLAT_DIM; 6][..]));

    // Relative paths begin at the user's folder, which isn't the folder of Cargo.toml.
    let arguments = ["--first", "--size", "2x1", "--samples", "2", "--out", "a b", "--path", &path];
    let ran = project.render("frames", &arguments);
    assert_eq!(ran.line(), format!("flat  2 x 1  {path}  {}", files("a b")));
    let image = project.frame("frames/a b", "flat");
    assert_eq!((image.width(), image.pixels()), (2, &[FLAT_BRIGHT; 2][..]));

    // A frame that fails doesn't stop Karat from rendering the other frame.
    let ran = project.render("", &["--all", "--out", "all", "--exposure", "-1"]);
    assert!(ran.line().starts_with("flat      3 x 2"), "{ran:?}");
    assert_eq!(ran.code, Some(1));
    let message = "error: frame `dark/sky` can't be rendered: no sky\n\
                   1 of 2 frames failed: dark/sky\n";
    assert_eq!(ran.err, message);
    assert_eq!(project.frame("all", "flat").pixels(), [FLAT_DIM; 6]);
    assert!(!project.has("all/dark/sky.exr"));
    let png = |folder: &str| std::fs::read(project.folder.path().join(folder).join("flat.png"));
    assert_ne!(png("all").expect("written"), png("target/karat/frames").expect("written"));

    let arguments = ["dark/*", "--environment", "main.rs", "--out", "none"];
    let message = "error: frame `dark/sky` can't be rendered: no light in main.rs\n";
    project.render("frames", &arguments).gives(1, "", message);

    let message = "error: the gallery has no frame `falt`; did you mean `flat`?\n";
    project.render("", &["falt", "--out", "none"]).gives(2, "", message);
    let message = "error: the gallery has no frame `x*`; its frames are flat, dark/sky\n";
    project.render("", &["flat", "x*", "--out", "none"]).gives(2, "", message);
    let message =
        "error: no frame is selected: name a frame, or use --first or --all; the frames are\n";
    project.render("", &[]).gives(2, "", &format!("{message}{list}"));
    let foreign = if cfg!(target_os = "macos") { "dx12" } else { "metal" };
    project
        .render("", &["flat", "--path", foreign, "--out", "none"])
        .says(2, &format!("error: execution path `{foreign}` is required, but unavailable"));
    let message = "error: can't write into `Cargo.toml/none`: ";
    project.render("", &["flat", "--out", "Cargo.toml/none"]).says(2, message);
    assert!(!project.has("none/flat.exr"), "nothing is rendered when a name is wrong");

    // The gallery is itself a program for the command line.
    let gallery = project.folder.path().join("target/debug/gallery");
    let gallery = gallery.with_extension(std::env::consts::EXE_EXTENSION);
    project.run(&gallery, "", &["--list"]).gives(0, list, "");
    project.run(&gallery, "", &["--help"]).says(0, "--environment <FILE>");
    project
        .run(&gallery, "", &["--size", "640"])
        .says(2, "write width x height in pixels, as in 640x360");
    let ran = project.run(&gallery, "frames", &["flat"]);
    let folder = project.folder.path().canonicalize().expect("it is there");
    let folder = folder.join("target/karat/frames");
    assert_eq!(ran.line(), format!("flat  3 x 2  {path}  {}", files(&folder.to_string_lossy())));

    project.write("frames/main.rs", "fn main() { unready }");
    let ran = project.render("", &["flat"]);
    ran.says(2, "error: can't build the gallery `gallery`, see above\n");
    ran.says(2, "cannot find value `unready`");
    project.write("frames/main.rs", "fn main() { panic!(\"unready\") }");
    project.render("", &["flat"]).says(2, "error: the gallery `gallery` ended early (");
    project.declare("[workspace.metadata.karat]\ngallery = \"galery\"\n");
    let ran = project.render("", &["flat"]);
    ran.says(2, "error: can't build the gallery `galery`, see above\n");
    ran.says(2, "no bin target named `galery`");
}
