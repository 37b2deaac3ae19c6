//! Twin of `sensor.wgsl`.
