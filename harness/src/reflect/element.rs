//! Finds the element at a byte of a variable, and names it as an author would in WGSL: `[17].sum`.

use naga::{Handle, Module, Scalar, ScalarKind, Type, TypeInner, VectorSize};

use super::{NAMED, Program};
use crate::value::{self, format_lane};

impl Program {
    /// Finds the element that begins at byte `byte` of a variable. Returns the element's path in the variable
    /// (`[17].sum`), and `words` formatted as values of the element's type. `variable` is the variable's name in the
    /// linked text.
    pub(crate) fn element<const N: usize>(
        &self,
        variable: &str,
        byte: u32,
        words: [u32; N],
    ) -> Option<(String, [String; N])> {
        let module = self.module();
        let mut globals = module.global_variables.iter();
        let (_, global) = globals.find(|(_, global)| global.name.as_deref() == Some(variable))?;
        let (path, scalar) = element_at(module, global.ty, byte)?;
        Some((path, words.map(|word| shown(scalar, word))))
    }
}

fn element_at(module: &Module, ty: Handle<Type>, byte: u32) -> Option<(String, Scalar)> {
    let component = |at: u32| ["x", "y", "z", "w"].get(at as usize).copied();
    Some(match &module.types[ty].inner {
        TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar) => (String::new(), *scalar),
        TypeInner::Vector { scalar, .. } => {
            (format!(".{}", component(byte / u32::from(scalar.width))?), *scalar)
        }
        TypeInner::Matrix { rows, scalar, .. } => {
            let rows = if *rows == VectorSize::Tri { 4 } else { *rows as u32 };
            let (width, stride) = (u32::from(scalar.width), rows * u32::from(scalar.width));
            (format!("[{}].{}", byte / stride, component(byte % stride / width)?), *scalar)
        }
        TypeInner::Array { base, stride, .. } => {
            let (path, scalar) = element_at(module, *base, byte % stride)?;
            (format!("[{}]{path}", byte / stride), scalar)
        }
        TypeInner::Struct { members, .. } => {
            let member = members.iter().rev().find(|member| member.offset <= byte)?;
            let (path, scalar) = element_at(module, member.ty, byte - member.offset)?;
            (format!(".{}{path}", member.name.as_deref().expect(NAMED)), scalar)
        }
        _ => return None,
    })
}

fn shown(scalar: Scalar, word: u32) -> String {
    match (scalar.kind, scalar.width) {
        (ScalarKind::Float, 2) => {
            let half = half::f16::from_bits((word & 0xFFFF) as u16);
            format_lane(value::Scalar::F32, half.to_f32().to_bits())
        }
        (ScalarKind::Float, _) => format_lane(value::Scalar::F32, word),
        (ScalarKind::Sint, _) => format_lane(value::Scalar::I32, word),
        (ScalarKind::Bool, _) => (word != 0).to_string(),
        _ => format_lane(value::Scalar::U32, word),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::package::Package;

    #[test]
    fn elements_of_memory_are_named_by_their_member_paths() {
        let text = "struct Item { id: u32, at: vec3f, turn: mat3x3f, tail: array<vec2<i32>, 2> }\n\
                    var<workgroup> tile: array<Item, 4>;\nvar<workgroup> flag: bool;\n\
                    @compute @workgroup_size(1) fn main() { tile[0].id = 1u; flag = true; }";
        let program = Program::of_module(&Package::from_source("m", text), "").expect("valid");
        let of = |name: &str, byte: u32, word: u32| {
            let (path, [word]) = program.element(name, byte, [word]).expect("it is there");
            format!("{path} {word}")
        };
        let one = 1.0_f32.to_bits();
        assert_eq!(of("tile", 0, 7), "[0].id 7");
        assert_eq!(of("tile", 16 + 8, one), "[0].at.z 1");
        assert_eq!(of("tile", 96 + 32 + 16 + 4, one), "[1].turn[1].y 1");
        assert_eq!(of("tile", 32 + 48 + 12, u32::MAX), "[0].tail[1].y -1");
        assert_eq!(of("flag", 0, 1), " true");
    }
}
