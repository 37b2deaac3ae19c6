//! The targets of pointers: registers of variables, or bytes of buffers.

use std::rc::Rc;

use naga::{Expression, Handle, TypeInner};

use super::{Lower, Lowered, Scope, Value};
use crate::code::{Count, Op, Reg, Step, Walk};
use crate::scalar::{Counts, File, Scalar, stride_bytes};

#[derive(Clone, Debug)]
pub(crate) struct Place {
    root: Root,
    inner: TypeInner,
    /// If the target is in a variable: the number of the variable's registers before the target, for each register
    /// file.
    offset: Counts,
    /// If the target is in a buffer: the number of bytes before the target.
    bytes: u32,
    indices: Vec<Index>,
}

#[derive(Clone, Copy, Debug)]
enum Root {
    /// A variable: for each register file, the first register (`base`), and the number of registers (`extent`).
    Local {
        base: Counts,
        extent: Counts,
    },
    Buffer(u32),
}

#[derive(Clone, Debug)]
pub(super) struct Index {
    pub(super) register: Reg,
    pub(super) signed: bool,
    count: Count,
    registers: Counts,
    bytes: u32,
}

impl Index {
    /// Describes the index as a [`Step`] with the stride in bytes.
    pub(super) fn step(&self) -> Step {
        Step { stride: self.bytes, count: self.count, signed: self.signed }
    }
}

impl Place {
    pub(super) fn local(base: Counts, extent: Counts, inner: TypeInner) -> Self {
        let root = Root::Local { base, extent };
        Self { root, inner, offset: [0; 3], bytes: 0, indices: Vec::new() }
    }

    pub(super) fn buffer(slot: u32, inner: TypeInner) -> Self {
        Self { root: Root::Buffer(slot), inner, offset: [0; 3], bytes: 0, indices: Vec::new() }
    }

    /// Checks if the target is a runtime-sized array. The engine checks even constant indices of such arrays.
    pub(super) fn has_no_length(&self) -> bool {
        matches!(self.inner, TypeInner::Array { size: naga::ArraySize::Dynamic, .. })
    }

    /// The registers of a variable's scalars. All indices of the target must be constants.
    pub(super) fn registers(&self, scalars: &[Scalar], extra: Counts) -> Rc<[Reg]> {
        let Root::Local { base, .. } = self.root else { return Rc::new([]) };
        let mut next: Counts = std::array::from_fn(|k| base[k] + self.offset[k] + extra[k]);
        scalars
            .iter()
            .map(|scalar| {
                let file = scalar.file();
                next[file as usize] += 1;
                Reg { file, index: next[file as usize] - 1 }
            })
            .collect()
    }
}

impl<'m> Lower<'m> {
    pub(super) fn component_place(&mut self, place: &Place, index: u32) -> Lowered<Rc<Place>> {
        let mut part = place.clone();
        match place.root {
            Root::Local { .. } => {
                let (inner, offset) = self
                    .layouts
                    .component(&place.inner, index)
                    .map_err(|what| self.refuse(what))?;
                part.inner = inner;
                part.offset = std::array::from_fn(|k| place.offset[k] + offset[k]);
            }
            Root::Buffer(_) => {
                let (inner, offset) = self
                    .layouts
                    .component_bytes(&place.inner, index)
                    .map_err(|what| self.refuse(what))?;
                part.inner = inner;
                part.bytes = place
                    .bytes
                    .checked_add(offset)
                    .ok_or_else(|| self.refuse("an offset above 4 GiB"))?;
            }
        }
        Ok(Rc::new(part))
    }

