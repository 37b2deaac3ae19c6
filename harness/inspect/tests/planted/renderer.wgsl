// A small renderer. Its entry points are correct, and tests plant faults in it.
const PI: f32 = 3.14159265;
struct Camera { view_proj: mat4x4f, model: mat4x4f, eye: vec3f, lod: f32 }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var albedo: texture_2d<f32>;
@group(0) @binding(2) var env: texture_cube<f32>;
@group(0) @binding(3) var samp: sampler;

struct Varying {
    @builtin(position) clip: vec4f,
    @location(0) normal: vec3f,
    @location(1) world: vec3f,
    @location(2) uv: vec2f,
}
@vertex
fn vs_main(@location(0) position: vec3f, @location(1) normal: vec3f, @location(2) uv: vec2f) -> Varying {
    let world = camera.model * vec4f(position, 1.0);
    return Varying(camera.view_proj * world, (camera.model * vec4f(normal, 0.0)).xyz, world.xyz, uv);
}
fn to_srgb(c: vec3f) -> vec3f { return pow(max(c, vec3f(0.0)), vec3f(1.0 / 2.2)); }
fn d_ggx(n_dot_h: f32, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    let d = n_dot_h * n_dot_h * (a2 - 1.0) + 1.0;
    return a2 / (PI * d * d);
}
@fragment
fn fs_main(in: Varying, @builtin(front_facing) front: bool) -> @location(0) vec4f {
    let n = normalize(in.normal) * select(-1.0, 1.0, front);
    let v = normalize(camera.eye - in.world);
    let l = normalize(vec3f(0.3, 0.8, 0.5));
    let h = normalize(v + l);
    let base = textureSample(albedo, samp, in.uv).rgb;
    let light = textureSampleLevel(env, samp, reflect(-v, n), camera.lod).rgb;
    let n_dot_l = max(dot(n, l), 0.0);
    let spec = d_ggx(max(dot(n, h), 0.0), 0.25) / max(4.0 * max(dot(n, v), 0.0) * n_dot_l, 0.001);
    let lit = base * n_dot_l + light * spec;
    return vec4f(to_srgb(lit), 1.0);
}

struct Blur { width: u32, height: u32 }
@group(0) @binding(4) var<uniform> blur: Blur;
@group(0) @binding(5) var<storage, read> source: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> target_: array<vec4f>;
@compute @workgroup_size(8, 8)
fn blur_x(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= blur.width || id.y >= blur.height) { return; }
    var sum = vec4f(0.0);
    for (var k = -2; k <= 2; k++) {
        let x = clamp(i32(id.x) + k, 0, i32(blur.width) - 1);
        sum += source[id.y * blur.width + u32(x)];
    }
    target_[id.y * blur.width + id.x] = sum / 5.0;
}
@group(0) @binding(7) var<storage, read_write> sums: array<u32>;
var<workgroup> tile: array<u32, 64>;
@compute @workgroup_size(64)
fn scan(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) i: u32) {
    tile[i] = sums[min(id.x, arrayLength(&sums) - 1u)];
    workgroupBarrier();
    for (var s = 1u; s < 64u; s <<= 1u) {
        let add = select(0u, tile[i - min(s, i)], i >= s);
        workgroupBarrier();
        tile[i] += add;
        workgroupBarrier();
    }
    if (id.x < arrayLength(&sums)) { sums[id.x] = tile[i]; }
}
