//! A lowered program: a list of operations on registers, with jumps.

use naga::{AtomicFunction, Span};

use crate::coverage::Statement;
use crate::rules::{FloatRule, FromInt, Half, Integer, Scale, ToInt};
use crate::scalar::{File, Scalar};

/// A register: a column with one value for each lane. `file` is the type of the values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct Reg {
    pub(crate) file: File,
    pub(crate) index: u32,
}

/// A comparison of two numbers. Lowering turns `a > b` and `a >= b` into `b < a` and `b <= a`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compare {
    Equal,
    NotEqual,
    Less,
    LessEqual,
}

/// The side of a quad from which its lanes read. For example, with `Left`, both pixels of a row read the left pixel. A
/// quad's four lanes are the upper left pixel, the pixel on its right, and the two pixels below.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Neighbour {
    Left,
    Right,
    Above,
    Below,
}

impl Neighbour {
    pub(crate) fn of(self, lane: usize) -> usize {
        match self {
            Self::Left => lane & !1,
            Self::Right => lane | 1,
            Self::Above => lane & !2,
            Self::Below => lane | 2,
        }
    }
}

/// An operation of a lowered program. [`Code::pool`] lists the operation's registers, the results first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Op {
    Float(FloatRule),
    Integer(Integer),
    ToInt(ToInt),
    FromInt(FromInt),
    Scale(Scale),
    /// Rounds to half precision. The argument is the error that the result may have.
    ToHalf(Half),
    /// Copies a float from another lane of the same quad.
    Neighbour(Neighbour),
    CompareFloat(Compare),
    CompareInt(Compare, bool),
    And,
    Or,
    Not,
    /// Exclusive or: tests if two booleans differ.
    Differ,
    /// Tests if a float is NaN. `IsInf` tests if a float is infinite.
    IsNan,
    IsInf,
    /// Selects one of two values by a condition. Registers: the result, the condition, the value for true, the value
    /// for false.
    Select(File),
    /// Copies a value in all lanes.
    Move(File),
    /// Copies a value in active lanes.
    Store(File),
    /// Copies the register that indices select from a range. Registers: the result, the range's first register,
    /// indices. [`Code::walks`] describes the indexing.
    Gather(File, u32),
    /// Stores a value in the register that `Gather` would copy. Registers: the range's first register, the value,
    /// indices.
    Scatter(File, u32),
    /// Copies the candidate that an index selects. Registers: the result, the candidates, the index. The `u32` is the
    /// number of candidates. The `bool` is `true` if the index is signed.
    Pick(File, u32, bool),
    /// Copies the element that an index selects from the table [`Code::tables`]`[u32]`. Registers: the result, the
    /// index.
    Table(File, u32),
    /// Loads a scalar from a buffer, with the indexing [`Code::walks`]`[u32]`. Registers: the result, the indices.
    Load(Scalar, u32),
    /// Writes a scalar to a buffer. Registers: the value, the indices.
    Write(Scalar, u32),
    /// Computes the number of elements of a runtime-sized array. Register: the result.
    ArrayLength(u32),
    /// Runs an atomic other than a load or a store. Registers: the old word (or none), for a compare-exchange the flag
    /// `exchanged`, the value, the compared value (or none), the indices.
    Atomic(u32),
    /// Reads or queries a texture, as [`Code::images`] describes. Registers: results, operands.
    Image(u32),
    /// Writes a texel. Registers: the texel's floats (if any), the coordinates and the layer, the texel's integers (if
    /// any).
    ImageStore(u32),
    /// Reports lanes in which a computed integer has wrapped around: an index, or a difference that is converted to a
    /// float, as in `f32(a - b)`. Registers: the integer, and the registers from which it is computed. [`Code::wraps`]
    /// describes the computation.
    Wrap(u32),

    /// Begins a branch. Jumps to `Else` or `EndIf` if the condition holds in no active lane. Register: the condition.
    If,
    /// Begins the other branch. Jumps to `EndIf` if no lane takes this branch. Register: the condition.
    Else,
    /// Ends an `if`. If no lane is active after it, jumps to the end of the enclosing branch, loop body or call.
    /// `EndSwitch`, `EndCall` and (after a loop) `Skip` also do this.
    EndIf,
    Switch,
    /// Begins a case of a `switch`. Register: the condition under which a lane enters the case. The `bool` is `true` if
    /// lanes of the previous case fall through into this case.
    Case(bool),
    EndSwitch,
    Loop,
    /// Begins an iteration of a loop, and counts it against each active lane's limit of iterations.
    Round,
    Continuing,
    /// Register: the condition.
    BreakIf,
    /// Ends a loop's body. Jumps back to `Round` while a lane is still in the loop.
    EndLoop,
    /// Comes after each loop. If no lane is active, jumps to the end of the enclosing construct.
    Skip,
    Call,
    EndCall,
    /// Makes the active lanes leave a loop or a `switch`. The argument is the number of open constructs inside of the
    /// one that the lanes leave: in `loop { if c { break; } }` it is 1.
    Break(u32),
    Continue(u32),
    Return(u32),
    /// Shows the value of a let-binding to observers, see [`Settings::named`](crate::Settings::named). Registers: the
    /// value's floats, then its integers, then its booleans.
    Mark(u32),
    /// Runs a subgroup operation, which [`Code::subgroups`] describes. Registers: the result, operands.
    Subgroup(u32),
    /// Makes active lanes helpers.
    Discard,
    /// A barrier. The argument lists the address spaces whose accesses it orders.
    Barrier(naga::Barrier),
    Halt,
}

