//! Subgroup operations, in which lanes see each other's values.

use naga::{CollectiveOperation, SubgroupOperation};

use super::Machine;
use crate::arithmetic::sealed::Rules;
use crate::code::{From, SubgroupKind, SubgroupOp};
use crate::options::Elsewhere;
use crate::scalar::{File, Scalar};

impl<A: Rules> Machine<'_, A> {
    fn subgroup_size(&self) -> usize {
        self.options.subgroup() as usize
    }

    pub(super) fn subgroup(&mut self, operation: u32, registers: &[u32]) {
        let operation = self.code.subgroups[operation as usize];
        self.note_subgroups();
        for first in (0..self.width).step_by(self.subgroup_size()) {
            let last = (first + self.subgroup_size()).min(self.width);
            let here = (first..last).filter(|lane| A::possible(self.active()[*lane]));
            let here: Vec<usize> = here.collect();
            match operation.kind {
                SubgroupKind::Ballot(word) => self.ballot(word, registers, first, &here),
                SubgroupKind::Gather(from) => {
                    self.gather_of(operation, from, registers, first, &here)
                }
                SubgroupKind::Collective(function, collective) => {
                    let words =
                        here.iter().map(|lane| self.word(operation.scalar, registers[1], *lane));
                    let words: Vec<u32> = words.collect();
                    let all = collected(operation.scalar, function, collective, &words);
                    for (lane, word) in here.iter().zip(all) {
                        self.set_word(operation.scalar, registers[0], *lane, word);
                    }
                }
            }
        }
    }

    /// Reports to the detector, if there is one, each subgroup in which only some of the lanes reach an operation.
    fn note_subgroups(&mut self) {
        let Some(mut detector) = self.detector.take() else { return };
        let active: Vec<bool> = self.active().iter().map(|mask| A::possible(*mask)).collect();
        for (number, lanes) in active.chunks(self.subgroup_size()).enumerate() {
            if lanes.contains(&true) {
                let first = number * self.subgroup_size();
                let met = (&*self.parted, lanes.iter().copied());
                detector.meet(self.code, self.site, (first, true), met);
            }
        }
        self.detector = Some(detector);
    }

    fn ballot(&mut self, word: u32, registers: &[u32], first: usize, here: &[usize]) {
        let mut bits = 0;
        for lane in here {
            let own = (lane - first) as u32;
            if own / 32 == word && A::possible(self.bools.get(registers[1])[*lane]) {
                bits |= 1 << (own % 32);
            }
        }
        for lane in here {
            self.ints.get_mut(registers[0])[*lane] = A::int(bits, false);
        }
    }

    /// Copies to each lane the value of another lane, for example for `subgroupShuffle`. If the other lane doesn't
    /// exist, or isn't active, the result may be any value, as for an index outside of an array.
    fn gather_of(
        &mut self,
        operation: SubgroupOp,
        from: From,
        registers: &[u32],
        first: usize,
        here: &[usize],
    ) {
        let (value, index) = match operation.scalar.file() {
            File::Bool if registers.len() > 2 => (registers[2], Some(registers[1])),
            _ => (registers[1], registers.get(2).copied()),
        };
        let is_float = operation.scalar.file() == File::Float;
        let words: Vec<u32> =
            here.iter().map(|lane| self.word(operation.scalar, value, *lane)).collect();
        // A float is moved without a change.
        let floats: Vec<A::Float> = match is_float {
            true => here.iter().map(|lane| self.floats.get(value)[*lane]).collect(),
            false => Vec::new(),
        };
        for (at, lane) in here.iter().enumerate() {
            let own = (lane - first) as u32;
            let by = index.map_or(0, |index| A::int_word(self.ints.get(index)[*lane]));
            let wanted = match from {
                From::First => Some((here[0] - first) as u32),
                From::Lane => Some(by),
                From::Above => own.checked_add(by),
                From::Below => own.checked_sub(by),
                From::Xor => Some(own ^ by),
                From::OfQuad => (by < 4).then_some(own & !3 | by),
                From::Swap(by) => Some(own ^ by),
            };
            let there = wanted.and_then(|own| {
                let lane = first.checked_add(own as usize)?;
                here.binary_search(&lane).ok()
            });
            if there.is_none() {
                self.leave(*lane);
            }
            let there = there.unwrap_or(match self.elsewhere() {
                Elsewhere::Nth(number) => number as usize % here.len(),
                Elsewhere::Wrapped => here.len() - 1,
                Elsewhere::Clamped | Elsewhere::Number(_) => at,
            });
            match is_float {
                true => self.floats.get_mut(registers[0])[*lane] = floats[there],
                false => self.set_word(operation.scalar, registers[0], *lane, words[there]),
            }
        }
    }

    fn word(&self, scalar: Scalar, register: u32, lane: usize) -> u32 {
        match scalar.file() {
            File::Float => A::float_word(self.floats.get(register)[lane]),
            File::Int => A::int_word(self.ints.get(register)[lane]),
            File::Bool => A::bool_word(self.bools.get(register)[lane]),
        }
    }

    fn set_word(&mut self, scalar: Scalar, register: u32, lane: usize, word: u32) {
        match scalar.file() {
            File::Float => self.floats.get_mut(register)[lane] = A::float(f32::from_bits(word)),
            File::Int => self.ints.get_mut(register)[lane] = A::int(word, scalar.signed()),
            File::Bool => self.bools.get_mut(register)[lane] = A::bool(word != 0),
        }
    }
}

