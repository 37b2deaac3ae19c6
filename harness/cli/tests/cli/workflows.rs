//! Tests the files for CI systems: workflows, an action for GitHub, and a template for GitLab. The tests use no CI
//! runner: they read the steps, parse the steps' shell scripts, and run the scripts that need no network. The tests
//! don't run on Windows, where the first `bash` in `PATH` may be another program.

use yaml_rust2::{Yaml, YamlLoader};

use super::*;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
const ACTION: &str = "ci/action/action.yml";
const TEMPLATE: &str = "ci/gitlab/karat.yml";
const FILES: [&str; 7] = [
    ACTION,
    TEMPLATE,
    ".github/workflows/ci.yml",
    ".github/workflows/full.yml",
    ".github/workflows/release.yml",
    "harness/cli/src/cli/init/github.yml",
    "harness/cli/src/cli/init/gitlab.yml",
];

fn read(file: &str) -> Yaml {
    let text = std::fs::read_to_string(FilePath::new(ROOT).join(file)).expect(file);
    let mut documents = YamlLoader::load_from_str(&text).unwrap_or_else(|e| panic!("{file}: {e}"));
    assert_eq!(documents.len(), 1, "{file}");
    documents.remove(0)
}

/// Collects the shell script of each step, at any depth.
fn scripts(yaml: &Yaml, found: &mut Vec<String>) {
    match yaml {
        Yaml::Hash(members) => {
            for (name, value) in members {
                match (name.as_str(), value) {
                    (Some("run"), Yaml::String(script)) => found.push(script.clone()),
                    (Some("script" | "before_script"), Yaml::Array(lines)) => {
                        found.extend(lines.iter().filter_map(Yaml::as_str).map(str::to_owned));
                    }
                    _ => scripts(value, found),
                }
            }
        }
        Yaml::Array(items) => items.iter().for_each(|item| scripts(item, found)),
        _ => {}
    }
}

fn scripts_of(file: &str) -> Vec<String> {
    let mut found = Vec::new();
    scripts(&read(file), &mut found);
    found
}

fn steps() -> Vec<Yaml> {
    read(ACTION)["runs"]["steps"].as_vec().expect("steps").clone()
}

fn step(name: &str) -> Yaml {
    let found = steps().into_iter().find(|step| step["name"].as_str() == Some(name));
    found.unwrap_or_else(|| panic!("no step `{name}`"))
}

#[test]
fn bash_can_parse_every_workflow_script() {
    for file in FILES {
        let scripts = scripts_of(file);
        assert!(!scripts.is_empty(), "{file}");
        for script in scripts {
            // GitHub would insert text from strangers into the script. The steps use variables instead.
            assert!(!script.contains("${{"), "{file}: {script}");
            let ran = output(Command::new("bash").args(["-n", "-c", &script]));
            assert_eq!(ran.code, Some(0), "{file}: {script}\n{ran:?}");
        }
    }
}

/// The action uses each input that it declares, and declares each input that it uses.
#[test]
fn the_action_uses_each_of_its_inputs() {
    let action = read(ACTION);
    assert_eq!(action["runs"]["using"].as_str(), Some("composite"));
    let inputs: Vec<&str> =
        action["inputs"].as_hash().expect("inputs").keys().filter_map(Yaml::as_str).collect();
    let text = std::fs::read_to_string(FilePath::new(ROOT).join(ACTION)).expect(ACTION);
    for input in &inputs {
        let input = &action["inputs"][*input];
        assert!(input["description"].as_str().is_some() && input["default"].as_str().is_some());
    }
    let mut used: Vec<&str> =
        text.split("inputs.").skip(1).filter_map(|rest| rest.split_whitespace().next()).collect();
    used.sort_unstable();
    used.dedup();
    let used: Vec<&str> =
        used.into_iter().map(|name| name.split('/').next().unwrap_or(name)).collect();
    let mut sorted = inputs.clone();
    sorted.sort_unstable();
    assert_eq!(used, sorted);
    for step in steps() {
        // A composite action has no default shell.
        assert!(step["run"].is_badvalue() || step["shell"].as_str() == Some("bash"), "{step:?}");
        // Karat would refuse an unknown variable with its prefix.
        for (name, _) in step["env"].as_hash().into_iter().flatten() {
            let name = name.as_str().expect("a name");
            assert!(
                !name.starts_with("KARAT_") || ["KARAT_PATHS", "KARAT_REQUIRE"].contains(&name)
            );
        }
    }
    // The guide has a row for each input.
    let guide = std::fs::read_to_string(FilePath::new(ROOT).join("docs/guide/ci.md"));
    let guide = guide.expect("the chapter");
    for input in inputs {
        assert!(guide.contains(&format!("`{input}`")), "{input}");
    }
}

