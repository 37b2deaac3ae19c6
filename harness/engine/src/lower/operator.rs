//! Lowers operators, selections and conversions.

use std::rc::Rc;

use naga::{
    BinaryOperator, Expression, Handle, RelationalFunction, ScalarKind, TypeInner, UnaryOperator,
};

use super::{Lower, Lowered, Scope, Value};
use crate::code::{Compare, Op, Reg};
use crate::rules::{Basic, FloatRule, FromInt, Geometry, Half, Integer, ToInt};
use crate::scalar::{File, Scalar};

impl<'m> Lower<'m> {
    /// Appends an operation with one result, which `rule` computes. If `half` is set, the result is rounded to half
    /// precision.
    pub(super) fn float_op(&mut self, rule: FloatRule, ins: &[Reg], half: bool) -> Lowered<Reg> {
        Ok(self.float_ops(rule, ins, half)?[0])
    }

    pub(super) fn float_ops(
        &mut self,
        rule: FloatRule,
        ins: &[Reg],
        half: bool,
    ) -> Lowered<Vec<Reg>> {
        let outs: Vec<Reg> = (0..rule.arity().1).map(|_| self.fresh(File::Float)).collect();
        // The operands were rounded to half precision. The rule must know this if the operands become terms of a sum.
        let mut ins = ins.to_vec();
        if half && !rule.is_one_of_a_chain() {
            let addend = (rule == FloatRule::Basic(Basic::Fma)).then_some(2);
            for k in (0..ins.len()).filter(|k| addend != Some(*k)) {
                ins[k] = self.halved(ins[k], Some(Half::Operand))?;
            }
        }
        self.emit(Op::Float(rule), &outs, &ins)?;
        if half && rule.half().is_none() {
            self.code.half.get_or_insert(self.span);
        }
        let as_exact = rule.half().unwrap_or(Half::Rounded);
        outs.into_iter().map(|out| self.halved(out, half.then_some(as_exact))).collect()
    }

    pub(super) fn rounded(&mut self, register: Reg, half: bool) -> Lowered<Reg> {
        self.halved(register, half.then_some(Half::Rounded))
    }

    fn halved(&mut self, register: Reg, half: Option<Half>) -> Lowered<Reg> {
        let Some(half) = half else { return Ok(register) };
        self.code.sites[self.site as usize].half |= half != Half::Operand;
        let out = self.fresh(File::Float);
        self.emit(Op::ToHalf(half), &[out], &[register])?;
        Ok(out)
    }

    pub(super) fn basic(&mut self, rule: Basic, ins: &[Reg], half: bool) -> Lowered<Reg> {
        self.float_op(FloatRule::Basic(rule), ins, half)
    }

    pub(super) fn integer(&mut self, rule: Integer, ins: &[Reg]) -> Lowered<Reg> {
        let out = self.fresh(File::Int);
        self.emit(Op::Integer(rule), &[out], ins)?;
        self.note_computed(rule, out, ins);
        Ok(out)
    }

    pub(super) fn boolean(&mut self, op: Op, ins: &[Reg]) -> Lowered<Reg> {
        let out = self.fresh(File::Bool);
        self.emit(op, &[out], ins)?;
        Ok(out)
    }

    pub(super) fn select(&mut self, condition: Reg, yes: Reg, no: Reg) -> Lowered<Reg> {
        let out = self.fresh(yes.file);
        self.emit(Op::Select(yes.file), &[out], &[yes, no, condition])?;
        Ok(out)
    }

    pub(super) fn scalar_of(&self, inner: &TypeInner) -> Lowered<Scalar> {
        match *inner {
            TypeInner::Scalar(scalar)
            | TypeInner::Vector { scalar, .. }
            | TypeInner::Matrix { scalar, .. } => self.scalar(scalar),
            ref other => Err(self
                .refuse(format!("an operator on a value of type {}", crate::scalar::kind(other)))),
        }
    }

