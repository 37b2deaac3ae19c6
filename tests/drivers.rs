//! Drivers that are less exact than others where WGSL lets them be, and how much.

/// Google's rasteriser, on whatever API.
pub(crate) const SWIFTSHADER: &str = "@swiftshader";

/// NVIDIA's drivers, seen on an H200 with 580.159.
pub(crate) const NVIDIA: &str = "@nvidia";

/// Where a filter's weight and the fraction of a level have 8 bits, they may be rounded, which is
/// off by 1/512, or cut off as on NVIDIA: 1/256. Vulkan says how many bits there are
/// (`subTexelPrecisionBits`, `mipmapPrecisionBits`) and not how a number gets them.
pub(crate) const CUT_OFF: f64 = 1.0 / 256.0;

/// What WGSL grants sin and cos between -pi and pi, as an absolute error. SwiftShader needs it: both
/// are one polynomial of order 5 there, exact at multiples of 30 degrees and off by up to 1.9e-4
/// between them (`Sin5` in its `ShaderCore.cpp`). Mesa's are off by 1e-7.
pub(crate) const SINE: f64 = 1.0 / 2048.0;

/// Why a short halfway vector may point away from the view: see `sampling.rs`.
pub(crate) const SHORT_HALFWAY: &str = "its sine and cosine are off by 1.9e-4, of 4.9e-4 that WGSL grants: \
                                 where view and normal are nearly at right angles, what is left of \
                                 the halfway vector is shorter than that, and points anywhere";
