//! Blending: formulas that combine a draw's new value with a pixel's old value.

/// A formula that combines a draw's new value with a pixel's old value. `new` is the result of the fragment function,
/// and `old` is the value in the target.
///
/// ```
/// use karat::draw::{Blend, Draw};
///
/// let glass = Draw::fullscreen("vertex", "fragment").blend(Blend::Premultiplied);
/// # let _ = glass;
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Blend {
    /// The new value replaces the old one.
    #[default]
    Replace,
    /// Adds the new value and the old value. If the fragment function returns 1, the target counts how often each
    /// pixel is shaded.
    Add,
    /// Draws transparent colours: `new * new.a + old * (1 - new.a)`, and for alpha `new.a + old.a * (1 - new.a)`.
    Alpha,
    /// Draws transparent colours that are already multiplied by their alpha: `new + old * (1 - new.a)`.
    Premultiplied,
    /// Multiplies the new value and the old value: `new * old`.
    Multiply,
    /// Any other formula. Colour and alpha have their own formulas.
    Custom {
        /// Red, green and blue.
        color: BlendComponent,
        /// Alpha.
        alpha: BlendComponent,
    },
}

/// The formula for colour or alpha: an operation combines `new * src_factor` and `old * dst_factor`.
///
/// ```
/// use karat::draw::{Blend, BlendComponent, BlendFactor, BlendOperation};
///
/// // The larger value, without regard to alpha.
/// let larger =
///     BlendComponent { src_factor: BlendFactor::One, dst_factor: BlendFactor::One, operation: BlendOperation::Max };
/// let blend = Blend::Custom { color: larger, alpha: larger };
/// # let _ = blend;
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct BlendComponent {
    /// The factor of the new value.
    pub src_factor: BlendFactor,
    /// The factor of the old value.
    pub dst_factor: BlendFactor,
    /// The operation that combines the two products.
    pub operation: BlendOperation,
}

/// A factor of blending: WebGPU's `GPUBlendFactor`.
///
/// ```
/// use karat::draw::{BlendComponent, BlendFactor, BlendOperation};
///
/// // Alpha blending of colours.
/// let (src_factor, dst_factor) = (BlendFactor::SrcAlpha, BlendFactor::OneMinusSrcAlpha);
/// let alpha = BlendComponent { src_factor, dst_factor, operation: BlendOperation::Add };
/// # let _ = alpha;
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BlendFactor {
    /// 0
    Zero,
    /// 1
    One,
    /// new
    Src,
    /// 1 - new
    OneMinusSrc,
    /// new.a
    SrcAlpha,
    /// 1 - new.a
    OneMinusSrcAlpha,
    /// old
    Dst,
    /// 1 - old
    OneMinusDst,
    /// old.a
    DstAlpha,
    /// 1 - old.a
    OneMinusDstAlpha,
    /// For colour, the smaller of `new.a` and `1 - old.a`. For alpha, 1.
    SrcAlphaSaturated,
    /// The blend constant of the draw.
    Constant,
    /// 1 - the blend constant of the draw.
    OneMinusConstant,
}

/// The operation that combines the new and the old value: WebGPU's `GPUBlendOperation`.
///
/// ```
/// use karat::draw::{BlendComponent, BlendFactor, BlendOperation};
///
/// let darker = BlendComponent { src_factor: BlendFactor::One, dst_factor: BlendFactor::One, operation: BlendOperation::Min };
/// # let _ = darker;
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BlendOperation {
    /// new + old
    #[default]
    Add,
    /// new - old
    Subtract,
    /// old - new
    ReverseSubtract,
    /// The smaller value. WebGPU ignores both factors.
    Min,
    /// The larger value. WebGPU ignores both factors.
    Max,
}

impl BlendComponent {
    const fn sum(src_factor: BlendFactor, dst_factor: BlendFactor) -> Self {
        Self { src_factor, dst_factor, operation: BlendOperation::Add }
    }

    fn state(self) -> wgpu::BlendComponent {
        let factor = |factor| match factor {
            BlendFactor::Zero => wgpu::BlendFactor::Zero,
            BlendFactor::One => wgpu::BlendFactor::One,
            BlendFactor::Src => wgpu::BlendFactor::Src,
            BlendFactor::OneMinusSrc => wgpu::BlendFactor::OneMinusSrc,
            BlendFactor::SrcAlpha => wgpu::BlendFactor::SrcAlpha,
            BlendFactor::OneMinusSrcAlpha => wgpu::BlendFactor::OneMinusSrcAlpha,
            BlendFactor::Dst => wgpu::BlendFactor::Dst,
            BlendFactor::OneMinusDst => wgpu::BlendFactor::OneMinusDst,
            BlendFactor::DstAlpha => wgpu::BlendFactor::DstAlpha,
            BlendFactor::OneMinusDstAlpha => wgpu::BlendFactor::OneMinusDstAlpha,
            BlendFactor::SrcAlphaSaturated => wgpu::BlendFactor::SrcAlphaSaturated,
            BlendFactor::Constant => wgpu::BlendFactor::Constant,
            BlendFactor::OneMinusConstant => wgpu::BlendFactor::OneMinusConstant,
        };
        wgpu::BlendComponent {
            src_factor: factor(self.src_factor),
            dst_factor: factor(self.dst_factor),
            operation: match self.operation {
                BlendOperation::Add => wgpu::BlendOperation::Add,
                BlendOperation::Subtract => wgpu::BlendOperation::Subtract,
                BlendOperation::ReverseSubtract => wgpu::BlendOperation::ReverseSubtract,
                BlendOperation::Min => wgpu::BlendOperation::Min,
                BlendOperation::Max => wgpu::BlendOperation::Max,
            },
        }
    }
}

impl Blend {
    /// The formulas for colour and alpha. `None` stands for [`Blend::Replace`].
    fn components(self) -> Option<(BlendComponent, BlendComponent)> {
        let both = |component| Some((component, component));
        match self {
            Self::Replace => None,
            Self::Add => both(BlendComponent::sum(BlendFactor::One, BlendFactor::One)),
            Self::Alpha => Some((
                BlendComponent::sum(BlendFactor::SrcAlpha, BlendFactor::OneMinusSrcAlpha),
                BlendComponent::sum(BlendFactor::One, BlendFactor::OneMinusSrcAlpha),
            )),
            Self::Premultiplied => {
                both(BlendComponent::sum(BlendFactor::One, BlendFactor::OneMinusSrcAlpha))
            }
            Self::Multiply => both(BlendComponent::sum(BlendFactor::Dst, BlendFactor::Zero)),
            Self::Custom { color, alpha } => Some((color, alpha)),
        }
    }

    pub(super) fn state(self) -> Option<wgpu::BlendState> {
        let (color, alpha) = self.components()?;
        Some(wgpu::BlendState { color: color.state(), alpha: alpha.state() })
    }
}
