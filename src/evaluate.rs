//! The evaluator: separability and covariance convergence of a schedule, and its score.
//!
//! # The score
//!
//! One figure of merit, lower is better:
//!
//! ```text
//! score = w_cov · ln(criterion) − w_sep · mean_i ln(max(separability_i, 1e-3)) + w_conv · ⟨ln(criterion)⟩
//! ```
//!
//! The first part is the covariance the filter converges to, by a [`Criterion`] on P_D; the
//! second what the ε^n expansions say of telling the coefficients apart, all channels weighted
//! by their noise; coefficients known before the test are left out. By default w_cov = 1, w_sep =
//! 0.01: of schedules of nearly the same accuracy, the one that separates better. The third, by default
//! without weight, is the average of ln(criterion) over the test: it rewards early convergence. A
//! `minimum_separability` is a requirement on every coefficient; a schedule that misses it is said to.
//!
//! # Two computations of every number
//!
//! [`Evaluator::evaluate`] computes the covariance twice, through the dwell kernels and by the
//! step-by-step square-root filter; [`mod@crate::covariance::filter`] says what the two share. A
//! difference above 1e-6 in any σ is an error, never printed away. Only where priors far weaker
//! than the measurements leave double precision too few digits for such a difference to mean
//! anything are both repeated in numbers of 32 digits, which then must agree; the difference that
//! there was in doubles is kept ([`Evaluation::first_disagreement`]).

mod convergence;
mod disagreement;
mod known;
mod merit;

use nalgebra::DMatrix;

use crate::covariance::filter::{self, instrument::Instrument};
use crate::covariance::full::{FullCovariance, IgnoredGroup};
use crate::covariance::history::{ConvergenceHistory, HistoryRecorder};
use crate::covariance::real::{Extended, Real};
use crate::covariance::selection::FullWithTold;
use crate::covariance::{CovarianceModel, EndCovariance, Precision, TickRule};
use crate::criterion::{Criterion, largest_principal_sigma};
use crate::drift::{COEFFICIENTS, CoefficientVector};
use crate::error::Result;
use crate::motion::{Test, Timeline};
use crate::observability::Observability;
use crate::observability::named::{NamedObservability, PrincipalDrift, principal_drift};
use crate::observability::parameters::of_parameters;
use crate::schedule::Schedule;
pub(crate) use disagreement::MISALIGNMENT_NAMES;
use disagreement::compare;
pub use disagreement::{AGREEMENT, CORRELATION_AGREEMENT, Compared, Disagreement};
pub use known::KnownParameter;
use known::known_parameters;

/// What makes one schedule better than another.
#[derive(Debug, Clone, PartialEq)]
pub struct Objective {
    /// Criterion on the coefficient covariance.
    pub criterion: Criterion,
    /// Weight of ln(criterion) in the score.
    pub covariance_weight: f64,
    /// Weight of −mean ln(separability) in the score.
    pub separability_weight: f64,
    /// Weight of the average of ln(criterion) over the test in the score.
    pub convergence_weight: f64,
    /// Smallest acceptable separability of any coefficient, 0 to 1; 0 asks for nothing.
    pub minimum_separability: f64,
    /// 1σ specification of each coefficient, °/h; infinite where there is none.
    pub spec_deg_per_h: Option<CoefficientVector>,
    /// Parameters beside the twelve coefficients that the criterion sees, in its order: places in
    /// [`ErrorModel::parameters`](crate::model::ErrorModel::parameters).
    pub others: Vec<usize>,
    /// Their 1σ specifications in their units; infinite where there is none.
    pub spec_of_others: Vec<f64>,
    /// Coefficients that count and may stay unobservable all the same, by index.
    pub accept_unobservable: [bool; COEFFICIENTS],
}

