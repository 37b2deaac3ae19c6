//! Tests shaders of crates, which commands find by the crates' names.

use super::*;

fn manifest(name: &str, dependencies: &str) -> String {
    format!(
        "[package]\nname = \"{name}\"\nversion = \"1.2.3\"\nedition = \"2024\"\n\n\
         [dependencies]\n{dependencies}"
    )
}

const MATHS: &str = "const PI: f32 = 3.14159265;\n\n// Whoever depends on whom.\n\
                     import engine_pbr::lights::GAIN;\n\n\
                     fn twice(x: f32) -> f32 {\n    return GAIN * x;\n}\n";

const LIGHTS: &str = "import engine_core::maths::PI;\n\nconst GAIN: f32 = 2.0;\n\n\
                      @if(DOUBLE) const FACTOR = 2.0;\n@if(!DOUBLE) const FACTOR = 1.0;\n\n\
                      fn flux(intensity: f32) -> f32 {\n    return 4.0 * PI * intensity * FACTOR;\n}\n";

fn crates(folder: &FilePath) {
    let (core, pbr, tool) =
        (folder.join("engine-core"), folder.join("engine-pbr"), folder.join("tool"));
    write(&core, "Cargo.toml", &manifest("engine-core", ""));
    write(&core.join("src"), "lib.rs", "");
    write(&core.join("src"), "maths.wesl", MATHS);
    write(
        &pbr,
        "Cargo.toml",
        &manifest("engine-pbr", "engine-core = { path = \"../engine-core\" }\n"),
    );
    write(&pbr.join("src"), "lib.rs", "");
    write(&pbr.join("src"), "lights.wesl", LIGHTS);
    write(&pbr.join("shaders"), "other.wgsl", "fn one(x: f32) -> f32 { return 1.0; }\n");
    write(&tool, "Cargo.toml", &manifest("tool", ""));
    write(&tool.join("src"), "lib.rs", "");
}

struct Place {
    folder: TempDir,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        crates(&folder.path().join("crates"));
        let dependencies = "engine-pbr = { path = \"../crates/engine-pbr\" }\n\
                            tool = { path = \"../crates/tool\" }\n";
        let game = folder.path().join("game");
        write(&game, "Cargo.toml", &(manifest("game", dependencies) + "\n[workspace]\n"));
        write(&game.join("src"), "lib.rs", "");
        Self { folder }
    }

    fn karat(&self, within: &str, arguments: &[&str]) -> Ran {
        let mut command = command(&self.folder.path().join(within), arguments);
        if let Some(cargo) = std::env::var_os("CARGO") {
            command.env("CARGO", cargo);
        }
        // The home folder keeps Cargo's output for Karat. Cargo must not use the network.
        let home = self.folder.path().join("home");
        let ran = output(command.env("CARGO_HOME", home).env("CARGO_NET_OFFLINE", "true"));
        let folder = self.folder.path().canonicalize().expect("it is there").display().to_string();
        let own = |text: String| {
            text.replace(&folder, "").replace(&self.folder.path().display().to_string(), "")
        };
        Ran { code: ran.code, out: own(ran.out), err: own(ran.err) }
    }

    fn kept(&self) -> usize {
        std::fs::read_dir(self.folder.path().join("home/karat")).map_or(0, Iterator::count)
    }
}

#[test]
fn a_crate_that_the_project_builds_opens_by_its_name() {
    let place = Place::new();
    for name in ["engine-pbr", "engine_pbr"] {
        let list = place.karat("game", &["list", "--crate", name]).good();
        assert!(list.contains("lights::flux(intensity: f32) -> f32"), "{list}");
        assert!(list.contains("/crates/engine-pbr/src/lights.wesl:8:4"), "{list}");
    }
    let call = |arguments: &[&str]| {
        let all = [&["call", "lights::flux", "1", "--crate", "engine-pbr"], arguments].concat();
        place.karat("game", &all).good()
    };
    assert!(call(&[]).contains(" 12.566371"), "{}", call(&[]));
    assert!(call(&["--feature", "DOUBLE"]).contains(" 25.132742"));
    assert!(call(&["--feature", "DOUBLE=false"]).contains(" 12.566371"));
    let other = ["list", "--crate", "engine-pbr", "--root", "shaders"];
    assert!(place.karat("game", &other).good().contains("other::one"));
    // The command also works in a folder below the project.
    assert!(place.karat("game/src", &["list", "--crate", "engine-pbr"]).good().contains("flux"));
}

