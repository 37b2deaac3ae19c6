//! Makes programs in which fragment functions return one intermediate value in addition to their colours.
//!
//! A tap is a changed copy of naga's IR. After the statement that computes the intermediate value, the copy stores the
//! value in a private variable. The fragment function returns the `u32` words of the value at an additional location.
//! Control flow, arguments, resources and the author's text stay unchanged.

use std::collections::BTreeSet;
use std::ops::Range;

use naga::{
    AddressSpace, BinaryOperator, Binding, Block, Expression, Function, FunctionResult,
    GlobalVariable, Handle, Literal, Module, Scalar, ScalarKind, ShaderStage, Span, Statement,
    StructMember, Type, TypeInner, VectorSize,
};

use naga::proc::{Layouter, TypeResolution};
use naga::valid::GlobalUse;

use super::rounds::walk;
use super::{NAMED, Program, ReflectError};
use crate::package::asserts::{ASSERTED, HOLDER, PRINTED, is_in_a_line};
use crate::package::let_statements;
use crate::value::Shape;

/// The number of `u32` words that a changed program returns in one colour target.
pub(crate) const WORDS: usize = 4;

#[derive(Clone, Debug)]
pub(crate) struct Valued {
    /// The name of the function or entry point in the linked text.
    pub(crate) function: String,
    /// The index of the value among the expressions of the function.
    pub(crate) expression: usize,
    /// The range of the expression in [`Program::text`]; `None` for an argument.
    pub(crate) range: Option<Range<usize>>,
    pub(crate) name: Option<String>,
    /// The type of the value, or the reason why Karat can't read the value.
    pub(crate) shape: Result<Shape, String>,
}

impl Valued {
    /// The number of `u32` words in which a program returns the value: one word for each scalar, and one word for a
    /// counter. The counter is 1 more than the number of times that the shader computed the value, so 0 means that no
    /// invocation wrote the words. `None` if Karat can't read the value.
    pub(crate) fn words(&self) -> Option<usize> {
        Some(self.shape.as_ref().ok()?.lanes().len() + 1)
    }
}

/// Selects a value of an expression that runs several times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum When {
    /// The last value.
    #[default]
    Last,
    /// The value in this iteration. The first iteration is 1.
    Round(u32),
    /// For a condition: the value `false`, if the condition is ever `false`. The counter then counts only the times
    /// when the condition is `false`.
    False,
}

impl From<Option<u32>> for When {
    fn from(round: Option<u32>) -> Self {
        round.map_or(Self::Last, Self::Round)
    }
}

/// The values that a changed program returns, and the locations at which it returns them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Telling<'t> {
    /// The values to return. If there are no values, each fragment function returns its position in the list of
    /// fragment functions, counted from 1.
    pub(crate) values: &'t [(&'t Valued, When)],
    /// The index of the first word to return, among the words of all values. The words of a value are its scalars,
    /// followed by the counter of [`Valued::words`].
    pub(crate) first: usize,
    /// The locations at which the program returns the words. Each location has [`WORDS`] words.
    pub(crate) locations: &'t [u32],
    /// `true` if the program returns these words in place of the colours of the author's function.
    pub(crate) alone: bool,
}

impl Program {
    /// All values that these entry points, and the functions that they call, compute. The values of one function are
    /// together.
    pub(crate) fn values_of(&self, entry_points: &[&str]) -> Vec<Valued> {
        let module = &self.checked.module;
        let (mut open, mut seen) = (Vec::new(), BTreeSet::new());
        let mut all = Vec::new();
        for entry in &module.entry_points {
            if entry_points.contains(&&*entry.name) {
                self.values(&entry.name, &entry.function, &mut all);
                open.push(&entry.function);
            }
        }
        while let Some(function) = open.pop() {
            walk(&function.body, false, &mut |statement, _, _| {
                if let Statement::Call { function: callee, .. } = statement
                    && seen.insert(*callee)
                {
                    let callee = &module.functions[*callee];
                    self.values(callee.name.as_deref().expect(NAMED), callee, &mut all);
                    open.push(callee);
                }
            });
        }
        all
    }

