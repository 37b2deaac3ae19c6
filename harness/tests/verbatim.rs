//! Linked code is the author's text, byte by byte, and Karat's verdict on a file is naga's verdict.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use karat::Package;
use karat::package::PackageError;
use karat::unstable::executor::call;
use karat::unstable::probe::{ProbeError, Probed};
use karat::unstable::reflect::{Program, ReflectError};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// Checks if naga accepts a text, with all of naga's capabilities turned on.
fn naga_accepts(text: &str) -> bool {
    let Ok(module) = naga::front::wgsl::parse_str(text) else { return false };
    Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module).is_ok()
}

/// The result of a function without parameters, on the first path that opens.
fn value(package: &Package, function: &str) -> f32 {
    let probed = Probed::new(package, function).unwrap_or_else(|error| panic!("{error}"));
    let path =
        karat::Path::ALL.into_iter().find(|path| karat::unstable::path::adapter(*path).is_ok());
    let results = call(&probed, path.expect("a path opens"), &[Vec::new()], &Vec::new());
    f32::from_bits(results.expect("it runs")[0][0])
}

/// Literals that are difficult to parse, with their values.
const LITERALS: [(&str, f32); 24] = [
    ("0x1p-2", 0.25),
    ("0x1.8p-3", 0.1875),
    ("0x1p4f", 16.0),
    ("0X1P+4f", 16.0),
    ("0x.8p1", 1.0),
    ("0x1.p3", 8.0),
    ("0x10.8p0", 16.5),
    ("0xAp-4f", 0.625),
    ("0xa.8P-1", 5.25),
    ("0x1p0", 1.0),
    ("0x1p-126f", f32::MIN_POSITIVE),
    ("0x1.fffffep+127f", f32::MAX),
    ("0x1.000002p0f", 1.000_000_1),
    ("0x0p10", 0.0),
    ("0x0.0000008p0f", 2.980_232_2e-8),
    ("1e-2f", 0.01),
    ("1.5E+1", 15.0),
    (".5", 0.5),
    ("2.", 2.0),
    ("3f", 3.0),
    ("- -4f", 4.0),
    ("-(-0x1p1)", 2.0),
    ("- - -1f", -1.0),
    ("f32(0x7fffffff)", 2_147_483_600.0),
];

/// Karat accepts texts that naga accepts, even if other parsers of WGSL refuse them.
// Lesson 49: text is copied from the author's bytes
#[test]
fn texts_that_naga_accepts_are_accepted() {
    let texts = [
        "var<immediate> exposure: f32; fn f() -> f32 { return exposure; }",
        "fn f() -> i64 { return 1li; }",
        "fn f() -> u64 { return 1lu; }",
        "fn f() -> f64 { return 1.5lf; }",
        "fn f(x: f32) -> f32 { return - -x; }",
        "enable f16; fn f() -> f16 { return 1.5h; }",
        "@group(0) @binding(0) var many: binding_array<texture_2d<f32>, 4>; \
         fn f() -> vec4f { return textureLoad(many[1], vec2(0), 0); }",
        "const a = 0x1p4f; fn f() -> f32 { return a; }",
    ];
    let accepted = texts.into_iter().filter(|text| naga_accepts(text)).count();
    assert!(accepted >= 6, "naga accepts {accepted}: it writes them in another way now");
    for text in texts {
        let karat = Program::of_module(&Package::from_source("s", text), "");
        assert_eq!(karat.is_ok(), naga_accepts(text), "{text}: {:?}", karat.err());
    }
}

// Lesson 49: text is copied from the author's bytes
#[test]
fn literals_of_every_form_have_their_values() {
    for (literal, expected) in LITERALS {
        let plain = format!("fn f() -> f32 {{ return {literal}; }}");
        let imports = format!("import package::other::ZERO;\n{plain}\nconst USED = ZERO;");
        let shaders =
            Package::from_modules("s", [("m", imports), ("other", "const ZERO = 0x0p0;".into())]);
        let condition = format!("@if(never) const GONE = 1;\n{plain}");
        for (package, function) in [
            (Package::from_source("s", plain), "f"),
            (shaders, "m::f"),
            (Package::from_source("s", condition), "f"),
        ] {
            assert_eq!(value(&package, function).to_bits(), expected.to_bits(), "{literal}");
        }
    }
}

