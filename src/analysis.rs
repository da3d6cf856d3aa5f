//! Everything that can be said about what a schedule makes observable, what it leaves unobservable
//! though it counts, and what to add to it.

pub mod additions;
pub mod remark;
pub mod suggest;
mod unobservable;

use crate::attitude::{EAST, NORTH, Position, UP};
use crate::covariance::CovarianceModel;
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector, DriftCoefficient};
use crate::error::Result;
use crate::evaluate::{Evaluation, Evaluator};
use crate::motion::Timeline;
use crate::observability::advice::Advice;
use crate::observability::classical::{Gramian, PiecewiseConstant, Units};
use crate::observability::combinations::Combination;
use crate::observability::nearly::Nearly;
use crate::observability::regressor::{Channel, Regressor, RowSource};
use crate::observability::row_space::{RowSpace, counts};
use crate::observability::solution::{NoSolution, Solution};
use crate::observability::weak::{WeakCombination, weak_combinations};
use crate::observability::{Observability, Order};
use crate::schedule::{Schedule, ScheduledPosition};
use additions::Additions;
use remark::Remark;
use suggest::{NoSuggestion, Suggestion};
#[cfg(feature = "cli")]
pub(crate) use unobservable::not_observed;
pub use unobservable::{USEFUL, Unobservable};

/// How many of the strongest correlations are listed.
const LISTED: usize = 6;

/// A state of the platform or a combination of such states, as the paper's conclusion 1 lists
/// them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PlatformState {
    /// ψ_x^n.
    PsiX,
    /// ψ_y^n.
    PsiY,
    /// ψ_z^n.
    PsiZ,
    /// ψ̇_y^n.
    PsiYRate,
    /// ε_x^n.
    EpsilonX,
    /// ε_y^n.
    EpsilonY,
    /// ε_z^n.
    EpsilonZ,
    /// ε_z^n − ω_N ψ_y^n.
    EpsilonZMinusAzimuth,
}

impl PlatformState {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::PsiX,
        Self::PsiY,
        Self::PsiZ,
        Self::PsiYRate,
        Self::EpsilonX,
        Self::EpsilonY,
        Self::EpsilonZ,
        Self::EpsilonZMinusAzimuth,
    ];

    /// The name used in documents and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::PsiX => "psi_nx",
            Self::PsiY => "psi_ny",
            Self::PsiZ => "psi_nz",
            Self::PsiYRate => "psi_ny rate",
            Self::EpsilonX => "eps_nx",
            Self::EpsilonY => "eps_ny",
            Self::EpsilonZ => "eps_nz",
            Self::EpsilonZMinusAzimuth => "eps_nz - omega_N psi_ny",
        }
    }

    /// In the states (ψ^n, ε^n) of a dwell, time in units of 1/ω_ie.
    fn vector(self, omega_n: f64) -> [f64; 6] {
        let mut v = [0.0; 6];
        match self {
            Self::PsiX => v[NORTH] = 1.0,
            Self::PsiY => v[UP] = 1.0,
            Self::PsiZ => v[EAST] = 1.0,
            Self::EpsilonX => v[3 + NORTH] = 1.0,
            Self::EpsilonY => v[3 + UP] = 1.0,
            Self::EpsilonZ => v[3 + EAST] = 1.0,
            // (25): ψ̇_y holds ε_y, which is of order 2.
            Self::PsiYRate => (v[EAST], v[3 + UP]) = (omega_n, 1.0),
            Self::EpsilonZMinusAzimuth => (v[UP], v[3 + EAST]) = (-omega_n, 1.0),
        }
        v
    }
}

/// The order of a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StateOrder {
    /// The state.
    pub state: PlatformState,
    /// Its order within one dwell; none: not observable there.
    pub one_position: Option<Order>,
    /// Its order over the schedule, at the position where it is highest; none: not observable
    /// at some position.
    pub schedule: Option<Order>,
}

/// What one position shows.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionAnalysis {
    /// The position.
    pub position: Position,
    /// What each channel shows there: x and z of order 1, y of order 2.
    pub seen: Vec<(Channel, Combination)>,
    /// Order of each coefficient by this position alone; none, unless everything else that the
    /// channel shows is absent, since a channel shows a sum.
    pub orders: [Option<Order>; COEFFICIENTS],
    /// Lowest order at which each coefficient is excited at all: part of what a channel shows.
    pub excited: [Option<Order>; COEFFICIENTS],
}

