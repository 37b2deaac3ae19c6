//! Tests external programs as executors. The checks pass with an honest program, and fail with each faulty program.

use std::collections::BTreeMap;
use std::process::Command;

use karat::unstable::job::{Answer, Job, Problem, Reply};
use karat::unstable::path::{Ability, Greeting};
use serde_json::{Value, json};

/// Runs the checks of `planted pipe` with the program `planted executor` as the executor, and returns the output of the
/// checks. The executor runs jobs on `path`, with the planted `fault`.
fn piped(path: &str, fault: &str) -> String {
    let executor = format!("mine={} executor {path} {fault}", env!("CARGO_BIN_EXE_planted"));
    told(&executor, "process@mine", &[])
}

fn told(executors: &str, paths: &str, environment: &[(&str, &str)]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_planted"));
    command.arg("pipe").env("KARAT_EXECUTORS", executors).env("KARAT_PATHS", paths);
    command.env_remove("KARAT_REQUIRE").env_remove("KARAT_RECORD");
    let output = command.envs(environment.iter().copied()).output().expect("it runs");
    String::from_utf8(output.stderr).expect("it is text")
}

/// If a program runs jobs on the engine, checks of functions and passes give the same verdicts as on the path `cpu`.
/// The program refuses frames, as the engine does.
#[test]
fn the_engine_behind_a_pipe_is_a_path() {
    let text = piped("cpu", "");
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[..3], ["function: agrees", "texture: agrees", "pass: agrees"], "{text}");
    assert!(lines[3].starts_with("frame: path `process@mine` draws no frames"), "{text}");
    assert_eq!(lines[4], "load: agrees", "{text}");
    assert!(
        lines[5].contains(
            "the function takes derivatives, or discards pixels and writes memory, so it runs only"
        ),
        "{text}"
    );
}

/// If a program runs jobs on a driver, it also draws frames.
#[test]
fn a_driver_behind_a_pipe_draws_frames() {
    let text = piped("vulkan", "");
    let agrees = text.lines().filter(|line| line.ends_with(": agrees")).count();
    assert_eq!(agrees, 5, "{text}");
    assert!(text.contains("frame: agrees"), "{text}");
}

/// Karat checks that an executor has really done its work, so the checks fail with programs that skip, drop or change
/// results.
#[test]
fn a_program_that_does_not_do_its_work_is_found_out() {
    for (fault, function, pass) in [
        (
            "idle",
            "the kernel of `half` wrote no result for 4096 of 4096 cases on path `process@mine`",
            "`data` after `add` fails",
        ),
        // The pass leaves its first word unchanged, so a dropped write has no effect. The result has two `u32`s, so
        // rotating it by two has no effect either.
        ("dropped", "never wrote 1 of 4096 result words", "pass: agrees"),
        ("shifted", "wrote no result for", "pass: agrees"),
        ("wrong", "`half` fails agrees_with", "`data` after `add` fails"),
        (
            "short",
            "the executor returned outputs of [8191] words, but the job needs [8192]",
            "the executor returned outputs of [1] words, but the job needs [2]",
        ),
        (
            "few",
            "the executor returned outputs of [] words, but the job needs [",
            "the executor returned outputs of [] words, but the job needs [",
        ),
        ("refuses", "it is too beautiful (<piped>:1:1)", "it is too beautiful (<piped>:6:"),
        ("fails", "it is too beautiful (<piped>:1:1)", "it is too beautiful (<piped>:6:"),
        (
            "garbage",
            "the executor wrote a line that isn't an answer: all went well",
            "the executor wrote a line that isn't an answer: all went well",
        ),
        (
            "dies",
            "the program ended (exit status: 3): out of memory",
            "the program ended (exit status: 3): out of memory",
        ),
    ] {
        let text = piped("cpu", fault);
        let of = |name: &str| {
            let from = text.find(&format!("{name}: ")).expect("each has a line");
            let next = ["\ntexture: ", "\npass: ", "\nframe: ", "\nload: "]
                .map(|next| text[from..].find(next));
            &text[from..from + next.into_iter().flatten().min().unwrap_or(text.len() - from)]
        };
        assert!(of("function").contains(function), "{fault}: {text}");
        assert!(of("pass").contains(pass), "{fault}: {text}");
        assert!(!text.contains("function: agrees"), "{fault}: {text}");
    }
}

