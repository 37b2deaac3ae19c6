//! The vectors and matrices of other versions of glam, and those of mint: what an engine has that isn't on the
//! glam of this crate. Each is a feature, so that a project without one compiles none of it.

#[cfg(feature = "mint")]
mod of_mint {
    use mint::{Vector2, Vector3, Vector4};

    use super::super::mirror::mirror_vector;
    use super::super::shareable::{Word, next, shareable_vector};
    use super::super::{Mirror, Scalar, Shape, Shareable};

    macro_rules! of {
        ($($vector:ident $size:literal $($lane:ident)+;)*) => {
            shareable_vector! {$(
                $vector<f32>, $vector<f64>, f32, $size, F32, |v| $vector { $($lane: f64::from(v.$lane)),+ };
                $vector<i32>, $vector<i32>, i32, $size, I32, |v| v;
                $vector<u32>, $vector<u32>, u32, $size, U32, |v| v;
            )*}
            mirror_vector! {$(
                $vector<f64>, f64, $size, F32, |v| v;
                $vector<i32>, i32, $size, I32, f64::from;
                $vector<u32>, u32, $size, U32, f64::from;
            )*}
        };
    }

    of! {
        Vector2 2 x y;
        Vector3 3 x y z;
        Vector4 4 x y z w;
    }
}

macro_rules! versions {
    ($($feature:literal $module:ident $package:ident;)*) => {$(
        #[cfg(feature = $feature)]
        mod $module {
            use $package::{
                BVec2, BVec3, BVec4, DMat2, DMat3, DMat4, DVec2, DVec3, DVec4, IVec2, IVec3, IVec4, Mat2,
                Mat3, Mat4, UVec2, UVec3, UVec4, Vec2, Vec3, Vec4,
            };

            use super::super::mirror::{mirror_matrix, mirror_vector, mirrored};
            use super::super::shareable::{Word, next, shareable_matrix, shareable_vector, shared};
            use super::super::{Mirror, Scalar, Shape, Shareable};

            shared! {}
            mirrored! {}
        }
    )*};
}

versions! {
    "glam-029" of_029 glam_029;
    "glam-030" of_030 glam_030;
    "glam-031" of_031 glam_031;
    "glam-032" of_032 glam_032;
    "glam-033" of_033 glam_033;
}

#[cfg(all(test, feature = "glam-029"))]
mod tests {
    use crate::domain::{Domain, UnitVector};
    use crate::value::{Mirror, Reference, Shareable};

    /// A vector of an older glam has the lanes of this one's, and a reference over it gets its doubles.
    #[test]
    fn an_older_glam_is_passed_and_compared() {
        let old = glam_029::Vec3::new(1.0, -2.0, 0.1);
        let (mut lanes, mut own) = (Vec::new(), Vec::new());
        old.store(&mut lanes);
        glam::Vec3::new(1.0, -2.0, 0.1).store(&mut own);
        assert_eq!(lanes, own);
        assert_eq!(glam_029::Vec3::load(&mut lanes.iter()), old);
        assert_eq!(<glam_029::Vec3 as Shareable>::shape(), <glam::Vec3 as Shareable>::shape());
        let turned = |v: glam_029::DVec3| v.yzx();
        let mut expected = Vec::new();
        Reference::<glam_029::Vec3>::expect(&turned, &old, &mut expected);
        assert_eq!(expected, [-2.0, f64::from(0.1_f32), 1.0]);
        let mut columns = Vec::new();
        glam_029::DMat2::from_cols_array(&[1.0, 2.0, 3.0, 4.0]).lanes(&mut columns);
        assert_eq!(columns, [1.0, 2.0, 3.0, 4.0]);
    }

    /// A domain of this glam's vectors becomes one of the engine's.
    #[test]
    fn a_domain_is_cast() {
        let cast = UnitVector.cast::<glam_029::Vec3>();
        for edge in cast.edges() {
            assert!((edge.length() - 1.0).abs() < 1e-6, "{edge}");
        }
        assert_eq!(cast.edges().len(), UnitVector.edges().len());
    }

    #[test]
    #[should_panic(expected = "a `vec3<f32>` is no `vec2<f32>`")]
    fn a_domain_is_cast_to_its_own_shape() {
        let _ = UnitVector.cast::<glam_029::Vec2>();
    }

    use glam_029::Vec3Swizzles as _;
}
