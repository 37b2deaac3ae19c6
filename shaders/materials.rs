//! Twin of `materials.wgsl`.
