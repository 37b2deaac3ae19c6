//! Tests of the shader library, a file for each module, and of the source documents' formulas. They are one program, so
//! that an edit of the harness links only once.

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