impl Default for Objective {
    fn default() -> Self {
        Self {
            criterion: Criterion::rms(),
            covariance_weight: 1.0,
            separability_weight: Self::SEPARABILITY_WEIGHT,
            convergence_weight: 0.0,
            minimum_separability: 0.0,
            spec_deg_per_h: None,
            others: Vec::new(),
            spec_of_others: Vec::new(),
            accept_unobservable: [false; COEFFICIENTS],
        }
    }
}

impl Objective {
    /// Whether parameters beside the drift coefficients have a specification.
    pub fn specifies_others(&self) -> bool {
        self.spec_of_others.iter().any(|s| s.is_finite())
    }

    /// The usual weight of the separability beside a covariance weight of 1.
    pub const SEPARABILITY_WEIGHT: f64 = 0.01;

    /// Whether separability is asked for by itself, not only to choose between schedules that the
    /// criterion holds for nearly equal.
    pub(crate) fn is_led_by_separability(&self) -> bool {
        self.covariance_weight == 0.0
            || self.minimum_separability > 0.0
            || self.separability_weight > Self::SEPARABILITY_WEIGHT * self.covariance_weight
    }

    pub(crate) fn uses_separability(&self) -> bool {
        self.separability_weight > 0.0 || self.minimum_separability > 0.0
    }
}

/// The score and its parts, see the module text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// The figure of merit; lower is better.
    pub value: f64,
    /// Value of the criterion, °/h (max-ratio: 1).
    pub criterion: f64,
    /// w_cov · ln(criterion).
    pub covariance_part: f64,
    /// −w_sep · mean ln(separability) over the coefficients that are not known before the test, each
    /// counted as 1e-3 at least.
    pub separability_part: f64,
    /// w_conv · the average of ln(criterion) over the test.
    pub convergence_part: f64,
    /// Smallest separability of a coefficient.
    pub least_separability: f64,
    /// Whether every coefficient reaches the minimum separability asked for.
    pub meets_minimum_separability: bool,
}

/// All that is known of a schedule before the test.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// Duration of the test, moves and settles included, s.
    pub total_time_s: f64,
    /// Of which moves and settles, s, and what was done before an interruption.
    pub overhead_s: f64,
    /// Covariance of the coefficients and of ψ^n at the end; with considered parameters the truth.
    pub end: EndCovariance,
    /// Every parameter of the platform: the twelve coefficients, others that are estimated, and those
    /// that are only considered.
    pub parameters: Vec<KnownParameter>,
    /// What ignoring each group of errors adds.
    pub budget: Vec<IgnoredGroup>,
    /// Prior 1σ of the coefficients, °/h.
    pub prior_sigma_deg_per_h: CoefficientVector,
    /// The score.
    pub score: Score,
    /// Orders, separability, unobservable combinations.
    pub observability: Observability,
    /// What cannot be told apart over all estimated parameters; none: it cannot be worked out.
    pub named: Option<NamedObservability>,
    /// What is known worst of all drift by gravity, with quadratic terms.
    pub principal_drift: Vec<PrincipalDrift>,
    /// σ against time.
    pub convergence: ConvergenceHistory,
    /// Largest relative difference of a σ between kernels and square-root filter.
    pub agreement: f64,
    /// The numbers that gave the covariance.
    pub precision: Precision,
    /// Where kernels and filter differed in doubles, before both were repeated in 32 digits.
    pub first_disagreement: Option<Disagreement>,
    /// When each position of the schedule begins to be held, and what accelerometers read there.
    pub positions: Vec<HeldPosition>,
    /// How far α, β and γ are from where the test began, at most, degrees.
    pub winding_deg: [f64; 3],
}

/// A position of a schedule in its test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldPosition {
    /// When the move to it and its settling are over, from the start of the test, s.
    pub starts_s: f64,
    /// What perfect accelerometers along the platform's axes read there, g.
    pub specific_force_g: [f64; 3],
}

