//! Tests of `brdf`.
