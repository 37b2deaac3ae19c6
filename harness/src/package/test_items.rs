//! Finds the WGSL tests of a module: functions with `@test`. In each test, Karat adds a number to each call of an
//! [expectation](crate::expectation). The number identifies the call's location.

use std::collections::BTreeSet;

use super::PackageError;
use super::lexer::Kind;
use super::syntax::{Declaration, Module};
use crate::diagnostic::{Diagnostic, Span};
use crate::expectation;

/// Removes the attributes of tests, and adds to each call of an expectation the number of the call's location.
pub(super) fn prepare(module: &mut Module) {
    for test in module.declarations.iter().filter(|declaration| declaration.test) {
        let attributes = attributes(module, test);
        let ranges: Vec<_> = attributes.iter().map(|a| module.bytes(&a.tokens)).collect();
        module.removed.extend(ranges);
    }
    module.removed.sort_by_key(|range| range.start);
    tell_places(module);
}

fn tell_places(module: &mut Module) {
    let mut known: BTreeSet<(Option<&'static str>, String)> = BTreeSet::new();
    for import in &module.imports {
        for name in ["karat", "wgsl_test"] {
            let names = &expectation::package(name).expect("Karat brings it").names;
            let mut words = import.clone().skip_while(|at| module.text(*at) != "import");
            if words.nth(1).is_none_or(|first| module.text(first) != name) {
                continue;
            }
            for at in import.clone().filter(|at| names.contains(module.text(*at))) {
                let alias = (module.text(at + 1) == "as").then_some(at + 2);
                known.insert((None, module.text(alias.unwrap_or(at)).to_owned()));
            }
        }
    }
    let mut told = Vec::new();
    for at in 0..module.tokens.len() {
        if !module.is_word(at) || !module.is(at + 1, b'(') {
            continue;
        }
        let name = module.text(at);
        // `karat::expect_near(`
        let path = at >= 3 && module.is(at - 1, b':') && module.is(at - 2, b':');
        let is_known = match path {
            true => expectation::package(module.text(at - 3))
                .is_some_and(|package| package.names.contains(name)),
            false => {
                known.contains(&(None, name.to_owned()))
                    && (at == 0 || (module.text(at - 1) != "fn" && !module.is(at - 1, b'.')))
            }
        };
        if is_known {
            told.push(at + 1);
        }
    }
    for open in told {
        let first = module.tokens[open - 1].range().start;
        let whole = first..module.tokens[module.brackets[open]].range().end;
        let mut hasher = blake3::Hasher::new();
        hasher.update(module.file.name.as_bytes()).update(&(first as u64).to_le_bytes());
        let mut word = [0; 4];
        word.copy_from_slice(&hasher.finalize().as_bytes()[..4]);
        let site = u32::from_le_bytes(word);
        let span = Span { file: std::sync::Arc::clone(&module.file), range: whole };
        module.calls.push((site, span));
        let comma = if module.brackets[open] == open + 1 { "" } else { ", " };
        module.replaced.push((module.tokens[open].range(), format!("({site}u{comma}")));
    }
    module.replaced.sort_by_key(|(range, _)| range.start);
}

struct Attribute {
    /// The tokens from `@` to the closing `)`.
    tokens: std::ops::Range<usize>,
    /// The attribute's name: `test`, `cases`, `over`.
    name: String,
    /// The index of the test's parameter with this `@over`; `None` for `@test` and `@cases`.
    parameter: Option<usize>,
}

/// The attributes `@test` and `@cases(..)` of a test, and `@over(..)` of its parameters.
fn attributes(module: &Module, test: &Declaration) -> Vec<Attribute> {
    let mut found = Vec::new();
    let open = test.name_token + 1;
    let mut end = test.tokens.start;
    let (mut parameter, mut depth) = (0, 0_usize);
    let last = if module.is(open, b'(') { module.brackets[open] } else { open };
    while end < last {
        match module.tokens[end].kind {
            Kind::Symbol(b',') if depth == 0 => parameter += 1,
            // A type may contain brackets: `array<f32, 2>`.
            Kind::Symbol(b'<') => depth += 1,
            Kind::Symbol(b'>') => depth = depth.saturating_sub(1),
            _ => {}
        }
        if !module.is(end, b'@') {
            // Skips brackets inside of an attribute or a type.
            end = match module.is(end, b'(') && end != open {
                true => module.brackets[end] + 1,
                false => end + 1,
            };
            continue;
        }
        let name = module.text(end + 1).to_owned();
        let has_arguments = module.is(end + 2, b'(') && name != "test";
        let after = if has_arguments { module.brackets[end + 2] + 1 } else { end + 2 };
        let inside = end > open;
        if (!inside && matches!(&*name, "test" | "cases")) || (inside && name == "over") {
            let parameter = inside.then_some(parameter);
            found.push(Attribute { tokens: end..after, name, parameter });
        }
        end = after;
    }
    found
}

/// A test as the author declares it.
#[derive(Clone, Debug)]
pub(crate) struct TestItem {
    /// The test's path: `brdf_test::schlick_at_grazing`.
    pub(crate) name: String,
    pub(crate) span: Span,
    /// The number of cases in `@cases`.
    pub(crate) cases: Option<u64>,
    /// For each parameter with `@over`, the words and numbers of its domain.
    pub(crate) over: Vec<Option<(Vec<String>, Span)>>,
    /// The name and the type of each parameter in the author's text. `None` if a parameter's type isn't WGSL's own: in
    /// another module, the type's name could mean another type.
    pub(crate) parameters: Option<Vec<(String, String)>>,
}

impl TestItem {
    pub(super) fn all_of(name: &str, module: &Module) -> Result<Vec<Self>, PackageError> {
        let tests = module.declarations.iter().filter(|declaration| declaration.test);
        tests.map(|test| item(name, module, test)).collect()
    }
}

fn item(name: &str, module: &Module, test: &Declaration) -> Result<TestItem, PackageError> {
    let own = test.name.as_deref().expect("a test is a function, which has a name");
    let name = if name.is_empty() { own.to_owned() } else { format!("{name}::{own}") };
    let span = |tokens: &std::ops::Range<usize>| Span {
        range: module.bytes(tokens),
        ..module.span(tokens.start)
    };
    let error = |place: Span, message: String, note: &str| {
        PackageError::Shader(Box::new(Diagnostic::new(message).at(place, "").note(note)))
    };
    let open = test.name_token + 1;
    let close = module.brackets[open];
    if module.is(close + 1, b'-') {
        let place = module.span(test.name_token);
        let message = format!("the test `{own}` has a return type");
        return Err(error(
            place,
            message,
            "remove the return type, and call expectations such as `expect_near(..)`",
        ));
    }
    let mut over: Vec<Option<(Vec<String>, Span)>> = Vec::new();
    let mut cases = None;
    for attribute in attributes(module, test) {
        let inside =
            (attribute.tokens.start + 3).min(attribute.tokens.end)..attribute.tokens.end - 1;
        // A sign and the number after the sign are one argument.
        let mut arguments = vec![String::new()];
        let is_value = |at: usize| !matches!(module.tokens[at].kind, Kind::Symbol(_));
        for at in inside.clone() {
            match module.tokens[at].kind {
                Kind::Symbol(b',') => arguments.push(String::new()),
                _ if at > inside.start && is_value(at) && is_value(at - 1) => {
                    let (first, second) = (module.text(at - 1), module.text(at));
                    let message = format!("a comma is missing between `{first}` and `{second}`");
                    let note = format!("write `@{}({first}, {second})`", attribute.name);
                    return Err(error(span(&(at - 1..at + 1)), message, &note));
                }
                _ => arguments.last_mut().expect("one at least").push_str(module.text(at)),
            }
        }
        // A trailing comma is allowed.
        arguments.pop_if(|last| last.is_empty());
        if arguments.iter().any(String::is_empty) {
            let message = format!("`@{}` has one comma too many", attribute.name);
            return Err(error(span(&attribute.tokens), message, "write a value before each comma"));
        }
        let stands = match attribute.parameter {
            None => cases.is_some(),
            Some(parameter) => over.get(parameter).is_some_and(Option::is_some),
        };
        if stands {
            let message = format!("`@{}` occurs twice", attribute.name);
            return Err(error(span(&attribute.tokens), message, "remove one of them"));
        }
        match (&*attribute.name, attribute.parameter) {
            ("cases", None) => {
                let [count] = &*arguments else {
                    let message = "`@cases` needs one number".to_owned();
                    return Err(error(span(&attribute.tokens), message, "write `@cases(1000)`"));
                };
                let count = count.trim_end_matches('u').parse().ok().filter(|count| *count > 0);
                let Some(count) = count else {
                    let message = "`@cases` needs a whole number of at least 1".to_owned();
                    return Err(error(span(&attribute.tokens), message, "write `@cases(1000)`"));
                };
                cases = Some(count);
            }
            (_, Some(parameter)) => {
                over.resize(over.len().max(parameter + 1), None);
                over[parameter] = Some((arguments, span(&attribute.tokens)));
            }
            _ => {}
        }
    }
    let parameters = parameters(module, open, close);
    if let (Some(_), Some([])) = (cases, parameters.as_deref()) {
        let place =
            attributes(module, test).into_iter().find(|attribute| attribute.name == "cases");
        let place = place.map_or_else(|| span(&test.tokens), |attribute| span(&attribute.tokens));
        let message = format!("the test `{own}` has no parameter, so it has only one case");
        return Err(error(place, message, "remove `@cases`"));
    }
    Ok(TestItem { name, span: span(&test.tokens), cases, over, parameters })
}

/// The parameters between two brackets. Returns `None` if a parameter's type isn't WGSL's own: in another module, the
/// type's name could mean another type.
fn parameters(module: &Module, open: usize, close: usize) -> Option<Vec<(String, String)>> {
    let all = module.bytes(&(open..close + 1));
    let is_shared = !module.includes.is_empty();
    if is_shared || module.replaced.iter().any(|(range, _)| all.contains(&range.start)) {
        return None;
    }
    let imported = |word: &str| {
        let mut tokens = module.imports.iter().flat_map(Clone::clone);
        tokens.any(|token| module.text(token) == word)
    };
    let means_other = |word: &str| module.declared(word).next().is_some() || imported(word);
    let mut found: Vec<(String, String)> = Vec::new();
    let mut at = open + 1;
    while at < close {
        if module.is(at, b'@') {
            let has_arguments = module.is(at + 2, b'(');
            at = if has_arguments { module.brackets[at + 2] + 1 } else { at + 2 };
            continue;
        }
        let (name, mut text, mut depth) = (module.text(at), String::new(), 0_usize);
        if !module.is_word(at) || !module.is(at + 1, b':') {
            return None;
        }
        at += 2;
        while at < close && !(depth == 0 && module.is(at, b',')) {
            let word = module.text(at);
            match module.tokens[at].kind {
                Kind::Symbol(b'<') => depth += 1,
                Kind::Symbol(b'>') => depth = depth.checked_sub(1)?,
                Kind::Symbol(b',') => {}
                _ if word.bytes().all(|byte| byte.is_ascii_digit()) => {}
                _ if is_builtin_type(word) && !means_other(word) => {}
                _ => return None,
            }
            text += word;
            at += 1;
        }
        found.push((name.to_owned(), text));
        at += 1;
    }
    Some(found)
}

/// Checks if a word may be in the type of a test's parameter: `array`, or a scalar (not `f16`), vector or matrix.
fn is_builtin_type(word: &str) -> bool {
    let size = |text: &str| matches!(text, "2" | "3" | "4");
    let is_vector =
        word.strip_prefix("vec").is_some_and(|rest| size(rest.trim_end_matches(['f', 'i', 'u'])));
    let sizes =
        word.strip_prefix("mat").and_then(|rest| rest.trim_end_matches('f').split_once('x'));
    let is_matrix = sizes.is_some_and(|(columns, rows)| size(columns) && size(rows));
    matches!(word, "f32" | "i32" | "u32" | "bool" | "array") || is_vector || is_matrix
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::package::Package;
    use crate::reflect::Program;

    #[test]
    fn the_packages_karat_and_wgsl_test_are_valid() {
        for name in ["karat", "wgsl_test"] {
            let expectations = expectation::package(name).expect("it is there");
            let package = Package::from_source(name, expectations.text.as_str());
            Program::of_module(&package, "").unwrap_or_else(|error| panic!("{name}: {error}"));
            assert!(expectations.names.len() > 10);
        }
    }

    #[test]
    fn types_that_all_modules_know_are_copied() {
        let of = |text: &str| {
            let package = Package::from_modules("p", [("a", text), ("b", "alias vec2f = i32;")]);
            let parsed = package.parsed("a").expect("it parses");
            let items = TestItem::all_of("a", &parsed).expect("they read");
            let known = items[0].parameters.clone()?;
            Some(
                known
                    .iter()
                    .map(|(name, ty)| format!("{name}: {ty}"))
                    .collect::<Vec<_>>()
                    .join("; "),
            )
        };
        let all = "@test fn t(@over(0, 1) a: array<vec3<f32>, 2>, k : bool, m: mat2x3f,) {}";
        assert_eq!(of(all).as_deref(), Some("a: array<vec3<f32>,2>; k: bool; m: mat2x3f"));
        assert_eq!(of("@test fn t() {}").as_deref(), Some(""));
        for other in [
            "@test fn t(x: Light) {}",
            "@test fn t(x: array<f32, N>) {}",
            "alias f32 = i32; @test fn t(x: f32) {}",
            "import package::b::vec2f; @test fn t(x: vec2f) {}",
            "enable f16; @test fn t(x: f16) {}",
            "@test fn t(x: vec5f) {}",
        ] {
            assert_eq!(of(other), None, "{other}");
        }
    }

    #[test]
    fn a_comma_of_a_type_separates_no_parameters() {
        let text = "@test fn t(a: array<f32, 2>, @over(0, 1) x: f32) {}";
        let parsed = Package::from_source("p", text).parsed("").expect("it parses");
        let items = TestItem::all_of("", &parsed).expect("they read");
        let over: Vec<_> = items[0].over.iter().map(Option::is_some).collect();
        assert_eq!(over, [false, true]);
    }

    #[test]
    fn tests_are_stripped_of_what_only_karat_knows() {
        let text = "import karat::{expect_near as near, expect_true};
fn half(x: f32) -> f32 { return 0.5 * x; }
@test @cases(8) fn halves(@over(-1.0, 1.0) x: f32, @over(unit_vector) n: vec3f, k: u32) {
    near(half(x), 0.5 * x, 0.0);
    karat::expect_true(true);
}
";
        let package = Package::from_source("p", text);
        assert!(package.functions().expect("it parses").iter().all(|item| item.name == "half"));
        let whole = Program::of_module(&package, "").expect("valid without its tests");
        assert!(!whole.text().contains("halves"), "{}", whole.text());
        let one = Program::of_function(&package, "halves").expect("valid with what it calls");
        assert!(!one.text().contains("@over") && one.text().contains("0.5 * x, 0.0)"));
        let parsed = package.parsed("").expect("it parses");
        let items = TestItem::all_of("", &parsed).expect("they read");
        let [item] = &*items else { panic!("{items:?}") };
        assert_eq!((&*item.name, item.cases), ("halves", Some(8)));
        let over: Vec<_> =
            item.over.iter().map(|over| over.as_ref().map(|o| o.0.join(" "))).collect();
        assert_eq!(over, [Some("-1.0 1.0".to_owned()), Some("unit_vector".to_owned())]);
    }
}