/// Every position of the schedule in order.
fn held_positions(timeline: &Timeline) -> Vec<HeldPosition> {
    let mut time_s = 0.0;
    let mut all = Vec::with_capacity(timeline.legs().len());
    for leg in timeline.legs() {
        time_s += leg.duration_s();
        all.push(HeldPosition {
            starts_s: time_s - leg.dwell_s,
            specific_force_g: leg.attitude.specific_force_c(),
        });
    }
    all.drain(timeline.positions()).collect()
}

impl Evaluation {
    /// √(mean of the coefficient variances), °/h.
    pub fn rms_sigma_deg_per_h(&self) -> f64 {
        (self.end.coefficients.trace() / COEFFICIENTS as f64).sqrt()
    }

    /// Largest σ of a coefficient, °/h.
    pub fn max_sigma_deg_per_h(&self) -> f64 {
        self.end.sigma_deg_per_h().max()
    }

    /// σ of the worst combination: √λ_max(P_D), °/h.
    pub fn max_eig_sigma_deg_per_h(&self) -> f64 {
        // Finite: its σ are.
        largest_principal_sigma(&self.end).unwrap_or(f64::NAN)
    }

    /// ln det P_D, P_D in (°/h)²; none when a coefficient is known exactly.
    pub fn logdet_deg_per_h(&self) -> Option<f64> {
        let (log_det, open) = self.end.root.log_determinant();
        (open == COEFFICIENTS).then_some(log_det)
    }
}

/// What two computations came to.
struct Checked {
    full: FullCovariance,
    /// Of the information on the estimated parameters.
    triangle: DMatrix<f64>,
    convergence: ConvergenceHistory,
    agreement: f64,
    precision: Precision,
    first_disagreement: Option<Disagreement>,
}

/// What the filter came to.
struct Judged {
    convergence: ConvergenceHistory,
    /// Largest relative difference of a σ, or the first that is too large.
    agreement: std::result::Result<f64, Disagreement>,
}

/// Scores schedules of one test. Cheap to share between threads.
///
/// ```
/// use scheme_opt::internals::evaluate::{Evaluator, Objective};
/// use scheme_opt::internals::platform::PlatformConfig;
/// use scheme_opt::internals::attitude::Position;
/// use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
///
/// let evaluator = Evaluator::new(PlatformConfig::default().check()?, Objective::default());
/// let schedule = Schedule::new(vec![
///     ScheduledPosition::new(Position::from_deg(0.0, 0.0, 0.0), 1000.0),
///     ScheduledPosition::new(Position::from_deg(180.0, 0.0, 0.0), 1000.0),
/// ])?;
/// let evaluation = evaluator.evaluate(&schedule)?;
/// // Theory: with psi^n continuous, D_FZ comes out clean and D_SZ absorbs omega_N psi_y(0).
/// let sigma = evaluation.end.sigma_deg_per_h();
/// assert!((sigma[2] - 0.00260).abs() < 1e-5 && (sigma[11] - 0.02377).abs() < 1e-5);
/// # Ok::<(), scheme_opt::Error>(())
/// ```
#[derive(Debug)]
pub struct Evaluator {
    test: Test,
    objective: Objective,
    /// The criterion for estimates that know the twelve coefficients alone.
    estimate: Criterion,
    model: CovarianceModel,
    /// What the step-by-step filter takes for the instrument.
    instrument: Instrument,
}

impl Evaluator {
    /// An evaluator of schedules by `objective`: of a whole test on a platform, or of what is left
    /// of one.
    pub fn new(test: impl Into<Test>, objective: Objective) -> Self {
        let test = test.into();
        let platform = test.platform();
        let model = CovarianceModel::new(platform).seeing(&objective.others);
        Self {
            instrument: Instrument::of(platform),
            estimate: objective.criterion.estimate(),
            test,
            objective,
            model,
        }
    }

    /// With a filter that takes the instrument for another.
    #[cfg(test)]
    fn judged_on(mut self, instrument: Instrument) -> Self {
        self.instrument = instrument;
        self
    }