    /// The values of all `let`s with a name that begins with one of these prefixes, in all functions.
    pub(crate) fn named_values(&self, beginnings: &[&str]) -> Vec<Valued> {
        let module = &self.checked.module;
        let mut all = Vec::new();
        for (_, function) in module.functions.iter() {
            self.values(function.name.as_deref().expect(NAMED), function, &mut all);
        }
        for entry in &module.entry_points {
            self.values(&entry.name, &entry.function, &mut all);
        }
        let begins = |name: &String| beginnings.iter().any(|one| name.starts_with(one));
        all.retain(|one| one.name.as_ref().is_some_and(begins));
        all
    }

    fn values(&self, name: &str, function: &Function, all: &mut Vec<Valued>) {
        let (_, info) = self.body(name).expect("it is a function of this program");
        let computed = computed(&function.body);
        for (handle, expression) in function.expressions.iter() {
            // naga turns a number next to a vector into a vector, and gives the vector the number's span.
            let span = |handle| function.expressions.get_span(handle);
            if let Expression::Splat { value, .. } = expression
                && span(*value) == span(handle)
            {
                continue;
            }
            let argument = match expression {
                Expression::FunctionArgument(index) => {
                    function.arguments[*index as usize].name.clone()
                }
                _ => None,
            };
            let shape = match expression {
                _ if argument.is_some() || computed.contains(&handle) => match &info[handle].ty {
                    TypeResolution::Handle(ty) => self.shape(*ty),
                    TypeResolution::Value(inner) => {
                        self.shape_of(&Type { name: None, inner: inner.clone() })
                    }
                },
                Expression::Constant(_)
                | Expression::Override(_)
                | Expression::Literal(_)
                | Expression::ZeroValue(_) => Err("a constant".to_owned()),
                _ => continue,
            };
            let range = function.expressions.get_span(handle).to_range();
            let range = range.and_then(|range| {
                let whole = super::whole_call(self.text(), range.clone())?;
                Some(range.start..range.start + whole.len())
            });
            let range = range.filter(|_| argument.is_none());
            let own = argument.or_else(|| function.named_expressions.get(&handle).cloned());
            all.push(Valued {
                function: name.to_owned(),
                expression: handle.index(),
                range: range.or_else(|| self.held(name, own.as_ref()?)),
                name: own,
                shape,
            });
        }
    }

    /// Checks that no assertion or print in the shader has a side effect, such as a call of a function that writes,
    /// or an atomic operation.
    ///
    /// # Errors
    /// Returns an error if there is such a side effect; the error has its location.
    pub(crate) fn expect_no_effects(&self) -> Result<(), ReflectError> {
        let (module, info) = (self.module(), self.info());
        let functions = module.functions.iter().map(|(_, function)| function);
        let mut found = None;
        for function in functions.chain(module.entry_points.iter().map(|entry| &entry.function)) {
            walk(&function.body, false, &mut |statement, span, _| {
                let writes = match statement {
                    Statement::Call { function: callee, arguments, .. } => {
                        let own = &info[*callee];
                        let mut globals = module.global_variables.iter();
                        let is_pointer = |argument: &Handle<Expression>| {
                            matches!(
                                function.expressions[*argument],
                                Expression::LocalVariable(_)
                                    | Expression::Access { .. }
                                    | Expression::AccessIndex { .. }
                            ) && module.functions[*callee].arguments.iter().any(|argument| {
                                matches!(module.types[argument.ty].inner, TypeInner::Pointer { .. })
                            })
                        };
                        globals.any(|(handle, _)| {
                            own[handle].intersects(GlobalUse::WRITE | GlobalUse::ATOMIC)
                        }) || arguments.iter().any(is_pointer)
                    }
                    Statement::Atomic { .. } | Statement::ImageStore { .. } => true,
                    _ => false,
                };
                let place = writes.then(|| self.resolve(span.to_range()?)).flatten();
                if let Some(place) = place.filter(is_in_a_line) {
                    found = found.take().or(Some(place));
                }
            });
        }
        let Some(place) = found else { return Ok(()) };
        let message = "this assertion or print has a side effect";
        let note = "call the function before this line, and assert or print the result";
        let found =
            crate::diagnostic::Diagnostic::new(message).at(place.first_line(), "").note(note);
        Err(ReflectError::Unprobeable(Box::new(found)))
    }