/// Applies a collective operation to one `u32` of each lane. Returns the results of all lanes, in order.
fn collected(
    scalar: Scalar,
    function: SubgroupOperation,
    collective: CollectiveOperation,
    words: &[u32],
) -> Vec<u32> {
    let both = |a: u32, b: u32| combined(scalar, function, a, b);
    match collective {
        CollectiveOperation::Reduce => {
            let all = words.iter().copied().reduce(both);
            vec![all.unwrap_or_default(); words.len()]
        }
        CollectiveOperation::InclusiveScan | CollectiveOperation::ExclusiveScan => {
            let inclusive = collective == CollectiveOperation::InclusiveScan;
            let mut sum = identity(scalar, function);
            let scan = words.iter().map(|word| {
                let before = sum;
                sum = both(sum, *word);
                if inclusive { sum } else { before }
            });
            scan.collect()
        }
    }
}

/// The result of a sum (0) or a product (1) of no lanes, which is the first lane's result in an exclusive scan.
fn identity(scalar: Scalar, function: SubgroupOperation) -> u32 {
    match (function, scalar.file()) {
        (SubgroupOperation::Mul, File::Float) => 1.0_f32.to_bits(),
        (SubgroupOperation::Mul, _) => 1,
        _ => 0,
    }
}

fn combined(scalar: Scalar, function: SubgroupOperation, a: u32, b: u32) -> u32 {
    if scalar.file() == File::Float {
        let [a, b] = [a, b].map(f32::from_bits);
        let both = match function {
            SubgroupOperation::Mul => a * b,
            SubgroupOperation::Min => a.min(b),
            SubgroupOperation::Max => a.max(b),
            _ => a + b,
        };
        let both = if scalar == Scalar::F16 { half::f16::from_f32(both).to_f32() } else { both };
        return both.to_bits();
    }
    let less = if scalar.signed() { a.cast_signed() < b.cast_signed() } else { a < b };
    match function {
        SubgroupOperation::Add => a.wrapping_add(b),
        SubgroupOperation::Mul => a.wrapping_mul(b),
        SubgroupOperation::Min => {
            if less {
                a
            } else {
                b
            }
        }
        SubgroupOperation::Max => {
            if less {
                b
            } else {
                a
            }
        }
        SubgroupOperation::And | SubgroupOperation::All => a & b,
        SubgroupOperation::Or | SubgroupOperation::Any => a | b,
        SubgroupOperation::Xor => a ^ b,
    }
}
