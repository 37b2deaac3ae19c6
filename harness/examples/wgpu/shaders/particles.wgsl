// Particles in a square box, which throws them back.

override DAMPING: f32 = 0.5; // the part of its speed that a particle keeps

/// A position of a box that reaches from 0 to 1, and a velocity.
struct Particle {
    position: vec2f,
    velocity: vec2f,
}

@group(0) @binding(0) var<storage, read_write> particles: array<Particle>;
@group(0) @binding(1) var<uniform> seconds: f32;

/// A coordinate and its velocity after a time, at most one bounce.
fn moved(place: f32, velocity: f32, time: f32) -> vec2f {
    let free = place + velocity * time;
    let inside = clamp(free, 0.0, 1.0);
    if free == inside {
        return vec2f(free, velocity);
    }
    return vec2f(clamp(inside - DAMPING * (free - inside), 0.0, 1.0), -DAMPING * velocity);
}

@compute @workgroup_size(64)
fn step(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&particles) {
        return;
    }
    let old = particles[id.x];
    let x = moved(old.position.x, old.velocity.x, seconds);
    let y = moved(old.position.y, old.velocity.y, seconds);
    particles[id.x] = Particle(vec2f(x.x, y.x), vec2f(x.y, y.y));
}
