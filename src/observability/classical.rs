//! The methods that the paper argues against, to be laid beside its own.
//!
//! - **Filter covariance** P (the paper's reference 4): what the filter will know.
//! - **Observability matrix** of the piecewise-constant system, built of Lie derivatives, with its
//!   singular values (reference 6): [`PiecewiseConstant`].
//! - **Output sensitivity** (references 3 and 10) and the observability Gramian it belongs to:
//!   [`Gramian`].
//!
//! [`Measure`] names them and the paper's own, one number per coefficient each, larger meaning
//! better observable. `examples/04_methods_compared.rs` tells how far such numbers agree with the
//! accuracy that the filter achieves.

use nalgebra::{Matrix3, SMatrix};

use super::combinations::Combination;
use super::regressor::{Channel, Regressor};
use super::singular::Singular;
use super::{Observability, Order, Spaces, separability};
use crate::covariance::{CovarianceModel, TickRule, split_periods};
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftCoefficient, DriftMatrix};
use crate::error::Result;
use crate::motion::{Leg, Timeline};

/// ψ^n at the start, and D.
pub const STATES: usize = 3 + COEFFICIENTS;
/// A matrix over the states, in arcsec and °/h.
pub type StateMatrix = SMatrix<f64, STATES, STATES>;

/// Output sensitivity and the observability Gramian W = Σ (∂z/∂x)ᵀ (∂z/∂x)/r² of a schedule: x is
/// ψ^n at its start (arcsec) and D (°/h), z the measurements of all filter ticks, r their noise.
/// The random drift of the gyros has no part in it, and other errors than the twelve coefficients have
/// none either.
#[derive(Debug, Clone, PartialEq)]
pub struct Gramian {
    /// W.
    pub matrix: StateMatrix,
}

impl Gramian {
    /// Of `timeline`, by stepping the sensitivities through every filter tick.
    pub fn new(model: &CovarianceModel, timeline: &Timeline) -> Self {
        let mut pass = SensitivityPass {
            model,
            psi: Matrix3::identity(),
            drift: DriftMatrix::zeros(),
            gramian: StateMatrix::zeros(),
        };
        let legs = timeline.legs();
        for (index, leg) in legs.iter().enumerate() {
            if index > 0 {
                pass.arrive(leg, &legs[index - 1]);
            }
            pass.hold(leg, leg.settle_s, false);
            pass.hold(leg, leg.dwell_s, true);
        }
        Self {
            matrix: pass.gramian / model.noise_variance,
        }
    }

    /// Output sensitivity of each coefficient, √W_ii: how much the measurements, in units of
    /// their noise, change with it, (°/h)⁻¹.
    pub fn sensitivity(&self) -> CoefficientVector {
        CoefficientVector::from_fn(|i, _| self.matrix[(3 + i, 3 + i)].sqrt())
    }

    /// 1σ of each coefficient by the Gramian and the prior, √((W + P₀⁻¹)⁻¹)_ii, °/h: what a least
    /// squares fit would reach if the gyros had no random drift. NaN where prior and Gramian differ
    /// so much in size that doubles do not hold their sum.
    pub fn sigma_deg_per_h(&self, model: &CovarianceModel) -> CoefficientVector {
        let prior: [f64; STATES] = std::array::from_fn(|i| match i {
            0..3 => model.prior_psi[(i, i)].sqrt(),
            _ => model.prior_sigma[i - 3],
        });
        let mut scaled = StateMatrix::identity();
        for j in 0..STATES {
            for i in 0..STATES {
                scaled[(i, j)] += self.matrix[(i, j)] * prior[i] * prior[j];
            }
        }
        // Not definite only where something overflowed: the σ are NaN then, and absent in print.
        let inverse = nalgebra::Cholesky::new(scaled).map(|c| c.inverse());
        CoefficientVector::from_fn(|i, _| {
            let variance = inverse.map_or(f64::NAN, |m| m[(3 + i, 3 + i)]);
            prior[3 + i] * variance.sqrt()
        })
    }
}

/// ψ^n as a function of the start, on its way through a schedule.
struct SensitivityPass<'a> {
    model: &'a CovarianceModel,
    /// ∂ψ^n/∂ψ^n(0).
    psi: Matrix3<f64>,
    /// ∂ψ^n/∂D.
    drift: DriftMatrix,
    gramian: StateMatrix,
}

