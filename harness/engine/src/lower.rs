//! Lowers naga's IR to a [`Code`]: calls are inlined, and values become registers.
//!
//! After calls are inlined, the pointers, textures and samplers that functions receive are known. So they don't exist
//! at run time. [`MOST_OPERATIONS`] limits the size of the result.

mod control;
mod derivative;
mod expression;
mod image;
mod math;
mod memory;
mod operator;
mod subgroup;
mod wrap;

use std::collections::HashMap;
use std::rc::Rc;

use naga::{
    AddressSpace, Arena, Expression, Function, Handle, Module, Override, Span, TypeInner,
    proc::TypeResolution,
    valid::{FunctionInfo, ModuleInfo},
};

use crate::code::{BufferSlot, Code, Constant, HandleSlot, Instruction, Op, Reg, Site};
use crate::coverage::{Statement, StatementKind};
use crate::refusal::Refusal;
use crate::scalar::{Counts, File, Layouts, Scalar};
use memory::Place;

/// The largest number of operations of a program with inlined calls. The largest shaders of game engines have about a
/// tenth of this number. Lowering takes about one second for this number of operations.
const MOST_OPERATIONS: usize = 1 << 20;

/// The largest size of workgroup memory, in bytes. The default limit of WebGPU is 16 KiB, and GPUs allow a few times as
/// much.
const MOST_WORKGROUP_BYTES: u64 = 1 << 20;

/// The stack that one level of nested statements needs, and the size of an additional stack, in bytes. If less than the
/// first number is free, lowering allocates an additional stack.
pub(crate) const STACK: (usize, usize) = (128 << 10, 2 << 20);

/// The values of overrides, by name, or by the override's id in decimal.
pub type Overrides = HashMap<String, f64>;

/// Settings for lowering a program.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// The values of overrides, by name, or by the id in decimal if the override has one.
    pub overrides: Overrides,
    /// `true` if `a * b + c` is rounded only once, as on many GPUs.
    pub contract: bool,
    /// Prefixes of names. If the name of a let-binding begins with one of these prefixes, observers receive the
    /// let-binding's value. These values count as results of the program.
    pub named: &'static [&'static str],
    /// `true` if four successive cases are a quad of pixels: the upper left pixel, the pixel on its right, and the two
    /// pixels below. Derivatives need this.
    pub quads: bool,
    /// `true` for programs that Karat compares with other programs. Then lowering applies identities, so that
    /// equivalent operations become equal (`x * 2` becomes `x + x`), and private variables count as results.
    pub identities: bool,
    /// `true` to list the program's statements, so that runs can count how often each statement runs.
    pub statements: bool,
}

#[derive(Clone, Debug)]
pub(crate) enum Value {
    /// The registers of the value's scalars, in order.
    Flat(Rc<[Reg]>),
    Place(Rc<Place>),
    Texture(u32, Handle<naga::Type>),
    Sampler(u32),
}

/// The expressions of a function or of the module, with the values of those that are already lowered.
pub(crate) struct Scope<'m> {
    name: String,
    call: usize,
    expressions: &'m Arena<Expression>,
    types: Types<'m>,
    function: Option<&'m Function>,
    values: Vec<Option<Value>>,
    arguments: Vec<Value>,
    locals: HashMap<Handle<naga::LocalVariable>, Rc<Place>>,
    /// The registers in which each `return` stores the result. `None` if the function returns only at its end.
    result: Option<Rc<[Reg]>>,
    returned: Option<Value>,
    /// `true` if the function also returns before its end. Then a call of the function is a construct (like a loop),
    /// from which a return jumps out.
    early: bool,
}

