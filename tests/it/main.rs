//! Integration tests: one binary, one module per subject.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::needless_range_loop,
    reason = "helpers of tests unwrap, say what they measured, and index as the formulas do"
)]

mod angles;
mod at_the_stand;
mod axes;
mod batch;
#[path = "../battery/mod.rs"]
mod battery;
mod certificate;
#[cfg(feature = "cli")]
mod cli;
mod coloured;
mod commands;
mod dense_filter;
mod extremes;
mod full_model;
mod full_search;
mod fuzz;
mod gradient;
mod lanes;
mod levelling;
mod limits;
mod named;
mod near_aligned;
mod observability;
mod obstacles;
mod odd_platforms;
mod own_scheme;
mod physics;
mod precision;
mod reconstruction;
mod reference;
mod replanning;
mod routes;
mod search;
mod simulation;
mod support;
mod weak_priors;
