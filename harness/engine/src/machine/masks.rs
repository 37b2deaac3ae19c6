//! Masks of active lanes, for control flow in which lanes take different branches.
//!
//! Each open construct (a branch, a loop, a call) has a `Frame`: the mask at the construct's entry, and the lanes that
//! have left the construct by a jump. At the end of the construct, the mask is again the mask at the entry, without the
//! lanes that have left.
//!
//! For arithmetics with undecided conditions, the module `worlds` has the masks.

use crate::arithmetic::sealed::Rules;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Branch,
    Loop,
}

struct Frame<A: Rules> {
    kind: Kind,
    saved: Box<[A::Bool]>,
    left: Box<[A::Bool]>,
    broken: Box<[A::Bool]>,
}

/// The current mask, and the [`Frame`]s of the open constructs.
pub(crate) struct Masks<A: Rules> {
    current: Box<[A::Bool]>,
    frames: Vec<Frame<A>>,
    spare: Vec<Frame<A>>,
    any: bool,
    all: bool,
    width: usize,
}

impl<A: Rules> Masks<A> {
    pub(crate) fn new(width: usize) -> Self {
        let empty = || vec![A::bool(false); width].into_boxed_slice();
        Self {
            current: empty(),
            frames: Vec::new(),
            spare: Vec::new(),
            any: false,
            all: false,
            width,
        }
    }

    /// Makes the first `active` lanes active, with no open construct.
    pub(crate) fn start(&mut self, active: usize) {
        self.spare.append(&mut self.frames);
        for (lane, mask) in self.current.iter_mut().enumerate() {
            *mask = A::bool(lane < active);
        }
        self.changed();
    }

    #[inline]
    pub(crate) fn any(&self) -> bool {
        self.any
    }

    /// Checks if all lanes are certainly active.
    #[inline]
    pub(crate) fn all(&self) -> bool {
        self.all
    }

    #[inline]
    pub(crate) fn active(&self) -> &[A::Bool] {
        &self.current
    }

    fn changed(&mut self) {
        let mut any = false;
        let mut all = true;
        for &mask in &self.current {
            any |= A::possible(mask);
            all &= !A::avoidable(mask);
        }
        self.any = any;
        self.all = all;
    }

    fn push(&mut self, kind: Kind) {
        let empty = || vec![A::bool(false); self.width].into_boxed_slice();
        let mut frame = self.spare.pop().unwrap_or_else(|| Frame {
            kind,
            saved: empty(),
            left: empty(),
            broken: empty(),
        });
        frame.kind = kind;
        frame.saved.copy_from_slice(&self.current);
        frame.left.fill(A::bool(false));
        if kind == Kind::Loop {
            frame.broken.fill(A::bool(false));
        }
        self.frames.push(frame);
    }

    /// Opens a `switch` or a call. Returns `true` if a lane is active afterwards.
    pub(crate) fn enter(&mut self) -> bool {
        self.push(Kind::Branch);
        self.any
    }

    pub(crate) fn enter_if(&mut self, condition: &[A::Bool]) -> bool {
        self.push(Kind::Branch);
        for (mask, &condition) in self.current.iter_mut().zip(condition) {
            *mask = A::and(*mask, condition);
        }
        self.changed();
        self.any
    }

    pub(crate) fn enter_else(&mut self, condition: &[A::Bool]) -> bool {
        if let Some(frame) = self.frames.last() {
            for ((mask, &saved), &condition) in
                self.current.iter_mut().zip(&frame.saved).zip(condition)
            {
                *mask = A::and(saved, A::not(condition));
            }
        }
        self.changed();
        self.any
    }

    pub(crate) fn enter_case(&mut self, condition: &[A::Bool], falls: bool) -> bool {
        if let Some(frame) = self.frames.last() {
            for ((mask, &saved), &condition) in
                self.current.iter_mut().zip(&frame.saved).zip(condition)
            {
                let fallen = if falls { *mask } else { A::bool(false) };
                *mask = A::or(A::and(saved, condition), fallen);
            }
        }
        self.changed();
        self.any
    }

    pub(crate) fn leave(&mut self) -> bool {
        if let Some(frame) = self.frames.pop() {
            for ((mask, &saved), &left) in
                self.current.iter_mut().zip(&frame.saved).zip(&frame.left)
            {
                *mask = A::and(saved, A::not(left));
            }
            self.spare.push(frame);
        }
        self.changed();
        self.any
    }

    pub(crate) fn enter_loop(&mut self) -> bool {
        self.push(Kind::Loop);
        self.any
    }

    /// Begins the `continuing` block of a loop: makes lanes that left the body by `continue` active again.
    pub(crate) fn continuing(&mut self) {
        if let Some(frame) = self.frames.last() {
            let gone = frame.broken.iter().zip(&frame.left);
            for ((mask, &saved), (&broken, &left)) in
                self.current.iter_mut().zip(&frame.saved).zip(gone)
            {
                *mask = A::and(saved, A::not(A::or(broken, left)));
            }
        }
        self.changed();
    }

    pub(crate) fn break_if(&mut self, condition: &[A::Bool]) {
        if let Some(frame) = self.frames.last_mut() {
            for ((mask, broken), &condition) in
                self.current.iter_mut().zip(&mut frame.broken).zip(condition)
            {
                *broken = A::or(*broken, A::and(*mask, condition));
                *mask = A::and(*mask, A::not(condition));
            }
        }
        self.changed();
    }

    pub(crate) fn drop_lanes(&mut self, lanes: &[usize]) {
        for lane in lanes {
            self.current[*lane] = A::bool(false);
            self.frames.iter_mut().for_each(|frame| frame.left[*lane] = A::bool(true));
        }
        self.changed();
    }

    /// Makes the active lanes jump to the end of an open construct: the innermost one if `depth` is 0, the one around
    /// it if `depth` is 1. `breaks` is `true` for `break`, and `false` for `continue` and `return`.
    pub(crate) fn exit(&mut self, depth: u32, breaks: bool) {
        let target = self.frames.len().saturating_sub(1 + depth as usize);
        for frame in self.frames[target + 1..].iter_mut().rev() {
            for (left, &leaving) in frame.left.iter_mut().zip(&self.current) {
                *left = A::or(*left, leaving);
            }
        }
        if let Some(frame) = self.frames.get_mut(target)
            && breaks
            && frame.kind == Kind::Loop
        {
            for (broken, &leaving) in frame.broken.iter_mut().zip(&self.current) {
                *broken = A::or(*broken, leaving);
            }
        }
        self.current.fill(A::bool(false));
        self.changed();
    }
}
