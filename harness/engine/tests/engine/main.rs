//! What WGSL does in the engine, by feature, in one program.

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
