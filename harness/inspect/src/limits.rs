//! The numbers that decide the results of `hazards`, `compare` and `matrix`, each with its reason. `made_up/meaning.rs`
//! has the ranges that an input's name suggests.

/// The number of inputs that each function runs with. For three arguments with six edges each, 800 of the inputs are
/// random samples.
pub(crate) const CASES: usize = 1024;

/// The seed. Functions with the same signature get the same inputs, on every machine.
pub(crate) const SEED: u64 = 0x6861_7a61_7264; // "hazard"

/// The least number of samples that must reach an operation, and all go wrong, before the finding is a fault. An input
/// that averts one bad sample in ten is then missed once in 800 times.
pub(crate) const DRAWS: usize = 64;

/// The least number of contents of resources that must go wrong in the same way. Each content is of another kind: for
/// example zeros, or numbers in order.
pub(crate) const CONTENTS: usize = 6;

/// The numbers of rows that are sampled again for a held case: with the first content, and with each other content. The
/// first number is twice [`DRAWS`], because some rows don't reach the operation, or bring bad operands.
pub(crate) const HELD: [usize; 2] = [2 * DRAWS, 8];

/// The most failing cases of a finding that run again, with the known inputs held and the other inputs sampled anew.
/// The first of these cases include an end of a range.
pub(crate) const HOLDS: usize = 4;

/// The most held cases for all findings of a function together. Each case costs a twentieth of the function's trial.
pub(crate) const ALL_HOLDS: usize = 8;

/// The most failing cases that Karat keeps for each finding. The cases with held inputs are chosen from these.
pub(crate) const KEPT: usize = 64;

/// The number of other values that are tried for an input, to see if one averts a finding: all edges of the input, and
/// as many samples.
pub(crate) const VARIED: usize = 32;

/// The most members of buffers, arrays and textures that vary separately. Each costs one run for each content.
pub(crate) const INPUTS_TRIED: usize = 16;

/// The least number of the callers' calls that must run an operation without an error, before its requirement counts as
/// met. The first hundred calls include edges of the callers' inputs.
pub(crate) const MET: usize = 256;

/// The most operations that all inputs of a function run together, with one content of its resources. One core needs
/// some seconds for them: each arithmetic operation runs four times, and all results are compared.
pub(crate) const WORK: u64 = 1 << 21;

/// The number of cases with long loops that run on, to find an endless loop. Each takes some tenths of a second.
pub(crate) const LONG_CASES: usize = 3;

/// The most members of buffers that a report shows with the arguments.
pub(crate) const MEMBERS: usize = 6;

/// The number of inputs that measure the work. These inputs always run.
pub(crate) const SAMPLE: usize = 16;

// Compare.

/// The last vertex of the twelve triangles of a box.
pub(crate) const LAST_VERTEX: f64 = 35.0;

/// The most operations that all inputs of a function run together, with one content of its resources. One core needs a
/// second or two for them.
pub(crate) const COMPARED_WORK: u64 = 1 << 25;

/// The most operations after a change is found. The other contents then only show the extent of the change, in a tenth
/// of a second each.
pub(crate) const CHANGED_WORK: u64 = COMPARED_WORK / 16;

/// The least number of inputs with equal results that make a verdict, if not all inputs could run. The same number of
/// samples makes a fault.
pub(crate) const LEAST_EQUAL: usize = 64;

/// The number of rounds that simplify a changed input: more than the bits of a number.
pub(crate) const SIMPLER: usize = 64;

/// The number of rows from which a simplification takes other values, evenly spread: edges and random samples.
pub(crate) const OTHER_WORDS: usize = 16;

/// The most features for which Karat tries each subset: 32 subsets. For each subset, Karat links the module twice.
pub(crate) const WHOLE_FEATURES: usize = 5;

/// The most features for which Karat tries each pair: 28 pairs.
pub(crate) const PAIRED_FEATURES: usize = 8;

/// The number of other feature values that a function runs with, if its results are equal. Each run costs as much as
/// the first.
pub(crate) const OTHER_VALUES: usize = 4;

/// The most numbers of a private variable that is an input and a result. With more numbers, the kernel takes seconds to
/// compile.
pub(crate) const MOST_STATE: usize = 256;

/// The value of an override without a default. Such overrides are often the width of a small texture or a number of
/// samples.
pub(crate) const OPEN_OVERRIDE: f64 = 4.0;

/// Another value for an override. The value isn't 0, 1 or a usual size, and is valid for each type of number.
pub(crate) const OTHER_OVERRIDE: f64 = 3.0;

/// The number of workgroups of a pass that hosts usually dispatch as one workgroup, but that may have more.
pub(crate) const SEVERAL_WORKGROUPS: u32 = 3;

/// The number of random orders for passes over generated resources. Each order costs as much as a plain run, for each
/// content.
pub(crate) const ORDERS: u64 = 6;

/// The least difference between two numbers that a person sees in two images side by side, relative to the larger
/// number: a quarter of an 8-bit step.
pub(crate) const VISIBLE: f32 = 1e-3;

// The matrix.

/// The largest floats in cases with samplers that repeat or mirror. WebGPU doesn't bound the error of a texture
/// coordinate. A filter weight has 8 bits, and at 2^10 times 16 texels a float has 10 bits after the binary point.
pub(crate) const REPEATED: f64 = 1024.0;

/// The least magnitude of a component in comparisons, relative to the largest component. With the usual tolerance of
/// 1e-3, this allows an error of 1e-6 of the largest component, some 8 steps of `f32`.
pub(crate) const CANCELLED: f64 = 1e-3;

// Sizes of generated resources.

/// The most bytes of an entry point's buffer. Mesa's GL takes minutes to compile a shader with arrays of a million
/// elements.
pub(crate) const MOST_BYTES: usize = 1 << 20;

/// The most texels of a texture in one direction. Every device supports this size (WebGPU, 3.6.2:
/// `maxTextureDimension1D` is 8,192).
pub(crate) const MOST_SIDE: u32 = 8192;

/// The most texels of a cube's face in one direction. A cube has six faces, with mip levels.
pub(crate) const MOST_FACE: u32 = 64;

/// The number of elements of an array if the shader doesn't determine its length.
pub(crate) const ELEMENTS: usize = 64;

/// The least number of invocations of a pass.
pub(crate) const LEAST_INVOCATIONS: u32 = 64;
