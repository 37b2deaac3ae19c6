//! Twin of `brdf.wgsl`.