/// If a function contains text that isn't WGSL, such as `x # 2.0`, the linker reports an error. The linker doesn't
/// silently drop this text.
// Lesson 49: text is copied from the author's bytes
#[test]
fn invalid_tokens_are_refused() {
    for body in [
        "return x $ ;",
        "return 'x';",
        "return 2147483648i - i32(x);",
        "return x\u{0};",
        "return x + 99999999999999999999;",
        "return x \\ 2.0;",
        "return x # 2.0;",
        "return \"x\";",
        "return x; /* not closed",
        "return 0x1p4q;",
        "return x `y`;",
    ] {
        for head in ["", "import package::other::ZERO;\n", "@if(never) const GONE = 1;\n"] {
            let text = format!("{head}fn f(x: f32) -> f32 {{ {body} }}");
            let package =
                Package::from_modules("s", [("m", text.as_str()), ("other", "const ZERO = 0.0;")]);
            let error = Probed::new(&package, "m::f").expect_err(&text).to_string();
            assert!(error.contains("<m>:"), "{text}\n{error}");
        }
    }
}

/// Checks if the test runs in a published package, which doesn't contain the shader library.
fn is_published() -> bool {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(".cargo_vcs_info.json").exists()
}

/// The packages of shaders in this repository: the shader library and the examples.
fn own_shaders() -> Vec<Package> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let many = if is_published() { "tests/strangers/shaders" } else { "../shaders" };
    let folders = [root.join(many), root.join("examples/shaders")];
    folders.iter().map(|folder| Package::open(folder).expect("a folder")).collect()
}

/// The linked text of each module in this repository. Linked text has no imports.
fn plain_texts() -> Vec<String> {
    let mut texts = Vec::new();
    for package in own_shaders() {
        for module in package.modules().expect("readable") {
            let program = Program::of_module(&package, &module);
            texts.push(program.unwrap_or_else(|error| panic!("{error}")).text().to_owned());
        }
    }
    texts
}

/// A linked function equals the author's text except for names: the texts differ only in whole words.
// Lesson 49: text is copied from the author's bytes
#[test]
fn linked_functions_are_the_authors_bytes_but_for_names() {
    let is_word = |c: &char| c.is_alphanumeric() || *c == '_';
    let mut functions = 0;
    for package in own_shaders() {
        for item in package.functions().expect("readable") {
            let Ok(program) = Program::of_function(&package, &item.name) else {
                panic!("`{}` doesn't link", item.name)
            };
            for (handle, function) in program.module().functions.iter() {
                // Karat adds this function, which calls a function that may discard.
                if function.name.as_deref() == Some("karat_or_discarded") {
                    continue;
                }
                let range = program.module().functions.get_span(handle).to_range().expect("a span");
                let span = program.resolve(range.clone()).expect("an author's place");
                let linked: Vec<char> = program.text()[range].chars().collect();
                let author: Vec<char> = span.file.text[span.range.clone()].chars().collect();
                let (mut a, mut b) = (0, 0);
                while a < linked.len() || b < author.len() {
                    let (left, right) = (linked.get(a), author.get(b));
                    // The linked text has entry points as functions, without their attributes.
                    let is_head = item.entry_point.is_some() && !linked[..a].contains(&'{');
                    if left == right || is_head && left == Some(&' ') {
                        (a, b) = (a + 1, b + 1);
                        continue;
                    }
                    // Goes back to the start of the word, then skips the word in both texts. If the author's word is
                    // part of a path, the linked text has blanks in place of the path's other words.
                    let started = (0..a).rev().take_while(|i| is_word(&linked[*i])).count();
                    assert!(started <= b, "{}", item.name);
                    let (from_a, from_b) = (a - started, b - started);
                    let begins = |text: &[char], word: &str| {
                        word.chars().eq(text.iter().take(word.len()).copied())
                    };
                    let [was, is] = ["discard", "karat_discarded = true"];
                    if begins(&linked[from_a..], is) && begins(&author[from_b..], was) {
                        (a, b) = (from_a + is.len(), from_b + was.len());
                        continue;
                    }
                    let word = |text: &[char]| text.iter().take_while(|c| is_word(c)).count();
                    let (name, first) = (word(&linked[from_a..]), word(&author[from_b..]));
                    let in_path = |c: &&char| is_word(c) || **c == ':';
                    let path = author[from_b..].iter().take_while(in_path).count();
                    let colons = author[from_b + first..].starts_with(&[':', ':']);
                    let rest = if colons { path - first } else { 0 };
                    let blank = linked[from_a + name..].iter().take(rest).all(|c| *c == ' ');
                    assert!(
                        name > 0 && first > 0 && blank,
                        "{}: {} is not {}",
                        item.name,
                        linked.iter().collect::<String>(),
                        author.iter().collect::<String>()
                    );
                    (a, b) = (from_a + name + rest, from_b + first + rest);
                }
                functions += 1;
            }
        }
    }
    assert!(functions > if is_published() { 10 } else { 500 }, "{functions}");
}

