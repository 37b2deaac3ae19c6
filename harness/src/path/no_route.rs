//! Replaces `route.rs` in builds without the feature `routes`.

use super::{Path, PathError, Via};
use crate::reflect::Ir;

pub(super) fn missing(path: Path) -> Option<String> {
    let reason = "karat is built without routes: add features = [\"routes\"] to the dependency on karat in \
                  Cargo.toml";
    (path.via() != Via::Direct).then(|| reason.to_owned())
}

pub(super) fn features(_: Path) -> wgpu::Features {
    wgpu::Features::empty()
}

pub(super) fn takes_wgpu(_: Path) -> bool {
    true
}

#[expect(clippy::unnecessary_wraps, reason = "as with routes")]
pub(super) fn through_naga(_: Path, ir: Ir) -> Result<Ir, PathError> {
    Ok(ir)
}

pub(super) enum Routed {
    Ir(Box<Ir>),
    #[expect(dead_code, reason = "there are no routes")]
    Spirv(Box<Foreign>),
}

pub(super) enum Foreign {}

#[expect(clippy::unnecessary_wraps, reason = "as with routes")]
pub(super) fn take(_: Path, ir: Ir, _: &str) -> Result<Routed, PathError> {
    Ok(Routed::Ir(Box::new(ir)))
}

impl Foreign {
    pub(super) fn pipeline(&self, _: &wgpu::Device) -> wgpu::ComputePipeline {
        match *self {}
    }

    pub(super) fn place(&self, _: u32, _: u32) -> Option<u32> {
        match *self {}
    }
}
