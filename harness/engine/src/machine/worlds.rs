//! Masks of active lanes for conditions that may be undecided. In a lane with an undecided condition, both branches
//! run, and then the values of the variables are joined.
//!
//! A lane whose condition is undecided forks into two *worlds*. A world is a copy of the lane's variables for one
//! branch. The world of the first branch runs first. Then the lane's variables get back their values from before the
//! branch, and the world of the other branch runs. The worlds are joined where control meets again: at the end of a
//! branch, of a loop's body, of a loop, or of a call. Within a world, each condition has one outcome. So a store
//! simply overwrites a variable. If a `break` depends on an undecided condition, one world leaves the loop, and the
//! other world stays.
//!
//! If a world jumps out of a construct, another world of the same lane may still have to run in the construct. Then the
//! world that jumped waits at the jump's target, with its variables in `waiting`. If the lane has no other world in the
//! construct, the variables stay in the registers.

use crate::arithmetic::sealed::Rules;
use crate::code::Code;
use crate::columns::Columns;

pub(crate) struct Files<'a, A: Rules> {
    pub(crate) floats: &'a mut Columns<A::Float>,
    pub(crate) ints: &'a mut Columns<A::Int>,
    pub(crate) bools: &'a mut Columns<A::Bool>,
}

/// The variables of all lanes at one point of the program, and the lanes that are at this point.
struct State<A: Rules> {
    floats: Vec<Box<[A::Float]>>,
    ints: Vec<Box<[A::Int]>>,
    bools: Vec<Box<[A::Bool]>>,
    here: Box<[bool]>,
}

impl<A: Rules> State<A> {
    fn new(mutable: &[Vec<u32>; 3], width: usize) -> Self {
        let [floats, ints, bools] = [0, 1, 2].map(|file| mutable[file].len());
        Self {
            floats: vec![vec![A::Float::default(); width].into(); floats],
            ints: vec![vec![A::Int::default(); width].into(); ints],
            bools: vec![vec![A::Bool::default(); width].into(); bools],
            here: vec![false; width].into(),
        }
    }

    /// Copies a lane's variables from the registers. If the state already has values for this lane, joins the old and
    /// the new values.
    fn add(&mut self, files: &Files<'_, A>, mutable: &[Vec<u32>; 3], lane: usize) {
        let joins = std::mem::replace(&mut self.here[lane], true);
        for (kept, &register) in self.floats.iter_mut().zip(&mutable[0]) {
            let now = files.floats.get(register)[lane];
            kept[lane] = if joins { A::select_float(A::undecided(), kept[lane], now) } else { now };
        }
        for (kept, &register) in self.ints.iter_mut().zip(&mutable[1]) {
            let now = files.ints.get(register)[lane];
            kept[lane] = if joins { A::select_int(A::undecided(), kept[lane], now) } else { now };
        }
        for (kept, &register) in self.bools.iter_mut().zip(&mutable[2]) {
            let now = files.bools.get(register)[lane];
            kept[lane] = if joins { A::select_bool(A::undecided(), kept[lane], now) } else { now };
        }
    }

    /// Writes a lane's variables back to the registers, or joins them with the registers if `joins` is `true`.
    fn take(
        &mut self,
        files: &mut Files<'_, A>,
        mutable: &[Vec<u32>; 3],
        lane: usize,
        joins: bool,
    ) {
        for (kept, &register) in self.floats.iter().zip(&mutable[0]) {
            let now = &mut files.floats.get_mut(register)[lane];
            *now =
                if joins { A::select_float(A::undecided(), kept[lane], *now) } else { kept[lane] };
        }
        for (kept, &register) in self.ints.iter().zip(&mutable[1]) {
            let now = &mut files.ints.get_mut(register)[lane];
            *now = if joins { A::select_int(A::undecided(), kept[lane], *now) } else { kept[lane] };
        }
        for (kept, &register) in self.bools.iter().zip(&mutable[2]) {
            let now = &mut files.bools.get_mut(register)[lane];
            *now =
                if joins { A::select_bool(A::undecided(), kept[lane], *now) } else { kept[lane] };
        }
        self.here[lane] = false;
    }
}

