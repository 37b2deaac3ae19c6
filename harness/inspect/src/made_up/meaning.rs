//! Determines the ranges that the names of inputs suggest: `roughness` is from 0 to 1.

use karat_core::domain::Part;
use karat_core::value::{Scalar, Shape};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Meaning {
    /// A number in this range, ends included.
    Range(f64, f64),
    /// A component of a direction.
    Direction,
    /// An integer of at least 1.
    Count,
    /// An integer from 0 to 15, such as a mip level.
    Index,
    /// Any number, because the name suggests nothing.
    Any,
}

/// The largest refractive index: germanium's in the infrared. The smallest refractive index is the vacuum's.
const MOST_REFRACTION: f64 = 4.0;

/// The largest dot product of unit vectors. It may round to one step above 1.
const COSINE: f64 = 1.0 + f32::EPSILON as f64;

/// The letters for vectors in names of cosines, such as `NoV`.
const VECTORS: &[u8] = b"NVLHTB";

/// Words that suggest a direction, in names of vectors with three components.
const DIRECTIONS: [&str; 26] = [
    "n",
    "v",
    "l",
    "h",
    "r",
    "d",
    "w",
    "i",
    "o",
    "wi",
    "wo",
    "wh",
    "wm",
    "normal",
    "view",
    "light",
    "half",
    "halfway",
    "direction",
    "dir",
    "axis",
    "tangent",
    "bitangent",
    "incoming",
    "outgoing",
    "reflected",
];

/// Words that suggest a number from 0 to 1.
const UNIT: [&str; 48] = [
    "alpha",
    "roughness",
    "metallic",
    "metalness",
    "f0",
    "f90",
    "albedo",
    "color",
    "colour",
    "rgb",
    "base",
    "reflectance",
    "specular",
    "diffuse",
    "coverage",
    "opacity",
    "transmittance",
    "occlusion",
    "ao",
    "visibility",
    "weight",
    "blend",
    "factor",
    "mask",
    "intensity",
    "luminance",
    "saturation",
    "u",
    "u1",
    "u2",
    "uv",
    "xi",
    "rand",
    "random",
    "noise",
    "jitter",
    "sample",
    "t",
    "fraction",
    "ratio",
    "sheen",
    "clearcoat",
    "strength",
    "tint",
    "gray",
    "hue",
    "smoothness",
    "gain",
];

/// Words that suggest a size in pixels, which is never 0, in names of floats.
const SIZES: [&str; 3] = ["viewport", "resolution", "dimensions"];

/// Words that suggest a size in pixels if `size` is another word of the name.
const SIZED: [&str; 8] =
    ["view", "screen", "texture", "map", "framebuffer", "window", "image", "frame"];

/// Words in names of projection matrices, which divide by a distance.
const PROJECTIONS: [&str; 6] = ["clip", "projection", "proj", "ndc", "mvp", "vp"];

/// Words in names of matrices that transform points from one space to another. Such matrices have an inverse.
const SPACES: [&str; 14] = [
    "view",
    "model",
    "world",
    "local",
    "object",
    "camera",
    "mesh",
    "transform",
    "pose",
    "rotation",
    "normal",
    "bone",
    "joint",
    "tbn",
];

/// Words that suggest a distance from a centre, which is never negative.
const RADII: [&str; 3] = ["radius", "radii", "thickness"];

const MOST_RADIUS: f64 = 1000.0;

const MOST_PIXELS: f64 = 4096.0;

/// Words that suggest a count of at least 1, in names of integers.
const COUNTS: [&str; 20] = [
    "samples",
    "sample",
    "count",
    "size",
    "steps",
    "step",
    "levels",
    "width",
    "height",
    "length",
    "num",
    "n",
    "resolution",
    "dimensions",
    "rays",
    "bins",
    "groups",
    "workgroups",
    "elements",
    "total",
];

/// Words that suggest an index or a small count, in names of integers. With a large count, a loop would take too long.
const INDICES: [&str; 17] = [
    "i",
    "j",
    "k",
    "index",
    "idx",
    "level",
    "mip",
    "lod",
    "layer",
    "channel",
    "octaves",
    "octave",
    "iterations",
    "iteration",
    "rounds",
    "shift",
    "depth",
];

/// The words of a name in lower case. `world_normal`, `worldNormal` and `WorldNormal` have the same words.
pub(super) fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut before = '_';
    for (at, c) in name.char_indices() {
        let next = name[at + c.len_utf8()..].chars().next();
        // The words of `RGBColor` are `rgb` and `color`.
        let last_capital = before.is_uppercase() && next.is_some_and(char::is_lowercase);
        if c == '_' || c.is_uppercase() && (!before.is_uppercase() || last_capital) {
            words.push(String::new());
        }
        if let (true, Some(word)) = (c != '_', words.last_mut()) {
            word.extend(c.to_lowercase());
        }
        before = c;
    }
    words.retain(|word| !word.is_empty());
    words
}

