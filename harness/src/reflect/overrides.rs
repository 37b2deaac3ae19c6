//! Sets the values of `override` declarations. A host sets these values when it creates a pipeline.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::{Arena, Expression, Handle, Literal, Module, Override, ScalarKind, TypeInner};

use super::signature::scalar_of;
use super::{NAMED, Program, ReflectError};
use crate::diagnostic::{Diagnostic, nearest};
use crate::package::Package;
use crate::value::Scalar;

/// Values of overrides, by the name of the override or by its `@id`.
pub type Overrides = BTreeMap<String, f64>;

impl Program {
    /// A copy of the program in which the overrides have the given values. Each override needs a value or an
    /// initialiser.
    pub fn overridden(self: &Arc<Self>, given: &Overrides) -> Result<Arc<Self>, ReflectError> {
        let declared = &self.checked.module.overrides;
        if given.is_empty() && declared.iter().all(|(_, declared)| declared.init.is_some()) {
            return Ok(Arc::clone(self));
        }
        let mut values = Overrides::new();
        for (name, value) in given {
            // The name of an override and its `@id` mean the same override.
            let text_name = self.text_name(name)?;
            if values.get(&text_name).is_some_and(|other| other.to_bits() != value.to_bits()) {
                let message = format!(
                    "the override `{name}` has two values, because you set it by two of its names"
                );
                return Err(ReflectError::Override(Box::new(Diagnostic::new(message))));
            }
            values.insert(text_name, *value);
        }
        for (handle, declared) in declared.iter() {
            let name = declared.name.as_deref().expect(NAMED);
            if declared.init.is_none() && !values.contains_key(name) {
                let name = self.override_name(declared);
                let message = format!("the override `{name}` has no value");
                let note = format!(
                    "set the value: with `with_override` in Rust, `override` in a test file, or `--override {name}=...` in a command"
                );
                return Err(self.told(handle, Diagnostic::new(message).note(note)));
            }
        }
        let mut module = self.checked.module.clone();
        if let Err((handle, reason)) = set(&mut module, &values) {
            return Err(self.told(handle, Diagnostic::new(reason)));
        }
        let program = Self::from_ir(self.linked.clone(), module)?;
        Ok(Arc::new(Self { overrides: values, ..program }))
    }

    /// The values of the program's overrides, with the keys that WebGPU uses: an override's `@id` or, without an `@id`,
    /// its name in the linked text.
    pub(crate) fn constants(&self) -> Overrides {
        let key = |name: &String| {
            let mut declared = self.checked.module.overrides.iter();
            let own = declared.find(|(_, one)| one.name.as_ref() == Some(name));
            own.and_then(|(_, one)| one.id).map_or_else(|| name.clone(), |id| id.to_string())
        };
        self.overrides.iter().map(|(name, value)| (key(name), *value)).collect()
    }

    /// Checks if the override has no initial value.
    pub fn wants_override(&self, name: &str) -> bool {
        let Ok(name) = self.text_name(name) else { return false };
        let mut all = self.checked.module.overrides.iter();
        all.any(|(_, one)| one.name.as_ref() == Some(&name) && one.init.is_none())
    }

    /// The name of each override in the author's code, with the rest of its declaration: `@id(3) f32 = 1.0`.
    pub fn declared_overrides(&self) -> Vec<(String, String)> {
        let module = &self.checked.module;
        let of = |declared: &Override| {
            let name = self.override_name(declared);
            let id = declared.id.map_or_else(String::new, |id| format!("@id({id}) "));
            let scalar = match module.types[declared.ty].inner {
                TypeInner::Scalar(scalar) => scalar_of(scalar).ok(),
                _ => None,
            };
            let scalar = scalar
                .map_or_else(String::new, |scalar| crate::value::Shape::Scalar(scalar).to_string());
            let range = |init| module.global_expressions.get_span(init).to_range();
            let init = declared.init.and_then(range).and_then(|range| self.text().get(range));
            let init = init.map_or_else(String::new, |init| format!(" = {init}"));
            (name, format!("{id}{scalar}{init}"))
        };
        module.overrides.iter().map(|(_, declared)| of(declared)).collect()
    }

    /// The type of the override with this name in the author's file, or with this `@id`. `None` if no override has
    /// the name or the `@id`.
    #[must_use]
    pub fn override_type(&self, name: &str) -> Option<Scalar> {
        let name = self.text_name(name).ok()?;
        let module = &self.checked.module;
        let is_it = |declared: &&Override| declared.name.as_deref() == Some(name.as_str());
        let declared = module.overrides.iter().map(|(_, declared)| declared).find(is_it)?;
        match module.types[declared.ty].inner {
            TypeInner::Scalar(scalar) => scalar_of(scalar).ok(),
            _ => None,
        }
    }