impl Op {
    /// Checks if an operation ends a branch, a loop or a call, or a part of such a construct. Observers don't receive
    /// these operations. Each has the source position of the operation before it, and can run even if that operation
    /// didn't run.
    pub(crate) fn is_an_end(self) -> bool {
        matches!(
            self,
            Self::Else
                | Self::EndIf
                | Self::Case(_)
                | Self::EndSwitch
                | Self::Continuing
                | Self::EndLoop
                | Self::Skip
                | Self::EndCall
                | Self::Halt
        )
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Instruction {
    pub(crate) op: Op,
    /// The index of the operation's first register in the pool.
    pub(crate) at: u32,
    /// The number of the operation's registers in the pool. The number is 0 until `allocate` has assigned registers.
    pub(crate) count: u32,
    pub(crate) target: u32,
    pub(crate) site: u32,
}

/// One index of an access: the distance between neighbouring elements, the number of elements, and whether the index is
/// signed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Step {
    pub(crate) stride: u32,
    pub(crate) count: Count,
    pub(crate) signed: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Count {
    Fixed(u32),
    /// The length of a runtime-sized array. The array begins at byte `offset` of the buffer, and fills the rest.
    Runtime {
        offset: u32,
        stride: u32,
    },
}

/// A computed integer that may wrap around: an index, or a difference that is converted to a float.
#[derive(Clone, Debug)]
pub(crate) struct Wrap {
    pub(crate) buffer: Option<u32>,
    /// The array that the integer indexes. `None` if the integer isn't an index.
    pub(crate) step: Option<Step>,
    /// The computation of the integer in postfix order: operands before the operation that uses them.
    pub(crate) terms: Vec<Term>,
}

/// An operand or an operation in the computation of an integer. The machine repeats the computation in a wider type.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Term {
    /// The value of a register. Such terms use the registers of [`Op::Wrap`] in order, from the second one.
    Register,
    Negate,
    Add,
    Subtract,
    Multiply,
    ShiftLeft,
}

/// Describes how indices lead to a register, or to bytes of a buffer.
#[derive(Clone, Debug)]
pub(crate) struct Walk {
    pub(crate) buffer: u32,
    pub(crate) offset: u32,
    pub(crate) steps: Vec<Step>,
    pub(crate) atomic: Option<AtomicOp>,
    /// `true` for a non-atomic access to a buffer. Atomics don't race with each other.
    pub(crate) plain: bool,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct AtomicOp {
    pub(crate) function: AtomicFunction,
    pub(crate) scalar: Scalar,
    pub(crate) result: bool,
    /// `true` if another operation uses the word that the atomic returns.
    pub(crate) used: bool,
}

/// The place in the WGSL source from which Karat lowered an operation.
#[derive(Clone, Debug)]
pub struct Site {
    /// The site's number in the program.
    pub number: usize,
    /// The function in which the author wrote the operation.
    pub function: String,
    /// The expression from which Karat lowered the operation, if there is one.
    pub expression: Option<naga::Handle<naga::Expression>>,
    /// The name of the let-binding, if the operation comes from one.
    pub name: Option<String>,
    /// The byte range of the operation in the source.
    pub span: Span,
    /// `true` if the operation's results are floats of half precision.
    pub half: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Constant {
    pub(crate) scalar: Scalar,
    pub(crate) word: u32,
}

/// The number of floats, of integers and of booleans among an operation's results (`outs`) and among its arguments
/// (`ins`).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Shape {
    pub(crate) outs: [u32; 3],
    pub(crate) ins: [u32; 3],
}

#[derive(Clone, Debug)]
pub(crate) struct BufferSlot {
    pub(crate) binding: Binding,
    pub(crate) name: String,
    pub(crate) span: Span,
    /// The least size of the buffer, in bytes. A runtime-sized array counts as 0 bytes.
    pub(crate) least: u32,
    pub(crate) written: bool,
}

impl BufferSlot {
    pub(crate) fn workgroup_bytes(&self) -> u64 {
        if self.binding == Binding::Workgroup { u64::from(self.least) } else { 0 }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Binding {
    /// A resource that the caller binds.
    Resource { group: u32, binding: u32 },
    /// A `var<workgroup>`, which is zero when a workgroup starts.
    Workgroup,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Code {
    pub(crate) instructions: Vec<Instruction>,
    pub(crate) pool: Vec<u32>,
    pub(crate) sites: Vec<Site>,
    pub(crate) walks: Vec<Walk>,
    pub(crate) wraps: Vec<Wrap>,
    pub(crate) tables: Vec<(Vec<Constant>, bool)>,
    pub(crate) images: Vec<ImageOp>,
    pub(crate) subgroups: Vec<SubgroupOp>,
    pub(crate) subgroup: Option<Span>,
    pub(crate) buffers: Vec<BufferSlot>,
    pub(crate) textures: Vec<HandleSlot>,
    pub(crate) samplers: Vec<HandleSlot>,
    /// The registers of constants, with their values.
    pub(crate) constants: Vec<(Reg, Constant)>,
    pub(crate) registers: [u32; 3],
    /// For an entry point, the size of a workgroup in x, y and z. For a function, three zeros.
    pub(crate) workgroup: [u32; 3],
    pub(crate) parameters: Vec<(Reg, Scalar)>,
    pub(crate) results: Vec<(Reg, Scalar)>,
    /// For each [`Op::Mark`], the numbers of floats, integers and booleans in the let-binding's value.
    pub(crate) marks: Vec<[u32; 3]>,
    /// The source position of the first operation in half precision for which WGSL doesn't limit the error.
    pub(crate) half: Option<Span>,
    /// The registers of variables: those that [`Op::Store`] and [`Op::Scatter`] change. If a lane takes both branches
    /// of an undecided condition, only these registers can have different values in the two branches.
    pub(crate) mutable: [Vec<u32>; 3],
    pub(crate) statements: Vec<Statement>,
    /// Ranges of registers in which an index selects a register at run time. Allocation keeps the registers of a range
    /// together.
    pub(crate) pinned: Vec<(File, u32, u32)>,
}

impl Code {
    /// Checks if an access may race with another access. `walk` is the access's index in [`Code::walks`].
    pub(crate) fn may_race(&self, walk: u32) -> bool {
        let walk = &self.walks[walk as usize];
        let slot = self.buffers.get(walk.buffer as usize);
        walk.plain && self.workgroup != [0; 3] && slot.is_some_and(|slot| slot.written)
    }
}

#[derive(Clone, Debug)]
pub(crate) struct HandleSlot {
    pub(crate) written: bool,
    /// For a texture: the dimension and the scalar kind that the bound texture must have.
    pub(crate) image: Option<(naga::ImageDimension, naga::ScalarKind)>,
    pub(crate) group: u32,
    pub(crate) binding: u32,
    pub(crate) name: String,
    pub(crate) span: Span,
}

/// An operation on a texture.
///
/// The float operands are in this order: the coordinates, the depth reference, and the level or both gradients. The
/// integer operands of `textureLoad` are the coordinates, the layer, the sample index and the level. The integer
/// operands of `textureSample` and similar functions are the layer and the offset.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImageOp {
    pub(crate) texture: u32,
    pub(crate) sampler: u32,
    pub(crate) kind: ImageKind,
    pub(crate) coordinates: u32,
    pub(crate) arrayed: bool,
    /// A bit set with one bit for each integer operand: 1 if the operand is signed.
    pub(crate) signed: u32,
    pub(crate) signed_texels: bool,
    pub(crate) outs: [u32; 3],
    pub(crate) ins: [u32; 3],
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ImageKind {
    Sample { detail: Detail, compare: bool, gather: Option<u8>, clamp: bool },
    Load { level: bool, sample: bool, signed: bool },
    Size,
    Levels,
    Layers,
    Samples,
    Store(naga::StorageFormat),
}

/// A subgroup operation on one scalar. A vector needs one such operation for each component.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SubgroupOp {
    pub(crate) kind: SubgroupKind,
    pub(crate) scalar: Scalar,
}

/// The kind of a subgroup operation. The operands are a value, and for some kinds a lane index.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SubgroupKind {
    /// One of the four `u32` that `subgroupBallot` returns. The argument is its index. The operand is the predicate.
    Ballot(u32),
    Collective(naga::SubgroupOperation, naga::CollectiveOperation),
    Gather(From),
}

/// The lane from which another lane (the reading lane) reads a value.
#[derive(Clone, Copy, Debug)]
pub(crate) enum From {
    /// The first active lane.
    First,
    /// The lane whose index is the operand.
    Lane,
    /// The lane whose index is the reading lane's index plus the operand. `Below` subtracts the operand.
    Above,
    Below,
    Xor,
    /// The lane whose index in the quad is the operand.
    OfQuad,
    /// The lane whose index is the reading lane's index with these bits flipped.
    Swap(u32),
}

impl SubgroupKind {
    fn has_index(self) -> bool {
        match self {
            Self::Gather(from) => !matches!(from, From::First | From::Swap(_)),
            Self::Ballot(_) | Self::Collective(..) => false,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Detail {
    Zero,
    Exact,
    Gradient,
}

impl Code {
    /// Checks if the program contains derivatives, which read other lanes of a quad.
    pub(crate) fn has_neighbours(&self) -> bool {
        self.instructions.iter().any(|one| matches!(one.op, Op::Neighbour(_)))
    }

    pub(crate) fn shape(&self, op: Op) -> Shape {
        let one = |file: File| {
            let mut counts = [0; 3];
            counts[file as usize] = 1;
            counts
        };
        let with = |mut counts: [u32; 3], file: File, more: u32| {
            counts[file as usize] += more;
            counts
        };
        let float = one(File::Float);
        let int = one(File::Int);
        let bool = one(File::Bool);
        match op {
            Op::Float(rule) => {
                let (ins, outs) = rule.arity();
                Shape { outs: [outs as u32, 0, 0], ins: [ins as u32, 0, 0] }
            }
            Op::Integer(rule) => Shape { outs: int, ins: [0, rule.arity() as u32, 0] },
            Op::ToInt(rule) => Shape { outs: int, ins: [rule.arity() as u32, 0, 0] },
            Op::FromInt(rule) => Shape { outs: [rule.arity() as u32, 0, 0], ins: int },
            Op::Scale(_) => Shape { outs: float, ins: [1, 1, 0] },
            Op::ToHalf(_) | Op::Neighbour(_) => Shape { outs: float, ins: float },
            Op::CompareFloat(_) => Shape { outs: bool, ins: [2, 0, 0] },
            Op::CompareInt(..) => Shape { outs: bool, ins: [0, 2, 0] },
            Op::And | Op::Or | Op::Differ => Shape { outs: bool, ins: [0, 0, 2] },
            Op::Not => Shape { outs: bool, ins: bool },
            Op::IsNan | Op::IsInf => Shape { outs: bool, ins: float },
            Op::Select(file) => {
                Shape { outs: one(file), ins: with(with([0; 3], file, 2), File::Bool, 1) }
            }
            Op::Move(file) | Op::Store(file) => Shape { outs: one(file), ins: one(file) },
            Op::Gather(file, walk) => {
                let indices = self.walks[walk as usize].steps.len() as u32;
                Shape { outs: one(file), ins: with(one(file), File::Int, indices) }
            }
            Op::Scatter(file, walk) => {
                let indices = self.walks[walk as usize].steps.len() as u32;
                Shape { outs: one(file), ins: with(one(file), File::Int, indices) }
            }
            Op::Pick(file, count, _) => {
                Shape { outs: one(file), ins: with(with([0; 3], file, count), File::Int, 1) }
            }
            Op::Table(file, _) => Shape { outs: one(file), ins: int },
            Op::Load(scalar, walk) => {
                let indices = self.walks[walk as usize].steps.len() as u32;
                Shape { outs: one(scalar.file()), ins: [0, indices, 0] }
            }
            Op::Write(scalar, walk) => {
                let indices = self.walks[walk as usize].steps.len() as u32;
                Shape { outs: [0; 3], ins: with(one(scalar.file()), File::Int, indices) }
            }
            Op::ArrayLength(_) => Shape { outs: int, ins: [0; 3] },
            Op::Atomic(walk) => {
                let walk = &self.walks[walk as usize];
                let indices = walk.steps.len() as u32;
                let Some(atomic) = walk.atomic else { return Shape::default() };
                let compared =
                    matches!(atomic.function, AtomicFunction::Exchange { compare: Some(_) });
                Shape {
                    outs: [0, u32::from(atomic.result), u32::from(atomic.result && compared)],
                    ins: [0, 1 + u32::from(compared) + indices, 0],
                }
            }
            Op::Image(image) | Op::ImageStore(image) => {
                let image = &self.images[image as usize];
                Shape { outs: image.outs, ins: image.ins }
            }
            Op::Wrap(wrap) => {
                let terms = &self.wraps[wrap as usize].terms;
                let leaves = terms.iter().filter(|term| matches!(term, Term::Register));
                Shape { outs: [0; 3], ins: [0, 1 + leaves.count() as u32, 0] }
            }
            Op::Subgroup(operation) => {
                let SubgroupOp { kind, scalar } = self.subgroups[operation as usize];
                let value = if matches!(kind, SubgroupKind::Ballot(_)) {
                    File::Bool
                } else {
                    scalar.file()
                };
                let ins = with(one(value), File::Int, u32::from(kind.has_index()));
                Shape { outs: one(scalar.file()), ins }
            }
            Op::If | Op::Else | Op::Case(_) | Op::BreakIf => Shape { outs: [0; 3], ins: bool },
            Op::Mark(mark) => Shape { outs: [0; 3], ins: self.marks[mark as usize] },
            Op::EndIf
            | Op::Switch
            | Op::EndSwitch
            | Op::Loop
            | Op::Round
            | Op::Continuing
            | Op::EndLoop
            | Op::Skip
            | Op::Call
            | Op::EndCall
            | Op::Break(_)
            | Op::Continue(_)
            | Op::Return(_)
            | Op::Discard
            | Op::Barrier(_)
            | Op::Halt => Shape::default(),
        }
    }
}
