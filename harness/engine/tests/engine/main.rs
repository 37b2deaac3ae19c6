//! The engine's tests, one module for each feature of WGSL.

mod builtins;
mod common;
mod control;
mod coverage;
mod differential;
mod explore;
mod hostile;
mod intervals;
mod memory;
mod observed;
mod pixels;
mod races;
mod random;
mod reassociation;
mod same;
mod subgroups;
mod table;
mod textures;
