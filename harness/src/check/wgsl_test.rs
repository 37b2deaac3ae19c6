//! Tests that are written in WGSL. For each test, Karat generates functions that call the test and report the
//! expectations that fail.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::sync::{Arc, OnceLock};

use super::{Probe, Together};
use crate::diagnostic::Span;
use crate::expectation::REPORT_WORDS;
use crate::interpret::asserted::has_lines;
use crate::package::test_items::TestItem;
use crate::package::{Features, Package, PackageError};
use crate::reflect::{Program, ReflectError};
use crate::value::{Scalar, Shape};

/// The name by which generated modules import the test's package.
const TESTED: &str = "karat_tested";

/// A test that is written in WGSL: a function with `@test`.
#[derive(Clone, Debug)]
pub struct WgslTest {
    /// The test's name, such as `brdf_test::is_a_fraction`.
    pub name: String,
    /// The position of the test in the author's file.
    pub span: Span,
    /// The number in `@cases`.
    pub cases: Option<u64>,
    /// For each parameter, the words and numbers in its `@over`, and the position of the `@over`. `None` for a
    /// parameter without `@over`.
    pub over: Vec<Option<(Vec<String>, Span)>>,
    /// The text of the test and of everything that the test uses, without comments and white space.
    normalized_text: Option<String>,
    /// The names and types of the parameters as the author wrote them. `None` if a type's name, such as a structure's
    /// name, can have another meaning in other modules.
    written: Option<Vec<(String, String)>>,
    package: Package,
    module: String,
    features: Arc<Features>,
    /// The linked test. Karat links the test at its first use.
    made: Arc<OnceLock<Result<Made, Arc<ReflectError>>>>,
}

/// The generated modules for a test that is valid WGSL.
#[derive(Clone, Debug)]
struct Made {
    parameters: Vec<(String, Shape)>,
    calls: BTreeSet<String>,
    /// The module whose function calls the test, and returns two counts: of the evaluated expectations, and of the
    /// expectations that seem to fail.
    counting: Package,
    /// The module whose function calls the test, and returns the values of the first expectations that seem to fail.
    /// Karat then judges these values on the host.
    telling: Package,
}

impl Package {
    /// Finds the tests in each of these modules, in the order of their lines. Tests are functions with `@test`.
    /// If a test isn't valid WGSL, you get an error only when you [use](WgslTest::parameters) the test.
    ///
    /// # Errors
    /// Returns an error if Karat can't read the package. If Karat can't read a module, the result for that module is an
    /// error.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn tests_in(
        &self,
        modules: &[String],
    ) -> Result<Vec<Result<Vec<WgslTest>, ReflectError>>, PackageError> {
        let (found, features) = self.test_items(modules)?;
        let (found, features) = (found.into_iter().zip(modules), Arc::new(features));
        let new = |module: &str, item: TestItem, normalized_text: Option<String>| {
            // Appends the arguments of `@cases` and `@over`, because they also change the verdict.
            let over: Vec<_> = item.over.iter().map(|over| over.as_ref().map(|o| &o.0)).collect();
            WgslTest {
                normalized_text: normalized_text
                    .map(|normalized_text| format!("{normalized_text} {:?} {over:?}", item.cases)),
                name: item.name,
                span: item.span,
                cases: item.cases,
                over: item.over,
                written: item.parameters,
                package: self.clone(),
                module: module.to_owned(),
                features: Arc::clone(&features),
                made: Arc::default(),
            }
        };
        let of_one = |(items, module): (Result<Vec<_>, PackageError>, &String)| {
            Ok(items?
                .into_iter()
                .map(|(item, normalized_text)| new(module, item, normalized_text))
                .collect())
        };
        Ok(found.map(of_one).collect())
    }
}

impl WgslTest {
    fn made(&self) -> Result<&Made, Arc<ReflectError>> {
        self.made.get_or_init(|| self.make().map_err(Arc::new)).as_ref().map_err(Arc::clone)
    }

    fn make(&self) -> Result<Made, ReflectError> {
        if let Some(made) = self.written.as_deref().and_then(|written| self.copied(written)) {
            return Ok(made);
        }
        let program = Program::of_function(&self.package, &self.name)?;
        let parameters = program.test_parameters(&self.name)?;
        let mut structs = BTreeMap::new();
        let types = self.types(&mut structs)?;
        let names = parameters.iter().map(|(name, _)| &**name);
        let typed: Vec<(&str, String)> = names.zip(types).collect();
        let [counting, telling] = self.generated(&typed, &structs);
        Ok(Made { calls: program.calls(&self.name), parameters, counting, telling })
    }

