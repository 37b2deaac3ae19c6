//! The generated kernel that calls one function over a batch of cases.

use std::fmt::Write;

use crate::reflect::{Function, Program};
use crate::value::{Scalar, Shape};

/// Invocations of a workgroup: what every device supports, and a multiple of every vector width.
pub(super) const WORKGROUP: u32 = 64;

/// Name of the generated entry point.
pub(super) const ENTRY_POINT: &str = "karat_probe";

/// A kernel and the layout of its buffers.
#[derive(Clone, Debug)]
pub(crate) struct Kernel {
    /// Linked text followed by the kernel: readable WGSL.
    pub(crate) text: String,
    /// Words of one case's arguments.
    pub(super) words_in: usize,
    /// Words of one case's result, without the canary that follows it.
    pub(super) words_out: usize,
    /// First of three binding numbers in group 0: arguments, results, batch.
    pub(super) first_binding: u32,
}

impl Kernel {
    /// Writes the kernel for `function`.
    pub(crate) fn new(program: &Program, function: &Function) -> Self {
        let lanes = |shape: &Shape| shape.lanes().len();
        let words_in = function.parameters.iter().map(|(_, shape)| lanes(shape)).sum();
        let words_out = lanes(&function.result);
        let first_binding = program.free_binding();
        let text = write_kernel(program.text(), function, words_in, words_out, first_binding)
            .expect("writing to a String never fails");
        Self { text, words_in, words_out, first_binding }
    }
}

fn write_kernel(
    linked: &str,
    function: &Function,
    words_in: usize,
    words_out: usize,
    binding: u32,
) -> Result<String, std::fmt::Error> {
    let mut text = linked.to_owned();
    let stride_out = words_out + 1;
    if words_in > 0 {
        writeln!(text, "@group(0) @binding({binding}) var<storage, read> karat_in: array<u32>;")?;
    }
    let (results, batch) = (binding + 1, binding + 2);
    writeln!(
        text,
        "@group(0) @binding({results}) var<storage, read_write> karat_out: array<u32>;\n\
         // Number of cases, canary, invocations in a row of workgroups.\n\
         @group(0) @binding({batch}) var<uniform> karat_batch: vec4<u32>;\n\n\
         @compute @workgroup_size({WORKGROUP})\n\
         fn {ENTRY_POINT}(@builtin(global_invocation_id) karat_id: vec3<u32>) {{\n    \
             let karat_case = karat_id.x + karat_id.y * karat_batch.z;\n    \
             if karat_case >= karat_batch.x {{ return; }}"
    )?;
    if words_in > 0 {
        writeln!(text, "    let karat_from = karat_case * {words_in}u;")?;
    }
    writeln!(text, "    let karat_to = karat_case * {stride_out}u;")?;
    let mut lane = 0;
    for (index, (_, shape)) in function.parameters.iter().enumerate() {
        writeln!(text, "    let karat_a{index} = {};", read(shape, &mut lane))?;
    }
    let arguments: Vec<String> =
        (0..function.parameters.len()).map(|index| format!("karat_a{index}")).collect();
    // A variable: a value of array type can't be indexed otherwise on all translations.
    writeln!(text, "    var karat_r = {}({});", function.name, arguments.join(", "))?;
    let lanes = function.result.lanes().into_iter().zip(function.result.lane_names());
    for (index, (scalar, name)) in lanes.enumerate() {
        let value = match scalar {
            Scalar::F32 | Scalar::I32 => format!("bitcast<u32>(karat_r{name})"),
            Scalar::F16 => format!("bitcast<u32>(f32(karat_r{name}))"),
            Scalar::U32 => format!("karat_r{name}"),
            Scalar::Bool => format!("select(0u, 1u, karat_r{name})"),
        };
        writeln!(text, "    karat_out[karat_to + {index}u] = {value};")?;
    }
    writeln!(text, "    karat_out[karat_to + {words_out}u] = karat_batch.y ^ karat_case;\n}}")?;
    Ok(text)
}

/// The expression that puts a value together from its lanes.
fn read(shape: &Shape, lane: &mut usize) -> String {
    let mut list = |count: usize, element: &Shape| {
        (0..count).map(|_| read(element, lane)).collect::<Vec<_>>().join(", ")
    };
    match shape {
        Shape::Scalar(scalar) => {
            let word = format!("karat_in[karat_from + {lane}u]");
            *lane += 1;
            match scalar {
                Scalar::F32 => format!("bitcast<f32>({word})"),
                Scalar::F16 => format!("f16(bitcast<f32>({word}))"),
                Scalar::I32 => format!("bitcast<i32>({word})"),
                Scalar::U32 => word,
                Scalar::Bool => format!("({word} != 0u)"),
            }
        }
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
                members.iter().map(|(_, member)| read(member, lane)).collect();
            format!("{name}({})", members.join(", "))
        }
    }
}
