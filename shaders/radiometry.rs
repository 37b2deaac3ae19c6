//! Twin of `radiometry.wgsl`.
