//! Comparisons, selections and stores, which work lane by lane.

use super::Machine;
use crate::arithmetic::sealed::Rules;
use crate::code::Compare;
use crate::scalar::File;

impl<A: Rules> Machine<'_, A> {
    pub(super) fn compare_floats(&mut self, compare: Compare, registers: &[u32]) {
        let [out, a, b] = [registers[0], registers[1], registers[2]];
        let (a, b) = (self.floats.get(a), self.floats.get(b));
        let out = self.bools.get_mut(out);
        match compare {
            Compare::Equal => zip(out, a, b, A::float_equal),
            Compare::NotEqual => zip(out, a, b, |a, b| A::not(A::float_equal(a, b))),
            Compare::Less => zip(out, a, b, A::float_less),
            Compare::LessEqual => zip(out, a, b, A::float_less_equal),
        }
    }

    pub(super) fn compare_ints(&mut self, compare: Compare, signed: bool, registers: &[u32]) {
        let [out, a, b] = [registers[0], registers[1], registers[2]];
        let (a, b) = (self.ints.get(a), self.ints.get(b));
        let out = self.bools.get_mut(out);
        match (compare, signed) {
            (Compare::Equal, _) => zip(out, a, b, A::int_equal),
            (Compare::NotEqual, _) => zip(out, a, b, |a, b| A::not(A::int_equal(a, b))),
            (Compare::Less, true) => zip(out, a, b, |a, b| A::int_less(a, b, true)),
            (Compare::Less, false) => zip(out, a, b, |a, b| A::int_less(a, b, false)),
            (Compare::LessEqual, true) => zip(out, a, b, |a, b| A::not(A::int_less(b, a, true))),
            (Compare::LessEqual, false) => zip(out, a, b, |a, b| A::not(A::int_less(b, a, false))),
        }
    }

    pub(super) fn select(&mut self, file: File, registers: &[u32]) {
        let [out, yes, no, condition] = [registers[0], registers[1], registers[2], registers[3]];
        let condition = self.bools.get(condition);
        match file {
            File::Float => self.floats.write(out, |floats, out| {
                blend(out, condition, floats.get(yes), floats.get(no), A::select_float);
            }),
            File::Int => self.ints.write(out, |ints, out| {
                blend(out, condition, ints.get(yes), ints.get(no), A::select_int);
            }),
            File::Bool => {
                self.bools.map::<3, 1>(registers, |[yes, no, c]| [A::select_bool(c, yes, no)])
            }
        }
    }

    pub(super) fn store(&mut self, file: File, registers: &[u32]) {
        let [to, from] = [registers[0], registers[1]];
        let all = if A::UNDECIDED { self.worlds.all() } else { self.masks.all() };
        let mask = if A::UNDECIDED { self.worlds.active() } else { self.masks.active() };
        match file {
            File::Float if all => self.floats.copy(to, from),
            File::Int if all => self.ints.copy(to, from),
            File::Bool if all => self.bools.copy(to, from),
            File::Float => self.floats.write(to, |floats, out| {
                blend(out, mask, floats.get(from), floats.get(to), A::select_float);
            }),
            File::Int => self.ints.write(to, |ints, out| {
                blend(out, mask, ints.get(from), ints.get(to), A::select_int);
            }),
            File::Bool => self.bools.write(to, |bools, out| {
                blend(out, mask, bools.get(from), bools.get(to), A::select_bool);
            }),
        }
    }
}

#[inline(always)]
fn zip<T: Copy, B>(out: &mut [B], a: &[T], b: &[T], f: impl Fn(T, T) -> B) {
    for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
        *out = f(a, b);
    }
}

#[inline(always)]
fn blend<T: Copy, B: Copy>(
    out: &mut [T],
    condition: &[B],
    yes: &[T],
    no: &[T],
    select: impl Fn(B, T, T) -> T,
) {
    for (((out, &c), &yes), &no) in out.iter_mut().zip(condition).zip(yes).zip(no) {
        *out = select(c, yes, no);
    }
}