/// The guide's samples are valid YAML, and name inputs and a job that exist.
#[test]
fn samples_of_the_guide_use_what_is_there() {
    let guide = std::fs::read_to_string(FilePath::new(ROOT).join("docs/guide/ci.md"));
    let guide = guide.expect("the chapter");
    let samples: Vec<Yaml> = guide
        .split("```yaml\n")
        .skip(1)
        .filter_map(|rest| rest.split("```").next())
        .map(|text| YamlLoader::load_from_str(text).expect("YAML").remove(0))
        .collect();
    assert_eq!(samples.len(), 2);
    let step = &samples[0]["jobs"]["karat"]["steps"][1];
    assert!(step["uses"].as_str().is_some_and(|uses| uses.contains("/ci/action@")));
    for (input, _) in step["with"].as_hash().expect("inputs") {
        let input = input.as_str().expect("a name");
        assert!(!read(ACTION)["inputs"][input].is_badvalue(), "{input}");
    }
    assert_eq!(samples[1]["include"][0]["file"].as_str(), Some(TEMPLATE));
    let template = read(TEMPLATE);
    let job = &template[samples[1]["shaders"]["extends"].as_str().expect("a job")];
    for (variable, _) in samples[1]["shaders"]["variables"].as_hash().expect("variables") {
        let variable = variable.as_str().expect("a name");
        assert!(!job["variables"][variable].is_badvalue(), "{variable}");
    }
}

fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "engine/my_shaders/a.wgsl", GOOD);
    folder
}

const GOOD: &str = "import karat::expect_near;\n\
    fn half(x: f32) -> f32 { return 0.5 * x; }\n\
    @test fn half_of_two() { expect_near(half(2.0), 1.0, 1e-6); }\n";

/// Returns a command that runs a script as a CI runner does, with the tested `karat` in `PATH`.
fn runner(script: &str, folder: &FilePath) -> Command {
    let mut command = command(folder, &[]);
    let karat = FilePath::new(env!("CARGO_BIN_EXE_karat")).parent().expect("a folder").to_owned();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let path = std::env::join_paths([karat].into_iter().chain(std::env::split_paths(&path)));
    let mut shell = Command::new("bash");
    shell.args(["--noprofile", "--norc", "-eo", "pipefail", "-c", script]);
    shell.current_dir(folder).env("PATH", path.expect("a path"));
    for (name, value) in command.stdin(Stdio::null()).get_envs() {
        match value {
            Some(value) => shell.env(name, value),
            None => shell.env_remove(name),
        };
    }
    shell
}

/// The action's step runs a folder of tests. If a test fails, GitHub gets an annotation with the file's path in the
/// repository.
// Lesson 135
#[test]
fn the_step_of_the_action_runs_tests() {
    let repository = folder();
    let here = repository.path().join("engine");
    let test = step("Test");
    let script = test["run"].as_str().expect("a script");
    let run = |arguments: &str| {
        let mut command = runner(script, &here);
        command.env("ARGUMENTS", arguments).env("KARAT_PATHS", "cpu").env("KARAT_REQUIRE", "");
        command.env("GITHUB_ACTIONS", "true").env("GITHUB_WORKSPACE", repository.path());
        output(command.env("HOME", repository.path()))
    };
    let ran = run("my_shaders --all").good();
    assert!(ran.contains("a::half_of_two") && ran.contains("1 check, 0 failed"), "{ran}");
    // An empty path means the project itself.
    assert!(run("").good().contains("1 check, 0 failed"));
    write(&here, "my_shaders/a.wgsl", &GOOD.replace("0.5", "0.4"));
    let ran = run("my_shaders");
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let annotation = "::error file=engine/my_shaders/a.wgsl,line=3,";
    assert!(ran.out.contains(annotation), "{ran:?}");
    // A path that doesn't exist is an error.
    let mut command = runner(script, &here);
    command.env("ARGUMENTS", "my_shaders").env("KARAT_PATHS", "cpu").env("KARAT_REQUIRE", "dx12");
    assert_eq!(output(command.env("HOME", repository.path())).code, Some(1));
}

