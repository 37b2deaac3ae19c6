//! Textures.

use super::{Machine, Memory};
use crate::arithmetic::sealed::Rules;

impl<A: Rules> Machine<'_, A> {
    pub(super) fn image(
        &mut self,
        _image: u32,
        _registers: &[u32],
        _memory: &mut Memory<'_, A>,
    ) -> Option<usize> {
        None
    }
}
