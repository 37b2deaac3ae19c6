//! Validates a scene, and turns it into data for executors.

use std::borrow::Cow;
use std::sync::Arc;

use super::request::{Draw, Geometry};
use super::{Blend, DrawError, Format};
use crate::diagnostic::{FileRead, Span, text_hash};
use crate::fixture::{self, FixtureError, Fixtures};
use crate::image::Image;
use crate::output::counted;
use crate::package::{LinkedModule, Package};
use crate::reflect::{Binding, Overrides, Program, Stage};
use crate::value::Shape;

/// A frame with its draws and settings, before validation.
#[derive(Clone, Debug)]
pub(crate) struct Scene<'a> {
    pub(crate) package: &'a Package,
    pub(crate) module: String,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) fixtures: Fixtures,
    /// Members of buffers, such as `globals.time`, to which the test gives a value.
    pub(crate) members: Vec<(String, Shape, Vec<u32>)>,
    pub(crate) overrides: Overrides,
    pub(crate) draws: Vec<Draw>,
    pub(crate) prepass: bool,
    pub(crate) blend: Blend,
    pub(crate) formats: Vec<Format>,
    pub(crate) result: Source,
    pub(crate) samples: u32,
    pub(crate) clear: [f32; 4],
    pub(crate) clear_depth: f32,
    /// The index of the first target for tapped values. Karat clears this target and all later targets to
    /// zeros.
    pub(crate) told: Option<usize>,
}

impl Scene<'_> {
    /// Returns the clear values if no draw changed any pixel, and `None` if a draw changed a pixel. Also returns `None`
    /// if a draw covers the whole frame, because its fragment function may return the clear values on purpose.
    pub(crate) fn untouched(&self, image: &Image) -> Option<[f32; 4]> {
        if self.draws.iter().any(Draw::covers) {
            return None;
        }
        let (clear, format) = match self.result {
            // The device copies depth as a 32-bit float.
            Source::Depth => ([self.clear_depth, 0.0, 0.0, 1.0], Format::R32Float),
            Source::Target(target) => (self.clear, self.formats[target]),
        };
        let is_clear = |pixel: &[f32; 4]| {
            let mut both = pixel.iter().zip(&clear).enumerate();
            both.all(|(channel, (x, clear))| format.keeps(channel, *clear, *x))
        };
        image.pixels().iter().all(is_clear).then_some(clear)
    }
}

/// The colour target or depth buffer that becomes a frame's image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// The colour target at a location.
    Target(usize),
    /// The depth buffer. The image's red channel has the depth.
    Depth,
}

/// A scene after validation: its shader is valid, and each fixture belongs to a variable of the shader.
#[derive(Debug)]
pub struct Drawing<'s> {
    pub(super) scene: Cow<'s, Scene<'s>>,
    pub(super) program: Arc<Program>,
    pub(super) bindings: Vec<Bindings>,
    /// The scene's fixtures. The buffers contain the values that the test sets for single members.
    fixtures: Fixtures,
    read: Read,
}

/// The shaders, files and modules of other frames whose images a drawing uses as textures.
#[derive(Debug, Default)]
struct Read {
    shaders: Vec<String>,
    files: Vec<FileRead>,
    modules: Vec<LinkedModule>,
}

#[derive(Debug)]
pub(crate) struct Bindings {
    pub(super) depth: Vec<Binding>,
    pub(super) color: Vec<Binding>,
}

impl Bindings {
    pub(crate) fn all(&self) -> impl Iterator<Item = &Binding> {
        self.depth.iter().chain(&self.color)
    }
}

impl<'a> Scene<'a> {
    pub(crate) fn new(package: &'a Package, module: &str, (width, height): (u32, u32)) -> Self {
        Self {
            package,
            module: module.to_owned(),
            width,
            height,
            fixtures: Vec::new(),
            members: Vec::new(),
            overrides: Overrides::new(),
            draws: Vec::new(),
            prepass: false,
            blend: Blend::Replace,
            formats: vec![Format::Float],
            result: Source::Target(0),
            samples: 1,
            clear: [0.0; 4],
            clear_depth: 1.0,
            told: None,
        }
    }
}

