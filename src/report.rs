//! Reports: pictures of what the other modules compute.

pub mod curves;
pub mod figure;