    /// The target for the element that `index` selects at run time.
    pub(super) fn element_place(
        &mut self,
        place: &Place,
        index: Reg,
        signed: bool,
    ) -> Lowered<Rc<Place>> {
        let (inner, length) =
            self.layouts.element(&place.inner).map_err(|what| self.refuse(what))?;
        if let (Some(constant), Some(length)) = (self.words.get(&index), length) {
            // A constant index that passed validation is in range. Other constant indices are clamped.
            let negative = signed && constant.word.cast_signed() < 0;
            let word = if negative { 0 } else { constant.word.min(length.saturating_sub(1)) };
            return self.component_place(place, word);
        }
        let mut part = place.clone();
        let stride = stride_bytes(&place.inner);
        let count = match length {
            Some(length) => Count::Fixed(length),
            None => Count::Runtime { offset: place.bytes, stride },
        };
        let registers = match place.root {
            Root::Local { .. } => self.counts(&inner)?,
            Root::Buffer(_) => [0; 3],
        };
        part.inner = inner;
        let index = Index { register: index, signed, count, registers, bytes: stride };
        let buffer = match place.root {
            Root::Buffer(slot) => Some(slot),
            Root::Local { .. } => None,
        };
        self.tell_wrapped(buffer, &index)?;
        part.indices.push(index);
        Ok(Rc::new(part))
    }

    pub(super) fn load(&mut self, place: &Place) -> Lowered<Value> {
        let indices: Vec<Reg> = place.indices.iter().map(|index| index.register).collect();
        let mut values = Vec::new();
        match place.root {
            Root::Local { base, extent } => {
                let scalars = self.scalars(&place.inner)?;
                for from in place.registers(&scalars, [0; 3]).iter() {
                    let to = self.fresh(from.file);
                    values.push(to);
                    if indices.is_empty() {
                        self.emit(Op::Move(from.file), &[to], &[*from])?;
                        continue;
                    }
                    let walk = self.walk(place, from.file);
                    self.pin(from.file, base, extent);
                    let ins = by_file(from.file, &[*from], &indices);
                    self.emit(Op::Gather(from.file, walk), &[to], &ins)?;
                }
            }
            Root::Buffer(slot) => {
                for (scalar, offset) in self.leaves(&place.inner, place.bytes)? {
                    let to = self.fresh(scalar.file());
                    values.push(to);
                    let walk = self.bytes_walk(place, slot, offset);
                    self.emit(Op::Load(scalar, walk), &[to], &indices)?;
                }
            }
        }
        Ok(Value::Flat(values.into()))
    }

    pub(super) fn store(&mut self, place: &Place, value: &[Reg]) -> Lowered<()> {
        let indices: Vec<Reg> = place.indices.iter().map(|index| index.register).collect();
        match place.root {
            Root::Local { base, extent } => {
                let scalars = self.scalars(&place.inner)?;
                let targets = place.registers(&scalars, [0; 3]);
                for (to, from) in targets.iter().zip(value) {
                    if indices.is_empty() {
                        self.emit(Op::Store(to.file), &[*to], &[*from])?;
                        continue;
                    }
                    let walk = self.walk(place, to.file);
                    self.pin(to.file, base, extent);
                    let ins = by_file(to.file, &[*from], &indices);
                    self.emit(Op::Scatter(to.file, walk), &[*to], &ins)?;
                }
            }
            Root::Buffer(slot) => {
                self.writes(slot)?;
                let leaves = self.leaves(&place.inner, place.bytes)?;
                for ((scalar, offset), from) in leaves.into_iter().zip(value) {
                    let walk = self.bytes_walk(place, slot, offset);
                    let ins = by_file(scalar.file(), &[*from], &indices);
                    self.emit(Op::Write(scalar, walk), &[], &ins)?;
                }
            }
        }
        Ok(())
    }

    /// Notes a write to a buffer. Fails if the program is a function, because the cases of a function mustn't see each
    /// other's writes.
    fn writes(&mut self, slot: u32) -> Lowered<()> {
        let buffer = &mut self.code.buffers[slot as usize];
        if !self.shared {
            let what = format!(
                "a function that writes the buffer `{}`, because all cases would share the buffer",
                buffer.name
            );
            return Err(self.refuse(what));
        }
        buffer.written = true;
        Ok(())
    }

    fn walk(&mut self, place: &Place, file: File) -> u32 {
        let step = |index: &Index| Step {
            stride: index.registers[file as usize],
            count: index.count,
            signed: index.signed,
        };
        let steps = place.indices.iter().map(step).collect();
        self.code.walks.push(Walk {
            buffer: u32::MAX,
            offset: 0,
            steps,
            atomic: None,
            plain: false,
        });
        self.code.walks.len() as u32 - 1
    }

