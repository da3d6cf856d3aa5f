//! The parameters of a platform as the [`chain`](super::chain) takes them, in numbers of 16 or of 32
//! digits.
//!
//! Every column of A is C_c^n times features of g^c and of the commanded rate, mixed by the constant
//! factors of [`ErrorModel::effects`](crate::model::ErrorModel). What the accelerometers show in error,
//! b^n = C_c^n δZ^c D, is constant over a dwell, and **shifts the state**: with
//!
//! ```text
//! ψ' = ψ^n + U D,   U = rows (−b_3, 0, b_1):   z_1 = ψ_z + b_1 = ψ'_z,   z_3 = −ψ_x + b_3 = −ψ'_x,
//! ψ̇' = −ω_ie^n × ψ' + A' D + w,   A' = A + [ω_ie^n ×] U,
//! ```
//!
//! so that the kernels stay what they are. The vertical channel, z_2 = b_2 + v, adds b_2ᵀ b_2 / r² in
//! each period. Between dwells V is that of ψ^n itself; in a measured move, where U changes from tick
//! to tick, a measurement is one of H (V + U).
//!
//! A move turns the torquers by ∫ C_c^n T ω_nc^c ds along its way, whether it takes time or not.

use nalgebra::{DMatrix, Matrix3, Matrix3xX, Vector3};

use super::chain::{Effects, NoRecord, Reached, run};
use super::coloured;
use super::full::{
    FullCovariance, IgnoredGroup, Outcome, Question, Walked, coefficients, errors_of_coefficients,
};
use super::kernel::Kernel;
use super::kernel_table::Doublings;
use super::real::{Extended, Real};
use super::rows::{Rows, Solved};
use super::{CovarianceModel, EndCovariance, Precision, TickRule, not_finite};
use crate::attitude::{Attitude, EAST, NORTH, UP};
use crate::drift::COEFFICIENTS;
use crate::error::Result;
use crate::model::{Effect, Feature, Instrument, Role};
use crate::motion::integral::for_each_share;
use crate::motion::{Leg, Move, Timeline};

/// What each parameter does: on which instrument, by which feature and factor.
#[derive(Debug, Clone)]
pub(crate) struct Mixing<T>(Vec<Vec<(Instrument, Feature, T)>>);

impl<T: Real> Mixing<T> {
    pub fn new(effects: &[Vec<Effect>]) -> Self {
        let of = |e: &Effect| (e.on, e.feature, T::from(e.factor));
        Self(
            effects
                .iter()
                .map(|list| list.iter().map(of).collect())
                .collect(),
        )
    }

    /// Three rows of zeros.
    pub fn nothing(&self) -> Matrix3xX<T> {
        Matrix3xX::zeros(self.0.len())
    }

    /// Whether any parameter shows in what an accelerometer reads.
    pub fn has_accelerometers(&self) -> bool {
        let mut all = self.0.iter().flatten();
        all.any(|(on, ..)| matches!(on, Instrument::Accelerometer(_)))
    }

    /// Whether the commanded rate drives any.
    pub fn has_torquers(&self) -> bool {
        self.0
            .iter()
            .flatten()
            .any(|(_, feature, _)| feature.is_rate())
    }

    /// Σ over the effects of each parameter on gyros, or on accelerometers, of the instrument's
    /// column of C_c^n times `feature`.
    fn columns(
        &self,
        c: &Matrix3<T>,
        of_gyros: bool,
        feature: impl Fn(Feature) -> T,
    ) -> Matrix3xX<T> {
        let mut columns = self.nothing();
        for (j, effects) in self.0.iter().enumerate() {
            for (on, of, factor) in effects {
                let axis = match (on, of_gyros) {
                    (Instrument::Gyro(k), true) | (Instrument::Accelerometer(k), false) => *k,
                    _ => continue,
                };
                let value = *factor * feature(*of);
                for i in 0..3 {
                    columns[(i, j)] += c[(i, axis)] * value;
                }
            }
        }
        columns
    }

    /// A where what is no rate counts `times` and the commanded rate is `rate`.
    pub fn drift(&self, c: &Matrix3<T>, rate: &Vector3<T>, times: T) -> Matrix3xX<T> {
        self.turned_drift(c, c, rate, times)
    }

