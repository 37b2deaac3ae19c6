//! Lowers statements: control flow, stores and calls.

use std::collections::HashMap;

use naga::{Block, Expression, Function, Handle, Statement, SwitchValue, valid::FunctionInfo};

use super::{Frame, Lower, Lowered, Open, STACK, Scope, Types, Value};
use crate::code::{Compare, Op, Reg, Site};
use crate::coverage::StatementKind;
use crate::scalar::{File, Scalar};

impl<'m> Lower<'m> {
    /// Lowers a call of `function`. Returns the registers that have the call's result.
    pub(super) fn inline(
        &mut self,
        function: &'m Function,
        info: &'m FunctionInfo,
        name: &str,
        arguments: Vec<Value>,
    ) -> Lowered<Option<Value>> {
        stacker::maybe_grow(STACK.0, STACK.1, || self.inline_here(function, info, name, arguments))
    }

    fn inline_here(
        &mut self,
        function: &'m Function,
        info: &'m FunctionInfo,
        name: &str,
        arguments: Vec<Value>,
    ) -> Lowered<Option<Value>> {
        self.calls += 1;
        let mut scope = Scope {
            name: name.to_owned(),
            call: self.calls,
            expressions: &function.expressions,
            types: Types::Function(info),
            function: Some(function),
            values: vec![None; function.expressions.len()],
            arguments,
            locals: HashMap::new(),
            result: None,
            returned: None,
            early: returns(&function.body) > usize::from(ends_with_return(&function.body)),
        };
        for (handle, variable) in function.local_variables.iter() {
            self.span = function.local_variables.get_span(handle);
            let init = match variable.init {
                Some(init) => Some(self.value(&mut scope, init)?),
                None => None,
            };
            let Value::Place(place) = self.variable(self.layouts.inner(variable.ty), init)? else {
                continue;
            };
            scope.locals.insert(handle, place);
        }
        if !scope.early {
            self.block(&mut scope, &function.body)?;
            return Ok(scope.returned);
        }
        if let Some(result) = &function.result {
            let scalars = self.scalars(self.layouts.inner(result.ty))?;
            scope.result = Some(scalars.iter().map(|s| self.fresh(s.file())).collect());
            // The first masked store keeps this value in the lanes that aren't active.
            for (scalar, register) in scalars.iter().zip(scope.result.iter().flat_map(|r| r.iter()))
            {
                let zero = self.constant(*scalar, 0);
                self.emit(Op::Move(register.file), &[*register], &[zero])?;
            }
        }
        let start = self.emit(Op::Call, &[], &[])?;
        self.open(Frame::Call);
        self.block(&mut scope, &function.body)?;
        let end = self.close(Op::EndCall)?;
        self.code.instructions[start].target = end as u32;
        Ok(scope.result.map(Value::Flat))
    }

    fn open(&mut self, frame: Frame) {
        self.open.push(Open { frame, skips: Vec::new() });
    }

    /// Ends a part, such as a branch, of the innermost open construct. The jumps that left this part now jump to the
    /// next operation.
    fn land(&mut self) {
        let here = self.code.instructions.len() as u32;
        if let Some(open) = self.open.last_mut() {
            for skip in open.skips.drain(..) {
                self.code.instructions[skip].target = here;
            }
        }
    }

    /// Ends the innermost open construct. If no lane is active after the end of this construct, control jumps to the
    /// end of the part that contains the construct, such as a branch.
    fn close(&mut self, op: Op) -> Lowered<usize> {
        self.land();
        self.open.pop();
        let end = self.emit(op, &[], &[])?;
        self.code.instructions[end].target = end as u32 + 1;
        if let Some(outer) = self.open.last_mut() {
            outer.skips.push(end);
        }
        Ok(end)
    }

    fn block(&mut self, scope: &mut Scope<'m>, block: &'m Block) -> Lowered<()> {
        stacker::maybe_grow(STACK.0, STACK.1, || {
            for (statement, span) in block.span_iter() {
                self.span = *span;
                let start = self.code.instructions.len();
                self.statement(scope, statement, *span)?;
                if let Some(kind) = StatementKind::of(statement) {
                    self.list(scope, *span, kind, start);
                }
            }
            Ok(())
        })
    }

