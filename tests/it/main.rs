//! Integration tests: one binary, one module per subject.
#![allow(clippy::unwrap_used, reason = "a test may fail by panicking")]

#[cfg(feature = "cli")]
mod cli;
mod gradient;
mod physics;
mod reference;
mod search;
mod support;
