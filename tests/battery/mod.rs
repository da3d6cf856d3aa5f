//! One battery of reference problems for every route to a number: the routes are held to each other
//! on all of them (`tests/it/routes.rs`), and what is timed and searched in `benches` is here.

pub mod full;
pub mod problems;
pub mod reference;
pub mod schedules;
