//! Generates the kernel that calls one function for a batch of cases.

use std::fmt::Write;

use super::Inputs;
use crate::path::MOST_ROUNDS;
use crate::reflect::{COUNTERS, Function, Overrides, Passed, Program};
use crate::value::{Scalar, Shape, format_f32, hexfloat};

/// The number of invocations in a workgroup. Every device supports 64, and 64 is a multiple of the number of lanes in
/// any GPU's or CPU's vectors.
pub(crate) const WORKGROUP: u32 = 64;

/// The number of 32-bit words in a uniform buffer of 16 KiB, the size that every device supports.
pub(crate) const UNIFORM_WORDS: usize = 4096;

/// The largest number of cases of a check if arguments are constants. Each case is a separate call, which the driver
/// may inline.
pub(crate) const CONSTANTS: usize = 64;

/// The number of calls in a kernel with constants. The time to compile a kernel grows faster than its number of calls.
/// Also, a long compilation can cause a panic on GL: wgpu panics if another thread waits six seconds for GL.
const CALLS: usize = 16;

pub(crate) const RESULTS: &str = "karat_out";

pub(super) const ENTRY_POINT: &str = "karat_probe";

/// The name of the vertex function that Karat generates if the kernel is a fragment function.
pub(super) const VERTEX: &str = "karat_vertex";

/// The width and height in pixels of the square around each quad. A triangle that covers the quad fits into the square.
pub(super) const CELL: u32 = 4;

/// A kernel, and the layout of its buffers.
#[derive(Clone, Debug)]
pub struct Kernel {
    /// The linked text, and then the kernel.
    pub text: String,
    /// The number of words of one case's arguments.
    pub(super) words_in: usize,
    /// The number of words of one case's result, without the canary.
    pub(super) words_out: usize,
    /// The first of three binding numbers in group 0: for the arguments, the results, and the numbers that describe the
    /// batch.
    pub(super) first_binding: u32,
    /// The source of the arguments. If the arguments are constants, `text` has no calls, and
    /// [`of_constants`](Self::of_constants) writes a text with the calls for a batch.
    pub(super) inputs: Inputs,
    /// `true` if the kernel can run each case in a separate vector of the processor. See [`rounds`](super::rounds).
    pub(super) apart: bool,
    /// The number of loop counters, if the kernel returns counters instead of results.
    counted: Option<usize>,
    linked: String,
    function: Function,
    /// The values of overrides, by their names in the text.
    pub(super) overrides: Overrides,
}

impl Kernel {
    /// Writes the kernel for a function.
    pub(crate) fn new(program: &Program, function: &Function) -> Self {
        Self::with_inputs(program, function, Inputs::Storage)
    }

    /// Writes the kernel for a function, with this source of arguments.
    pub(crate) fn with_inputs(program: &Program, function: &Function, inputs: Inputs) -> Self {
        let lanes = |shape: &Shape| shape.lanes().len();
        // For pixels of a quad that aren't drawn, a driver may skip reads of storage buffers.
        let form = &function.form;
        let inputs = if form.fragment && form.alone { Inputs::Uniform } else { inputs };
        let words_in = function.parameters.iter().map(|(_, shape)| lanes(shape)).sum();
        let mut kernel = Self {
            text: String::new(),
            words_in,
            words_out: function.outputs().iter().map(|(_, shape)| lanes(shape)).sum(),
            first_binding: program.free_binding(),
            inputs,
            apart: !form.fragment
                && !form.alone
                && program.most_rounds().is_none_or(|rounds| rounds >= MOST_ROUNDS),
            counted: None,
            linked: program.text().to_owned(),
            function: function.clone(),
            overrides: program.overrides().clone(),
        };
        kernel.text = kernel.write(&[]).expect("writing to a String never fails");
        kernel
    }

    /// A kernel that makes the same calls, but returns `loops` loop counters instead of the results. The code that
    /// counts isn't in the kernel's text: Karat inserts it into naga's IR.
    pub(super) fn counting(&self, loops: usize) -> Self {
        let mut kernel = Self {
            words_out: loops,
            inputs: Inputs::Storage,
            counted: Some(loops),
            ..self.clone()
        };
        kernel.text = kernel.write(&[]).expect("writing to a String never fails");
        kernel
    }

