//! Tests `karat init`.

use super::report::function;
use super::*;

/// In a project that depends on Karat, `karat init` adds profiles to `Cargo.toml`, so that cargo optimises the packages
/// that take most of the time in tests. `karat init` keeps profiles that the author wrote.
#[test]
fn a_project_gets_the_profiles_that_tests_need() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(&folder.path().join("shaders"), "a.wgsl", "fn f(u: f32) -> f32 { return 0.5 * u; }\n");
    let manifest = "[package]\nname = \"a\"\n\n[profile.dev.package]\nkarat.opt-level = 0";
    write(folder.path(), "Cargo.toml", manifest);
    let read = || std::fs::read_to_string(folder.path().join("Cargo.toml")).expect("it is there");
    // Cargo would warn about profiles of packages that don't exist.
    karat(folder.path(), &["init", "shaders"]).good();
    assert_eq!(read(), manifest);
    write(folder.path(), "Cargo.lock", "[[package]]\nname = \"karat\"\n");
    let ran = karat(folder.path(), &["init", "shaders"]).good();
    assert!(
        ran.contains("added build profiles for karat-core, karat-engine, naga to Cargo.toml"),
        "{ran}"
    );
    // CI also runs the project's Rust tests, and keeps the files that they write.
    karat(folder.path(), &["init", "--github", "--gitlab"]);
    for file in [".github/workflows/karat.yml", ".gitlab-ci.karat.yml"] {
        let text = std::fs::read_to_string(folder.path().join(file)).expect("it is there");
        assert!(
            text.contains("- run: karat test --paths") || text.contains("- karat test --paths"),
            "{text}"
        );
        assert!(text.contains("target/karat") && !text.contains(".karat/run"), "{text}");
    }
    let now: toml::Table = read().parse().expect("TOML");
    let level = |name: &str| now["profile"]["dev"]["package"][name]["opt-level"].as_integer();
    assert_eq!(["karat", "karat-engine", "naga"].map(level), [Some(0), Some(3), Some(1)]);
    let written = read();
    karat(folder.path(), &["init", "shaders"]).good();
    assert_eq!(read(), written, "once");
}

/// If `package.json` depends on Karat, the CI jobs install Karat with npm.
#[test]
fn jobs_of_an_npm_project_use_npm() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(&folder.path().join("shaders"), "m.wgsl", "fn half(x: f32) -> f32 { return 0.5 * x; }\n");
    for (manifest, by_npm) in
        [("{ \"devDependencies\": { \"karat\": \"0.1.0\" } }", true), ("{}", false)]
    {
        write(folder.path(), "package.json", manifest);
        write(folder.path(), "package-lock.json", "{}");
        for file in [".github/workflows/karat.yml", ".gitlab-ci.karat.yml"] {
            drop(std::fs::remove_file(folder.path().join(file)));
        }
        karat(folder.path(), &["init", "shaders", "--github", "--gitlab"]).good();
        let [github, gitlab] = [".github/workflows/karat.yml", ".gitlab-ci.karat.yml"]
            .map(|file| std::fs::read_to_string(folder.path().join(file)).expect("it is written"));
        for text in [&github, &gitlab] {
            assert_eq!(text.contains("npm ci\n"), by_npm, "{text}");
            assert_eq!(text.contains("npx karat test shaders --paths vulkan"), by_npm, "{text}");
            assert_eq!(text.contains("cargo install"), !by_npm, "{text}");
            assert_eq!(text.contains("crates.io"), !by_npm, "{text}");
        }
        assert_eq!(github.contains("actions/setup-node@v4"), by_npm, "{github}");
        assert_eq!(gitlab.contains("image: node:22"), by_npm, "{gitlab}");
    }
}

