//! Lowers builtin functions.

use std::rc::Rc;

use naga::{Expression, Handle, MathFunction, TypeInner};

use super::{Lower, Lowered, Scope, Value};
use crate::code::{Compare, Op, Reg};
use crate::rules::{Basic, FloatRule, FromInt, Geometry, Integer, Rounding, Scale, ToInt};
use crate::scalar::{File, Scalar};

impl<'m> Lower<'m> {
    pub(super) fn math(
        &mut self,
        scope: &mut Scope<'m>,
        handle: Handle<Expression>,
        function: MathFunction,
        arguments: [Option<Handle<Expression>>; 4],
    ) -> Lowered<Value> {
        let (site, span) = (self.site, self.span);
        let mut args: Vec<Rc<[Reg]>> = Vec::new();
        for argument in arguments.into_iter().flatten() {
            args.push(self.flat(scope, argument)?);
        }
        let first = arguments[0].map(|first| self.type_of(scope, first));
        let Some(first) = first else { return Err(self.refuse("a builtin without arguments")) };
        (self.site, self.span) = (site, span);
        let result = self.type_of(scope, handle);
        let values = self.builtin(function, &first, &result, &args)?;
        Ok(Value::Flat(values.into()))
    }

    fn builtin(
        &mut self,
        function: MathFunction,
        first: &TypeInner,
        result: &TypeInner,
        args: &[Rc<[Reg]>],
    ) -> Lowered<Vec<Reg>> {
        use MathFunction as M;
        let scalar = self.scalar_of(first)?;
        let half = scalar == Scalar::F16;
        if function.argument_count() != args.len() {
            return Err(self.refuse(format!("{function:?} with {} arguments", args.len())));
        }
        if scalar.file() == File::Float
            && let Some(rule) = FloatRule::builtin(function)
        {
            return self.by_component(args, |lower, args| lower.float_op(rule, args, half));
        }
        if scalar.file() == File::Int {
            // The result of `dot4I8Packed` is signed, but its arguments aren't.
            let signed = self.scalar_of(result)?.signed();
            if let Some(rule) = Integer::builtin(function, signed) {
                return self.by_component(args, |lower, args| lower.integer(rule, args));
            }
        }
        let size = args[0].len();
        let geometry = |rules: [Geometry; 3]| match size {
            2..=4 => Some(FloatRule::Geometry(rules[size - 2])),
            _ => None,
        };
        let all = |args: &[Rc<[Reg]>]| -> Vec<Reg> {
            args.iter().flat_map(|arg| arg.iter().copied()).collect()
        };
        match function {
            M::Dot if scalar.file() == File::Int => self.integer_dot(scalar, &args[0], &args[1]),
            M::Dot => Ok(vec![self.dot(&args[0], &args[1], half)?]),
            M::Cross => self.float_ops(FloatRule::Geometry(Geometry::Cross), &all(args), half),
            M::Length => Ok(vec![self.length(&args[0], half)?]),
            M::Distance => {
                let difference = self
                    .by_component(args, |lower, args| lower.basic(Basic::Subtract, args, half))?;
                Ok(vec![self.length(&difference, half)?])
            }
            M::Normalize => {
                use Geometry as G;
                match geometry([G::Normalize2, G::Normalize3, G::Normalize4]) {
                    Some(rule) => self.float_ops(rule, &args[0], half),
                    None => Err(self.refuse("`normalize` of a scalar")),
                }
            }
            M::Reflect => {
                use Geometry as G;
                match geometry([G::Reflect2, G::Reflect3, G::Reflect4]) {
                    Some(rule) => self.float_ops(rule, &all(args), half),
                    None => Err(self.refuse("`reflect` of a scalar")),
                }
            }
            M::Refract => {
                use Geometry as G;
                match geometry([G::Refract2, G::Refract3, G::Refract4]) {
                    Some(rule) => self.float_ops(rule, &all(args), half),
                    None => Err(self.refuse("`refract` of a scalar")),
                }
            }
            M::FaceForward => {
                let dot = self.dot(&args[1], &args[2], half)?;
                let zero = self.float(0.0);
                let seen = self.boolean(Op::CompareFloat(Compare::Less), &[dot, zero])?;
                let mut values = Vec::new();
                for &x in args[0].iter() {
                    let back = self.basic(Basic::Negate, &[x], false)?;
                    values.push(self.select(seen, x, back)?);
                }
                Ok(values)
            }
            M::Modf => {
                let mut values = Vec::new();
                for rule in [Rounding::Fraction, Rounding::Trunc] {
                    for &x in args[0].iter() {
                        values.push(self.float_op(FloatRule::Rounding(rule), &[x], half)?);
                    }
                }
                Ok(values)
            }
            M::Frexp => {
                let mut values = Vec::new();
                for &x in args[0].iter() {
                    let rule = FloatRule::Rounding(Rounding::Mantissa);
                    values.push(self.float_op(rule, &[x], half)?);
                }
                for &x in args[0].iter() {
                    values.push(self.integer_of(ToInt::Exponent, &[x])?);
                }
                Ok(values)
            }
            M::Ldexp => self.by_component(args, |lower, args| {
                let out = lower.fresh(File::Float);
                lower.emit(Op::Scale(Scale::Ldexp), &[out], args)?;
                lower.rounded(out, half)
            }),
            M::Outer => {
                let mut values = Vec::new();
                for &y in args[1].iter() {
                    for &x in args[0].iter() {
                        values.push(self.basic(Basic::Multiply, &[x, y], half)?);
                    }
                }
                Ok(values)
            }
            M::Transpose => {
                let TypeInner::Matrix { rows, .. } = *first else {
                    return Err(self.refuse("`transpose` of a value that isn't a matrix"));
                };
                let rows = rows as usize;
                Ok((0..rows)
                    .flat_map(|row| args[0].iter().skip(row).step_by(rows).copied())
                    .collect())
            }
            M::Determinant => {
                let rule = match size {
                    4 => Geometry::Determinant2,
                    9 => Geometry::Determinant3,
                    16 => Geometry::Determinant4,
                    _ => {
                        return Err(
                            self.refuse("`determinant` of a value that isn't a square matrix")
                        );
                    }
                };
                self.float_ops(FloatRule::Geometry(rule), &args[0], half)
            }
            M::Pack4x8snorm => Ok(vec![self.integer_of(ToInt::Snorm8, &args[0])?]),
            M::Pack4x8unorm => Ok(vec![self.integer_of(ToInt::Unorm8, &args[0])?]),
            M::Pack2x16snorm => Ok(vec![self.integer_of(ToInt::Snorm16, &args[0])?]),
            M::Pack2x16unorm => Ok(vec![self.integer_of(ToInt::Unorm16, &args[0])?]),
            M::Pack2x16float => Ok(vec![self.integer_of(ToInt::Half2, &args[0])?]),
            M::Unpack4x8snorm => self.floats_of(FromInt::Snorm8, args[0][0]),
            M::Unpack4x8unorm => self.floats_of(FromInt::Unorm8, args[0][0]),
            M::Unpack2x16snorm => self.floats_of(FromInt::Snorm16, args[0][0]),
            M::Unpack2x16unorm => self.floats_of(FromInt::Unorm16, args[0][0]),
            M::Unpack2x16float => self.floats_of(FromInt::Half2, args[0][0]),
            M::Pack4xI8 | M::Pack4xU8 => Ok(vec![self.integer(Integer::PackBytes, &args[0])?]),
            M::Pack4xI8Clamp => Ok(vec![self.integer(Integer::PackBytesClampI, &args[0])?]),
            M::Pack4xU8Clamp => Ok(vec![self.integer(Integer::PackBytesClampU, &args[0])?]),
            M::Unpack4xI8 | M::Unpack4xU8 => {
                let rule = if function == M::Unpack4xI8 { Integer::ByteI } else { Integer::ByteU };
                let mut values = Vec::new();
                for byte in 0..4 {
                    let byte = self.constant(Scalar::U32, byte);
                    values.push(self.integer(rule, &[args[0][0], byte])?);
                }
                Ok(values)
            }
            other => {
                Err(self.refuse(format!("the builtin function {other:?} for the type {scalar:?}")))
            }
        }
    }

