//! Tests that are written in WGSL: each is called by a function that returns what it reports.

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

/// The name under which generated modules import the package of a test.
const TESTED: &str = "karat_tested";

/// A function with `@test`.
#[derive(Clone, Debug)]
pub struct WgslTest {
    /// `brdf_test::is_a_fraction`
    pub name: String,
    /// All of it, in the author's file.
    pub span: Span,
    /// `@cases`: how many cases it wants.
    pub cases: Option<u64>,
    /// `@over` of each parameter: its words and numbers, and where it stands.
    pub over: Vec<Option<(Vec<String>, Span)>>,
    /// What it is made of.
    normalized_text: Option<String>,
    /// Its parameters as they are written, if their types have the same names everywhere.
    written: Option<Vec<(String, String)>>,
    package: Package,
    module: String,
    /// Features that are set of the package.
    features: Arc<Features>,
    /// What is known of it when it is linked.
    made: Arc<OnceLock<Result<Made, Arc<ReflectError>>>>,
}

/// A test that is valid WGSL.
#[derive(Clone, Debug)]
struct Made {
    parameters: Vec<(String, Shape)>,
    calls: BTreeSet<String>,
    /// The module that calls it, and returns how many expectations may have failed.
    counting: Package,
    /// The same with what they saw.
    telling: Package,
}

impl Package {
    /// The tests of each of some modules, in the order of lines: functions with `@test`. Whether each is
    /// valid WGSL is seen when it is [used](WgslTest::parameters).
    ///
    /// # Errors
    /// If the package can't be read; of each module, if that one can't.
    ///
    /// *Unstable*: for programs around tests.
    pub fn tests_in(
        &self,
        modules: &[String],
    ) -> Result<Vec<Result<Vec<WgslTest>, ReflectError>>, PackageError> {
        let (found, features) = self.test_items(modules)?;
        let (found, features) = (found.into_iter().zip(modules), Arc::new(features));
        let new = |module: &str, item: TestItem, normalized_text: Option<String>| {
            // Of which parameter each is counts, too.
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

    /// The test with its parameters as they are written: linked once, with what calls it. `None` if anything
    /// is wrong.
    fn copied(&self, written: &[(String, String)]) -> Option<Made> {
        let typed: Vec<_> = written.iter().map(|(name, ty)| (&**name, ty.clone())).collect();
        let [counting, telling] = self.generated(&typed, &BTreeMap::new());
        let program = Program::of_function(&counting, &self.name).ok()?;
        let path = format!("{TESTED}::{}", self.name);
        let parameters = program.test_parameters(&path).ok()?;
        // As the package has them that the test is of.
        let own = |name: String| match name.strip_prefix(TESTED) {
            Some(rest) => rest.trim_start_matches([':', '/']).to_owned(),
            None => name,
        };
        let calls = program.calls(&path).into_iter().map(own).collect();
        Some(Made { calls, parameters, counting, telling })
    }

    /// The types of its parameters as another module has them; structs by their imports.
    fn types(&self, structs: &mut BTreeMap<String, String>) -> Result<Vec<String>, ReflectError> {
        if let Some(written) = &self.written {
            return Ok(written.iter().map(|(_, ty)| ty.clone()).collect());
        }
        let program = Program::of_function(&self.package, &self.name)?;
        let parameters = program.test_parameters(&self.name)?;
        Ok(parameters.iter().map(|(_, shape)| type_text(&program, shape, structs)).collect())
    }

    /// Modules that call it: one that returns how many expectations may have failed, and one that returns
    /// what they saw.
    fn generated(
        &self,
        typed: &[(&str, String)],
        structs: &BTreeMap<String, String>,
    ) -> [Package; 2] {
        let own = self.name.rsplit("::").next().unwrap_or_default();
        let list: Vec<String> = typed.iter().map(|(name, ty)| format!("{name}: {ty}")).collect();
        let names: Vec<&str> = typed.iter().map(|(name, _)| *name).collect();
        let (list, names) = (list.join(", "), names.join(", "));
        // A generated name can't be the author's: `karat_` is what kernels keep for themselves.
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

    /// What it is made of, but for comments and blanks: its verdict changes with this alone. `None` if it
    /// can't be linked.
    #[must_use]
    pub fn normalized_text(&self) -> Option<&str> {
        self.normalized_text.as_deref()
    }

    /// The names and types of its parameters.
    ///
    /// # Errors
    /// What is wrong with it, with its place.
    pub fn parameters(&self) -> Result<&[(String, Shape)], Arc<ReflectError>> {
        Ok(&self.made()?.parameters)
    }

    /// The functions that it calls: `brdf::schlick`; none if it isn't valid.
    pub fn calls(&self) -> impl Iterator<Item = &str> {
        let made = self.made().ok();
        made.into_iter().flat_map(|made| &made.calls).map(String::as_str)
    }

    /// The test as a function, to be given arguments and [run](super::Check::try_expects).
    ///
    /// # Errors
    /// What is wrong with it, with its place.
    pub fn probe(&self) -> Result<Probe<'_>, Arc<ReflectError>> {
        let place = Some((self.span.clone(), self.package.root()));
        let Made { counting, telling, .. } = self.made()?;
        Ok(Probe { place, telling: Some(telling), ..counting.function(&self.name) })
    }
}

/// Tests of one module that drivers count in one kernel: compiling one of several tests takes a fraction of
/// the time of several. Whatever isn't simply good there runs alone, and is told as if it always had.
#[derive(Debug)]
pub struct TestGroup {
    package: Package,
    function: String,
    shapes: Vec<Shape>,
    words: usize,
    /// Which it is, and where its arguments begin, by the test's name.
    members: BTreeMap<String, (u32, usize)>,
}

/// Tests of one kernel: compilers take more than in proportion for large ones.
const TOGETHER: usize = 8;

impl TestGroup {
    /// Groups of some tests; a test that no other one of its module is with, or that isn't valid, is in
    /// none.
    #[must_use]
    pub fn of(tests: &[&WgslTest]) -> Vec<Self> {
        let mut modules: BTreeMap<&str, Vec<&WgslTest>> = BTreeMap::new();
        for test in tests.iter().filter(|test| test.made().is_ok()) {
            modules.entry(&test.module).or_default().push(test);
        }
        let parts = modules.values().flat_map(|tests| tests.chunks(TOGETHER));
        parts.filter(|part| part.len() > 1).filter_map(Self::new).collect()
    }

    /// `None` of those that can't be linked together, and of those with lines that assert or print.
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
                test.parameters().expect("tests without are run otherwise").iter().zip(types)
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

    /// [`WgslTest::probe`] with the others: `None` if it isn't in this group.
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

/// A type as the generated module has it; structs by their imports.
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