    /// The first error in the given values, as a sentence. This method doesn't report overrides without a value.
    fn misfit(&self, given: &Overrides) -> Option<String> {
        let mut values = Overrides::new();
        for (name, value) in given {
            let other = values.insert(self.text_name(name).ok()?, *value);
            if other.is_some_and(|other| other.to_bits() != value.to_bits()) {
                return Some(format!(
                    "the override `{name}` has two values, because you set it by two of its names"
                ));
            }
        }
        let mut module = self.checked.module.clone();
        set(&mut module, &values).err().map(|(_, reason)| reason)
    }

    /// The first of the given overrides that no package accepts, with the reason. A package doesn't accept an override
    /// that it doesn't declare, or a value that doesn't fit the override's type.
    pub fn unfit(packages: &[&Package], given: &Overrides) -> Option<(String, String)> {
        if given.is_empty() {
            return None;
        }
        let (mut programs, mut invalid) = (Vec::new(), Vec::new());
        for package in packages {
            for module in package.modules().unwrap_or_default() {
                match Self::of_module(&package.for_validating(&module), &module) {
                    Ok(program) => programs.push(program),
                    Err(_) => invalid.push(format!("`{module}`")),
                }
            }
        }
        given.iter().find_map(|(name, value)| {
            let mut own = programs.iter().filter(|program| program.has_override(name)).peekable();
            let why = match own.peek() {
                None => {
                    let all = programs.iter().flat_map(|program| program.declared_overrides());
                    let all: Vec<String> = all.map(|(name, _)| name).collect();
                    let near = nearest(name, all.iter().map(String::as_str));
                    let near =
                        near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
                    let unseen = match &*invalid {
                        [] => String::new(),
                        all => format!(
                            " (Karat can't search these invalid modules: {})",
                            all.join(", ")
                        ),
                    };
                    format!(
                        "no function and no entry point uses an override `{name}`{near}{unseen}"
                    )
                }
                Some(_) => own.find_map(|program| {
                    let alone = program.misfit(&Overrides::from([(name.clone(), *value)]));
                    let all = given.iter().filter(|(other, _)| program.has_override(other));
                    let all = || program.misfit(&all.map(|(a, b)| (a.clone(), *b)).collect());
                    alone.or_else(all)
                })?,
            };
            Some((name.clone(), why))
        })
    }

    /// Checks if the program has an override with this name in the author's file, or with this `@id`.
    pub fn has_override(&self, name: &str) -> bool {
        !self.overrides_called(name).is_empty()
    }

    /// The overrides with this name in the author's file, or with this `@id`. Several modules may declare an override
    /// of this name.
    fn overrides_called(&self, name: &str) -> Vec<&Override> {
        let all = || self.checked.module.overrides.iter().map(|(_, declared)| declared);
        let is_exact = |one: &&Override| {
            self.override_path(one) == name || one.id.is_some_and(|id| id.to_string() == name)
        };
        match all().find(is_exact) {
            Some(one) => vec![one],
            None => all().filter(|one| last(self.override_path(one)) == name).collect(),
        }
    }

    fn override_path<'o>(&'o self, declared: &'o Override) -> &'o str {
        let text = declared.name.as_deref().expect(NAMED);
        self.author_path(text).unwrap_or(text)
    }

    /// The override's name, or its path if another override has the same name.
    fn override_name(&self, declared: &Override) -> String {
        let path = self.override_path(declared);
        let own = last(path);
        if self.overrides_called(own).len() > 1 { path.to_owned() } else { own.to_owned() }
    }

    fn text_name(&self, name: &str) -> Result<String, ReflectError> {
        let wrong = |message| Err(ReflectError::Override(Box::new(Diagnostic::new(message))));
        match &*self.overrides_called(name) {
            [] => {}
            [one] => return Ok(one.name.clone().expect(NAMED)),
            several => {
                let paths = several.iter().map(|one| format!("`{}`", self.override_path(one)));
                let paths = paths.collect::<Vec<_>>().join(" and ");
                return wrong(format!(
                    "several overrides have the name `{name}`: use one of the paths {paths}"
                ));
            }
        }
        let all = self.checked.module.overrides.iter();
        let known: Vec<&str> = all.map(|(_, one)| last(self.override_path(one))).collect();
        let nearest = nearest(name, known.iter().copied());
        let nearest = nearest.map_or_else(String::new, |n| format!("; did you mean `{n}`?"));
        wrong(format!("the called function uses no override `{name}`{nearest}"))
    }

    fn told(&self, handle: Handle<Override>, diagnostic: Diagnostic) -> ReflectError {
        let range = self.checked.module.overrides.get_span(handle).to_range();
        let span = range.and_then(|range| self.resolve(range));
        let diagnostic = match span {
            Some(span) => diagnostic.at(span, "declared here"),
            None => diagnostic,
        };
        ReflectError::Override(Box::new(diagnostic))
    }
}