    /// Applies `f` to each component. If an argument is a scalar and others are vectors, all components use the scalar.
    fn by_component(
        &mut self,
        args: &[Rc<[Reg]>],
        mut f: impl FnMut(&mut Self, &[Reg]) -> Lowered<Reg>,
    ) -> Lowered<Vec<Reg>> {
        let size = args.iter().map(|arg| arg.len()).max().unwrap_or(0);
        let mut values = Vec::new();
        for k in 0..size {
            let args: Vec<Reg> =
                args.iter().map(|arg| arg[if arg.len() == 1 { 0 } else { k }]).collect();
            values.push(f(self, &args)?);
        }
        Ok(values)
    }

    fn length(&mut self, x: &[Reg], half: bool) -> Lowered<Reg> {
        let rule = match x.len() {
            1 => Geometry::Length1,
            2 => Geometry::Length2,
            3 => Geometry::Length3,
            _ => Geometry::Length4,
        };
        self.float_op(FloatRule::Geometry(rule), x, half)
    }

    fn integer_dot(&mut self, scalar: Scalar, x: &[Reg], y: &[Reg]) -> Lowered<Vec<Reg>> {
        let (multiply, add) = if scalar.signed() {
            (Integer::MultiplyI, Integer::AddI)
        } else {
            (Integer::MultiplyU, Integer::AddU)
        };
        let mut sum = self.integer(multiply, &[x[0], y[0]])?;
        for (&x, &y) in x.iter().zip(y).skip(1) {
            let product = self.integer(multiply, &[x, y])?;
            sum = self.integer(add, &[sum, product])?;
        }
        Ok(vec![sum])
    }
}