#[test]
fn a_crate_that_is_imported_from_may_have_another_folder() {
    let place = Place::new();
    let call = |roots: &[&str]| {
        let plain = ["call", "lights::flux", "1", "--crate", "engine-pbr"];
        place.karat("game", &[&plain, roots].concat())
    };
    let other = place.folder.path().join("crates/engine-core/wgsl");
    write(&other, "maths.wesl", "const PI: f32 = 3.0;\n");
    assert!(call(&[]).good().contains(" 12.566371"));
    for name in ["engine-core=wgsl", "engine_core=wgsl"] {
        let said = call(&["--root", name]).good();
        assert!(said.contains(" 12 "), "{name}: {said}");
    }
    assert!(call(&["--root", "src", "--root", "engine-core=wgsl"]).good().contains(" 12 "));
    for (roots, part) in [
        (&["--root", "engine-core=wgls"][..], "engine-core`: the crate has no folder `"),
        (&["--root", "engine-cor=wgsl"], "no crate of this name that has shaders; did you mean"),
        (&["--root", "a", "--root", "b"], "a crate can have only one folder of modules"),
    ] {
        let error = call(roots).error();
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn the_metadata_of_cargo_is_cached_until_the_lock_file_changes() {
    let place = Place::new();
    let list = |name: &str| place.karat("game", &["list", "--crate", name]);
    list("engine-pbr").good(); // Cargo writes the lock file
    list("engine-pbr").good();
    assert_eq!(place.kept(), 1);
    list("engine-core").good();
    assert_eq!(place.kept(), 1);
    assert!(list("late").error().contains("the project doesn't depend on the crate"));
    let late = place.folder.path().join("crates/late");
    write(&late, "Cargo.toml", &manifest("late", ""));
    write(&late.join("src"), "lib.rs", "");
    write(&late.join("src"), "a.wgsl", "fn f(x: f32) -> f32 { return x; }\n");
    let game = place.folder.path().join("game");
    let text = std::fs::read_to_string(game.join("Cargo.toml")).expect("it is there");
    let with =
        text.replace("[dependencies]\n", "[dependencies]\nlate = { path = \"../crates/late\" }\n");
    write(&game, "Cargo.toml", &with);
    assert!(list("late").good().contains("a::f"));
    // A crate beside the project gets its first shader, and then another folder for its modules.
    let tool = place.folder.path().join("crates/tool");
    assert!(list("tool").error().contains("the crate ships no .wgsl or .wesl file"));
    write(&tool.join("src"), "first.wgsl", "fn first(x: f32) -> f32 { return x; }\n");
    assert!(list("tool").good().contains("first::first"));
    write(&tool.join("shaders"), "second.wgsl", "fn second(x: f32) -> f32 { return x; }\n");
    let rooted = manifest("tool", "") + "\n[package.metadata.karat]\nroot = \"shaders\"\n";
    write(&tool, "Cargo.toml", &rooted);
    assert!(list("tool").good().contains("second::second"));
    // Karat doesn't use a stored folder that no longer exists.
    std::fs::rename(&late, late.with_file_name("later")).expect("renamed");
    assert!(list("late").error().contains("cargo says:"));
}

/// Without a project, `--crate NAME@VERSION` makes Cargo fetch the crate. In this test, a folder replaces crates.io.
// Lesson 34
#[test]
fn a_crate_at_a_version_needs_no_project() {
    let place = Place::new();
    let folder = place.folder.path();
    for (name, imports) in [("engine-core", "engine-pbr"), ("engine-pbr", "engine-core")] {
        let krate = folder.join("crates").join(name);
        let vendored = folder.join("vendor").join(format!("{name}-1.2.3"));
        let metadata = format!(
            "\n[package.metadata.wgsl-analyzer.dependencies]\n{imports} = {{ path = \"../{imports}\" }}\n"
        );
        write(&vendored, "Cargo.toml", &(manifest(name, "") + &metadata));
        write(&vendored, ".cargo-checksum.json", "{\"files\":{}}");
        for file in ["lib.rs", "maths.wesl", "lights.wesl"] {
            if let Ok(text) = std::fs::read_to_string(krate.join("src").join(file)) {
                write(&vendored.join("src"), file, &text);
            }
        }
    }
    let config = format!(
        "[source.crates-io]\nreplace-with = \"here\"\n[source.here]\ndirectory = {:?}\n",
        folder.join("vendor")
    );
    write(&folder.join("home"), "config.toml", &config);
    std::fs::create_dir(folder.join("nowhere")).expect("a folder");
    let call = ["call", "lights::flux", "1", "--crate", "engine-pbr@1.2.3"];
    // The crate imports from a crate that isn't a dependency. Its metadata names that crate.
    assert!(place.karat("nowhere", &call).good().contains(" 12.566371"));
    assert_eq!(place.kept(), 1);
    std::fs::rename(folder.join("home/config.toml"), folder.join("config")).expect("renamed");
    assert!(place.karat("nowhere", &call).good().contains(" 12.566371"), "cargo isn't asked again");
    let unknown = place.karat("nowhere", &["list", "--crate", "engine-pbr@9.9.9"]).error();
    assert!(
        unknown.contains("Karat can't open the shaders of crate `engine-pbr@9.9.9`: cargo says:"),
        "{unknown}"
    );
    assert_eq!(place.kept(), 1, "nothing is left of what failed");
}

/// The shaders of a crate's examples may import from the crate's development dependencies. Cargo doesn't fetch
/// development dependencies with the crate, so Karat asks Cargo for each imported crate.
#[test]
fn examples_import_development_dependencies() {
    let place = Place::new();
    let folder = place.folder.path();
    let vendored = |name: &str, more: &str, shader: &str, text: &str| {
        let vendored = folder.join("vendor").join(format!("{name}-1.2.3"));
        write(&vendored, "Cargo.toml", &(manifest(name, "") + more));
        write(&vendored, ".cargo-checksum.json", "{\"files\":{}}");
        write(&vendored.join("src"), "lib.rs", "");
        write(&vendored.join("examples"), shader, text);
    };
    vendored("sky-kit", "", "sky.wesl", "fn twice(x: f32) -> f32 { return 2.0 * x; }\n");
    let example =
        "import sky_kit::sky::twice;\nfn four(x: f32) -> f32 { return twice(twice(x)); }\n";
    let developed = |more: &str| format!("\n[dev-dependencies]\n{more}unrelated = \"9.9.9\"\n");
    vendored("clouds", &developed("sky-kit = \"1.2\"\n"), "clouds.wesl", example);
    // If an imported crate isn't available, only this import isn't found, and the rest of the crate works.
    let gone = example.replace("twice", "thrice").replace("sky_kit", "gone_kit");
    vendored("rain", &developed("gone-kit = \"1.2\"\n"), "rain.wesl", &gone);
    let config = format!(
        "[source.crates-io]\nreplace-with = \"here\"\n[source.here]\ndirectory = {:?}\n",
        folder.join("vendor")
    );
    write(&folder.join("home"), "config.toml", &config);
    std::fs::create_dir(folder.join("nowhere")).expect("a folder");
    let call = ["call", "clouds::four", "3", "--crate", "clouds@1.2.3"];
    assert!(place.karat("nowhere", &call).good().contains(" 12"));
    let rain = place.karat("nowhere", &["list", "--crate", "rain@1.2.3"]);
    assert!(
        rain.out.contains("no dependency `gone_kit`") && rain.out.contains("rain::four"),
        "{rain:?}"
    );
}

#[test]
fn a_crate_that_cannot_be_had_says_why() {
    let place = Place::new();
    for (name, message) in [
        (
            "engine-pbs",
            "the project doesn't depend on the crate; did you mean `engine-pbr`? If you add a version",
        ),
        (
            "serde",
            "the project doesn't depend on the crate. If you add a version, such as `serde@1.2.3`, cargo",
        ),
        ("tool", "the crate ships no .wgsl or .wesl file"),
        ("a b", "write a name, or a name and a version"),
        ("../tool", "write a name, or a name and a version"),
        ("tool@", "write a name, or a name and a version"),
        ("tool@1.2", "write the whole version, such as `tool@1.2.3`"),
    ] {
        let error = place.karat("game", &["list", "--crate", name]).error();
        assert!(
            error.contains(&format!("Karat can't open the shaders of crate `{name}`: {message}")),
            "{error}"
        );
    }
    let root = place.karat("game", &["list", "--crate", "engine-pbr", "--root", "shadrs"]).error();
    assert!(root.contains("the crate has no folder `"), "{root}");
    std::fs::create_dir(place.folder.path().join("nowhere")).expect("a folder");
    let nowhere = place.karat("nowhere", &["list", "--crate", "engine-pbr"]).error();
    assert!(nowhere.contains("there is no Cargo.toml in or above"), "{nowhere}");
    let slip = ["call", "lights::flux", "1", "--crate", "engine-pbr", "--feature", "DUOBLE"];
    let slip = place.karat("game", &slip).error();
    assert!(slip.contains("uses the feature `DUOBLE`; did you mean `DOUBLE`?"), "{slip}");
    for feature in ["=3", "A=x", "a-b"] {
        let ran = place.karat("game", &["list", "--feature", feature]);
        assert_eq!(ran.code, Some(2), "{ran:?}");
        assert!(ran.err.contains("a feature"), "{ran:?}");
    }
}
