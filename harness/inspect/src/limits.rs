//! The constants that determine the results of `hazards`, `compare` and `matrix`, each with the reason for its value.
//! The ranges that the names of inputs suggest are in `made_up/meaning.rs`.

/// The number of inputs for each function. If a function has three arguments with six edges each, about 800 inputs are
/// random samples, and the other inputs are combinations of edges.
pub(crate) const CASES: usize = 1024;

/// The seed of the inputs. Functions with the same signature get the same inputs on every machine.
pub(crate) const SEED: u64 = 0x6861_7a61_7264; // "hazard"

/// The number of samples that must reach an operation before a finding counts as a fault. The operation must go wrong
/// in all these samples. If one sample in ten doesn't go wrong, the probability that all 64 samples go wrong is 1/800.
pub(crate) const DRAWS: usize = 64;

/// The number of contents (sets of generated values) with which a pass must reach an operation before a finding counts
/// as a fault. The operation must go wrong with all these contents. The number is smaller than [`DRAWS`] because the
/// contents are of different kinds, for example zeros, or numbers in order.
pub(crate) const CONTENTS: usize = 6;

/// The number of new samples of the free inputs over the first content, and over each further content. The first number
/// is twice [`DRAWS`], because some samples take other branches or reach the operation with bad operands.
pub(crate) const HELD: [usize; 2] = [2 * DRAWS, 8];

/// The number of failing cases that Karat holds, one after the other: it keeps a case's declared inputs, and samples
/// its free inputs again. The cases with the fewest unusual values come first.
pub(crate) const HOLDS: usize = 4;

/// The maximum number of held cases (see [`HOLDS`]) for all findings of a function together. Each held case takes a
/// twentieth of the time that the first run of the function over all contents takes.
pub(crate) const ALL_HOLDS: usize = 8;

/// The number of failing cases that are kept for each finding. Karat chooses the held cases from the kept cases.
pub(crate) const KEPT: usize = 64;

/// The number of other values that Karat tries for each input, to avert a finding. At most half of the values are
/// edges, and the others are random samples.
pub(crate) const VARIED: usize = 32;

/// The maximum number of buffer members, arrays and textures that Karat varies separately to avert a finding. Each
/// varied input costs one run over each content.
pub(crate) const INPUTS_TRIED: usize = 16;

/// The number of calls in which callers must run an operation without an error before a requirement counts as met. The
/// first hundred calls include the edges of the callers' inputs.
pub(crate) const MET: usize = 256;

/// The maximum number of operations that a function executes over one content, counted over all cases. So many
/// operations take some seconds on one core, because the engine computes each operation four times and compares all
/// results.
pub(crate) const WORK: u64 = 1 << 21;

/// The number of long loops that Karat continues to run, to find out if they end. Each of these loops takes some tenths
/// of a second.
pub(crate) const LONG_CASES: usize = 3;

/// The maximum number of buffer members that a report shows beside the arguments.
pub(crate) const MEMBERS: usize = 6;

/// The number of inputs with which Karat measures the work of a function. These inputs always run.
pub(crate) const SAMPLE: usize = 16;

// Limits of `compare`.

/// The largest vertex index that `compare` generates: the last vertex of a box, which has twelve triangles.
pub(crate) const LAST_VERTEX: f64 = 35.0;

/// The maximum number of operations that a function executes over one content in `compare`, counted over all cases. So
/// many operations take one or two seconds on one core.
pub(crate) const COMPARED_WORK: u64 = 1 << 25;

/// The maximum number of operations over each further content after one content has shown that the results change. The
/// further contents only show how far the results change, and take a tenth of a second each.
pub(crate) const CHANGED_WORK: u64 = COMPARED_WORK / 16;

/// The number of inputs that must give equal results for the verdict "same" if other inputs couldn't run. It equals
/// [`DRAWS`].
pub(crate) const LEAST_EQUAL: usize = 64;

/// The maximum number of steps in which `compare` simplifies an input: more than one step for each bit of a number.
pub(crate) const SIMPLER: usize = 64;

/// The number of cases from which `compare` takes other values of an argument. These cases are evenly spread over edges
/// and samples.
pub(crate) const OTHER_WORDS: usize = 16;

/// The largest number of features for which Karat tests all combinations: 5 features have 32 combinations. Karat links
/// the module twice for each combination.
pub(crate) const WHOLE_FEATURES: usize = 5;

/// The largest number of features for which Karat tests all pairs: 8 features have 28 pairs.
pub(crate) const PAIRED_FEATURES: usize = 8;

/// The maximum number of other feature settings with which `compare` runs a function if the edit doesn't change the
/// function's results. Each setting costs another full run.
pub(crate) const OTHER_VALUES: usize = 4;

/// The maximum size of a private variable, in scalars. Karat neither sets nor compares larger variables. With more
/// scalars, a kernel takes seconds to compile.
pub(crate) const MOST_STATE: usize = 256;

/// The value of an override without a default. The value can be the size of a small texture, or a number of samples.
pub(crate) const OPEN_OVERRIDE: f64 = 4.0;

/// The other value that `compare` tries for an override. This value isn't 0, 1 or a usual size, and is valid for each
/// number type.
pub(crate) const OTHER_OVERRIDE: f64 = 3.0;

/// The number of workgroups that `compare` also tries for a pass whose usual dispatch has only one workgroup.
pub(crate) const SEVERAL_WORKGROUPS: u32 = 3;

/// The number of random orders for passes over generated resources. Each order costs one more run.
pub(crate) const ORDERS: u64 = 6;

/// The smallest difference between two values that counts as visible, relative to the larger value. For the value 1,
/// this is a quarter of an 8-bit step.
pub(crate) const VISIBLE: f32 = 1e-3;

// Limits of `matrix`.

/// The largest float argument in functions with samplers that repeat or mirror. WebGPU doesn't bound the error of a
/// texture coordinate, and a filter weight has 8 bits. At the coordinate 2^10 in a texture of 16 texels, the position
/// in texels still has 10 bits after the point.
pub(crate) const REPEATED: f64 = 1024.0;

/// The smallest scale of a component, as a share of the largest component's scale. A component's scale is the largest
/// magnitude of its results, and Karat compares the component relative to its scale. With the default tolerance of
/// 1e-3, the allowed error is at least 1e-6 of the largest component, or about 8 steps of an `f32`.
pub(crate) const CANCELLED: f64 = 1e-3;

// Sizes of generated resources.

/// The largest buffer of an entry point, in bytes. Mesa's GL takes minutes to compile a shader with an array of a
/// million elements.
pub(crate) const MOST_BYTES: usize = 1 << 20;

/// The largest texture width that every GPU supports, in texels (WebGPU, 3.6.2: `maxTextureDimension1D` is 8,192).
pub(crate) const MOST_SIDE: u32 = 8192;

/// The largest size of a cube's face, in texels. The limit is low because a cube has six faces, each with mip levels.
pub(crate) const MOST_FACE: u32 = 64;

/// The number of elements in a runtime-sized array.
pub(crate) const ELEMENTS: usize = 64;

/// The minimum number of invocations of a pass.
pub(crate) const LEAST_INVOCATIONS: u32 = 64;
