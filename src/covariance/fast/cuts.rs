//! A schedule cut between its positions, so that changing one of them costs one dwell, not K.
//!
//! Before a cut the chain is in a state (V, P) with information E on D. What the rest of the
//! test tells about (ψ^n, D) at the cut is, after eliminating its noise, three rows
//! `R ψ^n + S D` of unit noise and information E' on D alone: a [`Rest`]. Both together:
//!
//! ```text
//! T = R V + S,   E_total = E + E' + Tᵀ (I + R P Rᵀ)⁻¹ T,
//! ```
//!
//! the same form as a dwell of the [`chain`](crate::covariance::chain). Backwards through an interval
//! ψ^n ← Φ ψ^n + B D + ζ, ζ ~ N(0, C), the rows become W (R Φ ψ^n + (R B + S) D) with the whitener
//! W of I + R C Rᵀ; through a measurement they are stacked with its rows and triangularised in
//! ψ^n, and what is left without ψ^n goes to E'.
//!
//! The derivatives of E_total's merit with respect to V and P at a cut follow from the same
//! rows, and with them the exact **directional derivative** of inserting a position there:
//! [`Cut::insertion`].

use std::ops::Range;

use nalgebra::{Matrix3, SMatrix};

use super::several::between::Between;
use crate::attitude::{EAST, NORTH};
use crate::covariance::chain::{
    InformationSink, Measured, Passage, Recorder, State, Step, measurement_root,
};
use crate::covariance::rows::{Rows, Told, Whitened};
use crate::covariance::small::{square_root, whitener};
use crate::covariance::{CoefficientCovariance, CovarianceModel, Rooted, Slope, TickRule};
use crate::drift::{CoefficientMatrix, CoefficientVector, DriftMatrix, times_drift_matrix};
use crate::error::Result;
use crate::motion::{Leg, Timeline};

/// What the rest of a test tells about (ψ^n, D) at a cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rest {
    /// R: of three rows, what multiplies ψ^n.
    psi: Matrix3<f64>,
    /// S: of three rows, what multiplies D.
    drift: DriftMatrix,
    /// E': information on D alone.
    information: CoefficientMatrix,
    /// Its triangle of rows, in units of the prior σ; up to date at the cuts.
    triangle: CoefficientMatrix,
}

/// Information on D as a sum of squares, and as rows for where that loses digits.
struct Both {
    gram: CoefficientMatrix,
    rows: Rows,
}

impl Both {
    fn nothing(prior_sigma: &CoefficientVector) -> Self {
        Self {
            gram: CoefficientMatrix::zeros(),
            rows: Rows::new(prior_sigma),
        }
    }

    fn now(&mut self) -> Known {
        Known {
            gram: self.gram,
            triangle: self.rows.triangle(),
        }
    }
}

impl InformationSink for Both {
    fn add(&mut self, rows: &DriftMatrix) {
        self.gram.gemm_tr(1.0, rows, rows, 1.0);
        self.rows.add(rows);
    }
}

/// Information on D at a cut: E, and its triangle of rows in units of the prior σ.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Known {
    gram: CoefficientMatrix,
    triangle: CoefficientMatrix,
}

impl Known {
    fn nothing() -> Self {
        Self {
            gram: CoefficientMatrix::zeros(),
            triangle: CoefficientMatrix::zeros(),
        }
    }
}

impl Rest {
    /// Nothing follows.
    pub fn nothing() -> Self {
        Self {
            psi: Matrix3::zeros(),
            drift: DriftMatrix::zeros(),
            information: CoefficientMatrix::zeros(),
            triangle: CoefficientMatrix::zeros(),
        }
    }

    /// The rows `psi ψ^n + drift D` and `information` on D alone.
    pub fn of(psi: &Matrix3<f64>, drift: &DriftMatrix, information: &CoefficientMatrix) -> Self {
        Self {
            psi: *psi,
            drift: *drift,
            information: *information,
            triangle: CoefficientMatrix::zeros(),
        }
    }

    /// R, S and E'.
    pub fn parts(&self) -> (&Matrix3<f64>, &DriftMatrix, &CoefficientMatrix) {
        (&self.psi, &self.drift, &self.information)
    }