    pub(super) fn enter_statement(&mut self, scope: &Scope<'m>, span: naga::Span) {
        self.span = span;
        self.code.sites.push(Site {
            number: self.code.sites.len(),
            function: scope.name.clone(),
            expression: None,
            name: None,
            span,
            half: false,
        });
        self.site = self.code.sites.len() as u32 - 1;
    }

    /// Records that the current statement computes the value of an expression.
    fn gives(&mut self, result: Option<Handle<Expression>>) {
        if let Some(site) = self.code.sites.last_mut() {
            site.expression = result;
        }
    }

    fn statement(
        &mut self,
        scope: &mut Scope<'m>,
        statement: &'m Statement,
        span: naga::Span,
    ) -> Lowered<()> {
        match *statement {
            Statement::Emit(ref range) => {
                for handle in range.clone() {
                    // Each time that control reaches the expression, its operations are emitted again, so the old value
                    // is dropped.
                    scope.values[handle.index()] = None;
                    let value = self.value(scope, handle)?;
                    self.mark(scope, handle, &value)?;
                }
            }
            Statement::Block(ref block) => self.block(scope, block)?,
            Statement::If { condition, ref accept, ref reject } => {
                let condition = self.flat(scope, condition)?[0];
                self.enter_statement(scope, span);
                let site = self.site;
                let mut jump = self.emit(Op::If, &[], &[condition])?;
                self.open(Frame::If);
                self.block(scope, accept)?;
                if !reject.is_empty() {
                    self.land();
                    self.site = site;
                    let other = self.emit(Op::Else, &[], &[condition])?;
                    self.code.instructions[jump].target = other as u32;
                    jump = other;
                    self.block(scope, reject)?;
                }
                let end = self.close(Op::EndIf)?;
                self.code.instructions[jump].target = end as u32;
            }
            Statement::Switch { selector, ref cases } => {
                self.switch(scope, span, selector, cases)?;
            }
            Statement::Loop { ref body, ref continuing, break_if } => {
                self.enter_statement(scope, span);
                let site = self.site;
                let start = self.emit(Op::Loop, &[], &[])?;
                self.open(Frame::Loop);
                let round = self.emit(Op::Round, &[], &[])?;
                self.block(scope, body)?;
                self.land();
                self.emit(Op::Continuing, &[], &[])?;
                self.block(scope, continuing)?;
                self.land();
                if let Some(condition) = break_if {
                    let register = self.flat(scope, condition)?[0];
                    self.enter_expression(scope, condition);
                    self.emit(Op::BreakIf, &[], &[register])?;
                }
                self.site = site;
                self.span = span;
                let end = self.close(Op::EndLoop)?;
                // The loop's end jumps back to the beginning of an iteration. The loop's exit comes after this jump.
                self.code.instructions[end].target = round as u32;
                if let Some(outer) = self.open.last_mut() {
                    outer.skips.pop();
                }
                self.code.instructions[start].target = end as u32;
                let out = self.emit(Op::Skip, &[], &[])?;
                self.code.instructions[out].target = out as u32 + 1;
                if let Some(outer) = self.open.last_mut() {
                    outer.skips.push(out);
                }
            }
            Statement::Break => {
                self.enter_statement(scope, span);
                let depth = self.depth(|frame| matches!(frame, Frame::Loop | Frame::Switch))?;
                self.emit(Op::Break(depth), &[], &[])?;
            }
            Statement::Continue => {
                self.enter_statement(scope, span);
                let depth = self.depth(|frame| frame == Frame::Loop)?;
                self.emit(Op::Continue(depth), &[], &[])?;
            }
            Statement::Return { value } => {
                let value = match value {
                    Some(value) => Some(self.value(scope, value)?),
                    None => None,
                };
                match (&scope.result, &value) {
                    (Some(result), Some(Value::Flat(value))) => {
                        self.enter_statement(scope, span);
                        for (to, from) in result.clone().iter().zip(value.iter()) {
                            self.emit(Op::Store(to.file), &[*to], &[*from])?;
                        }
                    }
                    _ => scope.returned = value,
                }
                if scope.early {
                    self.enter_statement(scope, span);
                    let depth = self.depth(|frame| frame == Frame::Call)?;
                    self.emit(Op::Return(depth), &[], &[])?;
                }
            }
            Statement::Store { pointer, value } => {
                let place = self.place(scope, pointer)?;
                let value = self.flat(scope, value)?;
                self.enter_statement(scope, span);
                self.store(&place, &value)?;
            }
            Statement::Call { function, ref arguments, result } => {
                let mut values = Vec::new();
                for &argument in arguments {
                    values.push(self.value(scope, argument)?);
                }
                let called = &self.module.functions[function];
                let name = called.name.clone().expect("WGSL names it");
                // The first instructions of a call have the site of the call, not the site of the previous statement.
                self.enter_statement(scope, span);
                let value = self.inline(called, &self.info[function], &name, values)?;
                self.enter_statement(scope, span);
                if let Some(result) = result {
                    if let Some(value) = &value {
                        self.mark(scope, result, value)?;
                    }
                    scope.values[result.index()] = value;
                }
            }
            Statement::Atomic { pointer, fun, value, result } => {
                self.enter_statement(scope, span);
                self.gives(result);
                self.atomic(scope, pointer, fun, value, result)?;
            }
            Statement::WorkGroupUniformLoad { pointer, result } => {
                let place = self.place(scope, pointer)?;
                self.enter_statement(scope, span);
                // "Executes a control barrier .. before and after the load" (WGSL, 17.11.4).
                self.emit(Op::Barrier(naga::Barrier::WORK_GROUP), &[], &[])?;
                scope.values[result.index()] = Some(self.load(&place)?);
                self.emit(Op::Barrier(naga::Barrier::WORK_GROUP), &[], &[])?;
            }
            Statement::ControlBarrier(barrier) | Statement::MemoryBarrier(barrier) => {
                if !self.shared {
                    return Err(self.refuse(
                        "a barrier in a function, because cases don't wait for each other",
                    ));
                }
                self.enter_statement(scope, span);
                self.emit(Op::Barrier(barrier), &[], &[])?;
            }
            Statement::ImageStore { .. } => self.image_store(scope, statement, span)?,
            Statement::Kill if self.drawn => {
                self.enter_statement(scope, span);
                self.emit(Op::Discard, &[], &[])?;
            }
            Statement::Kill => return Err(self.refuse("`discard` outside of a fragment shader")),
            Statement::ImageAtomic { .. } => return Err(self.refuse("atomics on textures")),
            Statement::RayQuery { .. } | Statement::RayPipelineFunction(_) => {
                return Err(self.refuse("ray queries"));
            }
            Statement::SubgroupBallot { .. }
            | Statement::SubgroupGather { .. }
            | Statement::SubgroupCollectiveOperation { .. }
                if !self.shared =>
            {
                return Err(self
                    .refuse("a subgroup operation in a function, because cases form no subgroup"));
            }
            Statement::SubgroupBallot { result, predicate } => {
                self.enter_statement(scope, span);
                self.gives(Some(result));
                self.ballot(scope, predicate, result)?;
            }
            Statement::SubgroupGather { mode, argument, result } => {
                self.enter_statement(scope, span);
                self.gives(Some(result));
                self.gather_of(scope, mode, argument, result)?;
            }
            Statement::SubgroupCollectiveOperation { op, collective_op, argument, result } => {
                self.enter_statement(scope, span);
                self.gives(Some(result));
                self.collective(scope, (op, collective_op), argument, result)?;
            }
            Statement::CooperativeStore { .. } => return Err(self.refuse("cooperative matrices")),
        }
        Ok(())
    }