#[derive(Clone, Copy)]
enum Types<'m> {
    Function(&'m FunctionInfo),
    Module(&'m ModuleInfo),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Frame {
    If,
    Switch,
    Loop,
    Call,
}

struct Open {
    frame: Frame,
    /// The operations that jump to the end of the construct's current part, such as a branch, if no lane is active.
    skips: Vec<usize>,
}

pub(crate) struct Lower<'m> {
    module: &'m Module,
    info: &'m ModuleInfo,
    settings: &'m Settings,
    layouts: Layouts<'m>,
    code: Code,
    constants: HashMap<(Constant, File), Reg>,
    words: HashMap<Reg, Constant>,
    /// For integer registers whose value may have wrapped around: the operation that computed the register.
    computed: HashMap<Reg, wrap::Computed>,
    globals: HashMap<Handle<naga::GlobalVariable>, Value>,
    overrides: HashMap<Handle<Override>, Value>,
    constant_values: HashMap<Handle<naga::Constant>, Value>,
    open: Vec<Open>,
    calls: usize,
    sizes: Option<[Option<Handle<Expression>>; 3]>,
    /// `true` if the program is an entry point, whose invocations share memory.
    shared: bool,
    /// `true` for a fragment entry point. Its invocations are the pixels of quads.
    drawn: bool,
    site: u32,
    span: Span,
}

type Lowered<T> = Result<T, Refusal>;

impl<'m> Lower<'m> {
    pub(crate) fn new(
        module: &'m Module,
        info: &'m ModuleInfo,
        settings: &'m Settings,
        shared: bool,
    ) -> Self {
        let mut code = Code::default();
        code.sites.push(Site {
            number: code.sites.len(),
            function: String::new(),
            expression: None,
            name: None,
            span: Span::UNDEFINED,
            half: false,
        });
        Self {
            module,
            info,
            settings,
            layouts: Layouts::new(module),
            code,
            constants: HashMap::new(),
            words: HashMap::new(),
            computed: HashMap::new(),
            globals: HashMap::new(),
            overrides: HashMap::new(),
            constant_values: HashMap::new(),
            open: Vec::new(),
            calls: 0,
            sizes: None,
            shared,
            drawn: false,
            site: 0,
            span: Span::UNDEFINED,
        }
    }

    /// Lowers a compute or fragment entry point as the whole program.
    pub(crate) fn entry_point(
        mut self,
        point: &'m naga::EntryPoint,
        info: &'m FunctionInfo,
    ) -> Lowered<Code> {
        self.drawn = point.stage == naga::ShaderStage::Fragment;
        self.code.workgroup = point.workgroup_size;
        self.sizes = point.workgroup_size_overrides;
        self.program(&point.function, info, &point.name)
    }

    /// Evaluates an expression of the module. The expression may depend on overrides.
    fn evaluated(&mut self, register: Reg) -> Lowered<Constant> {
        if let Some(constant) = self.words.get(&register) {
            return Ok(*constant);
        }
        // The expression's operations are lowered already, so they only have to run.
        let scalar = match register.file {
            File::Float => Scalar::F32,
            File::Int => Scalar::U32,
            File::Bool => Scalar::Bool,
        };
        let mut code = self.code.clone();
        code.instructions.push(Instruction {
            op: Op::Halt,
            at: 0,
            count: 0,
            target: u32::MAX,
            site: 0,
        });
        code.results.push((register, scalar));
        match crate::program::evaluated(crate::allocate::allocated(code)) {
            Some(word) => Ok(Constant { scalar, word }),
            None => Err(self.refuse("an override expression that can't be evaluated")),
        }
    }

    /// Lowers `function` as the whole program. The parameters of the function become the parameters of the program.
    pub(crate) fn program(
        mut self,
        function: &'m Function,
        info: &'m FunctionInfo,
        name: &str,
    ) -> Lowered<Code> {
        self.prologue(info)?;
        let mut arguments = Vec::new();
        for argument in &function.arguments {
            self.span = self.module.types.get_span(argument.ty);
            let inner = self.layouts.inner(argument.ty);
            if !matches!(
                inner,
                TypeInner::Scalar(_)
                    | TypeInner::Vector { .. }
                    | TypeInner::Matrix { .. }
                    | TypeInner::Array { .. }
                    | TypeInner::Struct { .. }
            ) {
                return Err(
                    self.refuse(format!("a parameter of type {}", crate::scalar::kind(inner)))
                );
            }
            let scalars = self.scalars(inner)?;
            let registers: Rc<[Reg]> =
                scalars.iter().map(|scalar| self.fresh(scalar.file())).collect();
            self.code.parameters.extend(registers.iter().copied().zip(scalars));
            arguments.push(Value::Flat(registers));
        }
        let result = self.inline(function, info, name, arguments)?;
        if let (Some(Value::Flat(registers)), Some(result)) = (result, &function.result) {
            let scalars = self.scalars(self.layouts.inner(result.ty))?;
            // Each result gets a register of its own, so an operation writes each result.
            for (register, scalar) in registers.iter().zip(scalars) {
                let own = self.fresh(register.file);
                self.emit(Op::Move(register.file), &[own], &[*register])?;
                self.code.results.push((own, scalar));
            }
        }
        if self.settings.identities {
            self.private_results()?;
        }
        self.emit(Op::Halt, &[], &[])?;
        Ok(self.code)
    }