    /// The same with X C_c^n, for X A.
    pub fn turned_drift(
        &self,
        xc: &Matrix3<T>,
        c: &Matrix3<T>,
        rate: &Vector3<T>,
        times: T,
    ) -> Matrix3xX<T> {
        // g^c is minus the Up row of C_c^n.
        let a = -c.row(UP).transpose();
        self.columns(xc, true, |feature| match feature {
            Feature::Rate(axis) => rate[axis],
            other => power(&a, other) * times,
        })
    }

    /// b^n of each parameter.
    pub fn output(&self, c: &Matrix3<T>) -> Matrix3xX<T> {
        let f = c.row(UP).transpose();
        self.columns(c, false, |feature| power(&f, feature))
    }
}

/// The parameters of a platform.
pub(crate) struct Selection<'a, T: Real> {
    model: &'a CovarianceModel,
    mixing: Mixing<T>,
    /// The same for drift integrals.
    in_doubles: Mixing<f64>,
    has_accelerometers: bool,
    has_torquers: bool,
    /// Of A in the angles.
    degree: f64,
    doublings: Doublings<T>,
}

/// An attitude with what the parameters do there.
pub(crate) struct Place<T> {
    /// C_c^n.
    pub c: Matrix3<T>,
    /// A, or A' where the accelerometers have errors.
    pub a: Matrix3xX<T>,
    /// U, if they have.
    pub shift: Option<Matrix3xX<T>>,
    /// b_2 / r in the first row.
    pub upward: Option<Matrix3xX<T>>,
}

impl<'a, T: Real> Selection<'a, T> {
    /// Of the model's platform.
    pub fn new(model: &'a CovarianceModel) -> Self {
        Self::of_effects(model, &model.errors.effects())
    }

    /// Of parameters that do this on the model's platform.
    pub fn of_effects(model: &'a CovarianceModel, effects: &[Vec<Effect>]) -> Self {
        let any = |what: &dyn Fn(&Effect) -> bool| effects.iter().flatten().any(what);
        let is_of_gyro = |e: &Effect| matches!(e.on, Instrument::Gyro(_));
        let is_quadratic = any(&|e| is_of_gyro(e) && matches!(e.feature, Feature::Product(..)));
        Self {
            has_accelerometers: any(&|e| !is_of_gyro(e)),
            has_torquers: any(&|e| matches!(e.feature, Feature::Rate(_))),
            degree: if is_quadratic { 3.0 } else { 2.0 },
            mixing: Mixing::new(effects),
            in_doubles: Mixing::new(effects),
            doublings: Doublings::new(
                &model.dynamics,
                model.period_s,
                model.drift_psd,
                model.measured_variance(),
            ),
            model,
        }
    }

    /// The degree of A in the angles.
    pub fn degree(&self) -> f64 {
        self.degree
    }

    /// How many parameters there are.
    pub fn count(&self) -> usize {
        self.mixing.0.len()
    }