    /// The range of the expression that an assertion or a print evaluates. This function finds the range in the text,
    /// because naga has no span for the expression. `name` is the name of the `let` that has the expression's value.
    fn held(&self, function: &str, name: &str) -> Option<Range<usize>> {
        if ![ASSERTED, PRINTED].iter().any(|one| name.starts_with(one)) {
            return None;
        }
        let text = self.text();
        let all = let_statements(text, function);
        let found = all.into_iter().find(|one| &text[one.name.clone()] == name)?;
        let end = found.end?;
        let start = found.name.end + text[found.name.end..end].find(HOLDER)?;
        Some(start..end - 1)
    }

    /// A copy of this program in which the fragment functions `fragments` return the values in `telling`.
    ///
    /// # Errors
    /// Returns an error if naga rejects the program.
    pub(crate) fn telling(
        &self,
        fragments: &[&str],
        telling: Telling<'_>,
    ) -> Result<Self, ReflectError> {
        let mut module = self.checked.module.clone();
        let keep = |(value, when): &(&Valued, When)| self.keeping(&mut module, value, *when);
        let kept: Vec<(Kept, Vec<Way>)> = telling.values.iter().map(keep).collect();
        for index in 0..module.entry_points.len() {
            let entry = &module.entry_points[index];
            let known = fragments.iter().position(|name| *name == entry.name);
            if let (ShaderStage::Fragment, Some(number)) = (entry.stage, known) {
                let mut function = entry.function.clone();
                let number = u32::try_from(number).expect("there are few functions") + 1;
                tell(&mut module, &mut function, (&kept, number), telling);
                module.entry_points[index].function = function;
            }
        }
        let program = Self::from_ir(self.linked.clone(), module)?;
        Ok(Self { overrides: self.overrides.clone(), ..program })
    }

    /// A program whose compute entry point writes a value of each invocation into a buffer. For each invocation, the
    /// buffer has the scalars of the value, followed by the counter of [`Valued::words`]. The buffer's path is
    /// [`TOLD`]. `counts` has the number of invocations in each direction.
    ///
    /// # Errors
    /// Returns an error if naga rejects the program, or if the entry point has `global_invocation_id` in a structure.
    pub(crate) fn telling_pass(
        &self,
        entry_point: &str,
        (value, when): (&Valued, When),
        counts: [u32; 3],
    ) -> Result<Self, ReflectError> {
        let mut module = self.checked.module.clone();
        let (kept, ways) = self.keeping(&mut module, value, when);
        let plain = |inner| Type { name: None, inner };
        let u32_type = module.types.insert(plain(TypeInner::Scalar(Scalar::U32)), NOWHERE);
        let size = naga::ArraySize::Dynamic;
        let array = TypeInner::Array { base: u32_type, size, stride: 4 };
        let array = module.types.insert(plain(array), NOWHERE);
        let triple = TypeInner::Vector { size: VectorSize::Tri, scalar: Scalar::U32 };
        let triple = module.types.insert(plain(triple), NOWHERE);
        let access = naga::StorageAccess::LOAD | naga::StorageAccess::STORE;
        let told = GlobalVariable {
            name: Some(TOLD.to_owned()),
            space: AddressSpace::Storage { access },
            binding: Some(naga::ResourceBinding { group: 0, binding: self.free_binding() }),
            ty: array,
            init: None,
            memory_decorations: naga::MemoryDecorations::empty(),
        };
        let told = module.global_variables.append(told, NOWHERE);
        let mut entries = module.entry_points.iter_mut();
        let entry = entries.find(|entry| entry.name == entry_point).expect("it has one");
        let function = &mut entry.function;
        // An entry point may have this builtin value only once.
        let id = Some(Binding::BuiltIn(naga::BuiltIn::GlobalInvocationId));
        let at = match function.arguments.iter().position(|argument| argument.binding == id) {
            Some(at) => at,
            None if holds(&module.types, function, &id) => {
                return Err(untold_pass(entry_point));
            }
            None => {
                let name = Some("karat_told_id".to_owned());
                function.arguments.push(naga::FunctionArgument { name, ty: triple, binding: id });
                function.arguments.len() - 1
            }
        };
        let at = u32::try_from(at).expect("there are few arguments");
        let mut body = std::mem::take(&mut function.body);
        rewrite(&mut body, &mut |statement| {
            if !matches!(statement, Statement::Return { .. }) {
                return Rewritten::AsIs;
            }
            let mut block = leave(function, (kept, told), (at, counts), &ways);
            block.push(Statement::Return { value: None }, NOWHERE);
            Rewritten::Instead(block)
        });
        function.body = body;
        let program = Self::from_ir(self.linked.clone(), module)?;
        Ok(Self { overrides: self.overrides.clone(), ..program })
    }