    /// Back through ψ^n ← Φ ψ^n + B D + ζ, ζ ~ N(0, C).
    pub fn through(&mut self, phi: &Matrix3<f64>, b: &DriftMatrix, noise: &Matrix3<f64>) {
        let w = whitener(&(self.psi * square_root(noise)));
        self.drift = w * (self.psi * b + self.drift);
        self.psi = w * self.psi * phi;
    }

    /// With three more rows `psi ψ^n + drift D`, what they tell of D alone added to E'.
    pub fn with_rows(&mut self, psi: &Matrix3<f64>, drift: &DriftMatrix) {
        let alone = self.folded(psi, drift);
        self.information.gemm_tr(1.0, &alone, &alone, 1.0);
    }

    /// The same, but what they tell of D alone is added to `known`.
    fn with_rows_and(&mut self, psi: &Matrix3<f64>, drift: &DriftMatrix, known: &mut Both) {
        known.add(&self.folded(psi, drift));
    }

    /// Takes three more rows `psi ψ^n + drift D` up into the three that are held, and gives the
    /// three that are left: those of D alone.
    fn folded(&mut self, psi: &Matrix3<f64>, drift: &DriftMatrix) -> DriftMatrix {
        let mut rows = SMatrix::<f64, 6, 15>::zeros();
        rows.fixed_view_mut::<3, 3>(0, 0).copy_from(psi);
        rows.fixed_view_mut::<3, 12>(0, 3).copy_from(drift);
        rows.fixed_view_mut::<3, 3>(3, 0).copy_from(&self.psi);
        rows.fixed_view_mut::<3, 12>(3, 3).copy_from(&self.drift);
        triangularise(&mut rows);
        self.psi = rows.fixed_view::<3, 3>(0, 0).into_owned();
        self.drift = rows.fixed_view::<3, 12>(0, 3).into_owned();
        rows.fixed_view::<3, 12>(3, 3).into_owned()
    }

    /// With more information on D alone.
    pub fn add_to_information(&mut self, more: &CoefficientMatrix) {
        self.information += more;
    }

    /// With the information `known` on D alone.
    fn with(mut self, known: Known) -> Self {
        self.information = known.gram;
        self.triangle = known.triangle;
        self
    }
}

/// Householder reflections that make the first three columns upper triangular.
fn triangularise(rows: &mut SMatrix<f64, 6, 15>) {
    for column in 0..3 {
        let mut v = [0.0; 6];
        let mut norm2 = 0.0;
        for row in column..6 {
            v[row] = rows[(row, column)];
            norm2 += v[row] * v[row];
        }
        if norm2 == 0.0 {
            continue;
        }
        let pivot = v[column];
        v[column] += norm2.sqrt().copysign(pivot);
        let scale = 2.0 / (norm2 - pivot * pivot + v[column] * v[column]);
        for j in column..15 {
            let dot: f64 = (column..6).map(|i| v[i] * rows[(i, j)]).sum();
            for i in column..6 {
                rows[(i, j)] -= scale * dot * v[i];
            }
        }
        for row in column + 1..6 {
            rows[(row, column)] = 0.0;
        }
    }
}

/// A timeline with the state before and the rest after every dwell and every move.
#[derive(Debug)]
pub(crate) struct Cuts<'a> {
    model: &'a CovarianceModel,
    rule: TickRule,
    legs: &'a [Leg],
    /// Before the dwell of each leg, after its arrival.
    before_dwell: Vec<(State, Known)>,
    /// After the dwell of each leg.
    after_dwell: Vec<(State, Known)>,
    /// From the dwell of each leg on.
    rest: Vec<Rest>,
}

/// Information that nobody wants.
struct Ignored;

impl InformationSink for Ignored {
    fn add(&mut self, _: &DriftMatrix) {}
}

/// Remembers which steps a chain takes.
#[derive(Default)]
struct Steps(Vec<(usize, Step)>);

impl Recorder for Steps {
    fn record(&mut self, leg: usize, step: Step) {
        self.0.push((leg, step));
    }
}

