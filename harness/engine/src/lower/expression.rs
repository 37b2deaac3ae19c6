//! Lowers expressions: literals, composites, accesses and loads.

use std::rc::Rc;

use naga::{Expression, Handle, Literal, TypeInner};

use super::{Lower, Lowered, STACK, Scope, Value};
use crate::code::{Constant, Op, Reg, Site};
use crate::coverage::StatementKind;
use crate::lower::memory::Place;
use crate::scalar::{File, Scalar};

impl<'m> Lower<'m> {
    /// The value of an expression. Lowers the expression if it isn't lowered yet.
    pub(super) fn value(
        &mut self,
        scope: &mut Scope<'m>,
        handle: Handle<Expression>,
    ) -> Lowered<Value> {
        if let Some(value) = &scope.values[handle.index()] {
            return Ok(value.clone());
        }
        // After an operand is lowered, the next operations belong to the expression that uses it.
        let (site, span) = (self.site, self.span);
        let value = stacker::maybe_grow(STACK.0, STACK.1, || self.lower_expression(scope, handle))?;
        (self.site, self.span) = (site, span);
        scope.values[handle.index()] = Some(value.clone());
        Ok(value)
    }

    /// The registers of an expression that isn't a pointer, a texture or a sampler.
    pub(super) fn flat(
        &mut self,
        scope: &mut Scope<'m>,
        handle: Handle<Expression>,
    ) -> Lowered<Rc<[Reg]>> {
        match self.value(scope, handle)? {
            Value::Flat(registers) => Ok(registers),
            Value::Place(_) => Err(self.refuse("a pointer where a value is needed")),
            Value::Texture(..) | Value::Sampler(_) => {
                Err(self.refuse("a texture or sampler where a value is needed"))
            }
        }
    }

    pub(super) fn place(
        &mut self,
        scope: &mut Scope<'m>,
        handle: Handle<Expression>,
    ) -> Lowered<Rc<Place>> {
        match self.value(scope, handle)? {
            Value::Place(place) => Ok(place),
            _ => Err(self.refuse("a value where a pointer is needed")),
        }
    }

    pub(super) fn enter_expression(&mut self, scope: &Scope<'m>, handle: Handle<Expression>) {
        self.span = scope.expressions.get_span(handle);
        let name =
            scope.function.and_then(|function| function.named_expressions.get(&handle)).cloned();
        self.code.sites.push(Site {
            number: self.code.sites.len(),
            function: scope.name.clone(),
            expression: scope.function.map(|_| handle),
            name,
            span: self.span,
            half: false,
        });
        self.site = self.code.sites.len() as u32 - 1;
    }

