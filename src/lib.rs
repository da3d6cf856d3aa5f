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
//!
//! # Primer
//!
//! Everything is asked of a [`Study`]: a platform and an objective, from a platform file, from TOML
//! text or from a [`StudyConfig`], with every value checked. Each answer holds the JSON document that
//! the command line writes (`.document()`, [`documents`]).
//!
//! ```
//! use scheme_opt::{Control, Study};
//!
//! // The paper's platform, but with a middle gimbal of ±60° and slews at 0.5 °/s.
//! let study = Study::from_toml(
//!     "[gimbals]\n\
//!      beta_deg = [-60, 60]\n\
//!      [motion]\n\
//!      slew_rate_deg_per_s = 0.5\n\
//!      [search]\n\
//!      starts = 4\n",
//! )?;
//! let found = study.search(&Control::default())?;
//! let evaluation = &found.document().evaluation;
//! println!("RMS sigma {:.6} deg/h", evaluation.rms_sigma_deg_per_h);
//! assert!(evaluation.rms_sigma_deg_per_h < 0.0015);
//! println!("{}", found.schedule().to_csv());
//! # Ok::<(), scheme_opt::Error>(())
//! ```
//!
//! # Conventions
//!
//! - **n** is North – Up – East; gravity in it is (0, −1, 0) in units of 1 g.
//! - A [`Position`] is `C_c^n = Mx(α) My(β) Mz(γ)` (19), frame rotations: a positive α turns the
//!   platform about −x. `gimbals.axes` and `[stand]` are for gimbals and bases that are not the
//!   paper's, see `docs/angles.md` of the repository.
//! - Coefficients are in the order D_FX … D_SZ ([`DriftCoefficient`]): constant drift D_F, and drift
//!   per g along the input (D_I), output (D_O) and spin (D_S) axis of each gyro.
//! - Names carry their unit where it is not SI; everything inside is SI.
//!
//! Where things are inside, and where something new goes, is told in `docs/architecture.md` of the
//! repository.

// Results have the same bytes on every machine: clippy.toml.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod analysis;
mod attitude;
mod baseline;
mod certificate;
#[cfg(feature = "cli")]
mod cli;
mod commands;
mod compare;
mod config;
mod covariance;
mod criterion;
mod drift;
mod dynamics;
mod error;
mod evaluate;
#[doc(hidden)]
pub mod internals;
mod mission;
mod model;
mod motion;
mod observability;
mod platform;
mod report;
mod results;
mod schedule;
mod search;
mod sheet;
mod simulate;
mod study;
mod suspicion;
#[cfg(test)]
mod testing;
mod units;
mod wording;

pub mod documents;
pub mod settings;

pub use attitude::Position;
pub use commands::{Command, CommandTable, Segment};
pub use config::StudyConfig;
pub use drift::{DriftCoefficient, DriftKind};
pub use error::{Error, Result};
pub use schedule::standard::StandardScheme;
pub use schedule::{Schedule, ScheduledPosition};
pub use search::{Control, Freedom, Journal, Phase, Progress, StartingScheme, Status};
pub use sheet::{Approach, OperatorSheet, SheetRow, Stop};
pub use simulate::{FilterModel, SimulationOptions, ToldNoise, TruthModel, TruthNoise};
pub use study::{
    AnalysisResult, Batch, BatchControl, BatchPlatform, BatchResult, BoundResult,
    ComparisonOptions, ComparisonResult, Contender, EvaluationResult, SearchResult,
    SimulationRequest, SimulationResult, Study,
};
