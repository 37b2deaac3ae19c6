//! The faces of cubes, and the texels beyond the edges of faces.

use std::sync::LazyLock;

/// The face to which a direction points, and the position on the face: two numbers from 0 to 1, from the top left.
/// WebGPU has the same table of faces as Vulkan, "Cube Map Face Selection".
#[inline(always)]
pub(super) fn face([x, y, z]: [f64; 3]) -> (f64, f64, f64) {
    let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
    // If magnitudes are equal, z comes before y, and y before x. The code has no branches, because branch prediction
    // would fail half of the time. It uses only floats, so that one instruction handles several directions.
    let by_z = (az >= ax) & (az >= ay);
    let by_y = !by_z & (ay >= ax);
    let choose = |of_x: f64, of_y: f64, of_z: f64| {
        let other = if by_y { of_y } else { of_x };
        if by_z { of_z } else { other }
    };
    let negative = choose(x, y, z) < 0.0;
    let turned = |x: f64| if negative { -x } else { x };
    let (s, t) = (choose(-turned(z), x, turned(x)), choose(-y, turned(z), -y));
    let major = choose(ax, ay, az);
    let face = choose(0.0, 2.0, 4.0) + if negative { 1.0 } else { 0.0 };
    (face, 0.5 * (s / major + 1.0), 0.5 * (t / major + 1.0))
}

/// Converts a small change of a direction to the change of the position on the face, by Vulkan's *Cube Map Derivative
/// Transformation*.
pub(super) fn step(at: [f64; 3], step: [f64; 3]) -> [f64; 3] {
    let (face, u, v) = face(at);
    let (axis, negative) = (face as usize / 2, face as usize % 2 == 1);
    let [x, y, z] = step;
    let turned = |x: f64| if negative { -x } else { x };
    let (s, t) = [(-turned(z), -y), (x, turned(z)), (turned(x), -y)][axis];
    let (major, change) = (at[axis].abs(), turned(step[axis]));
    // The quotients are 2 u - 1 and 2 v - 1.
    let moved = |own: f64, from: f64| 0.5 * (own - (2.0 * from - 1.0) * change) / major;
    [moved(s, u), moved(t, v), 0.0]
}

/// The direction to a point of a face. The point may be beyond the face's edge.
pub(super) fn direction(face: usize, u: f64, v: f64) -> [f64; 3] {
    let (s, t) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    match face {
        0 => [1.0, -t, -s],
        1 => [-1.0, -t, s],
        2 => [s, 1.0, t],
        3 => [s, -1.0, -t],
        4 => [s, -t, 1.0],
        _ => [-s, -t, -1.0],
    }
}

/// The texels of the neighbouring face that are next to an edge of a face.
#[derive(Clone, Copy, Default)]
struct Edge {
    face: usize,
    /// `true` if the neighbouring texels are a column of the neighbouring face, `false` if they are a row.
    column: bool,
    /// `true` if the neighbouring texels are the last column or row.
    last: bool,
    /// `true` if the texels along the edge have the opposite order.
    reversed: bool,
}

static EDGES: LazyLock<[[Edge; 4]; 6]> = LazyLock::new(|| {
    let edge = |face: usize, edge: usize| {
        // The second texel along each edge of a face with 4 x 4 texels.
        let (x, y) = [(-1, 1), (4, 1), (1, -1), (1, 4)][edge];
        let (face, x, y) = found(face, x, y, 4);
        let column = x == 0 || x == 3;
        let (across, along) = if column { (x, y) } else { (y, x) };
        Edge { face, column, last: across == 3, reversed: along == 2 }
    };
    std::array::from_fn(|face| std::array::from_fn(|number| edge(face, number)))
});

/// Finds the texel of the neighbouring face for a position that is at most one texel beyond an edge of `face`. Returns
/// the texel's face, column and row.
pub(super) fn beyond(face: usize, x: i64, y: i64, size: u32) -> (usize, u32, u32) {
    let last = i64::from(size) - 1;
    let (edge, along) = match () {
        () if x < 0 => (0, y),
        () if x > last => (1, y),
        () if y < 0 => (2, x),
        () => (3, x),
    };
    let Edge { face, column, last: is_last, reversed } = EDGES[face][edge];
    let along = along.clamp(0, last) as u32;
    let along = if reversed { size - 1 - along } else { along };
    let across = if is_last { size - 1 } else { 0 };
    if column { (face, across, along) } else { (face, along, across) }
}

/// Computes the result of `beyond` from the geometry of the cube.
fn found(face_index: usize, x: i64, y: i64, size: u32) -> (usize, u32, u32) {
    let n = f64::from(size);
    // The centre of the texel beyond the edge is half a texel outside of the face. Seen from the cube's centre, the
    // first texels of the neighbour are in the same direction, but slightly nearer to the edge. They are also moved
    // along the edge, by less than half a texel towards the middle. So the code keeps the coordinate along the edge,
    // and uses the direction only to find the face.
    let (u, v) = ((x as f64 + 0.5) / n, (y as f64 + 0.5) / n);
    let clamped = |w: f64| w.clamp(0.5 / n, 1.0 - 0.5 / n);
    let outside_u = !(0.0..=1.0).contains(&u);
    let (edge_u, edge_v) = if outside_u { (u, clamped(v)) } else { (clamped(u), v) };
    // Projects onto the plane of the neighbour: a step along the edge's normal is a step in depth.
    let step = |w: f64| {
        if w < 0.0 {
            (0.0, -w)
        } else if w > 1.0 {
            (1.0, w - 1.0)
        } else {
            (w, 0.0)
        }
    };
    let ((on_u, du), (on_v, dv)) = (step(edge_u), step(edge_v));
    let mut at = direction(face_index, on_u, on_v);
    let depth = 2.0 * du.max(dv);
    let axis = face_index / 2;
    at[axis] -= depth * at[axis].signum();
    // The coordinate beyond the edge is the neighbour's major axis, so there is only one possible face.
    let (face_there, u, v) = face(at);
    let texel = |w: f64| ((w * n).floor().max(0.0) as u32).min(size - 1);
    (face_there as usize, texel(u), texel(v))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `step` agrees with a finite difference: the change of the position between two nearby directions.
    #[test]
    fn a_step_on_a_cube_face_equals_a_finite_difference() {
        let directions = [[0.3, -0.2, 1.5], [0.3, -0.2, -1.5], [2.0, 0.4, 0.1], [-2.0, 0.4, 0.1]];
        let others = [[0.2, 0.7, -0.1], [0.2, -0.7, -0.1]];
        for at in directions.into_iter().chain(others) {
            for by in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.3, -0.5, 0.7]] {
                let [_, u, v] = <[f64; 3]>::from(face(at));
                let moved = [0, 1, 2].map(|k| at[k] + 1e-6 * by[k]);
                let [_, right, down] = <[f64; 3]>::from(face(moved));
                let [du, dv, _] = step(at, by);
                assert!((1e6 * (right - u) - du).abs() < 1e-5, "{at:?} {by:?}");
                assert!((1e6 * (down - v) - dv).abs() < 1e-5, "{at:?} {by:?}");
            }
        }
    }

    #[test]
    fn texels_beyond_a_cube_edge_are_found_as_by_geometry() {
        for size in 1..8 {
            let last = i64::from(size) - 1;
            for face in 0..6 {
                for along in 0..=last {
                    for (x, y) in [(-1, along), (last + 1, along), (along, -1), (along, last + 1)] {
                        let wanted = found(face, x, y, size);
                        assert_eq!(beyond(face, x, y, size), wanted, "{face} {x} {y} of {size}");
                    }
                }
            }
        }
    }
}