fn last(path: &str) -> &str {
    path.rsplit("::").next().unwrap_or(path)
}

/// Replaces the initialisers of overrides by the given values. The keys are the overrides' names in the linked text.
pub(super) fn set(
    module: &mut Module,
    values: &Overrides,
) -> Result<(), (Handle<Override>, String)> {
    let mut given = Vec::new();
    for (handle, declared) in module.overrides.iter() {
        let name = declared.name.clone().expect(NAMED);
        let Some(value) = values.get(&name) else { continue };
        let TypeInner::Scalar(scalar) = module.types[declared.ty].inner else { continue };
        let literal = literal(scalar, *value).ok_or_else(|| {
            let kind = match scalar.kind {
                ScalarKind::Sint => "an i32",
                ScalarKind::Uint => "a u32",
                ScalarKind::Bool => "a bool (0 or 1)",
                _ => "a finite float",
            };
            (handle, format!("the override `{name}` must be {kind}, but is {value}"))
        })?;
        given.push((handle, literal));
    }
    // naga requires an initialiser before every use of its override, so these expressions come first.
    let mut expressions = Arena::new();
    let mut initialisers = Vec::new();
    for (handle, literal) in given {
        let span = module.overrides.get_span(handle);
        initialisers.push((handle, expressions.append(Expression::Literal(literal), span)));
    }
    let mut moved = Vec::new();
    for (handle, expression) in module.global_expressions.iter() {
        let expression = moved_to(expression.clone(), &moved);
        moved.push(expressions.append(expression, module.global_expressions.get_span(handle)));
    }
    module.global_expressions = expressions;
    let to = |handle: &mut Handle<Expression>| *handle = moved[handle.index()];
    let constants: Vec<_> = module.constants.iter().map(|(handle, _)| handle).collect();
    constants.into_iter().for_each(|handle| to(&mut module.constants.get_mut(handle).init));
    let variables = module.global_variables.iter_mut();
    variables.filter_map(|(_, variable)| variable.init.as_mut()).for_each(to);
    let overrides = module.overrides.iter_mut();
    overrides.filter_map(|(_, declared)| declared.init.as_mut()).for_each(to);
    for entry_point in &mut module.entry_points {
        let sizes = entry_point.workgroup_size_overrides.iter_mut().flatten();
        sizes.flatten().for_each(to);
        if let Some(mesh) = &mut entry_point.mesh_info {
            mesh.max_vertices_override.iter_mut().for_each(to);
            mesh.max_primitives_override.iter_mut().for_each(to);
        }
    }
    for (handle, initialiser) in initialisers {
        module.overrides.get_mut(handle).init = Some(initialiser);
    }
    Ok(())
}

fn moved_to(mut expression: Expression, moved: &[Handle<Expression>]) -> Expression {
    let to = |handle: &mut Handle<Expression>| *handle = moved[handle.index()];
    match &mut expression {
        Expression::Compose { components, .. } => components.iter_mut().for_each(to),
        Expression::Splat { value, .. } => to(value),
        Expression::Swizzle { vector, .. } => to(vector),
        Expression::Access { base, index } => [base, index].into_iter().for_each(to),
        Expression::AccessIndex { base, .. } => to(base),
        Expression::Unary { expr, .. } | Expression::As { expr, .. } => to(expr),
        Expression::Binary { left, right, .. } => [left, right].into_iter().for_each(to),
        Expression::Select { condition, accept, reject } => {
            [condition, accept, reject].into_iter().for_each(to);
        }
        Expression::Relational { argument, .. } => to(argument),
        Expression::Math { arg, arg1, arg2, arg3, .. } => {
            to(arg);
            [arg1, arg2, arg3].into_iter().flatten().for_each(to);
        }
        // Literals and expressions without operands. No other kinds occur in initialisers of overrides.
        _ => {}
    }
    expression
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the range is checked")]
fn literal(scalar: naga::Scalar, value: f64) -> Option<Literal> {
    let whole = |least: f64, most: f64| value.fract() == 0.0 && (least..=most).contains(&value);
    match (scalar.kind, scalar.width) {
        (ScalarKind::Float, 4) => {
            Some(Literal::F32(value as f32)).filter(|_| (value as f32).is_finite())
        }
        (ScalarKind::Float, 2) => {
            let half = half::f16::from_f64(value);
            Some(Literal::F16(half)).filter(|_| half.is_finite())
        }
        (ScalarKind::Sint, 4) if whole(i32::MIN.into(), i32::MAX.into()) => {
            Some(Literal::I32(value as i32))
        }
        (ScalarKind::Uint, 4) if whole(0.0, u32::MAX.into()) => Some(Literal::U32(value as u32)),
        (ScalarKind::Bool, _) if value == 0.0 || value == 1.0 => Some(Literal::Bool(value != 0.0)),
        _ => None,
    }
}