    fn lower_expression(
        &mut self,
        scope: &mut Scope<'m>,
        handle: Handle<Expression>,
    ) -> Lowered<Value> {
        self.enter_expression(scope, handle);
        let (site, span) = (self.site, self.span);
        let expression = &scope.expressions[handle];
        // Operands that aren't lowered yet are constants. They emit no operations, but they have spans.
        macro_rules! back {
            () => {
                self.site = site;
                self.span = span;
            };
        }
        let flat = |registers: Vec<Reg>| Ok(Value::Flat(registers.into()));
        match *expression {
            Expression::Literal(literal) => {
                let (scalar, word) = self.literal(literal)?;
                flat(vec![self.constant(scalar, word)])
            }
            Expression::Constant(constant) => {
                if let Some(value) = self.constant_values.get(&constant) {
                    return Ok(value.clone());
                }
                let mut module = self.module_scope();
                let value = self.value(&mut module, self.module.constants[constant].init)?;
                self.constant_values.insert(constant, value.clone());
                Ok(value)
            }
            Expression::Override(handle) => match self.overrides.get(&handle) {
                Some(value) => Ok(value.clone()),
                None => {
                    let name = self.module.overrides[handle].name.clone().expect("WGSL names it");
                    Err(self.refuse(format!(
                        "the override `{name}`, because the override has no value"
                    )))
                }
            },
            Expression::ZeroValue(ty) => {
                let scalars = self.scalars(self.layouts.inner(ty))?;
                flat(scalars.into_iter().map(|scalar| self.constant(scalar, 0)).collect())
            }
            Expression::Compose { ref components, .. } => {
                let mut registers = Vec::new();
                for &component in components {
                    registers.extend_from_slice(&self.flat(scope, component)?);
                    if registers.len() as u64 > crate::scalar::MOST_SCALARS {
                        back!();
                        return Err(self.refuse("a value with too many scalars"));
                    }
                }
                flat(registers)
            }
            Expression::Splat { size, value } => {
                let register = self.flat(scope, value)?[0];
                flat(vec![register; size as usize])
            }
            Expression::Swizzle { size, vector, pattern } => {
                let vector = self.flat(scope, vector)?;
                flat(pattern.iter().take(size as usize).map(|c| vector[*c as usize]).collect())
            }
            Expression::FunctionArgument(index) => match scope.arguments.get(index as usize) {
                Some(value) => Ok(value.clone()),
                None => Err(self.refuse("an argument that the function doesn't have")),
            },
            Expression::LocalVariable(variable) => match scope.locals.get(&variable) {
                Some(place) => Ok(Value::Place(place.clone())),
                None => Err(self.refuse("a variable that doesn't exist")),
            },
            Expression::GlobalVariable(variable) => match self.globals.get(&variable) {
                Some(value) => Ok(value.clone()),
                None => Err(self.refuse("a global variable that the entry point doesn't use")),
            },
            Expression::AccessIndex { base, index } => match self.value(scope, base)? {
                Value::Place(place) if place.has_no_length() => {
                    let index = self.constant(Scalar::U32, index);
                    back!();
                    self.element_place(&place, index, false).map(Value::Place)
                }
                Value::Place(place) => {
                    back!();
                    self.component_place(&place, index).map(Value::Place)
                }
                Value::Flat(registers) => {
                    back!();
                    let inner = self.type_of(scope, base);
                    self.component(&registers, &inner, index)
                }
                _ => Err(self.refuse("an index into a texture or a sampler")),
            },
            Expression::Access { base, index } => {
                let signed = self.signed(scope, index);
                let index = self.flat(scope, index)?[0];
                match self.value(scope, base)? {
                    Value::Place(place) => {
                        back!();
                        self.element_place(&place, index, signed).map(Value::Place)
                    }
                    Value::Flat(registers) => {
                        back!();
                        let inner = self.type_of(scope, base);
                        self.element(&registers, &inner, index, signed)
                    }
                    _ => Err(self.refuse("an index into a texture or a sampler")),
                }
            }
            Expression::Load { pointer } => {
                let place = self.place(scope, pointer)?;
                back!();
                self.load(&place)
            }
            Expression::ArrayLength(pointer) => {
                let place = self.place(scope, pointer)?;
                back!();
                self.array_length(&place)
            }
            Expression::Unary { op, expr } => self.unary(scope, op, expr),
            Expression::Binary { op, left, right } => self.binary(scope, op, left, right),
            Expression::Select { condition, accept, reject } => {
                let condition = self.flat(scope, condition)?;
                let accept = self.flat(scope, accept)?;
                let reject = self.flat(scope, reject)?;
                back!();
                let start = self.code.instructions.len();
                let mut registers = Vec::new();
                for (k, (yes, no)) in accept.iter().zip(reject.iter()).enumerate() {
                    let condition = condition[if condition.len() == 1 { 0 } else { k }];
                    registers.push(self.select(condition, *yes, *no)?);
                }
                let span = scope.expressions.get_span(handle);
                self.list(scope, span, StatementKind::Select, start);
                flat(registers)
            }
            Expression::Relational { fun, argument } => self.relational(scope, fun, argument),
            Expression::Math { fun, arg, arg1, arg2, arg3 } => {
                self.math(scope, handle, fun, [Some(arg), arg1, arg2, arg3])
            }
            Expression::As { expr, kind, convert } => {
                self.convert(scope, handle, expr, kind, convert)
            }
            Expression::ImageSample { .. }
            | Expression::ImageLoad { .. }
            | Expression::ImageQuery { .. } => self.image(scope, handle),
            Expression::Derivative { axis, expr, .. } => {
                let scalars = self.scalars(&self.type_of(scope, expr))?;
                let half = scalars.first() == Some(&Scalar::F16);
                let registers = self.flat(scope, expr)?;
                back!();
                let of = |register| self.derivative(axis, register, half);
                let derivatives: Vec<Reg> =
                    registers.iter().copied().map(of).collect::<Lowered<_>>()?;
                Ok(Value::Flat(derivatives.into()))
            }
            Expression::CallResult(_)
            | Expression::AtomicResult { .. }
            | Expression::SubgroupBallotResult
            | Expression::SubgroupOperationResult { .. }
            | Expression::WorkGroupUniformLoadResult { .. } => {
                Err(self.refuse("a result that is used before it is computed"))
            }
            Expression::RayQueryVertexPositions { .. }
            | Expression::RayQueryProceedResult
            | Expression::RayQueryGetIntersection { .. } => Err(self.refuse("ray queries")),
            Expression::CooperativeLoad { .. } | Expression::CooperativeMultiplyAdd { .. } => {
                Err(self.refuse("cooperative matrices"))
            }
        }
    }