    /// The model.
    pub fn of_model(&self) -> &'a CovarianceModel {
        self.model
    }

    /// What the parameters do where the platform stands so.
    pub fn place_at(&self, c: Matrix3<T>) -> Place<T> {
        let model = self.model;
        let rate = c.transpose() * model.earth_rate_n.map(T::from);
        let mut a = self.mixing.drift(&c, &rate, T::from(1.0));
        if !self.has_accelerometers {
            return Place {
                c,
                a,
                shift: None,
                upward: None,
            };
        }
        let b = self.mixing.output(&c);
        let mut shift = self.mixing.nothing();
        shift.set_row(NORTH, &-b.row(EAST));
        shift.set_row(EAST, &b.row(NORTH));
        // [ω_ie ×] = −F.
        a -= model.dynamics.system_matrix().map(T::from) * &shift;
        let mut upward = self.mixing.nothing();
        let by_noise = T::from(1.0) / T::from(model.noise_variance).sqrt();
        upward.set_row(0, &(b.row(UP) * by_noise));
        Place {
            c,
            a,
            shift: Some(shift),
            upward: Some(upward),
        }
    }

    /// B = ∫ Φ(t_end − t) (A dt + C_c^n T ω_nc^c ds) over a part of a move, start and length as
    /// shares of its duration, in doubles.
    pub fn part_of_move(&self, m: &Move, (start, length): (f64, f64)) -> Matrix3xX<f64> {
        let model = self.model;
        let mut b = self.in_doubles.nothing();
        for_each_share(m, (start, length), self.degree, |at, share| {
            let position = m.position_at(at);
            let attitude = model.stand.attitude(position);
            let c = attitude.matrix();
            let (time_s, done) = (share * m.duration_s, share * m.speed_at(at));
            // dC = −[φ ×] C: the platform turns by −φ in n.
            let axes = model.stand.rotation_axes(&attitude, position);
            let turned = axes.iter().zip(m.change);
            let turned = turned.fold(Vector3::zeros(), |sum, (axis, by)| sum - axis * by);
            let rate = c.transpose() * (model.earth_rate_n * time_s + turned * done);
            let phi = model
                .dynamics
                .transition((start + length - at) * m.duration_s);
            b += phi * self.in_doubles.drift(c, &rate, time_s);
        });
        b
    }
}

/// A product of components of `v`.
fn power<T: Real>(v: &Vector3<T>, feature: Feature) -> T {
    match feature {
        Feature::One => T::from(1.0),
        Feature::Linear(i) => v[i],
        Feature::Product(i, j) => v[i] * v[j],
        Feature::Cube(i) => v[i] * v[i] * v[i],
        // No component of gravity.
        Feature::Rate(_) => T::from(0.0),
    }
}

impl<T: Real> Effects for Selection<'_, T> {
    type Number = T;
    type Drive = Matrix3xX<T>;
    type Place = Place<T>;

    fn model(&self) -> &CovarianceModel {
        self.model
    }
    fn nothing(&self) -> Matrix3xX<T> {
        self.mixing.nothing()
    }
    fn place(&self, leg: &Leg) -> Place<T> {
        self.place_at(T::attitude(&self.model.stand, leg.position))
    }
    fn attitude(&self, place: &Place<T>) -> Matrix3<T> {
        place.c
    }
    fn held(&self, x: &Matrix3<T>, place: &Place<T>) -> Matrix3xX<T> {
        x * &place.a
    }
    fn moved(&self, m: &Move, start_s: f64, length_s: f64) -> Matrix3xX<T> {
        let part = [start_s, length_s].map(|s| s / m.duration_s);
        self.part_of_move(m, part.into()).map(T::from)
    }
    fn kernel(&self, periods: usize) -> Kernel<T> {
        self.doublings.kernel(periods)
    }
    fn measurement(&self) -> Matrix3<T> {
        let root = |variance: Option<f64>| match variance {
            Some(variance) => T::from(1.0) / T::from(variance).sqrt(),
            None => T::from(0.0),
        };
        Matrix3::from_diagonal(&Vector3::from(self.model.measured_variance().map(root)))
    }
    fn jump(&self, m: &Move) -> Option<Matrix3xX<T>> {
        self.has_torquers
            .then(|| self.part_of_move(m, (0.0, 1.0)).map(T::from))
    }
    fn shift<'b>(&self, place: &'b Place<T>) -> Option<&'b Matrix3xX<T>> {
        place.shift.as_ref()
    }
    fn upward<'b>(&self, place: &'b Place<T>) -> Option<&'b Matrix3xX<T>> {
        place.upward.as_ref()
    }
    fn passed(&self, m: &Move, time_s: f64) -> Option<Place<T>> {
        let here = || T::attitude(&self.model.stand, m.position_at(time_s / m.duration_s));
        self.has_accelerometers.then(|| self.place_at(here()))
    }
}

/// Information of 1e-7 of a unit prior: its share of a σ is below 1e-13.
pub(super) const MOST_IN_DOUBLES: f64 = 1e9;