/// Two coefficients and how alike they look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CorrelatedPair {
    /// One coefficient.
    pub a: DriftCoefficient,
    /// The other.
    pub b: DriftCoefficient,
    /// −1 to 1.
    pub correlation: f64,
}

/// The methods that the paper argues against, for comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct ClassicalMeasures {
    /// Output sensitivity and observability Gramian.
    pub gramian: Gramian,
    /// 1σ of each coefficient by Gramian and prior, without random drift, °/h.
    pub gramian_sigma_deg_per_h: CoefficientVector,
    /// Piecewise-constant (Lie-derivative) observability matrix in SI units.
    pub piecewise_constant: PiecewiseConstant,
}

impl ClassicalMeasures {
    fn new(model: &CovarianceModel, timeline: &Timeline) -> Self {
        let gramian = Gramian::new(model, timeline);
        Self {
            gramian_sigma_deg_per_h: gramian.sigma_deg_per_h(model),
            gramian,
            piecewise_constant: PiecewiseConstant::new(model, timeline, Units::Si),
        }
    }
}

/// Everything that can be said about what a schedule makes observable.
#[derive(Debug, Clone, PartialEq)]
pub struct Analysis {
    /// Orders, separability, ranks, unobservable combinations.
    pub observability: Observability,
    /// Order of ω_N ψ_y^n(0), the azimuth misalignment at the start.
    pub azimuth_order: Option<Order>,
    /// The states' orders.
    pub states: Vec<StateOrder>,
    /// What each position shows.
    pub positions: Vec<PositionAnalysis>,
    /// What is observable only through a small tilt.
    pub nearly: Vec<Nearly>,
    /// The reconstruction of each coefficient, or why there is none.
    pub solutions: Vec<std::result::Result<Solution, NoSolution>>,
    /// The strongest correlations between estimates, by P_D.
    pub estimate_correlations: Vec<CorrelatedPair>,
    /// The strongest correlations between columns of the weighted regressor.
    pub column_correlations: Vec<CorrelatedPair>,
    /// Singular values of the weighted regressor, (°/h)⁻¹, largest first.
    pub singular_values: Vec<f64>,
    /// Combinations of length one with 1σ by the filter, °/h, the largest first.
    pub weak: Vec<(WeakCombination, f64)>,
    /// The classical measures.
    pub classical: ClassicalMeasures,
    /// What to add, in words.
    pub advice: Vec<Advice>,
    /// The position to add, or why there is none.
    pub suggestion: std::result::Result<Suggestion, NoSuggestion>,
    /// What is worth saying of a platform with more than the twelve coefficients.
    pub remarks: Vec<Remark>,
    /// The position or the move that helps such a platform most, or why there is none; none: there is
    /// nothing but the twelve coefficients.
    pub additions: Option<std::result::Result<Additions, NoSuggestion>>,
}

impl Analysis {
    /// Analyses `schedule`, of which `evaluation` is the evaluation.
    ///
    /// What cannot be explained is absent with its reason: a schedule that could be evaluated can
    /// be analysed.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`](crate::Error::is_input) when the platform cannot execute the schedule.
    pub fn new(
        evaluator: &Evaluator,
        schedule: &Schedule,
        evaluation: &Evaluation,
    ) -> Result<Self> {
        let model = evaluator.model();
        let timeline = Timeline::new(evaluator.test(), schedule)?;
        let observability = &evaluation.observability;
        let p = &evaluation.end.coefficients;
        let (singular_values, weak) = weak_combinations(model, &timeline);
        let solutions = DriftCoefficient::ALL
            .iter()
            .map(|c| {
                let combination = Combination::single(*c);
                Solution::find(model, &timeline, observability, &combination)
            })
            .collect();
        let mut advice = Advice::of_geometry(model, &timeline, observability);
        advice.extend(more_time(evaluator, schedule, evaluation));
        Ok(Self {
            azimuth_order: observability.order_of(&Combination::azimuth()),
            states: states(model, &timeline, observability),
            positions: positions(model, &timeline),
            nearly: Nearly::find(model, &timeline, observability),
            solutions,
            estimate_correlations: strongest(p),
            column_correlations: strongest(&column_gram(model, &timeline)),
            singular_values,
            weak: worst_first(weak, p),
            classical: ClassicalMeasures::new(model, &timeline),
            advice,
            suggestion: Suggestion::find(evaluator, schedule, evaluation),
            remarks: Remark::of(model, evaluation),
            additions: (!model.is_of_the_paper())
                .then(|| Additions::find(evaluator, schedule, evaluation)),
            observability: observability.clone(),
        })
    }
}

