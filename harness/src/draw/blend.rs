//! What happens to a pixel that is drawn again.

/// What happens to a pixel that is drawn again. `new` is what the fragment function returns, `old` what
/// the target holds.
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
    /// Values add up. A fragment function that returns 1 counts how often a pixel is shaded.
    Add,
    /// new * new.a + old * (1 - new.a), and of alpha new.a + old.a * (1 - new.a): transparency.
    Alpha,
    /// new + old * (1 - new.a): transparency of colours that are multiplied by their alpha already.
    Premultiplied,
    /// new * old.
    Multiply,
    /// Any other, of colour and of alpha.
    Custom {
        /// Red, green and blue.
        color: Component,
        /// Alpha.
        alpha: Component,
    },
}

/// How the channels of a pixel are blended: `new * source` and `old * target`, joined by an operation.
///
/// ```
/// use karat::draw::{Blend, Component, Factor, Operation};
///
/// // The larger of both, whatever alpha is.
/// let larger =
///     Component { source: Factor::One, target: Factor::One, operation: Operation::Max };
/// let blend = Blend::Custom { color: larger, alpha: larger };
/// # let _ = blend;
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Component {
    /// What the new value is multiplied by.
    pub source: Factor,
    /// What the old value is multiplied by.
    pub target: Factor,
    /// How both are joined.
    pub operation: Operation,
}

/// A factor of blending: WebGPU's `GPUBlendFactor`.
///
/// ```
/// use karat::draw::{Component, Factor, Operation};
///
/// // What alpha blending does to colours.
/// let (source, target) = (Factor::NewAlpha, Factor::OneMinusNewAlpha);
/// let alpha = Component { source, target, operation: Operation::Add };
/// # let _ = alpha;
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Factor {
    /// 0
    Zero,
    /// 1
    One,
    /// new
    #[serde(rename = "src")]
    New,
    /// 1 - new
    #[serde(rename = "one-minus-src")]
    OneMinusNew,
    /// new.a
    #[serde(rename = "src-alpha")]
    NewAlpha,
    /// 1 - new.a
    #[serde(rename = "one-minus-src-alpha")]
    OneMinusNewAlpha,
    /// old
    #[serde(rename = "dst")]
    Old,
    /// 1 - old
    #[serde(rename = "one-minus-dst")]
    OneMinusOld,
    /// old.a
    #[serde(rename = "dst-alpha")]
    OldAlpha,
    /// 1 - old.a
    #[serde(rename = "one-minus-dst-alpha")]
    OneMinusOldAlpha,
    /// min(new.a, 1 - old.a), and 1 of alpha.
    #[serde(rename = "src-alpha-saturated")]
    NewAlphaSaturated,
    /// The constant of the draw.
    Constant,
    /// 1 - that constant.
    OneMinusConstant,
}

/// How the new and the old value are joined: WebGPU's `GPUBlendOperation`.
///
/// ```
/// use karat::draw::{Component, Factor, Operation};
///
/// let darker = Component { source: Factor::One, target: Factor::One, operation: Operation::Min };
/// # let _ = darker;
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Operation {
    /// new + old
    #[default]
    Add,
    /// new - old
    Subtract,
    /// old - new
    ReverseSubtract,
    /// The smaller of both, without factors.
    Min,
    /// The larger of both, without factors.
    Max,
}

impl Component {
    const fn sum(source: Factor, target: Factor) -> Self {
        Self { source, target, operation: Operation::Add }
    }

    fn state(self) -> wgpu::BlendComponent {
        let factor = |factor| match factor {
            Factor::Zero => wgpu::BlendFactor::Zero,
            Factor::One => wgpu::BlendFactor::One,
            Factor::New => wgpu::BlendFactor::Src,
            Factor::OneMinusNew => wgpu::BlendFactor::OneMinusSrc,
            Factor::NewAlpha => wgpu::BlendFactor::SrcAlpha,
            Factor::OneMinusNewAlpha => wgpu::BlendFactor::OneMinusSrcAlpha,
            Factor::Old => wgpu::BlendFactor::Dst,
            Factor::OneMinusOld => wgpu::BlendFactor::OneMinusDst,
            Factor::OldAlpha => wgpu::BlendFactor::DstAlpha,
            Factor::OneMinusOldAlpha => wgpu::BlendFactor::OneMinusDstAlpha,
            Factor::NewAlphaSaturated => wgpu::BlendFactor::SrcAlphaSaturated,
            Factor::Constant => wgpu::BlendFactor::Constant,
            Factor::OneMinusConstant => wgpu::BlendFactor::OneMinusConstant,
        };
        wgpu::BlendComponent {
            src_factor: factor(self.source),
            dst_factor: factor(self.target),
            operation: match self.operation {
                Operation::Add => wgpu::BlendOperation::Add,
                Operation::Subtract => wgpu::BlendOperation::Subtract,
                Operation::ReverseSubtract => wgpu::BlendOperation::ReverseSubtract,
                Operation::Min => wgpu::BlendOperation::Min,
                Operation::Max => wgpu::BlendOperation::Max,
            },
        }
    }
}

impl Blend {
    /// Of colour and of alpha; `None`: the new value replaces the old one.
    fn components(self) -> Option<(Component, Component)> {
        let both = |component| Some((component, component));
        match self {
            Self::Replace => None,
            Self::Add => both(Component::sum(Factor::One, Factor::One)),
            Self::Alpha => Some((
                Component::sum(Factor::NewAlpha, Factor::OneMinusNewAlpha),
                Component::sum(Factor::One, Factor::OneMinusNewAlpha),
            )),
            Self::Premultiplied => both(Component::sum(Factor::One, Factor::OneMinusNewAlpha)),
            Self::Multiply => both(Component::sum(Factor::Old, Factor::Zero)),
            Self::Custom { color, alpha } => Some((color, alpha)),
        }
    }

    pub(super) fn state(self) -> Option<wgpu::BlendState> {
        let (color, alpha) = self.components()?;
        Some(wgpu::BlendState { color: color.state(), alpha: alpha.state() })
    }
}