impl SensitivityPass<'_> {
    fn arrive(&mut self, leg: &Leg, previous: &Leg) {
        let Some(arrival) = leg.arrival else { return };
        if self.model.frame_hold {
            let q = leg.attitude.matrix() * previous.attitude.matrix().transpose();
            self.psi = q * self.psi;
            self.drift = q * self.drift;
            return;
        }
        let period = self.model.period_s;
        let (ticks, remainder) = match arrival.measured {
            true => split_periods(arrival.duration_s, period),
            false => (0, arrival.duration_s),
        };
        let dynamics = &self.model.dynamics;
        for tick in 0..ticks {
            let start_s = tick as f64 * period;
            let papers = arrival.drift_integral(&self.model.stand, dynamics, start_s, period);
            let b = self.model.mounting().of_the_papers(papers);
            self.advance(&dynamics.transition(period), &b);
            self.measure();
        }
        if remainder > 0.0 {
            let start_s = ticks as f64 * period;
            let papers = arrival.drift_integral(&self.model.stand, dynamics, start_s, remainder);
            let b = self.model.mounting().of_the_papers(papers);
            self.advance(&dynamics.transition(remainder), &b);
        }
    }

    fn hold(&mut self, leg: &Leg, duration_s: f64, measured: bool) {
        let period = self.model.period_s;
        let (ticks, remainder) = match measured {
            true => split_periods(duration_s, period),
            false => (0, duration_s),
        };
        let a = self.model.drift_matrix(&leg.attitude);
        let dynamics = &self.model.dynamics;
        let (phi, b) = (dynamics.transition(period), dynamics.integral(period) * a);
        for _ in 0..ticks {
            self.advance(&phi, &b);
            self.measure();
        }
        if remainder > 0.0 {
            let b = dynamics.integral(remainder) * a;
            self.advance(&dynamics.transition(remainder), &b);
        }
    }

    fn advance(&mut self, phi: &Matrix3<f64>, b: &DriftMatrix) {
        self.psi = phi * self.psi;
        self.drift = phi * self.drift + b;
    }

    fn measure(&mut self) {
        let variances = self.model.measured_variance();
        for (axis, variance) in variances.into_iter().enumerate() {
            let Some(variance) = variance else { continue };
            let row = SMatrix::<f64, STATES, 1>::from_fn(|j, _| match j {
                0..3 => self.psi[(axis, j)],
                _ => self.drift[(axis, j - 3)],
            });
            // In units of the noise of Z.
            let weight = self.model.noise_variance / variance;
            self.gramian.ger(weight, &row, &row, 1.0);
        }
    }
}

/// The units in which an observability matrix is written down. Its singular values depend on
/// them, and with them the ranking of the states.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Units {
    /// rad, rad/s, s.
    Si,
    /// Arc seconds, °/h, h.
    Hours,
    /// rad, multiples of the Earth rate, and its inverse for the time.
    EarthRate,
}

impl Units {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Si, Self::Hours, Self::EarthRate];

    /// What they are, in a few words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Si => "rad, s",
            Self::Hours => "arcsec, deg/h, h",
            Self::EarthRate => "rad, Earth rate",
        }
    }

    /// The unit of time in s, and the angle that a unit of drift makes in it.
    fn scales(self, earth_rate: f64) -> (f64, f64) {
        match self {
            Self::Si => (1.0, 1.0),
            // 1 °/h is 3600 arcsec in an hour.
            Self::Hours => (3600.0, 3600.0),
            Self::EarthRate => (earth_rate.recip(), 1.0),
        }
    }
}

