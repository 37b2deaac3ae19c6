//! Tests in WGSL: functions with `@test` that call expectations, such as `expect_near`.
//!
//! Expectations come from the package `karat`, and from `wgsl_test` under the names that the WESL
//! community's test runner has for them. Both are Karat's own, so `import karat::expect_near;` works in
//! any package. Each call is told its place: the linker writes a number behind its `(`. What an
//! expectation saw is kept in private variables; who runs the test judges it on the host.

use std::collections::{BTreeSet, HashMap};
use std::fmt::Write as _;
use std::sync::{LazyLock, Mutex, PoisonError};

use super::lexer::Kind;
use super::syntax::{Declaration, Module};
use super::{Package, PackageError};
use crate::diagnostic::{Diagnostic, Span};

/// What an expectation that may fail keeps: its place, its kind and how many components it has, the
/// values, what was expected of them, and two bounds.
pub(crate) const KEPT_WORDS: usize = 12;

/// How many of them a case keeps. A test with more failures than these is told by those and a count.
pub(crate) const MOST_KEPT: usize = 3;

/// Words of what a test returns: how many expectations were evaluated, how many of them may have
/// failed, and the first of these.
pub(crate) const REPORT_WORDS: usize = 2 + MOST_KEPT * KEPT_WORDS;

/// What an expectation wants. The numbers are those in the generated WGSL.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wanted {
    True,
    EqualU32,
    EqualI32,
    EqualF32,
    /// At most this far apart.
    Near,
    /// At most this far apart, as a share of what is expected.
    Relative,
    /// At most so many `f32` steps apart.
    Ulp,
    /// Within the larger of an absolute and a relative distance.
    Within,
    Finite,
    AtMost,
    Less,
    InRange,
}

impl Wanted {
    pub(crate) const ALL: [Self; 12] = [
        Self::True,
        Self::EqualU32,
        Self::EqualI32,
        Self::EqualF32,
        Self::Near,
        Self::Relative,
        Self::Ulp,
        Self::Within,
        Self::Finite,
        Self::AtMost,
        Self::Less,
        Self::InRange,
    ];
}

/// The text of a package of expectations, and their names.
struct Brought {
    text: String,
    names: BTreeSet<String>,
}

impl Brought {
    fn new(text: String) -> Self {
        let declared = text.split("fn expect").skip(1);
        let names = declared.filter_map(|rest| Some(format!("expect{}", rest.split('(').next()?)));
        Self { names: names.collect(), text }
    }
}

static KARAT: LazyLock<Brought> = LazyLock::new(|| Brought::new(karat()));
static WGSL_TEST: LazyLock<Brought> = LazyLock::new(|| Brought::new(wgsl_test()));

/// The package that Karat brings under a name.
pub(super) fn package(name: &str) -> Option<Package> {
    let brought = brought(name)?;
    Some(Package::from_source(name, brought.text.as_str()))
}

fn brought(name: &str) -> Option<&'static Brought> {
    match name {
        "karat" => Some(&KARAT),
        "wgsl_test" => Some(&WGSL_TEST),
        _ => None,
    }
}

/// Suffixes of the functions for one to four components, and their types.
const FLOATS: [(&str, &str); 4] =
    [("", "f32"), ("_vec2", "vec2f"), ("_vec3", "vec3f"), ("_vec4", "vec4f")];
const WHOLES: [(&str, &str); 4] =
    [("_u32", "u32"), ("_vec2u", "vec2u"), ("_vec3u", "vec3u"), ("_vec4u", "vec4u")];
const SIGNED: [(&str, &str); 4] =
    [("_i32", "i32"), ("_vec2i", "vec2i"), ("_vec3i", "vec3i"), ("_vec4i", "vec4i")];

/// `x`, or its components and zeros, as four words.
fn words(x: &str, width: usize) -> String {
    match width {
        1 => format!("vec4u(bitcast<u32>({x}), 0u, 0u, 0u)"),
        2 => format!("vec4u(bitcast<vec2u>({x}), 0u, 0u)"),
        3 => format!("vec4u(bitcast<vec3u>({x}), 0u)"),
        _ => format!("bitcast<vec4u>({x})"),
    }
}