    /// Makes a function store a value. Returns the variables that store the value, and the paths to its scalars.
    fn keeping(&self, module: &mut Module, value: &Valued, when: When) -> (Kept, Vec<Way>) {
        let (function, info) = self.body(&value.function).expect("it is a function of the program");
        let mut all = function.expressions.iter().map(|(handle, _)| handle);
        let handle = all.nth(value.expression).expect("it is an expression of its function");
        let ty = match info[handle].ty.clone() {
            TypeResolution::Handle(ty) => ty,
            TypeResolution::Value(inner) => {
                module.types.insert(Type { name: None, inner }, NOWHERE)
            }
        };
        let inner = TypeInner::Scalar(Scalar::U32);
        let u32_type = module.types.insert(Type { name: None, inner }, NOWHERE);
        let mut variable = |name: &str, ty| {
            let variable = GlobalVariable {
                name: Some(name.to_owned()),
                space: AddressSpace::Private,
                binding: None,
                ty,
                init: None,
                memory_decorations: naga::MemoryDecorations::empty(),
            };
            module.global_variables.append(variable, NOWHERE)
        };
        let rounds = variable("karat_told_rounds", u32_type);
        let kept = Kept { value: variable("karat_told", ty), rounds };
        let ways = lanes(module, ty, Vec::new());
        let name = &value.function;
        let found = module.functions.iter().find(|(_, one)| one.name.as_ref() == Some(name));
        let function = match found.map(|(handle, _)| handle) {
            Some(handle) => module.functions.get_mut(handle),
            None => {
                let mut entries = module.entry_points.iter_mut();
                &mut entries.find(|entry| entry.name == *name).expect("it has one").function
            }
        };
        kept.keep(function, handle, when);
        (kept, ways)
    }
}

const NOWHERE: Span = Span::UNDEFINED;

fn computed(body: &Block) -> BTreeSet<Handle<Expression>> {
    let mut all = BTreeSet::new();
    walk(body, false, &mut |statement, _, _| match statement {
        Statement::Emit(range) => all.extend(range.clone()),
        other => all.extend(result_of(other)),
    });
    all
}

fn result_of(statement: &Statement) -> Option<Handle<Expression>> {
    match statement {
        Statement::Call { result, .. } | Statement::Atomic { result, .. } => *result,
        Statement::WorkGroupUniformLoad { result, .. }
        | Statement::SubgroupBallot { result, .. }
        | Statement::SubgroupGather { result, .. }
        | Statement::SubgroupCollectiveOperation { result, .. } => Some(*result),
        _ => None,
    }
}

/// The position of a scalar inside a value, as a path of indices, and the scalar's type.
type Way = (Vec<u32>, Scalar);

fn lanes(module: &Module, ty: Handle<Type>, way: Vec<u32>) -> Vec<Way> {
    let mut all = Vec::new();
    let with = |index: u32| [&*way, &[index]].concat();
    match &module.types[ty].inner {
        TypeInner::Scalar(scalar) => all.push((way, *scalar)),
        TypeInner::Vector { size, scalar } => {
            all.extend((0..*size as u32).map(|index| (with(index), *scalar)));
        }
        TypeInner::Matrix { columns, rows, scalar } => {
            for column in 0..*columns as u32 {
                let column = with(column);
                all.extend((0..*rows as u32).map(|row| ([&*column, &[row]].concat(), *scalar)));
            }
        }
        TypeInner::Array { base, size: naga::ArraySize::Constant(length), .. } => {
            for index in 0..length.get() {
                all.extend(lanes(module, *base, with(index)));
            }
        }
        TypeInner::Struct { members, .. } => {
            for (index, member) in (0..).zip(members) {
                all.extend(lanes(module, member.ty, with(index)));
            }
        }
        _ => {}
    }
    all
}

/// Two private variables: one for a value, and one for the number of times that the shader computed the value.
#[derive(Clone, Copy)]
struct Kept {
    value: Handle<GlobalVariable>,
    rounds: Handle<GlobalVariable>,
}

