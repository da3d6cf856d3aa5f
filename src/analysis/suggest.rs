//! What to add to a schedule, and the position that separates its worst combination best.
//!
//! The target is what the schedule leaves unobservable or, where it observes everything, the
//! combination that it knows worst among those a position can help: D_IX + D_IY + D_IZ gives the
//! same ε^n everywhere (paper, Conclusion 2), so no position separates it and it is set aside.
//!
//! With P the covariance of (D, ω_N ψ_y(0)) by prior and channels, a position with weighted rows R
//! leaves P' = P − P Rᵀ (I + R P Rᵀ)⁻¹ R P. Its gain is the information on the target U,
//! ½ ln det(Uᵀ P U) − ½ ln det(Uᵀ P' U), which is maximised over all attitudes that the gimbals
//! allow: a grid over (α, β, γ), then a pattern search from its best points. For one combination
//! that is the least variance; for several, unlike their mean variance, it does not stop caring
//! once a combination is seen at all. The position found is judged by the full filter,
//! [`Evaluator::evaluate`].

use nalgebra::{DMatrix, SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::attitude::{Attitude, Degrees, EAST, NORTH, NanoDegrees, Position, Stand, UP, decimal};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector};
use crate::error::{Error, Result};
use crate::evaluate::{Evaluation, Evaluator};
use crate::model::Mounting;
use crate::motion::Timeline;
use crate::observability::Observability;
use crate::observability::combinations::Combination;
use crate::observability::regressor::{Change, Channel, Regressor, UNKNOWNS};
use crate::observability::row_space::counts;
use crate::platform::{Platform, multiples};
use crate::schedule::{Schedule, ScheduledPosition};
use crate::units::round_deg;

type Unknowns = SVector<f64, UNKNOWNS>;
type UnknownsMatrix = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// How a schedule stands.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(rename = "StandingRecord"))]
#[non_exhaustive]
pub struct Standing {
    /// Duration of the test, s.
    pub total_time_s: f64,
    /// Value of the criterion, °/h (max-ratio: 1).
    pub criterion: f64,
    /// √(mean of the coefficient variances), °/h.
    pub rms_sigma_deg_per_h: f64,
    /// RMS σ of the target combinations, of length one each, °/h.
    pub target_sigma_deg_per_h: f64,
    /// Smallest separability of a coefficient.
    pub least_separability: f64,
    /// Rank of all channels.
    pub rank: usize,
    /// Rank of the channels of order 1 and below.
    pub rank_first_order: usize,
}

/// The position to add.
#[derive(Debug, Clone, PartialEq)]
pub struct Suggestion {
    /// What it is to separate, by name.
    pub target: Vec<Combination>,
    /// Whether the target is unobservable so far.
    pub target_unobservable: bool,
    /// The position.
    pub position: Position,
    /// How long to hold it: the mean dwell of the schedule, s.
    pub dwell_s: f64,
    /// The schedule with the position at its end.
    pub schedule: Schedule,
    /// The schedule as it is.
    pub before: Standing,
    /// With the position added.
    pub after: Standing,
    /// As it is, its dwells stretched to the same total time: what the time alone would do.
    pub same_time: Standing,
    /// How many attitudes were examined.
    pub examined: usize,
}

/// Why there is no position to suggest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum NoSuggestion {
    /// The platform can take no attitude at all on its table and in its ranges.
    NoAttitude,
    /// The platform cannot execute a longer schedule, or one more position.
    NotExecutable,
    /// A longer schedule cannot be evaluated to the accuracy that evaluations have.
    NotEvaluated,
}

impl NoSuggestion {
    pub(super) fn because(error: Error) -> Self {
        match error.is_input() {
            true => Self::NotExecutable,
            false => Self::NotEvaluated,
        }
    }
}

