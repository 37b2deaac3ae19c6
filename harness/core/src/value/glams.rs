//! Support for mint, and for the vectors and matrices of glam versions other than this crate's. Each version is a cargo
//! feature, so projects compile only the versions that they need.

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
