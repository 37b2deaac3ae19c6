//! Tests the environment map with a cube map as a fixture.

use std::f64::consts::PI;

use glam::{DVec2, DVec3, Vec2, Vec3};
use karat::Path;
use karat::prelude::*;
use shaders::{PBR, environment};

use crate::drivers::{CUT_OFF, NVIDIA, SWIFTSHADER};
use crate::known_issues::{CORNERS, SEAMS};

/// The relative error of a texel's colour, which is rounded once: to f32, or to 11 bits on paths that filter only half
/// floats, such as GL.
const HALF: Rel = Rel(4.9e-4);

#[test]
fn a_constant_environment_is_constant_everywhere() {
    let color = Vec3::new(0.25, 1.0, 3.5);
    PBR.function("environment::radiance")
        .with("environment", CubeMap::constant(color))
        .with("environment_sampler", Sampler::LINEAR)
        .over(UnitVector)
        .tolerance_on(Path::GL, HALF)
        .agrees_with(move |_: DVec3| color.as_dvec3(), Ulp(2.0));
}

/// Each face has its own colour. If a direction points well inside a face, the shader returns the colour of that face.
#[test]
fn directions_find_the_face_that_webgpu_says() {
    let size = 4;
    let face_color = |face: usize| [face as f32, 1.0 - face as f32, 0.5, 1.0];
    let texels = (0..6).flat_map(|face| vec![face_color(face); 16]).collect();
    let inside = UnitVector.filter(|d: &Vec3| {
        let mut sizes = d.abs().to_array();
        sizes.sort_by(f32::total_cmp);
        sizes[1] < 0.7 * sizes[2] // the filter reaches half a texel, which is a quarter of half a face
    });
    PBR.function("environment::radiance")
        .with("environment", CubeMap::from_texels(size, texels))
        .with("environment_sampler", Sampler::LINEAR)
        .over(inside)
        .tolerance_on(Path::GL, HALF.or(Abs(1e-6)))
        .agrees_with(
            |d: DVec3| {
                let axis = (0..3).max_by(|a, b| d[*a].abs().total_cmp(&d[*b].abs())).unwrap_or(0);
                let face = 2 * axis + usize::from(d[axis] < 0.0);
                DVec3::from_slice(&face_color(face).map(f64::from))
            },
            Ulp(2.0).or(Abs(1e-6)),
        );
}

/// Each texel has its direction as its colour. So the test shows that the cube maps of `karat` and of the library place
/// texels where the hardware looks for them. Bilinear filtering between texel centres has an error of 1.2e-4: 1/8 of
/// (1/32)^2 times a curvature of at most 1. The colours of neighbouring texels differ by at most 1/64, and the filter's
/// weights have 8 bits. So rounding the weights adds an error of 1/512 * 1/64 along each of two axes: 6e-5 together. At
/// a corner of the cube only three texels meet, and the filter uses their mean in place of a fourth texel. Its error is
/// at most 2.3e-3: the mean's weight (at most 1/4) times its distance from the corner (at most a texel, 1/32) times the
/// colour's slope there (at most 0.29). At the edges of faces, wgpu's desktop GL doesn't filter across the edge, but
/// clamps to the nearest texel. So on GL, the colour has an error of half a texel (1/64) times its slope (at most 1/2).
// Lesson 22: a tolerance of one path
#[test]
fn directions_find_their_texel() {
    let size = 64;
    let library = environment::cube_map(size, |d| 0.5 * (d.normalize() + DVec3::ONE));
    let own = CubeMap::from_fn(size, |d| 0.5 * (d + Vec3::ONE));
    for cube_map in [CubeMap::from_texels(size, library), own] {
        PBR.function("environment::radiance")
            .with("environment", cube_map)
            .with("environment_sampler", Sampler::LINEAR)
            .over(UnitVector)
            .tolerance_on(Path::GL, Abs(8e-3))
            .agrees_with(|d: DVec3| 0.5 * (d.normalize() + DVec3::ONE), Abs(2.4e-3));
    }
}