    pub(super) fn unary(
        &mut self,
        scope: &mut Scope<'m>,
        op: UnaryOperator,
        operand: Handle<Expression>,
    ) -> Lowered<Value> {
        let scalar = self.scalar_of(&self.type_of(scope, operand))?;
        let registers = self.flat(scope, operand)?;
        let mut values = Vec::new();
        for &register in registers.iter() {
            values.push(match (op, scalar) {
                (UnaryOperator::Negate, Scalar::F32 | Scalar::F16) => {
                    self.basic(Basic::Negate, &[register], false)?
                }
                (UnaryOperator::Negate, Scalar::I32) => {
                    self.integer(Integer::NegateI, &[register])?
                }
                (UnaryOperator::LogicalNot, Scalar::Bool) => self.boolean(Op::Not, &[register])?,
                (UnaryOperator::BitwiseNot, Scalar::I32) => {
                    self.integer(Integer::NotI, &[register])?
                }
                (UnaryOperator::BitwiseNot, Scalar::U32) => {
                    self.integer(Integer::NotU, &[register])?
                }
                _ => return Err(self.refuse(format!("the operator {op:?} on {scalar:?}"))),
            });
        }
        Ok(Value::Flat(values.into()))
    }

    pub(super) fn binary(
        &mut self,
        scope: &mut Scope<'m>,
        op: BinaryOperator,
        left: Handle<Expression>,
        right: Handle<Expression>,
    ) -> Lowered<Value> {
        let (site, span) = (self.site, self.span);
        let left_type = self.type_of(scope, left);
        let right_type = self.type_of(scope, right);
        let x = self.flat(scope, left)?;
        let y = self.flat(scope, right)?;
        (self.site, self.span) = (site, span);
        let scalar = self.scalar_of(&left_type)?;
        if op == BinaryOperator::Multiply
            && let Some(product) = self.matrix_product(&left_type, &right_type, &x, &y, scalar)?
        {
            return Ok(Value::Flat(product.into()));
        }
        let fused = self.fused(scope, op, left, right, scalar)?;
        let count = x.len().max(y.len());
        let pick = |of: &Rc<[Reg]>, k: usize| of[if of.len() == 1 { 0 } else { k }];
        let mut values = Vec::new();
        for k in 0..count {
            let (a, b) = (pick(&x, k), pick(&y, k));
            values.push(match &fused {
                Some(Fused { factors: [p, q], negate, rest, negate_rest }) => {
                    let mut p = pick(p, k);
                    let mut rest = pick(rest, k);
                    if *negate {
                        p = self.basic(Basic::Negate, &[p], false)?;
                    }
                    if *negate_rest {
                        rest = self.basic(Basic::Negate, &[rest], false)?;
                    }
                    self.basic(Basic::Fma, &[p, pick(q, k), rest], false)?
                }
                None => self.binary_scalar(op, scalar, a, b)?,
            });
        }
        Ok(Value::Flat(values.into()))
    }

    /// If an identity applies to an operation, returns a register with the same result: an operand, or the result of
    /// another operation. Each identity also holds for NaN, infinities and both zeros. The exact results are equal, so
    /// the rounded results are equal, too.
    fn identical(&mut self, op: BinaryOperator, a: Reg, b: Reg) -> Lowered<Option<Reg>> {
        use BinaryOperator as B;
        let value = |of: &Self, register: Reg| {
            let constant = of.words.get(&register)?;
            (constant.scalar == Scalar::F32).then(|| f32::from_bits(constant.word))
        };
        let (x, y) = match (op, value(self, a), value(self, b)) {
            // The order of the operands of a sum or a product doesn't matter, so constants come last.
            (B::Multiply | B::Add, Some(_), None) => {
                return self.binary_scalar(op, Scalar::F32, b, a).map(Some);
            }
            (_, None, Some(y)) => (a, y),
            (B::Multiply | B::Add, None, None) if b < a => {
                return self.binary_scalar(op, Scalar::F32, b, a).map(Some);
            }
            _ => return Ok(None),
        };
        Ok(match op {
            // -0 - 0 is -0, but -0 + 0 is 0. So the subtraction of 0 can be left out, but not the addition.
            B::Multiply | B::Divide if y == 1.0 => Some(x),
            B::Subtract if y.to_bits() == 0 => Some(x),
            B::Multiply if y == 2.0 => Some(self.basic(Basic::Add, &[x, x], false)?),
            // The inverse of a power of two is exact if the inverse is a normal number.
            B::Divide if y.to_bits() << 9 == 0 && y.is_normal() && y.recip().is_normal() => {
                let inverse = self.constant(Scalar::F32, y.recip().to_bits());
                Some(self.binary_scalar(B::Multiply, Scalar::F32, x, inverse)?)
            }
            _ => None,
        })
    }

