//! Tests of the shader library, a file for each module, and of the formulas as the source documents
//! wrote them. One program: after an edit of the harness it is linked once.

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