/// A cube map with random texels in 0..=1 on all levels.
fn noise(size: u32) -> CubeMap {
    let mut state = 1_u32;
    let mut texel = || {
        [(); 4].map(|()| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        })
    };
    let levels = (0..=size.ilog2()).map(|level| {
        let side = (size >> level) as usize;
        (0..6 * side * side).map(|_| texel()).collect()
    });
    CubeMap::from_levels(size, levels.collect())
}

/// At the centre of a texel, the filter returns the colour of this texel alone. Rounding the direction moves the
/// sampled point by less than 1/256 of a texel, which is one step of the filter's weights. An error of one whole step
/// would change a colour by up to 1/256, which is far above the tolerance.
#[test]
fn a_texel_is_found_at_its_centre() {
    let size = 8;
    let cube_map = noise(size);
    let centre = |texel: u32| (f64::from(texel) + 0.5) / f64::from(size);
    let directions = (0..6 * size * size)
        .map(|i| {
            let (face, row, column) = (i / (size * size), i / size % size, i % size);
            environment::face_direction(face as usize, centre(column), centre(row)).as_vec3()
        })
        .collect();
    let texels: Vec<_> = cube_map.texels(0).expect("the first level").to_vec();
    PBR.function("environment::radiance")
        .with("environment", cube_map)
        .with("environment_sampler", Sampler::LINEAR)
        .over(OneOf(directions))
        .tolerance_on(Path::GL, HALF.or(Abs(1e-6)))
        .agrees_with(
            |d: DVec3| {
                let point = environment::face_point(d);
                let texel = (point.uv * f64::from(size)).floor();
                let index = (f64::from(point.face * size) + texel.y) * f64::from(size) + texel.x;
                let [r, g, b, _] = texels[index as usize].map(f64::from);
                DVec3::new(r, g, b)
            },
            Abs(1e-6),
        );
}

/// The error of a linear filter with weights of 8 bits: 1/512 along each of two axes and 1/512 between mip levels,
/// because the filtered values differ by at most 1.
const FILTER: Abs = Abs(3.0 / 512.0);

/// The error of the linear filter on drivers that cut off bits of the weights.
const FILTER_CUT_OFF: Abs = Abs(3.0 * CUT_OFF);

/// The error of the linear filter on paths that store texels as half floats, with a rounding error of 2^-12.
const FILTER_OF_HALVES: Abs = Abs(3.0 / 512.0 + 2.5e-4);

fn noisy() -> karat::check::Probe<'static> {
    PBR.function("environment::radiance_level")
        .with("environment", noise(16))
        .with("environment_sampler", Sampler::LINEAR)
}

/// Tests directions for which all texels that the filter reads are on one face, on both mip levels.
#[test]
fn radiance_level_inside_faces() {
    let cube_map = noise(16);
    let domain = (UnitVector, 0.0..=3.0).filter(|(d, level): &(Vec3, f32)| {
        let uv = environment::face_point(d.as_dvec3()).uv;
        // Half a texel of the coarser level, whose faces are 16, 8, 4 or 2 texels wide.
        let margin = 0.5 * f64::from(level.ceil()).exp2() / 16.0;
        (uv - DVec2::splat(0.5)).abs().max_element() <= 0.5 - margin
    });
    noisy()
        .over(domain)
        .tolerance_on(Path::GL, FILTER_OF_HALVES)
        .tolerance_on(NVIDIA, FILTER_CUT_OFF)
        .agrees_with(|d: DVec3, level: f64| cube_map.sample_level(d, level).truncate(), FILTER);
}