#[test]
fn a_first_test_is_written_and_passes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(
        &folder.path().join("shaders"),
        "brdf.wgsl",
        "fn count(k: u32) -> u32 { return k + 1u; }\nfn pi() -> f32 { return 3.14159; }\n\
         fn lambert(n_dot_l: f32) -> f32 { return n_dot_l * 0.31830987; }\n",
    );
    write(folder.path(), ".gitignore", "target");
    let ran = karat(folder.path(), &["init", "--github", "--gitlab"]).good();
    for part in [
        "wrote shaders/brdf.test.toml, a test of `brdf::lambert`",
        "added **/.karat/run/, *.new.exr, *.new.csv, *.new.png to .gitignore",
        "wrote .github/workflows/karat.yml",
        "wrote .gitlab-ci.karat.yml",
        "1 check, 0 failed",
        "karat watch shaders",
    ] {
        assert!(ran.contains(part), "no `{part}` in {ran}");
    }
    let read = |file: &str| std::fs::read_to_string(folder.path().join(file)).expect(file);
    assert_eq!(read(".gitignore"), "target\n**/.karat/run/\n*.new.exr\n*.new.csv\n*.new.png\n");
    assert!(read("shaders/brdf.test.toml").contains("finite = true"));
    assert!(read(".github/workflows/karat.yml").contains("karat test shaders --paths vulkan"));
    // The first test fails after a fault is planted.
    write(
        &folder.path().join("shaders"),
        "brdf.wgsl",
        "fn lambert(n_dot_l: f32) -> f32 { return 0.31830987 / n_dot_l; }\n",
    );
    assert_eq!(karat(folder.path(), &["test", "shaders"]).code, Some(1));
    // A second `karat init` overwrites nothing.
    write(
        folder.path(),
        "shaders/brdf.test.toml",
        "[[test]]\nfunction = \"count\"\nno_hazards = true\n",
    );
    write(&folder.path().join("shaders"), "brdf.wgsl", "fn count(k: u32) -> u32 { return k; }\n");
    let again = karat(folder.path(), &["init", "--github"]).good();
    assert!(
        again.contains("the folder has tests already") && again.contains("keeps the existing"),
        "{again}"
    );
    assert!(!read("shaders/brdf.test.toml").contains("finite"));
}

/// If a project has Rust tests, `karat init` writes a test only for a function that no Rust test checks. `karat
/// init` doesn't delete the records of the Rust tests' last run.
#[test]
fn init_skips_functions_that_rust_tests_check() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    let module = "fn f(u: f32) -> f32 { return 0.5 * u; }\nfn g(u: f32) -> f32 { return 0.5 + u; }\n\
                  fn h(u: f32) -> f32 { return 0.5 - u; }\n";
    write(path, "shaders/a.wgsl", module);
    write(path, "Cargo.toml", "[package]\nname = \"a\"\n");
    write(path, ".gitignore", "/target\n.karat/\n*.new.exr\n*.new.csv\n");
    write(path, "tests/a.rs", "SHADERS.function(\"a::f\").over(0.0..=1.0).is_finite();\n");
    let record = path.join("target/karat/record");
    write(&record, "1.jsonl", &function("a::g", "cpu", "pass", None));
    write(&record, "run.json", r#"{"schema":5,"selected":[],"passed":true}"#);
    // `karat init --github` writes only the workflow.
    let ran = karat(path, &["init", "--github"]).good();
    assert!(ran.contains("Karat writes no test, because the project has tests in Rust"), "{ran}");
    assert!(!path.join("shaders/a.test.toml").exists());
    write(path, ".gitignore", "/target\n.karat/\n*.new.exr\n*.new.csv\n");
    let ran = karat(path, &["init"]).good();
    assert!(ran.contains("a test of `a::h`"), "{ran}");
    assert!(ran.contains("added *.new.png to .gitignore"), "{ran}");
    assert!(
        ran.contains("1 passed")
            && ran.contains("this run left the record of the last `karat test`"),
        "{ran}"
    );
    let report = karat(path, &["report"]).good();
    assert!(report.contains("a::g") && !report.contains("a::h"), "{report}");
    // If each function has a test, there is nothing to write and nothing to run.
    std::fs::remove_file(path.join("shaders/a.test.toml")).expect("it was written");
    write(path, "tests/more/b.rs", "SHADERS.function(\"a::h\");\n");
    let ran = karat(path, &["init"]).good();
    assert!(ran.contains("Karat writes no test: each function has a test already"), "{ran}");
    assert!(!path.join("shaders/a.test.toml").exists());
}

