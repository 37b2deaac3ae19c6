struct Stream { state: u32 }

fn pcg(input: u32) -> u32 {
    let state = input * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

fn random(seed: u32) -> f32 {
    return f32(pcg(seed) >> 8u) * 0x1p-24f;
}

fn next(stream: ptr<function, Stream>) -> f32 {
    (*stream).state = pcg((*stream).state);
    return f32((*stream).state >> 8u) * 0x1p-24f;
}
