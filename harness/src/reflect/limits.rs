//! Compares WebGPU's limits with the resources that entry points use.

use std::collections::BTreeMap;

use naga::{
    AddressSpace, Binding, BuiltIn, Expression, GlobalVariable, Handle, ImageClass, Literal,
    ShaderStage, StorageAccess, Type, TypeInner,
};

use super::{NAMED, Program};
use crate::diagnostic::{Diagnostic, Span};
use crate::output::counted;
use crate::package::{Limit, Limits};

/// An amount that WebGPU limits, such as the number of samplers of an entry point, or the size of a variable.
struct Used {
    limit: Limit,
    amount: u64,
    /// The entry point or variable that has this amount, as text for messages: `the compute entry point main`.
    who: String,
    what: String,
    span: Option<Span>,
    entry_point: Option<String>,
}

impl Program {
    pub(super) fn over_limits(&self, limits: &Limits) -> Vec<Diagnostic> {
        let mut found = Vec::new();
        for used in self.used() {
            let Used { limit, amount, who, what, span, .. } = used;
            let most = limits.value(limit);
            if amount <= most {
                continue;
            }
            let (name, source) = (limit.name, limits.source(limit));
            let message = format!("{who} uses {what}, but {source} {name} is {most}");
            let note = format!(
                "if the devices of your users support a larger value, request this limit (`requiredLimits`), and write {name} = {amount} \
                 in `[limits]` of karat.toml"
            );
            let diagnostic = Diagnostic::new(message).note(note);
            let diagnostic = match span {
                Some(span) => diagnostic.at(span, ""),
                None => diagnostic,
            };
            found.push(diagnostic);
        }
        found
    }

    /// The names of entry points that exceed default limits. A GPU device with default limits can't make pipelines from
    /// these entry points.
    pub(super) fn beyond_default(&self, compatibility: bool) -> Vec<String> {
        let limits = Limits::usual(compatibility);
        let over = self.used().into_iter().filter(|used| used.amount > limits.value(used.limit));
        let mut names = Vec::new();
        for used in over {
            match used.entry_point {
                Some(name) => names.push(name),
                // If a variable exceeds a limit, so does each entry point that uses the variable.
                None => {
                    names.extend(self.module().entry_points.iter().map(|entry| entry.name.clone()))
                }
            }
        }
        names
    }

    fn used(&self) -> Vec<Used> {
        let (module, info) = (&self.checked.module, &self.checked.info);
        let mut all = Vec::new();
        for (handle, variable) in module.global_variables.iter() {
            // Pipeline layouts contain only variables that an entry point uses.
            let mut entries = 0..module.entry_points.len();
            if entries.any(|entry| !info.get_entry_point(entry)[handle].is_empty()) {
                self.of_variable(handle, variable, &mut all);
            }
        }
        for (index, entry) in module.entry_points.iter().enumerate() {
            let span = || self.entry_point_span(&entry.name);
            let name = self.linked.names.get(&entry.name).unwrap_or(&entry.name);
            let name = name.rsplit("::").next().unwrap_or(name);
            let who = format!("the {} entry point `{name}`", stage(entry.stage));
            let mut push = |limit: Limit, amount: u64, what: String| {
                let (who, entry_point) = (who.clone(), Some(entry.name.clone()));
                all.push(Used { limit, amount, who, what, span: span(), entry_point });
            };
            let uses = info.get_entry_point(index);
            let used = module.global_variables.iter();
            let used: Vec<_> = used.filter(|(handle, _)| !uses[*handle].is_empty()).collect();
            let mut counts: BTreeMap<Limit, u64> = BTreeMap::new();
            for (_, variable) in &used {
                for (limit, count) in self.counted_by(variable, entry.stage) {
                    *counts.entry(limit).or_default() += count;
                }
            }
            for (limit, count) in counts {
                push(
                    limit,
                    count,
                    counted(usize::try_from(count).unwrap_or(usize::MAX), kind(limit)),
                );
            }
            if entry.stage == ShaderStage::Compute {
                let size = self.workgroup_size(entry);
                let shown = size.map(|one| one.to_string()).join(" x ");
                let axes = [Limit::WORKGROUP_X, Limit::WORKGROUP_Y, Limit::WORKGROUP_Z];
                for (limit, size) in axes.into_iter().zip(size) {
                    push(limit, size, format!("a workgroup of {shown}"));
                }
                let all = size.iter().product();
                push(Limit::INVOCATIONS, all, format!("{all} invocations in a workgroup"));
                let memory = used.iter().filter(|(_, one)| one.space == AddressSpace::WorkGroup);
                // WGSL, 13.2 and WebGPU, "validating GPUProgrammableStage": each variable's size is rounded up to
                // a multiple of 16.
                let memory = memory.map(|(_, one)| self.size(one).next_multiple_of(16)).sum();
                push(
                    Limit::WORKGROUP_STORAGE,
                    memory,
                    format!("{memory} bytes of workgroup memory"),
                );
            }
            let (inputs, outputs) = self.locations(entry);
            let count = |all: &[u32], others: u64| {
                // WebGPU limits the number of locations, and also the largest number of a location.
                let highest = all.iter().max().map_or(0, |highest| highest + 1);
                u64::from(highest).max(all.len() as u64 + others)
            };
            let (read, written) = self.builtins(entry);
            match entry.stage {
                ShaderStage::Vertex => {
                    let (attributes, passed) = (count(&inputs, 0), count(&outputs, written));
                    push(
                        Limit::VERTEX_ATTRIBUTES,
                        attributes,
                        format!("{attributes} vertex attributes"),
                    );
                    push(Limit::INTER_STAGE, passed, format!("{passed} variables between stages"));
                }
                ShaderStage::Fragment => {
                    let (passed, targets) = (count(&inputs, read), count(&outputs, 0));
                    push(Limit::INTER_STAGE, passed, format!("{passed} variables between stages"));
                    push(
                        Limit::COLOR_ATTACHMENTS,
                        targets,
                        format!("{targets} colour attachments"),
                    );
                }
                _ => {}
            }
        }
        all
    }

