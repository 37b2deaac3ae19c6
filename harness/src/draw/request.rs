//! Describes a draw.

use super::state::State;
use super::{Blend, Cull, DepthBias, Mesh, Stencil, Winding};
use crate::fixture::Compare;
use crate::reflect::Program;

/// One draw of a frame: its entry points, its geometry and its state.
///
/// ```
/// use glam::Vec3;
/// use karat::draw::{Blend, Cull, Draw, Mesh};
///
/// let leaf = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![0, 1, 2]);
/// let leaves = Draw::mesh("vertex", "fragment", leaf)
///     .instances(100)
///     .cull(Cull::None)
///     .blend(Blend::Premultiplied)
///     .depth_write(false);
/// # let _ = leaves;
/// ```
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
#[must_use = "a draw draws nothing until you pass it to `Frame::draw`"]
pub struct Draw {
    /// The vertex function. `None` stands for Karat's own function, whose triangle covers the frame.
    pub(super) vertex: Option<String>,
    /// The fragment function. `None` if the draw writes only depth.
    pub(super) fragment: Option<String>,
    /// The fragment function of the depth pre-pass. `None` if the pre-pass writes the depth of the triangles.
    pub(super) depth_fragment: Option<String>,
    pub(super) geometry: Geometry,
    pub(super) instances: u32,
    pub(super) first_instance: u32,
    pub(super) base_vertex: i32,
    /// `true` if the GPU reads the numbers of vertices and copies from a buffer (an indirect draw).
    pub(super) indirect: bool,
    pub(super) u16_indices: bool,
    pub(super) state: State,
}

#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Geometry {
    Mesh(Mesh),
    /// Vertices without attributes. The vertex function computes this number of vertices from `@builtin(vertex_index)`.
    Vertices(u32),
}

impl Draw {
    fn new(vertex: Option<&str>, fragment: Option<&str>, geometry: Geometry) -> Self {
        Self {
            vertex: vertex.map(str::to_owned),
            fragment: fragment.map(str::to_owned),
            depth_fragment: None,
            geometry,
            instances: 1,
            first_instance: 0,
            base_vertex: 0,
            indirect: false,
            u16_indices: false,
            state: State::default(),
        }
    }

    /// Draws a mesh. By default, the draw culls back faces: see [`cull`](Self::cull).
    ///
    /// ```no_run
    /// use glam::Vec3;
    /// use karat::draw::{Draw, Mesh};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    ///
    /// let leaf = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![0, 1, 2]);
    /// SHADERS.frame("leaf", 64, 64).draw(Draw::mesh("vertex", "fragment", leaf)).matches(&GOLDENS, "leaf");
    /// ```
    pub fn mesh(vertex: &str, fragment: &str, mesh: Mesh) -> Self {
        Self::new(Some(vertex), Some(fragment), Geometry::Mesh(mesh))
    }

    /// Draws only the depth of a mesh, as for a shadow map. All other draws of the frame must also write only depth.
    ///
    /// ```no_run
    /// use karat::draw::{Draw, Mesh};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # let scene = Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    /// let shadow_map = SHADERS.frame("shadow", 512, 512).draw(Draw::depth("vertex", scene)).depth();
    /// # let _ = shadow_map;
    /// ```
    pub fn depth(vertex: &str, mesh: Mesh) -> Self {
        Self::new(Some(vertex), None, Geometry::Mesh(mesh))
    }

    /// Draws triangles without a mesh. The vertex function computes the `count` vertices from `@builtin(vertex_index)`.
    ///
    /// ```no_run
    /// use karat::draw::Draw;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// // fn vertex(@builtin(vertex_index) index: u32): six corners, two triangles
    /// let square = Draw::vertices("vertex", "fragment", 6);
    /// SHADERS.frame("sprite", 64, 64).draw(square).matches(&GOLDENS, "sprite");
    /// ```
    ///
    /// # Panics
    /// Panics if the number of vertices is 0 or isn't a multiple of three.
    pub fn vertices(vertex: &str, fragment: &str, count: u32) -> Self {
        assert!(
            count > 0 && count.is_multiple_of(3),
            "{count} vertices can't form triangles: use a positive multiple of 3"
        );
        Self::new(Some(vertex), Some(fragment), Geometry::Vertices(count))
    }

