//! Tests of translations, and of the verdicts of tools on translations.

use karat_translate::{
    Code, CompileError, NAGA_VERSION, Shader, Stage, Target, Tool, TranslateError, Translation,
    Verdict, compile,
};

const SHADER: &str = "
struct Light { colour: vec3f, power: f32 }
@group(1) @binding(2) var<uniform> light: Light;
@group(0) @binding(7) var<storage, read> values: array<f32>;
@group(2) @binding(0) var<storage, read_write> sums: array<f32>;
var<workgroup> total: f32;

fn scaled(x: f32) -> f32 { return x * light.power; }

@compute @workgroup_size(64)
fn add(@builtin(local_invocation_index) i: u32, @builtin(global_invocation_id) id: vec3u) {
    if i == 63u { total = scaled(values[id.x]); }
    workgroupBarrier();
    sums[id.x] = total + dot(light.colour, vec3f(1.0));
}

@vertex
fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(f32(i % 2u), f32(i / 2u), 0.0, 1.0);
}

@fragment
fn shade() -> @location(0) vec4f { return vec4f(light.colour, 1.0); }
";

fn shader() -> Shader {
    Shader::parse(SHADER).expect("valid")
}

fn translate(target: Target, entry_point: &str) -> Translation {
    let translated = shader().translate(target, Some(entry_point));
    translated.unwrap_or_else(|error| panic!("{target} {entry_point}: {error}"))
}

#[test]
fn each_entry_point_is_written_in_each_language() {
    for target in Target::ALL {
        for (entry_point, stage) in
            [("add", Stage::Compute), ("corner", Stage::Vertex), ("shade", Stage::Fragment)]
        {
            let translation = translate(target, entry_point);
            assert!(!translation.options.is_empty());
            let stages: Vec<Stage> = translation.entry_points.iter().map(|e| e.stage).collect();
            match target {
                // For WGSL, naga writes only whole modules.
                Target::Wgsl => assert!(stages.contains(&stage)),
                _ => assert_eq!(stages, [stage], "{target} {entry_point}"),
            }
            if let Code::Text(text) = &translation.code {
                for written in &translation.entry_points {
                    assert!(
                        text.contains(&written.name),
                        "{target}: no {} in {text}",
                        written.name
                    );
                }
            }
        }
    }
}

/// GLSL and HLSL number all resources in one sequence, across the groups of WGSL.
#[test]
fn resources_keep_their_order() {
    for target in [Target::Glsl, Target::GlslEs, Target::Hlsl, Target::Hlsl6] {
        let bindings = translate(target, "add").bindings;
        let row: Vec<_> = bindings.iter().map(|r| (r.wgsl, r.translated)).collect();
        assert_eq!(row, [((0, 7), (0, 0)), ((1, 2), (0, 1)), ((2, 0), (0, 2))], "{target}");
        assert_eq!(bindings.of(1, 2), Some((0, 1)));
    }
    let kept = translate(Target::Spirv, "add").bindings;
    assert!(kept.iter().all(|r| r.wgsl == r.translated));
}

/// Every installed tool accepts every translation, and reports its version and command.
// Lesson 81
#[test]
fn translations_of_naga_are_valid_for_the_installed_tools() {
    let mut asked = Vec::new();
    for target in Target::ALL {
        for entry_point in ["add", "corner", "shade"] {
            let translation = translate(target, entry_point);
            for tool in Tool::of(target) {
                let said = tool.validate(&translation).expect("the tool runs");
                assert_eq!(said.verdict, Verdict::Valid, "{target} {entry_point}: {said:?}");
                assert!(said.command.starts_with(tool.name()) && said.tool == tool.name());
                asked.push(tool.name());
            }
        }
    }
    assert!(asked.contains(&"naga"), "naga is always available");
    let read = Tool::naga().validate(&translate(Target::Spirv, "add")).expect("naga runs");
    assert_eq!(read.verdict, Verdict::Valid);
}

