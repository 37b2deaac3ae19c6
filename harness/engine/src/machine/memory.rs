//! Accesses registers and bytes by index.

use std::borrow::Cow;

use naga::AtomicFunction;

use super::Machine;
use crate::arithmetic::sealed::Rules;
use crate::code::{Count, Instruction, Op, Step, Walk};
use crate::columns::Columns;
use crate::options::Elsewhere;
use crate::races::{Accessed, Detector, Place};
use crate::rules::Half;
use crate::scalar::{File, Scalar};

/// The kind of an access, as two flags: `true` if the access reads, and `true` if the access writes.
const READS: (bool, bool) = (true, false);
const WRITES: (bool, bool) = (false, true);
const READS_AND_WRITES: (bool, bool) = (true, true);

/// The bytes of a buffer. If a program writes the buffer, `floats` also has the written floats, because an `f64`
/// doesn't fit into one word.
#[derive(Clone, Debug)]
pub(crate) struct Buffer<'a, A: Rules> {
    pub(crate) bytes: Cow<'a, [u8]>,
    /// For each word, the float that was written there. The float is valid only while the word is unchanged.
    floats: Vec<Option<A::Float>>,
}

impl<'a, A: Rules> Buffer<'a, A> {
    pub(crate) fn new(bytes: Cow<'a, [u8]>, written: bool) -> Self {
        let words = if written { bytes.len().div_ceil(4) } else { 0 };
        Self { bytes, floats: vec![None; words] }
    }

    pub(crate) fn clear(&mut self) {
        self.bytes.to_mut().fill(0);
        self.floats.fill(None);
    }

    pub(super) fn word(&self, at: usize) -> u32 {
        match self.bytes.get(at..at + 4) {
            Some(bytes) => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            None => 0,
        }
    }

    pub(super) fn put(&mut self, at: usize, word: &[u8]) {
        if let Some(bytes) = self.bytes.to_mut().get_mut(at..at + word.len()) {
            bytes.copy_from_slice(word);
        }
    }

    fn half(&self, at: usize) -> f32 {
        match self.bytes.get(at..at + 2) {
            Some(bytes) => half::f16::from_le_bytes([bytes[0], bytes[1]]).to_f32(),
            None => 0.0,
        }
    }