struct Frame<A: Rules> {
    saved: Box<[bool]>,
    /// The lanes that wait at the end of the construct with their variables in the registers.
    ended: Box<[bool]>,
    /// The lanes that wait, after a `continue`, at the end of the loop's body with their variables in the registers.
    continued: Box<[bool]>,
    /// The variables at the construct's entry, for the lanes that fork.
    start: State<A>,
    waiting: State<A>,
    round: State<A>,
    has_else: bool,
}

impl<A: Rules> Frame<A> {
    /// Checks if this frame stores a copy of the lane's variables, for a branch that still has to run or that waits.
    fn forks(&self, lane: usize) -> bool {
        self.start.here[lane] || self.waiting.here[lane] || self.round.here[lane]
    }
}

/// The current mask, and the [`Frame`]s of the open constructs.
pub(crate) struct Worlds<'p, A: Rules> {
    mutable: &'p [Vec<u32>; 3],
    current: Box<[bool]>,
    mask: Box<[A::Bool]>,
    frames: Vec<Frame<A>>,
    spare: Vec<Frame<A>>,
    any: bool,
    all: bool,
    width: usize,
}

impl<'p, A: Rules> Worlds<'p, A> {
    pub(crate) fn new(code: &'p Code, width: usize) -> Self {
        Self {
            mutable: &code.mutable,
            current: vec![false; width].into(),
            mask: vec![A::bool(false); width].into(),
            frames: Vec::new(),
            spare: Vec::new(),
            any: false,
            all: false,
            width,
        }
    }

    pub(crate) fn start(&mut self, active: usize) {
        self.spare.append(&mut self.frames);
        for (lane, mask) in self.current.iter_mut().enumerate() {
            *mask = lane < active;
        }
        self.changed();
    }

    pub(crate) fn any(&self) -> bool {
        self.any
    }

    pub(crate) fn all(&self) -> bool {
        self.all
    }

    pub(crate) fn active(&self) -> &[A::Bool] {
        &self.mask
    }

    fn changed(&mut self) {
        self.any = self.current.contains(&true);
        self.all = !self.current.contains(&false);
        for (mask, &current) in self.mask.iter_mut().zip(&self.current) {
            *mask = A::bool(current);
        }
    }

    fn push(&mut self) {
        let (mutable, width) = (self.mutable, self.width);
        let mut frame = self.spare.pop().unwrap_or_else(|| Frame {
            saved: vec![false; width].into(),
            ended: vec![false; width].into(),
            continued: vec![false; width].into(),
            start: State::new(mutable, width),
            waiting: State::new(mutable, width),
            round: State::new(mutable, width),
            has_else: false,
        });
        frame.saved.copy_from_slice(&self.current);
        frame.ended.fill(false);
        frame.continued.fill(false);
        frame.has_else = false;
        for state in [&mut frame.start, &mut frame.waiting, &mut frame.round] {
            state.here.fill(false);
        }
        self.frames.push(frame);
    }

    pub(crate) fn enter(&mut self) -> bool {
        self.push();
        self.any
    }

    pub(crate) fn enter_if(&mut self, files: &Files<'_, A>, condition: &[A::Bool]) -> bool {
        self.push();
        let Some(frame) = self.frames.last_mut() else { return self.any };
        for (lane, &condition) in condition.iter().enumerate() {
            if !self.current[lane] {
                continue;
            }
            let (yes, no) = (A::possible(condition), A::avoidable(condition));
            if yes && no {
                frame.start.add(files, self.mutable, lane);
            } else if no {
                self.current[lane] = false;
                frame.ended[lane] = true;
            }
        }
        self.changed();
        self.any
    }

    pub(crate) fn enter_else(&mut self, files: &mut Files<'_, A>, condition: &[A::Bool]) -> bool {
        let Some(frame) = self.frames.last_mut() else { return self.any };
        frame.has_else = true;
        for (lane, &condition) in condition.iter().enumerate() {
            if frame.start.here[lane] {
                if self.current[lane] {
                    frame.waiting.add(files, self.mutable, lane);
                }
                frame.start.take(files, self.mutable, lane, false);
                // The lane still forks, so worlds that jump out of this construct must wait.
                frame.start.here[lane] = true;
                self.current[lane] = true;
            } else {
                let other = frame.saved[lane] && !A::possible(condition);
                frame.ended[lane] = self.current[lane];
                self.current[lane] = other;
            }
        }
        self.changed();
        self.any
    }

