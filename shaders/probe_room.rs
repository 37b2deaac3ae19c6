//! Rust counterpart of `probe_room.wgsl`: a room with coloured walls, its probe, and spheres in it.

use glam::{DVec2, DVec3, Vec3};

use crate::camera::Setup;

/// The number of spheres in the room.
pub const SPHERES: u32 = 5;
/// The radius of the spheres.
pub const RADIUS: f64 = 0.3;
/// The albedo of the spheres.
pub const COLOUR: f64 = 0.8;

karat::shareable! {
    /// The room, and the point from which its cube maps are drawn.
    pub struct Room mirrors RoomMirror {
        /// The corner with the least coordinates.
        corner: Vec3,
        /// The corner with the greatest coordinates.
        opposite: Vec3,
        /// The point from which the cube maps are drawn. [`room`] places this point in the middle of the room.
        probe: Vec3,
    }
}

/// Half of the room's size: the room is four wide, two high and four deep, around the origin.
const HALF: DVec3 = DVec3::new(2.0, 1.0, 2.0);

/// Returns the room that the frames show.
#[must_use]
pub fn room() -> Room {
    Room { corner: -HALF.as_vec3(), opposite: HALF.as_vec3(), probe: Vec3::ZERO }
}

/// Returns a camera that stands inside the room at the front wall (+Z), and looks at the back wall.
#[must_use]
pub fn camera_setup() -> Setup {
    Setup {
        position: DVec3::new(0.0, 0.0, 1.9),
        target: DVec3::ZERO,
        // The field of view shows both side walls, the floor and the ceiling.
        field_of_view: 55_f64.to_radians(),
        depth: [0.5, 5.0],
    }
}

/// Returns the centre of one of the five spheres. `instance` is the sphere's number, from 0 to 4.
#[must_use]
pub fn sphere_centre(instance: u32) -> DVec3 {
    DVec3::new(0.8 * (f64::from(instance) - 2.0), -0.35, -0.6)
}

/// Returns the radiance of the wall that `direction` meets from the middle of the room. The left wall is red, the right
/// wall is green, and the ceiling has a lamp.
#[must_use]
pub fn walls(direction: DVec3) -> DVec3 {
    let distances = HALF / direction.abs();
    let point = direction * distances.min_element();
    let grey = DVec3::splat(0.35);
    if distances.x == distances.min_element() {
        if point.x < 0.0 { DVec3::new(0.9, 0.06, 0.05) } else { DVec3::new(0.06, 0.7, 0.08) }
    } else if distances.y == distances.min_element() {
        let floor = DVec3::new(0.25, 0.22, 0.2);
        if point.y < 0.0 { floor } else { grey.lerp(DVec3::splat(3.0), lamp(point)) }
    } else {
        // The front and the back wall are darker towards the floor.
        grey * (0.8 + 0.4 * point.y)
    }
}

/// Returns 1 in a rectangle of the ceiling and 0 around it, with edges 0.1 wide.
fn lamp(point: DVec3) -> f64 {
    let inside = DVec2::new(0.8, 0.5) - DVec2::new(point.x.abs(), point.z.abs());
    let [x, z] = (inside / 0.1).clamp(DVec2::ZERO, DVec2::ONE).to_array();
    x * z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_are_where_they_are_said_to_be() {
        assert!(walls(DVec3::NEG_X).x > 10.0 * walls(DVec3::NEG_X).y);
        assert!(walls(DVec3::X).y > 8.0 * walls(DVec3::X).x);
        assert_eq!(walls(DVec3::Y), DVec3::splat(3.0));
        assert_eq!(walls(DVec3::NEG_Y), DVec3::new(0.25, 0.22, 0.2));
        // The lamp ends 0.8 to the right of the middle, at a height of 1.
        assert_eq!(walls(DVec3::new(0.85, 1.0, 0.0)), DVec3::splat(0.35));
        assert_eq!(walls(DVec3::new(0.65, 1.0, 0.0)), DVec3::splat(3.0));
    }

    #[test]
    fn spheres_hang_inside() {
        for instance in 0..SPHERES {
            let reach = sphere_centre(instance).abs() + DVec3::splat(RADIUS);
            assert!(reach.cmplt(HALF).all());
        }
        assert!(sphere_centre(1).distance(sphere_centre(0)) > 2.0 * RADIUS);
    }
}