impl std::fmt::Display for NoSuggestion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::NoAttitude => "the gimbals allow no attitude on the table",
            Self::NotExecutable => "the platform can execute no longer schedule",
            Self::NotEvaluated => {
                "one position more cannot be evaluated: the numbers differ too much in size"
            }
        })
    }
}

impl Suggestion {
    /// The position that separates the worst combination of `schedule` best.
    ///
    /// # Errors
    ///
    /// [`NoSuggestion`]: why there is none.
    pub fn find(
        evaluator: &Evaluator,
        schedule: &Schedule,
        evaluation: &Evaluation,
    ) -> std::result::Result<Self, NoSuggestion> {
        let platform = evaluator.test().platform();
        let timeline = Timeline::new(evaluator.test(), schedule).map_err(NoSuggestion::because)?;
        let dwell_s = new_dwell_s(platform, schedule);
        let prospect = Prospect::new(evaluator, &timeline, evaluation, dwell_s)
            .map_err(NoSuggestion::because)?;
        let (position, examined) =
            best_position(platform, |p| prospect.gain(p)).ok_or(NoSuggestion::NoAttitude)?;
        let mut positions = schedule.positions().to_vec();
        positions.push(ScheduledPosition::new(position, dwell_s));
        let (extended, after) = evaluated(evaluator, Schedule::new(positions))?;
        let same_time = stretched(schedule, after.total_time_s - evaluation.overhead_s);
        let (_, same_time) = evaluated(evaluator, same_time)?;
        let standing = |e: &Evaluation| prospect.standing(e);
        Ok(Self {
            target: prospect.target_names(),
            target_unobservable: prospect.unobservable,
            position,
            dwell_s,
            schedule: extended,
            before: standing(evaluation),
            after: standing(&after),
            same_time: standing(&same_time),
            examined,
        })
    }
}

/// A schedule with its evaluation.
fn evaluated(
    evaluator: &Evaluator,
    schedule: Result<Schedule>,
) -> std::result::Result<(Schedule, Evaluation), NoSuggestion> {
    schedule
        .and_then(|s| evaluator.evaluate(&s).map(|e| (s, e)))
        .map_err(NoSuggestion::because)
}

/// The mean dwell, but no less than tells the second derivative.
pub(super) fn new_dwell_s(platform: &Platform, schedule: &Schedule) -> f64 {
    let held = schedule.positions().iter().filter(|p| p.dwell_s > 0.0);
    let mean = schedule.dwell_sum_s() / held.count().max(1) as f64;
    // Whole filter periods: the rest of a dwell is not measured.
    let periods = (mean / platform.period_s()).round().max(3.0);
    periods * platform.period_s()
}

/// `schedule` with its dwells stretched to `dwell_sum_s` in all.
pub(super) fn stretched(schedule: &Schedule, dwell_sum_s: f64) -> Result<Schedule> {
    let sum = schedule.dwell_sum_s();
    let factor = if sum > 0.0 { dwell_sum_s / sum } else { 1.0 };
    let positions = schedule.positions().iter().map(|p| ScheduledPosition {
        dwell_s: p.dwell_s * factor,
        ..*p
    });
    Schedule::new(positions.collect())
}

/// The schedule as one more position would find it.
struct Prospect {
    /// Covariance of (D, ω_N ψ_y(0)) by prior and channels, (°/h)².
    covariance: UnknownsMatrix,
    /// Uᵀ P U.
    target_covariance: DMatrix<f64>,
    /// P u for each target combination.
    pulled: Vec<Unknowns>,
    /// The target combinations, of length one and at right angles.
    target: Vec<Unknowns>,
    /// The same as a person would name them.
    names: Vec<Combination>,
    unobservable: bool,
    /// 1/σ of the channels of the new dwell, in n.
    weights: [f64; 3],
    azimuth_unknown: bool,
    mounting: Mounting,
    stand: Stand,
    /// In frame-hold: the attitude before, the share of ψ_y(0) in ψ_y there, and 1/σ.
    held: Option<(Attitude, f64, f64)>,
}

