//! Physically based shading and image-based lighting in WGSL, each module with its counterpart in Rust.
//!
//! For each module, `X.wgsl` contains the shader functions. `X.rs` contains their references: the same functions in
//! f64, in the form of the cited paper. Shader and reference share no code. An optimised shader also shares no algebra
//! with its reference, so if shader and reference agree, both are probably right.
//!
//! Most shader functions are pure: they compute their results only from their arguments. Only these modules have
//! bindings: `camera.wgsl`; `environment.wgsl`, with the light that `irradiance.wgsl` and `specular.wgsl` sample; and
//! the modules with entry points, `scene.wgsl`, `probe_room.wgsl` and `maps.wgsl`. The folder `as_written` contains
//! functions with the mistakes of papers and lectures. Tests catch these mistakes. All functions have their arguments
//! in this order: material (`f0`, `alpha`), frame (`n`), `v`, `l`, random numbers (`u`).

pub mod brdf;
pub mod camera;
pub mod compensation;
pub mod distribution;
pub mod environment;
pub mod fresnel;
pub mod geometry;
pub mod irradiance;
pub mod layering;
pub mod maps;
pub mod materials;
pub mod math;
pub mod overdraw;
pub mod probe_room;
pub mod radiometry;
pub mod sampling;
pub mod scene;
pub mod sensor;
pub mod specular;

use karat::Package;

/// The WGSL modules of this folder.
pub static PBR: Package = karat::package!(".");
