//! Reports integers that wrap around.

use super::{Machine, Memory};
use crate::arithmetic::sealed::Rules;
use crate::code::Term;

impl<A: Rules> Machine<'_, A> {
    /// Notes the lanes whose index has wrapped around and is still inside of the array. The access itself reports an
    /// index outside of the array. For a difference that is converted to a float, notes the lanes in which the exact
    /// difference is below 0.
    pub(super) fn wrapped(&mut self, wrap: u32, registers: &[u32], memory: &Memory<'_, A>) {
        // In intervals, an index that wraps may have any value, so it may be outside.
        if A::UNDECIDED {
            return;
        }
        let wrap = &self.code.wraps[wrap as usize];
        let bytes = wrap.buffer.map_or(0, |slot| memory.buffers[slot as usize].bytes.len());
        let length = wrap.step.as_ref().map(|step| step.length(bytes));
        let signed = wrap.step.as_ref().is_some_and(|step| step.signed);
        let mut stack: Vec<i128> = Vec::new();
        for lane in 0..self.width {
            if !self.acts(lane) {
                continue;
            }
            let value = |register: u32, signed: bool| {
                i128::from(A::bounds(self.ints.get(register)[lane], signed).0)
            };
            let index = value(registers[0], signed);
            if length.is_some_and(|length| index < 0 || index >= i128::from(length)) {
                continue;
            }
            // A term may be `u32(-1)`, or a hash above 2^31. The type doesn't tell which, so both readings are tried.
            let meant = [true, false].map(|signed| {
                let leaves = registers[1..].iter().map(|register| value(*register, signed));
                whole(&wrap.terms, leaves, &mut stack)
            });
            let is_wrong = match length {
                Some(_) => !meant.contains(&index),
                None => meant.iter().all(|meant| *meant < 0),
            };
            if is_wrong {
                if self.strayed.is_empty() {
                    self.meant = meant[1].clamp(i64::MIN.into(), i64::MAX.into()) as i64;
                }
                self.strayed.push(lane);
            }
        }
    }
}

fn whole(terms: &[Term], mut leaves: impl Iterator<Item = i128>, stack: &mut Vec<i128>) -> i128 {
    stack.clear();
    for term in terms {
        let mut next = || stack.pop().unwrap_or_default();
        let whole = match term {
            Term::Register => leaves.next().unwrap_or_default(),
            Term::Negate => next().saturating_neg(),
            Term::Add => next().saturating_add(next()),
            Term::Subtract => {
                let y = next();
                next().saturating_sub(y)
            }
            Term::Multiply => next().saturating_mul(next()),
            // Only the lowest five bits of the shift count.
            Term::ShiftLeft => {
                let distance = next() & 31;
                next().saturating_mul(1 << distance)
            }
        };
        stack.push(whole);
    }
    stack.pop().unwrap_or_default()
}
