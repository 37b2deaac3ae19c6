//! Arguments by what names and types say of them.

use std::collections::BTreeMap;

use crate::domain::{Part as DomainPart, Source};
use crate::probe::Probed;
use crate::value::{Scalar, Shape};

/// What a number of an argument is drawn from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Meaning {
    /// From the first to the second, with both ends.
    Range(f64, f64),
    /// Components of a direction.
    Direction,
    /// A whole number from 1.
    Count,
    /// A whole number from 0 that counts few things, such as levels of a texture.
    Index,
    /// Nothing is known.
    Any,
}

/// Ranges by the names of arguments, as `karat.toml` and the command line declare them.
pub(super) type Declared = BTreeMap<String, (f64, f64)>;

/// Names that mean a direction, for vectors of three components.
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

/// Words of names that mean a number from 0 to 1.
const UNIT: [&str; 44] = [
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
    "sample",
    "t",
    "fraction",
    "ratio",
    "sheen",
    "clearcoat",
    "strength",
    "tint",
    "gray",
];

/// Words of names that mean a whole number from 1, of integers.
const COUNTS: [&str; 16] = [
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
];

/// Words of names that mean a small whole number, of integers: loops to a large one never end.
const INDICES: [&str; 18] = [
    "i",
    "j",
    "k",
    "index",
    "idx",
    "level",
    "mip",
    "lod",
    "face",
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

impl Meaning {
    /// Of an argument or a member, by its name.
    pub(super) fn of(name: &str, shape: &Shape, declared: &Declared) -> Self {
        if let Some((least, most)) = declared.get(name) {
            return Self::Range(*least, *most);
        }
        let name = name.to_lowercase();
        let words: Vec<&str> = name.split('_').filter(|word| !word.is_empty()).collect();
        let has = |list: &[&str]| words.iter().any(|word| list.contains(word));
        let direction = matches!(shape, Shape::Vector { size: 3, scalar: Scalar::F32 });
        let whole = matches!(shape.lanes().first(), Some(Scalar::U32 | Scalar::I32));
        match () {
            () if direction && has(&DIRECTIONS) && !has(&UNIT[..10]) => Self::Direction,
            // `n_dot_l`, `NdotL`, `cos_theta`: of a surface's own side.
            () if name.contains("dot")
                || has(&["cos", "cosine", "mu"])
                || name.starts_with("cos") =>
            {
                Self::Range(0.0, 1.0)
            }
            () if has(&["theta", "phi", "angle", "azimuth", "rotation"]) => {
                Self::Range(-std::f64::consts::PI, std::f64::consts::PI)
            }
            () if whole && has(&COUNTS) => Self::Count,
            () if whole && has(&INDICES) => Self::Index,
            () if has(&UNIT) => Self::Range(0.0, 1.0),
            () => Self::Any,
        }
    }

    fn number(self, edge: Option<usize>, source: &mut Source) -> f64 {
        // Where formulas of a range break: its ends, and what lies close to them.
        const SHARES: [f64; 6] = [0.0, 1.0, 0.5, 1e-3, 0.999, 0.01];
        const NUMBERS: [f64; 6] = [0.0, 1.0, -1.0, 0.5, 2.0, 1e-3];
        match (self, edge) {
            (Self::Range(least, most), Some(edge)) => least + (most - least) * SHARES[edge],
            // Zero is an end of what lies to either side of it.
            (Self::Range(least, most), None)
                if least < 0.0 && most > 0.0 && source.below(4) == 0 =>
            {
                source.log_distance() * if source.below(2) == 0 { least } else { most }
            }
            (Self::Range(least, most), None) => {
                let share = match source.below(8) {
                    // Close to an end as often as not, on every scale.
                    0 => source.log_distance(),
                    1 => 1.0 - source.log_distance(),
                    _ => source.unit(),
                };
                least + (most - least) * share.clamp(0.0, 1.0)
            }
            (_, Some(edge)) => NUMBERS[edge],
            (_, None) => 8.0 * source.unit() - 4.0,
        }
    }
}

/// Values for a parameter of which only the name and the type are known: the parts of a
/// [`Dynamic`](crate::domain::Dynamic) domain.
///
/// ```
/// use karat::domain::Dynamic;
/// use karat::hazards::suggested;
/// use karat::value::{Scalar, Shape};
///
/// let cosine = ("n_dot_l".to_owned(), Shape::Scalar(Scalar::F32));
/// let domain = Dynamic::new(&[cosine.clone()], vec![suggested(&cosine.0, &cosine.1)]);
/// assert_eq!(domain.described(), "n_dot_l from 0 to 1");
/// ```
#[must_use]
pub fn suggested(name: &str, shape: &Shape) -> Vec<DomainPart> {
    let mut all = Vec::new();
    parts(name, shape, &Declared::new(), &mut all);
    all.iter().flat_map(Part::domains).collect()
}

/// Edges of a number, and as many of a direction.
const EDGES: usize = 6;

/// One argument, or a part of one, as it is drawn.
struct Part {
    meaning: Meaning,
    scalars: Vec<Scalar>,
}

fn parts(name: &str, shape: &Shape, declared: &Declared, all: &mut Vec<Part>) {
    if let Some(value) = shape.quad() {
        parts(name, value, declared, all);
        let slope = |scalar: Scalar| Part { meaning: SLOPE, scalars: vec![scalar] };
        return all.extend([0, 1].iter().flat_map(|_| value.lanes()).map(slope));
    }
    match shape {
        Shape::Struct { members, .. } => {
            members.iter().for_each(|(name, member)| parts(name, member, declared, all));
        }
        Shape::Array { element, length } => {
            (0..*length).for_each(|_| parts(name, element, declared, all));
        }
        other => {
            let meaning = Meaning::of(name, other, declared);
            all.push(Part { meaning, scalars: other.lanes() });
        }
    }
}

/// What a number changes from pixel to pixel. Zero is an end of both halves, so it is small as often as
/// not: textures' levels follow the logarithm.
const SLOPE: Meaning = Meaning::Range(-0.5, 0.5);

/// Whether nothing is known of some float.
pub(super) fn are_guessed(probed: &Probed, declared: &Declared) -> bool {
    let mut all = Vec::new();
    for (name, shape) in &probed.function().parameters {
        parts(name, shape, declared, &mut all);
    }
    let float = |part: &Part| part.scalars.iter().any(|scalar| scalar.is_float());
    all.iter().any(|part| part.meaning == Meaning::Any && float(part))
}

/// Rows of arguments, edges first: each meets each other edge, as far as cases reach.
pub(super) fn rows(probed: &Probed, declared: &Declared, cases: usize) -> Vec<u32> {
    let mut all = Vec::new();
    for (name, shape) in &probed.function().parameters {
        parts(name, shape, declared, &mut all);
    }
    // Half of the cases, at most.
    let edges = EDGES.checked_pow(u32::try_from(all.len()).unwrap_or(u32::MAX));
    let edges = edges.unwrap_or(usize::MAX).min(cases / 2);
    let mut rows = Vec::new();
    for case in 0..cases {
        let mut source = Source::new(SEED, case as u64);
        let mut left = case;
        let mut last: Option<[f32; 3]> = None;
        let start = rows.len();
        for part in &all {
            // Of many arguments not all combinations fit: then they are drawn.
            let edge = (case < edges).then_some(match EDGES.checked_pow(all.len() as u32) {
                Some(count) if count <= cases / 2 => left % EDGES,
                _ => source.below(EDGES as u64) as usize,
            });
            left /= EDGES;
            part.draw(edge, &mut last, &mut source, &mut rows);
        }
        if case >= edges && case % ALIKE == 0 {
            make_alike(&all, &mut rows[start..], &mut source);
        }
    }
    rows
}

/// One in so many drawn rows has numbers that are nearly equal: what subtracts them, as variances and
/// gradients do, cancels there alone.
const ALIKE: usize = 16;

/// Replaces each number by one next to the first that means the same.
fn make_alike(all: &[Part], row: &mut [u32], source: &mut Source) {
    let mut first: Vec<(Meaning, f32)> = Vec::new();
    let scalars =
        all.iter().flat_map(|part| part.scalars.iter().map(|scalar| (part.meaning, *scalar)));
    for ((meaning, scalar), word) in scalars.zip(row) {
        if scalar != Scalar::F32 || meaning == Meaning::Direction {
            continue;
        }
        let Some((_, like)) = first.iter().find(|(known, _)| *known == meaning) else {
            first.push((meaning, f32::from_bits(*word)));
            continue;
        };
        // Up to four times 2^-20 away, or the same.
        #[expect(clippy::cast_precision_loss, reason = "a small number")]
        let steps = source.below(9) as f32 - 4.0;
        let near = like * (1.0 + steps / 1_048_576.0);
        let near = match meaning {
            #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
            Meaning::Range(least, most) => near.clamp(least as f32, most as f32),
            _ => near,
        };
        *word = near.to_bits();
    }
}

/// The same rows for each function of one signature, on every machine.
const SEED: u64 = 0x6861_7a61_7264; // "hazard"

impl Part {
    fn domains(&self) -> Vec<DomainPart> {
        if self.meaning == Meaning::Direction {
            return DomainPart::named("unit_vector").into_iter().collect();
        }
        let of = |scalar: &Scalar| {
            let range = match (self.meaning, scalar) {
                (Meaning::Range(least, most), Scalar::F32 | Scalar::F16) => least..=most,
                (Meaning::Count, Scalar::I32 | Scalar::U32) => 1.0..=8.0,
                (Meaning::Index, Scalar::I32 | Scalar::U32) => 0.0..=15.0,
                _ => return DomainPart::plausible(*scalar),
            };
            DomainPart::range(*scalar, range).unwrap_or_else(|| DomainPart::any(*scalar))
        };
        self.scalars.iter().map(of).collect()
    }

    /// `last` is the direction that was drawn before in this row: two are the same, or opposite, more
    /// often than chance has it.
    fn draw(
        &self,
        edge: Option<usize>,
        last: &mut Option<[f32; 3]>,
        source: &mut Source,
        rows: &mut Vec<u32>,
    ) {
        if self.meaning == Meaning::Direction {
            let own = direction(edge, source);
            let drawn = match (*last, source.below(8)) {
                (Some(last), 0) if edge.is_none() => last,
                (Some(last), 1) if edge.is_none() => last.map(|x| -x),
                _ => own,
            };
            *last = Some(drawn);
            return rows.extend(drawn.map(f32::to_bits));
        }
        for scalar in &self.scalars {
            let number = self.meaning.number(edge, source);
            #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
            rows.push(match scalar {
                Scalar::F32 => (number as f32).to_bits(),
                Scalar::F16 => half::f16::from_f64(number).to_f32().to_bits(),
                Scalar::U32 | Scalar::I32 if self.meaning == Meaning::Count => match edge {
                    Some(edge) => [1, 2, 3, 4, 5, 8][edge],
                    None => 1 + source.below(8) as u32,
                },
                Scalar::U32 => match edge {
                    Some(edge) => [0, 1, 2, 3, 7, 15][edge],
                    None => source.below(16) as u32,
                },
                Scalar::I32 => match edge {
                    Some(edge) => [0, 1, 2, 3, -1, 15_i32][edge].cast_unsigned(),
                    None => (source.below(16) as i32 - 4).cast_unsigned(),
                },
                Scalar::Bool => source.bits() & 1,
            });
        }
    }
}

/// A unit vector: along an axis, its opposite, or anywhere.
fn direction(edge: Option<usize>, source: &mut Source) -> [f32; 3] {
    const AXES: [[f32; 3]; EDGES] = [
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.6, 0.0, 0.8],
        [-0.6, 0.0, -0.8],
    ];
    if let Some(edge) = edge {
        return AXES[edge];
    }
    loop {
        let at = [0; 3].map(|_| 2.0 * source.unit() - 1.0);
        let length = at.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (0.1..=1.0).contains(&length) {
            #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
            return at.map(|x| (x / length) as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_what_arguments_mean() {
        let vec3 = Shape::Vector { size: 3, scalar: Scalar::F32 };
        let float = Shape::Scalar(Scalar::F32);
        let none = Declared::new();
        let of = |name: &str, shape: &Shape| Meaning::of(name, shape, &none);
        for name in ["n", "V", "light_direction", "normal", "half_vector"] {
            assert_eq!(of(name, &vec3), Meaning::Direction, "{name}");
        }
        for name in ["base_color", "f0", "albedo"] {
            assert_eq!(of(name, &vec3), Meaning::Range(0.0, 1.0), "{name}");
        }
        for name in ["n_dot_l", "NdotV", "cosTheta", "alpha", "perceptual_roughness", "u"] {
            assert_eq!(of(name, &float), Meaning::Range(0.0, 1.0), "{name}");
        }
        for name in ["x", "n", "distance", "world_position"] {
            assert_eq!(of(name, &float), Meaning::Any, "{name}");
        }
        let declared = Declared::from([("n_dot_l".to_owned(), (-1.0, 1.0))]);
        assert_eq!(Meaning::of("n_dot_l", &float, &declared), Meaning::Range(-1.0, 1.0));
    }
}
