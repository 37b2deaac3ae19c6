//! Tests of the functions in `shaders/as_written/`, which contain the mistakes of papers and lectures. Each mistake
//! makes an ordinary check fail. `shaders/README.md` lists the mistakes by number: E3, P1.

mod brdf;
mod distribution;
mod fresnel;
mod irradiance;
mod layering;
mod radiometry;
mod sampling;
mod specular;
