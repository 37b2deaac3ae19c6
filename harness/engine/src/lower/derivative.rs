//! Lowers derivatives, which are differences between lanes of a quad.

use naga::DerivativeAxis;

use super::{Lower, Lowered};
use crate::code::{Neighbour, Op, Reg};
use crate::rules::Basic;
use crate::scalar::File;

impl Lower<'_> {
    /// Lowers the derivative of a float: the difference between neighbouring pixels. As with WGSL's fine derivatives,
    /// each row and each column of a quad of pixels has its own difference.
    pub(super) fn derivative(&mut self, axis: DerivativeAxis, of: Reg, half: bool) -> Lowered<Reg> {
        let neighbours = match axis {
            DerivativeAxis::X => [Neighbour::Right, Neighbour::Left],
            DerivativeAxis::Y => [Neighbour::Below, Neighbour::Above],
            DerivativeAxis::Width => {
                let x = self.derivative(DerivativeAxis::X, of, half)?;
                let y = self.derivative(DerivativeAxis::Y, of, half)?;
                let x = self.basic(Basic::Abs, &[x], half)?;
                let y = self.basic(Basic::Abs, &[y], half)?;
                return self.basic(Basic::Add, &[x, y], half);
            }
        };
        if !self.settings.quads && !self.drawn {
            return Err(self.refuse("a derivative outside of a fragment shader"));
        }
        let mut values = [of; 2];
        for (value, neighbour) in values.iter_mut().zip(neighbours) {
            *value = self.fresh(File::Float);
            self.emit(Op::Neighbour(neighbour), &[*value], &[of])?;
        }
        self.basic(Basic::Subtract, &values, half)
    }
}
