//! Statistical checks: what they find, how surely, and how rarely they are wrong.
