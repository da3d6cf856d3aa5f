//! The square root of the filter's covariance: P = Uᵀ U with U upper triangular, states in the
//! order (D, d, b, ψ^n), D all estimated parameters, d and b what wanders of drift and biases, if
//! anything does ([`super::wander`]).
//!
//! With the constants D first, a time update touches the columns behind them only. Where nothing
//! wanders these are three, and the retriangularisation is one of 6 × 3; a scalar measurement is one
//! sweep of Givens rotations.
//! Nothing is subtracted, so P is positive semi-definite whatever the rounding does; a
//! parameter with prior σ = 0 keeps an exact zero row.
//!
//! # What the filter does not know of
//!
//! A considered parameter c moves the platform and what is measured, and the filter takes it for
//! something else. Its error per 1σ of c follows from the filter's own gains K: S ← Φ S + B_c σ_c over
//! an interval, S ← S − K (h S + h_c σ_c) with a measurement. The true covariance of the filter's
//! error is P + Σ_c S Sᵀ ([`Knowledge::truth`]).

use nalgebra::{DMatrix, Matrix3, SMatrix, Vector3};

use crate::drift::COEFFICIENTS;

use super::channels::Channel;
use super::states::{Drive, Fading, LinearTransition, Shape};

/// The gain of one scalar measurement, the 1σ of its innovation as the filter has it, and what 1σ of
/// each considered parameter adds to that.
#[derive(Debug, Clone)]
pub(super) struct ScalarGain {
    pub gain: Vec<f64>,
    pub innovation_sigma: f64,
    pub by_considered: Vec<f64>,
}

/// NEES of a state error with the degrees of freedom (fewer than the states when something is known
/// exactly): eᵀ P⁻¹ e of the twelve coefficients, of all estimated parameters, and of all states.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Nees {
    pub coefficients: f64,
    pub coefficient_dof: usize,
    pub parameters: f64,
    pub parameter_dof: usize,
    pub states: f64,
    pub state_dof: usize,
}

/// U of P = Uᵀ U.
#[derive(Debug, Clone)]
pub(super) struct SquareRoot {
    shape: Shape,
    states: usize,
    /// Row by row.
    u: Vec<f64>,
}

impl SquareRoot {
    /// A diagonal covariance of these 1σ.
    pub fn diagonal(sigma: &[f64], shape: Shape) -> Self {
        let states = shape.states();
        let mut u = vec![0.0; states * states];
        for (i, s) in sigma.iter().enumerate() {
            u[i * states + i] = *s;
        }
        Self { shape, states, u }
    }

    /// Index of ψ^n's first component.
    fn psi(&self) -> usize {
        self.shape.psi()
    }

    fn row(&self, k: usize) -> &[f64] {
        &self.u[k * self.states..(k + 1) * self.states]
    }

    fn row_mut(&mut self, k: usize) -> &mut [f64] {
        &mut self.u[k * self.states..(k + 1) * self.states]
    }

    /// ψ ← Φ ψ + B D + noise of `variance` per axis; without B, ψ ← Φ ψ + noise.
    fn predict(&mut self, phi: &Matrix3<f64>, b: Option<&Drive>, variance: f64) {
        let psi = self.psi();
        for k in 0..psi {
            let row = self.row_mut(k);
            let moved = driven(phi, b, row, k..psi);
            row[psi..].copy_from_slice(moved.as_slice());
        }
        let mut stacked = SMatrix::<f64, 6, 3>::zeros();
        for k in 0..3 {
            let row = self.row(psi + k);
            let moved = driven(phi, None, row, psi..psi);
            stacked.set_row(k, &moved.transpose());
            stacked[(3 + k, k)] = variance.sqrt();
        }
        let r = stacked.qr().r();
        for k in 0..3 {
            for j in 0..3 {
                self.row_mut(psi + k)[psi + j] = r[(k, j)];
            }
        }
    }

    /// The same where what wanders goes on: it fades, and noise comes to it and with it to ψ.
    fn predict_wandering(
        &mut self,
        LinearTransition { phi, b, .. }: &LinearTransition,
        fading: &Fading,
        variance: f64,
    ) {
        let (first, psi) = (self.shape.parameters, self.psi());
        for k in 0..self.states {
            let row = self.row_mut(k);
            let moved = driven(phi, Some(b), row, k.min(psi)..psi);
            fading.fade(&mut row[first..psi]);
            row[psi..].copy_from_slice(moved.as_slice());
        }
        let (block, noises) = (self.states - first, fading.noise.nrows());
        let mut stacked = DMatrix::zeros(block + noises + 3, block);
        for k in 0..block {
            let row = &self.row(first + k)[first..];
            stacked.row_mut(k).copy_from_slice(row);
        }
        stacked
            .view_mut((block, 0), (noises, block))
            .copy_from(&fading.noise);
        for k in 0..3 {
            stacked[(block + noises + k, block - 3 + k)] = variance.sqrt();
        }
        let r = stacked.qr().r();
        for k in 0..block {
            for j in 0..block {
                self.row_mut(first + k)[first + j] = r[(k, j)];
            }
        }
    }

