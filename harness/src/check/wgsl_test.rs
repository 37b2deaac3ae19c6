//! Tests that are written in WGSL: each is called by a function that returns what it reports.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use super::Probe;
use crate::diagnostic::Span;
use crate::package::Package;
use crate::package::expectations::{REPORT_WORDS, TestItem};
use crate::reflect::{Program, ReflectError};
use crate::value::Shape;

/// The name under which generated modules import the package of a test.
const TESTED: &str = "karat_tested";

/// A function with `@test`.
///
/// ```wgsl
/// import package::fresnel::schlick;
/// import karat::{expect_near, expect_in_range};
///
/// @test fn grazing_light_is_reflected_whole() {
///     expect_near(schlick(0.04, 0.0), 1.0, 1e-6);
/// }
///
/// @test @cases(10000) fn is_a_fraction(@over(0, 1) f0: f32, @over(0, 1) cosine: f32) {
///     expect_in_range(schlick(f0, cosine), 0.0, 1.0);
/// }
/// ```
#[derive(Clone, Debug)]
pub struct WgslTest {
    /// `brdf_test::is_a_fraction`
    pub name: String,
    /// All of it, in the author's file.
    pub span: Span,
    /// `@cases`: how many cases it wants.
    pub cases: Option<u64>,
    /// The names and types of its parameters.
    pub parameters: Vec<(String, Shape)>,
    /// `@over` of each parameter: its words and numbers, and where it stands.
    pub over: Vec<Option<(Vec<String>, Span)>>,
    /// What it is made of.
    essence: String,
    /// The folder of its package.
    root: PathBuf,
    /// The module that calls it.
    generated: Package,
}

impl Package {
    /// The tests of one module, in the order of lines: functions with `@test`.
    ///
    /// # Errors
    /// If the module can't be read, or a test isn't valid WGSL.
    pub fn tests_in(&self, module: &str) -> Result<Vec<WgslTest>, ReflectError> {
        let items = self.test_items_in(module)?;
        items.into_iter().map(|item| WgslTest::new(self, module, item)).collect()
    }
}

impl WgslTest {
    fn new(package: &Package, module: &str, item: TestItem) -> Result<Self, ReflectError> {
        let program = Program::of_function(package, &item.name)?;
        let parameters = program.test_parameters(&item.name)?;
        let own = item.name.rsplit("::").next().unwrap_or_default();
        // A generated name can't be the author's: `karat_` is what kernels keep for themselves.
        let mut text = format!(
            "import karat::{{begin, report}};\nimport {TESTED}::{} as karat_test;\n",
            item.name
        );
        let mut structs = BTreeMap::new();
        let mut list = Vec::new();
        for (name, shape) in &parameters {
            list.push(format!("{name}: {}", type_text(&program, shape, &mut structs)));
        }
        for (path, alias) in &structs {
            writeln!(text, "import {TESTED}::{path} as {alias};").expect("text takes text");
        }
        let names: Vec<&str> = parameters.iter().map(|(name, _)| &**name).collect();
        writeln!(
            text,
            "fn {own}({}) -> array<u32, {REPORT_WORDS}> {{\n    begin();\n    karat_test({});\n    \
             return report();\n}}",
            list.join(", "),
            names.join(", "),
        )
        .expect("text takes text");
        let generated = Package::from_modules(&package.name(), [(module, text)]);
        let over = item.over.iter().flatten().map(|(words, _)| words.join(","));
        let over = over.collect::<Vec<_>>().join(";");
        let essence = format!("{} {:?} {over}", program.essence(), item.cases);
        Ok(Self {
            essence,
            name: item.name,
            span: item.span,
            cases: item.cases,
            over: item.over,
            parameters,
            root: package.root(),
            generated: generated.depends_on(TESTED, package),
        })
    }

    /// What it is made of, but for comments and blanks: its verdict changes with this alone.
    #[must_use]
    pub fn essence(&self) -> &str {
        &self.essence
    }

    /// The test as a function, to be given arguments and [run](super::DynamicCheck::expects).
    pub fn probe(&self) -> Probe<'_> {
        let place = Some((self.span.clone(), self.root.clone()));
        Probe { place, ..self.generated.function(&self.name) }
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
