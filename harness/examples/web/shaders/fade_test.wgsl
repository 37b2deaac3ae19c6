import karat::{expect_equal, expect_in_range};
import package::fade::{opacity, over};

@test
fn it_shows_for_two_seconds() {
    expect_equal(opacity(2.0), 1.0);
    expect_equal(opacity(2.5), 0.0);
}

@test
fn it_never_shows_more_than_all(@over(0, 10) age: f32) {
    expect_in_range(opacity(age), 0.0, 1.0);
}

@test
fn nothing_over_a_colour_is_the_colour(@over(0, 1) grey: f32) {
    expect_equal(over(vec4f(0.0), vec3f(grey)).x, grey);
}