    /// The covariance of (D, ψ^n), D_F with what has walked or without.
    fn without_wandering(&self, with_walk: bool) -> Self {
        if self.shape.wandering == 0 {
            return self.clone();
        }
        let shape = Shape {
            has_walk: self.shape.has_walk && with_walk,
            ..self.shape
        };
        let own = Shape {
            wandering: 0,
            has_walk: false,
            ..shape
        };
        let rows = (0..self.states).flat_map(|k| shape.reported(self.row(k)));
        let r = DMatrix::from_row_iterator(self.states, own.states(), rows)
            .qr()
            .r();
        Self {
            shape: own,
            states: own.states(),
            u: r.transpose().as_slice().to_vec(),
        }
    }

    /// Takes a measurement; gives its gain and the 1σ of its innovation.
    fn update(&mut self, channel: &Channel) -> (Vec<f64>, f64) {
        // Rows [s mᵀ] and [f_k U_k]: rotating f_k to zero from the last row upwards keeps U
        // triangular, for m is then zero before column k.
        let states = self.states;
        let mut m = vec![0.0; states];
        let mut s = channel.noise;
        for k in (0..states).rev() {
            let row = self.row_mut(k);
            let f = channel.seen_of(row, k);
            if f == 0.0 {
                continue;
            }
            let rho = libm::hypot(s, f);
            let (cos, sin) = (s / rho, f / rho);
            for j in k..states {
                let (a, b) = (m[j], row[j]);
                m[j] = cos * a + sin * b;
                row[j] = cos * b - sin * a;
            }
            s = rho;
        }
        m.iter_mut().for_each(|v| *v /= s);
        (m, s)
    }

    /// P ← P + v vᵀ.
    fn add(&mut self, v: &[f64]) {
        let mut v = v.to_vec();
        for k in 0..self.states {
            let row = self.row_mut(k);
            if v[k] == 0.0 {
                continue;
            }
            let rho = libm::hypot(row[k], v[k]);
            let (cos, sin) = (row[k] / rho, v[k] / rho);
            for j in k..v.len() {
                let (a, b) = (row[j], v[j]);
                row[j] = cos * a + sin * b;
                v[j] = cos * b - sin * a;
            }
        }
    }

    /// 1σ of what is reported: the parameters and ψ^n ([`Shape::reported`]).
    pub fn sigma(&self) -> Vec<f64> {
        let mut variances = vec![0.0; self.shape.parameters + 3];
        for k in 0..self.states {
            let row = self.shape.reported(self.row(k));
            variances.iter_mut().zip(row).for_each(|(v, u)| *v += u * u);
        }
        variances.into_iter().map(f64::sqrt).collect()
    }

    /// Covariance of ψ^n.
    pub fn misalignment_covariance(&self) -> Matrix3<f64> {
        let psi = self.psi();
        Matrix3::from_fn(|i, j| {
            (0..self.states)
                .map(|k| self.row(k)[psi + i] * self.row(k)[psi + j])
                .sum()
        })
    }

    /// The normalised estimation error squared of the `error` of all states. What wanders counts among
    /// the states; the coefficients are those that are reported.
    pub fn nees(&self, error: &[f64]) -> Nees {
        let all = self.squares(error);
        match self.shape.wandering {
            0 => all,
            _ => Nees {
                states: all.states,
                state_dof: all.state_dof,
                ..self
                    .without_wandering(true)
                    .squares(&self.shape.reported(error))
            },
        }
    }

    /// The same of (D, ψ^n) alone, D_F without what has walked: `states` is of these.
    pub fn nees_without_wandering(&self, error: &[f64]) -> Nees {
        let shape = Shape {
            has_walk: false,
            ..self.shape
        };
        let reported = shape.reported(error);
        self.without_wandering(false).squares(&reported)
    }

    fn squares(&self, error: &[f64]) -> Nees {
        let mut nees = Nees::default();
        // Uᵀ y = e by forward substitution; the first rows are those of D alone.
        let mut y = vec![0.0; self.states];
        for k in 0..self.states {
            let own = self.row(k)[k];
            if own == 0.0 {
                continue;
            }
            let known: f64 = (0..k).map(|i| self.row(i)[k] * y[i]).sum();
            y[k] = (error[k] - known) / own;
            let square = y[k] * y[k];
            nees.states += square;
            nees.state_dof += 1;
            if k < self.shape.parameters {
                nees.parameters += square;
                nees.parameter_dof += 1;
            }
            if k < COEFFICIENTS {
                nees.coefficients += square;
                nees.coefficient_dof += 1;
            }
        }
        nees
    }
}