    /// A kernel that calls the function once for each pixel of a draw. The pixels are the cases, row by row. Use this
    /// kernel to find races between the pixels of a fragment function that writes storage.
    pub fn of_pixels(&self) -> Self {
        let mut kernel = Self { inputs: Inputs::Storage, ..self.clone() };
        kernel.function.form.fragment = true;
        kernel.text = kernel.write(&[]).expect("writing to a String never fails");
        kernel
    }

    /// The largest number of cases in a dispatch for this source of arguments. `None` if there is no limit.
    pub(crate) fn largest_batch(&self) -> Option<usize> {
        match self.inputs {
            Inputs::Storage => None,
            Inputs::Uniform => Some(UNIFORM_WORDS / self.words_in.max(1)),
            Inputs::Constant => Some(CALLS),
        }
    }

    /// The first of the three binding numbers in group 0: for the arguments, the results, and the numbers that describe
    /// the batch.
    pub fn first_binding(&self) -> u32 {
        self.first_binding
    }

    /// The number of words in one case's arguments, and in its results without the canary.
    pub fn words(&self) -> (usize, usize) {
        (self.words_in, self.words_out)
    }

    /// The numbers of workgroups in x and y for this many invocations. x is at most `limit`.
    pub(crate) fn workgroups(invocations: u32, limit: u32) -> [u32; 2] {
        let groups = invocations.div_ceil(WORKGROUP);
        [groups.min(limit), groups.div_ceil(limit)]
    }

    /// The source of the arguments.
    pub fn inputs(&self) -> Inputs {
        self.inputs
    }

    pub(super) fn is_drawn(&self) -> bool {
        self.function.form.fragment
    }

    /// Checks if each case has its own dispatch.
    pub(super) fn is_alone(&self) -> bool {
        self.function.form.alone
    }

    /// The text for cases with constant arguments. Returns an error if an argument can't be a constant.
    pub(crate) fn of_constants(&self, arguments: &[u32]) -> Result<String, String> {
        let scalars: Vec<Scalar> =
            self.function.parameters.iter().flat_map(|(_, shape)| shape.lanes()).collect();
        for case in arguments.chunks_exact(self.words_in.max(1)) {
            for (word, scalar) in case.iter().zip(&scalars) {
                let value = f32::from_bits(*word);
                if scalar.is_float() && !value.is_finite() {
                    return Err(format!("WGSL has no constant for {}", format_f32(value)));
                }
            }
        }
        Ok(self.write(arguments).expect("writing to a String never fails"))
    }

