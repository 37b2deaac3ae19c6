//! A game with Bevy would stand here. Its shaders are in `assets/shaders`.
