//! How a draw's triangles become pixels: culling, depth, stencil, blending.

use super::Blend;
use crate::fixture::Compare;
use crate::probe::compare;

/// Which faces aren't drawn.
///
/// ```
/// use karat::draw::{Cull, Draw};
///
/// let inside = Draw::vertices("vertex", "fragment", 36).cull(Cull::Front); // of a room, seen from within
/// # let _ = inside;
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cull {
    /// Both faces are drawn.
    None,
    /// Front faces aren't drawn.
    Front,
    /// Back faces aren't drawn.
    Back,
}

/// In which order a front face's corners are, as they are seen.
///
/// ```
/// use karat::draw::{Draw, Winding};
///
/// let mirrored = Draw::vertices("vertex", "fragment", 36).front_face(Winding::Clockwise);
/// # let _ = mirrored;
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Winding {
    /// Counter-clockwise.
    #[default]
    #[serde(rename = "ccw")]
    CounterClockwise,
    /// Clockwise.
    #[serde(rename = "cw")]
    Clockwise,
}

/// What is added to the depth of a triangle's pixels, such as of a shadow map.
///
/// ```
/// use karat::draw::DepthBias;
///
/// let against_acne = DepthBias { constant: 2, slope: 1.5, clamp: 0.0 };
/// # let _ = against_acne;
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DepthBias {
    /// In the least steps of the depth format, of which the driver decides what they are.
    pub constant: i32,
    /// Times the triangle's largest change of depth from pixel to pixel.
    pub slope: f32,
    /// The most that is added; 0: no limit.
    pub clamp: f32,
}

/// What a draw compares with the stencil, and does to it.
///
/// ```
/// use karat::draw::{Stencil, StencilOperation};
///
/// // Writes 1 where it draws.
/// let mark = Stencil { reference: 1, pass: StencilOperation::Replace, ..Stencil::default() };
/// # let _ = mark;
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Stencil {
    /// How the reference compares with what the stencil holds: `reference < stencil`.
    pub compare: Compare,
    /// What is compared, and written by [`StencilOperation::Replace`].
    pub reference: u8,
    /// What happens to the stencil where the comparison fails.
    pub fail: StencilOperation,
    /// What happens where it holds, and the depth's fails.
    pub depth_fail: StencilOperation,
    /// What happens where both hold.
    pub pass: StencilOperation,
    /// The bits that are compared.
    pub read_mask: u8,
    /// The bits that are written.
    pub write_mask: u8,
}

/// What happens to a pixel's stencil: WebGPU's `GPUStencilOperation`.
///
/// ```
/// use karat::draw::{Stencil, StencilOperation};
///
/// // Counts how often each pixel is drawn.
/// let count = Stencil { pass: StencilOperation::Increment, ..Stencil::default() };
/// # let _ = count;
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StencilOperation {
    /// It stays.
    #[default]
    Keep,
    /// It becomes 0.
    Zero,
    /// It becomes the reference.
    Replace,
    /// Its bits are inverted.
    Invert,
    /// One more, at most 255.
    #[serde(rename = "increment-clamp")]
    Increment,
    /// One less, at least 0.
    #[serde(rename = "decrement-clamp")]
    Decrement,
    /// One more; behind 255 comes 0.
    IncrementWrap,
    /// One less; behind 0 comes 255.
    DecrementWrap,
}

impl Default for Stencil {
    /// It passes everywhere, and changes nothing.
    fn default() -> Self {
        Self {
            compare: Compare::Always,
            reference: 0,
            fail: StencilOperation::Keep,
            depth_fail: StencilOperation::Keep,
            pass: StencilOperation::Keep,
            read_mask: u8::MAX,
            write_mask: u8::MAX,
        }
    }
}

impl Stencil {
    pub(super) fn state(self) -> wgpu::StencilState {
        let operation = |operation| match operation {
            StencilOperation::Keep => wgpu::StencilOperation::Keep,
            StencilOperation::Zero => wgpu::StencilOperation::Zero,
            StencilOperation::Replace => wgpu::StencilOperation::Replace,
            StencilOperation::Invert => wgpu::StencilOperation::Invert,
            StencilOperation::Increment => wgpu::StencilOperation::IncrementClamp,
            StencilOperation::Decrement => wgpu::StencilOperation::DecrementClamp,
            StencilOperation::IncrementWrap => wgpu::StencilOperation::IncrementWrap,
            StencilOperation::DecrementWrap => wgpu::StencilOperation::DecrementWrap,
        };
        let face = wgpu::StencilFaceState {
            compare: compare(self.compare),
            fail_op: operation(self.fail),
            depth_fail_op: operation(self.depth_fail),
            pass_op: operation(self.pass),
        };
        wgpu::StencilState {
            front: face,
            back: face,
            read_mask: self.read_mask.into(),
            write_mask: self.write_mask.into(),
        }
    }
}

/// What a draw is drawn with; `None`: what is usual for its geometry.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct State {
    pub(super) cull: Option<Cull>,
    pub(super) winding: Winding,
    pub(super) depth_compare: Option<Compare>,
    pub(super) depth_write: Option<bool>,
    pub(super) bias: DepthBias,
    pub(super) stencil: Option<Stencil>,
    pub(super) blend: Option<Blend>,
    /// By target.
    pub(super) blends: Vec<(usize, Blend)>,
    pub(super) blend_constant: [f32; 4],
    /// The channels that are written, by target: `"rgb"`.
    pub(super) masks: Vec<(usize, String)>,
}