    /// Writes the kernel's text. If the arguments are constants, `constants` has the arguments of all cases.
    fn write(&self, constants: &[u32]) -> Result<String, std::fmt::Error> {
        let Self { words_in, words_out, first_binding: binding, inputs, .. } = self;
        let mut text = self.linked.clone();
        if !text.ends_with('\n') {
            text.push('\n');
        }
        let stride_out = words_out + 1;
        match inputs {
            Inputs::Storage if *words_in > 0 => writeln!(
                text,
                "@group(0) @binding({binding}) var<storage, read> karat_in: array<u32>;"
            )?,
            // Elements of arrays in uniform buffers are 16 bytes apart, so each element has four words.
            Inputs::Uniform if *words_in > 0 => writeln!(
                text,
                "@group(0) @binding({binding}) var<uniform> karat_in: array<vec4<u32>, {}>;",
                UNIFORM_WORDS / 4
            )?,
            _ => {}
        }
        let (results, batch) = (binding + 1, binding + 2);
        let counters = self.counted.map_or_else(String::new, |loops| {
            // Uses a variable for each counter, because glslang's HLSL has no zero for arrays with several elements.
            let one = |index| format!("var<private> {COUNTERS}{index}: u32;\n");
            (0..loops).map(one).collect::<String>() + "\n"
        });
        let form = &self.function.form;
        let what = match (form.fragment, form.alone) {
            (true, true) => "the case of pixel (i, j) is w + i * x + j * z; y: canary",
            (true, false) => "x: number of cases, y: canary, z: quads in a row, w: rows of quads",
            (false, true) => "y: canary, w: the index of the case; x and z are unused",
            (false, false) => {
                "x: number of cases, y: canary, z: invocations in a row of workgroups, w: invocations for each case"
            }
        };
        writeln!(
            text,
            "@group(0) @binding({results}) var<storage, read_write> karat_out: array<u32>;\n\
             // {what}.\n\
             @group(0) @binding({batch}) var<uniform> karat_batch: vec4<u32>;\n\n\
             {counters}{}",
            self.pointed()
        )?;
        if form.fragment && form.alone {
            writeln!(
                text,
                "// A triangle over all pixels. The undrawn pixels of a quad are helpers, which write nothing.\n\
                 @vertex\n\
                 fn {VERTEX}(@builtin(vertex_index) karat_index: u32) -> @builtin(position) vec4<f32> {{\n    \
                 let karat_corner = vec2<f32>(vec2<u32>(karat_index % 2u, karat_index / 2u));\n    \
                 return vec4<f32>(4.0 * karat_corner - 1.0, 0.0, 1.0);\n}}\n\n\
                 @fragment\n\
                 fn {ENTRY_POINT}(@builtin(position) karat_position: vec4<f32>) -> @location(0) vec4<f32> {{\n    \
                 let karat_pixel = vec2<u32>(karat_position.xy);\n    \
                 let karat_step = vec2<f32>(karat_pixel % vec2<u32>(2u));\n    \
                 let karat_case = karat_batch.w + karat_pixel.x * karat_batch.x + karat_pixel.y * karat_batch.z;"
            )?;
        } else if form.fragment {
            writeln!(
                text,
                "// Each case is a quad of 2 x 2 pixels with its own triangle, which covers these four pixels: a\n\
                 // driver may skip reads for a pixel that isn't covered.\n\
                 @vertex\n\
                 fn {VERTEX}(\n    \
                 @builtin(vertex_index) karat_index: u32,\n    \
                 @builtin(instance_index) karat_case: u32,\n\
                 ) -> @builtin(position) vec4<f32> {{\n    \
                 let karat_cell = vec2<u32>(karat_case % karat_batch.z, karat_case / karat_batch.z);\n    \
                 let karat_corner = karat_cell + vec2<u32>(karat_index % 2u, karat_index / 2u);\n    \
                 let karat_at = vec2<f32>(karat_corner) / vec2<f32>(karat_batch.zw);\n    \
                 return vec4<f32>(2.0 * karat_at.x - 1.0, 1.0 - 2.0 * karat_at.y, 0.0, 1.0);\n}}\n\n\
                 @fragment\n\
                 fn {ENTRY_POINT}(@builtin(position) karat_position: vec4<f32>) -> @location(0) vec4<f32> {{\n    \
                 let karat_pixel = vec2<u32>(karat_position.xy);\n    \
                 let karat_step = vec2<f32>(karat_pixel % vec2<u32>(2u));\n    \
                 let karat_cell = karat_pixel / vec2<u32>({CELL}u);\n    \
                 let karat_quad = karat_cell.x + karat_cell.y * karat_batch.z;\n    \
                 let karat_case = min(karat_quad, karat_batch.x - 1u);"
            )?;
        } else {
            let size = if form.alone { 1 } else { WORKGROUP };
            writeln!(
                text,
                "@compute @workgroup_size({size})\n\
                 fn {ENTRY_POINT}(@builtin(global_invocation_id) karat_id: vec3<u32>) {{"
            )?;
        }
        if form.alone && !form.fragment {
            writeln!(text, "    let karat_case = karat_batch.w + karat_id.x;")?;
        } else if self.apart {
            writeln!(
                text,
                "    // Only the first invocation of a case calls the function. The others keep cases in separate vectors.\n    \
                 let karat_index = karat_id.x + karat_id.y * karat_batch.z;\n    \
                 if karat_index % karat_batch.w != 0u {{ return; }}\n    \
                 let karat_case = karat_index / karat_batch.w;"
            )?;
        } else if !form.fragment {
            writeln!(text, "    let karat_case = karat_id.x + karat_id.y * karat_batch.z;")?;
        }
        if !form.fragment && !form.alone {
            writeln!(text, "    if karat_case >= karat_batch.x {{ return; }}")?;
        }
        if *words_in > 0 && *inputs != Inputs::Constant {
            writeln!(text, "    let karat_from = karat_case * {words_in}u;")?;
        }
        writeln!(text, "    let karat_to = karat_case * {stride_out}u;")?;
        let canary = format!("karat_out[karat_to + {words_out}u] = karat_batch.y ^ karat_case;");
        if form.discards && form.alone {
            // llvmpipe's GL drops a store that is repeated after a `discard`, so both stores must look different.
            writeln!(
                text,
                "    // The results of a discarded pixel. Any other pixel overwrites these results.\n    \
                 let karat_first = min(karat_to, arrayLength(&karat_out));"
            )?;
            let discarded = form.returns.iter().map(|shape| shape.lanes().len()).sum::<usize>() - 1;
            for index in 0..*words_out {
                let word = u32::from(index == discarded);
                writeln!(text, "    karat_out[karat_first + {index}u] = {word}u;")?;
            }
            writeln!(text, "    {}", canary.replace("karat_to", "karat_first"))?;
        }
        if *inputs == Inputs::Constant {
            writeln!(text, "    switch karat_case {{")?;
            let cases = constants.chunks_exact((*words_in).max(1));
            for (index, case) in cases.enumerate() {
                writeln!(text, "    case {index}u: {{")?;
                self.call(&mut text, "const", &|scalar, lane| constant(scalar, case[lane]))?;
                writeln!(text, "    }}")?;
            }
            writeln!(text, "    default: {{ return; }}\n    }}")?;
        } else {
            self.call(&mut text, "let", &|scalar, lane| match inputs {
                Inputs::Uniform => from_word(
                    scalar,
                    &format!("karat_in[(karat_from + {lane}u) / 4u][(karat_from + {lane}u) % 4u]"),
                ),
                _ => from_word(scalar, &format!("karat_in[karat_from + {lane}u]")),
            })?;
        }
        match (form.fragment, form.alone) {
            (true, true) => {
                writeln!(text, "    {canary}\n    return vec4<f32>();\n}}")?;
            }
            (true, false) => {
                writeln!(text, "        {canary}\n    }}\n    return vec4<f32>();\n}}")?;
            }
            _ => writeln!(text, "    {canary}\n}}")?,
        }
        Ok(text)
    }