/// If a program hangs, Karat ends the program after `KARAT_TIMEOUT` seconds, and the check fails.
#[test]
fn a_program_that_hangs_is_ended() {
    // The second program reads no job, so its pipe is full. The test waits for both programs at once.
    let is_ended = |fault: &str| {
        let executor = format!("mine={} executor cpu {fault}", env!("CARGO_BIN_EXE_planted"));
        let text = told(&executor, "process@mine", &[("KARAT_TIMEOUT", "0.5")]);
        assert_eq!(text.matches("did not finish within 0.5 s").count(), 4, "{fault}: {text}");
    };
    std::thread::scope(|scope| {
        scope.spawn(|| is_ended("hangs"));
        is_ended("deaf");
    });
}

/// Karat reports an error if a program writes an extra line, replies to another job, or gives an invalid position in
/// the shader. So no check gets the results of another job.
#[test]
fn a_line_belongs_to_its_job() {
    let text = piped("cpu", "noisy");
    assert!(
        text.contains("function: the driver of path `process@mine` reports: the executor wrote a line that isn't an answer"),
        "{text}"
    );
    // Karat starts another process, which is also faulty.
    assert_eq!(
        text.matches("the executor wrote a line that isn't an answer: by the way").count(),
        4,
        "{text}"
    );
    let text = piped("cpu", "other");
    assert_eq!(text.matches("reports: the executor answered job ").count(), 4, "{text}");
    let text = piped("cpu", "late");
    assert!(!text.contains(": agrees"), "{text}");
    let text = piped("cpu", "backwards");
    assert_eq!(text.matches("look there").count(), 4, "{text}");
}

/// If `KARAT_EXECUTORS` or `KARAT_PATHS` is wrong, or the program's greeting is wrong, the path doesn't open, and the
/// message gives the reason.
#[test]
fn programs_that_run_no_jobs_do_not_open() {
    let planted = env!("CARGO_BIN_EXE_planted");
    for (executors, paths, message) in [
        (
            "mine=/nowhere/at/all",
            "process@mine",
            "`/nowhere/at/all`, which KARAT_EXECUTORS names: the program can't be run",
        ),
        (
            "mine=PLANTED executor cpu",
            "process@mien",
            "KARAT_EXECUTORS has no program `mien`; did you mean `mine`?",
        ),
        (
            "mine=PLANTED executor cpu",
            "process",
            "write `process@NAME` with a name from KARAT_EXECUTORS",
        ),
        (
            "mine=PLANTED executor cpu",
            "process:hlsl@mine",
            "gets WGSL, so its path can't have a route",
        ),
        (
            "mine=PLANTED executor cpu silent",
            "process@mine",
            "the program ended (exit status: 0): it says nothing",
        ),
        (
            "mine=PLANTED executor cpu old",
            "process@mine",
            "the program reads jobs of version 0, but this Karat writes version 1",
        ),
        (
            "mine=PLANTED executor cpu rude",
            "process@mine",
            "the program's first line isn't a greeting: good morning",
        ),
        ("mine", "process@mine", "KARAT_EXECUTORS=mine isn't a list of NAME=PROGRAM ARGUMENTS"),
    ] {
        let text = told(&executors.replace("PLANTED", planted), paths, &[]);
        assert!(text.contains(message), "{executors}: {text}");
        assert!(!text.contains(": agrees"), "{executors}: {text}");
    }
}

/// Karat refuses a check before it runs, if the check needs an ability that the program's greeting doesn't report.
#[test]
fn a_check_that_needs_more_is_refused() {
    let text = piped("cpu", "plain");
    for needs in
        ["texture: `first` needs textures, which path", "load: `load` needs textures, which path"]
    {
        assert!(text.contains(needs), "{text}");
    }
    assert!(text.contains("function: agrees"), "{text}");
}