/// The covariance of all parameters, and what it took.
pub(crate) struct FullWithTold {
    pub full: FullCovariance,
    /// A triangle of the information on the estimated parameters without their priors, each in units of
    /// its prior σ.
    pub triangle: DMatrix<f64>,
    /// The numbers it was worked out in.
    pub precision: Precision,
    /// How many times better than its prior, σ against σ, some combination of parameters is told.
    pub told: f64,
}

impl CovarianceModel {
    /// A of the parameters that are drift by gravity, zero for all others.
    pub(crate) fn drift_by_gravity(&self, attitude: &Attitude) -> Matrix3xX<f64> {
        Mixing::<f64>::new(&self.errors.effects()).drift(attitude.matrix(), &Vector3::zeros(), 1.0)
    }

    /// What is known of all parameters at the end of `timeline`, by the filter's tick rule: in doubles
    /// where they are enough, see [`CovarianceModel::end_covariance`].
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows.
    pub fn full_covariance(&self, timeline: &Timeline) -> Result<FullCovariance> {
        Ok(self.full_with_told(timeline)?.full)
    }

    /// The same with what it took.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::full_covariance`].
    pub(crate) fn full_with_told(&self, timeline: &Timeline) -> Result<FullWithTold> {
        let in_doubles = match self.is_of_the_paper() {
            true => self.twelve_in_doubles(timeline),
            false => self.full_covariance_in::<f64>(timeline),
        };
        match in_doubles {
            Ok(found) if found.told <= MOST_IN_DOUBLES => Ok(found),
            found => Ok(FullWithTold {
                told: found.map_or(f64::INFINITY, |found| found.told),
                ..self.full_covariance_in::<Extended>(timeline)?
            }),
        }
    }

    /// The same of the twelve coefficients in the paper's mounting, as searches see them.
    fn twelve_in_doubles(&self, timeline: &Timeline) -> Result<FullWithTold> {
        let (mut rows, state) = self.rows(timeline, TickRule::Filter);
        let told = rows.largest();
        let triangle = rows.first_columns(COEFFICIENTS);
        let end = EndCovariance::new(rows.covariance_root()?, &state);
        Ok(FullWithTold {
            full: FullCovariance::of_coefficients(end),
            triangle,
            precision: Precision::Double,
            told,
        })
    }

    /// What is known of all parameters at the end of `timeline`, in numbers `T`, by the filter's tick
    /// rule.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows.
    pub(crate) fn full_covariance_in<T: Real>(&self, timeline: &Timeline) -> Result<FullWithTold> {
        self.full_covariance_by::<T>(timeline, TickRule::Filter)
    }

    /// The same by any tick rule.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::full_covariance_in`].
    pub(super) fn full_covariance_by<T: Real>(
        &self,
        timeline: &Timeline,
        rule: TickRule,
    ) -> Result<FullWithTold> {
        self.solved_in::<T>(timeline, rule, Question::of_budget(&self.errors))
    }

    /// The truth of all parameters without the budget, for comparisons between many timelines.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::full_covariance`].
    pub(crate) fn truth(&self, timeline: &Timeline) -> Result<FullCovariance> {
        self.truth_by(timeline, TickRule::Filter)
    }

    /// The same by any tick rule.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::full_covariance`].
    pub(crate) fn truth_by(&self, timeline: &Timeline, rule: TickRule) -> Result<FullCovariance> {
        if self.is_of_the_paper() {
            let end = self.end_covariance(timeline, rule)?;
            return Ok(FullCovariance::of_coefficients(end));
        }
        let found = self.solved_in::<f64>(timeline, rule, Vec::new())?;
        match found.told <= MOST_IN_DOUBLES {
            true => Ok(found.full),
            false => Ok(self.solved_in::<Extended>(timeline, rule, Vec::new())?.full),
        }
    }

