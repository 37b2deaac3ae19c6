//! Indices that are computed of sums and products, which wrap around at 32 bits.

use super::memory::Index;
use super::{Lower, Lowered};
use crate::code::{Op, Reg, Term, Wrap};
use crate::rules::Integer;

/// Terms that an index is looked at by, at most; of a longer one, parts are taken as they are.
const MOST_TERMS: usize = 64;

/// What an integer register was computed of, where the result may wrap.
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
            (
                I::AddI | I::AddU | I::SubtractI | I::SubtractU | I::MultiplyI | I::MultiplyU,
                [x, y],
            ) => [*x, *y],
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
        self.terms(index.register, index.signed, &mut terms, &mut ins);
        if terms.len() < 2 {
            return Ok(());
        }
        let step = index.step();
        self.code.wraps.push(Wrap { buffer, step, terms });
        self.emit(Op::Wrap(self.code.wraps.len() as u32 - 1), &[], &ins)?;
        Ok(())
    }

    /// Appends the terms of a register, operands first, and the registers that they begin with.
    fn terms(&self, register: Reg, signed: bool, terms: &mut Vec<Term>, ins: &mut Vec<Reg>) {
        use Integer as I;
        let of = |register: &Reg| self.computed.get(register).copied();
        // The bits of another type are what they are, unless they were computed.
        let is_known = |one: &Computed| match one.rule {
            I::ToI | I::ToU => of(&one.ins[0]).is_some(),
            _ => true,
        };
        let computed = of(&register).filter(|_| terms.len() < MOST_TERMS).filter(is_known);
        let Some(Computed { rule, ins: [x, y] }) = computed else {
            terms.push(Term::Register { signed });
            ins.push(register);
            return;
        };
        let (is_signed, term) = match rule {
            I::ToI => return self.terms(x, false, terms, ins),
            I::ToU => return self.terms(x, true, terms, ins),
            I::NegateI => (true, Term::Negate),
            I::AddI | I::AddU => (rule == I::AddI, Term::Add),
            I::SubtractI | I::SubtractU => (rule == I::SubtractI, Term::Subtract),
            I::MultiplyI | I::MultiplyU => (rule == I::MultiplyI, Term::Multiply),
            _ => (rule == I::ShiftLeftI, Term::ShiftLeft),
        };
        self.terms(x, is_signed, terms, ins);
        match term {
            Term::Negate => {}
            // A distance is unsigned.
            Term::ShiftLeft => self.terms(y, false, terms, ins),
            _ => self.terms(y, is_signed, terms, ins),
        }
        terms.push(term);
    }
}
