//! Lowers subgroup operations. Each scalar of a value gets its own operation.

use naga::{Direction, Expression, GatherMode, Handle};

use super::{Lower, Lowered, Scope, Value};
use crate::code::{From, Op, Reg, SubgroupKind, SubgroupOp};
use crate::scalar::{File, Scalar};

impl<'m> Lower<'m> {
    /// Lowers `subgroupBallot`: four words with one bit for each lane, set if the lane is active and the predicate
    /// holds.
    pub(super) fn ballot(
        &mut self,
        scope: &mut Scope<'m>,
        predicate: Option<Handle<Expression>>,
        result: Handle<Expression>,
    ) -> Lowered<()> {
        let predicate = match predicate {
            Some(predicate) => self.flat(scope, predicate)?[0],
            None => self.constant(Scalar::Bool, 1),
        };
        let mut words = Vec::new();
        for word in 0..4 {
            let kind = SubgroupKind::Ballot(word);
            words.push(self.subgroup(kind, Scalar::U32, &[predicate])?);
        }
        scope.values[result.index()] = Some(Value::Flat(words.into()));
        Ok(())
    }

    pub(super) fn collective(
        &mut self,
        scope: &mut Scope<'m>,
        (operation, collective): (naga::SubgroupOperation, naga::CollectiveOperation),
        argument: Handle<Expression>,
        result: Handle<Expression>,
    ) -> Lowered<()> {
        let kind = SubgroupKind::Collective(operation, collective);
        self.over_subgroup(scope, kind, argument, None, result)
    }

    pub(super) fn gather_of(
        &mut self,
        scope: &mut Scope<'m>,
        mode: GatherMode,
        argument: Handle<Expression>,
        result: Handle<Expression>,
    ) -> Lowered<()> {
        let (from, index) = match mode {
            GatherMode::BroadcastFirst => (From::First, None),
            GatherMode::Broadcast(index) | GatherMode::Shuffle(index) => (From::Lane, Some(index)),
            GatherMode::ShuffleDown(index) => (From::Above, Some(index)),
            GatherMode::ShuffleUp(index) => (From::Below, Some(index)),
            GatherMode::ShuffleXor(index) => (From::Xor, Some(index)),
            GatherMode::QuadBroadcast(index) => (From::OfQuad, Some(index)),
            GatherMode::QuadSwap(Direction::X) => (From::Swap(1), None),
            GatherMode::QuadSwap(Direction::Y) => (From::Swap(2), None),
            GatherMode::QuadSwap(Direction::Diagonal) => (From::Swap(3), None),
        };
        self.over_subgroup(scope, SubgroupKind::Gather(from), argument, index, result)
    }

    fn over_subgroup(
        &mut self,
        scope: &mut Scope<'m>,
        kind: SubgroupKind,
        argument: Handle<Expression>,
        index: Option<Handle<Expression>>,
        result: Handle<Expression>,
    ) -> Lowered<()> {
        let scalars = self.scalars(&self.type_of(scope, argument))?;
        let values = self.flat(scope, argument)?;
        let index = match index {
            Some(index) => self.flat(scope, index)?.first().copied(),
            None => None,
        };
        let mut results = Vec::new();
        for (scalar, value) in scalars.into_iter().zip(values.iter()) {
            let ins = match value.file {
                File::Bool => index.into_iter().chain([*value]).collect::<Vec<_>>(),
                _ => [*value].into_iter().chain(index).collect(),
            };
            results.push(self.subgroup(kind, scalar, &ins)?);
        }
        scope.values[result.index()] = Some(Value::Flat(results.into()));
        Ok(())
    }

    fn subgroup(&mut self, kind: SubgroupKind, scalar: Scalar, ins: &[Reg]) -> Lowered<Reg> {
        self.code.subgroup.get_or_insert(self.span);
        let to = self.fresh(scalar.file());
        self.code.subgroups.push(SubgroupOp { kind, scalar });
        self.emit(Op::Subgroup(self.code.subgroups.len() as u32 - 1), &[to], ins)?;
        Ok(to)
    }
}