    /// Writes one call of the function. `lane` takes the type and the index of a scalar of the arguments, and returns
    /// the expression for this scalar.
    fn call(
        &self,
        text: &mut String,
        declare: &str,
        lane: &dyn Fn(Scalar, usize) -> String,
    ) -> std::fmt::Result {
        let function = &self.function;
        let form = &function.form;
        let mut at = 0;
        let mut arguments = Vec::new();
        for (index, ((_, shape), passed)) in
            function.parameters.iter().zip(&form.passed).enumerate()
        {
            let first = at;
            at += shape.lanes().len();
            let mut next = first;
            let mut numbered = || {
                next += 1;
                next - 1
            };
            let value = match shape.quad() {
                Some(of) => {
                    let width = of.lanes().len();
                    compose(of, &mut |scalar| {
                        let index = numbered();
                        let [value, dx, dy] =
                            [0, 1, 2].map(|part| lane(scalar, index + part * width));
                        match scalar {
                            // A function without derivatives gets the value at the pixel.
                            _ if !form.fragment => value,
                            Scalar::F32 => {
                                format!("{value} + karat_step.x * {dx} + karat_step.y * {dy}")
                            }
                            Scalar::F16 => format!(
                                "{value} + f16(karat_step.x) * {dx} + f16(karat_step.y) * {dy}"
                            ),
                            // Integers and booleans have the same value at all four pixels.
                            _ => value,
                        }
                    })
                }
                None => compose(shape, &mut |scalar| lane(scalar, numbered())),
            };
            let name = match passed {
                Passed::Value => {
                    writeln!(text, "    {declare} karat_a{index} = {value};")?;
                    format!("karat_a{index}")
                }
                Passed::Function => {
                    writeln!(text, "    var karat_p{index} = {value};")?;
                    format!("&karat_p{index}")
                }
                Passed::Private => {
                    writeln!(text, "    karat_p{index} = {value};")?;
                    format!("&karat_p{index}")
                }
                Passed::State(variable) => {
                    writeln!(text, "    {variable} = {value};")?;
                    continue;
                }
            };
            arguments.push(name);
        }
        let call = format!("{}({})", function.linked, arguments.join(", "));
        // Uses a variable, because some translations can't index a value of array type.
        match &form.returns {
            Some(_) => writeln!(text, "    var karat_r = {call};")?,
            None => writeln!(text, "    {call};")?,
        }
        if let Some(loops) = self.counted {
            for index in 0..loops {
                writeln!(text, "    karat_out[karat_to + {index}u] = {COUNTERS}{index};")?;
            }
            return Ok(());
        }
        let mut indent = "    ";
        if form.fragment && !form.alone {
            indent = "        ";
            writeln!(text, "    if all(karat_pixel % vec2<u32>({CELL}u) == vec2<u32>(0u)) {{")?;
        }
        let returned = form.returns.iter().map(|shape| ("karat_r".to_owned(), shape));
        let pointers = function.parameters.iter().zip(&form.passed).enumerate();
        let pointers = pointers.filter_map(|(index, ((_, shape), passed))| match passed {
            Passed::Value => None,
            Passed::State(variable) => Some((variable.clone(), shape)),
            Passed::Function | Passed::Private => Some((format!("karat_p{index}"), shape)),
        });
        let mut index = 0;
        for (variable, shape) in returned.chain(pointers) {
            for (scalar, name) in shape.lanes().into_iter().zip(shape.lane_names()) {
                let value = match scalar {
                    Scalar::F32 | Scalar::I32 => format!("bitcast<u32>({variable}{name})"),
                    Scalar::F16 => format!("bitcast<u32>(f32({variable}{name}))"),
                    Scalar::U32 => format!("{variable}{name}"),
                    Scalar::Bool => format!("select(0u, 1u, {variable}{name})"),
                };
                writeln!(text, "{indent}karat_out[karat_to + {index}u] = {value};")?;
                index += 1;
            }
        }
        Ok(())
    }