/// If the first test fails, the output says what the user should correct.
#[test]
fn a_failing_first_test_of_init_says_what_to_do() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let module =
        "fn lobe(roughness: f32, n_dot_v: f32) -> f32 { return 0.25 / (roughness * n_dot_v); }\n";
    write(folder.path(), "shaders/a.wgsl", module);
    let ran = karat(folder.path(), &["init"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "a test of `a::lobe`",
        "1 check, 1 failed",
        "the first test fails: correct the function, or write in shaders/a.test.toml which inputs your program passes to the function",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in {ran:?}");
    }
    let test = std::fs::read_to_string(folder.path().join("shaders/a.test.toml"));
    let test = test.expect("it was written");
    let over = "# over = { roughness = \"0..1\" }\nfinite = true\n";
    assert!(test.ends_with(over), "{test}");
    let said = test.replace(
        "# over = { roughness = \"0..1\" }",
        "over = { roughness = \"0.1..1\", n_dot_v = \"0.1..1\" }",
    );
    write(folder.path(), "shaders/a.test.toml", &said);
    karat(folder.path(), &["test", "shaders"]).good();
}

// Lesson 181
#[test]
fn init_explains_why_there_is_nothing_to_test() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let init = || karat(folder.path(), &["init"]).error();
    assert!(init().contains("has no .wgsl or .wesl file"), "{}", init());
    write(folder.path(), "a.wgsl", "@compute @workgroup_size(1) fn main() {}\n");
    assert!(
        init().contains("`a::main`") && init().contains("can't write a first test"),
        "{}",
        init()
    );
    write(folder.path(), "a.wgsl", "struct A { x: f32 }\n");
    let nothing = karat(folder.path(), &["init"]);
    assert!(nothing.code == Some(2) && nothing.out.contains("declares no function"), "{nothing:?}");
    // If no test is possible, `karat init` writes nothing, including the files that go with a test.
    let bound = "@group(0) @binding(0) var t: texture_2d<f32>;\n\
                 fn tex(uv: vec2f) -> vec4f { return textureLoad(t, vec2i(uv), 0); }\n";
    write(folder.path(), "b.wgsl", bound);
    let told = init();
    let part = "1 function (`b::tex`): a binding needs a value";
    assert!(told.contains(part), "no `{part}` in {told}");
    let with = karat(folder.path(), &["init", "--github"]).error();
    assert!(with.contains("Karat can't write a first test"), "{with}");
    let left = std::fs::read_dir(folder.path()).expect("there").count();
    assert_eq!(left, 2, "the two modules alone");
    let none = karat(folder.path(), &["init", "nowhere"]).error();
    assert!(none.contains("there is no folder `nowhere`"), "{none}");
}

/// If a pass works only with a single workgroup, `karat init` writes a test that dispatches one workgroup. The test
/// declares a long array by a range, and doesn't list each element.
#[test]
fn a_pass_for_one_workgroup_gets_a_test() {
    let scan = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
        var<workgroup> tile: array<u32, 64>;
        @compute @workgroup_size(64) fn scan(@builtin(local_invocation_id) l: vec3u) {
            tile[l.x] = data[l.x];
            workgroupBarrier();
            for (var by = 1u; by < 64u; by *= 2u) {
                var sum = tile[l.x];
                if l.x >= by { sum += tile[l.x - by]; }
                workgroupBarrier();
                tile[l.x] = sum;
                workgroupBarrier();
            }
            data[l.x] = tile[l.x];
        }\n";
    let bins = "@group(0) @binding(0) var<storage, read> data: array<u32>;
        @group(0) @binding(1) var<storage, read_write> bins: array<atomic<u32>, 256>;
        @compute @workgroup_size(64) fn count(@builtin(global_invocation_id) id: vec3u) {
            if id.x < arrayLength(&data) { atomicAdd(&bins[data[id.x] % 256u], 1u); }
        }\n";
    for (text, name, part) in
        [(scan, "scan", "workgroups = [1, 1, 1]"), (bins, "count", "workgroups = [2, 1, 1]")]
    {
        let folder = tempfile::tempdir().expect("a temporary folder");
        write(folder.path(), "m.wgsl", text);
        let ran = karat(folder.path(), &["init"]).good();
        assert!(ran.contains(&format!("a test of `m::{name}`")), "{ran}");
        let file = folder.path().join("m.test.toml");
        let declared = std::fs::read_to_string(&file).expect("it is written");
        assert!(declared.contains(part), "no `{part}` in {declared}");
        // `karat init` writes a deleted test again.
        std::fs::remove_file(&file).expect("it is there");
        let ran = karat(folder.path(), &["init"]).good();
        assert!(ran.contains(&format!("a test of `m::{name}`")), "{ran}");
    }
}

