//! A stand-in for a game that uses Bevy. The game's shaders are in `assets/shaders`.