    /// Adds the private variables to the program's results, because the caller of a function sees their final values.
    fn private_results(&mut self) -> Lowered<()> {
        let module = self.module;
        for (handle, variable) in module.global_variables.iter() {
            let Some(Value::Place(place)) = self.globals.get(&handle).cloned() else { continue };
            if variable.space != AddressSpace::Private {
                continue;
            }
            if let Value::Flat(registers) = self.load(&place)? {
                for register in registers.iter() {
                    let own = self.fresh(register.file);
                    self.emit(Op::Move(register.file), &[own], &[*register])?;
                    let scalar = match register.file {
                        File::Float => Scalar::F32,
                        File::Int => Scalar::U32,
                        File::Bool => Scalar::Bool,
                    };
                    self.code.results.push((own, scalar));
                }
            }
        }
        Ok(())
    }

    /// Lowers the overrides and private variables that the function uses. Their operations come before all other
    /// operations of the program.
    fn prologue(&mut self, info: &FunctionInfo) -> Lowered<()> {
        let mut scope = self.module_scope();
        for (handle, declared) in self.module.overrides.iter() {
            self.span = self.module.overrides.get_span(handle);
            let given = declared
                .id
                .and_then(|id| self.settings.overrides.get(&id.to_string()))
                .or_else(|| declared.name.as_ref().and_then(|n| self.settings.overrides.get(n)));
            let inner = self.layouts.inner(declared.ty);
            let value = match (given, declared.init) {
                (Some(&given), _) => {
                    let scalar = self.scalars(inner)?[0];
                    Value::Flat(Rc::new([self.constant(scalar, override_word(scalar, given))]))
                }
                (None, Some(init)) => self.value(&mut scope, init)?,
                (None, None) => continue,
            };
            let Value::Flat(registers) = &value else { continue };
            let word = self.evaluated(registers[0])?.word;
            self.layouts.lengths.insert(handle, word);
            let scalar = self.scalars(inner)?[0];
            let constant = self.constant(scalar, word);
            self.overrides.insert(handle, Value::Flat(Rc::new([constant])));
        }
        for k in 0..3 {
            if let Some(size) = self.sizes.and_then(|sizes| sizes[k]) {
                let register = self.flat(&mut scope, size)?[0];
                self.code.workgroup[k] = self.evaluated(register)?.word;
            }
        }
        for (handle, variable) in self.module.global_variables.iter() {
            if info[handle].is_empty() {
                continue;
            }
            self.span = self.module.global_variables.get_span(handle);
            let value = self.global(handle, variable, &mut scope)?;
            self.globals.insert(handle, value);
        }
        Ok(())
    }

