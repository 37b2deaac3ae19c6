//! Reads the attributes of an entry point: locations, builtin values, and the size of a workgroup.

use naga::common::wgsl::TryToWgsl;
use naga::{Binding, Interpolation, ShaderStage, Type, TypeInner};

use super::{NAMED, Program};

impl Program {
    /// The attributes of an entry point: the path of each input or output (`in.uv`, `result`), with its attributes. A
    /// compute entry point also has its `@workgroup_size`. The list is empty if there is no such entry point.
    pub fn attributes(&self, name: &str) -> Vec<(String, String)> {
        let name = self.entry_point_name(name);
        let module = &self.checked.module;
        let Some(entry) = module.entry_points.iter().find(|entry| entry.name == name) else {
            return Vec::new();
        };
        let mut all = Vec::new();
        let mut add = |path: &str, binding: Option<&Binding>, ty: naga::Handle<Type>| {
            all.extend(binding.map(|binding| (path.to_owned(), shown(binding))));
            if let (None, TypeInner::Struct { members, .. }) = (binding, &module.types[ty].inner) {
                all.extend(members.iter().filter_map(|member| {
                    let own = member.name.as_deref().expect(NAMED);
                    Some((format!("{path}.{own}"), shown(member.binding.as_ref()?)))
                }));
            }
        };
        for argument in &entry.function.arguments {
            let name = argument.name.as_deref().expect(NAMED);
            add(name, argument.binding.as_ref(), argument.ty);
        }
        if let Some(result) = &entry.function.result {
            add("result", result.binding.as_ref(), result.ty);
        }
        if entry.stage == ShaderStage::Compute {
            let given = entry.workgroup_size_overrides.unwrap_or_default();
            let size = [0, 1, 2].map(|k| {
                let range =
                    given[k].map(|size| module.global_expressions.get_span(size).to_range());
                let text = range.flatten().and_then(|range| self.text().get(range));
                text.map_or_else(|| entry.workgroup_size[k].to_string(), str::to_owned)
            });
            all.push((name.to_owned(), format!("@workgroup_size({})", size.join(", "))));
        }
        all
    }

    /// Reports if an entry point reads the components x, y and z of `global_invocation_id` or `workgroup_id`. Each
    /// element is `true` if the entry point reads the component. An element is `None` if the answer is unknown: the
    /// entry point reads an unknown component (`id[i]`) or the whole vector, or there is no such entry point.
    pub fn asks_for_places(&self, name: &str) -> [Option<bool>; 3] {
        use naga::{BuiltIn, Expression};
        let name = self.entry_point_name(name);
        let module = &self.checked.module;
        let entries = &module.entry_points;
        let Some(at) = entries.iter().position(|entry| entry.name == name) else {
            return [None; 3];
        };
        let function = &entries[at].function;
        let is_place = |binding: Option<&Binding>| {
            let place = [BuiltIn::GlobalInvocationId, BuiltIn::WorkGroupId].map(Binding::BuiltIn);
            binding.is_some_and(|binding| place.contains(binding))
        };
        let members =
            |argument: u32| match &module.types[function.arguments[argument as usize].ty].inner {
                TypeInner::Struct { members, .. } => &**members,
                _ => &[],
            };
        let is_place_of = |handle: naga::Handle<Expression>| match function.expressions[handle] {
            Expression::FunctionArgument(at) => {
                is_place(function.arguments[at as usize].binding.as_ref())
            }
            Expression::AccessIndex { base, index } => match function.expressions[base] {
                Expression::FunctionArgument(at) => {
                    let member = members(at).get(index as usize);
                    member.is_some_and(|member| is_place(member.binding.as_ref()))
                }
                _ => false,
            },
            _ => false,
        };
        // The entry point may also use a whole structure that contains a position vector.
        let holds_place = |handle: naga::Handle<Expression>| match function.expressions[handle] {
            Expression::FunctionArgument(at) => {
                members(at).iter().any(|member| is_place(member.binding.as_ref()))
            }
            _ => false,
        };
        let is_either = |handle| is_place_of(handle) || holds_place(handle);
        let mut asks = [false; 3];
        // The number of uses of whole position vectors: all uses, minus the uses of single components.
        let info = self.checked.info.get_entry_point(at);
        let mut whole = 0;
        for (handle, expression) in function.expressions.iter() {
            if is_either(handle) {
                whole += info[handle].ref_count;
            }
            match *expression {
                Expression::AccessIndex { base, index } if is_either(base) => {
                    if is_place_of(base) {
                        asks[index as usize] = true;
                    }
                    whole -= 1;
                }
                Expression::Swizzle { size, vector, pattern } if is_place_of(vector) => {
                    pattern.iter().take(size as usize).for_each(|at| asks[*at as usize] = true);
                    whole -= 1;
                }
                _ => {}
            }
        }
        asks.map(|asks| if whole > 0 && !asks { None } else { Some(asks) })
    }
}

fn shown(binding: &Binding) -> String {
    match binding {
        Binding::BuiltIn(builtin) => {
            let is_invariant = matches!(builtin, naga::BuiltIn::Position { invariant: true });
            let invariant = if is_invariant { "@invariant " } else { "" };
            format!("{invariant}@builtin({})", builtin.to_wgsl_for_diagnostics())
        }
        Binding::Location { location, interpolation, sampling, .. } => {
            let how = match (interpolation, sampling) {
                (None | Some(Interpolation::Perspective), None | Some(naga::Sampling::Center)) => {
                    String::new()
                }
                (interpolation, sampling) => {
                    let of = |text: String| text.to_lowercase();
                    let kind = interpolation.map(|kind| of(format!("{kind:?}")));
                    let sampling = sampling.map(|one| of(format!("{one:?}")));
                    let parts: Vec<String> = kind.into_iter().chain(sampling).collect();
                    format!(" @interpolate({})", parts.join(", "))
                }
            };
            format!("@location({location}){how}")
        }
    }
}
