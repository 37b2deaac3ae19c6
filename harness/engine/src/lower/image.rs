//! Textures.

use naga::{Expression, Handle, Statement};

use super::{Lower, Lowered, Scope, Value};

impl<'m> Lower<'m> {
    pub(super) fn image(
        &mut self,
        _scope: &mut Scope<'m>,
        _handle: Handle<Expression>,
    ) -> Lowered<Value> {
        Err(self.refuse("textures"))
    }

    pub(super) fn image_store(
        &mut self,
        _scope: &mut Scope<'m>,
        _statement: &'m Statement,
        span: naga::Span,
    ) -> Lowered<()> {
        self.span = span;
        Err(self.refuse("writes to textures"))
    }
}