/// Tests directions near and on the edges of the cube, and near its corners. Some of the requested levels are below 0
/// or beyond the last mip level. Only wgpu's desktop GL is declared to fail, because it doesn't filter across the edges
/// of faces.
#[test]
fn radiance_level_across_edges() {
    let cube_map = noise(16);
    let near_edges = (UnitVector, 0.0..=1.0_f32, Integers(0..=2_u32)).map(|(d, share, count)| {
        // Sets components to the largest component, which moves some directions onto an edge or a corner.
        let largest = d.abs().max_element();
        let mut moved = d;
        for axis in 0..count as usize {
            moved[axis] = d[axis].signum() * largest * (1.0 - 0.1 * share * share);
        }
        moved
    });
    let corner = |d: &Vec3| d.abs() == Vec3::splat(d.x.abs());
    noisy()
        .over((near_edges.filter(move |d| !corner(d)), -1.0..=6.0))
        .fails_on(Path::GL, SEAMS)
        .tolerance_on(NVIDIA, FILTER_CUT_OFF)
        .agrees_with(|d: DVec3, level: f64| cube_map.sample_level(d, level).truncate(), FILTER);
}

/// Tests the exact directions of the cube's corners, which `radiance_level_across_edges` leaves out.
#[test]
fn radiance_level_at_corners() {
    let cube_map = noise(16);
    let sign = || OneOf(vec![-1.0_f32, 1.0]);
    let corners = (sign(), sign(), sign()).map(|(x, y, z)| Vec3::new(x, y, z));
    noisy()
        .over((corners, -1.0..=6.0))
        .fails_on(Path::GL, SEAMS)
        .fails_on(SWIFTSHADER, CORNERS)
        .tolerance_on(NVIDIA, FILTER_CUT_OFF)
        .agrees_with(|d: DVec3, level: f64| cube_map.sample_level(d, level).truncate(), FILTER);
}

/// Each mip level has its own number as its colour, so the result is the requested level, at most the last level.
#[test]
fn levels_are_interpolated_and_end_at_the_last() {
    let levels = (0..5).map(|level| vec![[level as f32; 4]; 6 << (2 * (4 - level))]).collect();
    PBR.function("environment::radiance_level")
        .with("environment", CubeMap::from_levels(16, levels))
        .with("environment_sampler", Sampler::LINEAR)
        .over((UnitVector, -1.0..=7.0))
        .tolerance_on(NVIDIA, Abs(CUT_OFF))
        // The fraction of a level has 8 bits.
        .agrees_with(|_: DVec3, level: f64| DVec3::splat(level.clamp(0.0, 4.0)), Abs(1.0 / 512.0));
}

/// Points of the unit square, including its border.
fn unit_square() -> impl Domain<Value = Vec2> {
    (0.0..=1.0_f32, 0.0..=1.0_f32).map(|(x, y)| Vec2::new(x, y))
}

/// The function computes products and sums of numbers up to 1, each with one rounding.
// Lesson 10: each direction has its own reference
#[test]
fn face_direction() {
    PBR.function("environment::face_direction")
        .over((Integers(0..=5_u32), unit_square()))
        .agrees_with(
            |face: u32, uv: DVec2| environment::face_direction(face as usize, uv.x, uv.y),
            Abs(1.2e-7),
        );
}

/// The shader of an article (see `shaders/README.md`) defines the cube's faces with coordinates in -1..=1 and y upward.
/// The test shows that the article and WebGPU define the same faces.
// Lesson 10: each direction has its own reference
#[test]
fn the_faces_of_the_article() {
    PBR.function("environment::face_direction")
        .over((Integers(0..=5_u32), unit_square()))
        .agrees_with(
            |face: u32, uv: DVec2| {
                let (x, y) = (2.0 * uv.x - 1.0, 1.0 - 2.0 * uv.y);
                match face {
                    2 => DVec3::new(x, 1.0, -y),
                    3 => DVec3::new(x, -1.0, y),
                    0 => DVec3::new(1.0, y, -x),
                    1 => DVec3::new(-1.0, y, x),
                    5 => DVec3::new(-x, y, -1.0),
                    _ => DVec3::new(x, y, 1.0),
                }
            },
            Abs(1.2e-7),
        );
}