    /// Generates the modules that call the test, with the parameters' types as the author wrote them. This is fast,
    /// because Karat links the test only once, together with the generated function. `None` if there is an error.
    fn copied(&self, written: &[(String, String)]) -> Option<Made> {
        let typed: Vec<_> = written.iter().map(|(name, ty)| (&**name, ty.clone())).collect();
        let [counting, telling] = self.generated(&typed, &BTreeMap::new());
        let program = Program::of_function(&counting, &self.name).ok()?;
        let path = format!("{TESTED}::{}", self.name);
        let parameters = program.test_parameters(&path).ok()?;
        // The function's name inside the test's package.
        let own = |name: String| match name.strip_prefix(TESTED) {
            Some(rest) => rest.trim_start_matches([':', '/']).to_owned(),
            None => name,
        };
        let calls = program.calls(&path).into_iter().map(own).collect();
        Some(Made { calls, parameters, counting, telling })
    }

    /// Returns the names that the generated module uses for the parameters' types. Adds to `structs` each structure
    /// that the generated module must import.
    fn types(&self, structs: &mut BTreeMap<String, String>) -> Result<Vec<String>, ReflectError> {
        if let Some(written) = &self.written {
            return Ok(written.iter().map(|(_, ty)| ty.clone()).collect());
        }
        let program = Program::of_function(&self.package, &self.name)?;
        let parameters = program.test_parameters(&self.name)?;
        Ok(parameters.iter().map(|(_, shape)| type_text(&program, shape, structs)).collect())
    }

    /// Generates two modules, each with a function that calls the test: [`Made::counting`] and [`Made::telling`].
    fn generated(
        &self,
        typed: &[(&str, String)],
        structs: &BTreeMap<String, String>,
    ) -> [Package; 2] {
        let own = self.name.rsplit("::").next().unwrap_or_default();
        let list: Vec<String> = typed.iter().map(|(name, ty)| format!("{name}: {ty}")).collect();
        let names: Vec<&str> = typed.iter().map(|(name, _)| *name).collect();
        let (list, names) = (list.join(", "), names.join(", "));
        // Generated names begin with the reserved prefix `karat_`, so they can't equal the author's names.
        let texts = [("counts", 2), ("report", REPORT_WORDS)].map(|(report, words)| {
            let mut text = format!(
                "import karat::{{begin as karat_begin, {report} as karat_report}};\nimport {TESTED}::{} as karat_test;\n",
                self.name
            );
            for (path, alias) in structs {
                writeln!(text, "import {TESTED}::{path} as {alias};").expect("text takes text");
            }
            writeln!(
                text,
                "fn {own}({list}) -> array<u32, {words}> {{\n    karat_begin();\n    \
                 karat_test({names});\n    return karat_report();\n}}"
            )
            .expect("text takes text");
            text
        });
        let module = (&*self.module, &*self.span.file.text);
        self.package.around(TESTED, module, &self.features, texts)
    }

    /// The text of the test and of everything that the test uses, without comments and white space. An edit
    /// can change the verdict only if it changes this text. `None` if Karat can't link the test.
    #[must_use]
    pub fn normalized_text(&self) -> Option<&str> {
        self.normalized_text.as_deref()
    }

    /// The names and types of the test's parameters.
    ///
    /// # Errors
    /// Returns an error if the test isn't valid WGSL. The error has the position of the mistake in the author's file.
    pub fn parameters(&self) -> Result<&[(String, Shape)], Arc<ReflectError>> {
        Ok(&self.made()?.parameters)
    }

    /// The functions that the test calls, such as `brdf::schlick`. Empty if the test isn't valid.
    pub fn calls(&self) -> impl Iterator<Item = &str> {
        let made = self.made().ok();
        made.into_iter().flat_map(|made| &made.calls).map(String::as_str)
    }

    /// A probe that runs the test. Give the probe a domain, then [run](super::Check::try_expects) it.
    ///
    /// # Errors
    /// Returns an error if the test isn't valid WGSL. The error has the position of the mistake in the author's file.
    pub fn probe(&self) -> Result<Probe<'_>, Arc<ReflectError>> {
        let place = Some((self.span.clone(), self.package.root()));
        let Made { counting, telling, .. } = self.made()?;
        Ok(Probe { place, telling: Some(telling), ..counting.function(&self.name) })
    }
}

