//! The values that functions leave each other in private variables: the state of a random number generator, a hit that was found.

use std::sync::Arc;

use naga::{AddressSpace, Expression, GlobalVariable, Literal, ScalarKind, Span, TypeInner};

use super::{NAMED, Program};

/// Private variables with the values that they are given.
pub(crate) type State = Vec<(String, String)>;

impl Program {
    /// True if functions leave each other something in private variables: those that have no initial value.
    pub fn has_state(&self) -> bool {
        self.checked.module.global_variables.iter().any(|(_, one)| is_state(one))
    }

    /// The program in the middle of its run: its private variables have other values than at first. Beside it these variables
    /// with their values, which depend on their types alone. `None` if there are none of numbers and vectors.
    pub fn with_state(&self) -> Option<(Arc<Self>, State)> {
        /// Fractions, by the component: none is another's, and none is plain.
        const FLOATS: [f32; 4] = [0.618, 0.271, 0.839, 0.467];
        /// Bits of all places (the fractions of the roots of 2, 3, 5 and 7).
        const WHOLES: [u32; 4] = [0x6a09_e667, 0xbb67_ae85, 0x3c6e_f372, 0xa54f_f53a];
        let mut module = self.checked.module.clone();
        let mut shown = Vec::new();
        for (_, variable) in module.global_variables.iter_mut() {
            // An initial value is what the first call finds.
            if variable.space != AddressSpace::Private {
                continue;
            }
            let (size, scalar) = match module.types[variable.ty].inner {
                TypeInner::Scalar(scalar) => (None, scalar),
                TypeInner::Vector { size, scalar } => (Some(size), scalar),
                _ => continue,
            };
            let literal = |lane: usize| match (scalar.kind, scalar.width) {
                (ScalarKind::Float, 4) => Some(Literal::F32(FLOATS[lane])),
                (ScalarKind::Uint, 4) => Some(Literal::U32(WHOLES[lane])),
                (ScalarKind::Sint, 4) => Some(Literal::I32(WHOLES[lane].cast_signed())),
                _ => None,
            };
            let lanes = size.map_or(1, |size| size as usize);
            let Some(literals) = (0..lanes).map(literal).collect::<Option<Vec<_>>>() else {
                continue;
            };
            let text = |one: &Literal| match one {
                Literal::F32(x) => x.to_string(),
                Literal::U32(x) => x.to_string(),
                Literal::I32(x) => x.to_string(),
                _ => String::new(),
            };
            let texts = literals.iter().map(text).collect::<Vec<_>>().join(", ");
            let expressions = &mut module.global_expressions;
            let mut add = |one| expressions.append(one, Span::UNDEFINED);
            let components: Vec<_> =
                literals.into_iter().map(|one| add(Expression::Literal(one))).collect();
            let init = match size {
                Some(_) => add(Expression::Compose { ty: variable.ty, components }),
                None => components[0],
            };
            variable.init = Some(init);
            let name = variable.name.as_deref().expect(NAMED);
            let name = self.author_path(name).unwrap_or(name);
            let name = name.rsplit("::").next().unwrap_or(name).to_owned();
            shown.push((name, if lanes == 1 { texts } else { format!("({texts})") }));
        }
        if shown.is_empty() {
            return None;
        }
        let program = Self::from_ir(self.linked.clone(), module).ok()?;
        Some((Arc::new(Self { overrides: self.overrides.clone(), ..program }), shown))
    }
}

fn is_state(variable: &GlobalVariable) -> bool {
    variable.space == AddressSpace::Private && variable.init.is_none()
}