/// The textures in the test have a texel for each invocation of the dispatch, with random values.
#[test]
fn a_pass_over_images_gets_a_test() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let blur = "@group(0) @binding(0) var source: texture_2d<f32>;
        @group(0) @binding(1) var smooth_: sampler;
        @group(0) @binding(2) var target_: texture_storage_2d<rgba8unorm, write>;
        @compute @workgroup_size(8, 8) fn blur(@builtin(global_invocation_id) id: vec3u) {
            let size = vec2f(textureDimensions(source));
            let at = (vec2f(id.xy) + 0.5) / size;
            var sum = vec4f();
            for (var k = -1; k <= 1; k++) {
                sum += textureSampleLevel(source, smooth_, at + vec2f(f32(k), 0.0) / size, 0.0);
            }
            textureStore(target_, id.xy, sum / 3.0);
        }\n";
    write(folder.path(), "m.wgsl", blur);
    let ran = karat(folder.path(), &["init"]).good();
    assert!(ran.contains("a test of `m::blur`") && ran.contains("1 check, 0 failed"), "{ran}");
    let text = std::fs::read_to_string(folder.path().join("m.test.toml")).expect("it is written");
    for part in ["source = { size = [16, 24], range = \"0..1\" }", "smooth_ = \"linear\""] {
        assert!(text.contains(part), "no `{part}` in {text}");
    }
    write(folder.path(), "m.wgsl", &blur.replace("id.xy, sum", "id.xx, sum"));
    let ran = karat(folder.path(), &["test", "."]);
    assert!(ran.code != Some(0) && ran.out.contains("race on `target_"), "{ran:?}");
}

/// `karat init` chooses the sizes of buffers so that each invocation has an element. The test fails if the pass races.
#[test]
fn a_pass_gets_a_test_of_its_own() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let pass = "struct Params { count: u32, scale: f32 }
        @group(0) @binding(0) var<uniform> params: Params;
        @group(0) @binding(1) var<storage, read> input: array<vec2f>;
        @group(0) @binding(2) var<storage, read_write> sums: array<f32>;
        @compute @workgroup_size(32) fn add(@builtin(global_invocation_id) id: vec3u) {
            if id.x < params.count { sums[id.x] = saturate(input[id.x].x + input[id.x].y) * params.scale; }
        }\n";
    write(folder.path(), "m.wgsl", pass);
    let ran = karat(folder.path(), &["init"]).good();
    for part in ["a test of `m::add`", "1 check, 0 failed"] {
        assert!(ran.contains(part), "no `{part}` in {ran}");
    }
    let text = std::fs::read_to_string(folder.path().join("m.test.toml")).expect("it is written");
    for part in
        ["params = { count = 64, scale = 1.0 }", "no_hazards = true\n", "# [compute.after.sums]\n"]
    {
        assert!(text.contains(part), "no `{part}` in {text}");
    }
    // The first test also fails after a fault is planted.
    let planted = pass.replace("sums[id.x] =", "sums[id.x / 2u] =");
    write(folder.path(), "m.wgsl", &planted);
    assert_eq!(karat(folder.path(), &["test", "."]).code, Some(1));
    std::fs::remove_file(folder.path().join("m.test.toml")).expect("it is there");
    let ran = karat(folder.path(), &["init"]);
    assert!(ran.code == Some(1) && ran.out.contains("the first test fails"), "{ran:?}");
    assert!(ran.out.contains("race on `sums["), "{ran:?}");
}