/// The hash by which the action names a cached build depends only on Karat's sources.
#[test]
fn the_build_of_the_action_is_named_by_its_sources() {
    let script = step("Sources");
    let script = script["run"].as_str().expect("a script");
    let action = tempfile::tempdir().expect("a temporary folder");
    for file in ["Cargo.toml", "Cargo.lock", "harness/a.rs", "harness/b c.rs", "ci/action/x"] {
        write(action.path(), file, file);
    }
    let hash = || {
        let out = action.path().join("output");
        let _ = std::fs::remove_file(&out);
        let mut command = runner(script, action.path());
        command.env("ACTION", action.path().join("ci/action")).env("GITHUB_OUTPUT", &out);
        assert_eq!(output(&mut command).code, Some(0));
        let text = std::fs::read_to_string(out).expect("written");
        let hash = text.trim().strip_prefix("hash=").expect("an output").to_owned();
        assert_eq!(hash.len(), 40, "{hash}");
        hash
    };
    let first = hash();
    write(action.path(), "ci/action/x", "other");
    assert_eq!(hash(), first);
    write(action.path(), "harness/b c.rs", "other");
    assert_ne!(hash(), first);
}

/// The template's command runs a folder of tests and writes its report.
#[test]
fn the_line_of_the_template_runs_tests() {
    let repository = folder();
    let here = repository.path().join("engine");
    let template = read(TEMPLATE);
    let job = &template[".karat"];
    let line = job["script"][0].as_str().expect("a line");
    let report = job["artifacts"]["reports"]["junit"].as_str().expect("a file");
    for (name, _) in job["variables"].as_hash().expect("variables") {
        let name = name.as_str().expect("a name");
        assert!(!name.starts_with("KARAT_") || ["KARAT_PATHS", "KARAT_REQUIRE"].contains(&name));
    }
    let mut command = runner(line, &here);
    command.env("ARGUMENTS", "my_shaders").env("KARAT_PATHS", "cpu").env("KARAT_REQUIRE", "");
    output(command.env("CI_PROJECT_DIR", repository.path())).good();
    let text = std::fs::read_to_string(here.join(report)).expect("the report");
    assert!(text.contains("file=\"engine/my_shaders/a.wgsl\" line=\"3\""), "{text}");
}

/// A failure of the CI job `elsewhere`, which isn't verified, doesn't make the run fail. A failure of any other job
/// makes the run fail.
#[test]
fn only_unverified_ci_jobs_may_fail() {
    let workflow = read(".github/workflows/ci.yml");
    let jobs = workflow["jobs"].as_hash().expect("jobs");
    let lenient = |job: &Yaml| job["continue-on-error"].as_bool() == Some(true);
    let names: Vec<_> =
        jobs.iter().filter(|(_, job)| lenient(job)).filter_map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["elsewhere"]);
    for (name, job) in jobs {
        let runs =
            job["steps"].as_vec().expect("steps").iter().any(|step| {
                step["run"].as_str().is_some_and(|run| run.starts_with("cargo ci test"))
            });
        assert!(runs, "{name:?}");
    }
}

/// Starts an HTTP server for `files` on this machine, and returns its URL. Other paths return 404.
#[cfg(unix)]
fn served(files: Vec<(String, Vec<u8>)>) -> String {
    use std::io::{BufRead as _, BufReader, Write as _};
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("its address");
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(mut stream) = stream else { continue };
            let mut lines = BufReader::new(&stream).lines().map_while(Result::ok);
            let first = lines.next().unwrap_or_default();
            // The head of a request ends with an empty line.
            lines.take_while(|line| !line.is_empty()).for_each(drop);
            let path = first.split(' ').nth(1).unwrap_or_default();
            let found = files.iter().find(|(name, _)| name == path);
            let (status, body): (&str, &[u8]) = match found {
                Some((_, body)) => ("200 OK", body),
                None => ("404 Not Found", b""),
            };
            let length = body.len();
            let head = format!(
                "HTTP/1.1 {status}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
            );
            drop(stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body)));
        }
    });
    format!("http://{address}")
}