/// Tests of one module that run together in one kernel. Compiling one kernel with several tests is much faster than
/// compiling several kernels. If a test fails in the shared kernel, Karat runs that test again in its own kernel, and
/// reports only the second run.
#[derive(Debug)]
pub struct TestGroup {
    package: Package,
    function: String,
    shapes: Vec<Shape>,
    words: usize,
    /// A map from a test's name to the test's number in the kernel, and to the index of the first word of the test's
    /// arguments.
    members: BTreeMap<String, (u32, usize)>,
}

/// The largest number of tests in one kernel. A kernel with twice as many tests takes more than twice as long to
/// compile.
const TOGETHER: usize = 8;

impl TestGroup {
    /// Groups the tests by module. A test is in no group if it isn't valid WGSL, or if no other test of its module is
    /// left to share a kernel.
    #[must_use]
    pub fn of(tests: &[&WgslTest]) -> Vec<Self> {
        let mut modules: BTreeMap<&str, Vec<&WgslTest>> = BTreeMap::new();
        for test in tests.iter().filter(|test| test.made().is_ok()) {
            modules.entry(&test.module).or_default().push(test);
        }
        let parts = modules.values().flat_map(|tests| tests.chunks(TOGETHER));
        parts.filter(|part| part.len() > 1).filter_map(Self::new).collect()
    }

    /// Makes a group. `None` if Karat can't link the tests together, or if a test calls Karat's functions that assert
    /// or print.
    fn new(tests: &[&WgslTest]) -> Option<Self> {
        let mut text = "import karat::{begin, counts};\n".to_owned();
        let (mut list, mut calls) = (vec!["karat_which: u32".to_owned()], String::new());
        let (mut structs, mut members) = (BTreeMap::new(), BTreeMap::new());
        let (mut shapes, mut words) = (vec![Shape::Scalar(Scalar::U32)], 1);
        let (package, module) = (&tests[0].package, &*tests[0].module);
        for (which, test) in (0..).zip(tests) {
            writeln!(text, "import {TESTED}::{} as karat_test{which};", test.name)
                .expect("text takes text");
            members.insert(test.name.clone(), (which, words));
            let mut names = Vec::new();
            let types = test.types(&mut structs).ok()?;
            for ((name, shape), ty) in
                test.parameters().expect("only tests with parameters come here").iter().zip(types)
            {
                let name = format!("karat_{which}_{name}");
                list.push(format!("{name}: {ty}"));
                words += shape.lanes().len();
                shapes.push(shape.clone());
                names.push(name);
            }
            writeln!(
                calls,
                "        case {which}u: {{ karat_test{which}({}); }}",
                names.join(", ")
            )
            .expect("text takes text");
        }
        for (path, alias) in &structs {
            writeln!(text, "import {TESTED}::{path} as {alias};").expect("text takes text");
        }
        writeln!(
            text,
            "fn counted({}) -> array<u32, 2> {{\n    begin();\n    switch karat_which {{\n{calls}        \
             default: {{}}\n    }}\n    return counts();\n}}",
            list.join(", ")
        )
        .expect("text takes text");
        let function =
            if module.is_empty() { "counted".to_owned() } else { format!("{module}::counted") };
        let module = (module, &*tests[0].span.file.text);
        let [package] = package.around(TESTED, module, &tests[0].features, [text]);
        let program = Program::of_function(&package, &function).ok()?;
        (!has_lines(&program)).then_some(Self { package, function, shapes, words, members })
    }

    /// Returns a probe like [`WgslTest::probe`] does, but the probe runs the test in the group's kernel. `None`
    /// if the test isn't in this group.
    pub fn probe<'a>(&'a self, test: &'a WgslTest) -> Option<Probe<'a>> {
        let (which, first) = *self.members.get(&test.name)?;
        let together = Together {
            package: &self.package,
            function: &self.function,
            shapes: &self.shapes,
            which,
            first,
            words: self.words,
        };
        Some(Probe { together: Some(together), ..test.probe().ok()? })
    }
}

/// Returns the name that the generated module uses for a type. Adds to `structs` each structure that the generated
/// module must import.
fn type_text(program: &Program, shape: &Shape, structs: &mut BTreeMap<String, String>) -> String {
    match shape {
        Shape::Struct { name, .. } => {
            let path = program.author_path(name).unwrap_or(name).to_owned();
            let next = format!("KaratType{}", structs.len());
            structs.entry(path).or_insert(next).clone()
        }
        Shape::Array { element, length } => {
            format!("array<{}, {length}>", type_text(program, element, structs))
        }
        other => other.to_string(),
    }
}