impl Prospect {
    fn new(
        evaluator: &Evaluator,
        timeline: &Timeline,
        evaluation: &Evaluation,
        dwell_s: f64,
    ) -> Result<Self> {
        let observability = &evaluation.observability;
        let model = evaluator.model();
        let regressor = Regressor::new(model, timeline);
        let covariance = covariance(evaluator, &regressor)?;
        let trace = Unknowns::from(*Combination::input_trace().as_array()).normalize();
        let (names, mut target) = unobservable_target(observability, &trace);
        let unobservable = !target.is_empty();
        let names = if unobservable {
            names
        } else {
            target.push(worst(&covariance, &trace, &evaluation.end.coefficients));
            vec![
                Combination::from_array(target[0].into())
                    .rounded(crate::observability::weak::NAMED),
            ]
        };
        let held = model.frame_hold.then(|| {
            let legs = timeline.position_legs();
            let last = &legs[legs.len() - 1];
            let share = regressor.changes.last().map_or(1.0, |c| c.share * c.cosine);
            let weight = (model.omega_north() * (2.0 * model.noise_variance).sqrt()).recip();
            (last.attitude, share, weight)
        });
        let pulled: Vec<Unknowns> = target.iter().map(|u| covariance * u).collect();
        Ok(Self {
            target_covariance: DMatrix::from_fn(target.len(), target.len(), |i, j| {
                target[i].dot(&pulled[j])
            }),
            pulled,
            covariance,
            target,
            names,
            unobservable,
            weights: crate::observability::regressor::dwell_weights(model, dwell_s),
            azimuth_unknown: regressor.azimuth_unknown,
            mounting: regressor.mounting,
            stand: regressor.stand,
            held: held.filter(|_| regressor.azimuth_unknown),
        })
    }

    fn target_names(&self) -> Vec<Combination> {
        self.names.clone()
    }

    /// The weighted rows that a dwell at `position` adds.
    fn rows(&self, position: Position) -> [Unknowns; 4] {
        let attitude = self.stand.attitude(position);
        let a = self.mounting.drift_matrix(&attitude);
        let mut rows = [Unknowns::zeros(); 4];
        for (row, axis) in rows.iter_mut().zip([NORTH, EAST, UP]) {
            for j in 0..COEFFICIENTS {
                row[j] = a[(axis, j)] * self.weights[axis];
            }
        }
        if self.azimuth_unknown {
            let mut azimuth = -1.0;
            if let Some((before, share, weight)) = self.held {
                let cosine = before.gravity_c().dot(&attitude.gravity_c());
                let change = Change {
                    leg: 0,
                    cosine,
                    share,
                    weight,
                };
                azimuth = -share * cosine;
                rows[3][COEFFICIENTS] = change.coefficient() * weight;
            }
            rows[1][COEFFICIENTS] = azimuth * self.weights[EAST];
        }
        rows
    }

    /// The information that a dwell at `position` adds on the target.
    fn gain(&self, position: Position) -> f64 {
        let rows = self.rows(position);
        let through = rows.map(|r| self.covariance * r);
        let s = SMatrix::<f64, 4, 4>::from_fn(|i, j| {
            rows[i].dot(&through[j]) + if i == j { 1.0 } else { 0.0 }
        });
        // I + … is definite unless something overflowed: a position of which nothing can be said is
        // not suggested.
        let Some(cholesky) = nalgebra::Cholesky::new(s) else {
            return 0.0;
        };
        let seen: Vec<SVector<f64, 4>> = self
            .pulled
            .iter()
            .map(|pulled| SVector::from_fn(|i, _| rows[i].dot(pulled)))
            .collect();
        let solved: Vec<_> = seen.iter().map(|v| cholesky.solve(v)).collect();
        let left = DMatrix::from_fn(seen.len(), seen.len(), |i, j| {
            self.target_covariance[(i, j)] - seen[i].dot(&solved[j])
        });
        half_log_det(&self.target_covariance) - half_log_det(&left)
    }

