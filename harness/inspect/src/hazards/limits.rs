//! The numbers that decide what `karat hazards` says, each with its reason.

/// Inputs of each function. With three arguments of six edges each, that leaves 800 draws.
pub(super) const CASES: usize = 1024;

/// The same rows for each function of one signature, on every machine.
pub(super) const SEED: u64 = 0x6861_7a61_7264; // "hazard"

/// Draws that come to an operation, at least, all of which go wrong: an input that averts one draw in ten is then missed
/// once in 800 times.
pub(super) const DRAWS: usize = 64;

/// Contents of resources, at least, in place of such draws: each is another kind, as zeros are and numbers in order.
pub(super) const CONTENTS: usize = 6;

/// Rows that are drawn again over the first content, and over each other one: twice as many as have to come to an operation, as
/// some of them go another way, or come with bad operands.
pub(super) const HELD: [usize; 2] = [2 * DRAWS, 8];

/// Failing cases whose known inputs are held, one after the other: an end of a range is among the first of them.
pub(super) const HOLDS: usize = 4;

/// Such cases of all findings of a function together: each costs a twentieth of its trial.
pub(super) const ALL_HOLDS: usize = 8;

/// Failing cases that are kept of a finding, from which these are taken.
pub(super) const KEPT: usize = 64;

/// Other values of an input that may avert a finding: all of its edges, and as many draws.
pub(super) const VARIED: usize = 32;

/// Members of buffers, arrays and textures that are varied alone: each costs a run over each content.
pub(super) const INPUTS_TRIED: usize = 16;

/// Calls in which callers run an operation, at least, before a finding in it counts as met: edges of the callers' inputs are
/// among the first hundred.
pub(super) const MET: usize = 256;

/// Operations that the inputs of a function come to over one content of its resources: some seconds of one core, as each
/// arithmetic runs four times, and all are compared.
pub(super) const WORK: u64 = 1 << 21;

/// Long loops that are run on, for one that doesn't end: each takes some tenths of a second.
pub(super) const LONG_CASES: usize = 3;

/// Members of buffers that are shown with the arguments.
pub(super) const MEMBERS: usize = 6;
