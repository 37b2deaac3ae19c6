//! Converts values into WGSL's memory layout for uniform and storage buffers, with naga's offsets.
//!
//! Karat uses WGSL's memory layout only for the buffers that fixtures supply. Arguments and results have another form:
//! Karat passes each of them as a list of scalars. The offsets and strides are naga's values for the author's
//! declaration.

use naga::proc::Layouter;
use naga::{ArraySize, Handle, Module, Type, TypeInner};

/// The reason why Karat can't convert scalars into a variable's memory.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LayoutError {
    /// The number of supplied scalars isn't the number of scalars in the type.
    #[error("the fixture has {supplied} scalars, but the variable needs {}{expected}",
        if .expected > .supplied { "at least " } else { "" })]
    Count {
        /// The number of supplied scalars.
        supplied: usize,
        /// The number of scalars that the variable needs. This is only a lower bound if the fixture has too few
        /// scalars, because Karat stops at the first missing scalar.
        expected: usize,
    },
    /// No buffer fixture can supply the type.
    #[error("Karat can't fill a variable of this type with values")]
    Unsupported,
}

/// The bytes of a value of type `ty`, from its scalars. The number of scalars decides the length of a
/// runtime-sized array.
pub(crate) fn bytes_of(
    module: &Module,
    layouter: &Layouter,
    ty: Handle<Type>,
    lanes: &[u32],
) -> Result<Vec<u8>, LayoutError> {
    let mut writer = Writer { module, lanes, at: 0, bytes: Vec::new() };
    writer.write(ty, 0)?;
    if writer.at != lanes.len() {
        return Err(LayoutError::Count { supplied: lanes.len(), expected: writer.at });
    }
    // The size of a buffer decides the length of a runtime-sized array, so the size must be exact. Other types
    // may have a larger buffer, and need a multiple of 16 bytes in uniform space. Padding is zero.
    let (size, multiple) = match dynamic(module, ty) {
        true => (writer.bytes.len(), 4),
        false => (layouter[ty].size as usize, 16),
    };
    writer.bytes.resize(size.max(writer.bytes.len()).next_multiple_of(multiple), 0);
    Ok(writer.bytes)
}

/// The scalars of a value of type `ty`, from its bytes: the inverse of [`bytes_of`]. An atomic counts as one scalar.
/// The number of bytes decides the length of a runtime-sized array. Returns `None` if there are too few bytes.
pub(crate) fn lanes_of(module: &Module, ty: Handle<Type>, bytes: &[u8]) -> Option<Vec<u32>> {
    let mut lanes = Vec::new();
    read(module, ty, bytes, &mut lanes)?;
    Some(lanes)
}

fn read(module: &Module, ty: Handle<Type>, bytes: &[u8], lanes: &mut Vec<u32>) -> Option<()> {
    let scalars = |scalar: naga::Scalar, count: usize, bytes: &[u8], lanes: &mut Vec<u32>| {
        for index in 0..count {
            let width = usize::from(scalar.width);
            let one = bytes.get(index * width..(index + 1) * width)?;
            lanes.push(match one {
                [a, b, c, d] => u32::from_le_bytes([*a, *b, *c, *d]),
                [a, b] => half::f16::from_le_bytes([*a, *b]).to_f32().to_bits(),
                _ => return None,
            });
        }
        Some(())
    };
    match &module.types[ty].inner {
        TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar) => scalars(*scalar, 1, bytes, lanes),
        TypeInner::Vector { size, scalar } => scalars(*scalar, *size as usize, bytes, lanes),
        TypeInner::Matrix { columns, rows, scalar } => {
            let rows_in_memory = if *rows == naga::VectorSize::Tri { 4 } else { *rows as usize };
            let stride = rows_in_memory * usize::from(scalar.width);
            (0..*columns as usize).try_for_each(|column| {
                scalars(*scalar, *rows as usize, bytes.get(column * stride..)?, lanes)
            })
        }
        TypeInner::Array { base, size, stride } => {
            let stride = *stride as usize;
            let count = match size {
                ArraySize::Constant(length) => length.get() as usize,
                ArraySize::Dynamic => bytes.len() / stride,
                ArraySize::Pending(_) => return None,
            };
            (0..count)
                .try_for_each(|index| read(module, *base, bytes.get(index * stride..)?, lanes))
        }
        TypeInner::Struct { members, .. } => members.iter().try_for_each(|member| {
            read(module, member.ty, bytes.get(member.offset as usize..)?, lanes)
        }),
        _ => None,
    }
}

