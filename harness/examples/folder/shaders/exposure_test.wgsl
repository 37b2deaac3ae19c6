import karat::{expect_near, expect_rel};
import package::exposure::{exposure, luminance};

@test
fn white_has_luminance_one() {
    expect_near(luminance(vec3f(1.0)), 1.0, 1e-6);
}

@test
fn an_exposed_scene_is_middle_grey(@over(0.001, 1000) average: f32) {
    expect_rel(average * exposure(average), 0.18, 1e-5);
}