/// A random number generator: SplitMix64 (Steele et al. 2014).
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % count as u64) as usize
    }
}

/// Splits a text roughly into words, numbers, blanks and symbols.
fn pieces(text: &str) -> Vec<String> {
    let mut pieces: Vec<String> = Vec::new();
    for c in text.chars() {
        let joins = |last: &String| {
            let before = last.chars().next_back().expect("no piece is empty");
            let word = |c: char| c.is_alphanumeric() || c == '_';
            (word(before) && word(c)) || (before.is_whitespace() && c.is_whitespace())
        };
        match pieces.last_mut() {
            Some(last) if joins(last) => last.push(c),
            _ => pieces.push(c.into()),
        }
    }
    pieces
}

/// Texts that the tests insert into files to damage them.
const STRANGE: [&str; 40] = [
    "$",
    "'",
    "\"",
    "\u{0}",
    "\\",
    "#",
    "`",
    "@",
    "?",
    "..",
    "::",
    "-",
    "- -",
    "--",
    "<<",
    ">",
    "<",
    "/*",
    "*/",
    "//",
    "0x1p4f",
    "0x1.8p-3",
    "0x1p",
    "99999999999999999999",
    "1e400",
    "2147483648i",
    "1h",
    "1lf",
    "import",
    "enable f16;",
    "fn",
    "let",
    "return",
    "@if(fast)",
    "@must_use",
    "_",
    "é",
    "\u{feff}",
    "\u{2028}",
    "struct S { a: f32, }",
];

// Lesson 49: files have naga's verdict
#[test]
fn damaged_files_have_nagas_verdict() {
    /// The number of damaged files. Half of the files have one damaged position, and the other files have up to three.
    const DAMAGES: usize = 10_000;
    // Only smaller texts, so that each check takes a millisecond.
    let mut texts = plain_texts();
    texts.sort_by_key(String::len);
    let texts: Vec<Vec<String>> =
        texts.iter().filter(|text| text.len() < 9_000).map(|text| pieces(text)).collect();
    assert!(texts.len() >= if is_published() { 5 } else { 8 }, "{}", texts.len());
    let threads = std::thread::available_parallelism().map_or(2, usize::from);
    let valid: usize = std::thread::scope(|scope| {
        let texts = &texts;
        let workers: Vec<_> = (0..threads)
            .map(|worker| {
                scope.spawn(move || {
                    (worker..DAMAGES)
                        .step_by(threads)
                        .filter(|number| compare(&damaged(texts, *number), *number))
                        .count()
                })
            })
            .collect();
        workers.into_iter().map(|worker| worker.join().expect("no verdict differs")).sum()
    });
    // Both verdicts must occur. Otherwise agreement proves nothing.
    assert!((DAMAGES / 100..DAMAGES / 2).contains(&valid), "{valid} of {DAMAGES} are valid");
}