/// The function computes a quotient (2.5 ulp), halves it and adds 0.5.
// Lesson 10: each direction has its own reference
#[test]
fn face_point() {
    PBR.function("environment::face_point")
        .over(UnitVector)
        .agrees_with(environment::face_point, Abs(3e-7));
    // At edges and corners several components are equal, and the face depends on the component that the code prefers.
    let component = || OneOf(vec![-1.0_f32, -0.5, 0.0, 0.5, 1.0]);
    let grid = (component(), component(), component()).map(|(x, y, z)| Vec3::new(x, y, z));
    PBR.function("environment::face_point")
        .over(grid.filter(|d: &Vec3| *d != Vec3::ZERO))
        .agrees_with(environment::face_point, Abs(3e-7));
}

#[test]
fn face_point_inverts_face_direction() {
    PBR.function("environment::face_point").over(UnitVector).satisfies(
        "lies on the ray",
        |d, point: environment::FacePoint| {
            let uv = point.uv.as_dvec2();
            let back = environment::face_direction(point.face as usize, uv.x, uv.y);
            back.normalize().cross(d.as_dvec3()).length() < 1e-6 && back.dot(d.as_dvec3()) > 0.0
        },
    );
}

/// WGSL allows `atan2` an error of 4096 ulp, which is 4.9e-4 of an angle of up to pi. The function divides one angle by
/// 2 pi, so u has an error of 2.5e-4. It divides the other angle by pi, so v has an error of 4.9e-4.
// Lesson 10: each direction has its own reference
#[test]
fn equirectangular_uv() {
    // At the seam, u is 0 on one side and 1 on the other side.
    let domain = UnitVector.filter(|d: &Vec3| d.z > 0.0 || d.x.abs() > 1e-5 * -d.z);
    PBR.function("environment::equirectangular_uv")
        .over(domain)
        .agrees_with(environment::equirectangular_uv, Abs(5e-4));
}

/// Converting a direction to uv and back gives the same direction, also at the poles and at the seam. `atan2` gives
/// each of the two angles an error of up to 4096 ulp.
#[test]
fn equirectangular_uv_finds_every_direction() {
    PBR.function("environment::equirectangular_uv").over(UnitVector).satisfies(
        "is where the direction is",
        |d, uv: Vec2| {
            let back = environment::equirectangular_direction(uv.as_dvec2());
            Vec2::ZERO.cmple(uv).all()
                && Vec2::ONE.cmpge(uv).all()
                && back.distance(d.as_dvec3()) < 2e-3
        },
    );
}

/// In a panorama, each pole is a whole row of texels. The function returns the centre of this row, even if the
/// direction has negative zeros. `atan2(-0, -0)` would give half a turn.
#[test]
fn poles_are_in_the_middle_of_their_row() {
    PBR.function("environment::equirectangular_uv")
        .over(OneOf(vec![Vec3::Y, Vec3::NEG_Y, Vec3::new(-0.0, 1.0, -0.0)]))
        .agrees_with(|d: DVec3| DVec2::new(0.5, 0.5 - 0.5 * d.y), Abs(1e-6));
}

/// WGSL allows sin and cos an error of 2^-11 = 4.9e-4. The product of a sine and a cosine has twice this error.
// Lesson 10: each direction has its own reference
#[test]
fn equirectangular_direction() {
    PBR.function("environment::equirectangular_direction")
        .over(unit_square())
        .agrees_with(environment::equirectangular_direction, Abs(1e-3));
}

/// Arguments of `parallax_box`: the position and the direction of a ray, the centre of the cube map, and two corners of
/// the room.
type Room = (Vec3, Vec3, Vec3, Vec3, Vec3);

