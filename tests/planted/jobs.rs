//! An executor that runs jobs with a planted fault, and checks that send jobs to this executor.

use std::io::Write;

use karat::Path;
use karat::path::PathError;
use karat::prelude::*;
use karat::unstable::executor::Executor;
use karat::unstable::job::{Job, Problem, Reply, Resource};
use karat::unstable::path::Ability;
use karat::unstable::path::Adapter;
use karat_inspect::conform;

/// Runs jobs on the path that the program's second command-line argument names, and plants the fault that the third
/// argument names.
pub(crate) fn serve() -> Result<String, String> {
    let mut arguments = std::env::args().skip(2);
    let path: Path =
        arguments.next().ok_or("no path")?.parse().map_err(|e: PathError| e.to_string())?;
    let fault = arguments.next().unwrap_or_default();
    match &*fault {
        "silent" => return Ok("it says nothing".to_owned()),
        "deaf" => {
            say(r#"{"jobs": 1, "name": "a deaf one", "can": ["textures"]}"#)?;
            std::thread::sleep(std::time::Duration::from_secs(600));
        }
        "old" => say(r#"{"jobs": 0, "name": "an old one"}"#)?,
        "rude" => say("good morning")?,
        _ => {}
    }
    let inner = karat::unstable::executor::of(path).map_err(|error| error.to_string())?;
    let (stdin, stdout) = (std::io::stdin().lock(), std::io::stdout().lock());
    let served = match &*fault {
        "other" => karat::unstable::executor::serve(inner, stdin, OfAnother(stdout)),
        _ => karat::unstable::executor::serve(&Faulty { inner, fault }, stdin, stdout),
    };
    served.map(|()| "its input has ended".to_owned()).map_err(|error| error.to_string())
}

fn say(line: &str) -> Result<(), String> {
    writeln!(std::io::stdout(), "{line}").map_err(|error| error.to_string())
}

/// A writer that changes the job number in each reply.
struct OfAnother<W>(W);

impl<W: Write> Write for OfAnother<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let text = String::from_utf8_lossy(bytes).replace("{\"id\":", "{\"id\":1");
        self.0.write_all(text.as_bytes()).map(|()| bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

/// An executor that changes the replies of another executor, according to `fault`.
#[derive(Debug)]
struct Faulty {
    inner: &'static dyn Executor,
    fault: String,
}

impl Executor for Faulty {
    fn path(&self) -> Path {
        self.inner.path()
    }

    fn adapter(&self) -> Adapter {
        self.inner.adapter()
    }

    fn can(&self, ability: Ability) -> bool {
        self.fault != "plain" && self.inner.can(ability)
    }

    fn run(&self, job: &Job) -> Result<Reply, PathError> {
        let Reply::Done(mut outputs) = self.inner.run(job)? else { return self.inner.run(job) };
        let before = |number: &usize| match &job.resources[*number] {
            Resource::Buffer { words } => words.clone(),
            _ => Vec::new(),
        };
        let problem = |message: &str| Problem { message: message.to_owned(), pass: 0, bytes: None };
        // The words in the name of the function or the entry point. Some faults depend on the name.
        let named = |text: &str| {
            let at = text.find("fn ").unwrap_or(0);
            Problem { bytes: Some(at..at + 2), ..problem("it is too beautiful") }
        };
        let text = match &job.work {
            karat::unstable::job::Work::Passes(passes) => passes[0].shader.wgsl.clone(),
            karat::unstable::job::Work::Frame(frame) => frame.shader.wgsl.clone(),
        };
        Ok(match &*self.fault {
            // The executor runs nothing.
            "idle" => Reply::Done(job.outputs.iter().map(before).collect()),
            // The executor drops the write of the first result.
            "dropped" => {
                outputs[0][0] = before(&job.outputs[0])[0];
                Reply::Done(outputs)
            }
            // Each result belongs to another case.
            "shifted" => {
                outputs.iter_mut().for_each(|words| words.rotate_left(2));
                Reply::Done(outputs)
            }
            "wrong" => {
                outputs[0][0] ^= 1;
                Reply::Done(outputs)
            }
            "short" => {
                outputs[0].pop();
                Reply::Done(outputs)
            }
            "few" => Reply::Done(Vec::new()),
            // The executor writes each job to the file in the next argument.
            "keeps" => {
                let file = std::env::args().nth(4).expect("it names a file");
                let line = serde_json::to_string(job).expect("a job is plain data");
                let mut kept = std::fs::File::options().create(true).append(true).open(file);
                writeln!(kept.as_mut().expect("it opens"), "{line}").expect("it is written");
                Reply::Done(outputs)
            }
            // The executor writes an extra line before the first reply.
            "noisy" => {
                static SAID: std::sync::Once = std::sync::Once::new();
                SAID.call_once(|| say("by the way").expect("the pipe is open"));
                Reply::Done(outputs)
            }
            "late" => {
                // The executor sends the reply to the previous job.
                static LAST: std::sync::Mutex<Vec<Vec<u32>>> = std::sync::Mutex::new(Vec::new());
                let mut last = LAST.lock().expect("no thread panics");
                Reply::Done(std::mem::replace(&mut *last, outputs))
            }
            "backwards" => Reply::Refused(Problem {
                bytes: Some(std::ops::Range { start: 60, end: 1 }),
                ..problem("look there")
            }),
            "refuses" => Reply::Refused(named(&text)),
            "fails" => Reply::Failed(named(&text)),
            "garbage" => {
                say("all went well").expect("the pipe is open");
                Reply::Done(outputs)
            }
            "dies" => {
                eprintln!("out of memory");
                std::process::exit(3)
            }
            "hangs" => loop {
                std::thread::park();
            },
            _ => Reply::Done(outputs),
        })
    }
}

/// Sends jobs with known results to the executor `process@mine`. Returns a JSON report with a verdict for each job, as
/// `Err` if a result is wrong.
pub(crate) fn conform() -> Result<String, String> {
    let path = "process@mine".parse::<Path>().map_err(|error| error.to_string())?;
    let report = conform::conform(path, &mut |_| {}).map_err(|error| error.to_string())?;
    let text = serde_json::to_string(&report).map_err(|error| error.to_string())?;
    if report.count(conform::Answer::Wrong) == 0 { Ok(text) } else { Err(text) }
}

/// Checks functions, passes and a frame on the paths that `KARAT_PATHS` selects.
pub(crate) fn checks() -> Result<String, String> {
    let wgsl = "fn half(x: f32) -> f32 { return 0.5 * x; }\n\
                fn tiny(x: f32) -> f32 { return dpdx(x); }\n\
                @group(0) @binding(0) var<storage, read_write> data: array<u32>;\n\
                @group(0) @binding(1) var image: texture_2d<f32>;\n\
                fn first(i: u32) -> f32 { return textureLoad(image, vec2u(i, 0u), 0).x; }\n\
                @compute @workgroup_size(1) fn add() { data[1] += 3u; }\n\
                @compute @workgroup_size(1) fn load() { data[0] = u32(textureLoad(image, vec2u(1u, 0u), 0).x); }\n\
                @vertex fn corners(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {\n\
                    return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);\n\
                }\n\
                @fragment fn white() -> @location(0) vec4f { return vec4f(1.0); }\n";
    let package = Package::from_source("piped", wgsl);
    let half = package.function("half").over(0.0..=1.0).cases(10_000).unrecorded();
    let texels = || Texture::from_fn(2, 1, |x, _| x as f32);
    let first =
        package.function("first").with("image", texels()).over(Integers(0..=1_u32)).unrecorded();
    let passes =
        package.compute().with("data", Storage::new([1_u32, 2])).dispatch("add", [1, 1, 1]);
    let loads = package.compute().with("data", Storage::new([7_u32, 2])).with("image", texels());
    let loads = loads.dispatch("load", [1, 1, 1]);
    let frame = package.frame("", 4, 2).fullscreen("corners", "white").unrecorded();
    let whole = karat::metric::Rect::new(0, 0, 4, 2);
    let tiny = package.function("tiny").over(0.0..=1.0).unrecorded();
    let told = [
        (
            "function",
            half.try_agrees_with(|x: f64| 0.5 * x, Ulp(0.0)).map(drop).map_err(|e| e.to_string()),
        ),
        (
            "texture",
            first.try_agrees_with(f64::from, Ulp(0.0)).map(drop).map_err(|e| e.to_string()),
        ),
        (
            "pass",
            passes
                .after("data")
                .unrecorded()
                .try_agrees_with([1_u32, 5], Ulp(0.0))
                .map(drop)
                .map_err(|e| e.to_string()),
        ),
        (
            "frame",
            frame.try_has_mean(whole, [1.0; 3], Abs(0.0)).map(drop).map_err(|e| e.to_string()),
        ),
        (
            "load",
            loads
                .after("data")
                .unrecorded()
                .try_agrees_with([1_u32, 2], Ulp(0.0))
                .map(drop)
                .map_err(|e| e.to_string()),
        ),
        ("quad", tiny.try_agrees_with(|_: f64| 0.0, Ulp(0.0)).map(drop).map_err(|e| e.to_string())),
    ];
    let line = |(name, result): (&str, Result<(), String>)| match result {
        Ok(()) => format!("{name}: agrees\n"),
        Err(error) => format!("{name}: {error}\n"),
    };
    Ok(told.into_iter().map(line).collect())
}
