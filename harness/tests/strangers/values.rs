//! Goldens of values: results of functions, and buffers after passes.

use std::path::PathBuf;

use karat::check::{Calls, Failure};
use karat::compute::ComputeError;
use karat::fixture::Buffer;
use karat::prelude::*;
use karat::unstable::golden::{AcceptError, Acceptance, Pending, Table, build_output, in_ci};
use karat::unstable::run::WrongDeclaration;
use karat::{Check, Goldens};
use tempfile::TempDir;

/// A folder of goldens, and the folder of pending files. In CI all tests share the folder of pending files, so each
/// test gives its goldens names that no other test uses.
pub(crate) struct Project {
    folder: TempDir,
    pub(crate) goldens: Goldens,
}

impl Project {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        Self { goldens: Goldens::open(folder.path()), folder }
    }

    fn waiting() -> Option<PathBuf> {
        in_ci().then(|| build_output().join("karat/pending"))
    }

    fn pending(&self, case: &str) -> Option<Pending> {
        let folder = Self::waiting().unwrap_or_else(|| self.folder.path().to_owned());
        let mut found = Goldens::open(&folder).select(case).ok()?.frames;
        assert_eq!(found.len(), 1, "{case}");
        found.pop()
    }

    pub(crate) fn accept(&self, case: &str) {
        let pending = self.pending(case).expect("it waits");
        let because = "as it should be".to_owned();
        let acceptance =
            Acceptance { because, any_adapter: true, ci_may_write: true, ..Acceptance::default() };
        self.goldens.accept(&pending, &acceptance).expect("accepted");
        assert!(self.pending(case).is_none(), "it waits no longer");
    }

    /// The text of the TOML file beside a golden frame.
    pub(crate) fn facts(&self, case: &str) -> String {
        std::fs::read_to_string(self.folder.path().join(format!("{case}.toml"))).expect("facts")
    }

    fn text(&self, case: &str) -> String {
        std::fs::read_to_string(self.folder.path().join(format!("{case}.csv"))).expect("a golden")
    }
}

fn curve(factor: &str) -> Package {
    Package::from_source(
        "tone",
        format!(
            "fn curve(x: f32, n: u32) -> vec2f {{ return vec2f(x * {factor} + f32(n), sin(x)); }}"
        ),
    )
}

fn over(package: &Package) -> Check<'_, Calls<(f32, u32)>> {
    package.function("curve").over((0.0..=1.0_f32, Integers(0..=3_u32))).cases(40)
}