    fn of_variable(
        &self,
        handle: Handle<GlobalVariable>,
        variable: &GlobalVariable,
        all: &mut Vec<Used>,
    ) {
        let Some(binding) = variable.binding else { return };
        let range = self.checked.module.global_variables.get_span(handle).to_range();
        let span = range.and_then(|range| self.resolve(range)).map(|span| span.first_line());
        let name = variable.name.as_deref().expect(NAMED);
        let who = format!("`{}`", self.author_path(name).unwrap_or(name));
        let mut push = |limit: Limit, amount: u64, what: String| {
            let (who, span) = (who.clone(), span.clone());
            all.push(Used { limit, amount, who, what, span, entry_point: None });
        };
        let group = u64::from(binding.group);
        push(
            Limit::BIND_GROUPS,
            group + 1,
            format!("group {group}, so at least {} groups", group + 1),
        );
        let number = u64::from(binding.binding);
        push(
            Limit::BINDINGS,
            number + 1,
            format!("binding {number}, so at least {} bindings", number + 1),
        );
        let size = self.size(variable);
        match variable.space {
            AddressSpace::Uniform => push(Limit::UNIFORM_SIZE, size, format!("{size} bytes")),
            AddressSpace::Storage { .. } => {
                push(Limit::STORAGE_SIZE, size, format!("{size} bytes"))
            }
            _ => {}
        }
    }

    /// The limits that apply to this variable in a stage, such as the largest number of uniform buffers. Each limit
    /// comes with the amount that the variable adds to the total, which is usually 1.
    fn counted_by(&self, variable: &GlobalVariable, stage: ShaderStage) -> Vec<(Limit, u64)> {
        let inner = &self.checked.module.types[variable.ty].inner;
        // WebGPU, "exceeds the binding slot limits": an external texture uses the slots of four textures, a
        // sampler and a uniform buffer.
        if matches!(inner, TypeInner::Image { class: ImageClass::External, .. }) {
            let slots =
                [(Limit::SAMPLED_TEXTURES, 4), (Limit::SAMPLERS, 1), (Limit::UNIFORM_BUFFERS, 1)];
            return slots.to_vec();
        }
        let limits = match (variable.space, inner) {
            (AddressSpace::Uniform, _) => vec![Limit::UNIFORM_BUFFERS],
            (AddressSpace::Storage { .. }, _) => match stage {
                ShaderStage::Vertex => {
                    vec![Limit::STORAGE_BUFFERS, Limit::STORAGE_BUFFERS_IN_VERTEX]
                }
                ShaderStage::Fragment => {
                    vec![Limit::STORAGE_BUFFERS, Limit::STORAGE_BUFFERS_IN_FRAGMENT]
                }
                _ => vec![Limit::STORAGE_BUFFERS],
            },
            (_, TypeInner::Sampler { .. }) => vec![Limit::SAMPLERS],
            (_, TypeInner::Image { class: ImageClass::Storage { .. }, .. }) => match stage {
                ShaderStage::Vertex => {
                    vec![Limit::STORAGE_TEXTURES, Limit::STORAGE_TEXTURES_IN_VERTEX]
                }
                ShaderStage::Fragment => {
                    vec![Limit::STORAGE_TEXTURES, Limit::STORAGE_TEXTURES_IN_FRAGMENT]
                }
                _ => vec![Limit::STORAGE_TEXTURES],
            },
            (_, TypeInner::Image { .. }) => vec![Limit::SAMPLED_TEXTURES],
            _ => Vec::new(),
        };
        limits.into_iter().map(|limit| (limit, 1)).collect()
    }