    fn bytes_walk(&mut self, place: &Place, buffer: u32, offset: u32) -> u32 {
        let steps = place.indices.iter().map(Index::step).collect();
        let plain = !matches!(place.inner, TypeInner::Atomic(_));
        self.code.walks.push(Walk { buffer, offset, steps, atomic: None, plain });
        self.code.walks.len() as u32 - 1
    }

    fn pin(&mut self, file: File, base: Counts, extent: Counts) {
        let range = (file, base[file as usize], extent[file as usize]);
        if !self.code.pinned.contains(&range) {
            self.code.pinned.push(range);
        }
    }

    fn leaves(&self, inner: &TypeInner, offset: u32) -> Lowered<Vec<(Scalar, u32)>> {
        self.counts(inner)?;
        let mut leaves = Vec::new();
        self.append_leaves(inner, offset, &mut leaves)?;
        Ok(leaves)
    }

    fn append_leaves(
        &self,
        inner: &TypeInner,
        offset: u32,
        to: &mut Vec<(Scalar, u32)>,
    ) -> Lowered<()> {
        let parts = match *inner {
            TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar) => {
                to.push((self.scalar(scalar)?, offset));
                return Ok(());
            }
            TypeInner::Struct { ref members, .. } => members.len() as u32,
            _ => self.layouts.element(inner).map_err(|what| self.refuse(what))?.1.unwrap_or(0),
        };
        for index in 0..parts {
            let (part, bytes) =
                self.layouts.component_bytes(inner, index).map_err(|what| self.refuse(what))?;
            self.append_leaves(&part, offset.saturating_add(bytes), to)?;
        }
        Ok(())
    }

    pub(super) fn array_length(&mut self, place: &Place) -> Lowered<Value> {
        let Root::Buffer(buffer) = place.root else {
            return Err(self.refuse("`arrayLength` of an array that isn't in a buffer"));
        };
        let stride = stride_bytes(&place.inner);
        let count = Count::Runtime { offset: place.bytes, stride };
        let steps = vec![Step { stride, count, signed: false }];
        self.code.walks.push(Walk { buffer, offset: 0, steps, atomic: None, plain: false });
        let walk = self.code.walks.len() as u32 - 1;
        let to = self.fresh(File::Int);
        self.emit(Op::ArrayLength(walk), &[to], &[])?;
        Ok(Value::Flat(Rc::new([to])))
    }

    pub(super) fn atomic(
        &mut self,
        scope: &mut Scope<'m>,
        pointer: Handle<Expression>,
        function: naga::AtomicFunction,
        value: Handle<Expression>,
        result: Option<Handle<Expression>>,
    ) -> Lowered<()> {
        let place = self.place(scope, pointer)?;
        let (Root::Buffer(buffer), TypeInner::Atomic(scalar)) = (place.root, &place.inner) else {
            return Err(self.refuse("an atomic operation on a variable that isn't in a buffer"));
        };
        let scalar = self.scalar(*scalar)?;
        if scalar.file() != File::Int {
            return Err(self.refuse("an atomic operation on a float"));
        }
        self.writes(buffer)?;
        let mut ins = vec![self.flat(scope, value)?[0]];
        let compared = match function {
            naga::AtomicFunction::Exchange { compare: Some(compare) } => {
                ins.push(self.flat(scope, compare)?[0]);
                true
            }
            _ => false,
        };
        ins.extend(place.indices.iter().map(|index| index.register));
        let mut outs = Vec::new();
        if result.is_some() {
            outs.push(self.fresh(File::Int));
            if compared {
                outs.push(self.fresh(File::Bool));
            }
        }
        let walk = self.bytes_walk(&place, buffer, place.bytes);
        let result_is = result.is_some();
        self.code.walks[walk as usize].atomic =
            Some(crate::code::AtomicOp { function, scalar, result: result_is, used: result_is });
        self.emit(Op::Atomic(walk), &outs, &ins)?;
        if let Some(result) = result {
            scope.values[result.index()] = Some(Value::Flat(outs.into()));
        }
        Ok(())
    }
}

/// Lists the registers `first` and `indices` in the order of the register files: the indices, which are integers, come
/// after floats, and before booleans.
fn by_file(file: File, first: &[Reg], indices: &[Reg]) -> Vec<Reg> {
    if file == File::Bool { [indices, first].concat() } else { [first, indices].concat() }
}