    /// The number of open constructs inside of the innermost open construct that `is` accepts.
    fn depth(&self, is: impl Fn(Frame) -> bool) -> Lowered<u32> {
        match self.open.iter().rev().position(|open| is(open.frame)) {
            Some(depth) => Ok(depth as u32),
            None => Err(self.refuse("a jump outside of a loop, a `switch` or a function")),
        }
    }

    fn switch(
        &mut self,
        scope: &mut Scope<'m>,
        span: naga::Span,
        selector: Handle<Expression>,
        cases: &'m [naga::SwitchCase],
    ) -> Lowered<()> {
        let signed = self.signed(scope, selector);
        let selector = self.flat(scope, selector)?[0];
        self.enter_statement(scope, span);
        let mut conditions: Vec<Option<Reg>> = Vec::new();
        let mut any: Option<Reg> = None;
        for case in cases {
            let word = match case.value {
                SwitchValue::I32(x) => x.cast_unsigned(),
                SwitchValue::U32(x) => x,
                SwitchValue::Default => {
                    conditions.push(None);
                    continue;
                }
            };
            let scalar = if signed { Scalar::I32 } else { Scalar::U32 };
            let constant = self.constant(scalar, word);
            let op = Op::CompareInt(Compare::Equal, signed);
            let condition = self.boolean(op, &[selector, constant])?;
            conditions.push(Some(condition));
            any = Some(match any {
                Some(any) => self.boolean(Op::Or, &[any, condition])?,
                None => condition,
            });
        }
        let default = match any {
            Some(any) => self.boolean(Op::Not, &[any])?,
            None => self.constant(Scalar::Bool, 1),
        };
        let site = self.site;
        let start = self.emit(Op::Switch, &[], &[])?;
        self.open(Frame::Switch);
        let mut before: Option<usize> = None;
        let (mut falls, mut clause) = (false, 0);
        for (case, condition) in cases.iter().zip(conditions) {
            self.land();
            let condition = condition.unwrap_or(default);
            self.site = site;
            let jump = self.emit(Op::Case(falls), &[], &[condition])?;
            if let Some(before) = before {
                self.code.instructions[before].target = jump as u32;
            }
            before = Some(jump);
            self.block(scope, &case.body)?;
            // A clause with several values has several cases in naga. The last of these cases has the clause's
            // statements.
            falls = case.fall_through;
            if !falls {
                self.list(scope, span, StatementKind::Clause(clause), jump);
                clause += 1;
            }
        }
        let end = self.close(Op::EndSwitch)?;
        if let Some(before) = before {
            self.code.instructions[before].target = end as u32;
        }
        self.code.instructions[start].target = end as u32;
        Ok(())
    }