/// The combinations with their σ by the filter, which also knows what the prior, the moves and
/// ψ_y tell: the order of the channels alone need not be that of the σ.
fn worst_first(weak: Vec<WeakCombination>, p: &CoefficientMatrix) -> Vec<(WeakCombination, f64)> {
    let mut known: Vec<_> = weak
        .into_iter()
        .map(|w| {
            let sigma = sigma_of(p, &w.combination);
            (w, sigma)
        })
        .collect();
    known.sort_by(|a, b| b.1.total_cmp(&a.1));
    known
}

/// 1σ of a combination of coefficients under the covariance `p`.
fn sigma_of(p: &CoefficientMatrix, combination: &Combination) -> f64 {
    let weights = combination.coefficients();
    weights.dot(&(p * weights)).max(0.0).sqrt()
}

/// The trace's advice: how much more time would help. None where it stays unobservable, or where
/// that cannot be said: a schedule near the longest possible cannot be doubled.
fn more_time(
    evaluator: &Evaluator,
    schedule: &Schedule,
    evaluation: &Evaluation,
) -> Option<Advice> {
    let trace = Combination::input_trace();
    // Of order 1 it is where the azimuth is measured, and as good as the rest.
    let order = evaluation.observability.order_of(&trace)?;
    if order < Order::Second {
        return None;
    }
    let doubled = schedule.positions().iter().map(|p| ScheduledPosition {
        dwell_s: 2.0 * p.dwell_s,
        ..*p
    });
    let doubled = Schedule::new(doubled.collect()).ok()?;
    let timeline = Timeline::new(evaluator.test(), &doubled).ok()?;
    let end = evaluator.model().truth(&timeline).ok()?.end;
    // Of length one, as all combinations that a σ is told of.
    let length = trace.coefficients().norm();
    Some(Advice::MoreTime {
        sigma_deg_per_h: sigma_of(&evaluation.end.coefficients, &trace) / length,
        sigma_at_twice_deg_per_h: sigma_of(&end.coefficients, &trace) / length,
    })
}

/// Orders of the states within one dwell, by the row spaces of Z, Ż and Z̈, and of ψ_y where the azimuth
/// is measured.
pub fn state_orders_of_a_dwell(model: &CovarianceModel) -> [Option<Order>; 8] {
    // Time in units of 1/ω_ie, so that all entries are of the order of one.
    let rate = model.dynamics.rate();
    let f = model.dynamics.system_matrix() / rate;
    let omega_n = model.omega_north() / rate;
    let mut rows: Vec<[f64; 6]> = Vec::new();
    let mut derivatives: Vec<[f64; 6]> = model
        .measured_axes()
        .map(|axis| std::array::from_fn(|j| if j == axis { 1.0 } else { 0.0 }))
        .collect();
    let mut orders = [None; 8];
    for order in [Order::Zero, Order::First, Order::Second] {
        rows.extend(&derivatives);
        let space = RowSpace::of(&rows);
        for (slot, state) in orders.iter_mut().zip(PlatformState::ALL) {
            if slot.is_none() && space.contains(&state.vector(omega_n)) {
                *slot = Some(order);
            }
        }
        // d/dt of h ψ + e ε is h F ψ + h ε.
        derivatives = derivatives
            .iter()
            .map(|row| {
                std::array::from_fn(|j| match j {
                    0..3 => (0..3).map(|i| row[i] * f[(i, j)]).sum(),
                    _ => row[j - 3],
                })
            })
            .collect();
    }
    orders
}

