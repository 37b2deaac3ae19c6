//! Checks that a compiler uses naga's layout for uniform buffers.
//!
//! naga's HLSL relies on Direct3D's packing: if the columns of a matrix have three elements, a scalar can be in the
//! padding of the last column. glslang silently puts the scalar behind the padding, so each later member has a wrong
//! offset. So this module compares the offsets in glslang's SPIR-V with WGSL's offsets.

use std::collections::BTreeMap;

use naga::valid::ModuleInfo;
use naga::{AddressSpace, EntryPoint, Module, TypeInner};

use crate::bindings::uses;

/// The names of a WGSL structure's members, with their offsets in bytes.
pub(crate) type Members = Vec<(String, u32)>;

/// The structures, also nested ones, in the uniform buffers that an entry point uses. Without an entry point, the
/// function returns the structures in all uniform buffers.
pub(crate) fn uniform_structures(
    module: &Module,
    info: &ModuleInfo,
    entry_point: Option<&EntryPoint>,
) -> Vec<Members> {
    let used = uses(module, info, entry_point);
    let uniforms = module
        .global_variables
        .iter()
        .filter(|(handle, global)| global.space == AddressSpace::Uniform && used(*handle));
    let mut types: Vec<_> = uniforms.map(|(_, global)| global.ty).collect();
    let mut found: Vec<Members> = Vec::new();
    while let Some(ty) = types.pop() {
        match &module.types[ty].inner {
            TypeInner::Array { base, .. } => types.push(*base),
            TypeInner::Struct { members, .. } => {
                types.extend(members.iter().map(|member| member.ty));
                let name = |m: &naga::StructMember| plain(m.name.as_deref().unwrap_or_default());
                let structure = members.iter().map(|m| (name(m), m.offset)).collect();
                if !found.contains(&structure) {
                    found.push(structure);
                }
            }
            _ => {}
        }
    }
    found
}

/// The name without the `_` that naga appends to avoid collisions.
fn plain(name: &str) -> String {
    name.trim_end_matches('_').to_owned()
}

/// A message about the first member whose offset in SPIR-V differs from the offset in WGSL; `None` if all are equal.
pub(crate) fn fault(structures: &[Members], words: &[u32]) -> Option<String> {
    let made = structures_of(words);
    for wanted in structures {
        let names = |members: &Members| members.iter().map(|(n, _)| n.clone()).collect::<Vec<_>>();
        let of_name: Vec<&Members> = made.iter().filter(|m| names(m) == names(wanted)).collect();
        if of_name.is_empty() {
            return Some(format!(
                "the compiler's SPIR-V has no structure with the members `{}`, so Karat can't compare \
                 their offsets",
                names(wanted).join("`, `")
            ));
        }
        if of_name.contains(&wanted) {
            continue;
        }
        let members = wanted.iter().zip(of_name[0]);
        let wrong = members.into_iter().find(|((_, wanted), (_, made))| wanted != made);
        if let Some(((name, wanted), (_, made))) = wrong {
            return Some(format!(
                "the compiler puts the member `{name}` at byte {made}, but naga's HLSL and Direct3D expect the member at byte \
                 {wanted}"
            ));
        }
    }
    None
}

/// The instructions of SPIR-V: for each instruction, the number of its operation, and all its words.
pub(crate) fn instructions(words: &[u32]) -> impl Iterator<Item = (u32, &[u32])> {
    const HEADER: usize = 5;
    let mut rest = words.get(HEADER..).unwrap_or_default();
    std::iter::from_fn(move || {
        let first = rest.first()?;
        let instruction = rest.get(..((first >> 16) as usize).max(1))?;
        rest = &rest[instruction.len()..];
        Some((first & 0xffff, instruction))
    })
}

/// The structures of SPIR-V with their members' names and offsets, without naga's padding.
fn structures_of(words: &[u32]) -> Vec<Members> {
    // Numbers from the SPIR-V specification: two instructions, and the decoration `Offset`.
    const OP_MEMBER_NAME: u32 = 6;
    const OP_MEMBER_DECORATE: u32 = 72;
    const OFFSET: u32 = 35;
    let mut members: BTreeMap<(u32, u32), (String, Option<u32>)> = BTreeMap::new();
    for (operation, instruction) in instructions(words) {
        match instruction {
            [_, structure, member, name @ ..] if operation == OP_MEMBER_NAME => {
                let bytes: Vec<u8> = name.iter().flat_map(|word| word.to_le_bytes()).collect();
                let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
                let name = plain(&String::from_utf8_lossy(&bytes[..end]));
                members.entry((*structure, *member)).or_default().0 = name;
            }
            [_, structure, member, OFFSET, offset] if operation == OP_MEMBER_DECORATE => {
                members.entry((*structure, *member)).or_default().1 = Some(*offset);
            }
            _ => {}
        }
    }
    let mut structures: BTreeMap<u32, Members> = BTreeMap::new();
    for ((structure, _), (name, offset)) in members {
        if let Some(offset) = offset.filter(|_| !is_padding(&name)) {
            structures.entry(structure).or_default().push((name, offset));
        }
    }
    structures.into_values().collect()
}

/// Checks if naga added this member to a structure in HLSL.
fn is_padding(name: &str) -> bool {
    name.starts_with("_pad") || name.starts_with("_end_pad")
}