/// The stripped observability matrix of the piecewise-constant system (Goshen-Meskin &
/// Bar-Itzhack, *Observability analysis of piece-wise constant systems*, IEEE TAES 28(4), 1992).
///
/// In each dwell the system is linear and constant, ẋ = F_j x, z = H x with x = (ψ^n, D), and the
/// Lie derivatives of z are H F_j^k x, k = 0 … 14. Stacked over the dwells they may stand for the
/// total observability matrix because null(Q_j) ⊂ null(F_j): what a dwell does not show does not
/// move (except at the poles). The matrix knows the positions, but neither how long they are held
/// nor in what order, nor any noise.
#[derive(Debug, Clone, PartialEq)]
pub struct PiecewiseConstant {
    /// The units it was written in.
    pub units: Units,
    /// Singular values, largest first.
    pub singular_values: Vec<f64>,
    /// How many of them are not zero, of [`STATES`].
    pub rank: usize,
    /// Degree of each coefficient: the singular value in whose right singular vector it has its
    /// largest part, as the literature assigns them.
    pub degrees: CoefficientVector,
}

impl PiecewiseConstant {
    /// Of the positions of `timeline`, in these units.
    pub fn new(model: &CovarianceModel, timeline: &Timeline, units: Units) -> Self {
        let (time, drift) = units.scales(model.dynamics.rate());
        let f = model.dynamics.system_matrix() * time;
        let mut rows: Vec<[f64; STATES]> = Vec::new();
        for leg in timeline.legs() {
            let a = model.drift_matrix(&leg.attitude) * drift;
            // H F_j^k = [F^k, F^(k−1) A], the North and East rows of both.
            let mut power = Matrix3::identity();
            let mut through = DriftMatrix::zeros();
            for _ in 0..STATES {
                for axis in model.measured_axes() {
                    rows.push(std::array::from_fn(|j| match j {
                        0..3 => power[(axis, j)],
                        _ => through[(axis, j - 3)],
                    }));
                }
                through = power * a;
                power *= f;
            }
        }
        let svd = Singular::of(rows.len(), STATES, |i, j| rows[i][j]);
        let singular_values = &svd.values;
        // Not the tolerance of the orders: in these units the smallest value of a perfect scheme
        // may be that small. As the literature does, only rounding counts as zero.
        let zero = rows.len() as f64 * f64::EPSILON * singular_values[0];
        let rank = singular_values.iter().filter(|s| **s > zero).count();
        let degrees = CoefficientVector::from_fn(|i, _| {
            let part = |k: usize| svd.vector(k, 3 + i).abs();
            (0..STATES)
                .max_by(|a, b| part(*a).total_cmp(&part(*b)))
                .map_or(0.0, |k| singular_values[k])
        });
        Self {
            units,
            singular_values: svd.values,
            rank,
            degrees,
        }
    }
}

/// A measure of how observable each coefficient is; larger is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Measure {
    /// The paper's observable degree: 1/order, 0 where not observable.
    Order,
    /// Separability by all channels, 0 to 1.
    Separability,
    /// 1/σ by the channels of the dwells, each weighted by its noise: the paper's
    /// reconstruction with its noise amplification put in numbers.
    Channels,
    /// 1/σ by the filter's covariance: the accuracy achieved.
    FilterCovariance,
    /// The singular value that belongs to the coefficient, [`PiecewiseConstant`].
    PiecewiseConstant(Units),
    /// Output sensitivity, [`Gramian::sensitivity`].
    OutputSensitivity,
    /// 1/σ by the Gramian's inverse, [`Gramian::sigma_deg_per_h`].
    Gramian,
}