fn states(
    model: &CovarianceModel,
    timeline: &Timeline,
    observability: &Observability,
) -> Vec<StateOrder> {
    let in_a_dwell = state_orders_of_a_dwell(model);
    let azimuth = observability.order_of(&Combination::azimuth());
    let regressor = Regressor::new(model, timeline);
    // The highest order of a row of A over the positions.
    let drift = |axis: usize| {
        let mut highest = Some(Order::Zero);
        let told = |b: &&crate::observability::regressor::RowBlock| b.weights[NORTH] > 0.0;
        for block in regressor.blocks.iter().filter(told) {
            let a = regressor.mounting.drift_matrix(&block.attitude);
            let row = CoefficientVector::from_fn(|j, _| a[(axis, j)]);
            let order = observability.order_of(&Combination::from_weights(&row, 0.0));
            highest = highest.zip(order).map(|(a, b)| a.max(b));
        }
        highest
    };
    let states = PlatformState::ALL.into_iter().zip(in_a_dwell);
    states
        .map(|(state, one_position)| StateOrder {
            state,
            one_position,
            schedule: match state {
                PlatformState::PsiY => azimuth,
                PlatformState::EpsilonX => drift(NORTH),
                PlatformState::EpsilonY => drift(UP),
                PlatformState::EpsilonZ => drift(EAST),
                _ => one_position,
            },
        })
        .collect()
}

/// What each position of the schedule shows by itself.
fn positions(model: &CovarianceModel, timeline: &Timeline) -> Vec<PositionAnalysis> {
    let regressor = Regressor::new(model, timeline);
    let tagged = regressor.tagged(&[Channel::X, Channel::Z, Channel::Y]);
    let mut all = Vec::with_capacity(timeline.legs().len());
    let mut rest = tagged.as_slice();
    for (index, leg) in timeline.legs().iter().enumerate() {
        // Rows come leg by leg.
        let count = rest.iter().take_while(|t| t.leg == index).count();
        let (here, later) = rest.split_at(count);
        rest = later;
        let held: Vec<_> = here
            .iter()
            .filter(|t| t.source == RowSource::Dwell)
            .collect();
        let space = |highest: Order| {
            let rows: Vec<_> = held
                .iter()
                .filter(|t| regressor.order(t.channel) <= highest)
                .map(|t| t.row)
                .collect();
            RowSpace::of(&rows)
        };
        let (first, second) = (space(Order::First), space(Order::Second));
        let order = |c: DriftCoefficient| {
            let vector = *Combination::single(c).as_array();
            if first.contains(&vector) {
                Some(Order::First)
            } else {
                second.contains(&vector).then_some(Order::Second)
            }
        };
        let excited = |c: DriftCoefficient| {
            let shows = |t: &&&crate::observability::regressor::TaggedRow| {
                counts(t.row[c.index()].abs(), 1.0)
            };
            let orders = held
                .iter()
                .filter(shows)
                .map(|t| regressor.order(t.channel));
            orders.min()
        };
        all.push(PositionAnalysis {
            position: leg.position,
            seen: held
                .iter()
                .map(|t| (t.channel, Combination::from_array(t.row)))
                .collect(),
            orders: DriftCoefficient::ALL.map(order),
            excited: DriftCoefficient::ALL.map(excited),
        });
    }
    // Start and return are no positions of the schedule.
    all.drain(timeline.positions()).collect()
}

/// Gram matrix of the weighted regressor's columns.
fn column_gram(model: &CovarianceModel, timeline: &Timeline) -> CoefficientMatrix {
    let mut gram = CoefficientMatrix::zeros();
    for row in Regressor::new(model, timeline).weighted(&Channel::ALL) {
        let row = CoefficientVector::from_fn(|j, _| row[j]);
        gram.ger(1.0, &row, &row, 1.0);
    }
    gram
}

/// The strongest correlations of a covariance or Gram matrix.
fn strongest(matrix: &CoefficientMatrix) -> Vec<CorrelatedPair> {
    let mut pairs = Vec::new();
    for (i, a) in DriftCoefficient::ALL.into_iter().enumerate() {
        for b in DriftCoefficient::ALL.into_iter().skip(i + 1) {
            let size = (matrix[(i, i)] * matrix[(b.index(), b.index())]).sqrt();
            let correlation = matrix[(i, b.index())] / size;
            // A coefficient known exactly, or not excited, is correlated with nothing.
            if size > 0.0 && correlation.abs() > 1e-9 {
                pairs.push(CorrelatedPair { a, b, correlation });
            }
        }
    }
    pairs.sort_by(|x, y| y.correlation.abs().total_cmp(&x.correlation.abs()));
    pairs.truncate(LISTED);
    pairs
}