/// Rooms that are 0.2 to 20 long along each axis, with `position` and `centre` at any place inside. If `share` is
/// 0.1..=0.9, both points are at least a tenth of the room's length away from the walls.
fn room(share: std::ops::RangeInclusive<f32>) -> impl Domain<Value = Room> {
    let point = move || {
        let share = || share.clone();
        (share(), share(), share()).map(|(x, y, z)| Vec3::new(x, y, z))
    };
    let side =
        || (0.1..=10.0_f32, 0.1..=10.0_f32, 0.1..=10.0_f32).map(|(x, y, z)| Vec3::new(x, y, z));
    (point(), UnitVector, point(), side(), side()).map(|(position, d, centre, below, above)| {
        let inside = |share: Vec3| ((above + below) * share - below).clamp(-below, above);
        (inside(position), d, inside(centre), -below, above)
    })
}

/// The function computes a difference, a quotient (2.5 ulp) and a product, so the length of the ray, up to 35, has a
/// relative error of 5e-7. In addition, two points with coordinates up to 10 are rounded.
#[test]
fn parallax_box() {
    PBR.function("environment::parallax_box")
        .over(room(0.0..=1.0))
        .agrees_with(environment::parallax_box, Abs(2e-5));
}

/// Tests rays to the edges between two walls, where rounding decides which wall a ray hits. The result is continuous
/// there, so a slightly rotated ray must hit nearly the same point. The point moves by the angle of the rotation, times
/// the square of the ray's length (at most 35^2), divided by the distance to the wall (at least 0.11).
#[test]
fn parallax_box_is_continuous() {
    let turn = 1e-5_f32;
    let domain =
        (room(0.1..=0.9), Integers(0..=2_u32)).map(|((position, d, centre, low, high), axis)| {
            let (low, high) = (low.min(Vec3::NEG_ONE), high.max(Vec3::ONE));
            let mut edge = Vec3::select(d.cmpgt(Vec3::ZERO), high, low);
            edge[axis as usize] = position[axis as usize];
            (position, (edge - position).normalize(), centre, low, high)
        });
    PBR.function("environment::parallax_box").over(domain).invariant_under(
        |(p, d, c, low, high)| {
            let turned = (d + turn * Vec3::new(d.y, d.z, -d.x)).normalize();
            (p, turned, c, low, high)
        },
        Abs(0.12),
    );
}

/// If `position` is the centre of the cube map, the function returns a multiple of the direction, with one rounding in
/// each component.
#[test]
fn parallax_vanishes_at_the_centre() {
    let along = |d: DVec3, seen: Vec3| {
        let seen = seen.as_dvec3();
        seen.dot(d) > 0.0 && seen.cross(d).length() <= 2e-7 * seen.length()
    };
    let centred = room(0.0..=1.0)
        .filter(|(_, _, c, low, high): &Room| c.cmpgt(*low).all() && c.cmplt(*high).all())
        .map(|(_, d, c, low, high)| (c, d, c, low, high));
    PBR.function("environment::parallax_box")
        .over(centred)
        .satisfies("is the direction", |(_, d, ..), seen: Vec3| along(d.as_dvec3(), seen));
    PBR.function("environment::parallax_sphere")
        .over((UnitVector, UnitVector, 0.1..=20.0).map(|(c, d, r)| (c, d, c, r)))
        .satisfies("is the direction", |(_, d, ..), seen: Vec3| along(d.as_dvec3(), seen));
}

/// Balls of radius 0.1 to 20 around a point on the unit sphere, with a position inside the ball.
fn ball() -> impl Domain<Value = (Vec3, Vec3, Vec3, f32)> {
    (UnitVector, 0.0..=0.999_f32, UnitVector, UnitVector, 0.1..=20.0_f32).map(
        |(to_position, share, direction, centre, radius)| {
            (centre + share * radius * to_position, direction, centre, radius)
        },
    )
}

