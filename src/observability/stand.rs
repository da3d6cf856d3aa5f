//! What a stand shows of the coefficients at all, whatever the schedule.
//!
//! The entries of A are trigonometric polynomials of degree 2 in each angle (A is linear in C_c^n and
//! in the specific force, each of degree 1). Such a polynomial is zero on an interval only if it is
//! zero everywhere, and five different angles determine it: a gimbal that turns at all spans what
//! five angles around the circle span, one that does not turn what its one angle does. So the space of
//! what can be observed is exact.
//!
//! Of a combination w with A(R) w = 0 at all attitudes R that the stand can take and pass on the way,
//! ψ_y(0) known or not, no measurement depends on it: with W all of them and Λ the prior's information,
//!
//! ```text
//! P_D = (Λ + K)⁻¹ ⪰ W (Wᵀ Λ W)⁻¹ Wᵀ,   K W = 0,
//! ```
//!
//! in any test, whatever else is estimated or not known.

use std::f64::consts::TAU;

use nalgebra::DMatrix;

use super::combinations::Combination;
use super::regressor::UNKNOWNS;
use super::row_space::{RowSpace, unit};
use crate::attitude::{EAST, NORTH, NanoDegrees, Position, UP};
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftMatrix};
use crate::platform::{Platform, Repositioning};
use crate::units::RAD_PER_DEG;

/// What no schedule on a stand can tell.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Unseen {
    /// The combinations.
    pub combinations: Vec<Combination>,
    /// The bound W (Wᵀ Λ W)⁻¹ Wᵀ on P_D, (°/h)².
    pub covariance: DMatrix<f64>,
}

impl Unseen {
    /// By a stand of which this is known before the test, 1σ in °/h; none where everything is seen or
    /// known.
    pub fn new(platform: &Platform, prior_sigma: &CoefficientVector) -> Option<Self> {
        let mut rows = rows_of_stand(platform);
        rows.push(unit(COEFFICIENTS));
        let known = (0..COEFFICIENTS).filter(|&i| prior_sigma[i] == 0.0);
        rows.extend(known.map(unit::<UNKNOWNS>));
        let combinations = RowSpace::of(&rows).missing(UNKNOWNS);
        if combinations.is_empty() {
            return None;
        }
        // Λ^½ W = Q T, so that W (Wᵀ Λ W)⁻¹ Wᵀ = Λ^{-½} Q Qᵀ Λ^{-½}. A known coefficient has no part of W.
        let in_sigma = DMatrix::from_fn(COEFFICIENTS, combinations.len(), |i, k| {
            match prior_sigma[i] > 0.0 {
                true => combinations[k][i] / prior_sigma[i],
                false => 0.0,
            }
        });
        let mut root = in_sigma.qr().q();
        for (mut row, sigma) in root.row_iter_mut().zip(prior_sigma.iter()) {
            row *= *sigma;
        }
        let combinations = combinations.into_iter().map(Combination::from_array);
        Some(Self {
            combinations: combinations.collect(),
            covariance: &root * root.transpose(),
        })
    }
}

/// Rows that span what any schedule on this stand can observe, see the module text.
pub(crate) fn rows_of_stand(platform: &Platform) -> Vec<[f64; UNKNOWNS]> {
    let [alphas, betas, gammas] = [0, 1, 2].map(|axis| angles(platform, axis));
    let azimuth = platform.earth_rate_n()[NORTH] != 0.0;
    let measured = platform.azimuth_noise_rad().is_some();
    let mounting = platform.errors().mounting();
    let mut rows = Vec::new();
    let mut add = |a: &DriftMatrix, channel: usize, weight: f64| {
        rows.push(std::array::from_fn(|j| match j {
            COEFFICIENTS => weight,
            _ => a[(channel, j)],
        }));
    };
    for &alpha in &alphas {
        for &beta in &betas {
            for &gamma in &gammas {
                let at = platform
                    .stand()
                    .attitude(Position::from_rad(alpha, beta, gamma));
                let a = mounting.drift_matrix(&at);
                add(&a, NORTH, 0.0);
                add(&a, EAST, if azimuth { -1.0 } else { 0.0 });
                if azimuth || measured {
                    add(&a, UP, 0.0);
                }
            }
        }
    }
    let frame_hold = platform.motion().repositioning == Repositioning::FrameHold;
    if azimuth && (frame_hold || measured) {
        // In frame-hold repositioning a change of position can show ψ_y by itself.
        rows.push(unit(COEFFICIENTS));
    }
    rows
}