    fn standing(&self, evaluation: &Evaluation) -> Standing {
        let p = &evaluation.end.coefficients;
        let variance: f64 = self
            .target
            .iter()
            .map(|u| {
                let u = CoefficientVector::from_fn(|i, _| u[i]);
                u.dot(&(p * u))
            })
            .sum();
        Standing {
            total_time_s: evaluation.total_time_s,
            criterion: evaluation.score.criterion,
            rms_sigma_deg_per_h: evaluation.rms_sigma_deg_per_h(),
            target_sigma_deg_per_h: (variance / self.target.len() as f64).sqrt(),
            least_separability: evaluation.score.least_separability,
            rank: evaluation.observability.rank,
            rank_first_order: evaluation.observability.rank_first_order,
        }
    }
}

/// ½ ln det of a covariance; infinite where rounding leaves nothing of it.
fn half_log_det(covariance: &DMatrix<f64>) -> f64 {
    nalgebra::Cholesky::new(covariance.clone()).map_or(f64::INFINITY, |c| {
        c.l_dirty().diagonal().iter().map(|v| libm::log(*v)).sum()
    })
}

/// Covariance of (D, ω_N ψ_y(0)) by prior and channels: S (I + S RᵀR S)⁻¹ S, S the prior σ.
fn covariance(evaluator: &Evaluator, regressor: &Regressor) -> Result<UnknownsMatrix> {
    let model = evaluator.model();
    let prior = Unknowns::from_fn(|i, _| match i {
        COEFFICIENTS => model.omega_north() * model.prior_psi[(UP, UP)].sqrt(),
        _ => model.prior_sigma[i],
    });
    let mut information = UnknownsMatrix::identity();
    for row in regressor.weighted(&Channel::ALL) {
        let row = Unknowns::from(row).component_mul(&prior);
        information.ger(1.0, &row, &row, 1.0);
    }
    let cholesky = nalgebra::Cholesky::new(information)
        .ok_or_else(|| Error::numerical("the information of the schedule overflows"))?;
    let scale = UnknownsMatrix::from_diagonal(&prior);
    Ok(scale * cholesky.inverse() * scale)
}

/// The unobservable combinations that a position can help, and an orthonormal basis of them.
fn unobservable_target(
    observability: &Observability,
    trace: &Unknowns,
) -> (Vec<Combination>, Vec<Unknowns>) {
    let mut names = Vec::new();
    let mut basis: Vec<Unknowns> = Vec::new();
    for combination in &observability.unobservable {
        let vector = Unknowns::from(*combination.as_array());
        let mut rest = vector - trace * trace.dot(&vector);
        for b in &basis {
            rest -= b * b.dot(&rest);
        }
        if counts(rest.norm(), vector.norm()) {
            basis.push(rest.normalize());
            names.push(*combination);
        }
    }
    (names, basis)
}

/// The combination of coefficients known worst, at right angles to the trace.
fn worst(covariance: &UnknownsMatrix, trace: &Unknowns, by_filter: &CoefficientMatrix) -> Unknowns {
    /// Relative distance of variances that are the same but for rounding.
    const ALIKE: f64 = 1e-6;
    let mut p = *covariance;
    for i in 0..UNKNOWNS {
        p[(i, COEFFICIENTS)] = 0.0;
        p[(COEFFICIENTS, i)] = 0.0;
    }
    let without = UnknownsMatrix::identity() - trace * trace.transpose();
    let eigen = (without * p * without).symmetric_eigen();
    let largest = eigen.eigenvalues.max();
    let alike: Vec<Unknowns> = (0..UNKNOWNS)
        .filter(|&k| largest - eigen.eigenvalues[k] <= ALIKE * largest.abs())
        .map(|k| eigen.eigenvectors.column(k).into_owned())
        .collect();
    // Of schemes with symmetries the dwells tell several combinations equally ill; what rounding makes
    // of them is none to show. The filter, which knows the order of the positions, tells them apart.
    let of = |u: &Unknowns| CoefficientVector::from_fn(|i, _| u[i]);
    let variances = DMatrix::from_fn(alike.len(), alike.len(), |a, b| {
        of(&alike[a]).dot(&(by_filter * of(&alike[b])))
    });
    let eigen = variances.symmetric_eigen();
    let shares = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let parts = alike.iter().zip(shares.iter());
    parts.fold(Unknowns::zeros(), |sum, (u, share)| sum + u * *share)
}

