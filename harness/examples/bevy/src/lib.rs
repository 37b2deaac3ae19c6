//! Stands for a game with Bevy. Its shaders are in `assets/shaders`.
