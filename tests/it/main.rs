//! Integration tests: one binary, one module per subject.
mod gradient;
mod reference;
mod support;