    /// Declares a private variable for each parameter that is a pointer into the address space `private`.
    fn pointed(&self) -> String {
        let function = &self.function;
        let of = function.parameters.iter().zip(&function.form.passed).enumerate();
        let declared = of.filter_map(|(index, ((_, shape), passed))| match passed {
            Passed::Private => Some(format!("var<private> karat_p{index}: {shape};\n")),
            _ => None,
        });
        declared.collect()
    }
}

/// The expression that turns a 32-bit word into a scalar.
fn from_word(scalar: Scalar, word: &str) -> String {
    match scalar {
        Scalar::F32 => format!("bitcast<f32>({word})"),
        Scalar::F16 => format!("f16(bitcast<f32>({word}))"),
        Scalar::I32 => format!("bitcast<i32>({word})"),
        Scalar::U32 => word.to_owned(),
        Scalar::Bool => format!("({word} != 0u)"),
    }
}

/// A literal with exactly the bits of a scalar.
fn constant(scalar: Scalar, word: u32) -> String {
    match scalar {
        Scalar::F32 => format!("{}f", hexfloat(f32::from_bits(word))),
        Scalar::F16 => format!("f16({}f)", hexfloat(f32::from_bits(word))),
        Scalar::I32 => format!("i32({})", word.cast_signed()),
        Scalar::U32 => format!("{word}u"),
        Scalar::Bool => (word != 0).to_string(),
    }
}