/// The position has coordinates up to 21, so its distance from the centre has a rounding error of 1e-6. Near the
/// surface of the ball, the shader's sqrt(b^2 + c) may be as small as sqrt(2e-3) radii, which multiplies the error by
/// 22.
#[test]
fn parallax_sphere() {
    PBR.function("environment::parallax_sphere")
        .over(ball())
        .agrees_with(environment::parallax_sphere, Rel(1e-6).or(Abs(1e-4)));
}

#[test]
fn parallax_sphere_ends_on_the_sphere() {
    PBR.function("environment::parallax_sphere")
        .over(ball())
        .satisfies("is a radius away", |(.., radius), seen: Vec3| {
            (seen.length() / radius - 1.0).abs() < 1e-5
        });
}

/// If a point lies on the sphere and its ray is a tangent of the sphere, both terms under the square root are 0, and
/// the ray ends at the point. The test uses axes and powers of two, so that no operation rounds.
// Lesson 31
#[test]
fn parallax_sphere_touches_the_sphere() {
    let axes = || OneOf(vec![0, 1, 2_usize]).map(|axis| Vec3::AXES[axis]);
    let tangents = (axes(), axes(), OneOf(vec![0.25_f32, 1.0, 4.0]))
        .filter(|(to_position, direction, _): &(Vec3, Vec3, f32)| to_position != direction)
        .map(|(to_position, direction, radius)| {
            (radius * to_position, direction, Vec3::ZERO, radius)
        });
    PBR.function("environment::parallax_sphere")
        .over(tangents)
        .agrees_with(|position: DVec3, _: DVec3, _: DVec3, _: f64| position, Ulp(0.0));
}

/// Tests samples that stand for solid angles between 6e-12 sr and more than the whole sphere. The level is half of a
/// logarithm, and WGSL allows `log2` an error of 3 ulp. For arguments near 1, `log2` has an absolute error of 2^-21.
/// Rounding the argument of `log2` increases this error.
#[test]
fn mip_level() {
    PBR.function("environment::mip_level")
        .over((log_density(), Integers(1..=4096_u32), Integers(1..=8192_u32)))
        .agrees_with(environment::mip_level, Ulp(4.0).or(Abs(1e-6)));
}

/// Densities from 1/1000 of the uniform density, 1 / (4 pi), to the peak of the narrowest lobe.
fn log_density() -> impl Domain<Value = f32> {
    (-7.0..=20.0_f32).map(|log: f32| log.exp() / (4.0 * PI as f32))
}

/// The mip level depends only on the number of samples per steradian. So four times the samples with a quarter of the
/// density give the same level.
#[test]
fn levels_depend_on_samples_per_steradian() {
    PBR.function("environment::mip_level")
        .over((log_density(), Integers(1..=1024_u32), Integers(1..=8192_u32)))
        .invariant_under(|(pdf, samples, size)| (pdf / 4.0, 4 * samples, size), Ulp(0.0));
}

/// A constant environment has the same colour on each mip level.
#[test]
fn a_constant_environment_is_constant_at_every_level() {
    let color = Vec3::new(0.25, 1.0, 3.5);
    PBR.function("environment::radiance_level")
        .with("environment", CubeMap::from_fn(16, move |_| color).with_mips())
        .with("environment_sampler", Sampler::LINEAR)
        .over((UnitVector, 0.0..=5.0))
        .tolerance_on(Path::GL, HALF)
        .agrees_with(move |_: DVec3, _: f64| color.as_dvec3(), Ulp(2.0));
}

/// Fewer samples or a lower density give a higher mip level, except for the rounding of `log2`.
#[test]
fn denser_samples_look_at_finer_levels() {
    let over = || {
        PBR.function("environment::mip_level").over((
            log_density(),
            Integers(1..=4096_u32),
            Integers(1..=8192_u32),
        ))
    };
    let rounding = || Ulp(4.0).or(Abs(1e-6));
    over().is_monotone_in("pdf", Trend::Decreasing, rounding());
    over().is_monotone_in(1, Trend::Decreasing, rounding());
    over().is_monotone_in(2, Trend::Increasing, rounding());
}