/// Checks if a matrix has a name such as `world_from_local`. For such a name, Karat generates an invertible matrix, as
/// a host does. All other matrices are unconstrained, so their determinant may be 0.
pub(super) fn is_transform(name: &str) -> bool {
    is_projection(name) || words(name).iter().any(|word| SPACES.contains(&word.as_str()))
}

pub(super) fn is_projection(name: &str) -> bool {
    words(name).iter().any(|word| PROJECTIONS.contains(&word.as_str()))
}

/// Checks if a name contains a word such as `NoV`: the cosine of the angle between two vectors.
fn is_cosine_of_two(name: &str) -> bool {
    name.as_bytes().windows(3).any(|part| match part {
        [from, b'o', to] => VECTORS.contains(from) && VECTORS.contains(to),
        _ => false,
    })
}

/// The builtin value with a pixel's position.
pub(super) const POSITION: &str = "position";

/// The width and height of the generated screen, in pixels.
const PIXELS: f64 = 64.0;

/// The largest generated vertex index and instance index. A shader may keep its vertices in a constant array, which has
/// at least the three vertices of a triangle.
const LAST_VERTEX: f64 = 2.0;

/// The largest generated `global_invocation_id.x`, which is a valid index: generated buffers have 64 elements.
const LAST_INVOCATION: f64 = 63.0;

/// The largest coordinate of an invocation in a workgroup of 8 x 8, the smallest usual size.
const LAST_LOCAL: f64 = 7.0;

/// Checks if WGSL limits a builtin value to a range, such as a position in a workgroup or a subgroup.
pub(super) fn has_range(builtin: &str) -> bool {
    matches!(
        builtin,
        "local_invocation_id"
            | "local_invocation_index"
            | "subgroup_invocation_id"
            | "subgroup_size"
            | "sample_index"
    )
}

impl Meaning {
    /// The range of a component of a builtin value (WGSL, 13.3.1.1); `None` if it may have any value of its type.
    pub(super) fn of_builtin(builtin: &str, lane: usize) -> Option<Self> {
        Some(match (builtin, lane) {
            (POSITION, 0 | 1) => Self::Range(0.5, PIXELS - 0.5),
            (POSITION, 2) => Self::Range(0.0, 1.0),
            // `w` is the interpolated 1/w of points in front of the camera.
            (POSITION, _) => Self::Range(1.0 / PIXELS, 1.0),
            ("vertex_index" | "instance_index", _) => Self::Range(0.0, LAST_VERTEX),
            ("sample_index", _) => Self::Range(0.0, 3.0),
            ("global_invocation_id" | "global_invocation_index", 0) => {
                Self::Range(0.0, LAST_INVOCATION)
            }
            ("local_invocation_id" | "local_invocation_index", 0 | 1) => {
                Self::Range(0.0, LAST_LOCAL)
            }
            ("num_workgroups", _) => Self::Range(1.0, 1.0 + LAST_LOCAL),
            (
                "global_invocation_id" | "workgroup_id" | "workgroup_index" | "local_invocation_id",
                _,
            ) => Self::Range(0.0, 1.0),
            _ => return None,
        })
    }

    /// Returns the range that the name of an argument or a member suggests.
    pub(super) fn of(name: &str, shape: &Shape) -> Self {
        let words = words(name);
        let has = |list: &[&str]| words.iter().any(|word| list.contains(&word.as_str()));
        let direction = matches!(shape, Shape::Vector { size: 3, scalar: Scalar::F32 });
        let whole = matches!(shape.lanes().first(), Some(Scalar::U32 | Scalar::I32));
        let whole_name = name.to_lowercase();
        match () {
            () if direction && has(&DIRECTIONS) && !has(&UNIT[..10]) => Self::Direction,
            // Names such as `n_dot_l`, `NdotL`, `NoL`, `cos_theta`: the direction is on the front side of the surface.
            () if whole_name.contains("dot")
                || is_cosine_of_two(name)
                || has(&["cos", "cosine", "mu"])
                || whole_name.starts_with("cos") =>
            {
                Self::Range(0.0, COSINE)
            }
            () if has(&["theta", "phi", "angle", "azimuth", "rotation"]) => {
                Self::Range(-std::f64::consts::PI, std::f64::consts::PI)
            }
            () if has(&["ior"]) => Self::Range(1.0, MOST_REFRACTION),
            // Light may go into the denser medium, or out of it.
            () if has(&["eta"]) => Self::Range(1.0 / MOST_REFRACTION, MOST_REFRACTION),
            () if !whole && has(&["texel"]) && has(&["size"]) => {
                Self::Range(1.0 / MOST_PIXELS, 1.0)
            }
            () if !whole && (has(&SIZES) || has(&SIZED) && has(&["size"])) => {
                Self::Range(1.0, MOST_PIXELS)
            }
            () if !whole && has(&RADII) => Self::Range(0.0, MOST_RADIUS),
            // The gammas that decode for monitors and encode images.
            () if !whole && has(&["gamma"]) => Self::Range(0.25, 4.0),
            () if whole && has(&COUNTS) => Self::Count,
            // A cube map has six faces.
            () if whole && has(&["face"]) => Self::Range(0.0, 5.0),
            () if whole && has(&INDICES) => Self::Index,
            // An integer named `u` isn't a texture coordinate.
            () if !whole && has(&UNIT) => Self::Range(0.0, 1.0),
            () => Self::Any,
        }
    }

