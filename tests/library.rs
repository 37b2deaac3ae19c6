//! Tests of the shader library, with one file for each module, and tests of the source documents' formulas. All these
//! files are modules of one test program, so after an edit of the harness Cargo links only one program.

#[path = "as_written/main.rs"]
mod as_written;
mod brdf;
mod camera;
mod compensation;
mod distribution;
mod drivers;
mod environment;
mod fresnel;
mod geometry;
mod hazards;
mod irradiance;
mod known_issues;
mod layering;
mod maps;
mod materials;
mod overdraw;
mod probe_room;
mod radiometry;
mod sampling;
mod scene;
mod sensor;
mod specular;