    /// Draws one triangle. The vertex function computes the three corners from `@builtin(vertex_index)`. A triangle at
    /// depth 1 is visible only where the frame has no mesh.
    ///
    /// ```no_run
    /// use karat::draw::Draw;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS.frame("sky", 64, 64).draw(Draw::fullscreen("vertex", "fragment")).matches(&GOLDENS, "sky");
    /// ```
    pub fn fullscreen(vertex: &str, fragment: &str) -> Self {
        Self::new(Some(vertex), Some(fragment), Geometry::Vertices(3))
    }

    /// Draws over the whole frame with only a fragment function. If the function has an input at a location, the input
    /// must be a `vec2f`. The input gets texture coordinates from (0, 0) at the upper left to (1, 1) at the lower
    /// right. By default, all pixels pass the depth test, and the draw writes depth only if the function returns a
    /// depth (`@builtin(frag_depth)`).
    ///
    /// ```no_run
    /// use karat::draw::{Blend, Draw};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS
    ///     .frame("sky", 64, 64)
    ///     .draw(Draw::fragment("background"))
    ///     .draw(Draw::fragment("haze").blend(Blend::Alpha))
    ///     .matches(&GOLDENS, "hazy");
    /// ```
    pub fn fragment(fragment: &str) -> Self {
        let mut draw = Self::new(None, Some(fragment), Geometry::Vertices(3));
        draw.state.depth_compare = Some(Compare::Always);
        draw
    }

    /// Draws this number of copies. By default, the first copy has `@builtin(instance_index)` 0.
    ///
    /// ```
    /// use karat::draw::Draw;
    /// # use karat::draw::Mesh;
    /// # let leaf = || Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    ///
    /// let draw = Draw::mesh("vertex", "fragment", leaf()).instances(100);
    /// # let _ = draw;
    /// ```
    pub fn instances(mut self, instances: u32) -> Self {
        self.instances = instances;
        self
    }

    /// Sets the index of the first copy.
    ///
    /// ```
    /// use karat::draw::Draw;
    /// # use karat::draw::Mesh;
    /// # let leaf = || Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    ///
    /// let draw = Draw::mesh("vertex", "fragment", leaf()).instances(10).first_instance(90); // copies 90 to 99
    /// # let _ = draw;
    /// ```
    pub fn first_instance(mut self, first: u32) -> Self {
        self.first_instance = first;
        self
    }

    /// Sets a number that the GPU adds to each index of a mesh. If the draw has no mesh, the number is the index of the
    /// first vertex.
    ///
    /// ```
    /// use karat::draw::Draw;
    ///
    /// let draw = Draw::vertices("vertex", "fragment", 3).base_vertex(6); // vertices 6, 7 and 8
    /// # let _ = draw;
    /// ```
    pub fn base_vertex(mut self, base: i32) -> Self {
        self.base_vertex = base;
        self
    }

    /// Lets the GPU read the numbers of vertices and copies from a buffer.
    ///
    /// ```
    /// use karat::draw::Draw;
    /// # use karat::draw::Mesh;
    /// # let leaf = || Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    ///
    /// let draw = Draw::mesh("vertex", "fragment", leaf()).instances(100).indirect();
    /// # let _ = draw;
    /// ```
    pub fn indirect(mut self) -> Self {
        self.indirect = true;
        self
    }

    /// Uses 16-bit indices instead of 32-bit indices.
    ///
    /// ```
    /// use karat::draw::Draw;
    /// # use karat::draw::Mesh;
    /// # let leaf = || Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    ///
    /// let draw = Draw::mesh("vertex", "fragment", leaf()).u16_indices();
    /// # let _ = draw;
    /// ```
    ///
    /// # Panics
    /// Panics if the draw has no mesh, or if an index is above 65534. GPUs reserve the 16-bit index 65535: it restarts
    /// a strip of triangles.
    pub fn u16_indices(mut self) -> Self {
        let Geometry::Mesh(mesh) = &self.geometry else {
            panic!("the draw has no mesh, so it has no indices")
        };
        let most = mesh.indices.iter().max().copied().unwrap_or(0);
        assert!(
            most < u32::from(u16::MAX),
            "index {most} is above 65534: GPUs reserve the 16-bit index 65535"
        );
        self.u16_indices = true;
        self
    }