/// The path of each member of a value (`.light.power`, `[].power`), with the member's offset in bytes. For each array,
/// the list also has the offset of the second element, which shows the array's stride.
pub(super) fn places(module: &Module, ty: Handle<Type>, path: &str, at: u32) -> Vec<(String, u32)> {
    match &module.types[ty].inner {
        TypeInner::Struct { members, .. } => {
            let own = |member: &naga::StructMember| {
                let path = format!("{path}.{}", member.name.as_deref().expect(super::NAMED));
                places(module, member.ty, &path, at + member.offset)
            };
            members.iter().flat_map(own).collect()
        }
        TypeInner::Array { base, stride, .. } => {
            let path = format!("{path}[]");
            let elements = places(module, *base, &path, at);
            std::iter::once((format!("{path}, the second,"), at + stride)).chain(elements).collect()
        }
        _ => vec![(path.to_owned(), at)],
    }
}

/// Checks if the type is a runtime-sized array, or a structure that ends in such an array.
pub(super) fn dynamic(module: &Module, ty: Handle<Type>) -> bool {
    match &module.types[ty].inner {
        TypeInner::Array { size: ArraySize::Dynamic, .. } => true,
        TypeInner::Struct { members, .. } => {
            members.last().is_some_and(|member| dynamic(module, member.ty))
        }
        _ => false,
    }
}

struct Writer<'a> {
    module: &'a Module,
    lanes: &'a [u32],
    at: usize,
    bytes: Vec<u8>,
}