    /// The domain of a scalar; `None` if the range contains no value of its type.
    pub(super) fn part(self, scalar: Scalar) -> Option<Part> {
        match (self, scalar) {
            (Self::Range(least, most), Scalar::F32 | Scalar::F16) => {
                Part::range(scalar, least..=most)
            }
            // The integers between the ends.
            (Self::Range(least, most), Scalar::I32 | Scalar::U32) => {
                let (first, last) = match scalar {
                    Scalar::I32 => (f64::from(i32::MIN), f64::from(i32::MAX)),
                    _ => (0.0, f64::from(u32::MAX)),
                };
                let (least, most) = (least.ceil().max(first), most.floor().min(last));
                (least <= most).then(|| Part::range(scalar, least..=most)).flatten()
            }
            (Self::Range(..), Scalar::Bool) => None,
            (Self::Count, Scalar::I32 | Scalar::U32) => Part::counts(scalar),
            (Self::Index, Scalar::I32 | Scalar::U32) => Part::range(scalar, 0.0..=15.0),
            _ => Some(Part::plausible(scalar)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 148
    #[test]
    fn names_say_what_arguments_mean() {
        let vec3 = Shape::Vector { size: 3, scalar: Scalar::F32 };
        let float = Shape::Scalar(Scalar::F32);
        for name in
            ["n", "V", "light_direction", "normal", "half_vector", "worldNormal", "WorldNormal"]
        {
            assert_eq!(Meaning::of(name, &vec3), Meaning::Direction, "{name}");
        }
        for name in ["base_color", "f0", "albedo", "baseColor", "RGBColor"] {
            assert_eq!(Meaning::of(name, &vec3), Meaning::Range(0.0, 1.0), "{name}");
        }
        for name in ["alpha", "perceptual_roughness", "perceptualRoughness", "u"] {
            assert_eq!(Meaning::of(name, &float), Meaning::Range(0.0, 1.0), "{name}");
        }
        for name in ["n_dot_l", "NdotV", "cosTheta", "NoV", "NoL", "VdotH", "clampedLoH"] {
            assert_eq!(Meaning::of(name, &float), Meaning::Range(0.0, COSINE), "{name}");
        }
        assert_eq!(Meaning::of("ior", &float), Meaning::Range(1.0, 4.0));
        let vec2 = Shape::Vector { size: 2, scalar: Scalar::F32 };
        for name in ["view_size", "viewport", "shadowMapSize"] {
            assert_eq!(Meaning::of(name, &vec2), Meaning::Range(1.0, 4096.0), "{name}");
        }
        assert_eq!(Meaning::of("texel_size", &float), Meaning::Range(1.0 / 4096.0, 1.0));
        assert_eq!(Meaning::of("size", &vec2), Meaning::Any, "a box may have the size 0");
        assert_eq!(Meaning::of("inner_radius", &float), Meaning::Range(0.0, 1000.0));
        assert!(is_projection("clip_from_view") && !is_projection("world_from_view"));
        assert!(
            is_projection("mvp") && is_transform("world_from_view") && is_transform("modelMatrix")
        );
        assert!(!is_transform("m") && !is_transform("covariance"));
        assert_eq!(Meaning::of("eta", &float), Meaning::Range(0.25, 4.0));
        for name in ["x", "n", "distance", "world_position", "Node", "editor"] {
            assert_eq!(Meaning::of(name, &float), Meaning::Any, "{name}");
        }
    }

    /// The guide's page about names contains each word of the lists in this file.
    #[test]
    fn the_guide_lists_each_name() {
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/guide/hazard-names.md");
        let page = std::fs::read_to_string(page).expect("the guide has this page");
        let all = DIRECTIONS.iter().chain(&UNIT).chain(&SIZES).chain(&SIZED).chain(&PROJECTIONS);
        let all = all.chain(&SPACES).chain(&RADII).chain(&COUNTS).chain(&INDICES);
        let missing: Vec<_> = all.filter(|word| !page.contains(&format!("`{word}`"))).collect();
        assert!(missing.is_empty(), "{missing:?}");
    }

    // Lesson 146
    #[test]
    fn a_range_has_the_whole_numbers_between_its_ends() {
        let part = |range: (f64, f64), scalar| Meaning::Range(range.0, range.1).part(scalar);
        let described = |range, scalar| part(range, scalar).map(|part| part.described().to_owned());
        assert_eq!(described((-1.5, 7.9), Scalar::U32).as_deref(), Some("from 0 to 7"));
        assert_eq!(described((-1.5, 7.9), Scalar::I32).as_deref(), Some("from -1 to 7"));
        assert_eq!(described((0.2, 0.8), Scalar::U32), None);
        assert_eq!(described((0.0, 1.0), Scalar::Bool), None);
    }
}
