//! Drivers that use more of WGSL's allowed error than other drivers, with the size of their errors.

/// Google's software rasteriser, with any graphics API.
pub(crate) const SWIFTSHADER: &str = "@swiftshader";

/// NVIDIA's drivers. Their errors were measured on an H200 with driver 580.159.
pub(crate) const NVIDIA: &str = "@nvidia";

/// The error of a filter's weight, or of the fraction of a mip level, if the driver cuts off bits. Both numbers have 8
/// bits. A driver may round them, with an error of 1/512, or cut bits off, with an error of 1/256, as NVIDIA does.
/// Vulkan reports the number of bits (`subTexelPrecisionBits`, `mipmapPrecisionBits`), but not the kind of rounding.
pub(crate) const CUT_OFF: f64 = 1.0 / 256.0;

/// The absolute error that WGSL allows sin and cos between -pi and pi. SwiftShader needs this error: its sin and cos
/// are one polynomial of order 5 (`Sin5` in its `ShaderCore.cpp`). The polynomial is exact at multiples of 30 degrees,
/// and has an error of up to 1.9e-4 between them. The error of Mesa's drivers is 1e-7.
pub(crate) const SINE: f64 = 1.0 / 2048.0;

/// The reason why a short halfway vector may point away from the view. `sampling.rs` explains it.
pub(crate) const SHORT_HALFWAY: &str = "its sine and cosine are off by 1.9e-4, of 4.9e-4 that WGSL grants: \
                                 where view and normal are nearly at right angles, what is left of \
                                 the halfway vector is shorter than that, and points anywhere";
