//! The mistakes of the source documents, each caught by an ordinary check, with the number that it
//! produces. The functions are in `shaders/as_written/`.

mod brdf;
mod distribution;
mod fresnel;
mod irradiance;
mod layering;
mod radiometry;
mod sampling;
mod specular;