#[test]
fn values_of_a_function_are_kept_and_compared() {
    let (project, case) = (Project::new(), "values/curve");
    let goldens = &project.goldens;
    let twice = curve("2.0");
    let error =
        over(&twice).unrecorded().try_matches(goldens, case, Ulp(4.0)).expect_err("no golden");
    assert!(matches!(error, Failure::Golden { disagreement: None, .. }), "{error}");
    let error = error.to_string();
    assert!(error.contains("the values `values/curve` have no golden; look at `"), "{error}");
    assert!(error.contains("values/curve.new.csv` and accept it with `karat accept"), "{error}");
    let accepted = project.folder.path().join("values/curve.csv");
    assert!(!accepted.exists(), "only accepting writes a golden");
    project.accept(case);
    let text = project.text(case);
    assert!(text.starts_with("# schema = 1\n# case = \"values/curve\"\n"), "{text}");
    assert!(text.contains("\nx,n,result.x,result.y\n"), "{text}");
    assert_eq!(text.lines().filter(|line| !line.starts_with('#')).count(), 41, "{text}");

    let agreement =
        over(&twice).unrecorded().try_matches(goldens, case, Ulp(4.0)).expect("the same");
    assert_eq!(agreement.cases, 40);
    // The arguments of a golden don't depend on the seed of the run.
    for slightly in ["2.00001", "(2.0 + select(0.0, 1e-3, n == 3u))"] {
        let changed = curve(slightly);
        let error = over(&changed)
            .unrecorded()
            .try_matches(goldens, case, Ulp(4.0))
            .expect_err("it changed");
        let Failure::Golden { disagreement: Some(differs), .. } = &error else {
            panic!("not a golden that differs: {error}")
        };
        assert_eq!(differs.check, "matches");
        let error = error.to_string();
        for part in
            ["fails matches: golden `values/curve`, 4 ulp", "differ from their golden", "replay:"]
        {
            assert!(error.contains(part), "no `{part}` in:\n{error}");
        }
        // A tolerance for one path may be wider.
        over(&changed).unrecorded().try_matches(goldens, case, Rel(0.01)).expect("near enough");
    }
    let pending = project.pending(case);
    assert!(pending.is_none(), "what agrees again waits no longer");
    over(&curve("3.0")).unrecorded().try_matches(goldens, case, Rel(1e-3)).expect_err("it changed");
    let pending = project.pending(case).expect("it waits");
    assert!(pending.is_table() && !pending.is_new());
    let rows = pending.changed_rows(goldens).expect("two tables");
    assert!(!rows.is_empty() && rows.len() < 40, "x = 0 is the same: {}", rows.len());
    assert!(rows.windows(2).all(|pair| pair[0].relative >= pair[1].relative));
    assert_eq!((rows[0].arguments.len(), rows[0].golden.len(), rows[0].actual.len()), (2, 2, 2));
    goldens.reject(&pending).expect("rejected");
    assert_eq!(project.text(case), text, "no test writes a golden");
}

#[test]
fn other_arguments_have_to_be_accepted() {
    let (project, case) = (Project::new(), "values/arguments");
    let goldens = &project.goldens;
    let package = curve("2.0");
    over(&package).unrecorded().try_matches(goldens, case, Ulp(4.0)).expect_err("no golden");
    project.accept(case);
    let fewer = over(&package).cases(39).unrecorded().try_matches(goldens, case, Ulp(4.0));
    let error = fewer.expect_err("fewer cases").to_string();
    assert!(
        error.contains("agrees for the golden's arguments, but the test has other arguments now"),
        "{error}"
    );
    let wider = package.function("curve").over((0.0..=2.0_f32, Integers(0..=3_u32)));
    let error = wider
        .cases(40)
        .unrecorded()
        .try_matches(goldens, case, Ulp(4.0))
        .expect_err("a wider domain");
    assert!(error.to_string().contains("the test's domain, number of cases or seed"), "{error}");
    project.accept(case);
    over(&package)
        .unrecorded()
        .try_matches(goldens, case, Ulp(4.0))
        .expect_err("now the narrower one is another");

    let other = Package::from_source("tone", "fn curve(x: f32) -> f32 { return x; }");
    let other = other.function("curve").over(0.0..=1.0_f32).unrecorded().try_matches(
        goldens,
        case,
        Ulp(4.0),
    );
    let error = other.expect_err("another function").to_string();
    let columns = "its columns are x: f32, n: u32 -> result.x: f32, result.y: f32, but the result has the columns \
                   x: f32 -> result: f32";
    assert!(error.contains(columns), "{error}");
}