impl<'a> Cuts<'a> {
    /// Cuts `timeline` before and after every dwell, at the cost of two runs through it.
    pub fn new(model: &'a CovarianceModel, timeline: &'a Timeline, rule: TickRule) -> Self {
        let legs = timeline.legs();
        let mut cuts = Self {
            model,
            rule,
            legs,
            before_dwell: Vec::with_capacity(legs.len()),
            after_dwell: Vec::with_capacity(legs.len()),
            rest: vec![Rest::nothing(); legs.len()],
        };
        let (mut state, mut known) = (model.start_state(), Both::nothing(&model.prior_sigma));
        for (k, leg) in legs.iter().enumerate() {
            if k > 0 {
                let before = &legs[k - 1].attitude;
                state = model.arrive(state, (before, leg), rule, &mut known);
            }
            cuts.before_dwell.push((state, known.now()));
            state = model.dwell(state, leg, rule, &mut known);
            cuts.after_dwell.push((state, known.now()));
        }
        cuts.go_back(timeline);
        cuts
    }

    fn go_back(&mut self, timeline: &Timeline) {
        let mut steps = Steps::default();
        self.model
            .run(timeline, self.rule, &mut Ignored, &mut steps);
        let (mut rest, mut known) = (Rest::nothing(), Both::nothing(&self.model.prior_sigma));
        let mut steps = steps.0.into_iter().rev().peekable();
        for leg in (0..self.legs.len()).rev() {
            let in_dwell = |step: &Step| {
                matches!(
                    step,
                    Step::Dwell { .. }
                        | Step::Pass {
                            passage: Passage::Remainder,
                            ..
                        }
                        | Step::Measure {
                            of: Measured::Dwell,
                            ..
                        }
                )
            };
            while let Some((_, step)) = steps.next_if(|(l, step)| *l == leg && in_dwell(step)) {
                self.back(&mut rest, &mut known, leg, step);
            }
            self.rest[leg] = rest.with(known.now());
            while let Some((_, step)) = steps.next_if(|(l, _)| *l == leg) {
                self.back(&mut rest, &mut known, leg, step);
            }
        }
    }

    fn back(&self, rest: &mut Rest, known: &mut Both, leg: usize, step: Step) {
        let (model, l) = (self.model, &self.legs[leg]);
        match step {
            Step::Dwell { periods } => {
                let k = model.kernels.kernel(periods);
                let a = |m: &Matrix3<f64>| times_drift_matrix(m, &l.attitude);
                rest.through(&k.a_psi, &a(&k.a_epsilon), &k.c);
                rest.with_rows_and(&k.r11, &a(&k.r12), known);
                known.add(&a(&k.r22));
            }
            Step::Pass { passage, length_s } => {
                let dynamics = &model.dynamics;
                let b = match (passage, &l.arrival) {
                    (Passage::Moving { start_s }, Some(m)) => {
                        m.drift_integral(&model.stand, dynamics, start_s, length_s)
                    }
                    _ => times_drift_matrix(&dynamics.integral(length_s), &l.attitude),
                };
                let noise = Matrix3::identity() * (model.drift_psd * length_s);
                rest.through(&dynamics.transition(length_s), &b, &noise);
            }
            Step::Measure { weight, .. } => {
                rest.with_rows_and(&measurement_root(weight), &DriftMatrix::zeros(), known);
            }
            Step::Rotate => {
                let q = l.attitude.matrix() * self.legs[leg - 1].attitude.matrix().transpose();
                rest.psi *= q;
            }
        }
    }

    /// What comes before the legs `replaced`, and after the arrival at the leg that follows them, if
    /// one does. What is put between them are the legs in their place and that arrival: the move
    /// starts at the last of them.
    pub fn around(&self, replaced: Range<usize>) -> Between {
        let (state, before) = self.state_before(replaced.start);
        let from = replaced.start.checked_sub(1);
        let from = from.map(|k| self.legs[k].attitude);
        match self.rest.get(replaced.end) {
            None => Between::new(&state, from, (&before.gram, before.triangle), None),
            Some(rest) => Between::new(
                &state,
                from,
                (
                    &(before.gram + rest.information),
                    self.together([&before.triangle, &rest.triangle]).triangle(),
                ),
                Some((&rest.psi, &rest.drift)),
            ),
        }
    }

    fn together(&self, triangles: [&CoefficientMatrix; 2]) -> Rows {
        let mut rows = Rows::new(&self.model.prior_sigma);
        triangles.into_iter().for_each(|r| rows.add_triangle(r));
        rows
    }

    /// The state in which leg `leg` begins, with the information collected until then.
    fn state_before(&self, leg: usize) -> (State, Known) {
        match leg.checked_sub(1) {
            Some(k) => self.after_dwell[k],
            None => (self.model.start_state(), Known::nothing()),
        }
    }

