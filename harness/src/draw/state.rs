//! The fixed-function state of a draw: culling, depth, stencil and blending.

use super::Blend;
use crate::fixture::Compare;
use crate::probe::compare;

/// The faces that aren't drawn.
///
/// ```
/// use karat::draw::{Cull, Draw};
///
/// let inside = Draw::vertices("vertex", "fragment", 36).cull(Cull::Front); // a room seen from inside
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

/// The order of a front face's corners, as a viewer sees them.
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

/// A bias to add to the depth of a triangle's pixels, for example in a shadow map.
///
/// ```
/// use karat::draw::DepthBias;
///
/// let against_acne = DepthBias { constant: 2, slope: 1.5, clamp: 0.0 };
/// # let _ = against_acne;
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DepthBias {
    /// A bias in units of the smallest step that the depth format can represent. The size of a step depends on the
    /// driver.
    pub constant: i32,
    /// A bias in proportion to the triangle's slope: this number times the triangle's largest change of depth between
    /// adjacent pixels.
    pub slope: f32,
    /// The largest total bias. 0 means no limit.
    pub clamp: f32,
}

/// The stencil test of a draw, and its changes to the stencil.
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
    /// The comparison of the reference with the stencil's value: `Less` means `reference < stencil`.
    pub compare: Compare,
    /// The value to compare with the stencil. [`StencilOperation::Replace`] also writes this value.
    pub reference: u8,
    /// The change to the stencil if the stencil test fails.
    pub fail: StencilOperation,
    /// The change to the stencil if the stencil test passes and the depth test fails.
    pub depth_fail: StencilOperation,
    /// The change to the stencil if both tests pass.
    pub pass: StencilOperation,
    /// The bits that the stencil test compares.
    pub read_mask: u8,
    /// The bits that the draw may write.
    pub write_mask: u8,
}

/// A change to a pixel's stencil: WebGPU's `GPUStencilOperation`.
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
    /// Keeps the stencil's value.
    #[default]
    Keep,
    /// Sets the stencil to 0.
    Zero,
    /// Sets the stencil to the reference.
    Replace,
    /// Inverts the bits of the stencil.
    Invert,
    /// Adds 1, up to 255.
    #[serde(rename = "increment-clamp")]
    Increment,
    /// Subtracts 1, down to 0.
    #[serde(rename = "decrement-clamp")]
    Decrement,
    /// Adds 1; 255 becomes 0.
    IncrementWrap,
    /// Subtracts 1; 0 becomes 255.
    DecrementWrap,
}

impl Default for Stencil {
    /// A stencil test that all pixels pass, and that doesn't change the stencil.
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

/// The fixed-function state of a draw. If a field is `None`, the draw uses the default for its kind of geometry.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct State {
    pub(super) cull: Option<Cull>,
    pub(super) winding: Winding,
    pub(super) depth_compare: Option<Compare>,
    pub(super) depth_write: Option<bool>,
    pub(super) bias: DepthBias,
    pub(super) stencil: Option<Stencil>,
    pub(super) blend: Option<Blend>,
    /// The blending formulas that the draw sets for single targets, each with the index of the target.
    pub(super) blends: Vec<(usize, Blend)>,
    pub(super) blend_constant: [f32; 4],
    /// The channels to write for each target that has a mask, such as `"rgb"`.
    pub(super) masks: Vec<(usize, String)>,
}
