//! Tests the interfaces for other programs: a list of tests, a run of one test, and the comparison of an image with its
//! golden.

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::Stdio;

use karat::Image;
use karat::image::Precision;

use super::*;

const SHADER: &str =
    "fn half(x: f32) -> f32 { return 0.5 * x; }\nfn twice(x: f32) -> f32 { return 3.0 * x; }\n";
const TESTS: &str = "[[test]]\nfunction = \"half\"\nover = { x = 2 }\nequals = 1\ntolerance = \"1 ulp\"\n\n\
                     [[test]]\nfunction = \"twice\"\nover = { x = 2 }\nequals = 4\ntolerance = \"1 ulp\"\n";
const OWN: &str = "import package::m::half;\nimport karat::expect_near;\n\n@test\nfn one() {\n    expect_near(half(2.0), 1.0, 0.0);\n}\n";

fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaders = folder.path().join("shaders");
    write(&shaders, "m.wgsl", SHADER);
    write(&shaders, "m.test.toml", TESTS);
    write(&shaders, "m_test.wgsl", OWN);
    folder
}

/// Each test has its position in the author's file. If a file should declare tests and declares none, the list has an
/// error for the file.
#[test]
fn tests_are_listed_with_their_places() {
    let folder = folder();
    let list = karat(folder.path(), &["list", "--tests"]).good();
    for line in [
        "shaders/m_test.wgsl:4:1 m_test::one",
        "shaders/m.test.toml:1:1 m::half equals",
        "shaders/m.test.toml:7:1 m::twice equals",
    ] {
        assert!(list.lines().any(|one| one == line), "no `{line}` in:\n{list}");
    }
    let listed = json(&karat(folder.path(), &["list", "--tests", "--json", "shaders"]).good());
    let one = listed.as_array().expect("a list").iter().find(|one| one["name"] == "m_test::one");
    let one = one.expect("it is there");
    let shaders = folder.path().canonicalize().expect("it is there").join("shaders");
    assert_eq!(
        (&one["line"], &one["column"], &one["error"]),
        (&4.into(), &1.into(), &serde_json::Value::Null)
    );
    assert_eq!(one["file"].as_str().map(FilePath::new), Some(&*shaders.join("m_test.wgsl")));
    assert_eq!(one["package"].as_str().map(FilePath::new), Some(&*shaders));
    write(
        &folder.path().join("shaders"),
        "n.test.toml",
        "[[test]]\nfunction = \"half\"\nequasl = 1\n",
    );
    let ran = karat(folder.path(), &["list", "--tests", "--json"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let listed = json(&ran.out);
    let wrong = listed.as_array().expect("a list").iter().find(|one| !one["error"].is_null());
    let wrong = wrong.expect("the list has it");
    assert_eq!(
        (&wrong["line"], wrong["error"]["headline"].is_string()),
        (&3.into(), true),
        "{wrong}"
    );
    let empty = tempfile::tempdir().expect("a temporary folder");
    write(&empty.path().join("shaders"), "m.wgsl", SHADER);
    let error = karat(empty.path(), &["list", "--tests"]).error();
    assert!(error.contains("there is no test beside the shaders"), "{error}");
}

/// A worker process runs the requested test and returns its record. If the same test is requested again without an
/// edit, the worker returns the earlier record.
#[test]
fn one_test_is_run_when_it_is_asked_for() {
    let folder = folder();
    let record = folder.path().join("record");
    std::fs::create_dir(&record).expect("a folder");
    let mut serve = command(folder.path(), &["suite", "shaders", "--serve"]);
    serve.env("KARAT_RECORD", &record).env("KARAT_PATHS", "cpu");
    let mut child = serve.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it starts");
    let mut stdin = child.stdin.take().expect("it is piped");
    let mut lines = BufReader::new(child.stdout.take().expect("it is piped")).lines();
    let mut said = Vec::new();
    for _ in 0..2 {
        let request = serde_json::json!({ "filter": "", "all": false, "first": [], "only": "m::twice equals" });
        writeln!(stdin, "{request}").expect("it reads");
        // The process ends when its input ends, during any work.
        while said.last().is_none_or(|one: &serde_json::Value| one["done"].is_null()) {
            let line = lines.next().expect("it goes on").expect("a text");
            said.extend((!line.is_empty()).then(|| json(&line)));
        }
        said.push(serde_json::Value::Null);
    }
    drop(stdin);
    child.wait().expect("it ends");
    let names: Vec<_> = said.iter().filter_map(|one| one["test"]["name"].as_str()).collect();
    assert_eq!(names, ["m::twice equals"], "once");
    let dones: Vec<_> = said.iter().filter(|one| !one["done"].is_null()).collect();
    assert_eq!(dones.len(), 2);
    for done in dones {
        let records = done["done"]["records"].as_array().expect("its record");
        let worst = &records[0]["details"]["paths"][0]["worst"];
        assert_eq!((&worst["actual"], &worst["expected"]), (&"6".into(), &"4".into()), "{done}");
    }
}

/// `karat match` compares an image from another program with a golden. If the image differs, it becomes a pending
/// frame. Karat refuses an image in which all pixels are equal.
#[test]
fn an_image_is_matched_with_its_golden() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let image = |name: &str, blue: f32| {
        let image = Image::new(2, 1, vec![[0.25, 0.5, blue, 1.0], [1.0; 4]]);
        image.write_exr(&folder.path().join(name), Precision::Float, None).expect("written");
    };
    image("first.exr", 4.0);
    let matched = |name: &str| karat(folder.path(), &["match", "menu", name, "--by", "Chrome 156"]);
    let first = matched("first.exr");
    assert!(first.code == Some(1) && first.err.contains("frame `menu` has no golden"), "{first:?}");
    karat(
        folder.path(),
        &["accept", "menu", "--goldens=golden", "--any-adapter", "--because", "it is the first"],
    )
    .good();
    assert!(matched("first.exr").good().contains("menu matches its golden"));
    image("other.exr", 0.5);
    let other = matched("other.exr");
    assert!(other.code == Some(1) && other.err.contains("differs from its golden"), "{other:?}");
    let pending = karat(folder.path(), &["pending", "--goldens=golden"]).out;
    assert!(pending.contains("menu") && pending.contains("Chrome 156"), "{pending}");
    Image::new(2, 1, vec![[0.5, 0.5, 0.5, 1.0]; 2])
        .write_exr(&folder.path().join("blank.exr"), Precision::Float, None)
        .expect("written");
    for (name, message) in [("blank.exr", "all pixels of the image"), ("none.png", "none.png")] {
        let wrong = matched(name);
        assert!(
            wrong.code.is_some_and(|code| code >= 2) && wrong.err.contains(message),
            "{wrong:?}"
        );
    }
}