impl Kept {
    /// Inserts statements after the statement that computes a value. They store the value, and count how often the
    /// shader computed it.
    fn keep(self, function: &mut Function, value: Handle<Expression>, when: When) {
        let mut body = std::mem::take(&mut function.body);
        let store = |function: &mut Function| {
            let mut add = |expression| function.expressions.append(expression, NOWHERE);
            let rounds = add(Expression::GlobalVariable(self.rounds));
            let pointer = add(Expression::GlobalVariable(self.value));
            let one = add(Expression::Literal(Literal::U32(1)));
            let wanted = match when {
                When::Round(round) => Some(add(Expression::Literal(Literal::U32(round)))),
                When::Last | When::False => None,
            };
            let left = add(Expression::Load { pointer: rounds });
            let op = BinaryOperator::Add;
            let mut last = add(Expression::Binary { op, left, right: one });
            let count = last;
            let condition = wanted.map(|wanted| {
                let op = BinaryOperator::Equal;
                last = add(Expression::Binary { op, left: count, right: wanted });
                last
            });
            let mut block = Block::new();
            block.push(Statement::Emit(naga::Range::new_from_bounds(left, last)), NOWHERE);
            block.push(Statement::Store { pointer: rounds, value: count }, NOWHERE);
            let mut accept = Block::new();
            accept.push(Statement::Store { pointer, value }, NOWHERE);
            match condition {
                None => block.append(&mut accept),
                Some(condition) => {
                    let reject = Block::new();
                    block.push(Statement::If { condition, accept, reject }, NOWHERE);
                }
            }
            if when == When::False {
                let (accept, reject) = (Block::new(), block);
                block = Block::new();
                block.push(Statement::If { condition: value, accept, reject }, NOWHERE);
            }
            block
        };
        if matches!(function.expressions[value], Expression::FunctionArgument(_)) {
            let mut all = store(function);
            all.append(&mut body);
            body = all;
        } else {
            rewrite(&mut body, &mut |statement| {
                let computes = match statement {
                    Statement::Emit(range) => range.clone().any(|one| one == value),
                    other => result_of(other) == Some(value),
                };
                if computes { Rewritten::Before(store(function)) } else { Rewritten::AsIs }
            });
        }
        function.body = body;
    }
}

/// The name of the buffer into which a changed pass writes its words.
pub(crate) const TOLD: &str = "karat_told_words";

/// Checks if an argument of a function is a structure that contains the builtin value `id`.
fn holds(types: &naga::UniqueArena<Type>, function: &Function, id: &Option<Binding>) -> bool {
    function.arguments.iter().any(|argument| match &types[argument.ty].inner {
        TypeInner::Struct { members, .. } => members.iter().any(|member| member.binding == *id),
        _ => false,
    })
}

fn untold_pass(entry_point: &str) -> ReflectError {
    let message = format!(
        "`{entry_point}` has `global_invocation_id` in a structure, so Karat can't read values of its invocations"
    );
    let note = "declare `global_invocation_id` as a separate parameter";
    ReflectError::Unprobeable(Box::new(crate::diagnostic::Diagnostic::new(message).note(note)))
}

/// An expression with the bits of a scalar as a `u32`.
fn bits(
    add: &mut dyn FnMut(Expression) -> Handle<Expression>,
    lane: Handle<Expression>,
    scalar: Scalar,
) -> Handle<Expression> {
    let as_bits = |expr, kind, convert| Expression::As { expr, kind, convert };
    match scalar.kind {
        ScalarKind::Bool => add(as_bits(lane, ScalarKind::Uint, Some(4))),
        ScalarKind::Float if scalar.width != 4 => {
            let wide = add(as_bits(lane, ScalarKind::Float, Some(4)));
            add(as_bits(wide, ScalarKind::Uint, None))
        }
        ScalarKind::Uint => lane,
        _ => add(as_bits(lane, ScalarKind::Uint, None)),
    }
}

