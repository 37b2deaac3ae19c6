//! The mistakes of the source documents, with the functions in `shaders/as_written/`. An ordinary check catches each
//! mistake, and finds the number that the mistake produces.

mod brdf;
mod distribution;
mod fresnel;
mod irradiance;
mod layering;
mod radiometry;
mod sampling;
mod specular;