#[test]
fn values_that_can_never_agree_are_errors() {
    let (project, goldens) = (Project::new(), Goldens::open("nowhere".as_ref()));
    let package = Package::from_source(
        "m",
        "fn root(x: f32) -> f32 { return sqrt(x); }\nfn half(x: f32) -> f32 { return x / 2.0; }",
    );
    let root = package.function("root").over(-1.0..=1.0_f32).cases(16);
    let error = root
        .unrecorded()
        .try_matches(&goldens, "values/root", Ulp(4.0))
        .expect_err("NaN")
        .to_string();
    assert!(error.contains("`values/root` can't be compared: `result` is NaN in row"), "{error}");
    let half = || package.function("half").over(0.0..=1.0_f32).cases(16);
    for (name, part) in [("../up", "can't name a golden"), ("", "can't name a golden")] {
        let error =
            half().unrecorded().try_matches(&project.goldens, name, Ulp(4.0)).expect_err(name);
        assert!(error.to_string().contains(part), "{error}");
    }
    let case = "values/half";
    half().unrecorded().try_matches(&project.goldens, case, Ulp(4.0)).expect_err("no golden");
    project.accept(case);
    let text = project.text(case);
    let write = |text: &str| {
        std::fs::write(project.folder.path().join("values/half.csv"), text).expect("written");
        half().unrecorded().try_matches(&project.goldens, case, Ulp(4.0))
    };
    write(&text).expect("as it was");
    let cell = text.lines().last().expect("a row").split_once(',').expect("two cells").1;
    for (damaged, part) in [
        (
            text.replacen("x,result", "x", 1),
            "has 1 column, but the metadata describes other columns",
        ),
        (text.replacen(&format!(",{cell}\n"), ",much\n", 1), "`much` isn't a finite f32"),
        (text.replacen(&format!(",{cell}\n"), ",NaN\n", 1), "`NaN` isn't a finite f32"),
        (text.replacen(&format!(",{cell}\n"), "\n", 1), "has 1 cell in 2 columns"),
        (text.replacen("# schema = 1", "# schema = 7", 1), "comes from a newer Karat"),
        (text.replacen("# case", "# [case", 1), "can't be used"),
        (String::new(), "can't be used"),
        (
            text.lines()
                .filter(|line| line.starts_with('#'))
                .map(|line| format!("{line}\n"))
                .collect(),
            "has no header line",
        ),
        (
            text.split_inclusive("result\n").next().unwrap_or_default().to_owned(),
            "is the header, but no rows follow",
        ),
    ] {
        let error = write(&damaged).expect_err(part).to_string();
        assert!(error.contains(part) && error.contains("half.csv"), "{part}: {error}");
    }
    // Changes one digit of one row.
    let number: f32 = cell.parse().expect("a number");
    let off = text.replacen(&format!(",{cell}\n"), &format!(",{}\n", number + 0.001), 1);
    let error = write(&off).expect_err("one row").to_string();
    assert!(error.contains("1 of 16 cases") || error.contains("1 of 16 rows"), "{error}");
    let error = half()
        .unrecorded()
        .try_matches(&project.goldens, case, Ulp(f64::NAN))
        .expect_err("no bound");
    assert!(error.to_string().contains("NaN"), "{error}");
}

#[test]
fn a_declared_failure_leaves_no_pending_file() {
    let (project, case) = (Project::new(), "values/known");
    over(&curve("2.0"))
        .unrecorded()
        .try_matches(&project.goldens, case, Ulp(4.0))
        .expect_err("no golden");
    project.accept(case);
    let wrong = curve("2.5");
    let paths = karat::unstable::path::selected().expect("paths");
    let check = paths
        .iter()
        .fold(over(&wrong), |check, path| check.fails_on(*path, "the bug of this test"));
    let agreement =
        check.unrecorded().try_matches(&project.goldens, case, Ulp(4.0)).expect("as declared");
    assert_eq!(agreement.known_issues.len(), paths.len());
    assert!(project.pending(case).is_none(), "nobody has to look at it");
    let right = curve("2.0");
    let check = over(&right).fails_on(paths[0], "the bug of this test");
    let error =
        check.unrecorded().try_matches(&project.goldens, case, Ulp(4.0)).expect_err("it agrees");
    assert!(
        matches!(error, Failure::Declaration(WrongDeclaration::UnexpectedPass { .. })),
        "{error}"
    );
}