/// A block that stores the words of an invocation at the invocation's offset in the buffer.
fn leave(
    function: &mut Function,
    (kept, told): (Kept, Handle<GlobalVariable>),
    (id, counts): (u32, [u32; 3]),
    ways: &[Way],
) -> Block {
    let word = |at: usize| u32::try_from(at).expect("a value has far fewer words than 2^32");
    let width = word(ways.len() + 1);
    let mut before = |expression| function.expressions.append(expression, NOWHERE);
    let mut number = |value| before(Expression::Literal(Literal::U32(value)));
    let [columns, rows] = [counts[0], counts[1]].map(&mut number);
    let (width, one) = (number(width), number(1));
    let offsets: Vec<_> = (0..=ways.len()).map(|at| number(word(at))).collect();
    let id = before(Expression::FunctionArgument(id));
    let base = before(Expression::GlobalVariable(told));
    let [value, rounds] =
        [kept.value, kept.rounds].map(|one| before(Expression::GlobalVariable(one)));
    let mut first = None;
    let mut add = |expression| {
        let handle = function.expressions.append(expression, NOWHERE);
        first.get_or_insert(handle);
        handle
    };
    let [x, y, z] = [0, 1, 2].map(|index| add(Expression::AccessIndex { base: id, index }));
    let mut binary = |op, left, right| add(Expression::Binary { op, left, right });
    let row = binary(BinaryOperator::Multiply, z, rows);
    let row = binary(BinaryOperator::Add, row, y);
    let place = binary(BinaryOperator::Multiply, row, columns);
    let place = binary(BinaryOperator::Add, place, x);
    let place = binary(BinaryOperator::Multiply, place, width);
    let left = add(Expression::Load { pointer: rounds });
    let count = add(Expression::Binary { op: BinaryOperator::Add, left, right: one });
    let mut stores = Vec::new();
    for (at, offset) in offsets.into_iter().enumerate() {
        let word = match ways.get(at) {
            None => count,
            Some((way, scalar)) => {
                let mut pointer = value;
                for index in way {
                    pointer = add(Expression::AccessIndex { base: pointer, index: *index });
                }
                let lane = add(Expression::Load { pointer });
                bits(&mut add, lane, *scalar)
            }
        };
        let index = add(Expression::Binary { op: BinaryOperator::Add, left: place, right: offset });
        stores.push((add(Expression::Access { base, index }), word));
    }
    let last = stores.last().map_or(count, |(pointer, _)| *pointer);
    let mut block = Block::new();
    block.push(Statement::Emit(naga::Range::new_from_bounds(first.unwrap_or(last), last)), NOWHERE);
    for (pointer, value) in stores {
        block.push(Statement::Store { pointer, value }, NOWHERE);
    }
    block
}

/// Changes the result type of a fragment function to a structure of its previous outputs and the words. Returns the new
/// type, the type of the words, and the index of each previous output in the previous result. The index is `None` if
/// the previous result isn't a structure.
fn returning(
    module: &mut Module,
    function: &mut Function,
    telling: Telling<'_>,
) -> ([Handle<Type>; 2], Vec<Option<u32>>) {
    let inner = TypeInner::Vector { size: VectorSize::Quad, scalar: Scalar::U32 };
    let words = module.types.insert(Type { name: None, inner }, NOWHERE);
    let member = |name: &str, ty, binding| StructMember {
        name: Some(name.to_owned()),
        ty,
        binding,
        offset: 0,
    };
    let mut all: Vec<(Option<u32>, StructMember)> = Vec::new();
    if let Some(result) = &function.result {
        match (&result.binding, &module.types[result.ty].inner) {
            (None, TypeInner::Struct { members, .. }) => {
                all.extend((0..).map(Some).zip(members.iter().cloned()));
            }
            (binding, _) => all.push((None, member("karat_own", result.ty, binding.clone()))),
        }
    }
    let is_location =
        |member: &StructMember| matches!(member.binding, Some(Binding::Location { .. }));
    all.retain(|(_, member)| !(telling.alone && is_location(member)));
    let at = |location: &u32| Binding::Location {
        location: *location,
        interpolation: None,
        sampling: None,
        blend_src: None,
        per_primitive: false,
    };
    let (kept, mut members): (Vec<_>, Vec<_>) = all.into_iter().unzip();
    let told = |location| member(&format!("karat_told_{location}"), words, Some(at(location)));
    members.extend(telling.locations.iter().map(told));
    // No host sees the structure, but naga's validator requires the layout.
    let mut layouter = Layouter::default();
    let mut span = 0;
    if layouter.update(module.to_ctx()).is_ok() {
        for member in &mut members {
            let layout = layouter[member.ty];
            member.offset = layout.alignment.round_up(span);
            span = member.offset + layout.size;
        }
    }
    let span = span.next_multiple_of(16); // the alignment of the words, which is the largest that there is
    let name = Some(format!("karat_told_{}", function.name.as_deref().unwrap_or("fragment")));
    let inner = TypeInner::Struct { members, span };
    let ty = module.types.insert(Type { name, inner }, NOWHERE);
    function.result = Some(FunctionResult { ty, binding: None });
    ([ty, words], kept)
}