/// The same of `f32`, for comparisons.
fn four(x: &str, width: usize) -> String {
    match width {
        1 => format!("vec4f({x}, 0.0, 0.0, 0.0)"),
        2 => format!("vec4f({x}, 0.0, 0.0)"),
        3 => format!("vec4f({x}, 0.0)"),
        _ => x.to_owned(),
    }
}

/// Where a case keeps what may have failed. Compilers of drivers take tens of times as long over an array
/// that is indexed by a variable, so each place has variables of its own.
fn report() -> String {
    let mut text = "\nvar<private> evaluated: u32;\nvar<private> suspected: u32;\n".to_owned();
    let (mut stored, mut listed) = (String::new(), String::new());
    for kept in 0..MOST_KEPT {
        write!(
            text,
            "var<private> head{kept}: vec4u;\nvar<private> actual{kept}: vec4u;\n\
             var<private> expected{kept}: vec4u;\n"
        )
        .expect("text takes text");
        writeln!(
            stored,
            "    if suspected == {kept}u {{ head{kept} = vec4u(site, kind, bound); \
             actual{kept} = actual; expected{kept} = expected; }}"
        )
        .expect("text takes text");
        let words = |name: &str, lanes: [&str; 4]| {
            lanes.map(|lane| format!(", {name}{kept}.{lane}")).concat()
        };
        listed += &format!(", head{kept}.x, head{kept}.y");
        listed += &words("actual", ["x", "y", "z", "w"]);
        listed += &words("expected", ["x", "y", "z", "w"]);
        listed += &format!(", head{kept}.z, head{kept}.w");
    }
    write!(
        text,
        "
fn begin() {{
    evaluated = 0u;
    suspected = 0u;
}}

fn counts() -> array<u32, 2> {{
    return array<u32, 2>(evaluated, suspected);
}}

fn report() -> array<u32, {REPORT_WORDS}> {{
    return array<u32, {REPORT_WORDS}>(evaluated, suspected{listed});
}}

fn judge(site: u32, kind: u32, actual: vec4u, expected: vec4u, bound: vec2u, passes: bool) {{
    evaluated += 1u;
    if passes {{
        return;
    }}
{stored}    suspected += 1u;
}}
"
    )
    .expect("text takes text");
    text
}

