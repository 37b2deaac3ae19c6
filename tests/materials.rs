//! Tests of `materials`.