    /// Sets the fragment function for the depth pre-pass. This function must discard pixels and write depth exactly as
    /// the colour pass's function does. Its only allowed result is a depth.
    ///
    /// ```
    /// use karat::draw::Draw;
    /// # use karat::draw::Mesh;
    /// # let leaf = || Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    ///
    /// let draw = Draw::mesh("vertex", "fragment", leaf()).depth_fragment("cutout");
    /// # let _ = draw;
    /// ```
    pub fn depth_fragment(mut self, fragment: &str) -> Self {
        self.depth_fragment = Some(fragment.to_owned());
        self
    }

    /// Sets the faces that aren't drawn. By default, a draw of a mesh doesn't draw back faces, and any other draw draws
    /// all faces.
    ///
    /// ```
    /// use karat::draw::{Cull, Draw};
    /// # use karat::draw::Mesh;
    /// # let leaf = || Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    ///
    /// let draw = Draw::mesh("vertex", "fragment", leaf()).cull(Cull::None); // both sides
    /// # let _ = draw;
    /// ```
    pub fn cull(mut self, cull: Cull) -> Self {
        self.state.cull = Some(cull);
        self
    }

    /// Sets the order of a front face's corners. The default is counter-clockwise.
    ///
    /// ```
    /// use karat::draw::{Draw, Winding};
    /// # use karat::draw::Mesh;
    /// # let leaf = || Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    ///
    /// let draw = Draw::mesh("vertex", "fragment", leaf()).front_face(Winding::Clockwise);
    /// # let _ = draw;
    /// ```
    pub fn front_face(mut self, winding: Winding) -> Self {
        self.state.winding = winding;
        self
    }

    /// Sets the comparison of a pixel's depth with the depth buffer. The default is `new <= old`.
    ///
    /// ```
    /// use karat::draw::Draw;
    /// use karat::fixture::Compare;
    /// # use karat::draw::Mesh;
    /// # let leaf = || Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    ///
    /// let draw = Draw::mesh("vertex", "fragment", leaf()).depth_compare(Compare::Greater);
    /// # let _ = draw;
    /// ```
    pub fn depth_compare(mut self, compare: Compare) -> Self {
        self.state.depth_compare = Some(compare);
        self
    }

    /// Turns depth writes on (`true`) or off (`false`). The default is `true`. For a draw with only a fragment
    /// function, the default is `true` only if the function returns a depth.
    ///
    /// ```
    /// use karat::draw::Draw;
    /// # use karat::draw::Mesh;
    /// # let leaf = || Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    ///
    /// let draw = Draw::mesh("vertex", "fragment", leaf()).depth_write(false); // transparent: hides nothing behind it
    /// # let _ = draw;
    /// ```
    pub fn depth_write(mut self, write: bool) -> Self {
        self.state.depth_write = Some(write);
        self
    }

    /// Sets a bias to add to the depth.
    ///
    /// ```
    /// use karat::draw::{DepthBias, Draw};
    /// # use karat::draw::Mesh;
    /// # let leaf = || Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    ///
    /// let draw = Draw::depth("vertex", leaf()).depth_bias(DepthBias { slope: 1.5, ..DepthBias::default() });
    /// # let _ = draw;
    /// ```
    pub fn depth_bias(mut self, bias: DepthBias) -> Self {
        self.state.bias = bias;
        self
    }

    /// Sets the stencil test, and the changes to the stencil. The stencil of a frame starts with zeros.
    ///
    /// ```no_run
    /// use karat::draw::{Draw, Stencil, StencilOperation};
    /// use karat::fixture::Compare;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// let mark = Stencil { reference: 1, pass: StencilOperation::Replace, ..Stencil::default() };
    /// let marked = Stencil { reference: 1, compare: Compare::Equal, ..Stencil::default() };
    /// SHADERS
    ///     .frame("portal", 64, 64)
    ///     .draw(Draw::vertices("frame_vertex", "nothing", 3).stencil(mark))
    ///     .draw(Draw::fullscreen("vertex", "behind").stencil(marked))
    ///     .matches(&GOLDENS, "portal");
    /// ```
    pub fn stencil(mut self, stencil: Stencil) -> Self {
        self.state.stencil = Some(stencil);
        self
    }

