//! Drivers that use more of WGSL's allowed error than others, and how much.

/// Google's rasteriser, on any API.
pub(crate) const SWIFTSHADER: &str = "@swiftshader";

/// NVIDIA's drivers, measured on an H200 with 580.159.
pub(crate) const NVIDIA: &str = "@nvidia";

/// The weight of a filter and the fraction of a level have 8 bits. A driver may round them, with an error of 1/512, or
/// cut them off as NVIDIA does: 1/256. Vulkan gives the number of bits (`subTexelPrecisionBits`,
/// `mipmapPrecisionBits`), but not the rounding.
pub(crate) const CUT_OFF: f64 = 1.0 / 256.0;

/// The absolute error that WGSL allows sin and cos between -pi and pi. SwiftShader needs it: there both are one
/// polynomial of order 5, exact at multiples of 30 degrees and off by up to 1.9e-4 between them (`Sin5` in its
/// `ShaderCore.cpp`). Mesa's are off by 1e-7.
pub(crate) const SINE: f64 = 1.0 / 2048.0;

/// The reason why a short halfway vector may point away from the view: see `sampling.rs`.
pub(crate) const SHORT_HALFWAY: &str = "its sine and cosine are off by 1.9e-4, of 4.9e-4 that WGSL grants: \
                                 where view and normal are nearly at right angles, what is left of \
                                 the halfway vector is shorter than that, and points anywhere";
