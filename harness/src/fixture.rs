//! What a test supplies for the resource variables that its function reads.

mod cube_map;
mod texture;

pub use cube_map::{CubeMap, CubeMapError};
pub(crate) use texture::Level;
pub use texture::Texture;

use crate::diagnostic::{FileRead, nearest};
use crate::path::PathError;
use crate::reflect::{Binding, BindingKind, LayoutError, Program, bytes_of};
use crate::value::{Shape, Shareable};

/// How a texture is sampled. Coordinates outside [0, 1] are clamped to the edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampler {
    /// Linear between texels and between mip levels.
    Linear,
    /// The nearest texel.
    Nearest,
}

/// A value for a `var<uniform>`, or for a `var<storage>` that holds one value.
#[derive(Clone, Debug)]
pub struct Uniform(pub(crate) Values);

impl Uniform {
    /// The value, laid out as the variable's type.
    pub fn new<T: Shareable>(value: T) -> Self {
        let mut lanes = Vec::new();
        value.store(&mut lanes);
        Self(Values { shape: T::shape(), lanes })
    }

    /// The value of a type that is known at run time, by its lanes.
    #[must_use]
    pub fn of_lanes(shape: Shape, lanes: Vec<u32>) -> Self {
        Self(Values { shape, lanes })
    }
}

/// Elements for a `var<storage>` array.
#[derive(Clone, Debug)]
pub struct Storage(pub(crate) Values);

impl Storage {
    /// The elements, laid out as the variable's type.
    pub fn new<T: Shareable>(elements: impl IntoIterator<Item = T>) -> Self {
        let mut lanes = Vec::new();
        for element in elements {
            element.store(&mut lanes);
        }
        Self(Values { shape: T::shape(), lanes })
    }

    /// Elements of a type that is known at run time, by the lanes of one after the other.
    #[must_use]
    pub fn of_lanes(element: Shape, lanes: Vec<u32>) -> Self {
        Self(Values { shape: element, lanes })
    }
}

/// The lanes of a value, or of the elements of an array.
#[derive(Clone, Debug)]
pub(crate) struct Values {
    /// The type of the value or element.
    shape: Shape,
    lanes: Vec<u32>,
}

impl Values {
    /// Whether these are the values of a variable of shape `wgsl`: the type itself, or elements of
    /// that array type.
    fn fit(&self, wgsl: &Shape) -> bool {
        let element = match wgsl {
            Shape::Array { element, .. } => self.shape.stands_for(element, false),
            _ => false,
        };
        element || self.shape.stands_for(wgsl, false)
    }
}

/// What a test binds to a resource variable.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Fixture {
    /// `texture_cube<f32>`
    CubeMap(CubeMap),
    /// `texture_2d<f32>`
    Texture(Texture),
    /// `sampler`
    Sampler(Sampler),
    /// `var<uniform>`
    Uniform(Uniform),
    /// `var<storage>`
    Storage(Storage),
}

impl Fixture {
    fn kind(&self) -> &'static str {
        match self {
            Self::CubeMap(_) => "a CubeMap",
            Self::Texture(_) => "a Texture",
            Self::Sampler(_) => "a Sampler",
            Self::Uniform(_) => "a Uniform",
            Self::Storage(_) => "a Storage",
        }
    }

    /// A buffer of these lanes: of one value, or of the elements of an array without a length.
    #[cfg(any(feature = "engine", feature = "routes"))]
    pub(crate) fn of_lanes(shape: Shape, lanes: Vec<u32>, elements: bool) -> Self {
        let values = Values { shape, lanes };
        if elements { Self::Storage(Storage(values)) } else { Self::Uniform(Uniform(values)) }
    }

    /// The files that it was made of.
    pub(crate) fn read(&self) -> &[FileRead] {
        match self {
            Self::CubeMap(CubeMap { read, .. }) | Self::Texture(Texture { read, .. }) => read,
            Self::Sampler(_) | Self::Uniform(_) | Self::Storage(_) => &[],
        }
    }

    fn fits(&self, kind: BindingKind) -> bool {
        matches!(
            (self, kind),
            (Self::CubeMap(_), BindingKind::TextureCube)
                | (Self::Texture(_), BindingKind::Texture2d)
                | (Self::Sampler(_), BindingKind::Sampler)
                | (Self::Uniform(_), BindingKind::Uniform | BindingKind::Storage { .. })
                | (Self::Storage(_), BindingKind::Storage { .. } | BindingKind::Uniform)
        )
    }
}

macro_rules! into_fixture {
    ($($name:ident),*) => {$(
        impl From<$name> for Fixture {
            fn from(fixture: $name) -> Self {
                Self::$name(fixture)
            }
        }
    )*};
}

into_fixture!(CubeMap, Texture, Sampler, Uniform, Storage);

