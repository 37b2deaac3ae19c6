//! The numbers that decide what `hazards`, `compare` and `matrix` say, each with its reason. The ranges that names mean are a
//! table of their own: `made_up/meaning.rs`.

/// Inputs of each function. With three arguments of six edges each, that leaves 800 draws.
pub(crate) const CASES: usize = 1024;

/// The same rows for each function of one signature, on every machine.
pub(crate) const SEED: u64 = 0x6861_7a61_7264; // "hazard"

/// Draws that come to an operation, at least, all of which go wrong: an input that averts one draw in ten is then missed
/// once in 800 times.
pub(crate) const DRAWS: usize = 64;

/// Contents of resources, at least, in place of such draws: each is another kind, as zeros are and numbers in order.
pub(crate) const CONTENTS: usize = 6;

/// Rows that are drawn again over the first content, and over each other one: twice as many as have to come to an operation, as
/// some of them go another way, or come with bad operands.
pub(crate) const HELD: [usize; 2] = [2 * DRAWS, 8];

/// Failing cases whose known inputs are held, one after the other: an end of a range is among the first of them.
pub(crate) const HOLDS: usize = 4;

/// Such cases of all findings of a function together: each costs a twentieth of its trial.
pub(crate) const ALL_HOLDS: usize = 8;

/// Failing cases that are kept of a finding, from which these are taken.
pub(crate) const KEPT: usize = 64;

/// Other values of an input that may avert a finding: all of its edges, and as many draws.
pub(crate) const VARIED: usize = 32;

/// Members of buffers, arrays and textures that are varied alone: each costs a run over each content.
pub(crate) const INPUTS_TRIED: usize = 16;

/// Calls in which callers run an operation, at least, before a finding in it counts as met: edges of the callers' inputs are
/// among the first hundred.
pub(crate) const MET: usize = 256;

/// Operations that the inputs of a function come to over one content of its resources: some seconds of one core, as each
/// arithmetic runs four times, and all are compared.
pub(crate) const WORK: u64 = 1 << 21;

/// Long loops that are run on, for one that doesn't end: each takes some tenths of a second.
pub(crate) const LONG_CASES: usize = 3;

/// Members of buffers that are shown with the arguments.
pub(crate) const MEMBERS: usize = 6;

/// Inputs by which work is measured, and which run in any case.
pub(crate) const SAMPLE: usize = 16;

// Compare.

/// The last corner of the twelve triangles of a box.
pub(crate) const LAST_VERTEX: f64 = 35.0;

/// Operations that the inputs of a function may come to over one content of its resources: a second or two of one core.
pub(crate) const COMPARED_WORK: u64 = 1 << 25;

/// The same once a change is known: the other contents show how far it goes, in a tenth of a second each.
pub(crate) const CHANGED_WORK: u64 = COMPARED_WORK / 16;

/// Inputs, of more, whose equal results are a verdict: as many as draws that make a fault.
pub(crate) const LEAST_EQUAL: usize = 64;

/// Rounds in which a changed input is made simpler: more than one for each bit of a number.
pub(crate) const SIMPLER: usize = 64;

/// Rows from which a word is taken, evenly spread: edges and draws.
pub(crate) const OTHER_WORDS: usize = 16;

/// Features of which each set is tried: 32 sets, and each links the module twice.
pub(crate) const WHOLE_FEATURES: usize = 5;

/// Features of which each pair is tried: 28 pairs.
pub(crate) const PAIRED_FEATURES: usize = 8;

/// Other values of features under which a function runs whose results are the same: each costs as much as the first.
pub(crate) const OTHER_VALUES: usize = 4;

/// Numbers of a private variable that is an input and a result: a kernel of more takes seconds to compile.
pub(crate) const MOST_STATE: usize = 256;

/// The value of an override that has none: a side of a small texture, a number of samples.
pub(crate) const OPEN_OVERRIDE: f64 = 4.0;

/// Another value of an override: neither 0 nor 1 nor a usual size, and what every type of number has.
pub(crate) const OTHER_OVERRIDE: f64 = 3.0;

/// Workgroups of a pass that is dispatched as one, where it may take more.
pub(crate) const SEVERAL_WORKGROUPS: u32 = 3;

/// Orders that are drawn for passes over made-up resources: each costs as much as a plain run, over each content.
pub(crate) const ORDERS: u64 = 6;

/// The least difference that two pictures beside each other show, of the larger number: a quarter of an 8-bit step.
pub(crate) const VISIBLE: f32 = 1e-3;

// The matrix.

/// Floats of cases whose samplers repeat or mirror, at most. WebGPU says nothing of how exact a coordinate is, and a weight has
/// 8 bits: of 2^10 times 16 texels a float has 10 bits behind the point.
pub(crate) const REPEATED: f64 = 1024.0;

/// The least that a component counts as, as a share of the largest one: with the tolerance of 1e-3 that
/// is usual, 1e-6 of it, some 8 steps of `f32`.
pub(crate) const CANCELLED: f64 = 1e-3;

// Sizes of what is made up.

/// A buffer of an entry point, at most. Mesa's GL takes minutes to compile a shader whose arrays have a
/// million elements.
pub(crate) const MOST_BYTES: usize = 1 << 20;

/// Texels along a side of a texture, on every device (WebGPU, 3.6.2: `maxTextureDimension1D` is 8,192).
pub(crate) const MOST_SIDE: u32 = 8192;

/// Texels along a side of a cube's face: there are six of them, with levels.
pub(crate) const MOST_FACE: u32 = 64;

/// Elements of an array whose length the shader doesn't say.
pub(crate) const ELEMENTS: usize = 64;

/// Invocations of a pass, at least.
pub(crate) const LEAST_INVOCATIONS: u32 = 64;