/// Distance of grid points, degrees.
const GRID_DEG: f64 = 15.0;
/// Grid points from which a pattern search starts.
const REFINED: usize = 16;
/// Most explorations from one start: a ridge may be followed for long at little gain.
const MOST_EXPLORATIONS: usize = 400;
/// Smallest step, degrees; also what a free position is rounded to.
const FINEST_DEG: f64 = 1e-3;

/// One gimbal axis: where it may stand, in whole numbers of `unit_deg`.
pub(super) struct GimbalAxis {
    unit_deg: f64,
    low: i64,
    high: i64,
    /// Whether it turns without end.
    endless: bool,
}

impl GimbalAxis {
    pub(super) fn new(platform: &Platform, axis: usize) -> Self {
        let unit_deg = platform.gimbals().step_deg().unwrap_or(FINEST_DEG);
        let range = platform.gimbals().ranges[axis];
        // Every attitude has a triple with β in ±90°.
        let half_deg = if axis == 1 { 90.0 } else { 180.0 };
        let [low, high] = range.map_or([-half_deg, half_deg], |r| {
            let (low, high) = r.ends().into_inner();
            let [low, high] = [low, high].map(NanoDegrees::deg);
            // One turn is enough, and the one nearest zero is the natural one.
            if high - low > 360.0 {
                let centre = 0.0_f64.clamp(low + 180.0, high - 180.0);
                [centre - 180.0, centre + 180.0]
            } else {
                [low, high]
            }
        });
        let [low, high] = [low, high].map(NanoDegrees::nearest);
        let within = multiples(unit_deg, low..=high);
        Self {
            unit_deg,
            low: i64::from(within.start),
            high: i64::from(within.end) - 1,
            endless: range.is_none(),
        }
    }

    /// Where it may stand, so far apart.
    pub(super) fn grid(&self, apart_deg: f64) -> Vec<i64> {
        let stride = self.steps(apart_deg) as usize;
        (self.low..=self.high).step_by(stride).collect()
    }

    /// Where it stands at an angle, if it can.
    pub(super) fn setting(&self, deg: f64) -> Option<i64> {
        let at = (deg / self.unit_deg).round() as i64;
        let is_there = decimal(at as f64 * self.unit_deg) == deg;
        (is_there && (self.low..=self.high).contains(&at)).then_some(at)
    }

    /// An angle in whole steps, at least one.
    pub(super) fn steps(&self, deg: f64) -> i64 {
        (deg / self.unit_deg).round().max(1.0) as i64
    }

    /// The angle, degrees.
    fn deg(&self, at: i64) -> f64 {
        decimal(at as f64 * self.unit_deg)
    }

    /// The angle, degrees, on an endless axis within a half turn where the index table allows.
    pub(super) fn tidy(&self, at: i64) -> f64 {
        let steps = (360.0 / self.unit_deg).round();
        let turn = NanoDegrees::nearest(steps * self.unit_deg);
        match self.endless && turn == NanoDegrees::TURN {
            true => Degrees::new(self.deg(at)).wrapped().deg(),
            false => self.deg(at),
        }
    }

    /// One step further, if the axis can go there.
    pub(super) fn moved(&self, at: i64, by: i64) -> Option<i64> {
        let to = at + by;
        (self.endless || (self.low..=self.high).contains(&to)).then_some(to)
    }
}