fn karat() -> String {
    // A driver may assume that no value is NaN, so what is one is told by its bits. What passes is told
    // by a narrower bound than the author's; the rest is judged on the host. However a difference is
    // rounded, it isn't below a bound that it exceeds.
    let mut text = format!(
        "{}

fn are_finite(x: vec4f) -> bool {{
    return all((bitcast<vec4u>(x) & vec4u(0x7f800000u)) != vec4u(0x7f800000u));
}}

fn are_near(actual: vec4f, expected: vec4f, absolute: f32, relative: f32) -> bool {{
    let bound = max(vec4f(absolute), relative * max(abs(actual), abs(expected)));
    return are_finite(actual) && are_finite(expected) && are_finite(bound)
        && absolute >= 0.0 && relative >= 0.0
        && all((abs(actual - expected) <= 0.999 * bound) | (abs(actual - expected) < vec4f(absolute)));
}}

// From the least to the largest number: a bound of as many bounds nothing.
const MOST_STEPS: f32 = 4278190080.0;

fn place(x: f32) -> u32 {{
    let bits = bitcast<u32>(x);
    return select(0x80000000u + bits, 0x80000000u - (bits & 0x7fffffffu), bits >= 0x80000000u);
}}

fn steps(a: f32, b: f32) -> f32 {{
    let first = place(a);
    let other = place(b);
    return f32(max(first, other) - min(first, other));
}}

fn within_steps(actual: vec4f, expected: vec4f, bound: f32) -> bool {{
    let apart = vec4f(steps(actual.x, expected.x), steps(actual.y, expected.y),
        steps(actual.z, expected.z), steps(actual.w, expected.w));
    return are_finite(actual) && are_finite(expected) && are_finite(vec4f(bound))
        && bound < MOST_STEPS && all(apart <= vec4f(bound));
}}

fn judge_within(site: u32, width: u32, actual: vec4f, expected: vec4f, relative: f32, absolute: f32) {{
    let passes = are_near(actual, expected, absolute, relative);
    judge(site, {}u * 8u + width, bitcast<vec4u>(actual), bitcast<vec4u>(expected),
        vec2u(bitcast<u32>(relative), bitcast<u32>(absolute)), passes);
}}

fn judge_ulp(site: u32, width: u32, actual: vec4f, expected: vec4f, bound: f32) {{
    judge(site, {}u * 8u + width, bitcast<vec4u>(actual), bitcast<vec4u>(expected),
        vec2u(bitcast<u32>(bound), 0u), within_steps(actual, expected, bound));
}}

fn expect_true(site: u32, condition: bool) {{
    judge(site, 1u, vec4u(u32(condition)), vec4u(1u), vec2u(0u), condition);
}}

fn expect_false(site: u32, condition: bool) {{
    judge(site, 1u, vec4u(u32(condition)), vec4u(0u), vec2u(0u), !condition);
}}
",
        report(),
        Wanted::Within as u32,
        Wanted::Ulp as u32,
    );
    let exact = [(WHOLES, Wanted::EqualU32), (SIGNED, Wanted::EqualI32)];
    for (types, wanted) in exact {
        for (width, (suffix, ty)) in (1..).zip(types) {
            let kind = wanted as u32 * 8 + u32::try_from(width).unwrap_or(1);
            writeln!(
                text,
                "fn expect_equal{suffix}(site: u32, actual: {ty}, expected: {ty}) {{ \
                 judge(site, {kind}u, {}, {}, vec2u(0u), all(actual == expected)); }}",
                words("actual", width),
                words("expected", width),
            )
            .expect("text takes text");
        }
    }
    for (width, (suffix, ty)) in (1..).zip(FLOATS) {
        let (actual, expected) = (four("actual", width), four("expected", width));
        let kind = |wanted: Wanted| format!("{}u", wanted as usize * 8 + width);
        let of = |name: &str, more: &str, body: &str| {
            format!("fn expect_{name}{suffix}(site: u32, actual: {ty}{more}) {{ {body} }}\n")
        };
        let pair = format!(", expected: {ty}");
        let bounded = format!(", expected: {ty}, tolerance: f32");
        let judge = |wanted: Wanted, bound: &str, passes: &str| {
            format!(
                "let a = {actual}; let e = {expected}; judge(site, {}, bitcast<vec4u>(a), \
                 bitcast<vec4u>(e), vec2u(bitcast<u32>({bound}), 0u), {passes});",
                kind(wanted)
            )
        };
        let finite = "are_finite(a) && are_finite(e)";
        text += &of(
            "near",
            &bounded,
            &judge(Wanted::Near, "tolerance", "are_near(a, e, tolerance, 0.0)"),
        );
        text += &of(
            "rel",
            &bounded,
            &judge(
                Wanted::Relative,
                "tolerance",
                &format!(
                    "{finite} && are_finite(tolerance * abs(e)) && are_finite(vec4f(tolerance)) && all(abs(a - e) <= 0.999 * tolerance * abs(e))"
                ),
            ),
        );
        text +=
            &of("ulp", &bounded, &judge(Wanted::Ulp, "tolerance", "within_steps(a, e, tolerance)"));
        text += &of(
            "equal",
            &pair,
            &judge(Wanted::EqualF32, "0.0", &format!("{finite} && all(a == e)")),
        );
        text += &of(
            "at_most",
            &pair,
            &judge(Wanted::AtMost, "0.0", &format!("{finite} && all(a <= e)")),
        );
        // The components that aren't there are equal.
        let less = (0..width).map(|lane| format!(" && a[{lane}] < e[{lane}]")).collect::<String>();
        text += &of("less", &pair, &judge(Wanted::Less, "0.0", &format!("{finite}{less}")));
        let inside = (0..width).map(|lane| format!(" && least <= a[{lane}] && a[{lane}] <= most"));
        text += &of(
            "in_range",
            ", least: f32, most: f32",
            &format!(
                "let a = {actual}; judge(site, {}, bitcast<vec4u>(a), vec4u(0u), \
                 bitcast<vec2u>(vec2f(least, most)), \
                 are_finite(a) && are_finite(vec4f(least, most, 0.0, 0.0)){});",
                kind(Wanted::InRange),
                inside.collect::<String>()
            ),
        );
        text += &of(
            "finite",
            "",
            &format!(
                "let a = {actual}; judge(site, {}, bitcast<vec4u>(a), vec4u(0u), vec2u(0u), are_finite(a));",
                kind(Wanted::Finite)
            ),
        );
    }
    text
}

