//! Scalars, and the types that consist of them.

use std::cell::RefCell;
use std::collections::HashMap;

use naga::{ArraySize, Handle, Module, ScalarKind, Type, TypeInner, VectorSize};

/// The type of one scalar in a row of arguments or results. A row has a `u32` for each scalar.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Scalar {
    /// The bits of an `f32`.
    F32,
    /// The 16 bits of an `f16`.
    F16,
    /// The bits of an `i32`.
    I32,
    /// A `u32`.
    U32,
    /// A `bool`: 0 is false, and all other words are true.
    Bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum File {
    Float = 0,
    Int = 1,
    Bool = 2,
}

impl Scalar {
    pub(crate) fn file(self) -> File {
        match self {
            Self::F32 | Self::F16 => File::Float,
            Self::I32 | Self::U32 => File::Int,
            Self::Bool => File::Bool,
        }
    }

    pub(crate) fn signed(self) -> bool {
        self == Self::I32
    }

    /// Converts naga's scalar type. The error names a type that the engine doesn't support.
    pub(crate) fn of(scalar: naga::Scalar) -> Result<Self, String> {
        match (scalar.kind, scalar.width) {
            (ScalarKind::Float, 4) => Ok(Self::F32),
            (ScalarKind::Float, 2) => Ok(Self::F16),
            (ScalarKind::Sint, 4) => Ok(Self::I32),
            (ScalarKind::Uint, 4) => Ok(Self::U32),
            (ScalarKind::Bool, _) => Ok(Self::Bool),
            (ScalarKind::Sint, width) => Err(format!("type i{}", 8 * u32::from(width))),
            (ScalarKind::Uint, width) => Err(format!("type u{}", 8 * u32::from(width))),
            (ScalarKind::Float, width) => Err(format!("type f{}", 8 * u32::from(width))),
            (ScalarKind::AbstractInt | ScalarKind::AbstractFloat, _) => {
                Err("a number of abstract type at run time".to_owned())
            }
        }
    }
}

/// The numbers of registers that a type needs: for floats, for integers and for booleans.
pub(crate) type Counts = [u32; 3];

/// The same numbers as [`Counts`], before Karat checks that they are small enough.
type Wide = Result<[u64; 3], String>;

/// The largest number of scalars in a value or a variable. For 2^14 scalars of 256 cases, a thread needs 16 MiB. WGSL
/// limits all variables of a function to 2^11 scalars in total.
pub(crate) const MOST_SCALARS: u64 = 1 << 14;

#[derive(Debug)]
pub(crate) struct Layouts<'m> {
    pub(crate) module: &'m Module,
    pub(crate) lengths: HashMap<Handle<naga::Override>, u32>,
    cache: RefCell<HashMap<Handle<Type>, Wide>>,
}

impl<'m> Layouts<'m> {
    pub(crate) fn new(module: &'m Module) -> Self {
        Self { module, lengths: Default::default(), cache: Default::default() }
    }

