fn attenuation(distance: f32, radius: f32) -> f32 {
    let ratio = distance / radius;
    //karat: print ratio
    //karat: assert ratio >= 0.0
    return clamp(1.0 - ratio * ratio, 0.0, 1.0);
}