/// The names of the WESL community's runner. Its tolerances: 1e-3 relative, 1e-6 absolute.
fn wgsl_test() -> String {
    let mut text = "import karat::{judge_within, judge_ulp, judge};
fn expect(site: u32, condition: bool) {
    judge(site, 1u, vec4u(u32(condition)), vec4u(1u), vec2u(0u), condition);
}
fn expectEq(site: u32, actual: u32, expected: u32) {
    judge(site, 9u, vec4u(actual), vec4u(expected), vec2u(0u), actual == expected);
}
"
    .to_owned();
    for (width, (_, ty)) in (1..).zip(FLOATS) {
        let (actual, expected) = (four("actual", width), four("expected", width));
        let suffix = if width == 1 { String::new() } else { format!("Vec{width}") };
        write!(
            text,
            "fn expectNear{suffix}(site: u32, actual: {ty}, expected: {ty}) {{ \
             judge_within(site, {width}u, {actual}, {expected}, 1e-3, 1e-6); }}\n\
             fn expectWithin{suffix}(site: u32, actual: {ty}, expected: {ty}, relTol: f32, absTol: f32) {{ \
             judge_within(site, {width}u, {actual}, {expected}, relTol, absTol); }}\n\
             fn expectUlp{suffix}(site: u32, actual: {ty}, expected: {ty}, maxUlp: f32) {{ \
             judge_ulp(site, {width}u, {actual}, {expected}, maxUlp); }}\n"
        )
        .expect("text takes text");
    }
    text
}

/// Calls of expectations in all modules that this process has read, by the number that they are told.
static SITES: LazyLock<Mutex<HashMap<u32, Span>>> = LazyLock::new(Mutex::default);

/// The call that was told this number.
pub(crate) fn call(site: u32) -> Option<Span> {
    SITES.lock().unwrap_or_else(PoisonError::into_inner).get(&site).cloned()
}

/// Removes the attributes of tests, and tells each expectation its place.
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
        for (name, brought) in [("karat", &*KARAT), ("wgsl_test", &*WGSL_TEST)] {
            let mut words = import.clone().skip_while(|at| module.text(*at) != "import");
            if words.nth(1).is_none_or(|first| module.text(first) != name) {
                continue;
            }
            for at in import.clone().filter(|at| brought.names.contains(module.text(*at))) {
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
            true => {
                brought(module.text(at - 3)).is_some_and(|brought| brought.names.contains(name))
            }
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
        SITES.lock().unwrap_or_else(PoisonError::into_inner).insert(site, span);
        let comma = if module.brackets[open] == open + 1 { "" } else { ", " };
        module.replaced.push((module.tokens[open].range(), format!("({site}u{comma}")));
    }
    module.replaced.sort_by_key(|(range, _)| range.start);
}

/// An attribute of a test or of one of its parameters, which only Karat knows.
struct Attribute {
    /// From `@` to the closing `)`.
    tokens: std::ops::Range<usize>,
    /// Its name, and the parameter that it is for.
    name: String,
    parameter: Option<usize>,
}