/// The attitude of largest gain that the gimbals allow, and how many were looked at.
fn best_position(platform: &Platform, gain: impl Fn(Position) -> f64) -> Option<(Position, usize)> {
    let axes: [GimbalAxis; 3] = std::array::from_fn(|i| GimbalAxis::new(platform, i));
    let position = |at: [i64; 3]| {
        let deg = |i: usize| axes[i].deg(at[i]);
        Position::from_deg(deg(0), deg(1), deg(2))
    };
    let mut examined = 0;
    let mut value = |at: [i64; 3]| {
        examined += 1;
        let position = position(at);
        match platform.obstacles().allow(position.nano()) {
            true => gain(position),
            false => f64::NEG_INFINITY,
        }
    };
    let mut grid = Vec::new();
    let grids = axes.each_ref().map(|axis| axis.grid(GRID_DEG));
    for &alpha in &grids[0] {
        for &beta in &grids[1] {
            for &gamma in &grids[2] {
                let at = [alpha, beta, gamma];
                grid.push((value(at), at));
            }
        }
    }
    grid.sort_by(|a, b| b.0.total_cmp(&a.0));
    grid.truncate(REFINED);
    let mut best: Option<(f64, [i64; 3])> = None;
    for (start, at) in grid {
        let refined = pattern_search(&axes, start, at, &mut value);
        // Later starts must be better by more than rounding, so that the answer is stable.
        if best.is_none_or(|(most, _)| gains(refined.0, most)) {
            best = Some(refined);
        }
    }
    best.map(|(_, at)| {
        let deg: [f64; 3] = std::array::from_fn(|i| round_deg(axes[i].tidy(at[i])));
        (Position::from_deg(deg[0], deg[1], deg[2]), examined)
    })
}

/// Pattern search (Hooke & Jeeves, *"Direct search" solution of numerical and statistical
/// problems*, J. ACM 8(2), 1961): steps along the axes and, after those that gain, further along
/// the same way, which follows ridges; in ever smaller steps.
fn pattern_search(
    axes: &[GimbalAxis; 3],
    start: f64,
    from: [i64; 3],
    value: &mut impl FnMut([i64; 3]) -> f64,
) -> (f64, [i64; 3]) {
    let mut best = (start, from);
    let mut step = (0.5 * GRID_DEG / axes[0].unit_deg).ceil() as i64;
    let mut explorations = 0;
    loop {
        let before = best;
        best = explore(axes, best, step, value);
        explorations += 1;
        if best.1 == before.1 || explorations > MOST_EXPLORATIONS {
            if step == 1 || explorations > MOST_EXPLORATIONS {
                return best;
            }
            step /= 2;
            continue;
        }
        // Further along the same way, and around there.
        let ahead: [Option<i64>; 3] =
            std::array::from_fn(|i| axes[i].moved(best.1[i], best.1[i] - before.1[i]));
        if let [Some(a), Some(b), Some(c)] = ahead {
            let at = [a, b, c];
            let further = explore(axes, (value(at), at), step, value);
            if gains(further.0, best.0) {
                best = further;
            }
        }
    }
}

/// The best of `from` and one step either way along each axis in turn.
fn explore(
    axes: &[GimbalAxis; 3],
    from: (f64, [i64; 3]),
    step: i64,
    value: &mut impl FnMut([i64; 3]) -> f64,
) -> (f64, [i64; 3]) {
    let mut best = from;
    for (i, axis) in axes.iter().enumerate() {
        for by in [step, -step] {
            let Some(to) = axis.moved(best.1[i], by) else {
                continue;
            };
            let mut at = best.1;
            at[i] = to;
            let gain = value(at);
            if gains(gain, best.0) {
                best = (gain, at);
            }
        }
    }
    best
}

/// Whether `gain` is more than `best` by more than rounding.
pub(super) fn gains(gain: f64, best: f64) -> bool {
    gain > best + 1e-10 * best.abs()
}