/// glslang doesn't support the zero value of an array, so its verdict is `Unable`. If glslang reports a different error
/// first, its verdict is `Invalid`.
// Lesson 160
#[test]
fn arrays_of_workgroups_are_no_fault_of_hlsl() {
    let text = "var<workgroup> tile: array<u32, 64>;
        @group(0) @binding(0) var<storage, read_write> data: array<u32>;
        @compute @workgroup_size(64) fn turn(@builtin(local_invocation_index) i: u32) {
            tile[i] = data[i];
            workgroupBarrier();
            data[i] = tile[63u - i];
        }";
    let shader = Shader::parse(text).expect("valid");
    let translation = shader.translate(Target::Hlsl, Some("turn"));
    let mut translation = translation.expect("naga writes it");
    for tool in Tool::of(Target::Hlsl) {
        let said = tool.validate(&translation).expect("the tool runs");
        let is_none = matches!(&said.verdict, Verdict::Unable(what) if what.contains("zero value of an array"));
        assert!(is_none || said.verdict == Verdict::Valid, "{said:?}");
    }
    let Code::Text(written) = &mut translation.code else { panic!("HLSL is a text") };
    *written = format!("static uint early = undeclared_name;\n{written}");
    for tool in Tool::of(Target::Hlsl) {
        let said = tool.validate(&translation).expect("the tool runs");
        assert!(matches!(said.verdict, Verdict::Invalid(_)), "{said:?}");
    }
}

/// Each validator rejects a translation into which the test writes an error. A validator that accepts everything would
/// prove nothing.
// Lesson 82
#[test]
fn a_fault_is_seen_by_each_tool_that_judges_it() {
    let spoiled = |target: Target| {
        let mut translation = translate(target, "add");
        match &mut translation.code {
            Code::Text(text) => *text = text.replacen("total =", "undeclared_name =", 1),
            // Replaces the result type of the last instruction that has a result type by an undefined type.
            Code::Words(words) => {
                let last = words.len() - 8;
                words[last..].fill(0x0002_0001);
            }
        }
        translation
    };
    for target in Target::ALL {
        for tool in Tool::of(target) {
            let translation = spoiled(target);
            let said = tool.validate(&translation).expect("the tool runs");
            assert!(
                matches!(said.verdict, Verdict::Invalid(_) | Verdict::Broke(_)),
                "{target}: {} sees nothing in {:?}",
                tool.name(),
                translation.code.text()
            );
        }
    }
}

/// naga can write variables in the address space `immediate` in each language.
#[test]
fn immediates_are_written() {
    let text = "struct Scale { by: f32 }\nvar<immediate> scale: Scale;\n\
                @fragment fn shade() -> @location(0) vec4f { return vec4f(scale.by); }";
    let shader = Shader::parse(text).expect("valid");
    for target in Target::ALL {
        if let Err(error) = shader.translate(target, Some("shade")) {
            panic!("{target}: {error}");
        }
    }
}

/// Checking several translations together gives the same verdicts as separate checks: an invalid translation doesn't
/// affect the others.
// Lesson 116
#[test]
fn translations_checked_together_have_the_verdicts_of_each_alone() {
    for target in Target::ALL {
        let good = translate(target, "add");
        let mut bad = good.clone();
        match &mut bad.code {
            Code::Text(text) => *text = text.replacen("total =", "undeclared_name =", 1),
            Code::Words(words) => {
                let last = words.len() - 8;
                words[last..].fill(0x0002_0001);
            }
        }
        let whole = shader().translate(target, None);
        let mut all: Vec<&Translation> = vec![&good; 40];
        all[37] = &bad;
        all.extend(whole.as_ref());
        for tool in Tool::of(target) {
            let alone = |one: &&Translation| tool.validate(one).expect("the tool runs");
            let (of_good, of_bad) = (alone(&&good), alone(&&bad));
            assert_ne!(of_good.verdict, of_bad.verdict, "{target} {}", tool.name());
            let said: Vec<_> = tool
                .validate_all(&all)
                .into_iter()
                .map(|one| one.expect("the tool runs"))
                .collect();
            assert_eq!(said.len(), all.len());
            for (index, said) in said.iter().enumerate() {
                match index {
                    37 => assert_eq!(*said, of_bad),
                    0..40 => assert_eq!(*said, of_good),
                    _ => assert_eq!(*said, alone(&all[index])),
                }
            }
        }
    }
}

#[test]
fn glsl_and_hlsl_become_spirv() {
    for target in [Target::Glsl, Target::GlslEs, Target::Hlsl] {
        match compile(&translate(target, "add")) {
            Ok(words) => {
                assert_eq!(words[0], 0x0723_0203, "the magic number of SPIR-V");
                let back = Shader::from_spirv(&words);
                // naga can't read everything that other compilers write. If naga can read the SPIR-V, the shader has
                // one entry point.
                if let Ok(back) = back {
                    assert_eq!(back.entry_points().len(), 1);
                }
            }
            Err(CompileError::NoCompiler { .. }) => {}
            Err(error) => panic!("{target}: {error}"),
        }
    }
    let error =
        compile(&translate(Target::Msl, "add")).expect_err("no compiler makes SPIR-V from MSL");
    assert_eq!(error.to_string(), "Karat knows no compiler from msl to SPIR-V");
}