impl Measure {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Order,
        Self::Separability,
        Self::Channels,
        Self::FilterCovariance,
        Self::PiecewiseConstant(Units::Si),
        Self::PiecewiseConstant(Units::Hours),
        Self::PiecewiseConstant(Units::EarthRate),
        Self::OutputSensitivity,
        Self::Gramian,
    ];

    /// What it is, in a few words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Order => "1/order (the paper)",
            Self::Separability => "separability",
            Self::Channels => "channel accuracy",
            Self::FilterCovariance => "filter covariance P",
            Self::PiecewiseConstant(Units::Si) => "PWCS/Lie SVD, rad and s",
            Self::PiecewiseConstant(Units::Hours) => "PWCS/Lie SVD, deg/h and h",
            Self::PiecewiseConstant(Units::EarthRate) => "PWCS/Lie SVD, Earth rate",
            Self::OutputSensitivity => "output sensitivity",
            Self::Gramian => "Gramian inverse",
        }
    }

    /// Its value for each coefficient.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when a decomposition fails.
    pub fn of(self, model: &CovarianceModel, timeline: &Timeline) -> Result<CoefficientVector> {
        match self {
            Self::Order => {
                let orders = orders(model, timeline);
                Ok(CoefficientVector::from_fn(|i, _| {
                    orders[i].map_or(0.0, |o| f64::from(o.number()).recip())
                }))
            }
            Self::Separability => Ok(Observability::analyze(model, timeline)?.separability),
            Self::Channels => {
                let regressor = Regressor::new(model, timeline);
                let rows = regressor.weighted(&Channel::ALL);
                let spaces = Spaces::of(&regressor);
                let separability = separability::of_rows(&rows, &spaces.all, |c| {
                    spaces.order_of(&Combination::single(c)).is_some()
                });
                let length = |j: usize| rows.iter().map(|r| r[j] * r[j]).sum::<f64>().sqrt();
                Ok(CoefficientVector::from_fn(|i, _| {
                    separability[i] * length(i)
                }))
            }
            Self::FilterCovariance => {
                let end = model.end_covariance(timeline, TickRule::Filter)?;
                Ok(end.sigma_deg_per_h().map(f64::recip))
            }
            Self::PiecewiseConstant(units) => {
                Ok(PiecewiseConstant::new(model, timeline, units).degrees)
            }
            Self::OutputSensitivity => Ok(Gramian::new(model, timeline).sensitivity()),
            Self::Gramian => {
                let gramian = Gramian::new(model, timeline);
                Ok(gramian.sigma_deg_per_h(model).map(f64::recip))
            }
        }
    }
}

/// The coefficients' orders and nothing else: the paper's measure at its own cost.
pub fn orders(model: &CovarianceModel, timeline: &Timeline) -> [Option<Order>; COEFFICIENTS] {
    let spaces = Spaces::of(&Regressor::new(model, timeline));
    DriftCoefficient::ALL.map(|c| spaces.order_of(&Combination::single(c)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::{PlatformConfig, Repositioning};
    use crate::schedule::standard::StandardScheme;

    fn case(config: &PlatformConfig) -> (CovarianceModel, Timeline) {
        let platform = config.check().unwrap();
        let schedule = StandardScheme::Icosahedron12
            .schedule(12_000.0, &platform.clone().into())
            .unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
        (CovarianceModel::new(&platform), timeline)
    }

    #[test]
    fn the_gramian_is_the_filters_information_when_the_gyros_have_no_random_drift() {
        for (measured, repositioning) in [
            (false, Repositioning::Slew),
            (true, Repositioning::Slew),
            (false, Repositioning::FrameHold),
        ] {
            let mut config = PlatformConfig::default();
            config.gyro.random_drift_deg_per_h = Some(0.0);
            config.motion.repositioning = repositioning;
            if repositioning == Repositioning::Slew {
                config.motion.slew_rate_deg_per_s = Some(2.0.into());
                config.motion.measure_moves = measured;
                config.motion.settle_s = 20.0;
            }
            let (model, timeline) = case(&config);
            let filter = model
                .end_covariance(&timeline, TickRule::Filter)
                .unwrap()
                .sigma_deg_per_h();
            let gramian = Gramian::new(&model, &timeline).sigma_deg_per_h(&model);
            for c in DriftCoefficient::ALL {
                let ratio = gramian[c.index()] / filter[c.index()];
                assert!((ratio - 1.0).abs() < 1e-6, "{}: {ratio}", c.name());
            }
        }
    }

    #[test]
    fn the_observability_matrix_has_full_rank_when_all_is_observable() {
        let (model, timeline) = case(&PlatformConfig::default());
        for units in Units::ALL {
            let matrix = PiecewiseConstant::new(&model, &timeline, units);
            assert_eq!(
                matrix.rank, STATES,
                "{units:?} {:?}",
                matrix.singular_values
            );
            assert_eq!(matrix.singular_values.len(), STATES);
        }
    }

    #[test]
    fn every_measure_gives_a_number_for_every_coefficient() {
        let (model, timeline) = case(&PlatformConfig::default());
        for measure in Measure::ALL {
            let values = measure.of(&model, &timeline).unwrap();
            assert!(
                values.iter().all(|v| *v > 0.0 && v.is_finite()),
                "{}",
                measure.name()
            );
        }
    }
}