    /// The same, working out several schedules in at most `most` lanes; see
    /// [`CovarianceModel::with_most_lanes`]. For tests: a search ends with the same bytes.
    pub fn with_most_lanes(mut self, most: usize) -> Self {
        self.model = self.model.with_most_lanes(most);
        self
    }

    /// The test, and through it the platform.
    pub fn test(&self) -> &Test {
        &self.test
    }

    /// The objective.
    pub fn objective(&self) -> &Objective {
        &self.objective
    }

    /// The covariance model.
    pub fn model(&self) -> &CovarianceModel {
        &self.model
    }

    /// Everything about `schedule`.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when the platform cannot execute the schedule,
    /// [`Error::is_numerical`] when a number cannot be trusted, [`Error::is_disagreement`] when
    /// the two computations of a σ differ by more than [`AGREEMENT`].
    pub fn evaluate(&self, schedule: &Schedule) -> Result<Evaluation> {
        let timeline = Timeline::new(&self.test, schedule)?;
        let total_time_s = timeline.total_time_s();
        let Checked {
            full,
            triangle,
            convergence,
            agreement,
            precision,
            first_disagreement,
        } = self.checked(&timeline)?;
        let observability = Observability::analyze(&self.model, &timeline)?;
        let of_each = of_parameters(&self.model, &timeline, &observability, &triangle);
        let parameters = known_parameters(self.model.errors.parameters(), &full, &of_each);
        let score = self.score(&timeline, &full, &observability)?;
        let named = NamedObservability::of(&self.test, &self.model, &timeline);
        let vertical = named.as_ref().map_or(&[][..], |named| &named.vertical);
        let principal_drift = principal_drift(&self.model.errors, &full.parameters, vertical);
        let FullCovariance { end, budget, .. } = full;
        Ok(Evaluation {
            total_time_s,
            overhead_s: timeline.overhead_s(),
            score,
            end,
            parameters,
            budget,
            prior_sigma_deg_per_h: *self.model.prior_sigma_deg_per_h(),
            observability,
            named,
            principal_drift,
            convergence,
            agreement,
            precision,
            first_disagreement,
            positions: held_positions(&timeline),
            winding_deg: timeline.winding_deg(),
        })
    }

    /// The end of `timeline` by kernels and filter: in doubles and, where those have lost the
    /// digits that are compared, once more in numbers of 32 digits.
    fn checked(&self, timeline: &Timeline) -> Result<Checked> {
        let FullWithTold {
            full,
            triangle,
            precision,
            told,
        } = self.model.full_with_told(timeline)?;
        let first = match self.judge::<f64>(&full, timeline) {
            Ok(Judged {
                convergence,
                agreement: Ok(agreement),
            }) => {
                return Ok(Checked {
                    full,
                    triangle,
                    convergence,
                    agreement,
                    precision,
                    first_disagreement: None,
                });
            }
            Ok(Judged {
                agreement: Err(first),
                ..
            }) if self.digits_are_lost(told, &first) => Some(first),
            Ok(Judged {
                agreement: Err(first),
                ..
            }) => return Err(first.error()),
            // The filter's rows leave the range of doubles.
            Err(error) if error.is_numerical() => None,
            Err(error) => return Err(error),
        };
        let FullWithTold { full, triangle, .. } =
            self.model.full_covariance_in::<Extended>(timeline)?;
        let judged = self.judge::<Extended>(&full, timeline)?;
        let agreement = judged
            .agreement
            .map_err(|again| again.error().with_hint(why_lost(timeline)))?;
        Ok(Checked {
            full,
            triangle,
            convergence: judged.convergence,
            agreement,
            precision: Precision::Extended,
            first_disagreement: first,
        })
    }

