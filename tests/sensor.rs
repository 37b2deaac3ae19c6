//! Tests of `sensor`.
