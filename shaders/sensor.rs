//! Rust counterpart of `sensor.wgsl`: from radiance to a display, in textbook form.
//!
//! Colours are linear, except where a name says otherwise, and have the primaries of sRGB.

use glam::DVec3;

/// Computes EV100 = log2(N^2 / t * 100 / S), as in Lagarde and de Rousiers 2014, section 5.1.
///
/// `aperture` is the f-number N, `shutter` the time t in s, and `iso` the sensitivity S. All are above 0.
#[must_use]
pub fn ev100_from_camera(aperture: f64, shutter: f64, iso: f64) -> f64 {
    2.0 * aperture.log2() - shutter.log2() - (iso / 100.0).log2()
}

/// Computes 1 divided by the saturating luminance, 1.2 * 2^EV100, as in Lagarde and de Rousiers 2014, section 5.1.
#[must_use]
pub fn exposure_from_ev100(ev100: f64) -> f64 {
    (1.2 * 2.0_f64.powf(ev100)).recip()
}

/// Multiplies the radiance by 2 for each stop.
#[must_use]
pub fn expose(radiance: DVec3, stops: f64) -> DVec3 {
    radiance * 2.0_f64.powf(stops)
}

/// Computes the luminance of IEC 61966-2-1: Y = 0.2126 R + 0.7152 G + 0.0722 B.
#[must_use]
pub fn luminance(color: DVec3) -> f64 {
    0.2126 * color.x + 0.7152 * color.y + 0.0722 * color.z
}

/// Computes Reinhard et al. 2002, eq. 4: L (1 + L / white^2) / (1 + L), for L >= 0 and white > 0.
#[must_use]
pub fn reinhard(luminance: f64, white: f64) -> f64 {
    luminance * (1.0 + luminance / white.powi(2)) / (1.0 + luminance)
}

/// Scales the colour so that its luminance becomes the result of [`reinhard`].
#[must_use]
pub fn tone_map(color: DVec3, white: f64) -> DVec3 {
    match luminance(color) {
        0.0 => DVec3::ZERO,
        before => color / before * reinhard(before, white),
    }
}

/// Computes the sRGB code of IEC 61966-2-1: 12.92 C up to 0.0031308, otherwise 1.055 C^(1 / 2.4) - 0.055.
#[must_use]
pub fn srgb_from_linear(color: DVec3) -> DVec3 {
    color
        .map(|c| if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(2.4_f64.recip()) - 0.055 })
}

/// Computes linear light as in IEC 61966-2-1: C / 12.92 up to 0.04045, otherwise ((C + 0.055) / 1.055)^2.4.
#[must_use]
pub fn linear_from_srgb(color: DVec3) -> DVec3 {
    color.map(|c| if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sunny_day_is_at_ev_15() {
        // The camera has f/16 and 1/ISO s.
        assert!((ev100_from_camera(16.0, 1.0 / 100.0, 100.0) - 14.64).abs() < 0.01);
        assert_eq!(ev100_from_camera(1.0, 1.0, 100.0), 0.0);
        // Twice the sensitivity needs one stop less light.
        assert!(
            (ev100_from_camera(4.0, 0.01, 400.0) - ev100_from_camera(4.0, 0.01, 100.0) + 2.0).abs()
                < 1e-12
        );
    }

    #[test]
    fn the_brightest_that_a_sensor_holds_becomes_one() {
        for ev100 in [-6.0, 0.0, 15.0] {
            // The saturating luminance is 78 / (q S) N^2 / t = 78 / (100 q) 2^EV100, with q = 0.65.
            let brightest = 78.0 / (100.0 * 0.65) * 2.0_f64.powf(ev100);
            assert!((exposure_from_ev100(ev100) * brightest - 1.0).abs() < 1e-14, "{ev100}");
        }
    }

    #[test]
    fn white_has_luminance_one() {
        assert!((luminance(DVec3::ONE) - 1.0).abs() < 1e-15);
        assert!(
            luminance(DVec3::Y) > luminance(DVec3::X) && luminance(DVec3::X) > luminance(DVec3::Z)
        );
    }

    #[test]
    fn reinhard_maps_white_to_one() {
        for white in [0.5, 4.0, 100.0] {
            assert!((reinhard(white, white) - 1.0).abs() < 1e-15, "{white}");
            assert_eq!(reinhard(0.0, white), 0.0);
        }
        // Eq. 3 is the limit of eq. 4 for a white brighter than all light.
        assert!((reinhard(3.0, 1e9) - 0.75).abs() < 1e-15);
        let mapped = tone_map(DVec3::new(0.5, 2.0, 1.0), 4.0);
        assert!((mapped / mapped.y).abs_diff_eq(DVec3::new(0.25, 1.0, 0.5), 1e-15));
        assert!(
            (luminance(mapped) - reinhard(luminance(DVec3::new(0.5, 2.0, 1.0)), 4.0)).abs() < 1e-15
        );
    }

    #[test]
    fn known_values_of_srgb() {
        // The codes of mid grey (18 %) and of 128/255 have the digits of published tables.
        assert!((srgb_from_linear(DVec3::splat(0.18)).x - 0.461_356).abs() < 1e-6);
        assert!((linear_from_srgb(DVec3::splat(128.0 / 255.0)).x - 0.215_861).abs() < 1e-6);
        assert!(srgb_from_linear(DVec3::ONE).abs_diff_eq(DVec3::ONE, 1e-15));
        assert!(linear_from_srgb(DVec3::ONE).abs_diff_eq(DVec3::ONE, 1e-15));
        assert_eq!(srgb_from_linear(DVec3::ZERO), DVec3::ZERO);
    }

    #[test]
    fn the_curves_are_inverse_and_continuous() {
        for i in 0..=1000 {
            let c = DVec3::splat(f64::from(i) / 1000.0);
            // The standard's thresholds are rounded: they differ by 6e-9 in linear light.
            assert!(linear_from_srgb(srgb_from_linear(c)).abs_diff_eq(c, 1e-8), "{c}");
        }
        let gap = |f: fn(DVec3) -> DVec3, at: f64| {
            (f(DVec3::splat(at)) - f(DVec3::splat(at.next_up()))).x.abs()
        };
        assert!(gap(srgb_from_linear, 0.003_130_8) < 1e-7);
        assert!(gap(linear_from_srgb, 0.040_45) < 1e-7);
    }
}
