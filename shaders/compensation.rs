//! Rust counterpart of `compensation.wgsl`: adds the light of multiple reflections, which a model of single reflections
//! loses.

use glam::{DVec2, DVec3};

/// Computes f0 A + B, where A and B are the two values of `table`, as in Karis 2013, "Environment BRDF".
#[must_use]
pub fn directional_albedo(f0: DVec3, table: DVec2) -> DVec3 {
    f0 * table.x + DVec3::splat(table.y)
}

/// Computes Turquin 2019, eq. 16: the light of one reflection, times 1 + F0 (1 - E) / E. E is the directional albedo at
/// f0 = 1.
#[must_use]
pub fn compensated(f0: DVec3, light: DVec3, table: DVec2) -> DVec3 {
    let furnace = table.x + table.y;
    light + light * f0 * (1.0 - furnace) / furnace
}

/// Computes the model of Kulla and Conty 2017: the specular interface reflects the share E of the light (the
/// directional albedo), and the diffuse layer below gets 1 - E.
#[must_use]
pub fn coupled(f0: DVec3, diffuse: DVec3, light: DVec3, table: DVec2) -> DVec3 {
    light + (DVec3::ONE - directional_albedo(f0, table)) * diffuse
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::specular::{estimate, split_sum_table};

    /// In a white environment, a metal with `compensated` and a plastic with `coupled` reflect radiance 1, for each
    /// width and view.
    #[test]
    fn furnaces_are_white() {
        for alpha in [0.0, 0.05, 0.3, 0.5, 1.0] {
            for n_dot_v in [0.01, 0.2, 0.7, 1.0_f64] {
                let view = DVec3::new((1.0 - n_dot_v * n_dot_v).sqrt(), 0.0, n_dot_v);
                let table = split_sum_table(alpha, n_dot_v, 256);
                let white = |f0| estimate(f0, alpha, DVec3::Z, view, 256, |_| DVec3::ONE);
                let metal = compensated(DVec3::ONE, white(DVec3::ONE), table);
                assert!(metal.abs_diff_eq(DVec3::ONE, 1e-12), "{alpha}, {n_dot_v}: {metal}");
                let f0 = DVec3::splat(0.04);
                let plastic = coupled(f0, DVec3::ONE, white(f0), table);
                assert!(plastic.abs_diff_eq(DVec3::ONE, 1e-12), "{alpha}, {n_dot_v}: {plastic}");
            }
        }
    }
}
