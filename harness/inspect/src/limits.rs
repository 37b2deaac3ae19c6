//! The numbers that decide the results of `hazards`, `compare` and `matrix`, each with its reason. The ranges that
//! names suggest have their own table: `made_up/meaning.rs`.

/// Inputs of each function. With three arguments of six edges each, 800 of them are random samples.
pub(crate) const CASES: usize = 1024;

/// The seed: functions with the same signature get the same rows, on every machine.
pub(crate) const SEED: u64 = 0x6861_7a61_7264; // "hazard"

/// The least number of samples that reach an operation and all go wrong. An input that averts one sample in ten is then
/// missed once in 800 times.
pub(crate) const DRAWS: usize = 64;

/// The least number of contents of resources, in place of such samples. Each is of another kind, for example zeros, or
/// numbers in order.
pub(crate) const CONTENTS: usize = 6;

/// Rows that are sampled again over the first content, and over each other one: twice as many as have to reach an
/// operation, as some go another way, or arrive with bad operands.
pub(crate) const HELD: [usize; 2] = [2 * DRAWS, 8];

/// Failing cases whose known inputs are held, one after the other. An end of a range is among the first.
pub(crate) const HOLDS: usize = 4;

/// Such cases for all findings of a function together: each costs a twentieth of its trial.
pub(crate) const ALL_HOLDS: usize = 8;

/// Failing cases that are kept of a finding, to choose those from.
pub(crate) const KEPT: usize = 64;

/// Other values of an input that may avert a finding: all of its edges, and as many samples.
pub(crate) const VARIED: usize = 32;

/// Members of buffers, arrays and textures that are varied on their own: each costs a run over each content.
pub(crate) const INPUTS_TRIED: usize = 16;

/// The least number of calls in which callers run an operation before a finding in it counts as met. Edges of the
/// callers' inputs are among the first hundred.
pub(crate) const MET: usize = 256;

/// The most operations that the inputs of a function reach over one content of its resources: some seconds of one core,
/// as each arithmetic runs four times, and all results are compared.
pub(crate) const WORK: u64 = 1 << 21;

/// Long loops to run on in search of an endless one. Each takes some tenths of a second.
pub(crate) const LONG_CASES: usize = 3;

/// Members of buffers that are shown with the arguments.
pub(crate) const MEMBERS: usize = 6;

/// Inputs that measure the work. They always run.
pub(crate) const SAMPLE: usize = 16;

// Compare.

/// The last vertex of the twelve triangles of a box.
pub(crate) const LAST_VERTEX: f64 = 35.0;

/// The most operations that the inputs of a function reach over one content of its resources: a second or two of one
/// core.
pub(crate) const COMPARED_WORK: u64 = 1 << 25;

/// The same once a change is known: the other contents show its extent, in a tenth of a second each.
pub(crate) const CHANGED_WORK: u64 = COMPARED_WORK / 16;

/// The least number of inputs with equal results that count as a verdict, if not all could run: as many as the samples
/// that make a fault.
pub(crate) const LEAST_EQUAL: usize = 64;

/// Rounds of simplifying a changed input: more than one for each bit of a number.
pub(crate) const SIMPLER: usize = 64;

/// Rows to take another word from, evenly spread: edges and random samples.
pub(crate) const OTHER_WORDS: usize = 16;

/// The most features of which each set is tried: 32 sets, and each links the module twice.
pub(crate) const WHOLE_FEATURES: usize = 5;

/// The most features of which each pair is tried: 28 pairs.
pub(crate) const PAIRED_FEATURES: usize = 8;

/// Other values of features to run a function with if its results are the same. Each costs as much as the first.
pub(crate) const OTHER_VALUES: usize = 4;

/// The most numbers of a private variable that is an input and a result. A kernel with more takes seconds to compile.
pub(crate) const MOST_STATE: usize = 256;

/// The value of an override without a default: a side of a small texture, a number of samples.
pub(crate) const OPEN_OVERRIDE: f64 = 4.0;

/// Another value for an override: not 0, 1 or a usual size, and valid for each type of number.
pub(crate) const OTHER_OVERRIDE: f64 = 3.0;

/// Workgroups of a pass that is usually dispatched as one, but may take more.
pub(crate) const SEVERAL_WORKGROUPS: u32 = 3;

/// Random orders for passes over generated resources. Each costs as much as a plain run, over each content.
pub(crate) const ORDERS: u64 = 6;

/// The least visible difference between two images side by side, relative to the larger number: a quarter of an 8-bit
/// step.
pub(crate) const VISIBLE: f32 = 1e-3;

// The matrix.

/// The largest floats of cases with samplers that repeat or mirror. WebGPU doesn't bound the error of a coordinate, and
/// a weight has 8 bits: at 2^10 times 16 texels, a float has 10 bits behind the point.
pub(crate) const REPEATED: f64 = 1024.0;

/// The least magnitude that a component counts with, relative to the largest one. With the usual tolerance of 1e-3 that
/// allows an error of 1e-6 of the largest, some 8 steps of `f32`.
pub(crate) const CANCELLED: f64 = 1e-3;

// Sizes of generated resources.

/// The most bytes of a buffer of an entry point. Mesa's GL takes minutes to compile a shader whose arrays have a
/// million elements.
pub(crate) const MOST_BYTES: usize = 1 << 20;

/// The most texels along a side of a texture that each device supports (WebGPU, 3.6.2: `maxTextureDimension1D` is
/// 8,192).
pub(crate) const MOST_SIDE: u32 = 8192;

/// The most texels along a side of a cube's face: a cube has six faces, with levels.
pub(crate) const MOST_FACE: u32 = 64;

/// The elements of an array for which the shader gives no length.
pub(crate) const ELEMENTS: usize = 64;

/// The least number of invocations of a pass.
pub(crate) const LEAST_INVOCATIONS: u32 = 64;