#[test]
fn a_compiler_says_what_it_rejects() {
    let mut translation = translate(Target::Glsl, "add");
    translation.code = Code::Text("#version 450\nvoid main() { nothing(); }\n".to_owned());
    match compile(&translation) {
        Err(CompileError::Rejected { message, command, .. }) => {
            assert!(message.contains("nothing"), "{message}");
            assert!(command.starts_with("glslangValidator -V"), "{command}");
        }
        Err(CompileError::NoCompiler { .. }) => {}
        other => panic!("{other:?}"),
    }
}

#[test]
fn errors_of_naga_are_reported() {
    let error = Shader::parse("fn f( {").expect_err("not WGSL").to_string();
    assert!(error.starts_with("naga can't read the shader: "), "{error}");
    let error = Shader::parse("fn f() -> f32 { return 1u; }").expect_err("invalid").to_string();
    assert!(error.contains("naga"), "{error}");
    let error = shader().translate(Target::Hlsl, Some("ad")).expect_err("no such entry point");
    assert_eq!(error, TranslateError::NoEntryPoint("ad".to_owned()));
    let error = shader()
        .translate(Target::Glsl, None)
        .expect_err("the shader has three entry points")
        .to_string();
    assert!(
        error.contains("has only one entry point: name an entry point of the shader"),
        "{error}"
    );
    let error = "hlls".parse::<Target>().expect_err("no such language");
    assert!(error.contains("spirv, glsl, glsl-es, hlsl, hlsl6, msl, wgsl"), "{error}");
}

/// In a translation to HLSL, the value of an override replaces the override. An override without a value is an error.
#[test]
fn overrides_have_their_values() {
    let shader = |value: &str| {
        let text = format!(
            "override scale: f32{value};\n{}",
            SHADER.replace("x * light.power", "x * scale")
        );
        Shader::parse(&text).expect("valid").translate(Target::Hlsl, Some("add"))
    };
    let text = shader(" = 2.5").expect("the override has a value");
    assert!(text.code.text().is_some_and(|text| text.contains("2.5")));
    assert!(matches!(shader(""), Err(TranslateError::Unsupported { .. })));
}

#[test]
fn the_reported_version_is_that_of_the_lock_file() {
    // Reads the lock file of the repository, or the lock file's copy in a published package.
    let package = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |folder: &str| std::fs::read_to_string(package.join(folder).join("Cargo.lock")).ok();
    let lock = read("../..").or_else(|| read("")).expect("a lock file exists");
    assert!(lock.contains(&format!("name = \"naga\"\nversion = \"{NAGA_VERSION}\"\n")));
}

/// If the columns of a matrix have three elements, Direct3D puts a scalar into the padding of the last column, but
/// glslang puts the scalar behind the padding. So `compile` refuses glslang's SPIR-V for a buffer with such a matrix
/// and scalar.
#[test]
fn another_layout_of_a_uniform_buffer_is_refused() {
    let shader = |members: &str| {
        let text = format!(
            "struct P {{ {members} }}\n@group(0) @binding(0) var<uniform> p: P;\n\
             @group(0) @binding(1) var<storage, read_write> out: array<f32>;\n\
             @compute @workgroup_size(1) fn main() {{ out[0] = p.last; }}"
        );
        let shader = Shader::parse(&text).expect("valid");
        compile(&shader.translate(Target::Hlsl, Some("main")).expect("naga writes it"))
    };
    for members in ["scale: f32, list: array<vec4f, 3>, last: f32", "v: vec3f, last: f32"] {
        match shader(members) {
            Ok(_) | Err(CompileError::NoCompiler { .. }) => {}
            Err(error) => panic!("{members}: {error}"),
        }
    }
    match shader("m: mat3x3f, last: f32") {
        Err(CompileError::Layout { message, .. }) => {
            assert!(message.contains("`last`") && message.contains("at byte 48"), "{message}");
        }
        Err(CompileError::NoCompiler { .. }) => {}
        other => panic!("{other:?}"),
    }
}
