//! Finds the torquing scheme that calibrates an inertially stabilised platform's gyros best.
//!
//! A platform calibrates its own gyros before use: it is torqued through a sequence of positions
//! (α, β, γ), tracks the local level frame at each, and a Kalman filter estimates the platform
//! misalignment ψ (3) and the drift coefficients of the gyros (12) from the accelerometers. How
//! well each coefficient comes out depends on the torquing scheme. This crate says how well, for
//! any scheme, and finds the best one for a given stand, noise, prior and time.
//!
//! The theory follows Ding, Cai & Huang, *Observable degree analysis of gyroscope error
//! coefficients for inertially stabilized platforms self-calibration*, Journal of National
//! University of Defense Technology 39(1), 2017; "(n)" in these pages is that paper's equation n.
//! Where the paper has misprints, [`drift::expansions`] lists them and tests prove them.
//!
//! # Conventions
//!
//! - **n** is North – Up – East; gravity in it is (0, −1, 0) in units of 1 g ([`attitude`]).
//! - A position is `C_c^n = Mx(α) My(β) Mz(γ)` (19), frame rotations.
//! - Coefficients are in the order D_FX … D_SZ ([`drift::DriftCoefficient`]): constant drift D_F,
//!   and drift per g along the input (D_I), output (D_O) and spin (D_S) axis of each gyro.
//! - Inside, everything is SI; names carry the unit where it is not ([`units`]).
//!
//! # Primer
//!
//! ```
//! use std::sync::atomic::AtomicBool;
//! use scheme_opt::internals::evaluate::{Evaluator, Objective};
//! use scheme_opt::internals::platform::PlatformConfig;
//! use scheme_opt::internals::search::{search, Control, SearchProblem};
//!
//! // The paper's platform, but with a middle gimbal of ±60° and slews at 0.5 °/s.
//! let mut config = PlatformConfig::default();
//! config.gimbals.beta_deg = Some([-60.0, 60.0]);
//! config.motion.slew_rate_deg_per_s = Some(0.5);
//! let evaluator = Evaluator::new(config.check()?, Objective::default());
//!
//! let problem = SearchProblem { total_time_s: 14_400.0, starts: 4, ..Default::default() };
//! let found = search(&evaluator, &problem, &Control::default())?;
//!
//! println!("RMS sigma {:.6} deg/h", found.evaluation.rms_sigma_deg_per_h());
//! assert!(found.evaluation.rms_sigma_deg_per_h() < 0.0015);
//! # Ok::<(), scheme_opt::Error>(())
//! ```
//!
//! # Where things are
//!
//! Layers point one way: [`attitude`], [`units`], [`dynamics`] → [`drift`], [`platform`],
//! [`schedule`], [`motion`] → [`covariance`], [`observability`] → [`criterion`], [`evaluate`] →
//! [`search`], [`certificate`] (what no schedule can beat) → [`commands`] (for the stand),
//! [`results`] and reports (feature `report`), command line (feature `cli`). The model never sees
//! the search, nor the search the certificate, and the library never prints.

// Results have the same bytes on every machine: clippy.toml.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod attitude;
pub mod baseline;
pub mod certificate;
#[cfg(feature = "cli")]
pub mod cli;
pub mod commands;
pub mod compare;
pub mod covariance;
pub mod criterion;
pub mod drift;
pub mod dynamics;
pub mod error;
pub mod evaluate;
pub mod motion;
pub mod observability;
pub mod platform;
pub mod report;
pub mod results;
pub mod schedule;
pub mod search;
pub mod simulate;
pub mod study;
pub mod suspicion;
pub mod units;

pub use error::{Error, Result};