    fn global(
        &mut self,
        handle: Handle<naga::GlobalVariable>,
        variable: &'m naga::GlobalVariable,
        scope: &mut Scope<'m>,
    ) -> Lowered<Value> {
        // A variable that replaces a pointer parameter has no name.
        let name = variable.name.clone().unwrap_or_default();
        let span = self.module.global_variables.get_span(handle);
        let inner = self.layouts.inner(variable.ty);
        let slot = |binding: &naga::ResourceBinding| HandleSlot {
            written: false,
            image: image_of(inner),
            group: binding.group,
            binding: binding.binding,
            name: name.clone(),
            span,
        };
        match (variable.space, inner) {
            (AddressSpace::Private, _) => {
                let init = match variable.init {
                    Some(init) => Some(self.value(scope, init)?),
                    None => None,
                };
                self.variable(inner, init)
            }
            (AddressSpace::Handle, TypeInner::Image { .. }) => {
                let Some(binding) = &variable.binding else {
                    return Err(self.refuse("a texture without a binding"));
                };
                self.code.textures.push(slot(binding));
                Ok(Value::Texture(self.code.textures.len() as u32 - 1, variable.ty))
            }
            (AddressSpace::Handle, TypeInner::Sampler { .. }) => {
                let Some(binding) = &variable.binding else {
                    return Err(self.refuse("a sampler without a binding"));
                };
                self.code.samplers.push(slot(binding));
                Ok(Value::Sampler(self.code.samplers.len() as u32 - 1))
            }
            (AddressSpace::Handle, other) => {
                Err(self.refuse(format!("a resource of type {}", crate::scalar::kind(other))))
            }
            (AddressSpace::Uniform | AddressSpace::Storage { .. }, _) => {
                let Some(binding) = &variable.binding else {
                    return Err(self.refuse("a buffer without a binding"));
                };
                let binding = crate::code::Binding::Resource {
                    group: binding.group,
                    binding: binding.binding,
                };
                Ok(self.buffer(binding, name, span, inner))
            }
            (AddressSpace::Immediate, _) => {
                let [group, binding] = crate::Resources::IMMEDIATE;
                let binding = crate::code::Binding::Resource { group, binding };
                Ok(self.buffer(binding, name, span, inner))
            }
            (AddressSpace::WorkGroup, _) => {
                if !self.shared {
                    return Err(self.refuse(format!(
                        "a function with the workgroup variable `{name}`, because all cases would share the variable"
                    )));
                }
                let place = self.buffer(crate::code::Binding::Workgroup, name, span, inner);
                let total: u64 = self.code.buffers.iter().map(|slot| slot.workgroup_bytes()).sum();
                if total > MOST_WORKGROUP_BYTES {
                    return Err(
                        self.refuse(format!("workgroup variables of {total} bytes in total"))
                    );
                }
                Ok(place)
            }
            (space, _) => Err(self.refuse(format!("a variable in address space {space:?}"))),
        }
    }

    fn buffer(
        &mut self,
        binding: crate::code::Binding,
        name: String,
        span: Span,
        inner: &TypeInner,
    ) -> Value {
        let least = match *inner {
            // An override may give the array's length, which naga doesn't know here.
            TypeInner::Array { size, stride, .. } => match self.layouts.length(size) {
                Ok(Some(length)) => length.saturating_mul(stride),
                _ => 0,
            },
            _ => inner.try_size(self.module.to_ctx()).unwrap_or(0),
        };
        self.code.buffers.push(BufferSlot { binding, name, span, least, written: false });
        let slot = self.code.buffers.len() as u32 - 1;
        Value::Place(Rc::new(Place::buffer(slot, inner.clone())))
    }

    /// Makes the registers of a local or private variable. The initial value is `init`, or zero if `init` is `None`.
    fn variable(&mut self, inner: &TypeInner, init: Option<Value>) -> Lowered<Value> {
        let scalars = self.scalars(inner)?;
        let counts = self.counts(inner)?;
        let base = self.code.registers;
        self.code.registers = std::array::from_fn(|k| base[k] + counts[k]);
        let place = Place::local(base, counts, inner.clone());
        let registers = place.registers(&scalars, [0; 3]);
        let init = match init {
            Some(Value::Flat(init)) => init,
            _ => scalars.iter().map(|&scalar| self.constant(scalar, 0)).collect(),
        };
        for (to, from) in registers.iter().zip(init.iter()) {
            self.emit(Op::Move(to.file), &[*to], &[*from])?;
        }
        Ok(Value::Place(Rc::new(place)))
    }

