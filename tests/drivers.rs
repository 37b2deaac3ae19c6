//! Drivers whose errors are within WGSL's bounds, but larger than the errors of other drivers, with bounds for these
//! errors.

/// SwiftShader, Google's software rasteriser, on any graphics API.
pub(crate) const SWIFTSHADER: &str = "@swiftshader";

/// NVIDIA's drivers. Their errors were measured on an H200 with driver 580.159.
pub(crate) const NVIDIA: &str = "@nvidia";

/// The error of a texture filter's weight, or of the fraction of a mip level, on a driver that cuts off bits. Weights
/// and fractions have 8 bits. A driver may round them to 8 bits, with an error of 1/512, or cut off the other bits,
/// with an error of 1/256, as NVIDIA's driver does. Vulkan reports the number of bits (`subTexelPrecisionBits`,
/// `mipmapPrecisionBits`), but not the kind of rounding.
pub(crate) const CUT_OFF: f64 = 1.0 / 256.0;

/// The absolute error that WGSL allows for sin and cos between -pi and pi. SwiftShader needs this tolerance, because it
/// computes sin and cos by one polynomial of order 5 (`Sin5` in `ShaderCore.cpp`). The polynomial is exact at multiples
/// of 30 degrees, and has an error of up to 1.9e-4 between these angles. The error of Mesa's drivers is 1e-7.
pub(crate) const SINE: f64 = 1.0 / 2048.0;

/// The reason for known issues with short halfway vectors, which can point away from the view. `sampling.rs` explains
/// them.
pub(crate) const SHORT_HALFWAY: &str = "its sine and cosine are off by 1.9e-4, of 4.9e-4 that WGSL grants: \
                                 where view and normal are nearly at right angles, what is left of \
                                 the halfway vector is shorter than that, and points anywhere";
