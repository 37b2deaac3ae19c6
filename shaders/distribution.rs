//! Twin of `distribution.wgsl`.
