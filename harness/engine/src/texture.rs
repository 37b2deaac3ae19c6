//! Textures and samplers, as data.

/// A texture.
#[derive(Clone, Debug, Default)]
pub struct Texture;

/// A sampler.
#[derive(Clone, Debug, Default)]
pub struct Sampler;