fn tell(
    module: &mut Module,
    function: &mut Function,
    (values, number): (&[(Kept, Vec<Way>)], u32),
    telling: Telling<'_>,
) {
    let ([ty, words_type], kept) = returning(module, function, telling);
    let mut body = std::mem::take(&mut function.body);
    rewrite(&mut body, &mut |statement| {
        let Statement::Return { value: returned } = statement else { return Rewritten::AsIs };
        let mut first = None;
        // Appends an expression that needs no `Emit` statement. Such expressions come before all other new expressions.
        let mut before = |expression| function.expressions.append(expression, NOWHERE);
        let zero = before(Expression::Literal(Literal::U32(0)));
        let one = before(Expression::Literal(Literal::U32(1)));
        let number = before(Expression::Literal(Literal::U32(number)));
        let mut variable = |one| before(Expression::GlobalVariable(one));
        let variables: Vec<_> =
            values.iter().map(|(kept, _)| (variable(kept.value), variable(kept.rounds))).collect();
        let mut add = |expression| {
            let handle = function.expressions.append(expression, NOWHERE);
            first.get_or_insert(handle);
            handle
        };
        // The scalars of each value, and then the iterations of the value.
        let mut places: Vec<(usize, Option<&Way>)> = Vec::new();
        for (index, (_, ways)) in values.iter().enumerate() {
            places.extend(ways.iter().map(|way| (index, Some(way))));
            places.push((index, None));
        }
        let mut word = |at: usize| match places.get(at) {
            None if at == 0 => number,
            None => zero,
            Some((index, None)) => {
                let left = add(Expression::Load { pointer: variables[*index].1 });
                add(Expression::Binary { op: BinaryOperator::Add, left, right: one })
            }
            Some((index, Some((way, scalar)))) => {
                let mut pointer = variables[*index].0;
                for index in way {
                    pointer = add(Expression::AccessIndex { base: pointer, index: *index });
                }
                let lane = add(Expression::Load { pointer });
                bits(&mut add, lane, *scalar)
            }
        };
        let count = WORDS * telling.locations.len();
        let words: Vec<_> = (telling.first..telling.first + count).map(&mut word).collect();
        let mut components = Vec::new();
        for index in &kept {
            let Some(own) = *returned else { continue };
            components.push(match index {
                None => own,
                Some(index) => add(Expression::AccessIndex { base: own, index: *index }),
            });
        }
        for words in words.chunks_exact(WORDS) {
            components.push(add(Expression::Compose { ty: words_type, components: words.into() }));
        }
        let last = add(Expression::Compose { ty, components });
        let start = first.unwrap_or(last);
        let mut block = Block::new();
        block.push(Statement::Emit(naga::Range::new_from_bounds(start, last)), NOWHERE);
        block.push(Statement::Return { value: Some(last) }, NOWHERE);
        Rewritten::Instead(block)
    });
    function.body = body;
}

enum Rewritten {
    AsIs,
    /// Keeps the statement, and inserts this block after it.
    Before(Block),
    Instead(Block),
}

fn rewrite(block: &mut Block, with: &mut dyn FnMut(&Statement) -> Rewritten) {
    let mut all = Block::new();
    for (mut statement, span) in std::mem::take(block).span_into_iter() {
        match &mut statement {
            Statement::Block(inner) => rewrite(inner, with),
            Statement::If { accept, reject, .. } => {
                rewrite(accept, with);
                rewrite(reject, with);
            }
            Statement::Switch { cases, .. } => {
                cases.iter_mut().for_each(|case| rewrite(&mut case.body, with));
            }
            Statement::Loop { body, continuing, .. } => {
                rewrite(body, with);
                rewrite(continuing, with);
            }
            _ => {}
        }
        match with(&statement) {
            Rewritten::AsIs => all.push(statement, span),
            Rewritten::Before(mut more) => {
                all.push(statement, span);
                all.append(&mut more);
            }
            Rewritten::Instead(mut other) => all.append(&mut other),
        }
    }
    *block = all;
}