    fn module_scope(&self) -> Scope<'m> {
        let expressions = &self.module.global_expressions;
        Scope {
            name: String::new(),
            call: 0,
            expressions,
            types: Types::Module(self.info),
            function: None,
            values: vec![None; expressions.len()],
            arguments: Vec::new(),
            locals: HashMap::new(),
            result: None,
            returned: None,
            early: false,
        }
    }

    fn refuse(&self, what: impl Into<String>) -> Refusal {
        Refusal::new(what, self.span)
    }

    fn counts(&self, inner: &TypeInner) -> Lowered<Counts> {
        self.layouts.counts(inner).map_err(|what| self.refuse(what))
    }

    fn scalars(&self, inner: &TypeInner) -> Lowered<Vec<Scalar>> {
        self.layouts.scalars(inner).map_err(|what| self.refuse(what))
    }

    fn scalar(&self, scalar: naga::Scalar) -> Lowered<Scalar> {
        Scalar::of(scalar).map_err(|what| self.refuse(what))
    }

    fn fresh(&mut self, file: File) -> Reg {
        let index = &mut self.code.registers[file as usize];
        *index += 1;
        Reg { file, index: *index - 1 }
    }

    /// The register of a constant. For a float of half precision, `word` has the bits of the equal `f32`.
    fn constant(&mut self, scalar: Scalar, word: u32) -> Reg {
        let constant = Constant { scalar, word };
        let key = (constant, scalar.file());
        if let Some(&found) = self.constants.get(&key) {
            return found;
        }
        let register = self.fresh(scalar.file());
        self.constants.insert(key, register);
        self.words.insert(register, constant);
        self.code.constants.push((register, constant));
        register
    }

    fn float(&mut self, x: f32) -> Reg {
        self.constant(Scalar::F32, x.to_bits())
    }

    /// Appends an operation. `outs` and `ins` must each list floats first, then integers, then booleans.
    fn emit(&mut self, op: Op, outs: &[Reg], ins: &[Reg]) -> Lowered<usize> {
        if self.code.instructions.len() >= MOST_OPERATIONS {
            return Err(self.refuse(format!(
                "a program of more than {MOST_OPERATIONS} operations after its calls are inlined"
            )));
        }
        let at = self.code.pool.len() as u32;
        self.code.pool.extend(outs.iter().chain(ins).map(|register| register.index));
        self.code.instructions.push(Instruction {
            op,
            at,
            count: 0,
            target: u32::MAX,
            site: self.site,
        });
        Ok(self.code.instructions.len() - 1)
    }

    /// Adds a statement to the program's list of statements, if the settings ask for this list. The statement's
    /// operations are those from index `start` to the last operation so far.
    fn list(&mut self, scope: &Scope<'m>, span: Span, kind: StatementKind, start: usize) {
        if self.settings.statements && span.is_defined() {
            let end = self.code.instructions.len() as u32;
            let (function, start) = (scope.name.clone(), start as u32);
            let call = scope.call;
            let listed = Statement { function, call, span, kind, needed: true, start, end };
            self.code.statements.push(listed);
        }
    }

    fn type_of(&self, scope: &Scope<'m>, handle: Handle<Expression>) -> TypeInner {
        let resolution: &TypeResolution = match scope.types {
            Types::Function(info) => &info[handle].ty,
            Types::Module(info) => &info[handle],
        };
        resolution.inner_with(&self.module.types).clone()
    }
}

fn image_of(inner: &TypeInner) -> Option<(naga::ImageDimension, naga::ScalarKind)> {
    let TypeInner::Image { dim, class, .. } = *inner else { return None };
    let kind = match class {
        naga::ImageClass::Sampled { kind, .. } => kind,
        naga::ImageClass::Depth { .. } | naga::ImageClass::External => naga::ScalarKind::Float,
        naga::ImageClass::Storage { format, .. } => naga::Scalar::from(format).kind,
    };
    Some((dim, kind))
}

/// Converts an override's value from `f64` to the override's type, as the bits of a `u32`.
fn override_word(scalar: Scalar, given: f64) -> u32 {
    match scalar {
        Scalar::F32 => (given as f32).to_bits(),
        Scalar::F16 => half::f16::from_f64(given).to_f32().to_bits(),
        Scalar::I32 => (given as i32).cast_unsigned(),
        Scalar::U32 => given as u32,
        Scalar::Bool => u32::from(given != 0.0),
    }
}