/// Φ ψ + B D of a state, D among `known` alone.
fn driven(
    phi: &Matrix3<f64>,
    b: Option<&Drive>,
    state: &[f64],
    known: std::ops::Range<usize>,
) -> Vector3<f64> {
    let psi = state.len() - 3;
    let mut moved = phi * Vector3::new(state[psi], state[psi + 1], state[psi + 2]);
    if let Some(b) = b {
        for j in known {
            moved += b.column(j) * state[j];
        }
    }
    moved
}

/// What a filter knows, and what it does not know that it does not.
#[derive(Debug, Clone)]
pub(super) struct Knowledge {
    root: SquareRoot,
    /// Prior 1σ of the considered parameters.
    considered_sigma: Vec<f64>,
    /// What 1σ of each does to the error of every state.
    by_considered: Vec<Vec<f64>>,
}

impl Knowledge {
    /// As before the test.
    pub fn new(prior_sigma: &[f64], considered_sigma: &[f64], shape: Shape) -> Self {
        Self {
            root: SquareRoot::diagonal(prior_sigma, shape),
            considered_sigma: considered_sigma.to_vec(),
            by_considered: vec![vec![0.0; prior_sigma.len()]; considered_sigma.len()],
        }
    }

    /// The filter's own covariance.
    pub fn claimed(&self) -> &SquareRoot {
        &self.root
    }

    /// The true covariance of its error.
    pub fn truth(&self) -> SquareRoot {
        let mut truth = self.root.clone();
        self.by_considered.iter().for_each(|s| truth.add(s));
        truth
    }

    /// ψ ← Φ ψ + B D + noise of `variance` per axis; B has columns of all parameters.
    pub fn predict(&mut self, step: &LinearTransition, variance: f64) {
        let LinearTransition { phi, b, fading } = step;
        match fading {
            Some(fading) => self.root.predict_wandering(step, fading, variance),
            None => self.root.predict(phi, Some(b), variance),
        }
        let (first, psi) = (self.root.shape.parameters, self.root.psi());
        let considered = self.by_considered.iter_mut().zip(&self.considered_sigma);
        for (c, (error, sigma)) in considered.enumerate() {
            let moved = driven(phi, Some(b), error, 0..psi) + b.column(psi + c) * *sigma;
            if let Some(fading) = fading {
                fading.fade(&mut error[first..psi]);
            }
            error[psi..].copy_from_slice(moved.as_slice());
        }
    }

    /// ψ ← X ψ: a change of the frame.
    pub fn turn(&mut self, x: &Matrix3<f64>) {
        self.root.predict(x, None, 0.0);
        for error in &mut self.by_considered {
            let psi = error.len() - 3;
            let turned = driven(x, None, error, psi..psi);
            error[psi..].copy_from_slice(turned.as_slice());
        }
    }