/// Why fixtures and variables don't match.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FixtureError {
    /// A variable has no fixture.
    #[error("`{variable}` ({kind}) has no fixture; add `.with(\"{variable}\", ...)`")]
    Missing {
        /// The variable.
        variable: String,
        /// What it is.
        kind: BindingKind,
    },
    /// There is no variable for a fixture.
    #[error("the shader reads no variable `{name}`{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    Unused {
        /// What the fixture was called.
        name: String,
        /// The closest variable.
        nearest: Option<String>,
    },
    /// A fixture is of another kind than its variable.
    #[error("`{variable}` is a {kind}, the fixture is {fixture}")]
    Kind {
        /// The variable.
        variable: String,
        /// What it is.
        kind: BindingKind,
        /// What was supplied.
        fixture: &'static str,
    },
    /// The values are of another type than the variable.
    #[error("`{variable}` holds {wgsl}, the fixture {supplied}")]
    Type {
        /// The variable.
        variable: String,
        /// Its type, or that of its elements.
        wgsl: String,
        /// What was supplied.
        supplied: String,
    },
    /// Two variables of one draw have the same binding.
    #[error(
        "`{}` and `{}` are both @group({group}) @binding({binding}), and one draw can bind only one \
         of them: give one another number",
        variables[0],
        variables[1]
    )]
    Shared {
        /// The variables.
        variables: [String; 2],
        /// `@group`
        group: u32,
        /// `@binding`
        binding: u32,
    },
    /// The fixture has no values or no texels.
    #[error("the fixture of `{variable}` is empty")]
    Empty {
        /// The variable.
        variable: String,
    },
    /// The path's texture format can't hold a texel.
    #[error(
        "a texel of `{variable}` is {value}, but path `{path}` filters 16-bit floats only, which \
         end at 65504"
    )]
    Range {
        /// The variable.
        variable: String,
        /// The value.
        value: f32,
        /// The path.
        path: crate::path::Path,
    },
    /// The values don't fill the variable's type.
    #[error("`{variable}`: {source}")]
    Layout {
        /// The variable.
        variable: String,
        /// How they differ.
        source: LayoutError,
    },
    /// The device refused.
    #[error(transparent)]
    Path(#[from] PathError),
}

/// Fixtures by the name of their variable: `environment`, or `sky::environment`.
pub(crate) type Fixtures = Vec<(String, Fixture)>;

fn named(binding: &Binding, name: &str) -> bool {
    binding.path == name || binding.name() == name
}

/// Refuses a fixture that no variable is called by: a misspelt name would be ignored otherwise.
pub(crate) fn check_used(bindings: &[Binding], fixtures: &Fixtures) -> Result<(), FixtureError> {
    for (name, _) in fixtures {
        if !bindings.iter().any(|binding| named(binding, name)) {
            let known = bindings.iter().map(Binding::name);
            let nearest = nearest(name, known).map(str::to_owned);
            return Err(FixtureError::Unused { name: name.clone(), nearest });
        }
    }
    Ok(())
}

/// The fixture of each variable, the last one given where there are several.
pub(crate) fn resolve<'a>(
    bindings: &'a [Binding],
    fixtures: &'a Fixtures,
) -> Result<Vec<(&'a Binding, &'a Fixture)>, FixtureError> {
    bindings
        .iter()
        .map(|binding| {
            let (variable, kind) = (binding.path.clone(), binding.kind);
            match fixtures.iter().rev().find(|(name, _)| named(binding, name)) {
                None => Err(FixtureError::Missing { variable, kind }),
                Some((_, fixture)) if !fixture.fits(kind) => {
                    Err(FixtureError::Kind { variable, kind, fixture: fixture.kind() })
                }
                Some((_, fixture)) => Ok((binding, fixture)),
            }
        })
        .collect()
}

impl Values {
    /// Laid out as the variable's type, which they have to fit.
    pub(crate) fn bytes(
        &self,
        program: &Program,
        binding: &Binding,
    ) -> Result<Vec<u8>, FixtureError> {
        let variable = || binding.path.clone();
        let wgsl = program.buffer_shape(binding.ty);
        if let Some(wgsl) = wgsl.filter(|wgsl| !self.fit(wgsl)) {
            let (wgsl, supplied) = (members(&wgsl), members(&self.shape));
            return Err(FixtureError::Type { variable: variable(), wgsl, supplied });
        }
        if self.lanes.is_empty() {
            return Err(FixtureError::Empty { variable: variable() });
        }
        bytes_of(program.module(), program.layouter(), binding.ty, &self.lanes)
            .map_err(|source| FixtureError::Layout { variable: variable(), source })
    }
}

/// A type with its members, where it has any.
fn members(shape: &Shape) -> String {
    match shape {
        Shape::Struct { members, .. } => {
            let members: Vec<String> =
                members.iter().map(|(name, shape)| format!("{name}: {shape}")).collect();
            format!("{{ {} }}", members.join(", "))
        }
        other => other.to_string(),
    }
}