    /// Whether rounding in doubles may come to such a difference: what measurements tell `told`
    /// times better than the prior leaves, of the digits of what the prior knows, an error of so
    /// many roundings. A difference beyond that is one of the computations', not of the numbers'.
    fn digits_are_lost(&self, told: f64, found: &Disagreement) -> bool {
        /// Roundings that add up in a test.
        const ROUNDINGS: f64 = 1e3;
        let noise = self.model.noise_variance.sqrt();
        let psi = self.model.prior_psi.diagonal().map(|v| v.sqrt() / noise);
        // Of a misalignment told s times better than its prior, I + R11 P R11ᵀ holds both 1 and s². One
        // known exactly is one far below the noise to the filter.
        let told_of_psi = psi.map(|s| (s * s).max(1.0 / s.max(f64::KNOWN))).max();
        let rounding = ROUNDINGS * f64::EPSILON * told.max(told_of_psi);
        // From the size of σ on, nothing is left of it; also where the rows overflow.
        rounding.is_nan() || rounding >= 1.0 || found.difference <= rounding
    }

    /// Compares `full` with what the filter comes to in numbers `T`.
    fn judge<T: Real>(&self, full: &FullCovariance, timeline: &Timeline) -> Result<Judged> {
        let mut recorder = HistoryRecorder::new(timeline, self.objective.spec_deg_per_h);
        let filter =
            filter::run::<T>(self.test.platform(), &self.instrument, timeline, &mut |m| {
                recorder.observe(m);
            })?;
        Ok(Judged {
            convergence: recorder.finish(),
            agreement: compare(
                self.model.errors.parameters(),
                full,
                &filter,
                self.model.noise_variance.sqrt(),
            ),
        })
    }

    fn score(
        &self,
        timeline: &Timeline,
        full: &FullCovariance,
        observability: &Observability,
    ) -> Result<Score> {
        let o = &self.objective;
        let criterion = self.criterion_of(full)?;
        let covariance_part = weighted(o.covariance_weight, libm::log(criterion));
        let counted = self.counted_separability(&observability.separability.map(libm::log));
        let separability_part = o.separability_weight * counted.0;
        let least_separability = observability.separability.min();
        let convergence_part = self.convergence_by_filter(timeline)?;
        Ok(Score {
            value: covariance_part + separability_part + convergence_part,
            criterion,
            covariance_part,
            separability_part,
            convergence_part,
            least_separability,
            meets_minimum_separability: least_separability >= o.minimum_separability,
        })
    }

    /// The criterion of what is known of all parameters.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when it is not finite.
    pub(crate) fn criterion_of(&self, full: &FullCovariance) -> Result<f64> {
        let o = &self.objective;
        o.criterion.value(&full.seeing(&o.others))
    }

    /// The covariance at the end of `timeline` by the filter's own rule, with the criterion.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows.
    pub(crate) fn end_with_criterion(&self, timeline: &Timeline) -> Result<(EndCovariance, f64)> {
        let Objective {
            criterion, others, ..
        } = &self.objective;
        if others.is_empty() {
            let end = self.model.end_covariance(timeline, TickRule::Filter)?;
            let value = criterion.value(&end)?;
            return Ok((end, value));
        }
        let full = self.model.truth(timeline)?;
        let value = self.criterion_of(&full)?;
        Ok((full.end, value))
    }
}

/// A part of the score. Not 0 · ∞: without a weight there is no such part.
fn weighted(weight: f64, value: f64) -> f64 {
    if weight == 0.0 { 0.0 } else { weight * value }
}

/// Why numbers of 32 digits do not settle it.
fn why_lost(timeline: &Timeline) -> &'static str {
    let moves = timeline.legs().iter().filter_map(|leg| leg.arrival);
    match moves.into_iter().any(|m| m.duration_s > 0.0) {
        true => {
            "some combination of coefficients is known only from a prior so much weaker than the \
             measurements that the tenth digit of the drift during the moves would decide it, \
             and no more are computed; give stronger priors"
        }
        false => {
            "the noises, the prior and the durations are too far apart even for numbers of 32 \
             digits"
        }
    }
}

#[cfg(test)]
mod tests;