fn damaged(texts: &[Vec<String>], number: usize) -> String {
    let mut numbers = Numbers(number as u64);
    let mut pieces = texts[numbers.below(texts.len())].clone();
    for _ in 0..1 + (number % 2) * numbers.below(3) {
        let at = numbers.below(pieces.len());
        let other = numbers.below(pieces.len());
        match numbers.below(6) {
            0 => drop(pieces.remove(at)),
            1 => pieces.insert(at, pieces[other].clone()),
            2 => pieces.swap(at, other),
            3 => pieces[at] = pieces[other].clone(),
            4 => pieces[at] = STRANGE[numbers.below(STRANGE.len())].to_owned(),
            _ => pieces.insert(at, STRANGE[numbers.below(STRANGE.len())].to_owned()),
        }
    }
    pieces.concat()
}

/// Checks that Karat and naga both accept a text or both refuse it. There is one exception: Karat may also accept WESL,
/// which naga refuses. Returns `true` if naga accepts the text and the text contains no null character.
fn compare(text: &str, number: usize) -> bool {
    let package = Package::from_source("damaged", text);
    let karat = Program::of_module(&package, "");
    // WGSL, section 3.1, forbids the null character. Browsers also refuse it in comments, and naga doesn't.
    let naga = naga_accepts(text) && !text.contains('\0');
    if let Err(error) = &karat {
        // Karat refuses the text, so naga must refuse it, too.
        assert!(!naga, "damage {number}: naga accepts, Karat says {error}\n{text}");
    }
    // A text that naga refuses may be WESL.
    let wesl = ["@if", "import", "::"].iter().any(|mark| text.contains(mark));
    assert!(naga || wesl || karat.is_err(), "damage {number}: Karat alone accepts\n{text}");
    if naga {
        // The functions that a test would call also link, and equal those of the whole file.
        for item in package.functions().expect("naga accepts it").iter().take(3) {
            match Probed::new(&package, &item.name) {
                Ok(_) | Err(ProbeError::Reflect(ReflectError::Unprobeable(_))) => {}
                Err(error) => panic!("damage {number}: `{}`: {error}\n{text}", item.name),
            }
        }
    }
    naga
}

/// Karat limits the depth and the length of shaders. Without these limits, the shaders of this test crashed the process
/// or took seconds.
// Lesson 56
#[test]
fn deep_and_long_shaders_are_compiled_or_refused_in_time() {
    let function = |body: String| format!("fn f(x: f32) -> f32 {{ {body} }}");
    let blocks = |depth: usize| {
        function(format!("var y = x; {}y = 1.0;{} return y;", "{".repeat(depth), "}".repeat(depth)))
    };
    let terms = |count: usize| function(format!("return {};", vec!["x"; count].join(" + ")));
    let chain = |count: usize| {
        let links: String =
            (0..count).map(|i| format!(" else if x < {i}.0 {{ return {i}.0; }}")).collect();
        function(format!("if x < 0.0 {{ return 0.0; }}{links} return 1.0;"))
    };
    let brackets =
        |depth: usize| function(format!("return {}x{};", "(".repeat(depth), ")".repeat(depth)));
    let templates = |depth: usize| {
        let types = (0..depth).fold("f32".to_owned(), |inner, _| format!("array<{inner}, 2>"));
        format!("alias T = {types}; fn f(x: f32) -> f32 {{ return x; }}")
    };
    let members =
        |depth: usize| function(format!("return vec2f(x){};", ".xy".repeat(depth) + ".x"));
    // Runs in a thread with the stack size of a test.
    let verdict = |text: String| {
        let package = Package::from_source("deep", text);
        Probed::new(&package, "f").map(drop).map_err(|error| error.to_string())
    };
    for text in [blocks(100), terms(1_000), terms(1_400), chain(1_500), templates(16), members(500)]
    {
        let head: String = text.chars().take(60).collect();
        verdict(text).unwrap_or_else(|error| panic!("{head}: {error:.500}"));
    }
    for text in [
        blocks(300),
        blocks(100_000),
        terms(200_000),
        chain(50_000),
        brackets(100_000),
        members(9_000),
    ] {
        let head: String = text.chars().take(60).collect();
        let error = verdict(text).expect_err(&head);
        assert!(error.contains("<deep>:1:"), "{head}: {error:.500}");
    }
    let condition = format!("@if({}a{}) const A = 1;", "(".repeat(10_000), ")".repeat(10_000));
    assert!(verdict(condition + "fn f(x: f32) -> f32 { return x; }").is_err());
    let import = format!("import package::{}a{};", "{b::".repeat(10_000), "}".repeat(10_000));
    assert!(verdict(import + "fn f(x: f32) -> f32 { return x; }").is_err());
}