    /// The size of a workgroup, with the overrides' initial values. A dimension counts as 1 if it is an override
    /// without an initial value, or an expression with operators, such as `2 * SIZE`.
    pub(super) fn workgroup_size(&self, entry: &naga::EntryPoint) -> [u64; 3] {
        let module = &self.checked.module;
        let number = |expression: &Expression| match expression {
            Expression::Literal(Literal::U32(value)) => Some(u64::from(*value)),
            Expression::Literal(Literal::I32(value)) => u64::try_from(*value).ok(),
            _ => None,
        };
        let value = |handle: Handle<Expression>| match &module.global_expressions[handle] {
            Expression::Override(one) => {
                number(&module.global_expressions[module.overrides[*one].init?])
            }
            other => number(other),
        };
        let mut size = entry.workgroup_size.map(u64::from);
        for (axis, size) in entry.workgroup_size_overrides.into_iter().flatten().zip(&mut size) {
            *size = axis.map_or(Some(*size), value).unwrap_or(1);
        }
        size
    }

    /// The numbers of inter-stage variables that WebGPU counts for an entry point's builtin inputs and for its builtin
    /// outputs ("validating inter-stage interfaces").
    fn builtins(&self, entry: &naga::EntryPoint) -> (u64, u64) {
        let module = &self.checked.module;
        let read = |(binding, _): &(Binding, Handle<Type>)| {
            let counted = [BuiltIn::FrontFacing, BuiltIn::SampleIndex, BuiltIn::SampleMask];
            matches!(binding, Binding::BuiltIn(builtin) if counted.contains(builtin))
        };
        let clipped = |(binding, ty): &(Binding, Handle<Type>)| {
            let clips = matches!(binding, Binding::BuiltIn(BuiltIn::ClipDistances));
            let distances = u64::from(module.types[*ty].inner.size(module.to_ctx()) / 4);
            if clips { distances.div_ceil(4) } else { 0 }
        };
        let read = self.inputs(entry).iter().filter(|one| read(one)).count() as u64;
        (read, self.outputs(entry).iter().map(clipped).sum())
    }

    /// Reports vertex entry points that use writable storage, which WebGPU forbids ("GPUBindGroupLayoutEntry"). Tint
    /// reports them, too.
    pub(super) fn written_by_vertices(&self) -> Vec<Diagnostic> {
        let (module, info) = (&self.checked.module, &self.checked.info);
        let mut found = Vec::new();
        for (index, entry) in module.entry_points.iter().enumerate() {
            if entry.stage != ShaderStage::Vertex {
                continue;
            }
            let uses = info.get_entry_point(index);
            for (handle, variable) in module.global_variables.iter() {
                let access = match (variable.space, &module.types[variable.ty].inner) {
                    (AddressSpace::Storage { access }, _) => access,
                    (_, TypeInner::Image { class: ImageClass::Storage { access, .. }, .. }) => {
                        *access
                    }
                    _ => continue,
                };
                if uses[handle].is_empty() || !access.contains(StorageAccess::STORE) {
                    continue;
                }
                let name = variable.name.as_deref().expect(NAMED);
                let name = self.author_path(name).unwrap_or(name);
                let message = format!(
                    "the vertex entry point `{}` uses `{name}`, which is writable, and WebGPU \
                     forbids writable storage in vertex stages",
                    entry.name
                );
                let note = "declare the variable as `read`, or write to it in a compute pass";
                let diagnostic = Diagnostic::new(message).note(note);
                let diagnostic = match self.entry_point_span(&entry.name) {
                    Some(span) => diagnostic.at(span, ""),
                    None => diagnostic,
                };
                found.push(diagnostic);
            }
        }
        found
    }

    fn size(&self, variable: &GlobalVariable) -> u64 {
        let module = &self.checked.module;
        // A runtime-sized array counts as one element, because the buffer decides its length.
        u64::from(module.types[variable.ty].inner.size(module.to_ctx()))
    }
}

fn stage(stage: ShaderStage) -> &'static str {
    match stage {
        ShaderStage::Vertex => "vertex",
        ShaderStage::Fragment => "fragment",
        ShaderStage::Compute => "compute",
        _ => "mesh or ray",
    }
}

fn kind(limit: Limit) -> &'static str {
    match limit {
        Limit::UNIFORM_BUFFERS => "uniform buffer",
        Limit::SAMPLERS => "sampler",
        Limit::SAMPLED_TEXTURES => "sampled texture",
        Limit::STORAGE_TEXTURES
        | Limit::STORAGE_TEXTURES_IN_VERTEX
        | Limit::STORAGE_TEXTURES_IN_FRAGMENT => "storage texture",
        _ => "storage buffer",
    }
}