    /// Takes a measurement.
    pub fn update(&mut self, channel: &Channel) -> ScalarGain {
        let (gain, innovation_sigma) = self.root.update(channel);
        let psi = self.root.psi();
        let considered = self.by_considered.iter_mut().zip(&self.considered_sigma);
        let by_considered = considered
            .enumerate()
            .map(|(c, (error, sigma))| {
                let seen = channel.seen_of(error, 0) + channel.of_parameter(psi + c) * sigma;
                for (e, k) in error.iter_mut().zip(&gain) {
                    *e -= k * seen;
                }
                seen
            })
            .collect();
        ScalarGain {
            gain,
            innovation_sigma,
            by_considered,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// Estimated parameters.
    const KNOWN: usize = 14;
    const STATES: usize = KNOWN + 3;
    const SHAPE: Shape = Shape {
        parameters: KNOWN,
        wandering: 0,
        has_walk: false,
    };

    fn dense(root: &SquareRoot) -> DMatrix<f64> {
        let u = DMatrix::from_fn(STATES, STATES, |i, j| root.row(i)[j]);
        u.transpose() * u
    }

    fn step(columns: usize) -> LinearTransition {
        LinearTransition {
            phi: Matrix3::new(0.9, 0.1, -0.2, 0.05, 1.0, 0.3, 0.1, -0.3, 0.95),
            b: Drive::from_fn(columns, |i, j| ((2 * i + 7 * j) as f64).sin()),
            fading: None,
        }
    }

    /// Alternately two channels, the second of which sees parameters too.
    fn channel(round: usize) -> Channel {
        match round % 2 {
            0 => Channel::new([0.0, 0.0, 1.0], Vec::new(), 0.7),
            _ => Channel::new(
                [-1.0, 0.0, 0.2],
                vec![(12, 0.5), (13, -2.0), (15, 3.0)],
                0.7,
            ),
        }
    }

    /// Parameters 14 and 15 are considered: the filter's error covariance is carried as it is, with its
    /// gains in it.
    #[test]
    fn agrees_with_the_textbook_filter_and_its_error() {
        let sigma: Vec<f64> = (0..STATES).map(|i| 1.0 + 0.3 * i as f64).collect();
        let considered = [0.8, 1.7];
        let mut knowledge = Knowledge::new(&sigma, &considered, SHAPE);
        // Of (states, considered).
        let all: Vec<f64> = sigma.iter().chain(&considered).map(|s| s * s).collect();
        let mut truth = DMatrix::from_diagonal(&DVector::from(all));
        let mut p = dense(&knowledge.root);
        let step = step(KNOWN + 2);
        for round in 0..20 {
            knowledge.predict(&step, 0.25);
            let mut f = DMatrix::identity(STATES + 2, STATES + 2);
            f.view_mut((KNOWN, KNOWN), (3, 3)).copy_from(&step.phi);
            f.view_mut((KNOWN, 0), (3, KNOWN))
                .copy_from(&step.b.columns(0, KNOWN));
            f.view_mut((KNOWN, STATES), (3, 2))
                .copy_from(&step.b.columns(KNOWN, 2));
            let own = f.view((0, 0), (STATES, STATES)).into_owned();
            p = &own * p * own.transpose();
            truth = &f * truth * f.transpose();
            for i in KNOWN..STATES {
                p[(i, i)] += 0.25;
                truth[(i, i)] += 0.25;
            }
            let channel = channel(round);
            let mut h = DVector::zeros(STATES + 2);
            h.rows_mut(KNOWN, 3).copy_from_slice(&channel.psi);
            for k in 0..KNOWN + 2 {
                let at = if k < KNOWN { k } else { STATES + k - KNOWN };
                h[at] = channel.of_parameter(k);
            }
            let seen = h.rows(0, STATES).into_owned();
            let found = knowledge.update(&channel);
            let ph = &p * &seen;
            let s = seen.dot(&ph) + 0.49;
            assert!((found.innovation_sigma - s.sqrt()).abs() < 1e-10);
            let gain = &ph / s;
            assert!((DVector::from(found.gain) - &gain).amax() < 1e-10);
            p -= &ph * ph.transpose() / s;
            let mut update = DMatrix::identity(STATES + 2, STATES + 2);
            let mut top = update.rows_mut(0, STATES);
            top -= &gain * h.transpose();
            truth = &update * truth * update.transpose();
            let mut top = truth.view_mut((0, 0), (STATES, STATES));
            top += &gain * gain.transpose() * 0.49;
        }
        assert!((dense(knowledge.claimed()) - &p).amax() < 1e-9);
        let truth = truth.view((0, 0), (STATES, STATES)).into_owned();
        assert!((dense(&knowledge.truth()) - &truth).amax() < 1e-9);
        assert!((&truth - &p).amax() > 1.0);
        let e: Vec<f64> = (0..STATES).map(|i| (i as f64).cos()).collect();
        let v = DVector::from(e.clone());
        for (root, covariance) in [(knowledge.claimed(), p), (&knowledge.truth(), truth)] {
            let nees = root.nees(&e);
            let of = |count: usize| {
                let part = covariance.view((0, 0), (count, count)).into_owned();
                let error = v.rows(0, count).into_owned();
                error.dot(&(part.try_inverse().unwrap() * &error))
            };
            for (found, count) in [
                (nees.states, STATES),
                (nees.parameters, KNOWN),
                (nees.coefficients, COEFFICIENTS),
            ] {
                assert!((found / of(count) - 1.0).abs() < 1e-6, "{count}");
            }
            let dof = (nees.state_dof, nees.parameter_dof, nees.coefficient_dof);
            assert_eq!(dof, (STATES, KNOWN, COEFFICIENTS));
        }
    }

    #[test]
    fn what_is_known_exactly_stays_known() {
        let mut sigma = [2.0; STATES];
        sigma[3] = 0.0;
        let mut knowledge = Knowledge::new(&sigma, &[1.0, 0.0], SHAPE);
        for _ in 0..5 {
            knowledge.predict(&step(KNOWN + 2), 0.1);
            knowledge.update(&channel(0));
        }
        for root in [knowledge.claimed(), &knowledge.truth()] {
            assert_eq!(root.sigma()[3], 0.0);
            assert_eq!(root.nees(&[0.1; STATES]).state_dof, STATES - 1);
        }
    }
}
