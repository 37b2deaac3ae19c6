//! The resources that the caller binds.

use std::collections::BTreeMap;

use crate::races::Touched;
use crate::texture::{Sampler, Texture};

/// Buffers, textures and samplers, by group and binding.
#[derive(Clone, Debug, Default)]
pub struct Resources {
    pub(crate) buffers: BTreeMap<(u32, u32), Vec<u8>>,
    pub(crate) textures: BTreeMap<(u32, u32), Texture>,
    pub(crate) samplers: BTreeMap<(u32, u32), Sampler>,
    /// The written elements of each buffer whose contents are unknown until they are written.
    pub(crate) blank: BTreeMap<(u32, u32), Touched>,
}

impl Resources {
    /// No resources.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Binds a resource of `others`. In `others`, the resource has the group and binding `from`. In `self`, the
    /// resource gets the group and binding `to`.
    pub fn take_from(&mut self, others: &Self, from: [u32; 2], to: [u32; 2]) {
        let (from, to) = ((from[0], from[1]), (to[0], to[1]));
        if let Some(bytes) = others.buffers.get(&from) {
            self.buffers.insert(to, bytes.clone());
        }
        if let Some(touched) = others.blank.get(&from) {
            self.blank.insert(to, touched.clone());
        }
        if let Some(texture) = others.textures.get(&from) {
            self.textures.insert(to, texture.clone());
        }
        if let Some(sampler) = others.samplers.get(&from) {
            self.samplers.insert(to, sampler.clone());
        }
    }

    /// The group and binding for `var<immediate>`, which has no group and binding in WGSL.
    pub const IMMEDIATE: [u32; 2] = [u32::MAX; 2];

    /// Binds a buffer. The bytes must have the layout of the buffer's type, in little-endian order.
    pub fn set_buffer(&mut self, group: u32, binding: u32, bytes: impl Into<Vec<u8>>) {
        self.buffers.insert((group, binding), bytes.into());
    }

    /// The bytes of a buffer, which a dispatch may have changed. `None` if no buffer has this group and binding.
    #[must_use]
    pub fn buffer(&self, group: u32, binding: u32) -> Option<&[u8]> {
        self.buffers.get(&(group, binding)).map(Vec::as_slice)
    }

    /// Declares that the contents of a buffer are unknown until they are written.
    pub fn set_blank(&mut self, group: u32, binding: u32) {
        self.blank.insert((group, binding), Touched::default());
    }

    /// The written elements of a buffer with unknown contents.
    #[must_use]
    pub fn blank(&self, group: u32, binding: u32) -> Option<&Touched> {
        self.blank.get(&(group, binding))
    }

    /// The bytes of all buffers with unknown contents.
    pub fn blank_mut(&mut self) -> impl Iterator<Item = &mut Vec<u8>> {
        let Self { buffers, blank, .. } = self;
        let is_blank = |(at, _): &(&(u32, u32), &mut Vec<u8>)| blank.contains_key(at);
        buffers.iter_mut().filter(is_blank).map(|(_, bytes)| bytes)
    }

    /// Binds a texture.
    pub fn set_texture(&mut self, group: u32, binding: u32, texture: Texture) {
        self.textures.insert((group, binding), texture);
    }

    /// A texture, which a dispatch may have changed. `None` if no texture has this group and binding.
    #[must_use]
    pub fn texture(&self, group: u32, binding: u32) -> Option<&Texture> {
        self.textures.get(&(group, binding))
    }

    /// Binds a sampler.
    pub fn set_sampler(&mut self, group: u32, binding: u32, sampler: Sampler) {
        self.samplers.insert((group, binding), sampler);
    }
}
