//! Checks the outputs of draws against the targets. An unwritten target would contain old memory, and an output without
//! a target would be lost silently.

use super::drawing::{Scene, Source};
use super::request::Draw;
use super::{DrawError, Format};
use crate::reflect::{Output, Program, Texels};

impl Scene<'_> {
    /// Checks that each draw writes each target, and nothing else.
    pub(super) fn expect_targets(&self, program: &Program) -> Result<(), DrawError> {
        let unsound = |setting, reason: String| Err(DrawError::Unsound { setting, reason });
        if !matches!(self.samples, 1 | 2 | 4 | 8 | 16) {
            return unsound(
                "samples",
                format!("it has {} samples a pixel, and every device draws 1 and 4", self.samples),
            );
        }
        if self.result == Source::Depth && !self.draws.iter().any(|d| writes_depth(d, program)) {
            return unsound(
                "depth",
                "its image is depth, which none of its draws writes: a fragment function alone writes \
                 what it returns as `@builtin(frag_depth)`"
                    .to_owned(),
            );
        }
        for draw in &self.draws {
            let Some((fragment, outputs)) = outputs(draw, program) else { continue };
            let at =
                |target: usize| outputs.iter().find(|output| output.location as usize == target);
            for (target, format) in self.formats.iter().enumerate() {
                let Some(output) = at(target) else {
                    // If the image is depth, the targets don't matter.
                    if draw.writes(target) && self.result != Source::Depth {
                        return unsound(
                            "formats",
                            format!(
                                "`{fragment}` writes nothing at @location({target}), where the frame has a \
                             target: nobody can say what it would hold"
                            ),
                        );
                    }
                    continue;
                };
                if output.kind != format.kind() {
                    let (has, wants) = match output.kind {
                        Texels::Uint => (
                            "unsigned integers",
                            "one of these, such as `Format::Rgba32Uint`, in a test's file `rgba32uint`",
                        ),
                        Texels::Sint => (
                            "signed integers",
                            "one of these: `Format::R32Sint`, in a test's file `r32sint`",
                        ),
                        Texels::Float | Texels::Depth => (
                            "floats",
                            "one of floats, such as `Format::Float`, in a test's file `float`",
                        ),
                    };
                    return unsound(
                        "formats",
                        format!(
                            "`{fragment}` writes {has} at @location({target}): the target's format has to be {wants}"
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
                        "`{fragment}` writes @location({location}), and the frame has {targets} target{}: \
                     add `formats` with a format for each location, and compare that one in a frame of its \
                     own whose `target` is {location}",
                        if targets == 1 { "" } else { "s" }
                    ),
                );
            }
        }
        Ok(())
    }

    /// The number of a target's components that every draw writes.
    pub(super) fn components(&self, program: &Program, target: usize) -> u8 {
        let of = |draw: &Draw| {
            let (_, outputs) = outputs(draw, program)?;
            let output = outputs.into_iter().find(|output| output.location as usize == target)?;
            Some(output.components)
        };
        self.draws.iter().filter_map(of).min().unwrap_or(4)
    }
}

/// Returns `true` if a draw writes depth. A lone fragment function covers the whole frame, and writes depth only if it
/// returns it.
pub(super) fn writes_depth(draw: &Draw, program: &Program) -> bool {
    let says = || draw.fragment.as_deref().is_some_and(|fragment| program.writes_depth(fragment));
    draw.state.depth_write.unwrap_or_else(|| draw.vertex.is_some() || says())
}

/// Returns `true` if a draw's fragment function writes a target.
pub(super) fn writes_target(draw: &Draw, program: &Program, target: usize) -> bool {
    let outputs = outputs(draw, program);
    outputs.is_none_or(|(_, outputs)| outputs.iter().any(|o| o.location as usize == target))
}

fn outputs<'d>(draw: &'d Draw, program: &Program) -> Option<(&'d str, Vec<Output>)> {
    let fragment = draw.fragment.as_deref()?;
    Some((fragment, program.fragment_outputs(fragment)?))
}

impl Format {
    /// The type of the values that a shader writes into it.
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