/// Karat parses each module once, so the time grows with the size of the file, and not with its square.
// Lesson 56
#[test]
fn five_thousand_functions_are_listed() {
    let functions: String = (0..5_000)
        .map(|i| {
            format!("/// Number {i}.\nfn at{i}(x: f32) -> f32 {{ return at{}(x) + x; }}\n", i + 1)
        })
        .collect();
    let package =
        Package::from_source("many", functions + "fn at5000(x: f32) -> f32 { return x; }");
    let program = Program::of_module(&package, "").unwrap_or_else(|error| panic!("{error}"));
    for item in package.functions().expect("valid") {
        let function = program.function(&item.name).unwrap_or_else(|error| panic!("{error}"));
        assert!(function.span.range.start < item.span.range.start);
    }
}

/// A shader may declare functions, structures and variables with the names of WGSL's builtin functions and types, such
/// as `clamp` or `vec2`.
// Lesson 51
#[test]
fn names_of_wgsl_may_be_declared() {
    let source = "fn clamp(x: f32) -> f32 { return x + 1.0; }\n\
                  fn uniform(x: f32) -> f32 { return clamp(x) * 2.0; }\n\
                  fn select() -> f32 { let u32 = 4.0; return uniform(u32) + bitcast<f32>(0u); }\n\
                  fn karat_out() -> f32 { return array(clamp(1.0), 3.0)[1]; }\n\
                  struct vec2 { a: f32 }\n\
                  fn vec3() -> f32 { let v = vec2(7.0); return v.a; }";
    let package = Package::from_source("s", source);
    assert!(naga_accepts(source));
    for (function, expected) in [("select", 10.0), ("karat_out", 3.0), ("vec3", 7.0)] {
        assert_eq!(value(&package, function), expected, "{function}");
    }
    // Imported modules call the builtin function.
    let modules = Package::from_modules(
        "s",
        [
            (
                "a",
                "import package::b::half;\nfn clamp(x: f32) -> f32 { return half(x) + 1.0; }\n\
                   fn f() -> f32 { return clamp(9.0); }",
            ),
            ("b", "fn half(x: f32) -> f32 { return clamp(x, 0.0, 1.0) / 2.0; }"),
        ],
    );
    assert_eq!(value(&modules, "a::f"), 1.5);
}

/// The linker replaces a name only where the name means the import: the linker doesn't rename a local variable with the
/// same name.
// Lesson 51
#[test]
fn only_names_that_mean_the_import_are_replaced() {
    let module = "import package::lib::{PI, scale as x, S, function, read, flat};\n\
        import package::lib;\n\
        @group(0) @binding(0) var<storage, read> data: array<f32>;\n\
        struct V { @location(0) @interpolate(flat) PI: u32, x: f32, s: S }\n\
        fn shadow(PI: f32) -> f32 { return PI; }\n\
        fn later() -> f32 { let before = PI; let PI = before * 2.0; return PI; }\n\
        fn block() -> f32 { var r = 0.0; { let PI = 1.0; r += PI; } return r + PI; }\n\
        fn looped() -> f32 { var r = 0.0; for (var x = 0; x < 2; x++) { r += f32(x); } return x(r); }\n\
        fn member() -> f32 { let v = V(1u, 5.0, S(2.0)); return v.x + v.s.PI + f32(v.PI); }\n\
        fn pointer(p: ptr<function, f32>) -> f32 { return *p; }\n\
        fn pointed() -> f32 { var v = 3.0; return pointer(&v) + function() + read() + f32(flat); }\n\
        fn path() -> f32 { let lib = 1.0; return lib::PI + package::lib::PI * lib; }\n\
        fn cased() -> f32 { switch 3 { case lib::THREE: { let PI = 8.0; return PI; } default: { return PI; } } }\n";
    let lib = "const PI = 3.0;\nconst THREE = 3;\nstruct S { PI: f32 }\nconst flat = 100;\n\
        fn scale(v: f32) -> f32 { return v * 10.0; }\n\
        fn function() -> f32 { return 20.0; }\nfn read() -> f32 { return 40.0; }";
    let package = Package::from_modules("s", [("m", module), ("lib", lib)]);
    let expected = [
        ("m::later", 6.0),
        ("m::block", 4.0),
        ("m::looped", 10.0),
        ("m::member", 8.0),
        ("m::pointed", 163.0),
        ("m::path", 6.0),
        ("m::cased", 8.0),
    ];
    for (function, expected) in expected {
        assert_eq!(value(&package, function), expected, "{function}");
    }
}