impl Writer<'_> {
    fn scalar(&mut self, scalar: naga::Scalar, offset: usize) -> Result<(), LayoutError> {
        let expected = self.at + 1;
        let count = LayoutError::Count { supplied: self.lanes.len(), expected };
        let lane = *self.lanes.get(self.at).ok_or(count)?;
        self.at += 1;
        let half = half::f16::from_f32(f32::from_bits(lane));
        match scalar.width {
            4 => self.put(offset, &lane.to_le_bytes()),
            2 => self.put(offset, &half.to_le_bytes()),
            _ => return Err(LayoutError::Unsupported),
        }
        Ok(())
    }

    fn put(&mut self, offset: usize, bytes: &[u8]) {
        if self.bytes.len() < offset + bytes.len() {
            self.bytes.resize(offset + bytes.len(), 0);
        }
        self.bytes[offset..offset + bytes.len()].copy_from_slice(bytes);
    }

    fn vector(
        &mut self,
        size: naga::VectorSize,
        scalar: naga::Scalar,
        offset: usize,
    ) -> Result<(), LayoutError> {
        (0..size as usize)
            .try_for_each(|i| self.scalar(scalar, offset + i * usize::from(scalar.width)))
    }

    fn write(&mut self, ty: Handle<Type>, offset: usize) -> Result<(), LayoutError> {
        let module = self.module;
        match &module.types[ty].inner {
            TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar) => self.scalar(*scalar, offset),
            TypeInner::Vector { size, scalar } => self.vector(*size, *scalar, offset),
            TypeInner::Matrix { columns, rows, scalar } => {
                // Columns have the alignment of vectors, so a column of three rows takes the space of four.
                let rows_in_memory =
                    if *rows == naga::VectorSize::Tri { 4 } else { *rows as usize };
                let stride = rows_in_memory * usize::from(scalar.width);
                (0..*columns as usize)
                    .try_for_each(|column| self.vector(*rows, *scalar, offset + column * stride))
            }
            TypeInner::Array { base, size, stride } => {
                let stride = *stride as usize;
                match size {
                    ArraySize::Constant(length) => (0..length.get() as usize)
                        .try_for_each(|index| self.write(*base, offset + index * stride)),
                    ArraySize::Dynamic => {
                        let mut index = 0;
                        while self.at < self.lanes.len() {
                            self.write(*base, offset + index * stride)?;
                            index += 1;
                        }
                        let end = offset + index * stride;
                        self.bytes.resize(end.max(self.bytes.len()), 0);
                        Ok(())
                    }
                    ArraySize::Pending(_) => Err(LayoutError::Unsupported),
                }
            }
            TypeInner::Struct { members, .. } => members
                .iter()
                .try_for_each(|member| self.write(member.ty, offset + member.offset as usize)),
            _ => Err(LayoutError::Unsupported),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lay_out(wgsl: &str, lanes: &[u32]) -> Result<Vec<u32>, LayoutError> {
        let module = naga::front::wgsl::parse_str(wgsl).expect("valid WGSL");
        let mut layouter = Layouter::default();
        layouter.update(module.to_ctx()).expect("types have layouts");
        let (_, global) = module.global_variables.iter().next().expect("one variable");
        let bytes = bytes_of(&module, &layouter, global.ty, lanes)?;
        Ok(bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }

    #[test]
    fn members_arrays_and_columns_are_padded_as_wgsl_says() {
        let wgsl = "struct S { a: f32, b: vec3<f32>, c: u32, m: mat2x3<f32> }\n\
                    @group(0) @binding(0) var<uniform> s: S;";
        let words = lay_out(wgsl, &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]).expect("fits");
        assert_eq!(words, [1, 0, 0, 0, 2, 3, 4, 5, 6, 7, 8, 0, 9, 10, 11, 0]);
    }

    #[test]
    fn runtime_arrays_take_whole_elements() {
        let wgsl = "struct S { a: vec3<f32>, b: f32, c: f32 }\n\
                    @group(0) @binding(0) var<storage, read> s: array<S>;";
        let words = lay_out(wgsl, &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]).expect("fits");
        assert_eq!(words.len(), 16);
        assert_eq!(words[..5], [1, 2, 3, 4, 5]);
        assert_eq!(words[8..13], [6, 7, 8, 9, 10]);
        let few = lay_out(wgsl, &[1, 2, 3]).expect_err("too few").to_string();
        assert_eq!(few, "the fixture has 3 scalars, but the variable needs at least 4");
    }

    #[test]
    fn values_round_trip_through_their_bytes() {
        let wgsl = "struct T { m: mat3x3<f32>, a: array<vec2<u32>, 2> }\n\
                    struct S { a: f32, b: vec3<f32>, c: array<T, 1>, rest: array<vec3<f32>> }\n\
                    @group(0) @binding(0) var<storage, read> s: S;";
        let module = naga::front::wgsl::parse_str(wgsl).expect("valid WGSL");
        let mut layouter = Layouter::default();
        layouter.update(module.to_ctx()).expect("types have layouts");
        let (_, global) = module.global_variables.iter().next().expect("one variable");
        let lanes: Vec<u32> = (1..=4 + 13 + 6).collect();
        let bytes = bytes_of(&module, &layouter, global.ty, &lanes).expect("fits");
        assert_eq!(lanes_of(&module, global.ty, &bytes), Some(lanes));
        assert_eq!(lanes_of(&module, global.ty, &bytes[..20]), None);
    }

    #[test]
    fn too_many_values_are_an_error() {
        let wgsl = "@group(0) @binding(0) var<uniform> v: vec4<f32>;";
        assert!(matches!(
            lay_out(wgsl, &[0; 5]),
            Err(LayoutError::Count { supplied: 5, expected: 4 })
        ));
    }
}
