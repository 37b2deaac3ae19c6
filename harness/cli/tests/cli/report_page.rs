//! Tests the page of `karat report`, its JSON, and one report for several parts of a run.

use std::path::PathBuf;

use super::report::{frame, function};
use super::*;

/// A project, and a folder with the record of each part of a run. Each element of `parts` has the lines of one record.
fn recorded(parts: &[&[String]]) -> (TempDir, Vec<PathBuf>) {
    let project = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(project.path().join("Cargo.toml"), "[workspace]\n").expect("written");
    let folder = |at: usize| project.path().join(format!("part{at}"));
    for (at, lines) in parts.iter().enumerate() {
        write(&folder(at), "1.jsonl", &lines.concat());
        write(&folder(at), "run.json", r#"{"schema":5,"selected":[],"passed":true}"#);
    }
    let folders = (0..parts.len()).map(folder).collect();
    (project, folders)
}

/// A record of a check of the function `name` in the test `test`, with the distribution of its errors. The record of a
/// failing check also has the data of a plot.
fn check(name: &str, test: &str, verdict: &str) -> String {
    let message =
        (verdict == "fail").then_some("error: `f` fails\n  replay: KARAT_SEED=1 cargo test");
    let line = function(name, "vulkan", verdict, message).replace("tests::calc", test);
    let errors = r#""errors":{"exact":3,"powers":{"-2":5,"1":1},"not_finite":1}"#;
    let plot = r#""plot":{"arguments":["a","<b>"],"rows":[[0,0,0.5],[1,0,2],[0,1,null],[1,1,9]]}"#;
    let more = if verdict == "fail" { format!("{errors},{plot}") } else { errors.to_owned() };
    line.replacen("\"asserted\"", &format!("{more},\"asserted\""), 1)
}

#[test]
fn the_page_shows_what_fails_with_its_plots() {
    let lines = [
        check("calc::half", "a", "pass"),
        check("calc::<script>", "b", "fail"),
        frame(FilePath::new(""), "room", &["vulkan"], "pass"),
    ];
    let (project, folders) = recorded(&[&lines]);
    let folder = folders[0].to_str().expect("UTF-8");
    let arguments = [
        "report", "--record", folder, "--html", "r.html", "--json", "r.json", "--review", "frames/",
    ];
    let ran = output(&mut command(project.path(), &arguments));
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let page = std::fs::read_to_string(project.path().join("r.html")).expect("written");
    for part in [
        "<h1 class=\"fail\">failed</h1>",
        "3 checks, 1 failed",
        "id=\"calc::half-agrees_with-a\"",
        "calc::&lt;script&gt;",
        "&lt;b&gt;",
        "KARAT_SEED=1 cargo test",
        "href=\"frames/#room\"",
        "Each of the 4 dots is a case",
        "not finite: 1 of 10 cases",
    ] {
        assert!(page.contains(part), "no `{part}` in {page}");
    }
    // The page has the plots, and shows nothing from the record as markup.
    assert_eq!((page.matches("<svg width").count(), page.matches("<script>").count()), (3, 1)); // 2 plots and a map
    // The page needs no network.
    let page = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    assert!(!page.contains("src=") && !page.contains("http:") && !page.contains("@import"));
    let json = std::fs::read_to_string(project.path().join("r.json")).expect("written");
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!((&json["schema"], json["records"].as_array().map(Vec::len)), (&5.into(), Some(3)));
    assert_eq!(json["run"]["passed"], true);
}

/// The page shows how often a tested sampler hit each cell, lists hazards, and links to the page of `karat matrix`.
#[test]
fn the_page_has_maps_hazards_and_links() {
    let histogram = r#""histogram":{"axes":["theta","phi"],"rows":[1,2],"observed":[9,1,0],"expected":[4,4,2]}"#;
    let line = check("calc::half", "a", "fail");
    let line = line.replacen("\"asserted\"", &format!("{histogram},\"asserted\""), 1);
    let (project, folders) = recorded(&[&[line]]);
    write(
        &project.path().join("shaders"),
        "calc.wgsl",
        "fn half(n_dot_l: f32) -> f32 { return 1.0 / n_dot_l; }\n",
    );
    let folder = folders[0].to_str().expect("UTF-8");
    let more = ["--hazards", "--matrix", "routes.html", "--html", "r.html"];
    let ran = output(&mut command(
        project.path(),
        &[&["report", "--record", folder][..], &more].concat(),
    ));
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let page = std::fs::read_to_string(project.path().join("r.html")).expect("written");
    for part in [
        "Samples in each of 3 cells",
        "9, expected 4.00 (+2.5 sigma)",
        "href=\"routes.html\"",
        "shaders: 1 fault and 0 requirements in 1 function",
        "1.0 / n_dot_l",
    ] {
        assert!(page.contains(part), "no `{part}` in {page}");
    }
}

#[test]
fn reports_do_not_overwrite_other_files() {
    let lines = [check("calc::half", "a", "pass"), check("calc::half", "a", "pass")];
    let (project, folders) = recorded(&[&lines]);
    let folder = folders[0].to_str().expect("UTF-8");
    let report = |more: &[&str]| {
        output(&mut command(project.path(), &[&["report", "--record", folder], more].concat()))
    };
    let twice = report(&["--html", "r", "--json", "./r"]);
    assert!(
        twice.code == Some(2) && twice.err.contains("two reports have the same file"),
        "{twice:?}"
    );
    // No two rows have the same name.
    assert_eq!(report(&["--html", "r.html"]).code, Some(0));
    let page = std::fs::read_to_string(project.path().join("r.html")).expect("written");
    let ids: Vec<&str> =
        page.split(" id=\"").skip(1).filter_map(|id| id.split('"').next()).collect();
    let mut distinct = ids.clone();
    distinct.sort_unstable();
    distinct.dedup();
    assert_eq!(ids.len(), distinct.len(), "{ids:?}");
    assert!(page.contains("calc::half-agrees_with-a-2"), "{ids:?}");
    // If a run didn't end, the report of its record says what to do.
    std::fs::remove_file(folders[0].join("run.json")).expect("removed");
    assert_eq!(report(&["--html", "r.html"]).code, Some(1));
    let page = std::fs::read_to_string(project.path().join("r.html")).expect("written");
    assert!(page.contains(">not ended</h1>") && page.contains("Run the tests again"), "{page}");
    // If Karat can't write the page, the old page stays.
    let blocked = report(&["--html", "r.html", "--json", "r.html/x.json"]);
    assert!(blocked.code != Some(0) && project.path().join("r.html").is_file(), "{blocked:?}");
}

/// The merged report of a run's shards equals the report of the whole run, byte for byte.
// Lesson 108
#[test]
fn merged_shards_give_the_report_of_the_whole_run() {
    let names = ["a", "b", "c", "d", "e", "f", "g"];
    let mut all: Vec<String> =
        names.iter().map(|name| check(&format!("m::{name}"), name, "pass")).collect();
    // One test checks a function twice. The record has both checks, in the order in which they ran.
    let twice = ["9", "10"]
        .map(|seed| check("m::h", "h", "pass").replace("\"seed\":1", &format!("\"seed\":{seed}")));
    assert_ne!(twice[0], twice[1]);
    all.push(twice.concat().replacen("7 ulp", "6 ulp", 1));
    let [whole, first, second, third] = [
        all.clone(),
        all.iter().step_by(3).cloned().collect(),
        all.iter().skip(1).step_by(3).rev().cloned().collect(),
        all.iter().skip(2).step_by(3).cloned().collect::<Vec<_>>(),
    ];
    let (project, folders) = recorded(&[&whole, &first, &second, &third]);
    let parts: Vec<&str> = folders.iter().map(|path| path.to_str().expect("UTF-8")).collect();
    let write = |arguments: &[&str], name: &str| {
        let mut all = vec!["report"];
        all.extend(arguments);
        let files = ["html", "xml", "json"].map(|ending| format!("{name}.{ending}"));
        all.extend(["--html", &files[0], "--junit", &files[1], "--json", &files[2]]);
        let ran = output(&mut command(project.path(), &all));
        assert_eq!(ran.code, Some(0), "{ran:?}");
        let table = ran.out.lines().filter(|line| !line.contains("record: ")).collect::<String>();
        let read = |file| std::fs::read_to_string(project.path().join(file)).expect("written");
        (table, files.map(read))
    };
    let whole = write(&["--record", parts[0]], "whole");
    assert_eq!(write(&["--merge", parts[3], parts[1], parts[2]], "merged"), whole);
    // The report names a missing shard. A shard that is given twice counts once.
    assert_ne!(write(&["--merge", parts[1], parts[2]], "two"), whole);
    assert_eq!(write(&["--merge", parts[0], parts[1], parts[2]], "twice"), whole);
}

/// If a part failed, didn't end or doesn't exist, the merged run fails.
// Lesson 108
#[test]
fn a_failed_or_missing_shard_fails_the_merged_report() {
    let good = [check("m::a", "a", "pass")];
    let (project, folders) = recorded(&[&good, &good, &good]);
    let parts: Vec<&str> = folders.iter().map(|path| path.to_str().expect("UTF-8")).collect();
    let code = |parts: &[&str]| {
        let mut arguments = vec!["report", "--merge"];
        arguments.extend(parts);
        output(&mut command(project.path(), &arguments))
    };
    assert_eq!(code(&parts).code, Some(0));
    write(&folders[1], "1.jsonl", &check("m::a", "a", "fail"));
    let failed = code(&parts);
    assert!(failed.code == Some(1) && failed.out.contains("1 check, 1 failed"), "{failed:?}");
    write(&folders[1], "1.jsonl", &check("m::a", "a", "pass"));
    std::fs::remove_file(folders[2].join("run.json")).expect("removed");
    let open = code(&parts);
    assert!(
        open.code == Some(1) && open.out.contains("doesn't say that its run ended"),
        "{open:?}"
    );
    let missing = code(&[parts[0], "nowhere"]);
    assert_eq!(missing.code, Some(3), "{missing:?}");
    assert!(missing.err.contains("there is no record of a run in `nowhere`"), "{missing:?}");
}