/// The expression that builds a value from its scalars.
fn compose(shape: &Shape, lane: &mut dyn FnMut(Scalar) -> String) -> String {
    let mut list = |count: usize, element: &Shape| {
        (0..count).map(|_| compose(element, lane)).collect::<Vec<_>>().join(", ")
    };
    match shape {
        Shape::Scalar(scalar) => lane(*scalar),
        Shape::Vector { size, scalar } => {
            format!("{shape}({})", list(usize::from(*size), &Shape::Scalar(*scalar)))
        }
        Shape::Matrix { columns, rows, scalar } => {
            let column = Shape::Vector { size: *rows, scalar: *scalar };
            format!("{shape}({})", list(usize::from(*columns), &column))
        }
        Shape::Array { element, length } => {
            format!("{shape}({})", list(*length as usize, element))
        }
        Shape::Struct { name, members } => {
            let members: Vec<String> =
                members.iter().map(|(_, member)| compose(member, lane)).collect();
            format!("{name}({})", members.join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::package::{KERNEL_WORDS, Package};

    /// A shader may declare names that WGSL predeclares. Karat renames such a declaration if kernels use the
    /// predeclared name. So `KERNEL_WORDS` must have all names that kernels use.
    // Lesson 51
    #[test]
    fn kernels_use_no_other_names_than_they_say() {
        let mut shapes =
            vec!["f32", "i32", "u32", "bool", "f16", "vec3<f16>", "array<vec2<u32>, 2>"]
                .into_iter()
                .map(str::to_owned)
                .collect::<Vec<_>>();
        for columns in 2..=4 {
            shapes.extend(["f32", "i32", "bool"].map(|scalar| format!("vec{columns}<{scalar}>")));
            shapes.extend((2..=4).map(|rows| format!("mat{columns}x{rows}<f32>")));
        }
        let of_shape = |shape: String| {
            format!(
                "enable f16;\nfn same(x: {shape}, n: u32) -> {shape} {{ var y = x; \
                 for (var i = 0u; i < n; i++) {{ y = x; }} return y; }}"
            )
        };
        // Tests kernels that are drawn, and kernels whose cases run separately.
        let writes = "@group(0) @binding(0) var<storage, read_write> d: f32;\n";
        let drawn = ["d = x;", "_ = dpdx(x);", "d = dpdx(x);", "if x > 0.5 { discard; } d = x;"]
            .map(|body| format!("{writes}fn same(x: f32, n: u32) -> f32 {{ {body} for (var i = 0u; i < n; i++) {{}} return x; }}"));
        for source in shapes.into_iter().map(of_shape).chain(drawn) {
            let package = Package::from_source("s", source);
            let program = Program::of_function(&package, "same").expect("valid");
            let function = program.function("same").expect("it can be called");
            for inputs in [Inputs::Storage, Inputs::Uniform, Inputs::Constant] {
                let kernel = Kernel::with_inputs(&program, &function, inputs);
                let constants = kernel.of_constants(&vec![1; kernel.words_in]).expect("finite");
                for text in [&kernel.text, &constants, &kernel.counting(1).text] {
                    let own = text.strip_prefix(program.text()).expect("the shader comes first");
                    let code = own.lines().map(|line| line.split("//").next().unwrap_or_default());
                    let code = code.collect::<Vec<_>>().join("\n");
                    let words = code.split(|c: char| !c.is_alphanumeric() && c != '_');
                    for word in words.filter(|word| word.starts_with(char::is_alphabetic)) {
                        let grammar = [
                            "binding",
                            "builtin",
                            "case",
                            "compute",
                            "const",
                            "default",
                            "discarded",
                            "false",
                            "fn",
                            "fragment",
                            "group",
                            "if",
                            "instance_index",
                            "let",
                            "location",
                            "position",
                            "return",
                            "switch",
                            "true",
                            "value",
                            "var",
                            "vertex",
                            "vertex_index",
                            "workgroup_size",
                            "x",
                            "xy",
                            "y",
                            "z",
                            "zw",
                            "w",
                        ];
                        assert!(
                            word.starts_with("karat_")
                                || word == "same"
                                || grammar.contains(&word)
                                || KERNEL_WORDS.contains(&word),
                            "`{word}` in {own}"
                        );
                    }
                }
            }
        }
    }
}