    fn mark(
        &mut self,
        scope: &Scope<'m>,
        handle: Handle<Expression>,
        value: &Value,
    ) -> Lowered<()> {
        let name = scope.function.and_then(|f| f.named_expressions.get(&handle));
        let named = name.is_some_and(|name| {
            self.settings.named.iter().any(|beginning| name.starts_with(beginning))
        });
        let (true, Value::Flat(registers)) = (named, value) else {
            return Ok(());
        };
        self.enter_expression(scope, handle);
        let mut sorted = registers.to_vec();
        sorted.sort_by_key(|register| register.file);
        let count = |file: File| sorted.iter().filter(|r| r.file == file).count() as u32;
        self.code.marks.push([count(File::Float), count(File::Int), count(File::Bool)]);
        self.emit(Op::Mark(self.code.marks.len() as u32 - 1), &[], &sorted)?;
        Ok(())
    }
}

fn returns(block: &Block) -> usize {
    stacker::maybe_grow(STACK.0, STACK.1, || {
        block
            .iter()
            .map(|statement| match statement {
                Statement::Return { .. } => 1,
                Statement::Block(block) => returns(block),
                Statement::If { accept, reject, .. } => returns(accept) + returns(reject),
                Statement::Switch { cases, .. } => {
                    cases.iter().map(|case| returns(&case.body)).sum()
                }
                Statement::Loop { body, continuing, .. } => returns(body) + returns(continuing),
                _ => 0,
            })
            .sum()
    })
}

fn ends_with_return(block: &Block) -> bool {
    matches!(block.last(), Some(Statement::Return { .. }))
}