    /// What is known at the end of `timeline`, and what ignoring the groups of `asked` adds.
    fn solved_in<T: Real>(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        asked: Vec<(&'static str, Role, Question)>,
    ) -> Result<FullWithTold> {
        let selection = Selection::<T>::new(self);
        let priors: Vec<f64> = self
            .errors
            .parameters()
            .iter()
            .map(|p| p.prior_sigma)
            .collect();
        let mut rows = Rows::on(&priors);
        let reached = match self.is_white() {
            true => {
                let Reached { v, g } = run(&selection, timeline, rule, &mut rows, &mut NoRecord);
                AtEnd {
                    p: g * g.transpose(),
                    v,
                    walk: None,
                }
            }
            false => AtEnd::of(&coloured::run(&selection, timeline, rule, &mut rows)),
        };
        let told = rows.largest();
        let Question { others, ignored } = Question::of(&self.errors);
        let twelve = coefficients();
        let solved = rows.solution([&others, &twelve], &ignored)?;
        let in_doubles = |m: &DMatrix<T>| m.map(T::f64);
        let mut budget = Vec::new();
        for (group, role, question) in asked {
            let of = rows.solution([&question.others, &twelve], &question.ignored)?;
            let mut bias = in_doubles(&of.bias);
            if let Some(walked) = reached.walked(&of, &question.ignored, &priors) {
                walked.add_to_bias(&of.pivots, &mut bias);
            }
            budget.push(IgnoredGroup {
                group,
                role,
                error_deg_per_h: errors_of_coefficients(&of.pivots, &bias),
            });
        }
        let full = FullCovariance::new(Outcome {
            root: in_doubles(&solved.root),
            bias: in_doubles(&solved.bias),
            misalignment: reached.misalignment(&solved, &ignored, &priors),
            walked: reached.walked(&solved, &ignored, &priors),
            budget,
            pivots: solved.pivots,
        });
        match full.is_finite() {
            true => Ok(FullWithTold {
                full,
                triangle: rows.first_columns(self.errors.estimated()),
                precision: T::PRECISION,
                told,
            }),
            false => Err(not_finite()),
        }
    }
}

/// What is known of ψ^n and of the drift's random walk for known D, and what D does to them.
struct AtEnd<T: Real> {
    /// V of ψ^n.
    v: Matrix3xX<T>,
    /// Covariance of ψ^n, arcsec².
    p: Matrix3<T>,
    /// Of the random walk along the axes of the gyros: V, and a root of its covariance.
    walk: Option<[DMatrix<T>; 2]>,
}

impl<T: Real> AtEnd<T> {
    fn of(end: &coloured::End<T>) -> Self {
        let g = end.g.rows(0, 3);
        let p = g * g.transpose();
        Self {
            v: Matrix3xX::from_fn(end.v.ncols(), |i, j| end.v[(i, j)]),
            p: Matrix3::from_fn(|i, j| p[(i, j)]),
            walk: end.walk.map(|at| {
                let to_gyros = end.attitude.transpose();
                [&end.v, &end.g]
                    .map(|m| to_gyros * m.rows(at, 3))
                    .map(|m| DMatrix::from_fn(3, m.ncols(), |i, j| m[(i, j)]))
            }),
        }
    }

    /// Covariance of ψ^n: of its own, through the estimates, and through what is ignored.
    fn misalignment(&self, solved: &Solved<T>, ignored: &[usize], priors: &[f64]) -> Matrix3<f64> {
        let estimated = self.v.select_columns(&solved.pivots);
        let by_estimates = &estimated * &solved.root;
        let mut by_ignored = &estimated * &solved.bias;
        for (mut column, &k) in by_ignored.column_iter_mut().zip(ignored) {
            column += self.v.column(k) * T::from(priors[k]);
        }
        let covariance = self.p
            + &by_estimates * by_estimates.transpose()
            + &by_ignored * by_ignored.transpose();
        covariance.map(T::f64)
    }

    /// What the drift's random walk has come to, where it has one.
    fn walked(&self, solved: &Solved<T>, ignored: &[usize], priors: &[f64]) -> Option<Walked> {
        let [v, g] = self.walk.as_ref()?;
        let estimated = v.select_columns(&solved.pivots);
        let mut by_ignored = &estimated * &solved.bias;
        for (mut column, &k) in by_ignored.column_iter_mut().zip(ignored) {
            column += v.column(k) * T::from(priors[k]);
        }
        Some(Walked {
            own: g.map(T::f64),
            by_estimates: (estimated * &solved.root).map(T::f64),
            by_ignored: by_ignored.map(T::f64),
        })
    }
}

#[cfg(test)]
mod tests;