/// `@test`, `@cases(..)`, and `@over(..)` of parameters.
fn attributes(module: &Module, test: &Declaration) -> Vec<Attribute> {
    let mut found = Vec::new();
    let open = test.name_token + 1;
    let mut end = test.tokens.start;
    let (mut parameter, mut depth) = (0, 0_usize);
    let last = if module.is(open, b'(') { module.brackets[open] } else { open };
    while end < last {
        match module.tokens[end].kind {
            Kind::Symbol(b',') if depth == 0 => parameter += 1,
            // Of a type: `array<f32, 2>`.
            Kind::Symbol(b'<') => depth += 1,
            Kind::Symbol(b'>') => depth = depth.saturating_sub(1),
            _ => {}
        }
        if !module.is(end, b'@') {
            // What an attribute or a type has in brackets is none of ours.
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

/// A test as it is written.
#[derive(Clone, Debug)]
pub(crate) struct TestItem {
    /// `brdf_test::schlick_at_grazing`
    pub(crate) name: String,
    /// All of it.
    pub(crate) span: Span,
    /// How many cases it wants.
    pub(crate) cases: Option<u64>,
    /// Where each parameter comes from, if it says so: the words and numbers of `@over`.
    pub(crate) over: Vec<Option<(Vec<String>, Span)>>,
    /// The name and the type of each parameter, as they are written; `None` if a type has another name in
    /// other modules.
    pub(crate) parameters: Option<Vec<(String, String)>>,
}

impl TestItem {
    /// The tests of one module, in the order of lines.
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
        let message = format!("the test `{own}` returns something");
        return Err(error(place, message, "a test says what it expects: `expect_near(..)`"));
    }
    let mut over: Vec<Option<(Vec<String>, Span)>> = Vec::new();
    let mut cases = None;
    for attribute in attributes(module, test) {
        let inside =
            (attribute.tokens.start + 3).min(attribute.tokens.end)..attribute.tokens.end - 1;
        // A sign belongs to the number behind it.
        let mut arguments = vec![String::new()];
        let is_value = |at: usize| !matches!(module.tokens[at].kind, Kind::Symbol(_));
        for at in inside.clone() {
            match module.tokens[at].kind {
                Kind::Symbol(b',') => arguments.push(String::new()),
                _ if at > inside.start && is_value(at) && is_value(at - 1) => {
                    let (first, second) = (module.text(at - 1), module.text(at));
                    let message = format!("a comma is missing between `{first}` and `{second}`");
                    let note = format!("`@{}({first}, {second})`", attribute.name);
                    return Err(error(span(&(at - 1..at + 1)), message, &note));
                }
                _ => arguments.last_mut().expect("one at least").push_str(module.text(at)),
            }
        }
        // One comma may stand behind the last.
        arguments.pop_if(|last| last.is_empty());
        if arguments.iter().any(String::is_empty) {
            let message = format!("`@{}` has a comma too many", attribute.name);
            return Err(error(span(&attribute.tokens), message, "a value stands before each"));
        }
        let stands = match attribute.parameter {
            None => cases.is_some(),
            Some(parameter) => over.get(parameter).is_some_and(Option::is_some),
        };
        if stands {
            let message = format!("`@{}` stands twice", attribute.name);
            return Err(error(span(&attribute.tokens), message, "leave one of them out"));
        }
        match (&*attribute.name, attribute.parameter) {
            ("cases", None) => {
                let [count] = &*arguments else {
                    let message = "`@cases` takes one number".to_owned();
                    return Err(error(span(&attribute.tokens), message, "`@cases(1000)`"));
                };
                let count = count.trim_end_matches('u').parse().ok().filter(|count| *count > 0);
                let Some(count) = count else {
                    let message = "`@cases` takes a whole number from 1".to_owned();
                    return Err(error(span(&attribute.tokens), message, "`@cases(1000)`"));
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
        let message = format!("the test `{own}` has no parameter, so that it is one case");
        return Err(error(place, message, "leave `@cases` out"));
    }
    Ok(TestItem { name, span: span(&test.tokens), cases, over, parameters })
}

/// The parameters between two brackets, if all modules know their types by these names.
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

/// Whether a word is a type, or what makes one of others, without an extension of the language.
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
    use crate::reflect::Program;

    #[test]
    fn both_packages_are_valid() {
        for name in ["karat", "wgsl_test"] {
            let package = package(name).expect("it is there");
            Program::of_module(&package, "").unwrap_or_else(|error| panic!("{name}: {error}"));
            assert!(brought(name).expect("it is there").names.len() > 10);
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
