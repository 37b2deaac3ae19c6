//! Tests `karat mutate`.

use std::path::PathBuf;

use super::*;
use crate::repository::git;

const SHADER: &str = "fn half(x: f32) -> f32 { return 0.5 * x; }\n\
                      fn lonely(x: f32) -> f32 { return x + 3.0; }\n";

const TESTS: &str =
    "[[test]]\nfunction = \"half\"\nover = { x = 2 }\nequals = 1\ntolerance = \"1 ulp\"\n";

fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(&folder.path().join("shaders"), "calc.wgsl", SHADER);
    write(&folder.path().join("shaders"), "calc.test.toml", TESTS);
    folder
}

fn files(folder: &FilePath) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        match entry.path() {
            path if path.is_dir() => all.extend(files(&path)),
            path => all.push(path),
        }
    }
    all.sort();
    all
}

#[test]
fn mutants_are_killed_or_listed() {
    let folder = folder();
    let before = files(folder.path());
    let ran = karat(folder.path(), &["mutate"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "no test shaders/calc.wgsl:2:35 `x + 3.0` -> `x` in `calc::lonely` (operand)",
        "no test uses this code; the function `calc::lonely` returns",
        "| function = \"lonely\"",
        " more mutants of `calc::lonely`",
        "calc    ",
        "mutants killed by 1 test on cpu",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in:\n{}", ran.out);
    }
    assert!(!ran.out.contains("killed shaders"), "those that are killed are counted alone");
    assert_eq!(files(folder.path()), before, "tests that fail on purpose leave nothing");
    let all = karat(folder.path(), &["mutate", "--all", "--only", "half"]).good();
    assert!(all.contains("killed shaders/calc.wgsl:1:33 `0.5` -> `1.0`"), "{all}");
    assert!(all.contains("by `calc::half equals`") && all.contains("score 100%"), "{all}");
    let list = karat(folder.path(), &["mutate", "--list"]).good();
    assert!(list.lines().count() > 5 && !list.contains("score"), "{list}");
    // The report names the sample. With the same seed, the sample is the same.
    let part = ["mutate", "--sample", "3", "--seed", "4", "--all", "--fail-under", "0"];
    let [first, second] = [(); 2].map(|()| karat(folder.path(), &part).good());
    let without_time = |out: &str| out.rsplit_once(';').map(|(all, _)| all.to_owned());
    assert_eq!(without_time(&first), without_time(&second));
    assert!(first.contains("a sample of 3 of ") && first.contains("by seed 4"), "{first}");
    let told = json(&karat(folder.path(), &["mutate", "--json", "--only", "half"]).out);
    assert_eq!(told[0]["result"]["fate"], "killed", "{told}");
}

/// With `--in-diff`, Karat mutates only lines that were edited, and all lines of files that git doesn't track.
#[test]
fn mutants_in_a_diff_are_only_those_of_changed_lines() {
    let folder = folder();
    git(folder.path(), &["init", "-q"]);
    git(folder.path(), &["add", "."]);
    git(folder.path(), &["commit", "-qm", "one"]);
    let shaders = folder.path().join("shaders");
    // A pull request without shaders passes.
    let none = karat(folder.path(), &["mutate", "--in-diff", "HEAD"]);
    assert!(none.code == Some(0) && none.out.contains("no mutant was tried"), "{none:?}");
    assert!(none.err.contains("the package has no mutant in the lines that changed"), "{none:?}");
    write(&shaders, "calc.wgsl", &SHADER.replace("0.5 * x", "x * 0.5"));
    let own = karat(folder.path(), &["mutate", "--in-diff", "HEAD", "--all"]).good();
    assert!(own.contains("`calc::half`") && !own.contains("lonely"), "{own}");
    write(&shaders, "new.wgsl", "fn third(x: f32) -> f32 { return x / 3.0; }\n");
    let both = karat(folder.path(), &["mutate", "--in-diff", "HEAD", "--all"]);
    assert!(both.code == Some(1) && both.out.contains("`new::third`"), "{both:?}");
    // Later commits on the other branch aren't part of this pull request.
    git(folder.path(), &["checkout", "-q", "--", "."]);
    git(folder.path(), &["branch", "work"]);
    write(&shaders, "calc.wgsl", &SHADER.replace("3.0", "4.0"));
    git(folder.path(), &["commit", "-qam", "other"]);
    git(folder.path(), &["tag", "other"]);
    git(folder.path(), &["checkout", "-q", "work"]);
    std::fs::rename(shaders.join("new.wgsl"), shaders.join("n\u{e9} w.wgsl")).expect("renamed");
    std::fs::remove_file(shaders.join("n\u{e9} w.wgsl")).expect("removed");
    let none = karat(folder.path(), &["mutate", "--in-diff", "other"]);
    assert!(none.code == Some(0) && none.out.contains("no mutant was tried"), "{none:?}");
    let slip = karat(folder.path(), &["mutate", "--in-diff", "HAED"]).error();
    assert!(slip.contains("HAED"), "{slip}");
}

// Lesson 29
#[test]
fn mutate_fails_if_the_score_is_below_the_bound() {
    let folder = folder();
    let under = |percent: &str| karat(folder.path(), &["mutate", "--fail-under", percent]).code;
    assert_eq!((under("10"), under("99.5")), (Some(0), Some(1)));
    let slip = karat(folder.path(), &["mutate", "--fail-under", "many"]);
    assert!(slip.code == Some(2) && slip.err.contains("a number from 0 to 100"), "{slip:?}");
    // Tests that already fail kill no mutant.
    let red = TESTS.replace("equals = 1", "equals = 3");
    write(&folder.path().join("shaders"), "calc.test.toml", &red);
    let error = karat(folder.path(), &["mutate"]).error();
    assert!(error.contains("1 test fails") && error.contains("fix these tests"), "{error}");
    std::fs::remove_file(folder.path().join("shaders/calc.test.toml")).expect("removed");
    let error = karat(folder.path(), &["mutate"]).error();
    assert!(error.contains("the package has no test"), "{error}");
}

/// For each line with surviving mutants, GitHub gets a warning with the file's path in the repository. The job's
/// summary gets the list of these mutants.
#[test]
fn lines_are_annotated() {
    let folder = folder();
    let summary = folder.path().join("summary.md");
    let mut github = command(folder.path(), &["mutate", "--github"]);
    let ran = output(github.env("GITHUB_STEP_SUMMARY", &summary));
    let warnings: Vec<&str> =
        ran.out.lines().filter(|line| line.starts_with("::warning ")).collect();
    let start = "::warning file=shaders/calc.wgsl,line=2,col=35,title=karat mutate::no test kills ";
    assert!(warnings.len() == 1 && warnings[0].starts_with(start), "{ran:?}");
    assert!(warnings[0].contains("of this line: `x + 3.0` -> `x`"), "{ran:?}");
    let summary = std::fs::read_to_string(summary).expect("it was written");
    for part in ["## karat mutate", " mutants killed by ", "<pre>no test shaders/calc.wgsl:2:35 "] {
        assert!(summary.contains(part), "{part}: {summary}");
    }
    assert!(!summary.contains('\u{1b}'), "{summary}");
}

/// With `--stryker`, Karat writes each mutant with its position into a file, in the format of Stryker's schema.
#[test]
fn stryker_reads_the_report() {
    let folder = folder();
    let written = karat(folder.path(), &["mutate", "--stryker", "out/mutation.json"]);
    assert_eq!(written.code, Some(1), "{written:?}");
    let text = std::fs::read_to_string(folder.path().join("out/mutation.json")).expect("written");
    let report = json(&text);
    assert_eq!(
        (&report["schemaVersion"], &report["thresholds"]["high"]),
        (&"2".into(), &80.into())
    );
    let file = &report["files"]["shaders/calc.wgsl"];
    assert_eq!((&file["language"], &file["source"]), (&"wgsl".into(), &SHADER.into()));
    let known = ["Killed", "Survived", "NoCoverage", "CompileError", "RuntimeError", "Ignored"];
    let mutants = file["mutants"].as_array().expect("mutants");
    assert!(mutants.len() > 5);
    for mutant in mutants {
        for key in ["id", "mutatorName", "replacement", "status"] {
            assert!(mutant[key].is_string(), "{mutant}");
        }
        assert!(
            mutant["status"].as_str().is_some_and(|status| known.contains(&status)),
            "{mutant}"
        );
        let at = |end: &str, key: &str| mutant["location"][end][key].as_u64().expect("a number");
        let (line, from, to) = (at("start", "line"), at("start", "column"), at("end", "column"));
        assert!(line >= 1 && from >= 1 && to > from, "{mutant}");
    }
    let half = mutants.iter().find(|one| one["replacement"] == "1.0").expect("a number");
    assert_eq!(
        (&half["status"], &half["location"]["start"]["column"]),
        (&"Killed".into(), &33.into())
    );
    assert_eq!(half["location"]["end"]["column"], 36);
}
