//! Control flow: operations that change the mask, and the iterations of loops.

use std::time::Instant;

use super::worlds::Files;
use super::{Limit, Machine, Spent};
use crate::arithmetic::sealed::Rules;
use crate::code::{Instruction, Op};

/// The number of loop iterations between two readings of the clock.
const ROUNDS: u64 = 1024;

macro_rules! files {
    ($machine:expr) => {
        Files { floats: &mut $machine.floats, ints: &mut $machine.ints, bools: &mut $machine.bools }
    };
}

impl<A: Rules> Machine<'_, A> {
    /// Runs an operation that may change the mask. Returns `true` if control jumps to the operation's target.
    pub(super) fn control(&mut self, op: Op, registers: &[u32]) -> bool {
        if A::UNDECIDED {
            self.control_worlds(op, registers)
        } else {
            self.control_masks(op, registers)
        }
    }

    fn control_masks(&mut self, op: Op, registers: &[u32]) -> bool {
        let masks = &mut self.masks;
        let condition = registers.first().map_or(&[][..], |&register| self.bools.get(register));
        match op {
            Op::If => !masks.enter_if(condition),
            Op::Else => !masks.enter_else(condition),
            Op::Case(falls) => !masks.enter_case(condition, falls),
            Op::Loop => !masks.enter_loop(),
            Op::Switch | Op::Call => !masks.enter(),
            Op::EndIf | Op::EndSwitch | Op::EndCall => !masks.leave(),
            Op::Skip => !masks.any(),
            Op::EndLoop if masks.any() => true,
            Op::EndLoop => {
                masks.leave();
                false
            }
            Op::Continuing => {
                masks.continuing();
                false
            }
            Op::BreakIf => {
                masks.break_if(condition);
                false
            }
            Op::Break(depth) => {
                masks.exit(depth, true);
                false
            }
            Op::Continue(depth) | Op::Return(depth) => {
                masks.exit(depth, false);
                false
            }
            _ => false,
        }
    }

    fn control_worlds(&mut self, op: Op, registers: &[u32]) -> bool {
        let condition: Vec<A::Bool> =
            registers.first().map_or(Vec::new(), |&register| self.bools.get(register).to_vec());
        let mut files = files!(self);
        let worlds = &mut self.worlds;
        match op {
            Op::If => !worlds.enter_if(&files, &condition),
            Op::Else => !worlds.enter_else(&mut files, &condition),
            Op::Case(falls) => !worlds.enter_case(&mut files, &condition, falls),
            Op::Loop | Op::Switch | Op::Call => !worlds.enter(),
            Op::EndIf => !worlds.leave(&mut files, true),
            Op::EndSwitch | Op::EndCall => !worlds.leave(&mut files, false),
            Op::Skip => !worlds.any(),
            Op::EndLoop if worlds.any() => true,
            Op::EndLoop => {
                worlds.leave(&mut files, false);
                false
            }
            Op::Continuing => {
                worlds.continuing(&mut files);
                false
            }
            Op::BreakIf => {
                worlds.break_if(&files, &condition);
                false
            }
            Op::Break(depth) | Op::Return(depth) => {
                worlds.exit(&files, depth, false);
                false
            }
            Op::Continue(depth) => {
                worlds.exit(&files, depth, true);
                false
            }
            _ => false,
        }
    }

    pub(super) fn round(&mut self, instruction: &Instruction) -> Result<(), Spent> {
        let span = self.site(instruction).span;
        if let Some(own) = self.open.last_mut() {
            *own += 1;
        }
        let own = self.open.iter().copied().max().unwrap_or_default();
        let mask = if A::UNDECIDED { self.worlds.active() } else { self.masks.active() };
        let (mut spent, mut all) = (false, 0);
        for (fuel, &mask) in self.fuel.iter_mut().zip(mask) {
            let cost = u64::from(A::possible(mask));
            spent |= *fuel < cost;
            all += cost;
            // `u64::MAX` marks a lane that ran too many iterations. A lane with 0 has none left, but didn't run too
            // many.
            *fuel = if *fuel < cost { u64::MAX } else { *fuel - cost };
        }
        if spent && self.options.leaves && !A::UNDECIDED {
            let long = (0..self.width).filter(|lane| self.fuel[*lane] == u64::MAX);
            let long: Vec<usize> =
                long.filter(|lane| A::possible(self.masks.active()[*lane])).collect();
            self.masks.drop_lanes(&long);
            self.long.extend(long.into_iter().map(|lane| (lane, span)));
        } else if spent {
            let lane = self.fuel.iter().position(|&fuel| fuel == u64::MAX).unwrap_or(0);
            return Err(Spent { span, lane, by: Limit::Fuel, own });
        }
        let Some(left) = self.work.checked_sub(all) else {
            return Err(Spent { span, lane: 0, by: Limit::Work, own });
        };
        self.work = left;
        // Reading the clock takes more time than an iteration, so it isn't read in each iteration.
        self.rounds += 1;
        if self.rounds.is_multiple_of(ROUNDS)
            && self.options.deadline.is_some_and(|deadline| Instant::now() >= deadline)
        {
            let mask = if A::UNDECIDED { self.worlds.active() } else { self.masks.active() };
            let lane = mask.iter().position(|active| A::possible(*active)).unwrap_or(0);
            return Err(Spent { span, lane, by: Limit::Deadline, own });
        }
        if A::UNDECIDED {
            for lane in 0..self.width {
                if !self.worlds.is_divided(lane) {
                    continue;
                }
                if self.undecided[lane] == 0 {
                    self.lost[lane].get_or_insert(instruction.site);
                    let files = files!(self);
                    self.worlds.drop_from_loop(&files, lane);
                } else {
                    self.undecided[lane] -= 1;
                }
            }
        }
        Ok(())
    }
}
