//! Links a job's shaders again, then runs the job on an executor of this process.

use std::borrow::Cow;

use super::{Bound, Frame, Job, Pass, Problem, Reply, Resource, Shader, Work};
use crate::diagnostic::Blamed;
use crate::dispatch::{self, DispatchError, Held, Passes};
use crate::draw::{DrawError, Drawing, Scene};
use crate::fixture::{Buffer, Fixture};
use crate::image::Image;
use crate::package::Package;
use crate::path::JOBS;
use crate::reflect::{Binding, Program, ReflectError};

type Dispatch<'b> = &'b dyn Fn(&Passes) -> Result<dispatch::Afterwards, DispatchError>;

type Draw<'b> = &'b dyn Fn(&Drawing<'_>) -> Result<Image, DrawError>;

/// The reason why the reply to a job isn't [`Reply::Done`].
enum Unraised {
    Dispatch(DispatchError),
    Draw(DrawError),
    /// The job contradicts itself, or this program can't read the job.
    Job(String),
}

impl From<DispatchError> for Unraised {
    fn from(error: DispatchError) -> Self {
        Self::Dispatch(error)
    }
}

impl From<DrawError> for Unraised {
    fn from(error: DrawError) -> Self {
        Self::Draw(error)
    }
}

impl From<ReflectError> for Unraised {
    fn from(error: ReflectError) -> Self {
        Self::Dispatch(error.into())
    }
}

pub(crate) fn run(job: &Job, dispatch: Dispatch<'_>, draw: Draw<'_>) -> Reply {
    let done = match &job.work {
        _ if job.jobs != JOBS => {
            let theirs = job.jobs;
            Err(Unraised::Job(format!(
                "the job has version {theirs}, but this program reads version {JOBS}"
            )))
        }
        Work::Passes(passes) => dispatched(job, passes, dispatch),
        Work::Frame(frame) => drawn(job, frame, draw),
    };
    done.map_or_else(Unraised::reply, Reply::Done)
}

impl Unraised {
    fn reply(self) -> Reply {
        let (refused, message, diagnostic) = match &self {
            Self::Dispatch(error) => {
                let refused = error.is_refusal() || matches!(error, DispatchError::Reflect(_));
                (refused, error.to_string(), error.blame().message)
            }
            Self::Draw(error) => {
                let refused = error.is_refusal() || matches!(error, DrawError::Reflect(_));
                (refused, error.to_string(), error.blame().message)
            }
            Self::Job(reason) => (false, reason.clone(), None),
        };
        let place = diagnostic.and_then(crate::diagnostic::Diagnostic::location);
        let problem = Problem {
            message: diagnostic.map_or(message, |found| found.message.clone()),
            // A module's name contains the number of its pass.
            pass: place.map_or(0, |place| number(&place.file.name)),
            bytes: place.map(|place| place.range.clone()),
        };
        if refused { Reply::Refused(problem) } else { Reply::Failed(problem) }
    }
}

fn module(pass: usize) -> String {
    format!("pass{pass}")
}

/// The number of the pass to which a module's file belongs.
fn number(file: &str) -> usize {
    let digits = file.chars().skip_while(|c| !c.is_ascii_digit()).take_while(char::is_ascii_digit);
    digits.collect::<String>().parse().unwrap_or(0)
}

impl Shader {
    /// Links the shader again, as a module of a package.
    fn program(
        &self,
        package: &Package,
        module: &str,
    ) -> Result<std::sync::Arc<Program>, ReflectError> {
        Program::of_module(package, module)?.overridden(&self.overrides)
    }
}

impl Resource {
    fn fixture(&self) -> Fixture {
        match self {
            Self::Buffer { words } => {
                Buffer::from_bytes(bytemuck::cast_slice(words).to_vec()).into()
            }
            Self::Texture { texture, .. } => texture.clone().into(),
            Self::Sampler(sampler) => (*sampler).into(),
        }
    }
}

/// Finds the number of the resource that the job binds to a variable.
fn bound(bindings: &[Bound], binding: &Binding) -> Result<usize, Unraised> {
    let at = (binding.group != Binding::NOWHERE).then_some([binding.group, binding.binding]);
    let found = bindings.iter().find(|bound| bound.at == at);
    let missing = || Unraised::Job(format!("the job binds no resource to `{}`", binding.path));
    found.map(|bound| bound.resource).ok_or_else(missing)
}

fn dispatched(
    job: &Job,
    passes: &[Pass],
    dispatch: Dispatch<'_>,
) -> Result<Vec<Vec<u32>>, Unraised> {
    let texts = passes.iter().enumerate().map(|(n, pass)| (module(n), pass.shader.wgsl.clone()));
    let package = Package::from_modules("job", texts);
    let held = |(number, resource): (usize, &Resource)| Held {
        name: format!("resource {number}"),
        fixture: resource.fixture(),
    };
    let resources = job.resources.iter().enumerate().map(held).collect();
    let mut all = Passes { passes: Vec::new(), resources };
    for (number, pass) in passes.iter().enumerate() {
        let program = pass.shader.program(&package, &module(number))?;
        let entry = program.compute_entry_point(&pass.entry_point);
        let Some((bindings, _)) = entry else {
            let (name, nearest) = (pass.entry_point.clone(), None);
            return Err(DispatchError::EntryPoint { name, nearest }.into());
        };
        let numbered = |binding: Binding| {
            let number = bound(&pass.bindings, &binding)?;
            let missing = || Unraised::Job(format!("the job has no resource {number}"));
            let held = all.resources.get(number).ok_or_else(missing)?;
            held.fixture.expect(&binding).map_err(DispatchError::Fixture)?;
            Ok((binding, number))
        };
        let bindings = bindings.into_iter().map(numbered).collect::<Result<_, Unraised>>()?;
        let (name, entry_point) = (pass.entry_point.clone(), pass.entry_point.clone());
        let workgroups = pass.workgroups;
        let drawn = None;
        all.passes.push(dispatch::Pass { name, program, entry_point, workgroups, bindings, drawn });
    }
    let most = 1..=dispatch::MOST_WORKGROUPS;
    for Pass { entry_point, workgroups, .. } in passes {
        if workgroups.iter().any(|count| !most.contains(count)) {
            let (name, workgroups) = (entry_point.clone(), *workgroups);
            return Err(DispatchError::Workgroups { name, workgroups }.into());
        }
    }
    if passes.is_empty() {
        return Err(DispatchError::Empty.into());
    }
    // Karat can't create a resource that no pass uses, because no variable describes it.
    if let Some(unused) = (0..all.resources.len()).find(|n| all.uses(*n).next().is_none()) {
        return Err(Unraised::Job(format!("no pass uses resource {unused}")));
    }
    let afterwards = dispatch(&all)?;
    let output = |wanted: &usize| {
        let found = afterwards.iter().find(|(number, _)| number == wanted);
        let missing = || Unraised::Job(format!("no pass writes resource {wanted}"));
        let (_, words) = found.ok_or_else(missing)?;
        // A device's buffer may be longer than the job's buffer.
        Ok(words.iter().copied().take(job.resources[*wanted].words()).collect())
    };
    job.outputs.iter().map(output).collect()
}

fn drawn(job: &Job, frame: &Frame, draw: Draw<'_>) -> Result<Vec<Vec<u32>>, Unraised> {
    let package = Package::from_modules("job", [(module(0), frame.shader.wgsl.clone())]);
    let program = frame.shader.program(&package, &module(0))?;
    let mut scene = Scene {
        overrides: frame.shader.overrides.clone(),
        draws: frame.draws.iter().map(|drawn| drawn.draw.clone()).collect(),
        prepass: frame.prepass,
        blend: frame.blend,
        formats: frame.formats.clone(),
        result: frame.result,
        samples: frame.samples,
        clear: frame.clear,
        clear_depth: frame.clear_depth,
        ..Scene::new(&package, &module(0), (frame.width, frame.height))
    };
    for (drawn, bindings) in frame.draws.iter().zip(scene.bindings(&program)?) {
        for binding in bindings.all() {
            let number = bound(&drawn.bindings, binding)?;
            let missing = || Unraised::Job(format!("the job has no resource {number}"));
            let resource = job.resources.get(number).ok_or_else(missing)?;
            if scene.fixtures.iter().all(|(path, _)| *path != binding.path) {
                scene.fixtures.push((binding.path.clone(), resource.fixture()));
            }
        }
    }
    let image = draw(&Drawing::of(Cow::Owned(scene))?)?;
    Ok(vec![image.pixels().iter().flatten().map(|x| x.to_bits()).collect()])
}

#[cfg(test)]
mod tests {
    use super::*;

    const JOB: &str = r#"{"jobs": 1, "id": 7, "resources": [{"buffer": {"words": [0, 0]}}], "outputs": [0],
        "seconds": 60.0, "work": {"passes": [{"shader": {"wgsl":
        "@group(0) @binding(0) var<storage, read_write> x: u32; @compute @workgroup_size(1) fn f() { x = 7u; }",
        "sources": [], "overrides": {}}, "entry_point": "f", "bindings": [{"at": [0, 0], "resource": 0}],
        "workgroups": [1, 1, 1]}]}}"#;

    /// Replaces `from` with `to` in the job, and returns the reply to the new job. The test's device returns longer
    /// buffers than requested.
    fn reply(from: &str, to: &str) -> Reply {
        assert!(JOB.contains(from), "{from}");
        let job: Job = serde_json::from_str(&JOB.replacen(from, to, 1)).expect("it is a job");
        run(&job, &|_| Ok(vec![(0, vec![7, 8, 9, 10])]), &|_| panic!("it draws nothing"))
    }

    #[test]
    fn an_invalid_job_has_a_reason() {
        assert_eq!(reply("", ""), Reply::Done(vec![vec![7, 8]]));
        for (from, to, reason) in [
            (
                r#""jobs": 1"#,
                r#""jobs": 2"#,
                "the job has version 2, but this program reads version 1",
            ),
            (
                r#""jobs": 1"#,
                r#""jobs": 0"#,
                "the job has version 0, but this program reads version 1",
            ),
            ("[0, 0], \"resource", "[0, 1], \"resource", "the job binds no resource to `pass0::x`"),
            (r#""resource": 0"#, r#""resource": 1"#, "the job has no resource 1"),
            ("[0, 0]}}", "[0]}}, {\"buffer\": {\"words\": [1]}}", "no pass uses resource 1"),
            (r#""outputs": [0]"#, r#""outputs": [0, 1]"#, "no pass writes resource 1"),
        ] {
            let Reply::Failed(problem) = reply(from, to) else { panic!("{to} is no job") };
            assert_eq!(problem.message, reason);
        }
        let sampler = serde_json::to_string(&crate::fixture::Sampler::LINEAR).expect("plain data");
        let sampler = format!(r#"{{"sampler": {sampler}}}"#);
        let unfit = reply(r#"{"buffer": {"words": [0, 0]}}"#, &sampler);
        let (Reply::Failed(problem) | Reply::Refused(problem)) = unfit else {
            panic!("a sampler is no buffer")
        };
        assert!(problem.message.contains("the fixture is a Sampler"), "{}", problem.message);
        for (from, to) in
            [("[1, 1, 1]", "[1, 0, 1]"), ("[1, 1, 1]", "[65536, 1, 1]"), ("\"f\"", "\"g\"")]
        {
            assert!(!matches!(reply(from, to), Reply::Done(_)), "{to}");
        }
    }

    /// A frame that another executor draws as a job keeps its settings: its size, blending, formats. In this test,
    /// each setting differs from its default.
    #[test]
    fn a_frame_keeps_its_state() {
        let text = "@fragment fn fs() -> @location(0) vec4f { return vec4f(1.0); }";
        let package = Package::from_modules("p", [("m", text)]);
        let state = |scene: &Scene<'_>| {
            let Scene { width, height, prepass, blend, formats, result, .. } = scene;
            let Scene { samples, clear, clear_depth, draws, .. } = scene;
            format!(
                "{width} {height} {prepass} {blend:?} {formats:?} {result:?} {samples} {clear:?} {clear_depth} {draws:?}"
            )
        };
        let scene = Scene {
            draws: vec![crate::draw::Draw::fragment("fs")],
            blend: crate::draw::Blend::Alpha,
            formats: vec![crate::draw::Format::Rgba8Unorm],
            samples: 4,
            clear: [0.25, 0.5, 0.75, 1.0],
            clear_depth: 0.5,
            ..Scene::new(&package, "m", (2, 3))
        };
        let usual = state(&Scene::new(&package, "m", (2, 3)));
        let drawing = Drawing::of(Cow::Owned(scene)).expect("it is sound");
        let job = Job::of_drawing(&drawing).expect("it is a job");
        let seen = std::cell::RefCell::new(String::new());
        let draw = |drawing: &Drawing<'_>| {
            seen.replace(state(drawing.scene()));
            Ok(Image::new(2, 3, vec![[1.0; 4]; 6]))
        };
        let reply = run(&job, &|_: &Passes| panic!("it dispatches nothing"), &draw);
        assert_eq!(reply, Reply::Done(vec![vec![1.0_f32.to_bits(); 24]]));
        assert_eq!(*seen.borrow(), state(drawing.scene()));
        assert_ne!(*seen.borrow(), usual);
    }

    /// A problem in a job's reply has the number of the invalid pass, and a byte range in that pass's text.
    #[test]
    fn a_problem_of_a_job_names_its_pass_and_byte_range() {
        let mut job: Job = serde_json::from_str(JOB).expect("it is a job");
        let Work::Passes(passes) = &mut job.work else { unreachable!("it has passes") };
        let mut second = passes[0].clone();
        second.shader.wgsl = second.shader.wgsl.replace("x = 7u", "x = 7.5");
        let text = second.shader.wgsl.clone();
        passes.push(second);
        let nothing = |_: &Passes| panic!("nothing runs");
        let Reply::Refused(problem) = run(&job, &nothing, &|_| panic!("it draws nothing")) else {
            panic!("the second pass isn't valid")
        };
        let bytes = problem.bytes.expect("it has a place");
        let place = text[..bytes.start].contains("fn f()");
        assert_eq!((problem.pass, place), (1, true), "{}", problem.message);
    }
}
