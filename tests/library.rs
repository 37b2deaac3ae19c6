//! Tests of the shader library, with one file for each module, and tests of the source documents' formulas. All files
//! are one program, so an edit of the harness needs only one link.

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
