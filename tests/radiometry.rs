//! Tests of `radiometry`.
