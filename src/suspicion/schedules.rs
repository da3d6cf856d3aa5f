//! The rules for schedules.
//!
//! | values | suspicious when | because |
//! |---|---|---|
//! | angles | all within ±2π, one beyond 0.5, one with three decimals or more | as degrees all positions are nearly the same |
//! | dwells | every dwell and move shorter than `motion.min_dwell_s`, than 60 s, and than ten filter periods | the platform file says that such a dwell is not worth its move; 20 minutes are 1200 s |
//! | dwells | one longer than a day | milliseconds: 600 s are 600 000 |

use super::rules::{TURN_RAD, decimals, largest};
use super::warning::{Suspicion, TimeUnit, Warning};
use crate::config::StudyConfig;
use crate::schedule::Schedule;
use crate::units::RAD_PER_DEG;

/// A schedule whose angles are all smaller than this is taken for what it says.
const NEAR_ZERO: f64 = 0.5;
/// Dwells are taken for seconds from here on, s.
const SHORT_S: f64 = 60.0;
/// And from so many filter periods on.
const FEW_PERIODS: f64 = 10.0;
/// Longest dwell, s.
const DAY_S: f64 = 86_400.0;
/// Dwells up to this are taken for hours, beyond for minutes.
const HOURS: f64 = 3.0;

/// What is hard to believe of a schedule on the platform of `config`.
pub(super) fn schedule(schedule: &Schedule, config: &StudyConfig) -> Vec<Warning> {
    let warning = |value: String, suspicion: Suspicion| Warning {
        key: "positions".to_owned(),
        value,
        suspicion,
    };
    let mut found = Vec::new();
    let positions = schedule.positions();
    let angles: Vec<f64> = positions.iter().flat_map(|p| p.position.to_deg()).collect();
    let extreme = largest(angles.iter().copied());
    let within = extreme.abs() <= TURN_RAD && extreme.abs() >= NEAR_ZERO;
    if within && angles.iter().any(|a| decimals(*a) >= 3) {
        let suspicion = Suspicion::ScheduleInRadians {
            largest: extreme,
            degrees: extreme / RAD_PER_DEG,
        };
        found.push(warning(
            format!("angles up to {}", extreme.abs()),
            suspicion,
        ));
    }
    let times = positions
        .iter()
        .flat_map(|p| [p.dwell_s, p.move_s.unwrap_or(0.0)]);
    let longest_time = largest(times);
    let longest = largest(positions.iter().map(|p| p.dwell_s));
    let platform = &config.platform;
    let short = SHORT_S
        .min(platform.motion.min_dwell_s)
        .min(FEW_PERIODS * platform.filter.period_s);
    let unit = if longest > DAY_S {
        Some(TimeUnit::Milliseconds)
    } else if longest > 0.0 && longest_time < short {
        Some(match longest <= HOURS {
            true => TimeUnit::Hours,
            false => TimeUnit::Minutes,
        })
    } else {
        None
    };
    if let Some(unit) = unit {
        let suspicion = Suspicion::Dwells { longest, unit };
        found.push(warning(format!("dwells up to {longest} s"), suspicion));
    }
    found
}