    pub(crate) fn inner(&self, ty: Handle<Type>) -> &'m TypeInner {
        &self.module.types[ty].inner
    }

    /// The number of elements. `None` for a runtime-sized array.
    pub(crate) fn length(&self, size: ArraySize) -> Result<Option<u32>, String> {
        match size {
            ArraySize::Constant(count) => Ok(Some(count.get())),
            ArraySize::Pending(handle) => match self.lengths.get(&handle) {
                Some(&length) => Ok(Some(length)),
                None => Err("an array whose length is an override expression".to_owned()),
            },
            ArraySize::Dynamic => Ok(None),
        }
    }

    fn wide(&self, inner: &TypeInner) -> Wide {
        let of = |scalar: naga::Scalar, count: u64| {
            let mut counts = [0; 3];
            counts[Scalar::of(scalar)?.file() as usize] = count;
            Ok(counts)
        };
        match *inner {
            TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar) => of(scalar, 1),
            TypeInner::Vector { size, scalar } => of(scalar, size as u64),
            TypeInner::Matrix { columns, rows, scalar } => of(scalar, columns as u64 * rows as u64),
            TypeInner::Array { base, size, .. } => {
                let Some(count) = self.length(size)? else {
                    return Err("a runtime-sized array where a value is needed".to_owned());
                };
                Ok(self.wide_of(base)?.map(|n| n.saturating_mul(u64::from(count))))
            }
            TypeInner::Struct { ref members, .. } => {
                let mut sum = [0u64; 3];
                for member in members {
                    let counts = self.wide_of(member.ty)?;
                    sum = std::array::from_fn(|k| sum[k].saturating_add(counts[k]));
                }
                Ok(sum)
            }
            ref other => Err(format!("a value of type {}", kind(other))),
        }
    }

    fn wide_of(&self, ty: Handle<Type>) -> Wide {
        if let Some(found) = self.cache.borrow().get(&ty) {
            return found.clone();
        }
        let counts = self.wide(self.inner(ty));
        self.cache.borrow_mut().insert(ty, counts.clone());
        counts
    }

    /// The number of registers that a value of this type needs.
    pub(crate) fn counts(&self, inner: &TypeInner) -> Result<Counts, String> {
        let counts = self.wide(inner)?;
        let total = counts.iter().fold(0u64, |sum, n| sum.saturating_add(*n));
        if total > MOST_SCALARS {
            return Err(format!("a value with {total} scalars (at most {MOST_SCALARS})"));
        }
        Ok(counts.map(|n| n as u32))
    }

    pub(crate) fn counts_of(&self, ty: Handle<Type>) -> Result<Counts, String> {
        self.counts(self.inner(ty))
    }

    pub(crate) fn scalars(&self, inner: &TypeInner) -> Result<Vec<Scalar>, String> {
        self.counts(inner)?;
        let mut scalars = Vec::new();
        self.append(inner, &mut scalars)?;
        Ok(scalars)
    }

    fn append(&self, inner: &TypeInner, to: &mut Vec<Scalar>) -> Result<(), String> {
        match *inner {
            TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar) => to.push(Scalar::of(scalar)?),
            TypeInner::Vector { size, scalar } => {
                to.extend(std::iter::repeat_n(Scalar::of(scalar)?, size as usize));
            }
            TypeInner::Matrix { columns, rows, scalar } => {
                let count = columns as usize * rows as usize;
                to.extend(std::iter::repeat_n(Scalar::of(scalar)?, count));
            }
            TypeInner::Array { base, size, .. } => {
                let start = to.len();
                self.append(self.inner(base), to)?;
                let one = to[start..].to_vec();
                for _ in 1..self.length(size)?.unwrap_or(0) {
                    to.extend_from_slice(&one);
                }
            }
            TypeInner::Struct { ref members, .. } => {
                for member in members {
                    self.append(self.inner(member.ty), to)?;
                }
            }
            ref other => return Err(format!("a value of type {}", kind(other))),
        }
        Ok(())
    }

    /// The type of component `index`, and the number of registers before it.
    pub(crate) fn component(
        &self,
        inner: &TypeInner,
        index: u32,
    ) -> Result<(TypeInner, Counts), String> {
        match *inner {
            TypeInner::Struct { ref members, .. } => {
                let mut before = [0; 3];
                for member in members.iter().take(index as usize) {
                    let counts = self.counts_of(member.ty)?;
                    before = std::array::from_fn(|k| before[k] + counts[k]);
                }
                let member = members.get(index as usize).ok_or("a member that doesn't exist")?;
                Ok((self.inner(member.ty).clone(), before))
            }
            _ => {
                let (element, _) = self.element(inner)?;
                let counts = self.counts(&element)?;
                Ok((element, counts.map(|n| n * index)))
            }
        }
    }

    /// The type of each element, and the number of elements. The number is `None` for a runtime-sized array.
    pub(crate) fn element(&self, inner: &TypeInner) -> Result<(TypeInner, Option<u32>), String> {
        match *inner {
            TypeInner::Vector { size, scalar } => {
                Ok((TypeInner::Scalar(scalar), Some(size as u32)))
            }
            TypeInner::Matrix { columns, rows, scalar } => {
                Ok((TypeInner::Vector { size: rows, scalar }, Some(columns as u32)))
            }
            TypeInner::Array { base, size, .. } => {
                Ok((self.inner(base).clone(), self.length(size)?))
            }
            ref other => Err(format!("an index into {}", kind(other))),
        }
    }

    /// For buffers, the type of component `index`, and its offset in bytes.
    pub(crate) fn component_bytes(
        &self,
        inner: &TypeInner,
        index: u32,
    ) -> Result<(TypeInner, u32), String> {
        match *inner {
            TypeInner::Struct { ref members, .. } => {
                let member = members.get(index as usize).ok_or("a member that doesn't exist")?;
                Ok((self.inner(member.ty).clone(), member.offset))
            }
            _ => {
                let (element, _) = self.element(inner)?;
                let stride = stride_bytes(inner);
                let offset = stride.checked_mul(index).ok_or("an offset above 4 GiB")?;
                Ok((element, offset))
            }
        }
    }
}

pub(crate) fn stride_bytes(inner: &TypeInner) -> u32 {
    match *inner {
        TypeInner::Vector { scalar, .. } => u32::from(scalar.width),
        // A column of three scalars needs the space of four.
        TypeInner::Matrix { rows, scalar, .. } => {
            let rows = if rows == VectorSize::Tri { 4 } else { rows as u32 };
            rows * u32::from(scalar.width)
        }
        TypeInner::Array { stride, .. } => stride,
        _ => 0,
    }
}

pub(crate) fn kind(inner: &TypeInner) -> &'static str {
    match inner {
        TypeInner::Scalar(_) => "scalar",
        TypeInner::Vector { .. } => "vector",
        TypeInner::Matrix { .. } => "matrix",
        TypeInner::CooperativeMatrix { .. } => "cooperative matrix",
        TypeInner::Atomic(_) => "atomic",
        TypeInner::Pointer { .. } | TypeInner::ValuePointer { .. } => "pointer",
        TypeInner::Array { .. } => "array",
        TypeInner::Struct { .. } => "struct",
        TypeInner::Image { .. } => "texture",
        TypeInner::Sampler { .. } => "sampler",
        TypeInner::AccelerationStructure { .. } => "acceleration structure",
        TypeInner::RayQuery { .. } => "ray query",
        TypeInner::BindingArray { .. } => "binding array",
    }
}