    /// Sets the blending in all targets. The default is the blending of the frame.
    ///
    /// ```
    /// use karat::draw::{Blend, Draw};
    ///
    /// let draw = Draw::fullscreen("vertex", "fragment").blend(Blend::Alpha);
    /// # let _ = draw;
    /// ```
    pub fn blend(mut self, blend: Blend) -> Self {
        self.state.blend = Some(blend);
        self
    }

    /// Sets the blending in one target.
    ///
    /// ```
    /// use karat::draw::{Blend, Draw};
    ///
    /// let draw = Draw::fullscreen("vertex", "fragment").blend_target(1, Blend::Add);
    /// # let _ = draw;
    /// ```
    pub fn blend_target(mut self, target: usize, blend: Blend) -> Self {
        self.state.blends.push((target, blend));
        self
    }

    /// Sets the constant of [`BlendFactor::Constant`](super::BlendFactor::Constant).
    ///
    /// ```
    /// use karat::draw::{Blend, BlendComponent, Draw, BlendFactor, BlendOperation};
    ///
    /// let half = BlendComponent {
    ///     src_factor: BlendFactor::Constant,
    ///     dst_factor: BlendFactor::OneMinusConstant,
    ///     operation: BlendOperation::Add,
    /// };
    /// let draw = Draw::fullscreen("vertex", "fragment")
    ///     .blend(Blend::Custom { color: half, alpha: half })
    ///     .blend_constant([0.5; 4]);
    /// # let _ = draw;
    /// ```
    pub fn blend_constant(mut self, constant: [f32; 4]) -> Self {
        self.state.blend_constant = constant;
        self
    }

    /// Limits the draw to some channels of a target: `"rgb"`, `"a"`, `""`. The draw doesn't write the other channels.
    ///
    /// ```
    /// use karat::draw::Draw;
    ///
    /// let draw = Draw::fullscreen("vertex", "fragment").write_mask(0, "rgb"); // keeps the old alpha
    /// # let _ = draw;
    /// ```
    ///
    /// # Panics
    /// Panics if `channels` contains a letter other than r, g, b and a.
    pub fn write_mask(mut self, target: usize, channels: &str) -> Self {
        let other = channels.chars().find(|channel| !"rgba".contains(*channel));
        assert!(other.is_none(), "`{channels}` contains a letter other than r, g, b and a");
        self.state.masks.push((target, channels.to_owned()));
        self
    }

    /// The fragment function of a draw without a vertex function.
    pub(crate) fn covering(&self) -> Option<&str> {
        self.fragment.as_deref().filter(|_| self.covers())
    }

    /// Renames the functions of the draw to their names in the linked text.
    pub(crate) fn named_as_in(mut self, program: &Program) -> Self {
        for name in [&mut self.vertex, &mut self.fragment, &mut self.depth_fragment] {
            *name = name.as_ref().map(|name| program.entry_point_name(name).to_owned());
        }
        self
    }

    /// Reports if Karat's own triangle covers the frame.
    pub(super) fn covers(&self) -> bool {
        self.vertex.is_none()
    }

    pub(crate) fn is_mesh(&self) -> bool {
        matches!(self.geometry, Geometry::Mesh(_))
    }

    pub(super) fn blend_of(&self, target: usize, frame: Blend) -> Blend {
        let own = self.state.blends.iter().rev().find(|(index, _)| *index == target);
        own.map(|(_, blend)| *blend).or(self.state.blend).unwrap_or(frame)
    }

    pub(super) fn writes(&self, target: usize) -> bool {
        let own = self.state.masks.iter().rev().find(|(index, _)| *index == target);
        own.is_none_or(|(_, channels)| !channels.is_empty())
    }

    /// The indices of the targets for which this draw sets the blending or a write mask.
    pub(super) fn named_targets(&self) -> impl Iterator<Item = usize> {
        let masks = self.state.masks.iter().map(|(target, _)| *target);
        self.state.blends.iter().map(|(target, _)| *target).chain(masks)
    }
}
