//! Helper invocations: pixels that a draw doesn't cover, and pixels that were discarded.
//!
//! Helpers run so that their neighbours have derivatives. They perform "no write accesses", their atomics may return
//! any value, and their results are dropped (WGSL, *Fragment Shaders and Helper Invocations*).

use std::borrow::Cow;

use super::Machine;
use crate::arithmetic::sealed::Rules;

impl<A: Rules> Machine<'_, A> {
    /// Sets the lanes of a draw that are helpers from the start.
    pub(crate) fn set_helpers(&mut self, helpers: impl Iterator<Item = bool>) {
        self.helpers.extend(helpers);
    }

    pub(super) fn discard(&mut self) {
        for lane in 0..self.helpers.len() {
            self.helpers[lane] |= A::possible(self.active()[lane]);
        }
    }

    #[inline]
    pub(super) fn is_helper(&self, lane: usize) -> bool {
        self.helpers.get(lane).is_some_and(|helper| *helper)
    }

    #[inline]
    pub(super) fn acts(&self, lane: usize) -> bool {
        A::possible(self.active()[lane]) && !self.is_helper(lane)
    }

    pub(super) fn acting(&self) -> Cow<'_, [A::Bool]> {
        if self.helpers.is_empty() {
            return Cow::Borrowed(self.active());
        }
        let active = self.active().iter().enumerate();
        let of_lane = |(lane, mask): (usize, &A::Bool)| {
            if self.is_helper(lane) { A::bool(false) } else { *mask }
        };
        Cow::Owned(active.map(of_lane).collect())
    }
}