/// A function that returns no float gets a check for hazards.
// Lesson 181
#[test]
fn a_function_of_integers_gets_a_test() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "shaders/m.wgsl", "fn f(seed: u32) -> u32 { return (seed ^ 61u) * 9u; }");
    let ran = karat(folder.path(), &["init"]).good();
    assert!(ran.contains("a test of `m::f`") && ran.contains("1 check, 0 failed"), "{ran}");
    write(folder.path(), "shaders/m.wgsl", "fn f(seed: u32) -> u32 { return 9u / seed; }");
    assert_eq!(karat(folder.path(), &["test", "shaders"]).code, Some(1));
}

/// `karat init` makes git ignore the files that runs write, wherever the shader folder is.
// Lesson 181
#[test]
fn git_ignores_what_runs_leave() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    write(path, "lib/shaders/m.wgsl", "fn f(u: f32) -> f32 { return 0.5 * u; }\n");
    let git = |arguments: &[&str]| {
        let mut git = Command::new("git");
        let ran = git.current_dir(path).args(arguments).output().expect("git is there");
        String::from_utf8_lossy(&ran.stdout).into_owned()
    };
    git(&["init", "-q"]);
    karat(path, &["init", "lib/shaders"]).good();
    assert!(path.join("lib/shaders/.karat/run/record").is_dir());
    let seen = git(&["status", "--porcelain", "-uall"]);
    assert_eq!(seen, "?? .gitignore\n?? lib/shaders/m.test.toml\n?? lib/shaders/m.wgsl\n");
}

/// `karat init` writes tests into the folder in which `karat test` looks for tests.
// Lesson 181
#[test]
fn init_writes_tests_in_the_declared_folder() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    write(path, "assets/wgsl/m.wgsl", "fn f(u: f32) -> f32 { return 0.5 * u; }\n");
    let manifest =
        "[package]\nname = \"a\"\n[package.metadata.karat]\npackages = [\"assets/wgsl\"]\n";
    write(path, "Cargo.toml", manifest);
    let ran = karat(path, &["init"]).good();
    assert!(ran.contains("wrote assets/wgsl/m.test.toml"), "{ran}");
}

// Lesson 180
#[test]
fn init_writes_in_ci_only_with_ci_may_write() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "m.wgsl", "fn f(u: f32) -> f32 { return 0.5 * u; }\n");
    let init = |more: &[&str]| {
        output(command(folder.path(), &[&["init"], more].concat()).env("CI", "true"))
    };
    let error = init(&[]).error();
    assert!(error.contains("`CI` is set") && error.contains("--ci-may-write"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("there").count(), 1);
    init(&["--ci-may-write"]).good();
    assert!(folder.path().join("m.test.toml").is_file());
}

/// If a project has a `package.json`, `karat init` adds a script that runs the tests. The tests require Tint only if
/// Tint's npm package, `webgpu`, is listed in `package.json` and installed.
#[test]
fn a_project_for_the_web_gets_a_script() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let manifest = "{\n  \"scripts\": {\n    \"dev\": \"vite\"\n  }\n}\n";
    write(folder.path(), "package.json", manifest);
    let shader = "fn reinhard(luminance: f32) -> f32 { return luminance / (1.0 + luminance); }\n";
    write(&folder.path().join("src/shaders"), "tone.wgsl", shader);
    let init = || {
        let mut command = command(folder.path(), &["init", "src/shaders"]);
        output(command.env("KARAT_PATHS", "cpu").env("KARAT_TINT", "off"))
    };
    let said = init().good();
    assert!(said.contains("added `npm run test:shaders`"), "{said}");
    assert!(
        said.contains(
            "because package.json doesn't list this compiler: run `npm install --save-dev webgpu`"
        ),
        "{said}"
    );
    let manifest = std::fs::read_to_string(folder.path().join("package.json")).expect("there");
    let script = "    \"test:shaders\": \"karat test src/shaders\",\n    \"dev\": \"vite\"\n";
    assert!(manifest.contains(script), "{manifest}");
    assert!(!folder.path().join("src/shaders/karat.toml").exists(), "nothing requires Tint");
    init().good();
    let again = std::fs::read_to_string(folder.path().join("package.json")).expect("there");
    assert_eq!(again, manifest, "once is enough");
    // The project depends on `webgpu`, but this machine hasn't installed it.
    let with = manifest.replacen('{', "{ \"devDependencies\": { \"webgpu\": \"0.3\" },", 1);
    write(folder.path(), "package.json", &with);
    let said = init().good();
    assert!(said.contains("the tests don't require Chrome's compiler: "), "{said}");
}

