//! Indices that are computed of sums and products, and differences that become floats: they wrap around at 32 bits.

use super::memory::Index;
use super::{Lower, Lowered};
use crate::code::{Op, Reg, Term, Wrap};
use crate::rules::Integer;

/// Terms that an index is looked at by, at most; of a longer one, parts are taken as they are.
const MOST_TERMS: usize = 64;

/// The greatest stride that is odd: by a larger odd number a hash multiplies, which is meant to wrap.
const MOST_ODD: u32 = 1 << 16;

/// The operation and the registers that an integer register is computed of, if its result may wrap.
#[derive(Clone, Copy, Debug)]
pub(super) struct Computed {
    rule: Integer,
    ins: [Reg; 2],
}

impl<'m> Lower<'m> {
    /// Notes how a register is computed, if its result may wrap.
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
            // By a constant it is a product. By another distance it moves bits.
            (I::ShiftLeftI | I::ShiftLeftU, [x, y]) if self.words.contains_key(y) => [*x, *y],
            _ => return,
        };
        self.computed.insert(out, Computed { rule, ins });
    }

    /// Appends the operation that tells where an index has wrapped, if it may.
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

    /// Appends the operation that tells where a difference without a sign goes below 0 and becomes a float.
    pub(super) fn tell_below(&mut self, register: Reg) -> Lowered<()> {
        let (mut terms, mut ins) = (Vec::new(), vec![register]);
        self.terms(register, &mut terms, &mut ins);
        if terms.iter().any(|term| matches!(term, Term::Subtract)) {
            self.code.wraps.push(Wrap { buffer: None, step: None, terms });
            self.emit(Op::Wrap(self.code.wraps.len() as u32 - 1), &[], &ins)?;
        }
        Ok(())
    }

    /// Appends the terms of a register, operands first, and the registers that they begin with.
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
            // The same number, if it is one of both types.
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