    fn binary_scalar(
        &mut self,
        op: BinaryOperator,
        scalar: Scalar,
        a: Reg,
        b: Reg,
    ) -> Lowered<Reg> {
        use BinaryOperator as B;
        if self.settings.identities
            && scalar == Scalar::F32
            && let Some(same) = self.identical(op, a, b)?
        {
            return Ok(same);
        }
        let half = scalar == Scalar::F16;
        let order = |op: B| match op {
            B::Equal => Some((Compare::Equal, false)),
            B::NotEqual => Some((Compare::NotEqual, false)),
            B::Less => Some((Compare::Less, false)),
            B::LessEqual => Some((Compare::LessEqual, false)),
            B::Greater => Some((Compare::Less, true)),
            B::GreaterEqual => Some((Compare::LessEqual, true)),
            _ => None,
        };
        if let (Some((compare, exchanged)), true) = (order(op), scalar != Scalar::Bool) {
            let ins = if exchanged { [b, a] } else { [a, b] };
            let op = match scalar.file() {
                File::Float => Op::CompareFloat(compare),
                _ => Op::CompareInt(compare, scalar.signed()),
            };
            return self.boolean(op, &ins);
        }
        match (op, scalar) {
            (B::Multiply, Scalar::F32 | Scalar::F16) if a == b => {
                self.basic(Basic::Square, &[a], half)
            }
            (_, Scalar::F32 | Scalar::F16) => {
                let rule = match op {
                    B::Add => Basic::Add,
                    B::Subtract => Basic::Subtract,
                    B::Multiply => Basic::Multiply,
                    B::Divide => Basic::Divide,
                    B::Modulo => Basic::Remainder,
                    _ => return Err(self.refuse(format!("the operator {op:?} on floats"))),
                };
                self.basic(rule, &[a, b], half)
            }
            (_, Scalar::I32 | Scalar::U32) => {
                let (signed, unsigned) = match op {
                    B::Add => (Integer::AddI, Integer::AddU),
                    B::Subtract => (Integer::SubtractI, Integer::SubtractU),
                    B::Multiply => (Integer::MultiplyI, Integer::MultiplyU),
                    B::Divide => (Integer::DivideI, Integer::DivideU),
                    B::Modulo => (Integer::RemainderI, Integer::RemainderU),
                    B::And => (Integer::AndI, Integer::AndU),
                    B::ExclusiveOr => (Integer::XorI, Integer::XorU),
                    B::InclusiveOr => (Integer::OrI, Integer::OrU),
                    B::ShiftLeft => (Integer::ShiftLeftI, Integer::ShiftLeftU),
                    B::ShiftRight => (Integer::ShiftRightI, Integer::ShiftRightU),
                    _ => return Err(self.refuse(format!("the operator {op:?} on integers"))),
                };
                self.integer(if scalar.signed() { signed } else { unsigned }, &[a, b])
            }
            (B::And | B::LogicalAnd, Scalar::Bool) => self.boolean(Op::And, &[a, b]),
            (B::InclusiveOr | B::LogicalOr, Scalar::Bool) => self.boolean(Op::Or, &[a, b]),
            (B::NotEqual | B::ExclusiveOr, Scalar::Bool) => self.boolean(Op::Differ, &[a, b]),
            (B::Equal, Scalar::Bool) => {
                let differ = self.boolean(Op::Differ, &[a, b])?;
                self.boolean(Op::Not, &[differ])
            }
            _ => Err(self.refuse(format!("the operator {op:?} on booleans"))),
        }
    }