// Lesson 52
#[test]
fn conditions_choose_wherever_they_may_stand() {
    let source = "@if(a) diagnostic(off, derivative_uniformity); @else diagnostic(info, derivative_uniformity);\n\
        @if(a) import package::lib::{ONE as N}; @else import package::lib::{TWO as N};\n\
        @if(a && !b) { const X = 1.0; fn x() -> f32 { return X; } }\n\
        @elif(b) { const X = 2.0; fn x() -> f32 { return X; } }\n\
        @else { const X = 3.0; fn x() -> f32 { return X; } }\n\
        struct S { @if(a) p: vec2<f32>, q: f32, @if(b) r: array<f32, 4> }\n\
        fn g(@if(a) p: vec2<f32>, q: f32, @else @if(b) r: f32) -> f32 { return q; }\n"
        .replace("@else @if(b) r: f32", "@if(b) r: f32");
    let body = "fn f() -> f32 {\n    var s: S;\n    @if(a) { s.p = vec2(1.0); } @else s.q = 5.0;\n    \
        @if(a) if s.p.x > 0.0 { s.q += 10.0; } else { s.q = 0.0; }\n    \
        @if(b) for (var i = 0; i < 4; i++) { s.q += 100.0; s.r[i] = 0.0; } @else s.q += 1000.0;\n    \
        switch 1 { @if(a) case 1: { s.q += 0.5; } @else case 1: { s.q += 0.25; } default: {} }\n    \
        return s.q + x() + N;\n}";
    let value_with = |features: &[(&'static str, bool)]| {
        let text = format!("{source}{body}");
        let package = Package::from_modules(
            "s",
            [("m", text), ("lib", "const ONE = 0.01; const TWO = 0.02;".to_owned())],
        );
        let package = features.iter().fold(package, |p, (name, on)| p.feature(name, *on));
        (value(&package, "m::f") * 100.0).round() / 100.0
    };
    assert_eq!(value_with(&[]), 1008.27);
    assert_eq!(value_with(&[("a", true)]), 1011.51);
    assert_eq!(value_with(&[("b", true)]), 407.27);
    assert_eq!(value_with(&[("a", true), ("b", true)]), 412.51);
}

/// Karat finds an error in a function even if no test calls this function.
// Lesson 53
#[test]
fn functions_that_no_test_reaches_are_validated() {
    let good = "fn f(x: f32) -> f32 { return x; }\n";
    let entry = "@fragment fn main() -> @location(0) vec4f { return colr; }\n";
    let package = Package::from_modules("s", [("m", format!("{good}{entry}")), ("n", good.into())]);
    let in_valid = |path: &str| Probed::in_valid(&package, path, &BTreeMap::new());
    let error = in_valid("m::f").expect_err("its module isn't valid").to_string();
    assert!(error.contains("`colr`") && error.contains("<m>:2:"), "{error}");
    let error = package.try_is_valid().expect_err("a module isn't valid").to_string();
    assert!(error.contains("1 of 2 modules") && error.contains("<m>:2:"), "{error}");
    assert!(in_valid("n::f").is_ok(), "its own module is valid");

    let broken = Package::from_modules("s", [("m", good), ("n", "fn g( { }")]);
    let error = broken.try_is_valid().expect_err("a module doesn't parse").to_string();
    assert!(error.contains("<n>:1:"), "{error}");
    let imports = Package::from_modules("s", [("m", "import package::n::g;\nconst A = 1;")]);
    assert!(imports.try_is_valid().is_err());
    let empty = Package::from_source("s", "const A = 1;");
    assert!(empty.try_is_valid().expect_err("nothing runs").to_string().contains("no function"));

    let found = Package::from_modules("s", [("m", good), ("n", good)]).is_valid();
    assert_eq!((found.modules, found.functions, found.entry_points), (2, 2, 0));
}

// Lesson 53
#[test]
fn modules_may_be_valid_with_features_alone() {
    let debug = "@if(DEBUG) const SCALE = 2.0;\nfn f(x: f32) -> f32 { return x * SCALE; }";
    let package = Package::from_modules("s", [("debug::overlay", debug)]);
    assert!(package.try_is_valid().is_err());
    assert!(package.clone().module_features("debug::overlay", &["DEBUG"]).try_is_valid().is_ok());
    let error = package.module_features("debug::overlai", &["DEBUG"]).try_is_valid();
    let error = error.expect_err("no such module").to_string();
    assert!(error.contains("did you mean `debug::overlay`?"), "{error}");
}

/// The error for a missing function names that function.
// Lesson 54
#[test]
fn an_unknown_function_is_not_another_modules_error() {
    let good = "fn f(x: f32) -> f32 { return x; }\n@if(fast) fn b() -> f32 { return 1.0; }";
    let package = Package::from_modules("s", [("m", good), ("broken", "fn g( {")]);
    let error = |path: &str| Probed::new(&package, path).expect_err("not there").to_string();
    assert!(error("m::ff").contains("has no function `m::ff`"), "{}", error("m::ff"));
    assert!(error("m::b").contains("declared under `@if(fast)`"), "{}", error("m::b"));
    let unknown =
        "package `s` has no function `n::f` (functions in the package: 1); did you mean `m::f`?";
    assert_eq!(error("n::f"), unknown, "of a module that isn't there");
    let Err(ProbeError::Reflect(ReflectError::Package(PackageError::Inactive { .. }))) =
        Probed::new(&package, "m::b")
    else {
        panic!("the condition is data");
    };
}

/// If an import gives a name a second meaning in its module, Karat reports an error at the import. A module may contain
/// the same import twice.
// Lesson 75
#[test]
fn an_import_that_gives_a_name_a_second_meaning_is_refused() {
    let sq = "fn sq(x: f32) -> f32 { return x * x; }\nfn cube(x: f32) -> f32 { return x; }";
    let check = |text: &str| {
        let modules = [("a", text), ("math", sq), ("bad", sq)];
        Package::from_modules("s", modules).try_is_valid().map_err(|error| error.to_string())
    };
    let f = "fn f(x: f32) -> f32 { return sq(x); }";
    for imports in [
        "import package::math::sq;\nimport package::bad::sq;\n",
        "import package::math::{sq, cube as sq};\n",
        "import package::math::sq;\nfn sq(x: f32) -> f32 { return 7.0; }\n",
    ] {
        let error = check(&format!("{imports}{f}")).expect_err(imports);
        assert!(error.contains("the name `sq` has two meanings in this module"), "{error}");
        assert!(error.contains("<a>:1:") || error.contains("<a>:2:"), "{error}");
    }
    let same = "import package::math::sq;\nimport package::math::{sq, cube};\n";
    assert_eq!(check(&format!("{same}{f}")).expect("one meaning").modules, 3);
}

/// Two modules or dependencies with the same name are an error.
// Lesson 75
#[test]
fn modules_and_dependencies_have_names_of_their_own() {
    let text = |body: &str| format!("fn f() -> f32 {{ return {body}; }}");
    let twice = Package::from_modules("s", [("a", text("1.0")), ("a", text("x"))]);
    let error = twice.try_is_valid().expect_err("two of them").to_string();
    assert!(error.contains("package `s` has two modules named `a`"), "{error}");
    assert!(Probed::new(&twice, "a::f").is_err());
    let other = Package::from_source("d", text("1.0"));
    let package = Package::from_source("s", text("1.0"));
    let package = package.depends_on("noise", &other).depends_on("noise", &other);
    let error = Probed::new(&package, "f").expect_err("two of them").to_string();
    assert!(error.contains("two dependencies named `noise`"), "{error}");
}

/// Karat reads each file that looks like a module, or reports an error at this file.
// Lesson 76
#[test]
fn every_file_of_a_package_is_looked_at() {
    let check = |files: &[&str]| {
        let folder = tempfile::tempdir().expect("a folder");
        for (index, file) in files.iter().enumerate() {
            let path = folder.path().join(file);
            std::fs::create_dir_all(path.parent().expect("in the folder")).expect("made");
            let text = if index == 0 { "fn f() -> f32 { return 1.0; }" } else { "fn g( {" };
            std::fs::write(path, text).expect("written");
        }
        let package = Package::open(folder.path()).expect("a folder");
        package.try_is_valid().map_err(|error| error.to_string())
    };
    for (file, reason) in [
        ("target/b.wgsl", "target/b.wgsl:1:"),
        ("a.wesl", "two modules named `a`"),
        ("v1.2/b.wgsl", "v1.2/b.wgsl:1:"),
        ("B.WGSL", "write the file's extension in lower case"),
    ] {
        let error = check(&["a.wgsl", file]).expect_err(file);
        assert!(error.contains(reason), "{file}: {error}");
    }
    assert!(check(&["a.wgsl", "target/b.wgsl", "target/CACHEDIR.TAG"]).is_ok(), "cargo's output");
}

// Lesson 78
#[test]
fn paths_that_leave_the_package_and_null_characters_are_refused() {
    let up = "import super::super::m::g;\nfn f() -> f32 { return g(); }";
    let package =
        Package::from_modules("s", [("n::a", up), ("m", "fn g() -> f32 { return 1.0; }")]);
    assert!(Probed::new(&package, "n::a::f").is_ok());
    let up = up.replace("super::super", "super::super::super");
    let package =
        Package::from_modules("s", [("n::a", &*up), ("m", "fn g() -> f32 { return 1.0; }")]);
    let error = Probed::new(&package, "n::a::f").expect_err("above the root").to_string();
    assert!(error.contains("`super` goes above the root of package `s`"), "{error}");
    let package = Package::from_source("s", "fn f() -> f32 { return 1.0; } // a\0b");
    let error = package.try_is_valid().expect_err("no WGSL").to_string();
    assert!(error.contains("null character") && error.contains("<s>:1:35"), "{error}");
    let package = Package::from_source("s", "fn f() -> f32 { return 1.0; }\nenable f16;");
    let error = package.try_is_valid().expect_err("a directive behind").to_string();
    assert!(error.contains("<s>:2:1"), "{error}");
}

/// A symbolic link to a parent folder doesn't cause an endless search.
// Lesson 56
#[cfg(unix)]
#[test]
fn links_that_loop_are_an_error_or_ignored() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text);
    write("a.wgsl", "fn f() -> f32 { return 1.0; }").expect("written");
    let link = |to: PathBuf, at: &str| std::os::unix::fs::symlink(to, folder.path().join(at));
    link(folder.path().to_owned(), "again").expect("a link");
    link(folder.path().join("self.wgsl"), "self.wgsl").expect("a link to itself");
    let package = Package::open(folder.path()).expect("a folder");
    let modules = package.modules();
    match modules {
        Ok(modules) => assert!(modules.len() < 10, "{modules:?}"),
        Err(error) => assert!(error.to_string().contains("self.wgsl"), "{error}"),
    }
    assert!(Probed::new(&package, "a::f").is_ok());
}