    fn literal(&self, literal: Literal) -> Lowered<(Scalar, u32)> {
        Ok(match literal {
            Literal::F32(x) => (Scalar::F32, x.to_bits()),
            Literal::F16(x) => (Scalar::F16, x.to_f32().to_bits()),
            Literal::U32(x) => (Scalar::U32, x),
            Literal::I32(x) => (Scalar::I32, x.cast_unsigned()),
            Literal::Bool(x) => (Scalar::Bool, u32::from(x)),
            Literal::F64(_) => return Err(self.refuse("type f64")),
            Literal::U16(_) => return Err(self.refuse("type u16")),
            Literal::I16(_) => return Err(self.refuse("type i16")),
            Literal::U64(_) => return Err(self.refuse("type u64")),
            Literal::I64(_) => return Err(self.refuse("type i64")),
            Literal::AbstractInt(_) | Literal::AbstractFloat(_) => {
                return Err(self.refuse("a number of abstract type at run time"));
            }
        })
    }

    /// Checks if an expression is a signed integer, or a vector of signed integers.
    pub(super) fn signed(&self, scope: &Scope<'m>, handle: Handle<Expression>) -> bool {
        self.type_of(scope, handle).scalar_kind() == Some(naga::ScalarKind::Sint)
    }

    fn component(&mut self, registers: &[Reg], inner: &TypeInner, index: u32) -> Lowered<Value> {
        let (part, before) =
            self.layouts.component(inner, index).map_err(|what| self.refuse(what))?;
        let start = before.iter().sum::<u32>() as usize;
        let count = self.counts(&part)?.iter().sum::<u32>() as usize;
        match registers.get(start..start + count) {
            Some(registers) => Ok(Value::Flat(registers.into())),
            None => Err(self.refuse("a component that doesn't exist")),
        }
    }

    fn element(
        &mut self,
        registers: &[Reg],
        inner: &TypeInner,
        index: Reg,
        signed: bool,
    ) -> Lowered<Value> {
        let (part, length) = self.layouts.element(inner).map_err(|what| self.refuse(what))?;
        let length = length.unwrap_or(0);
        if let Some(constant) = self.words.get(&index) {
            let word = constant.word.min(length.saturating_sub(1));
            return self.component(registers, inner, word);
        }
        let scalars = self.scalars(&part)?;
        let width = scalars.len();
        let mut values = Vec::new();
        for (k, scalar) in scalars.iter().enumerate() {
            let file = scalar.file();
            let to = self.fresh(file);
            values.push(to);
            let candidates: Vec<Reg> =
                (0..length as usize).map(|i| registers[i * width + k]).collect();
            let table: Option<Vec<Constant>> =
                candidates.iter().map(|register| self.words.get(register).copied()).collect();
            if let Some(table) = table {
                self.code.tables.push((table, signed));
                let table = self.code.tables.len() as u32 - 1;
                self.emit(Op::Table(file, table), &[to], &[index])?;
                continue;
            }
            let ins = if file == File::Bool {
                [&[index], &candidates[..]].concat()
            } else {
                [&candidates[..], &[index]].concat()
            };
            self.emit(Op::Pick(file, length, signed), &[to], &ins)?;
        }
        Ok(Value::Flat(values.into()))
    }
}
