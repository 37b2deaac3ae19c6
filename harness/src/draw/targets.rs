//! Checks the outputs of draws against the targets. A target without an output would contain old memory. An output
//! without a target would disappear without an error.

use super::drawing::{Scene, Source};
use super::request::Draw;
use super::{DrawError, Format};
use crate::reflect::{Output, Program, Texels};

impl Scene<'_> {
    /// Checks the settings `samples` and `depth`, and that each draw's outputs match the targets.
    pub(super) fn expect_targets(&self, program: &Program) -> Result<(), DrawError> {
        let unsound = |setting, reason: String| Err(DrawError::Unsound { setting, reason });
        if !matches!(self.samples, 1 | 2 | 4 | 8 | 16) {
            return unsound(
                "samples",
                format!(
                    "it has {} samples a pixel, which no device supports: use 1 or 4",
                    self.samples
                ),
            );
        }
        if self.result == Source::Depth && !self.draws.iter().any(|d| writes_depth(d, program)) {
            return unsound(
                "depth",
                "it shows depth, but none of its draws writes depth: let a draw with a vertex function write depth, \
                 or return `@builtin(frag_depth)` from a fragment function"
                    .to_owned(),
            );
        }
        for draw in &self.draws {
            let Some((fragment, outputs)) = outputs(draw, program) else { continue };
            let at =
                |target: usize| outputs.iter().find(|output| output.location as usize == target);
            for (target, format) in self.formats.iter().enumerate() {
                let Some(output) = at(target) else {
                    // A frame that shows depth ignores its colour targets.
                    if draw.writes(target) && self.result != Source::Depth {
                        return unsound(
                            "formats",
                            format!(
                                "`{fragment}` writes nothing at @location({target}), but the frame has a target \
                             there: the target's contents would be undefined"
                            ),
                        );
                    }
                    continue;
                };
                if output.kind != format.kind() {
                    let (has, wants) = match output.kind {
                        Texels::Uint => (
                            "unsigned integers",
                            "a format of unsigned integers, such as `Format::Rgba32Uint` (`rgba32uint` in a file)",
                        ),
                        Texels::Sint => {
                            ("signed integers", "`Format::R32Sint` (`r32sint` in a file)")
                        }
                        Texels::Float | Texels::Depth => (
                            "floats",
                            "a format of floats, such as `Format::Float` (`float` in a file)",
                        ),
                    };
                    return unsound(
                        "formats",
                        format!(
                            "`{fragment}` writes {has} at @location({target}): the target's format must be {wants}"
                        ),
                    );
                }
            }
            if let Some(output) = outputs.iter().find(|o| o.location as usize >= self.formats.len())
            {
                let (location, targets) = (output.location, self.formats.len());
                return unsound(
                    "formats",
                    format!(
                        "`{fragment}` writes @location({location}), but the frame has {targets} target{}: \
                     add `formats` with a format for each location, and compare this location in a second frame \
                     that sets `target` to {location}",
                        if targets == 1 { "" } else { "s" }
                    ),
                );
            }
        }
        Ok(())
    }

    /// The smallest number of components that a draw writes into a target.
    pub(super) fn components(&self, program: &Program, target: usize) -> u8 {
        let of = |draw: &Draw| {
            let (_, outputs) = outputs(draw, program)?;
            let output = outputs.into_iter().find(|output| output.location as usize == target)?;
            Some(output.components)
        };
        self.draws.iter().filter_map(of).min().unwrap_or(4)
    }
}

/// Reports if a draw writes depth. A draw with only a fragment function writes depth only if that function returns a
/// depth.
pub(super) fn writes_depth(draw: &Draw, program: &Program) -> bool {
    let says = || draw.fragment.as_deref().is_some_and(|fragment| program.writes_depth(fragment));
    draw.state.depth_write.unwrap_or_else(|| draw.vertex.is_some() || says())
}

pub(super) fn writes_target(draw: &Draw, program: &Program, target: usize) -> bool {
    let outputs = outputs(draw, program);
    outputs.is_none_or(|(_, outputs)| outputs.iter().any(|o| o.location as usize == target))
}

fn outputs<'d>(draw: &'d Draw, program: &Program) -> Option<(&'d str, Vec<Output>)> {
    let fragment = draw.fragment.as_deref()?;
    Some((fragment, program.fragment_outputs(fragment)?))
}

impl Format {
    /// The type of the values that a shader writes into a target.
    fn kind(self) -> Texels {
        match self {
            Self::R32Sint => Texels::Sint,
            integers if integers.is_of_integers() => Texels::Uint,
            _ => Texels::Float,
        }
    }

    pub(crate) fn is_of_integers(self) -> bool {
        matches!(
            self,
            Self::R32Uint | Self::R32Sint | Self::Rgba8Uint | Self::Rgba16Uint | Self::Rgba32Uint
        )
    }
}
