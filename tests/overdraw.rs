//! What a depth pre-pass does: each pixel is shaded once, and nothing else changes.

use frames::{grid, open_paths};
use karat::prelude::*;
use karat::{Blend, Frame, Image};
use shaders::scene;

const SIZE: (u32, u32) = (240, 180);

/// The spheres one behind the other, the farthest drawn first.
fn oblique(fragment: &str) -> Frame<'static> {
    let aspect = f64::from(SIZE.0) / f64::from(SIZE.1);
    grid("overdraw", fragment, scene::oblique_camera(aspect), SIZE)
}

fn render(frame: &Frame<'_>, path: Path) -> Image {
    frame.render(path).expect("the spheres are drawn")
}

/// How many fragments each pixel keeps.
fn counts(frame: Frame<'_>, path: Path) -> Vec<u32> {
    let image = render(&frame.blend(Blend::Add), path);
    image.pixels().iter().map(|pixel| pixel[0] as u32).collect()
}

#[test]
fn a_pre_pass_shades_each_pixel_once() {
    for path in open_paths() {
        let plain = counts(oblique("counting_fragment"), path);
        let prepass = counts(oblique("counting_fragment").depth_prepass(), path);
        let most = plain.iter().max().expect("the frame has pixels");
        assert!(*most >= 4, "on {path} spheres hide each other, at most {most} times");
        assert!(plain.iter().zip(&prepass).all(|(plain, once)| *once == (*plain).min(1)), "{path}");
        let shaded: u32 = prepass.iter().sum();
        let drawn: u32 = plain.iter().sum();
        assert!(shaded > 4000 && drawn > shaded + shaded / 2, "on {path}: {shaded} of {drawn}");
    }
}

/// Fragments that discard or write their depth are tested late: with a pre-pass that does the
/// same, the image stays the same.
#[test]
fn fragments_that_change_depth_come_out_the_same() {
    for (fragment, depth) in [
        ("cutout_fragment", "cutout_depth_fragment"),
        ("stepped_fragment", "stepped_depth_fragment"),
    ] {
        for path in open_paths() {
            let plain = render(&oblique(fragment), path);
            let prepass = render(&oblique(fragment).depth_prepass().depth_fragment(depth), path);
            assert_eq!(plain.hash(), prepass.hash(), "{fragment} on {path}");
        }
    }
}

/// The fault that the rule prevents: depth from triangles alone covers what the holes show.
#[test]
fn a_pre_pass_without_the_holes_changes_the_image() {
    for path in open_paths() {
        let plain = render(&oblique("cutout_fragment"), path);
        let filled = render(&oblique("cutout_fragment").depth_prepass(), path);
        let differing = plain.pixels().iter().zip(filled.pixels()).filter(|(a, b)| a != b).count();
        assert!(differing > 500, "on {path} {differing} pixels show the fault");
    }
}