impl Scene<'_> {
    pub(crate) fn drawing(&self) -> Result<Drawing<'_>, DrawError> {
        Drawing::of(Cow::Borrowed(self))
    }

    pub(super) fn is_depth_only(&self) -> bool {
        self.draws.iter().all(|draw| draw.fragment.is_none())
    }

    fn expect_sound(&self) -> Result<(), DrawError> {
        let unsound = |setting, reason: String| Err(DrawError::Unsound { setting, reason });
        let targets = self.formats.len();
        let (depth_only, mixed) =
            (self.is_depth_only(), self.draws.iter().any(|draw| draw.fragment.is_none()));
        if self.draws.is_empty() {
            return Err(DrawError::Empty);
        }
        if mixed && !depth_only {
            return unsound(
                "depth",
                "some of its draws write only depth, and others write colour: make one frame for depth and one for colour"
                    .to_owned(),
            );
        }
        if let Some(other) = self.draws.iter().flat_map(Draw::named_targets).find(|t| *t >= targets)
        {
            return unsound(
                "target",
                format!(
                    "a draw has a setting for target {other}, but the frame's number of targets is {targets}, counted from 0"
                ),
            );
        }
        match self.result {
            Source::Target(_) if depth_only => {
                return unsound(
                    "depth",
                    "its draws write only depth: add `depth` to compare the depth".to_owned(),
                );
            }
            Source::Target(target) if target >= targets => {
                let has = counted(targets, "target");
                return unsound(
                    "target",
                    format!(
                        "the frame has {has}, counted from 0, so it can't show target {target}"
                    ),
                );
            }
            Source::Depth if self.samples > 1 => {
                return unsound(
                    "samples",
                    "with several samples, a pixel has several depths, and a frame can show only one: use 1 sample".to_owned(),
                );
            }
            _ => {}
        }
        for draw in &self.draws {
            if let Geometry::Mesh(mesh) = &draw.geometry
                && let Some(most) = mesh.most_instances()
                && (draw.first_instance as usize + draw.instances as usize) > most
            {
                return unsound(
                    "mesh",
                    format!(
                        "a draw makes {} copies of a mesh, beginning with copy {}, but an attribute has values for only {most} copies",
                        draw.instances, draw.first_instance
                    ),
                );
            }
        }
        Ok(())
    }

    pub(crate) fn bindings(&self, program: &Program) -> Result<Vec<Bindings>, DrawError> {
        let of = |stage: Stage, name: &Option<String>| {
            let Some(name) = name else { return Ok(Vec::new()) };
            program.entry_point_bindings(stage, name).ok_or_else(|| DrawError::EntryPoint {
                module: self.module.clone(),
                stage,
                name: name.clone(),
            })
        };
        let mut bindings = Vec::new();
        for draw in &self.draws {
            let vertex = of(Stage::Vertex, &draw.vertex)?;
            let fragment = of(Stage::Fragment, &draw.fragment)?;
            let depth = of(Stage::Fragment, &draw.depth_fragment)?;
            let (depth, color) = (union(&vertex, depth)?, union(&vertex, fragment)?);
            bindings.push(Bindings { depth, color });
        }
        Ok(bindings)
    }
}