/// `karat init` reports an invalid module, and writes tests for the valid modules.
/// Also tests that `karat matrix` and `karat compare` accept a folder.
#[test]
fn init_writes_tests_for_the_valid_modules() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaders = folder.path().join("src/wgsl");
    write(&shaders, "tone.wgsl", "fn tone(x: f32) -> f32 { return x / (1.0 + abs(x)); }\n");
    write(&shaders, "use.wgsl", "fn shade(x: f32) -> f32 { return tone(x); }\n");
    let run = |arguments: &[&str]| {
        let mut command = command(folder.path(), arguments);
        output(command.env("KARAT_PATHS", "cpu").env("KARAT_TINT", "off"))
    };
    let red = |ran: Ran| {
        assert_eq!(ran.code, Some(1), "{ran:?}");
        ran.out
    };
    let said = red(run(&["init", "src/wgsl"]));
    for part in [
        "`tone` declares `tone`: write `import package::tone::tone;`",
        "the tests of these modules fail until you correct the modules",
        "tone.test.toml, a test of `tone::tone`",
        "1 module isn't valid: use; 1 check passed",
    ] {
        assert!(said.contains(part), "no `{part}` in {said}");
    }
    assert!(!said.contains("the first test fails"), "{said}");
    write(&shaders, "karat.toml", "[join]\nuse = [\"tone\"]\n");
    run(&["check", "src/wgsl"]).good();
    let matrix = run(&["matrix", "src/wgsl", "--columns", "vulkan,cpu"]).good();
    assert!(matrix.contains("of 2 rows"), "{matrix}");
    let before = folder.path().join("before");
    write(&before, "tone.wgsl", "fn tone(x: f32) -> f32 { return x / (2.0 + abs(x)); }\n");
    let compared = red(run(&["compare", "before", "src/wgsl"]));
    assert!(compared.contains("changed") && compared.contains("tone::tone"), "{compared}");
}

/// Karat ignores shaders in `node_modules`. For each command, the package is the folder that contains all modules.
#[test]
fn the_folder_that_has_all_modules_is_found() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    write(path, "package.json", "{}\n");
    write(path, "node_modules/a/shaders/lib.wgsl", "fn broken( {\n");
    let draws = "@fragment fn main(@location(0) uv: vec2f) -> @location(0) vec4f {\n    \
                 return vec4f(fract(uv), 0.0, 1.0);\n}\n";
    write(path, "src/shaders/draw.wgsl", draws);
    let run = |arguments: &[&str]| {
        let mut command = command(path, arguments);
        output(command.env("KARAT_PATHS", "cpu").env("KARAT_TINT", "off"))
    };
    // A module with only entry points also gets a test.
    let said = run(&["init"]).good();
    assert!(said.contains("wrote src/shaders/draw.test.toml, a test of `draw::main`"), "{said}");
    assert!(said.contains("karat watch src/shaders"), "{said}");
    // For each command, imports begin at that folder.
    write(
        path,
        "src/shaders/noise.wgsl",
        "import package::draw::main;\nfn one() -> f32 { return 1.0; }\n",
    );
    let list = run(&["list"]).good();
    assert!(list.contains("noise::one() -> f32") && !list.contains("src::"), "{list}");
    let row = list.lines().find(|line| line.contains("draw::main")).unwrap_or_default();
    assert!(row.contains("  yes  "), "the record of its test is found: {list}");
    run(&["test"]).good();
    run(&["hazards", "--only", "one"]).good();
    // No command finds a package within a package.
    write(path, "karat.toml", "");
    let error = run(&["init", "src/shaders"]).error();
    assert!(error.contains("contains the folder `src/shaders`: run `karat init .`"), "{error}");
}
