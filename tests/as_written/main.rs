//! The mistakes of the source documents. An ordinary check catches each, with the number that the mistake produces. The
//! functions are in `shaders/as_written/`.

mod brdf;
mod distribution;
mod fresnel;
mod irradiance;
mod layering;
mod radiometry;
mod sampling;
mod specular;
