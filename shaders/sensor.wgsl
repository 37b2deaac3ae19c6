// From radiance to a display: exposure, luminance, tone mapping, and the transfer function
// of sRGB. PV227 lecture 11, "Sensors". Only for previews: frames are linear and HDR.

/// Weights of linear red, green and blue with the primaries of sRGB (and of ITU-R BT.709).
/// IEC 61966-2-1, the second row of the matrix to XYZ.
const LUMINANCE: vec3f = vec3f(0.2126, 0.7152, 0.0722);

/// Exposure value at ISO 100 of a camera with f-number `aperture`, `shutter` time in s and
/// sensitivity `iso`. Lagarde and de Rousiers 2014, section 5.1: log2(N^2 / t * 100 / S).
fn ev100_from_camera(aperture: f32, shutter: f32, iso: f32) -> f32 {
    return log2(aperture * aperture / shutter * 100.0 / iso);
}

/// The factor that converts luminance in cd/m^2 such that the brightest luminance of the
/// sensor becomes 1. Lagarde and de Rousiers 2014, section 5.1: 1 / (1.2 * 2^EV100).
///
/// The 1.2 is 78 / (100 q) with q = 0.65, the part of the light that a lens lets through.
fn exposure_from_ev100(ev100: f32) -> f32 {
    return exp2(-ev100) / 1.2;
}

/// `radiance`, brighter by `stops`: each stop doubles it.
fn expose(radiance: vec3f, stops: f32) -> vec3f {
    return radiance * exp2(stops);
}

/// Luminance of a linear colour.
fn luminance(color: vec3f) -> f32 {
    return dot(color, LUMINANCE);
}

/// Compresses luminance so that `white`, the least that shows as white, becomes 1.
/// Reinhard et al. 2002, eq. 4: L (1 + L / white^2) / (1 + L). `white` is above 1e-30.
fn reinhard(color_luminance: f32, white: f32) -> f32 {
    return compressed(vec3f(color_luminance), color_luminance, white).x;
}

/// `reinhard` of a colour's luminance, with the same hue and saturation. Channels
/// brighter than the luminance may exceed 1. `white` is above 1e-30. If it is below
/// 1e-15, channels of up to 1e4 may become infinite, because the results exceed an f32.
fn tone_map(color: vec3f, white: f32) -> vec3f {
    return compressed(color, luminance(color), white);
}

/// `color` times eq. 4 over L, so that black needs no division by its luminance.
///
/// It divides by `white` twice, and each time a number that is small if the other is:
/// the square of `white` may underflow, and a channel of 0 must not meet an infinity.
fn compressed(color: vec3f, color_luminance: f32, white: f32) -> vec3f {
    let darker = color / (1.0 + color_luminance);
    return darker + darker / white * (color_luminance / white);
}

/// Non-linear sRGB of a linear colour. IEC 61966-2-1.
///
/// Not clamped: values above 1 continue the curve, those below 0 its straight part. (The power is
/// NaN there, but it isn't selected.)
fn srgb_from_linear(color: vec3f) -> vec3f {
    let curve = 1.055 * pow(color, vec3f(1.0 / 2.4)) - 0.055;
    return select(curve, 12.92 * color, color <= vec3f(0.0031308));
}

/// Linear colour of non-linear sRGB. IEC 61966-2-1. Not clamped either.
fn linear_from_srgb(color: vec3f) -> vec3f {
    let curve = pow((color + 0.055) / 1.055, vec3f(2.4));
    return select(curve, color / 12.92, color <= vec3f(0.04045));
}