impl<'s> Drawing<'s> {
    /// Links and validates the scene's functions, and checks that each fixture belongs to a variable.
    pub(crate) fn of(scene: Cow<'s, Scene<'s>>) -> Result<Self, DrawError> {
        scene.expect_sound()?;
        let names = |draw: &'_ Draw| {
            let all = [&draw.vertex, &draw.fragment, &draw.depth_fragment];
            all.into_iter().flatten().cloned().collect::<Vec<_>>()
        };
        let items: Vec<String> = scene.draws.iter().flat_map(names).collect();
        let items: Vec<&str> = items.iter().map(String::as_str).collect();
        let linked = Program::of_items(scene.package, &scene.module, &items)?;
        // The rest of the module must be valid, too.
        if !scene.package.is_crate() {
            crate::reflect::validate(scene.package, &scene.module, &linked)?;
        }
        let program = linked.overridden(&scene.overrides)?;
        scene.expect_targets(&program)?;
        scene.expect_inputs(&program)?;
        let bindings = scene.bindings(&program)?;
        let all: Vec<Binding> = bindings.iter().flat_map(Bindings::all).cloned().collect();
        let members = scene.members.iter().map(|(path, shape, lanes)| (&**path, shape, &**lanes));
        let fixtures = fixture::with_members(&program, &all, &scene.fixtures, members)?;
        let drawing = Self::with(scene, program, bindings, fixtures);
        fixture::check_used(&drawing.all_bindings(), &drawing.fixtures)?;
        Ok(drawing)
    }

    pub(super) fn with(
        scene: Cow<'s, Scene<'s>>,
        program: Arc<Program>,
        bindings: Vec<Bindings>,
        fixtures: Fixtures,
    ) -> Self {
        Self { scene, program, bindings, fixtures, read: Read::default() }
    }

    /// Notes that this drawing reads the frame `other`.
    pub(crate) fn reads(&mut self, other: &Drawing<'_>) {
        self.read.shaders.push(other.shader());
        self.read.files.extend(other.read());
        self.read.modules.extend(other.modules());
    }
}

impl Drawing<'_> {
    /// The width and height of the frame, in pixels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        (self.scene.width, self.scene.height)
    }

    /// The module that contains the entry points.
    #[must_use]
    pub fn module(&self) -> &str {
        &self.scene.module
    }

    /// The names of the entry points of all draws, and the source position of the last entry point.
    pub(crate) fn entry_points(&self) -> (Vec<&str>, Option<Span>) {
        let all = self.scene.draws.iter().flat_map(|draw| {
            [&draw.vertex, &draw.fragment, &draw.depth_fragment].into_iter().flatten()
        });
        let names: Vec<&str> = all.map(String::as_str).collect();
        let span = names.last().and_then(|name| self.program.entry_point_span(name));
        (names, span)
    }

    /// The program that all draws run.
    #[must_use]
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// The textures, samplers and buffers, by the name of their variable.
    #[must_use]
    pub fn fixtures(&self) -> &Fixtures {
        &self.fixtures
    }

    pub(crate) fn all_bindings(&self) -> Vec<Binding> {
        self.bindings.iter().flat_map(Bindings::all).cloned().collect()
    }

    pub(crate) fn scene(&self) -> &Scene<'_> {
        &self.scene
    }

    pub(crate) fn bindings(&self) -> &[Bindings] {
        &self.bindings
    }

    pub(crate) fn shader(&self) -> String {
        let text = self.program.text();
        match &*self.read.shaders {
            [] => text_hash(text.as_bytes()),
            others => text_hash([text, &*others.concat()].concat().as_bytes()),
        }
    }

    /// The files that the drawing depends on, and the files of the frames that the drawing reads as textures.
    pub(crate) fn read(&self) -> Vec<FileRead> {
        let fixtures = self.fixtures.iter().flat_map(|(_, fixture)| fixture.read());
        self.program.files().iter().chain(fixtures).chain(&self.read.files).cloned().collect()
    }

    /// The linked modules of the drawing's shaders, and of the frames that the drawing reads as textures.
    pub(crate) fn modules(&self) -> Vec<LinkedModule> {
        self.program.modules().iter().chain(&self.read.modules).cloned().collect()
    }
}

/// Joins the bindings of a draw's vertex function and fragment function. Two variables of one draw can't share a
/// binding, because the draw would ignore one of the fixtures.
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
