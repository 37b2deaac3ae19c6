//! Makes drawings whose fragment functions return tapped values, either beside the colours or instead of them.

use std::borrow::Cow;
use std::sync::Arc;

use super::drawing::{Drawing, Scene, Source};
use super::request::Draw;
use super::{Blend, DrawError, Format};
use crate::reflect::{Telling, Valued, WORDS, When};

/// The number of targets for tapped values that every WebGPU device supports. A pixel may take 32 bytes in all
/// targets together (`maxColorAttachmentBytesPerSample`), and a target of four `u32`s takes 16 bytes.
const TARGETS: usize = 2;

/// A drawing with fragment functions that return tapped values, and the targets for these values.
pub(crate) struct Told<'s> {
    pub(crate) drawing: Drawing<'s>,
    pub(crate) targets: Vec<usize>,
}

impl<'s> Drawing<'s> {
    /// A copy of this drawing without one draw. `number` counts only the draws with a fragment function.
    ///
    /// # Errors
    /// Returns an error if the fixtures don't match the variables of the other draws.
    pub(crate) fn without_draw(&self, number: usize) -> Result<Self, DrawError> {
        let mut scene = Scene::clone(&self.scene);
        let has_fragment = |(_, draw): &(usize, &Draw)| draw.fragment.is_some();
        let index = scene.draws.iter().enumerate().filter(has_fragment).nth(number);
        let index = index.map(|(index, _)| index).expect("it is one of them");
        drop(scene.draws.remove(index));
        let (program, fixtures) = (Arc::clone(&self.program), self.fixtures().clone());
        let bindings = scene.bindings(&program)?;
        Ok(Self::with(Cow::Owned(scene), program, bindings, fixtures))
    }

    pub(crate) fn fragments(&self) -> Vec<&str> {
        let names = self.scene.draws.iter().filter_map(|draw| draw.fragment.as_deref());
        names.map(|name| self.program.entry_point_name(name)).collect()
    }

    pub(crate) fn vertices(&self) -> Vec<&str> {
        let names = self.scene.draws.iter().filter_map(|draw| draw.vertex.as_deref());
        names.map(|name| self.program.entry_point_name(name)).collect()
    }

    /// Reports if the frame's own colours can be drawn beside a tapped value. If the frame has several targets, some
    /// GPUs don't support another target. With several samples per pixel, a target contains means of samples, and a
    /// mean of tapped values is meaningless.
    pub(crate) fn may_keep_colours(&self) -> bool {
        self.scene.samples == 1 && self.scene.formats.len() == 1
    }

    /// Checks if any draw blends. If so, several draws may contribute to a pixel's colour.
    pub(crate) fn blends(&self) -> bool {
        let targets = 0..self.scene.formats.len();
        let blends = |target: usize| {
            let of = |draw: &Draw| draw.blend_of(target, self.scene.blend) != Blend::Replace;
            self.scene.draws.iter().any(of)
        };
        targets.into_iter().any(blends)
    }

    /// A copy of this drawing in which the fragment functions return the 32-bit words of tapped values, from word
    /// `first` on. If `values` is empty, each function returns its own number, counted from 1 in the order of
    /// [`fragments`](Self::fragments). If `alone` is `true`, the functions return no colours, so a pixel has space for
    /// twice as many words.
    ///
    /// # Errors
    /// Returns an error if naga rejects the changed program.
    pub(crate) fn telling(
        &self,
        values: &[(&Valued, When)],
        first: usize,
        alone: bool,
    ) -> Result<Told<'_>, DrawError> {
        let mut scene = Scene::clone(&self.scene);
        if alone {
            scene.formats.clear();
        }
        let words = values.iter().filter_map(|(value, _)| value.words()).sum::<usize>();
        let needed = words.saturating_sub(first).div_ceil(WORDS).max(1);
        let own = scene.formats.len();
        let targets = own..own + if alone { needed.min(TARGETS) } else { 1 };
        let targets: Vec<usize> = targets.collect();
        scene.formats.extend(targets.iter().map(|_| Format::Rgba32Uint));
        (scene.result, scene.samples, scene.told) = (Source::Target(own), 1, Some(own));
        for draw in &mut scene.draws {
            if alone {
                draw.state.blends.clear();
                draw.state.masks.clear();
            }
            draw.state.blends.extend(targets.iter().map(|target| (*target, Blend::Replace)));
        }
        let location = |target: &usize| u32::try_from(*target).expect("there are few targets");
        let locations: Vec<u32> = targets.iter().map(location).collect();
        let telling = Telling { values, first, locations: &locations, alone };
        let program = Arc::new(self.program.telling(&self.fragments(), telling)?);
        let bindings = scene.bindings(&program)?;
        let fixtures = self.fixtures().clone();
        let drawing = Drawing::with(Cow::Owned(scene), program, bindings, fixtures);
        Ok(Told { drawing, targets })
    }
}