#[test]
fn elements_that_passes_leave_are_kept_and_compared() {
    let (project, case) = (Project::new(), "values/passes");
    let goldens = &project.goldens;
    let source = |factor: &str| {
        Package::from_source(
            "m",
            format!(
                "struct Particle {{ place: vec2f, id: u32 }}
                 @group(0) @binding(0) var<storage, read_write> particles: array<Particle>;
                 @compute @workgroup_size(8) fn spawn(@builtin(global_invocation_id) id: vec3u) {{
                     let x = f32(id.x);
                     particles[id.x] = Particle(vec2f(x, x * {factor}), id.x);
                 }}"
            ),
        )
    };
    let compare = |factor: &str, count: usize| {
        let package = source(factor);
        let passes = package.compute().with("particles", Buffer::zeros(16 * count));
        passes.dispatch("spawn", [1, 1, 1]).after("particles").unrecorded().try_matches(
            goldens,
            case,
            Ulp(1.0),
        )
    };
    let error = compare("0.5", 8).expect_err("no golden");
    assert!(matches!(error, ComputeError::Golden { difference: None, .. }), "{error}");
    project.accept(case);
    let text = project.text(case);
    assert!(
        text.contains("\nparticles.place.x,particles.place.y,particles.id\n0,0,0\n1,0.5,1\n"),
        "{text}"
    );
    assert_eq!(compare("0.5", 8).expect("the same").elements, 8);
    let error = compare("0.6", 8).expect_err("it changed").to_string();
    for part in ["after `spawn` fails: 1 ulp", "7 of 8 elements on", "`karat accept values/passes"]
    {
        assert!(error.contains(part), "no `{part}` in:\n{error}");
    }
    let error = compare("0.5", 7).expect_err("fewer").to_string();
    assert!(error.contains("the golden has 8 elements, but the result has 7"), "{error}");
    compare("0.5", 8).expect("the same again");
    assert!(project.pending(case).is_none(), "what agrees again waits no longer");
}

#[test]
fn accepting_values_has_the_rules_of_accepting_frames() {
    let (project, case) = (Project::new(), "values/rules");
    let goldens = &project.goldens;
    let package = curve("2.0");
    over(&package).unrecorded().try_matches(goldens, case, Ulp(4.0)).expect_err("no golden");
    let pending = project.pending(case).expect("it waits");
    let accept = |change: fn(&mut Acceptance)| {
        let mut acceptance =
            Acceptance { because: "right".to_owned(), ci_may_write: true, ..Acceptance::default() };
        change(&mut acceptance);
        goldens.accept(&pending, &acceptance)
    };
    assert!(matches!(accept(|a| a.because = " ".to_owned()), Err(AcceptError::NoReason(_))));
    let of_profile = accept(|a| a.profile = Some("gl-llvmpipe".to_owned()));
    assert!(matches!(of_profile, Err(AcceptError::OneForAll(_))), "{of_profile:?}");
    let text = std::fs::read_to_string(&pending.path).expect("there");
    let (facts, last) = text.trim_end().rsplit_once('\n').expect("rows");
    std::fs::write(&pending.path, format!("{facts}\n")).expect("written");
    assert!(matches!(accept(|_| ()), Err(AcceptError::Altered(_))), "a row less");
    std::fs::write(&pending.path, format!("{facts}\n{last}\n")).expect("written");
    accept(|a| a.any_adapter = true).expect("accepted");
    let (table, provenance) =
        Table::read(&project.folder.path().join("values/rules.csv")).expect("a golden");
    assert_eq!((table.len(), table.arguments), (40, 2));
    assert_eq!(
        (provenance.because.as_str(), provenance.width, provenance.height),
        ("right", 4, 40)
    );
    // The pending values were compared with a golden that has been replaced since.
    over(&curve("3.0")).unrecorded().try_matches(goldens, case, Ulp(4.0)).expect_err("it changed");
    let stale = project.pending(case).expect("it waits");
    let golden = project.text(case).replacen(last, "0.5,1,7,8", 1);
    std::fs::write(project.folder.path().join("values/rules.csv"), golden).expect("written");
    let stale = goldens.accept(
        &stale,
        &Acceptance {
            because: "right".to_owned(),
            any_adapter: true,
            ci_may_write: true,
            ..Acceptance::default()
        },
    );
    assert!(matches!(stale, Err(AcceptError::Stale(_))), "{stale:?}");
}