    /// What a position inserted before (`leg` = index of the leg it would come before) is worth by
    /// a figure of merit of P_D.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows; what
    /// `merit` returns.
    pub fn insertion(
        &self,
        leg: usize,
        merit: impl Fn(&dyn CoefficientCovariance) -> Result<(f64, Slope)>,
    ) -> Result<Insertion> {
        let ((state, known), rest) = match self.rest.get(leg) {
            Some(rest) => (self.before_dwell[leg], *rest),
            None => (self.state_before(self.legs.len()), Rest::nothing()),
        };
        Insertion::new(self.model, &state, &known, &rest, merit)
    }
}

/// Derivative of the merit with respect to the time spent, at a cut, in any attitude.
///
/// For a short time dt at A = A(C): dV = (F V + A − P HᵀH V w) dt,
/// dP = (F P + P Fᵀ + q I − P HᵀH P w) dt and dE = Vᵀ HᵀH V w dt, w = 1/(period · r²) the
/// information of the measurements per second. With the adjoints of V and P at the cut,
/// V̄ = 2 Rᵀ S⁻¹ T Ē and P̄ = −Rᵀ S⁻¹ T Ē Tᵀ S⁻¹ R, the attitude enters through ⟨V̄, A⟩ alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Insertion {
    /// What any attitude gives, per s.
    constant: f64,
    /// V̄.
    v_adjoint: DriftMatrix,
}

impl Insertion {
    fn new(
        model: &CovarianceModel,
        State { v, p }: &State,
        known: &Known,
        rest: &Rest,
        merit: impl Fn(&dyn CoefficientCovariance) -> Result<(f64, Slope)>,
    ) -> Result<Self> {
        let t = rest.psi * v + rest.drift;
        let w = whitener(&(rest.psi * square_root(p)));
        let whitened_t = w * t;
        // Ē times the rows that come of the rest, and times those of ψ_x and ψ_z seen here, which
        // do not count yet.
        let told = |rows: &DriftMatrix, scale: f64| {
            let row = |i: usize| std::array::from_fn(|j| rows[(i, j)]);
            [0, 1, 2].map(|i| Told::new(&row(i), scale, &model.prior_sigma))
        };
        let (of_rest, of_psi) = (told(&whitened_t, 1.0), told(v, 0.0));
        let others = [&known.triangle, &rest.triangle].into_iter().flat_map(|r| {
            r.row_iter().map(|row| Told {
                row: std::array::from_fn(|j| row[j]),
                scale: 1.0,
            })
        });
        let all: Vec<Told> = of_rest.into_iter().chain(of_psi).chain(others).collect();
        let whitened = Whitened::new(&all, &model.prior_sigma)?;
        let of = Rooted::new(whitened.root.clone());
        let (_, slope) = merit(&of)?;
        let pulled = whitened.times_adjoint(&slope.in_root(&of));
        let pulled = |first: usize| DriftMatrix::from_fn(|i, j| pulled[first + i][j]);
        let s_inv_t = w.transpose() * whitened_t;
        let s_inv_t_e = w.transpose() * pulled(0);
        let psi_e = pulled(3);
        let v_adjoint = rest.psi.transpose() * s_inv_t_e * 2.0;
        let p_adjoint = -(rest.psi.transpose() * (s_inv_t_e * s_inv_t.transpose()) * rest.psi);
        let weight = 1.0 / (model.period_s * model.noise_variance);
        let f = model.dynamics.system_matrix();
        let mut seen = Matrix3::zeros();
        seen[(NORTH, NORTH)] = weight;
        seen[(EAST, EAST)] = weight;
        let gain = p * seen;
        let fp = f * p;
        let v_rate = f * v - gain * v;
        let p_rate = fp + fp.transpose() + Matrix3::identity() * model.drift_psd - gain * p;
        let through_e = (seen * psi_e).dot(v);
        Ok(Self {
            constant: v_adjoint.dot(&v_rate) + p_adjoint.dot(&p_rate) + through_e,
            v_adjoint,
        })
    }

    /// The derivative at an attitude with drift matrix A, per s.
    pub fn at(&self, drift_matrix: &DriftMatrix) -> f64 {
        self.constant + self.v_adjoint.dot(drift_matrix)
    }
}

#[cfg(test)]
mod tests;
