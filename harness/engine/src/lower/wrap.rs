//! Finds integers that may wrap around at 32 bits: differences that are converted to floats, and indices that are
//! computed from sums and products.

use super::memory::Index;
use super::{Lower, Lowered};
use crate::code::{Op, Reg, Term, Wrap};
use crate::rules::Integer;

/// The number of terms after which the engine stops tracing how an index was computed. The engine assumes that the
/// remaining operands haven't wrapped around.
const MOST_TERMS: usize = 64;

/// The largest odd constant by which an index may be multiplied. A multiplication by a larger odd constant counts as a
/// hash, for which wrapping around is correct.
const MOST_ODD: u32 = 1 << 16;

/// An operation that may wrap around, and its operands.
#[derive(Clone, Copy, Debug)]
pub(super) struct Computed {
    rule: Integer,
    ins: [Reg; 2],
}

impl<'m> Lower<'m> {
    pub(super) fn note_computed(&mut self, rule: Integer, out: Reg, ins: &[Reg]) {
        use Integer as I;
        let ins = match (rule, ins) {
            (I::NegateI | I::ToI | I::ToU, [x]) => [*x, *x],
            (I::AddI | I::AddU | I::SubtractI | I::SubtractU, [x, y]) => [*x, *y],
            (I::MultiplyI | I::MultiplyU, [x, y]) => {
                let is_hash = |register: &Reg| {
                    let word = self.words.get(register).map(|constant| constant.word);
                    word.is_some_and(|word| word & 1 == 1 && word > MOST_ODD)
                };
                if is_hash(x) || is_hash(y) {
                    return;
                }
                [*x, *y]
            }
            // A shift by a constant counts as a product. Other shifts aren't checked: they move bits.
            (I::ShiftLeftI | I::ShiftLeftU, [x, y]) if self.words.contains_key(y) => [*x, *y],
            _ => return,
        };
        self.computed.insert(out, Computed { rule, ins });
    }

    /// If an index may wrap around, appends the operation that reports it.
    pub(super) fn tell_wrapped(&mut self, buffer: Option<u32>, index: &Index) -> Lowered<()> {
        let mut terms = Vec::new();
        let mut ins = vec![index.register];
        self.terms(index.register, &mut terms, &mut ins);
        if terms.len() < 2 {
            return Ok(());
        }
        let step = Some(index.step());
        self.code.wraps.push(Wrap { buffer, step, terms });
        self.emit(Op::Wrap(self.code.wraps.len() as u32 - 1), &[], &ins)?;
        Ok(())
    }

    /// Appends the operation that reports an unsigned difference that wraps around, such as `f32(a - b)` with `a < b`.
    pub(super) fn tell_below(&mut self, register: Reg) -> Lowered<()> {
        let (mut terms, mut ins) = (Vec::new(), vec![register]);
        self.terms(register, &mut terms, &mut ins);
        if terms.iter().any(|term| matches!(term, Term::Subtract)) {
            self.code.wraps.push(Wrap { buffer: None, step: None, terms });
            self.emit(Op::Wrap(self.code.wraps.len() as u32 - 1), &[], &ins)?;
        }
        Ok(())
    }

    /// Appends to `terms` the terms that compute a register, operands before their operation. Appends to `ins` the
    /// register of each [`Term::Register`].
    fn terms(&self, register: Reg, terms: &mut Vec<Term>, ins: &mut Vec<Reg>) {
        use Integer as I;
        let computed = self.computed.get(&register).filter(|_| terms.len() < MOST_TERMS);
        let Some(Computed { rule, ins: [x, y] }) = computed.copied() else {
            terms.push(Term::Register);
            ins.push(register);
            return;
        };
        self.terms(x, terms, ins);
        let term = match rule {
            // A conversion between `i32` and `u32` keeps the number, if both types have this number.
            I::ToI | I::ToU => return,
            I::NegateI => Term::Negate,
            I::AddI | I::AddU => Term::Add,
            I::SubtractI | I::SubtractU => Term::Subtract,
            I::MultiplyI | I::MultiplyU => Term::Multiply,
            _ => Term::ShiftLeft,
        };
        if !matches!(term, Term::Negate) {
            self.terms(y, terms, ins);
        }
        terms.push(term);
    }
}
