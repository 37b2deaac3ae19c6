//! Reads the outputs of fragment functions.

use naga::{Binding, ShaderStage, TypeInner};

use super::{Program, Texels};

/// An output of a fragment function, with its `@location`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Output {
    pub(crate) location: u32,
    pub(crate) kind: Texels,
    pub(crate) components: u8,
}

impl Program {
    pub(crate) fn fragment_outputs(&self, fragment: &str) -> Option<Vec<Output>> {
        let written = self.written_by(fragment)?;
        Some(written.into_iter().filter_map(|(binding, inner)| output(binding, inner)).collect())
    }

    pub(crate) fn writes_depth(&self, fragment: &str) -> bool {
        let written = self.written_by(fragment).unwrap_or_default();
        let is_depth =
            |binding: &Binding| matches!(binding, Binding::BuiltIn(naga::BuiltIn::FragDepth));
        written.into_iter().any(|(binding, _)| is_depth(binding))
    }

    fn written_by(&self, fragment: &str) -> Option<Vec<(&Binding, &TypeInner)>> {
        let name = self.entry_point_name(fragment);
        let module = &self.checked.module;
        let mut entries = module.entry_points.iter();
        let entry = entries.find(|e| e.name == name && e.stage == ShaderStage::Fragment)?;
        let Some(result) = &entry.function.result else { return Some(Vec::new()) };
        let inner = &module.types[result.ty].inner;
        Some(match (&result.binding, inner) {
            (Some(binding), _) => vec![(binding, inner)],
            (None, TypeInner::Struct { members, .. }) => members
                .iter()
                .filter_map(|member| {
                    Some((member.binding.as_ref()?, &module.types[member.ty].inner))
                })
                .collect(),
            _ => Vec::new(),
        })
    }
}

fn output(binding: &Binding, inner: &TypeInner) -> Option<Output> {
    let Binding::Location { location, .. } = binding else { return None };
    let (scalar, components) = match inner {
        TypeInner::Scalar(scalar) => (scalar, 1),
        TypeInner::Vector { size, scalar } => (scalar, *size as u8),
        _ => return None,
    };
    let kind = match scalar.kind {
        naga::ScalarKind::Sint => Texels::Sint,
        naga::ScalarKind::Uint => Texels::Uint,
        _ => Texels::Float,
    };
    Some(Output { location: *location, kind, components })
}
