//! Draws as data, and the program that they run.

use std::sync::Arc;

use super::{Blend, DrawError, Mesh};
use crate::diagnostic::FileRead;
use crate::fixture::{self, FixtureError, Fixtures};
use crate::package::Package;
use crate::reflect::{Binding, Program, Stage};

/// What a frame is made of, as its author says it.
#[derive(Clone, Debug)]
pub(crate) struct Scene<'a> {
    pub(crate) package: &'a Package,
    pub(crate) module: String,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) fixtures: Fixtures,
    pub(crate) draws: Vec<Draw>,
    pub(crate) prepass: bool,
    pub(crate) blend: Blend,
}

/// A mesh or a triangle with its entry points.
#[derive(Clone, Debug)]
pub(crate) struct Draw {
    pub(crate) vertex: String,
    pub(crate) fragment: String,
    /// What the depth pre-pass runs; `None`: depth comes from the triangles alone.
    pub(crate) depth_fragment: Option<String>,
    /// `None`: one triangle that covers the frame, from `@builtin(vertex_index)`.
    pub(crate) mesh: Option<(Mesh, u32)>,
}

/// A scene whose shader is valid and whose fixtures fit it.
#[derive(Debug)]
pub struct Drawing<'s> {
    pub(super) scene: &'s Scene<'s>,
    pub(super) program: Arc<Program>,
    /// What each draw reads.
    pub(super) bindings: Vec<Bindings>,
}

/// What a draw's two pipelines read.
#[derive(Debug)]
pub(super) struct Bindings {
    pub(super) depth: Vec<Binding>,
    pub(super) color: Vec<Binding>,
}

impl Scene<'_> {
    /// Links and validates what the draws run, and sees that each variable has its fixture.
    pub(crate) fn drawing(&self) -> Result<Drawing<'_>, DrawError> {
        if self.draws.is_empty() {
            return Err(DrawError::Empty);
        }
        let mut items: Vec<&str> = Vec::new();
        for draw in &self.draws {
            items.extend([draw.vertex.as_str(), draw.fragment.as_str()]);
            items.extend(draw.depth_fragment.as_deref());
        }
        let program = Program::of_items(self.package, &self.module, &items)?;
        // What the draws don't reach must be valid, too, as of functions that are probed.
        if !self.package.is_crate() {
            crate::reflect::validate(self.package, &self.module)?;
        }
        let bindings = self.bindings(&program)?;
        let drawing = Drawing { scene: self, program, bindings };
        fixture::check_used(&drawing.all_bindings(), &self.fixtures)?;
        Ok(drawing)
    }

    /// What each draw of a program reads.
    pub(super) fn bindings(&self, program: &Program) -> Result<Vec<Bindings>, DrawError> {
        let of = |stage: Stage, name: &str| {
            program.entry_point_bindings(stage, name).ok_or_else(|| DrawError::EntryPoint {
                module: self.module.clone(),
                stage,
                name: name.to_owned(),
            })
        };
        let mut bindings = Vec::new();
        for draw in &self.draws {
            let vertex = of(Stage::Vertex, &draw.vertex)?;
            let fragment = of(Stage::Fragment, &draw.fragment)?;
            let depth = match &draw.depth_fragment {
                Some(fragment) => of(Stage::Fragment, fragment)?,
                None => Vec::new(),
            };
            let (depth, color) = (union(&vertex, depth)?, union(&vertex, fragment)?);
            bindings.push(Bindings { depth, color });
        }
        Ok(bindings)
    }
}

impl Drawing<'_> {
    /// Width and height of the frame.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        (self.scene.width, self.scene.height)
    }

    /// The module that has the entry points.
    #[must_use]
    pub fn module(&self) -> &str {
        &self.scene.module
    }

    /// The program that the draws run.
    #[must_use]
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// The textures, samplers and buffers of the variables, by name.
    #[must_use]
    pub fn fixtures(&self) -> &Fixtures {
        &self.scene.fixtures
    }

    /// What all draws read.
    pub(super) fn all_bindings(&self) -> Vec<Binding> {
        let of = |bindings: &Bindings| [&*bindings.depth, &*bindings.color].concat();
        self.bindings.iter().flat_map(of).collect()
    }

    /// The hash of the WGSL that is run.
    pub(crate) fn shader(&self) -> String {
        blake3::hash(self.program.text().as_bytes()).to_hex().to_string()
    }

    /// The files that it depends on.
    pub(crate) fn read(&self) -> Vec<FileRead> {
        let fixtures = self.scene.fixtures.iter().flat_map(|(_, fixture)| fixture.read());
        self.program.files().iter().chain(fixtures).cloned().collect()
    }
}

/// The bindings of both stages. Two variables can't share a binding in one draw: of their fixtures
/// one would be ignored.
fn union(some: &[Binding], others: Vec<Binding>) -> Result<Vec<Binding>, FixtureError> {
    let mut all = some.to_vec();
    for other in others {
        let place = |binding: &Binding| (binding.group, binding.binding);
        match some.iter().find(|binding| place(binding) == place(&other)) {
            None => all.push(other),
            Some(same) if same.path == other.path => {}
            Some(same) => {
                let (group, binding) = place(&other);
                let variables = [same.path.clone(), other.path];
                return Err(FixtureError::Shared { variables, group, binding });
            }
        }
    }
    Ok(all)
}