/// Angles of an axis, rad, whose attitudes span what all that it can take span.
fn angles(platform: &Platform, axis: usize) -> Vec<f64> {
    /// So many determine a trigonometric polynomial of degree 2.
    const ENOUGH: usize = 5;
    let gimbals = platform.gimbals();
    let all_around = || {
        (0..ENOUGH)
            .map(|k| TAU * k as f64 / ENOUGH as f64)
            .collect()
    };
    let fixed = |low: f64, high: f64| high <= low;
    let Some(settings) = gimbals.settings_deg(axis) else {
        return match gimbals.ranges[axis] {
            Some(r) if fixed(r.low_rad, r.high_rad) => vec![r.low_rad],
            _ => all_around(),
        };
    };
    let mut turns: Vec<NanoDegrees> = Vec::new();
    for setting in settings.map(|deg| NanoDegrees::nearest(deg).wrapped()) {
        if turns.len() < ENOUGH && !turns.contains(&setting) {
            turns.push(setting);
        }
    }
    let settings: Vec<f64> = turns.iter().map(|turn| turn.deg() * RAD_PER_DEG).collect();
    // A slew passes all angles between its ends.
    match platform.motion().repositioning {
        Repositioning::Slew if settings.len() > 1 => all_around(),
        _ => settings,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drift::drift_matrix;
    use crate::platform::PlatformConfig;

    fn unseen(change: impl FnOnce(&mut PlatformConfig)) -> Option<Unseen> {
        let mut config = PlatformConfig::default();
        change(&mut config);
        let platform = config.check().unwrap();
        let prior = CoefficientVector::from_fn(|i, _| 1.0 + i as f64);
        Unseen::new(&platform, &prior)
    }

    #[test]
    fn a_free_stand_sees_everything() {
        assert_eq!(unseen(|_| {}), None);
        assert_eq!(unseen(|c| c.gimbals.beta_deg = Some([10.0, 11.0])), None);
    }

    /// About one level axis alone gravity never comes along it.
    #[test]
    fn what_is_not_seen_keeps_its_prior() {
        let found = unseen(|c| {
            c.gimbals.beta_deg = Some([0.0, 0.0]);
            c.gimbals.gamma_deg = Some([0.0, 0.0]);
        })
        .unwrap();
        let names: Vec<String> = found.combinations.iter().map(ToString::to_string).collect();
        assert_eq!(names, ["D_IX", "D_OZ", "D_SY"]);
        let p = found.covariance;
        for i in 0..COEFFICIENTS {
            let seen = ![3, 8, 10].contains(&i);
            let expected = if seen { 0.0 } else { (1.0 + i as f64).powi(2) };
            assert!((p[(i, i)] - expected).abs() < 1e-9, "{i}: {}", p[(i, i)]);
        }
    }

    /// At a pole the sum of the D_I, and of each of them what its prior leaves beside the others'.
    #[test]
    fn a_sum_keeps_what_the_priors_say_of_it() {
        let found = unseen(|c| c.site.latitude_deg = 90.0).unwrap();
        let p = found.covariance;
        let information: f64 = [4.0_f64, 5.0, 6.0].iter().map(|s| (s * s).recip()).sum();
        for i in 3..6 {
            for j in 3..6 {
                assert!((p[(i, j)] - information.recip()).abs() < 1e-9);
            }
        }
        assert!((p.trace() - 3.0 / information).abs() < 1e-9);
    }

    /// The space of the stand is that of many attitudes drawn within its ranges.
    #[test]
    fn five_angles_of_an_axis_span_what_all_do() {
        for (alpha, beta, step) in [
            (None, None, None),
            (Some([20.0, 20.0]), None, None),
            (Some([20.0, 60.0]), Some([-30.0, -30.0]), None),
            (Some([0.0, 0.0]), Some([90.0, 90.0]), None),
            (None, Some([0.0, 0.0]), Some(90.0)),
            (Some([0.0, 0.0]), Some([80.0, 100.0]), Some(90.0)),
        ] {
            let mut config = PlatformConfig::default();
            config.gimbals.alpha_deg = alpha;
            config.gimbals.beta_deg = beta;
            config.gimbals.step_deg = step;
            let platform = config.check().unwrap();
            let space = RowSpace::of(&rows_of_stand(&platform));
            let mut rows = Vec::new();
            for k in 0..400 {
                let k = f64::from(k);
                let angles = [alpha, beta, None].map(|range| match range {
                    // With a step, moves pass everything between the settings.
                    Some([low, high]) if step.is_none() => {
                        low + (high - low) * (k * 0.618_034).fract()
                    }
                    Some([low, high]) => 0.5 * (low + high),
                    None => 360.0 * (k * (0.754_878 + 0.01 * k)).fract(),
                });
                let a =
                    drift_matrix(&Position::from_deg(angles[0], angles[1], angles[2]).attitude());
                for (axis, azimuth) in [(NORTH, 0.0), (EAST, -1.0), (UP, 0.0)] {
                    let row: [f64; UNKNOWNS] = std::array::from_fn(|j| match j {
                        COEFFICIENTS => azimuth,
                        _ => a[(axis, j)],
                    });
                    assert!(space.contains(&row), "{alpha:?} {beta:?} {step:?}");
                    rows.push(row);
                }
            }
            let drawn = RowSpace::of(&rows);
            assert_eq!(drawn.rank(), space.rank(), "{alpha:?} {beta:?} {step:?}");
        }
    }
}