    /// Begins a case of a `switch`. The first case begins with the variables at the entry of the `switch`. Each later
    /// case restores these variables.
    pub(crate) fn enter_case(
        &mut self,
        files: &mut Files<'_, A>,
        condition: &[A::Bool],
        falls: bool,
    ) -> bool {
        let Some(frame) = self.frames.last_mut() else { return self.any };
        if !frame.has_else {
            // After the first case, each of its lanes may need its variables again.
            frame.has_else = true;
            for lane in (0..self.width).filter(|&lane| frame.saved[lane]) {
                frame.start.add(files, self.mutable, lane);
            }
            self.current.fill(false);
        }
        for (lane, &condition) in condition.iter().enumerate() {
            let enters = frame.saved[lane] && A::possible(condition);
            if self.current[lane] && !falls {
                frame.waiting.add(files, self.mutable, lane);
                self.current[lane] = false;
            }
            if enters {
                let joins = self.current[lane];
                frame.start.take(files, self.mutable, lane, joins);
                frame.start.here[lane] = true;
                self.current[lane] = true;
            }
        }
        self.changed();
        self.any
    }

    pub(crate) fn leave(&mut self, files: &mut Files<'_, A>, is_if: bool) -> bool {
        let Some(mut frame) = self.frames.pop() else { return self.any };
        for lane in 0..self.width {
            let mut here = self.current[lane] || frame.ended[lane];
            if is_if && !frame.has_else && frame.start.here[lane] {
                // The branch that isn't taken changes no variable.
                frame.start.take(files, self.mutable, lane, self.current[lane]);
                here = true;
            }
            if frame.waiting.here[lane] {
                frame.waiting.take(files, self.mutable, lane, here);
                here = true;
            }
            self.current[lane] = here;
        }
        self.spare.push(frame);
        self.changed();
        self.any
    }

    pub(crate) fn continuing(&mut self, files: &mut Files<'_, A>) {
        let Some(frame) = self.frames.last_mut() else { return };
        for lane in 0..self.width {
            let mut here = self.current[lane] || std::mem::take(&mut frame.continued[lane]);
            if frame.round.here[lane] {
                frame.round.take(files, self.mutable, lane, here);
                here = true;
            }
            self.current[lane] = here;
        }
        self.changed();
    }

    pub(crate) fn break_if(&mut self, files: &Files<'_, A>, condition: &[A::Bool]) {
        let Some(frame) = self.frames.last_mut() else { return };
        for lane in (0..self.width).filter(|&lane| self.current[lane]) {
            if !A::possible(condition[lane]) {
                continue;
            }
            if A::avoidable(condition[lane]) {
                frame.waiting.add(files, self.mutable, lane);
            } else {
                frame.ended[lane] = true;
            }
        }
        for (current, &condition) in self.current.iter_mut().zip(condition) {
            *current &= A::avoidable(condition);
        }
        self.changed();
    }

    /// Checks if the lane has left the innermost loop in one branch of an undecided condition, and is still in the loop
    /// in the other branch.
    pub(crate) fn is_divided(&self, lane: usize) -> bool {
        self.current[lane] && self.frames.last().is_some_and(|frame| frame.waiting.here[lane])
    }

    pub(crate) fn drop_from_loop(&mut self, files: &Files<'_, A>, lane: usize) {
        if let Some(frame) = self.frames.last_mut() {
            frame.waiting.add(files, self.mutable, lane);
        }
        self.current[lane] = false;
        self.changed();
    }

    /// Makes the active lanes jump to the end of an open construct: the innermost one if `depth` is 0, the one around
    /// it if `depth` is 1. If `continues` is `true`, this construct is a loop, and the lanes jump to the end of its
    /// body.
    pub(crate) fn exit(&mut self, files: &Files<'_, A>, depth: u32, continues: bool) {
        let target = self.frames.len().saturating_sub(1 + depth as usize);
        for lane in (0..self.width).filter(|&lane| self.current[lane]) {
            let inside = self.frames[target + 1..].iter().any(|frame| frame.forks(lane));
            let Some(frame) = self.frames.get_mut(target) else { continue };
            let waits = inside || frame.start.here[lane] || frame.round.here[lane];
            match (continues, waits) {
                (true, true) => frame.round.add(files, self.mutable, lane),
                (true, false) => frame.continued[lane] = true,
                (false, true) => frame.waiting.add(files, self.mutable, lane),
                (false, false) => frame.ended[lane] = true,
            }
        }
        self.current.fill(false);
        self.changed();
    }
}