    /// If the operation is a sum with a product as a term, and `Settings::contract` is set, returns the terms.
    fn fused(
        &mut self,
        scope: &mut Scope<'m>,
        op: BinaryOperator,
        left: Handle<Expression>,
        right: Handle<Expression>,
        scalar: Scalar,
    ) -> Lowered<Option<Fused>> {
        let subtract = op == BinaryOperator::Subtract;
        if !self.settings.contract
            || scalar != Scalar::F32
            || !(subtract || op == BinaryOperator::Add)
        {
            return Ok(None);
        }
        for (product, rest, is_right) in [(left, right, false), (right, left, true)] {
            let Expression::Binary { op: BinaryOperator::Multiply, left: p, right: q } =
                scope.expressions[product]
            else {
                continue;
            };
            // Products of matrices are already sums.
            let matrix = |lower: &Self, scope: &Scope<'m>, handle| {
                matches!(lower.type_of(scope, handle), TypeInner::Matrix { .. })
            };
            if matrix(self, scope, p) || matrix(self, scope, q) {
                continue;
            }
            let factors = [self.flat(scope, p)?, self.flat(scope, q)?];
            let rest = self.flat(scope, rest)?;
            return Ok(Some(Fused {
                factors,
                negate: subtract && is_right,
                rest,
                negate_rest: subtract && !is_right,
            }));
        }
        Ok(None)
    }

    fn matrix_product(
        &mut self,
        left: &TypeInner,
        right: &TypeInner,
        x: &[Reg],
        y: &[Reg],
        scalar: Scalar,
    ) -> Lowered<Option<Vec<Reg>>> {
        let half = scalar == Scalar::F16;
        let row = |m: &[Reg], row: usize, rows: usize| -> Vec<Reg> {
            m.iter().skip(row).step_by(rows).copied().collect()
        };
        let mut values = Vec::new();
        match (left, right) {
            (TypeInner::Matrix { rows, .. }, TypeInner::Vector { .. }) => {
                for k in 0..*rows as usize {
                    values.push(self.dot(&row(x, k, *rows as usize), y, half)?);
                }
            }
            (TypeInner::Vector { .. }, TypeInner::Matrix { rows, .. }) => {
                for column in y.chunks(*rows as usize) {
                    values.push(self.dot(x, column, half)?);
                }
            }
            (TypeInner::Matrix { rows, .. }, TypeInner::Matrix { rows: inner, .. }) => {
                for column in y.chunks(*inner as usize) {
                    for k in 0..*rows as usize {
                        values.push(self.dot(&row(x, k, *rows as usize), column, half)?);
                    }
                }
            }
            _ => return Ok(None),
        }
        Ok(Some(values))
    }

    pub(super) fn dot(&mut self, x: &[Reg], y: &[Reg], half: bool) -> Lowered<Reg> {
        let rule = match x.len() {
            1 => return self.basic(Basic::Multiply, &[x[0], y[0]], half),
            2 => Geometry::Dot2,
            3 => Geometry::Dot3,
            4 => Geometry::Dot4,
            n => return Err(self.refuse(format!("a vector of {n} components"))),
        };
        self.float_op(FloatRule::Geometry(rule), &[x, y].concat(), half)
    }

    pub(super) fn relational(
        &mut self,
        scope: &mut Scope<'m>,
        function: RelationalFunction,
        argument: Handle<Expression>,
    ) -> Lowered<Value> {
        let registers = self.flat(scope, argument)?;
        let mut values = Vec::new();
        match function {
            RelationalFunction::All | RelationalFunction::Any => {
                let op = if function == RelationalFunction::All { Op::And } else { Op::Or };
                let mut all = registers[0];
                for &next in &registers[1..] {
                    all = self.boolean(op, &[all, next])?;
                }
                values.push(all);
            }
            RelationalFunction::IsNan | RelationalFunction::IsInf => {
                let op = if function == RelationalFunction::IsNan { Op::IsNan } else { Op::IsInf };
                for &register in registers.iter() {
                    values.push(self.boolean(op, &[register])?);
                }
            }
        }
        Ok(Value::Flat(values.into()))
    }

    pub(super) fn convert(
        &mut self,
        scope: &mut Scope<'m>,
        handle: Handle<Expression>,
        operand: Handle<Expression>,
        kind: ScalarKind,
        convert: Option<u8>,
    ) -> Lowered<Value> {
        let from = self.scalar_of(&self.type_of(scope, operand))?;
        let result = self.type_of(scope, handle);
        let to = self.scalar_of(&result)?;
        let registers = self.flat(scope, operand)?;
        if convert.is_none() && (from == Scalar::F16 || to == Scalar::F16) && from != to {
            return Err(self.refuse("a bitcast between `f16` and another type"));
        }
        let mut values = Vec::new();
        for &register in registers.iter() {
            values.push(match convert {
                Some(_) => self.convert_scalar(register, from, to)?,
                None => self.bitcast(register, from, to, kind)?,
            });
        }
        Ok(Value::Flat(values.into()))
    }

    fn convert_scalar(&mut self, x: Reg, from: Scalar, to: Scalar) -> Lowered<Reg> {
        let half = to == Scalar::F16;
        Ok(match (from, to) {
            (Scalar::F32, Scalar::F16) => self.halved(x, Some(Half::Converted))?,
            // A sum that uses the result starts a new chain, with terms of single precision.
            (Scalar::F16, Scalar::F32) => self.halved(x, Some(Half::Operand))?,
            (Scalar::F32 | Scalar::F16, Scalar::F32 | Scalar::F16) => x,
            (Scalar::F32 | Scalar::F16, Scalar::I32) => self.integer_of(ToInt::Signed, &[x])?,
            (Scalar::F32 | Scalar::F16, Scalar::U32) => self.integer_of(ToInt::Unsigned, &[x])?,
            (Scalar::F32 | Scalar::F16, Scalar::Bool) => {
                let zero = self.float(0.0);
                self.boolean(Op::CompareFloat(Compare::NotEqual), &[x, zero])?
            }
            (Scalar::I32, Scalar::F32 | Scalar::F16) => {
                let float = self.floats_of(FromInt::Signed, x)?[0];
                self.rounded(float, half)?
            }
            (Scalar::U32, Scalar::F32 | Scalar::F16) => {
                self.tell_below(x)?;
                let float = self.floats_of(FromInt::Unsigned, x)?[0];
                self.rounded(float, half)?
            }
            (Scalar::I32, Scalar::U32) => self.integer(Integer::ToU, &[x])?,
            (Scalar::U32, Scalar::I32) => self.integer(Integer::ToI, &[x])?,
            (Scalar::I32 | Scalar::U32, Scalar::Bool) => {
                let zero = self.constant(from, 0);
                self.boolean(Op::CompareInt(Compare::NotEqual, from.signed()), &[x, zero])?
            }
            (Scalar::Bool, Scalar::F32 | Scalar::F16) => {
                let (one, zero) = (self.float(1.0), self.float(0.0));
                self.select(x, one, zero)?
            }
            (Scalar::Bool, Scalar::I32 | Scalar::U32) => {
                let (one, zero) = (self.constant(to, 1), self.constant(to, 0));
                self.select(x, one, zero)?
            }
            (Scalar::I32, Scalar::I32)
            | (Scalar::U32, Scalar::U32)
            | (Scalar::Bool, Scalar::Bool) => x,
        })
    }

    fn bitcast(&mut self, x: Reg, from: Scalar, to: Scalar, kind: ScalarKind) -> Lowered<Reg> {
        Ok(match (from, to) {
            (Scalar::F32, Scalar::I32) => self.integer_of(ToInt::BitsSigned, &[x])?,
            (Scalar::F32, Scalar::U32) => self.integer_of(ToInt::BitsUnsigned, &[x])?,
            (Scalar::I32 | Scalar::U32, Scalar::F32) => self.floats_of(FromInt::Bits, x)?[0],
            (Scalar::I32, Scalar::U32) => self.integer(Integer::ToU, &[x])?,
            (Scalar::U32, Scalar::I32) => self.integer(Integer::ToI, &[x])?,
            _ if from == to => x,
            _ => return Err(self.refuse(format!("a bitcast of {from:?} to {kind:?}"))),
        })
    }

    pub(super) fn integer_of(&mut self, rule: ToInt, ins: &[Reg]) -> Lowered<Reg> {
        let out = self.fresh(File::Int);
        self.emit(Op::ToInt(rule), &[out], ins)?;
        Ok(out)
    }

    pub(super) fn floats_of(&mut self, rule: FromInt, x: Reg) -> Lowered<Vec<Reg>> {
        let outs: Vec<Reg> = (0..rule.arity()).map(|_| self.fresh(File::Float)).collect();
        self.emit(Op::FromInt(rule), &outs, &[x])?;
        Ok(outs)
    }
}

/// The terms of a fused multiply-add `p * q + rest`, with the signs of both terms.
struct Fused {
    factors: [Rc<[Reg]>; 2],
    negate: bool,
    rest: Rc<[Reg]>,
    negate_rest: bool,
}
