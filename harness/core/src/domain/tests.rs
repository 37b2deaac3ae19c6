use super::stream::tests::Cases;
use super::*;

fn all<D: Domain>(domain: &D, seed: u64, limit: u64) -> Vec<D::Value> {
    let cases = Cases::new(domain, seed, limit, limit);
    (0..cases.count()).filter_map(|index| cases.get(index)).collect()
}

#[test]
fn finite_domains_are_enumerated_whole() {
    let domain = (Just(1.0_f32), Grid::linear(0.0..=1.0, 3), OneOf(vec![true, false]));
    let cases = all(&domain, 1, 1000);
    assert_eq!(cases.len(), 6);
    assert_eq!(cases[0], (1.0, 0.0, true));
    assert_eq!(cases[5], (1.0, 1.0, false));
}

// Lesson 41
#[test]
fn same_seed_same_cases_and_another_seed_others() {
    let domain = (UnitVector, 0.0..=1.0_f32);
    assert_eq!(all(&domain, 7, 500), all(&domain, 7, 500));
    assert_ne!(all(&domain, 7, 500), all(&domain, 8, 500));
}

// Lesson 41
#[test]
fn ranges_are_closed_and_their_ends_are_drawn() {
    for value in all(&(0.25..=0.75_f32), 3, 20_000) {
        assert!((0.25..=0.75).contains(&value));
    }
    let cases = all(&(0.0..=1.0_f32, -2.0..=2.0_f32), 3, 20_000);
    for corner in [(0.0, -2.0), (1.0, -2.0), (0.0, 2.0), (1.0, 2.0)] {
        assert!(cases[..64].contains(&corner), "{corner:?} is tried first");
        assert!(cases[64..].contains(&corner), "{corner:?} is drawn again among others");
    }
    let near_one = cases.iter().filter(|(a, _)| *a < 1.0 && *a > 1.0 - 1e-5).count();
    assert!(near_one > 100, "only {near_one} of 20,000 lie within 1e-5 of the end");
}

// Lesson 9
#[test]
fn a_filter_that_rejects_everything_draws_nothing() {
    let domain = (0.0..=1.0_f32).filter(|_| false);
    assert!(all(&domain, 1, 10).is_empty());
    let domain = (UnitVector, UnitVector).filter(|(n, v)| n.dot(*v) > 0.0);
    assert!(all(&domain, 1, 1000).iter().all(|(n, v)| n.dot(*v) > 0.0));
}

#[test]
fn grids_hit_both_ends_exactly() {
    let grid = Grid::linear(0.1..=0.7, 7);
    let values = all(&grid, 0, 100);
    assert_eq!((values[0], values[6], values.len()), (0.1, 0.7, 7));
    let grid = Grid::logarithmic(0.1..=10.0, 3);
    assert_eq!(all(&grid, 0, 100), [0.1, 1.0, 10.0]);
    assert_eq!((grid.admits(&10.0), grid.admits(&2.0)), (Some(true), Some(false)));
    assert_eq!(all(&Grid::logarithmic(-8.0..=-1.0, 4), 0, 100), [-8.0, -4.0, -2.0, -1.0]);
    assert!([0.0..=1.0, -1.0..=1.0].map(|r| Grid::logarithmic(r, 9)).iter().all(Domain::is_empty));
}

/// `cast` changes the Rust type of a domain's values, but not their bits.
#[test]
fn a_cast_domain_has_the_same_edges() {
    let (own, cast) = (UnitVector.edges(), UnitVector.cast::<glam::Vec3>().edges());
    assert!(!own.is_empty());
    assert_eq!(own, cast);
}

#[test]
#[should_panic(expected = "the WGSL types differ")]
fn a_cast_keeps_the_shape() {
    let _ = UnitVector.cast::<glam::Vec2>();
}