    fn float(&self, at: usize) -> A::Float {
        let word = self.word(at);
        match self.floats.get(at / 4) {
            Some(&Some(float)) if A::float_word(float) == word => float,
            _ => A::float(f32::from_bits(word)),
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Memory<'a, A: Rules> {
    pub(crate) buffers: Vec<Buffer<'a, A>>,
    pub(crate) textures: Vec<Cow<'a, crate::texture::Texture>>,
    pub(crate) samplers: Vec<&'a crate::texture::Sampler>,
}

impl Step {
    pub(super) fn length(&self, bytes: usize) -> u64 {
        match self.count {
            Count::Fixed(count) => u64::from(count),
            Count::Runtime { offset, stride } => {
                (bytes as u64).saturating_sub(u64::from(offset)) / u64::from(stride.max(1))
            }
        }
    }
}

/// Calls `visit` with each offset that the indices of a lane may select. In intervals, an index may select several
/// offsets. Returns `true` if an index was clamped.
pub(super) fn walk_lane<A: Rules>(
    (walk, elsewhere): (&Walk, Elsewhere),
    indices: &[u32],
    ints: &Columns<A::Int>,
    lane: usize,
    bytes: usize,
    mut visit: impl FnMut(usize),
) -> bool {
    let mut clamped = false;
    let mut one = u64::from(walk.offset);
    let mut many: Vec<u64> = Vec::new();
    for (step, &index) in walk.steps.iter().zip(indices) {
        let last = step.length(bytes).saturating_sub(1) as i64;
        let (lo, hi) = A::bounds(ints.get(index)[lane], step.signed);
        clamped |= lo < 0 || hi > last;
        let (lo, hi) = (elsewhere.find(lo, last), elsewhere.find(hi, last));
        if lo == hi && many.is_empty() {
            one += lo as u64 * u64::from(step.stride);
            continue;
        }
        let before = if many.is_empty() { vec![one] } else { std::mem::take(&mut many) };
        for index in lo.min(hi)..=hi.max(lo) {
            many.extend(before.iter().map(|at| at + index as u64 * u64::from(step.stride)));
        }
    }
    if many.is_empty() {
        visit(one as usize);
    } else {
        many.into_iter().for_each(|at| visit(at as usize));
    }
    clamped
}

/// For each lane, copies to a register the element of `columns` that the indices select.
macro_rules! gathered {
    ($self:ident, $columns:ident, $select:path, $registers:ident, $base:expr, $indices:expr, $walk:ident) => {{
        let (base, indices) = ($base, $indices);
        let elsewhere = $self.elsewhere();
        for lane in 0..$self.width {
            let mut value = None;
            let walk = ($walk, elsewhere);
            let clamped = walk_lane::<A>(walk, indices, &$self.ints, lane, 0, |at| {
                let here = $self.$columns.get(base + at as u32)[lane];
                value = Some(match value {
                    Some(before) => $select(A::undecided(), before, here),
                    None => here,
                });
            });
            if clamped && A::possible($self.active()[lane]) {
                $self.leave(lane);
            }
            if let Some(value) = value {
                $self.$columns.get_mut($registers[0])[lane] = value;
            }
        }
    }};
}

macro_rules! scattered {
    ($self:ident, $columns:ident, $select:path, $base:expr, $value:expr, $indices:expr, $walk:ident) => {{
        let (base, from, indices) = ($base, $value, $indices);
        let mut places = Vec::new();
        for lane in 0..$self.width {
            let mask = $self.active()[lane];
            if !A::possible(mask) {
                continue;
            }
            let value = $self.$columns.get(from)[lane];
            let walk = ($walk, Elsewhere::Clamped);
            places.clear();
            let clamped =
                walk_lane::<A>(walk, indices, &$self.ints, lane, 0, |at| places.push(at as u32));
            if clamped && $self.leave_unwritten(lane) {
                continue;
            }
            let mask = if places.len() > 1 { A::and(mask, A::undecided()) } else { mask };
            for at in places.drain(..) {
                let place = &mut $self.$columns.get_mut(base + at)[lane];
                *place = $select(mask, value, *place);
            }
        }
    }};
}

impl<'p, A: Rules> Machine<'p, A> {
    /// Notes that the index of a lane is outside of its array. In intervals, this makes the lane's results unbounded,
    /// because the specification lets an implementation read any element or zero, and write any element.
    pub(super) fn leave(&mut self, lane: usize) {
        if self.is_helper(lane) {
            return;
        }
        self.strayed.push(lane);
        if A::UNDECIDED {
            self.lost[lane] = self.lost[lane].or(Some(self.site));
        }
    }

    /// If the lane's index is outside of an array in a buffer: the index, and the number of elements. If a coordinate
    /// is outside of a texture: the coordinate, and the number of texels in this direction. For an index that wraps
    /// around: the index without wrapping, and the index with wrapping.
    pub(super) fn beyond(
        &self,
        instruction: &Instruction,
        registers: &[u32],
        lane: usize,
        memory: &Memory<'_, A>,
    ) -> Option<(i64, u64)> {
        let walk = match instruction.op {
            Op::Load(_, walk) | Op::Atomic(walk) => walk,
            Op::Write(scalar, walk) if scalar != Scalar::Bool => walk,
            Op::Wrap(_) => {
                let index = A::bounds(self.ints.get(registers[0])[lane], false).0;
                return Some((self.meant, index.cast_unsigned()));
            }
            Op::Image(image) => return self.texel_beyond(image, registers, lane, memory),
            _ => return None,
        };
        let walk = &self.code.walks[walk as usize];
        let bytes = memory.buffers[walk.buffer as usize].bytes.len();
        // In the operation's list of registers, those of the indices come last.
        let shape = self.code.shape(instruction.op);
        let all = shape.outs.iter().chain(&shape.ins).sum::<u32>() as usize;
        let indices = &registers[..all][all - walk.steps.len()..];
        walk.steps.iter().zip(indices).find_map(|(step, &index)| {
            let (index, _) = A::bounds(self.ints.get(index)[lane], step.signed);
            let length = step.length(bytes);
            (index < 0 || index.cast_unsigned() >= length).then_some((index, length))
        })
    }

    /// The variable that an operation indexes, and `true` if the indexed array is only a part of the variable.
    pub(super) fn array_of(&self, op: Op) -> (Option<&'p str>, bool) {
        let code = self.code;
        let (slot, nested) = match op {
            Op::Load(_, walk) | Op::Atomic(walk) | Op::Write(_, walk) => {
                let walk = &code.walks[walk as usize];
                (Some(walk.buffer), walk.steps.len() > 1 || walk.offset > 0)
            }
            Op::Wrap(wrap) => (code.wraps[wrap as usize].buffer, false),
            Op::Image(image) => {
                let slot = code.images[image as usize].texture as usize;
                return (Some(&code.textures[slot].name), false);
            }
            _ => (None, false),
        };
        (slot.map(|slot| &*code.buffers[slot as usize].name), nested)
    }

    /// The element that the current operation accesses if an index is outside of its array.
    pub(super) fn elsewhere(&self) -> Elsewhere {
        match self.options.outside_at {
            Some((site, elsewhere)) if site == self.site => elsewhere,
            _ => self.options.outside.reads,
        }
    }

    /// Notes that the index of a write is outside of its array. Returns `true` if the write has no effect.
    fn leave_unwritten(&mut self, lane: usize) -> bool {
        self.leave(lane);
        self.options.outside.drops
    }

    pub(super) fn gather(&mut self, file: File, walk: u32, registers: &[u32]) {
        let walk = &self.code.walks[walk as usize];
        let n = walk.steps.len();
        match file {
            File::Float => {
                gathered!(
                    self,
                    floats,
                    A::select_float,
                    registers,
                    registers[1],
                    &registers[2..],
                    walk
                )
            }
            File::Int => {
                gathered!(self, ints, A::select_int, registers, registers[1], &registers[2..], walk)
            }
            File::Bool => {
                gathered!(
                    self,
                    bools,
                    A::select_bool,
                    registers,
                    registers[1 + n],
                    &registers[1..=n],
                    walk
                )
            }
        }
    }

    pub(super) fn scatter(&mut self, file: File, walk: u32, registers: &[u32]) {
        let walk = &self.code.walks[walk as usize];
        let n = walk.steps.len();
        let base = registers[0];
        match file {
            File::Float => {
                scattered!(self, floats, A::select_float, base, registers[1], &registers[2..], walk)
            }
            File::Int => {
                scattered!(self, ints, A::select_int, base, registers[1], &registers[2..], walk)
            }
            File::Bool => {
                scattered!(
                    self,
                    bools,
                    A::select_bool,
                    base,
                    registers[1 + n],
                    &registers[1..=n],
                    walk
                )
            }
        }
    }

    fn chosen(&self, index: u32, signed: bool, count: usize, lane: usize) -> (usize, usize, bool) {
        let last = count.saturating_sub(1) as i64;
        let (lo, hi) = A::bounds(self.ints.get(index)[lane], signed);
        let clamped = (lo < 0 || hi > last) && A::possible(self.active()[lane]);
        let find = |index: i64| self.elsewhere().find(index, last) as usize;
        (find(lo).min(find(hi)), find(hi).max(find(lo)), clamped)
    }

    pub(super) fn pick(&mut self, file: File, count: u32, signed: bool, registers: &[u32]) {
        let count = count as usize;
        let (index, candidates) = match file {
            File::Bool => (registers[1], &registers[2..]),
            _ => (registers[1 + count], &registers[1..=count]),
        };
        for lane in 0..self.width {
            let (lo, hi, clamped) = self.chosen(index, signed, count, lane);
            if clamped {
                self.leave(lane);
            }
            macro_rules! picked {
                ($columns:ident, $select:path) => {{
                    let mut value = self.$columns.get(candidates[lo])[lane];
                    for &candidate in &candidates[lo + 1..=hi.max(lo)] {
                        value = $select(A::undecided(), value, self.$columns.get(candidate)[lane]);
                    }
                    self.$columns.get_mut(registers[0])[lane] = value;
                }};
            }
            match file {
                File::Float => picked!(floats, A::select_float),
                File::Int => picked!(ints, A::select_int),
                File::Bool => picked!(bools, A::select_bool),
            }
        }
    }

    pub(super) fn table(&mut self, file: File, table: u32, registers: &[u32]) {
        let (table, signed) = &self.code.tables[table as usize];
        for lane in 0..self.width {
            let (lo, hi, clamped) = self.chosen(registers[1], *signed, table.len(), lane);
            if clamped {
                self.leave(lane);
            }
            let entries = &table[lo..=hi];
            match file {
                File::Float => {
                    let values = entries.iter().map(|entry| A::float(f32::from_bits(entry.word)));
                    let value = values.reduce(|a, b| A::select_float(A::undecided(), a, b));
                    if let Some(value) = value {
                        self.floats.get_mut(registers[0])[lane] = value;
                    }
                }
                File::Int => {
                    let values =
                        entries.iter().map(|entry| A::int(entry.word, entry.scalar.signed()));
                    let value = values.reduce(|a, b| A::select_int(A::undecided(), a, b));
                    if let Some(value) = value {
                        self.ints.get_mut(registers[0])[lane] = value;
                    }
                }
                File::Bool => {
                    let values = entries.iter().map(|entry| A::bool(entry.word != 0));
                    let value = values.reduce(|a, b| A::select_bool(A::undecided(), a, b));
                    if let Some(value) = value {
                        self.bools.get_mut(registers[0])[lane] = value;
                    }
                }
            }
        }
    }

    pub(super) fn load(
        &mut self,
        scalar: Scalar,
        walk: u32,
        registers: &[u32],
        memory: &Memory<'_, A>,
    ) {
        let walk = &self.code.walks[walk as usize];
        let buffer = &memory.buffers[walk.buffer as usize];
        let length = buffer.bytes.len();
        // Without an index, all lanes load the same element.
        let lanes = if walk.steps.is_empty() { 1 } else { self.width };
        let join = A::undecided();
        let notes = self.notes(walk);
        // The element that each lane loads, for the detector.
        let mut places = std::mem::take(&mut self.places);
        places.clear();
        for lane in 0..lanes {
            let (mut float, mut int, mut truth) = (None, None, None);
            let mut place = 0;
            let clamped = walk_lane::<A>(
                (walk, self.elsewhere()),
                &registers[1..],
                &self.ints,
                lane,
                length,
                |at| {
                    place = at;
                    match scalar {
                        Scalar::F32 | Scalar::F16 => {
                            let x = match scalar {
                                Scalar::F32 => buffer.float(at),
                                _ => A::to_half(A::float(buffer.half(at)), Half::Rounded),
                            };
                            float =
                                Some(float.map_or(x, |before| A::select_float(join, before, x)));
                        }
                        Scalar::I32 | Scalar::U32 => {
                            let x = A::int(buffer.word(at), scalar.signed());
                            int = Some(int.map_or(x, |before| A::select_int(join, before, x)));
                        }
                        Scalar::Bool => {
                            let x = A::bool(buffer.bytes.get(at).is_some_and(|byte| *byte != 0));
                            truth = Some(truth.map_or(x, |before| A::select_bool(join, before, x)));
                        }
                    }
                },
            );
            if notes {
                places.push((place, clamped));
            }
            if clamped && A::possible(self.active()[lane]) {
                self.leave(lane);
            }
            if let Some(x) = float {
                self.floats.get_mut(registers[0])[lane] = x;
            }
            if let Some(x) = int {
                self.ints.get_mut(registers[0])[lane] = x;
            }
            if let Some(x) = truth {
                self.bools.get_mut(registers[0])[lane] = x;
            }
        }
        if lanes == 1 {
            match scalar.file() {
                File::Float => fill(self.floats.get_mut(registers[0])),
                File::Int => fill(self.ints.get_mut(registers[0])),
                File::Bool => fill(self.bools.get_mut(registers[0])),
            }
        }
        if !notes {
            self.places = places;
            return;
        }
        let found = |_: &Self, lane: usize| places[lane.min(lanes - 1)];
        self.note_accesses(walk, &found, READS, |_, at| match scalar {
            Scalar::F16 => u32::from(half::f16::from_f32(buffer.half(at)).to_bits()),
            Scalar::Bool => u32::from(buffer.bytes.get(at).is_some_and(|byte| *byte != 0)),
            _ => buffer.word(at),
        });
        self.places = places;
    }

    fn notes(&self, walk: &Walk) -> bool {
        let watches = |detector: &Detector| detector.watches_buffer(walk.buffer);
        self.detector.as_deref().is_some_and(watches)
    }

    /// The offset of a lane's access, and `true` if the access has an index outside of its array.
    fn place_of(&self, walk: &Walk, indices: &[u32], lane: usize, length: usize) -> (usize, bool) {
        let mut at = 0;
        let found = (walk, Elsewhere::Clamped);
        let strays = walk_lane::<A>(found, indices, &self.ints, lane, length, |to| at = to);
        (at, strays)
    }

    /// Reports to the detector, if there is one, the elements that the lanes accessed, and their words.
    fn note_accesses(
        &mut self,
        walk: &Walk,
        place_of: &impl Fn(&Self, usize) -> (usize, bool),
        (reads, writes): (bool, bool),
        word: impl Fn(usize, usize) -> u32,
    ) {
        let Some(mut detector) = self.detector.take() else { return };
        for lane in 0..self.width {
            if !self.acts(lane) {
                continue;
            }
            let (at, strays) = place_of(self, lane);
            // An access outside of the array may go anywhere. It is reported as an index outside, and not as a race.
            if strays {
                continue;
            }
            let place = Place::Byte(at as u32);
            let (site, word) = (self.site, word(lane, at));
            let accessed = Accessed { lane, site, place, index: at / 4, word };
            if walk.plain {
                let is_written = detector.buffer(self.code, walk.buffer, accessed, writes);
                if writes || !is_written {
                    detector.touch(self.code, walk.buffer, accessed, (reads, writes));
                }
            } else {
                detector.touch(self.code, walk.buffer, accessed, (reads, writes));
                detector.atomic(lane, (walk.buffer, at), walk.access(writes));
            }
        }
        self.detector = Some(detector);
    }

    pub(super) fn write(
        &mut self,
        scalar: Scalar,
        walk: u32,
        registers: &[u32],
        memory: &mut Memory<'_, A>,
    ) {
        let walk = &self.code.walks[walk as usize];
        let n = walk.steps.len();
        let (value, indices) = match scalar {
            Scalar::Bool => (registers[n], &registers[..n]),
            _ => (registers[0], &registers[1..]),
        };
        let buffer = &mut memory.buffers[walk.buffer as usize];
        let length = buffer.bytes.len();
        let word = |machine: &Self, lane: usize| match scalar {
            Scalar::F32 => A::float_word(machine.floats.get(value)[lane]),
            Scalar::F16 => {
                let x = f32::from_bits(A::float_word(machine.floats.get(value)[lane]));
                u32::from(half::f16::from_f32(x).to_bits())
            }
            Scalar::I32 | Scalar::U32 => A::int_word(machine.ints.get(value)[lane]),
            Scalar::Bool => A::bool_word(machine.bools.get(value)[lane]),
        };
        if self.notes(walk) {
            let words: Vec<u32> = (0..self.width).map(|lane| word(self, lane)).collect();
            let found = |own: &Self, lane| own.place_of(walk, indices, lane, length);
            self.note_accesses(walk, &found, WRITES, |lane, _| words[lane]);
        }
        for lane in 0..self.width {
            if !self.acts(lane) {
                continue;
            }
            let mut at = 0;
            let found = (walk, Elsewhere::Clamped);
            if walk_lane::<A>(found, indices, &self.ints, lane, length, |to| at = to)
                && self.leave_unwritten(lane)
            {
                continue;
            }
            let bytes = word(self, lane).to_le_bytes();
            match scalar {
                Scalar::F32 => {
                    buffer.put(at, &bytes);
                    if let Some(float) = buffer.floats.get_mut(at / 4) {
                        *float = Some(self.floats.get(value)[lane]);
                    }
                }
                Scalar::F16 => buffer.put(at, &bytes[..2]),
                Scalar::I32 | Scalar::U32 => buffer.put(at, &bytes),
                Scalar::Bool => buffer.put(at, &bytes[..1]),
            }
        }
    }

    pub(super) fn array_length(&mut self, walk: u32, out: u32, memory: &Memory<'_, A>) {
        let walk = &self.code.walks[walk as usize];
        let bytes = memory.buffers[walk.buffer as usize].bytes.len();
        let length = walk.steps.first().map_or(0, |step| step.length(bytes));
        self.ints.get_mut(out).fill(A::int(u32::try_from(length).unwrap_or(u32::MAX), false));
    }

    /// Runs an atomic in one lane after another. This is one of the orders that the specification allows.
    pub(super) fn atomic(&mut self, walk: u32, registers: &[u32], memory: &mut Memory<'_, A>) {
        let walk = &self.code.walks[walk as usize];
        let Some(atomic) = walk.atomic else { return };
        let compared = matches!(atomic.function, AtomicFunction::Exchange { compare: Some(_) });
        let outs = usize::from(atomic.result) + usize::from(atomic.result && compared);
        let operand = registers[outs];
        let indices = &registers[outs + 1 + usize::from(compared)..];
        let buffer = &mut memory.buffers[walk.buffer as usize];
        let length = buffer.bytes.len();
        let signed = atomic.scalar.signed();
        // A compare-exchange whose comparison fails writes nothing.
        let noted = if compared { READS } else { READS_AND_WRITES };
        if self.notes(walk) {
            let found = |own: &Self, lane| own.place_of(walk, indices, lane, length);
            self.note_accesses(walk, &found, noted, |_, _| 0);
        }
        for lane in 0..self.width {
            if self.is_helper(lane) && atomic.result {
                // WGSL allows any result for a helper. Returning a success here ends a loop that waits for a success.
                let seen = if compared {
                    self.ints.get(registers[outs + 1])[lane]
                } else {
                    A::int(0, signed)
                };
                self.ints.get_mut(registers[0])[lane] = seen;
                if compared {
                    self.bools.get_mut(registers[1])[lane] = A::bool(true);
                }
            }
            if !self.acts(lane) {
                continue;
            }
            let mut at = 0;
            let found = (walk, Elsewhere::Clamped);
            if walk_lane::<A>(found, indices, &self.ints, lane, length, |to| at = to)
                && self.leave_unwritten(lane)
            {
                if atomic.result {
                    let old = match self.elsewhere() {
                        Elsewhere::Number(number) => u32::from(number),
                        _ => buffer.word(at),
                    };
                    self.ints.get_mut(registers[0])[lane] = A::int(old, signed);
                    if compared {
                        self.bools.get_mut(registers[1])[lane] = A::bool(false);
                    }
                }
                continue;
            }
            let old = buffer.word(at);
            let x = A::int_word(self.ints.get(operand)[lane]);
            let mut exchanged = true;
            let new = match atomic.function {
                AtomicFunction::Exchange { compare: Some(_) } => {
                    exchanged = A::int_word(self.ints.get(registers[outs + 1])[lane]) == old;
                    if exchanged { x } else { old }
                }
                function => changed_by(function, old, x, signed),
            };
            buffer.put(at, &new.to_le_bytes());
            if let Some(detector) = self.detector.as_mut().filter(|_| compared && exchanged) {
                let place = Place::Byte(at as u32);
                let accessed = Accessed { lane, site: self.site, place, index: at / 4, word: new };
                detector.touch(self.code, walk.buffer, accessed, WRITES);
            }
            if atomic.result {
                self.ints.get_mut(registers[0])[lane] = A::int(old, signed);
                if compared {
                    self.bools.get_mut(registers[1])[lane] = A::bool(exchanged);
                }
            }
        }
    }
}

/// The word that an atomic stores in place of `old`. For a compare-exchange, the caller has already compared the words.
pub(super) fn changed_by(function: AtomicFunction, old: u32, x: u32, signed: bool) -> u32 {
    let order = |less: bool| {
        let x_is_less = if signed { x.cast_signed() < old.cast_signed() } else { x < old };
        if x_is_less == less { x } else { old }
    };
    match function {
        AtomicFunction::Add => old.wrapping_add(x),
        AtomicFunction::Subtract => old.wrapping_sub(x),
        AtomicFunction::And => old & x,
        AtomicFunction::ExclusiveOr => old ^ x,
        AtomicFunction::InclusiveOr => old | x,
        AtomicFunction::Min => order(true),
        AtomicFunction::Max => order(false),
        AtomicFunction::Exchange { .. } => x,
    }
}

fn fill<T: Copy>(lanes: &mut [T]) {
    if let Some(&first) = lanes.first() {
        lanes.fill(first);
    }
}