/// A release for this machine is used if its checksum is right. A wrong checksum ends the job, and without a release
/// the job builds Karat.
#[cfg(all(unix, target_arch = "x86_64", target_os = "linux"))]
#[test]
fn released_archives_are_taken_with_their_checksum() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let stem = "karat-0.9.0-x86_64-unknown-linux-gnu";
    let program = folder.path().join(stem).join("karat");
    write(&folder.path().join(stem), "karat", "#!/bin/sh\necho from an archive\n");
    let mut mode = Command::new("chmod");
    assert_eq!(output(mode.arg("+x").arg(&program)).code, Some(0));
    let mut tar = Command::new("tar");
    let packed = tar.current_dir(folder.path()).args(["-czf", "a.tar.gz", stem]);
    assert_eq!(output(packed).code, Some(0));
    let archive = std::fs::read(folder.path().join("a.tar.gz")).expect("packed");
    let sum = output(Command::new("sha256sum").current_dir(folder.path()).arg("a.tar.gz")).good();
    let digest = sum.split(' ').next().expect("a digest").to_owned();
    let file =
        |version: &str| format!("/v{version}/karat-{version}-x86_64-unknown-linux-gnu.tar.gz");
    let wrong = digest.replace(|c: char| c.is_ascii_digit(), "f");
    let at = served(vec![
        (file("0.9.0"), archive.clone()),
        (file("0.9.0") + ".sha256", format!("{digest}  another.tar.gz\n").into_bytes()),
        (file("0.9.1"), archive.clone()),
        (file("0.9.1") + ".sha256", format!("{wrong}  a.tar.gz\n").into_bytes()),
        (file("0.9.2"), archive.clone()),
        (file("0.9.3"), archive),
        (file("0.9.3") + ".sha256", b"<html>".to_vec()),
    ]);
    let script = FilePath::new(ROOT).join("ci/download.sh");
    for (version, code, message) in [
        ("0.9.0", 0, ""),
        ("0.9.1", 1, "has the checksum"),
        ("0.9.2", 1, "has no checksum beside it"),
        ("0.9.3", 1, "has the checksum"),
        ("0.9.4", 3, "there is no archive at"),
    ] {
        let to = folder.path().join("to").join(version);
        let mut sh = Command::new("sh");
        let ran = output(sh.arg(&script).args([&at, version]).arg(&to));
        assert_eq!(ran.code, Some(code), "{version}: {ran:?}");
        assert!(ran.err.contains(message), "{version}: {ran:?}");
        let program = to.join("bin/karat");
        assert_eq!(program.exists(), code == 0, "{version}");
        if code == 0 {
            assert_eq!(output(&mut Command::new(program)).good(), "from an archive\n");
        }
    }
    // The action's step prints the result, and ends the job at a wrong checksum.
    let script = step("Archive")["run"].as_str().expect("a script").to_owned();
    let home = folder.path().join("home");
    for (releases, version, code, found) in [
        (at.as_str(), "v0.9.0", 0, "found=yes\n"),
        (&at, "v0.9.1", 1, ""),
        (&at, "v0.9.4", 0, "found=no\n"),
        // The revision isn't a release, or the host has no server.
        (&at, "main", 0, "found=no\n"),
        ("http://127.0.0.1:9", "v0.9.0", 0, "found=no\n"),
    ] {
        let said = folder.path().join("said");
        let mut bash = Command::new("bash");
        bash.args(["-e", "-c", &script]).env("HOME", &home).env("RELEASES", releases);
        bash.env("REF", version);
        std::fs::write(&said, "").expect("written");
        let action = FilePath::new(ROOT).join("ci/action");
        let ran = output(bash.env("ACTION", action).env("GITHUB_OUTPUT", &said));
        assert_eq!(ran.code, Some(code), "{version}: {ran:?}");
        assert_eq!(std::fs::read_to_string(&said).expect("written"), found, "{version}: {ran:?}");
    }
}