/// Runs `planted conform`, which sends jobs with known results to `planted executor`. Returns the verdict for each job
/// by the job's name. Also checks that the exit code is 0 only if no result is wrong.
fn conformed(path: &str, fault: &str) -> BTreeMap<String, Value> {
    let executor = format!("mine={} executor {path} {fault}", env!("CARGO_BIN_EXE_planted"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_planted"));
    command.arg("conform").env("KARAT_EXECUTORS", executor).env_remove("KARAT_RECORD");
    let output = command.output().expect("it runs");
    let report: Value = serde_json::from_slice(&output.stderr).expect("it is JSON");
    let answers = report["answers"].as_array().expect("it has answers").iter();
    let named = |one: &Value| (one["name"].as_str().expect("a name").to_owned(), one.clone());
    let answers: BTreeMap<String, Value> = answers.map(named).collect();
    let wrong = answers.values().any(|answer| answer["answer"] == "wrong");
    assert_eq!(output.status.success(), !wrong, "{fault}: {report}");
    answers
}

/// Honest programs return the known result of each job. Karat skips jobs that need an ability which the program's path
/// doesn't have.
// Lesson 87
#[test]
fn honest_programs_conform() {
    for (path, unasked) in [("cpu", &["nearest", "pixels"][..]), ("vulkan", &[])] {
        let answers = conformed(path, "");
        for (name, answer) in &answers {
            match unasked.contains(&&**name) {
                true => {
                    assert_eq!(
                        answer["why"], "the program's greeting doesn't name the ability `frames`",
                        "{path}: {name}"
                    )
                }
                false => assert_eq!(answer["answer"], "right", "{path}: {name}"),
            }
        }
        assert_eq!(answers.len(), 21, "{path}");
    }
}

/// Each faulty program gives a wrong result for some job. The report shows the wrong values, or the program's reply.
// Lesson 87
#[test]
fn lies_do_not_conform() {
    for (fault, name, reason) in [
        ("idle", "passes", "word 0 is 0x00000000, not 0x00000003; 2 of 2 differ"),
        ("dropped", "bits", "word 0 is 0x7fc01234, not 0xffffffff; 1 of 6 differ"),
        ("shifted", "untouched", "word 0 is 0xdead0003, not 0xdead0000; 8 of 8 differ"),
        ("wrong", "long", "1 of 262144 differ"),
        ("short", "grid", "the executor returned outputs of [71] words, but the job needs [72]"),
        ("few", "outputs", r#"the program's reply is {"done":[]}, not {"done":[[3,8,9],[1]]}"#),
        ("late", "outputs", r#"the program's reply is {"done":[["#),
        (
            "refuses",
            "refusal",
            r#"after a refused job, the program's reply to a valid job is {"refused":{"message":"#,
        ),
        ("dies", "function", "the program ended (exit status: 3): out of memory"),
    ] {
        let answers = conformed("cpu", fault);
        let one = &answers[name];
        assert_eq!(one["answer"], "wrong", "{fault}: {one}");
        let told = one["why"].as_str().expect("it has a reason");
        assert!(told.contains(reason), "{fault}: {told}");
    }
    // No job has its initial words as its result.
    let idle = conformed("cpu", "idle");
    assert!(idle.values().all(|one| one["answer"] != "right"), "{idle:?}");
    // The program reports only buffers, so Karat sends only jobs with buffers.
    let plain = conformed("cpu", "plain");
    assert_eq!(plain.values().filter(|one| one["answer"] == "right").count(), 12, "{plain:?}");
}

/// Describes the first part of `value` that violates the JSON schema `schema`. Supports only the features of JSON
/// Schema that `jobs.schema.json` uses.
fn misfit(all: &Value, schema: &Value, value: &Value) -> Option<String> {
    if let Some(name) = schema["$ref"].as_str() {
        let name = name.strip_prefix("#/$defs/").expect("a definition of this file");
        return misfit(all, &all["$defs"][name], value).map(|why| format!("{name}: {why}"));
    }
    let fits = |one: &&Value| misfit(all, one, value).is_none();
    let count = |key: &str| schema[key].as_array().map(|of| of.iter().filter(fits).count());
    if count("anyOf") == Some(0) || count("oneOf").is_some_and(|count| count != 1) {
        return Some(format!("none, or several, of {schema} fit {value}"));
    }
    if schema.get("const").is_some_and(|wanted| wanted != value)
        || schema["enum"].as_array().is_some_and(|names| !names.contains(value))
    {
        return Some(format!("{value} isn't of {schema}"));
    }
    let typed = match schema["type"].as_str() {
        Some("object") => value.is_object(),
        Some("array") => value.is_array(),
        Some("string") => value.is_string(),
        Some("boolean") => value.is_boolean(),
        Some("integer") => value.is_u64() || value.is_i64(),
        Some("number") => value.is_number(),
        Some("null") => value.is_null(),
        Some(other) => panic!("{other} is no type"),
        None => true,
    };
    let number = value.as_f64().unwrap_or(0.0);
    let outside = schema["minimum"].as_f64().is_some_and(|least| number < least)
        || schema["exclusiveMinimum"].as_f64().is_some_and(|least| number <= least)
        || schema["maximum"].as_f64().is_some_and(|most| number > most);
    if !typed || outside {
        return Some(format!("{value} isn't of {schema}"));
    }
    if let Some(values) = value.as_array() {
        let length = values.len() as u64;
        let short = schema["minItems"].as_u64().is_some_and(|least| length < least);
        if short || schema["maxItems"].as_u64().is_some_and(|most| length > most) {
            return Some(format!("{value} is longer or shorter than {schema}"));
        }
        let own = |at: usize| schema["prefixItems"].get(at).unwrap_or(&schema["items"]);
        return values.iter().enumerate().find_map(|(at, one)| misfit(all, own(at), one));
    }
    let members = value.as_object()?;
    let required = schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str);
    if let Some(missing) = required.clone().find(|name| !members.contains_key(*name)) {
        return Some(format!("{value} lacks {missing}"));
    }
    members.iter().find_map(|(name, one)| match schema["properties"].get(name) {
        Some(own) => misfit(all, own, one).map(|why| format!("{name}: {why}")),
        None if schema["additionalProperties"].is_object() => {
            misfit(all, &schema["additionalProperties"], one)
        }
        None => (schema["additionalProperties"] == false).then(|| format!("{name} is unknown")),
    })
}

/// Karat's jobs, greetings and replies match the published JSON schema. Both the schema and Karat's reader refuse a job
/// if any member is missing.
// Lesson 87
#[test]
fn jobs_are_as_the_schema_says() {
    let schema = include_str!("../../docs/guide/jobs.schema.json");
    let schema: Value = serde_json::from_str(schema).expect("it is JSON");
    let folder = tempfile::tempdir().expect("it is made");
    let kept = folder.path().join("jobs.jsonl");
    let executor = format!("vulkan keeps {}", kept.display());
    assert_eq!(conformed("", &executor).len(), 21);
    let text = std::fs::read_to_string(kept).expect("it is there");
    let jobs: Vec<Value> =
        text.lines().map(|line| serde_json::from_str(line).expect("it is JSON")).collect();
    assert!(jobs.len() >= 21, "{} jobs", jobs.len());
    for job in &jobs {
        assert_eq!(misfit(&schema, &schema["$defs"]["job"], job), None);
        // The schema requires the same members as Karat's own reader.
        for name in job.as_object().expect("a job").keys() {
            let mut less = job.clone();
            less.as_object_mut().expect("a job").remove(name);
            assert!(misfit(&schema, &schema["$defs"]["job"], &less).is_some(), "without {name}");
            assert!(serde_json::from_value::<Job>(less).is_err(), "without {name}");
        }
    }
    let frame = jobs.iter().find(|job| job["work"].get("frame").is_some()).expect("a frame");
    let mut odd = frame.clone();
    odd["work"]["frame"]["draws"][0]["draw"]["state"]["winding"] = json!("widdershins");
    assert!(misfit(&schema, &schema["$defs"]["job"], &odd).is_some());
    let reply = |reply: Reply| serde_json::to_value(Answer { id: 7, reply }).expect("plain data");
    let problem = Problem { message: "no".to_owned(), pass: 1, bytes: Some(3..9) };
    let greeting = Greeting {
        jobs: 1,
        name: "mine".to_owned(),
        driver: String::new(),
        software: true,
        can: vec![
            Ability::F16,
            Ability::Textures,
            Ability::Immediates,
            Ability::Subgroups,
            Ability::Frames,
        ],
    };
    let greeting = serde_json::to_value(greeting).expect("plain data");
    for (name, value) in [
        ("greeting", greeting),
        ("answer", reply(Reply::Done(vec![vec![1, 2]]))),
        ("answer", reply(Reply::Refused(problem.clone()))),
        ("answer", reply(Reply::Failed(problem))),
    ] {
        assert_eq!(misfit(&schema, &schema["$defs"][name], &value), None);
    }
}
