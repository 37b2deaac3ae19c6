//! Tests computations of specular light with mistakes: more light than a white environment has, a wrong direction, or a
//! wrong mip level.

use glam::{DVec3, Vec3};
use karat::check::Failure;
use karat::prelude::*;
use karat::unstable::check::Disagreement;
use shaders::{PBR, specular};

#[track_caller]
fn caught<T>(result: Result<T, Failure>) -> Disagreement {
    match result {
        Ok(_) => panic!("the mistake was not seen"),
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        Err(other) => panic!("the check failed for another reason: {other}"),
    }
}

fn probe(function: &str, cube_map: CubeMap) -> karat::check::Probe<'static> {
    PBR.function(function)
        .with("environment", cube_map)
        .with("environment_sampler", Sampler::LINEAR)
}

fn view(degrees: f32) -> Vec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    Vec3::new(sin, 0.0, cos)
}

#[test]
fn clamped_cosines_exceed_a_furnace() {
    let furnace = || probe("as_written::specular::estimate", CubeMap::constant(Vec3::ONE));
    let case = |alpha: f32, degrees: f32| (Vec3::ONE, alpha, Vec3::Z, view(degrees), 256_u32);
    let domain = || (0.01..=1.0_f32, 89.9..=89.99_f32).map(move |(alpha, d)| case(alpha, d));
    let found = furnace()
        .over(domain())
        .cases(1024)
        .unrecorded()
        .try_satisfies("is at most 1.01", |_, light: Vec3| light.max_element() <= 1.01);
    assert!(caught(found).paths.iter().all(|path| path.census.failures == path.census.cases));
    let found = furnace().over(domain()).cases(1024).unrecorded().try_agrees_with(
        |f0: DVec3, alpha: f64, n: DVec3, v: DVec3, samples: u32| {
            specular::estimate(f0, alpha, n, v, samples, |_| DVec3::ONE)
        },
        Abs(0.2),
    );
    let _ = caught(found);
    // The library's function never exceeds 1 (`a_white_furnace_gives_no_more_than_its_light`).
    for (alpha, degrees, expected) in [
        (0.01, 89.9, 1.25),
        (0.3, 89.9, 1.32),
        (1.0, 89.9, 1.43),
        (0.01, 89.95, 1.47),
        (1.0, 89.95, 1.75),
    ] {
        furnace().over(Just(case(alpha, degrees))).agrees_with(
            |_: DVec3, _: f64, _: DVec3, _: DVec3, _: u32| DVec3::splat(expected),
            Abs(0.01),
        );
    }
}

#[test]
fn a_clamped_cosine_gives_no_mirror_direction() {
    let reflected = || PBR.function("as_written::specular::reflected");
    let mirrored = |v: DVec3, h: DVec3| (2.0 * v.dot(h) * h - v).normalize();
    let facing = |side: f32| {
        (UnitVector, UnitVector).filter(move |(v, h): &(Vec3, Vec3)| side * v.dot(*h) > 2e-3)
    };
    reflected().over(facing(1.0)).agrees_with(mirrored, Abs(1e-6));
    let found = reflected().over(facing(-1.0)).unrecorded().try_agrees_with(mirrored, Abs(1e-3));
    assert!(caught(found).paths.iter().all(|path| path.census.failures == path.census.cases));
    // L is -V plus at most 0.002 H, so L.H = -V.H.
    let found = reflected()
        .over(facing(-1.0))
        .unrecorded()
        .try_satisfies("makes the same angle with H as V", |(v, h), l: Vec3| {
            (l.dot(h) - v.dot(h)).abs() < 1e-3
        });
    let _ = caught(found);
    reflected()
        .over(Just((Vec3::new(0.8, 0.0, -0.6), Vec3::Z)))
        .agrees_with(|_: DVec3, _: DVec3| DVec3::new(-0.8, 0.0, 0.6), Abs(2e-3));
}

/// A cube map in which the colour of each level is the level's number, so an estimate returns the mean of the levels
/// that it reads.
fn numbered(size: u32) -> CubeMap {
    let last = size.ilog2();
    let levels = (0..=last).map(|level| vec![[level as f32; 4]; 6 << (2 * (last - level))]);
    CubeMap::from_levels(size, levels.collect())
}

#[test]
fn a_density_in_world_space_takes_the_last_level() {
    let size = 64;
    let found = |normals: fn(Vec3) -> Vec3| {
        let domain = (0.01..=0.5_f32, UnitVector).map(move |(alpha, d)| {
            let n = normals(d);
            (Vec3::ONE, alpha, n, n, 16_u32, size)
        });
        probe("as_written::specular::filtered_estimate", numbered(size))
            .over(domain)
            .cases(512)
            .unrecorded()
            .try_agrees_with(
                |f0: DVec3, alpha: f64, n: DVec3, v: DVec3, samples: u32, size: u32| {
                    let level = |_, level: f64| DVec3::splat(level.min(6.0));
                    specular::filtered_estimate(f0, alpha, n, v, samples, size, level)
                },
                Abs(0.1),
            )
    };
    let _ = found(|_| Vec3::Z).expect("it is right for upward normals");
    let _ = caught(found(|d| d));
    // Each sample reads level 6. The right mean is level 3.3.
    probe("as_written::specular::filtered_estimate", numbered(size))
        .over(Just((Vec3::ONE, 0.1_f32, Vec3::X, Vec3::X, 16_u32, size)))
        .agrees_with(
            |f0: DVec3, alpha: f64, n: DVec3, v: DVec3, samples: u32, _: u32| {
                6.0 * specular::estimate(f0, alpha, n, v, samples, |_| DVec3::ONE)
            },
            Abs(0.05),
        );
    let right = specular::filtered_estimate(
        DVec3::ONE,
        f64::from(0.1_f32),
        DVec3::X,
        DVec3::X,
        16,
        size,
        |_, level| DVec3::splat(level.min(6.0)),
    );
    assert!((right.x - 3.3).abs() < 0.05, "{right}");
}
