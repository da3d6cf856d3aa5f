//! Time that passes without a measurement, where drift or biases wander.
//!
//! A process d with d at the end = e^{−λt} d + noise (λ = 0 for a random walk) drives ψ^n,
//!
//! ```text
//! ψ ← Φ ψ + M d + …,   M = ∫ Φ(t_1 − t) C(t) e^{−λ(t − t_0)} dt,
//! Q_dd = g² ∫ e^{−2λ(t_1 − s)} ds,   Q_ψd = g² ∫ N(s) e^{−λ(t_1 − s)} ds,   Q_ψψ = g² ∫ N(s) N(s)ᵀ ds,
//! N(s) = ∫_s^{t_1} Φ(t_1 − t) C(t) e^{−λ(t − s)} dt,
//! ```
//!
//! g² the PSD of the noise that drives it. At a position the process is taken in n (δ^n, C = I), and all
//! this is power series in time, in any numbers. In a move it is taken in the platform, and integrated by
//! Gauss's rule in panels, N by integrating the polynomial through its nodes; in doubles.

use std::sync::LazyLock;

use nalgebra::{DMatrix, Matrix3};

use super::Layout;
use crate::attitude::Stand;
use crate::covariance::real::Real;
use crate::dynamics::ErrorDynamics;
use crate::model::{Colour, Markov};
use crate::motion::Move;
use crate::motion::integral::{eight_nodes, sixteen_nodes};

/// A process that each of three instruments has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Process {
    /// A random walk: the variance by which it grows in a second.
    Walk(f64),
    /// A first-order Gauss–Markov process.
    Markov(Markov),
}

impl Process {
    pub(super) fn of(colour: &Colour) -> Vec<Self> {
        let walk = colour.random_walk.map(Self::Walk);
        let markov = colour.markov.map(Self::Markov);
        walk.into_iter().chain(markov).collect()
    }

    /// λ = 1/τ.
    pub fn decay<T: Real>(self) -> T {
        match self {
            Self::Walk(_) => T::from(0.0),
            Self::Markov(m) => T::from(1.0) / T::from(m.time_s),
        }
    }

    /// g².
    pub fn psd<T: Real>(self) -> T {
        match self {
            Self::Walk(k) => T::from(k),
            Self::Markov(m) => {
                let sigma = T::from(m.sigma);
                T::from(2.0) * sigma * sigma / T::from(m.time_s)
            }
        }
    }

    /// σ before the test.
    pub fn start_sigma(self) -> f64 {
        match self {
            Self::Walk(_) => 0.0,
            Self::Markov(m) => m.sigma,
        }
    }
}

/// What a process does in an interval.
#[derive(Debug, Clone, Copy)]
struct Share<T: Real> {
    /// M.
    carried: Matrix3<T>,
    /// e^{−λt}.
    kept: T,
    /// Q_ψd.
    crossed: Matrix3<T>,
    /// Q_ψψ.
    psi: Matrix3<T>,
    /// Q_dd.
    own: T,
}

impl<T: Real> Share<T> {
    /// This interval, then `next`, of transition `phi`.
    fn then(&self, next: &Self, phi: &Matrix3<T>) -> Self {
        let mixed = phi * self.crossed * next.carried.transpose();
        let driven = next.carried * self.own;
        Self {
            carried: phi * self.carried + next.carried * self.kept,
            kept: self.kept * next.kept,
            crossed: (phi * self.crossed + driven) * next.kept + next.crossed,
            psi: phi * self.psi * phi.transpose()
                + mixed
                + mixed.transpose()
                + driven * next.carried.transpose()
                + next.psi,
            own: self.own * next.kept * next.kept + next.own,
        }
    }

    /// `length_s` at a position, in parts of which each is short to the process and to the Earth's
    /// rotation; the transition of a part beside it.
    fn held(process: Process, dynamics: &ErrorDynamics, length_s: f64) -> Self {
        /// Longest part, s.
        const LONGEST_S: f64 = 1000.0;
        let parts = (length_s * process.decay::<f64>()).max(length_s / LONGEST_S);
        let doublings = libm::log2(parts).ceil().max(0.0) as i32;
        let part_s = length_s / libm::pow(2.0, f64::from(doublings));
        let mut share = Self::by_series(process, dynamics, part_s);
        for k in 0..doublings {
            let [phi, _] = T::transition(dynamics, part_s * libm::pow(2.0, f64::from(k)));
            share = share.then(&share, &phi);
        }
        share
    }

    /// With time in units of the part, M = t Σ m_k s^k, (k + 1) m_{k+1} = F t m_k + e_k, and
    /// e^{−λts} = Σ e_k s^k.
    fn by_series(process: Process, dynamics: &ErrorDynamics, part_s: f64) -> Self {
        let t = T::from(part_s);
        let decay = process.decay::<T>() * t;
        let f = dynamics.system_matrix().map(T::from) * t;
        let (mut faded, mut carried) = (vec![T::from(1.0)], vec![Matrix3::zeros()]);
        let mut size = 1.0_f64;
        let mut k = 0;
        while size > T::SMALLEST_TERM || k < 4 {
            let next = T::from(f64::from(k) + 1.0);
            let (e, m) = (faded[k as usize], carried[k as usize]);
            carried.push((f * m + Matrix3::identity() * e) / next);
            faded.push(-(e * decay) / next);
            k += 1;
            size *= (decay.f64() + dynamics.rate() * part_s) / f64::from(k);
        }
        let (mut crossed, mut psi) = (Matrix3::zeros(), Matrix3::zeros());
        let mut own = T::from(0.0);
        for i in 0..carried.len() {
            for j in 0..carried.len() {
                let by = T::from(1.0) / T::from((i + j + 1) as f64);
                crossed += carried[i] * (faded[j] * by);
                psi += carried[i] * carried[j].transpose() * by;
                own += faded[i] * faded[j] * by;
            }
        }
        let zero = T::from(0.0);
        let g2 = process.psd::<T>() * t;
        Self {
            carried: carried.iter().fold(Matrix3::zeros(), |sum, m| sum + m) * t,
            kept: faded.iter().fold(zero, |sum, e| sum + *e),
            crossed: crossed * (g2 * t),
            psi: psi * (g2 * t * t),
            own: own * g2,
        }
    }

    /// The same in another type.
    fn convert<U: Real>(&self, of: impl Fn(T) -> U + Copy) -> Share<U> {
        Share {
            carried: self.carried.map(of),
            kept: of(self.kept),
            crossed: self.crossed.map(of),
            psi: self.psi.map(of),
            own: of(self.own),
        }
    }
}

/// A rule of Gauss on [0, 1], and what polynomials through its nodes are when integrated from each node
/// to the end.
pub(crate) struct Nodes {
    /// Place and weight.
    pub nodes: Vec<(f64, f64)>,
    /// ∫ from node i to 1 of the polynomial that is 1 at node k.
    pub rest: Vec<Vec<f64>>,
}

impl Nodes {
    fn of(nodes: &[(f64, f64)]) -> Self {
        let count = nodes.len();
        // P_0 … P_count at every node on [−1, 1].
        let legendre: Vec<Vec<f64>> = nodes
            .iter()
            .map(|(place, _)| {
                let x = 2.0 * place - 1.0;
                let mut p = vec![1.0, x];
                for k in 2..=count {
                    let of = k as f64;
                    p.push(((2.0 * of - 1.0) * x * p[k - 1] - (of - 1.0) * p[k - 2]) / of);
                }
                p
            })
            .collect();
        // ℓ_k = w_k Σ_n (2n + 1) P_n(x_k) P_n, w_k those of [0, 1], and (2n + 1) ∫_x^1 P_n =
        // P_{n−1} − P_{n+1} at x, half of it in the unit of [0, 1].
        let rest = |i: usize, k: usize| {
            let at = |n: usize| legendre[i][n];
            let first = 1.0 - at(1);
            let more = (1..count).map(|n| legendre[k][n] * (at(n - 1) - at(n + 1)));
            0.5 * nodes[k].1 * (first + more.sum::<f64>())
        };
        Self {
            rest: (0..count)
                .map(|i| (0..count).map(|k| rest(i, k)).collect())
                .collect(),
            nodes: nodes.to_vec(),
        }
    }
}

static NODES: LazyLock<Nodes> = LazyLock::new(|| Nodes::of(sixteen_nodes()));
static EIGHT: LazyLock<Nodes> = LazyLock::new(|| Nodes::of(eight_nodes()));

/// How many nodes a search has in a panel.
pub(crate) const NODES_IN_PANEL: usize = 8;

/// They.
pub(crate) fn panel_nodes() -> &'static Nodes {
    &EIGHT
}

/// A panel of a move: Φ(t_1 − t) C_c^n(t) at its nodes.
struct Panel {
    length_s: f64,
    seen: Vec<Matrix3<f64>>,
}

impl Panel {
    fn new(
        (stand, dynamics): (&Stand, &ErrorDynamics),
        m: &Move,
        start_s: f64,
        length_s: f64,
    ) -> Self {
        let seen = NODES.nodes.iter().map(|(place, _)| {
            let position = m.position_at((start_s + place * length_s) / m.duration_s);
            dynamics.transition(length_s * (1.0 - place)) * stand.attitude(position).matrix()
        });
        Self {
            length_s,
            seen: seen.collect(),
        }
    }

    fn share(&self, process: Process) -> Share<f64> {
        let (t, decay) = (self.length_s, process.decay::<f64>() * self.length_s);
        let Nodes { nodes, rest } = &*NODES;
        // The process, kept from the start of the panel and to its end.
        let kept: Vec<f64> = nodes.iter().map(|(x, _)| libm::exp(-decay * x)).collect();
        let left: Vec<f64> = nodes
            .iter()
            .map(|(x, _)| libm::exp(decay * (x - 1.0)))
            .collect();
        let (mut carried, mut crossed, mut psi) =
            (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
        for (i, (_, weight)) in nodes.iter().enumerate() {
            carried += self.seen[i] * (weight * kept[i]);
            let mut through = Matrix3::zeros();
            for (k, seen) in self.seen.iter().enumerate() {
                through += seen * (rest[i][k] * kept[k] / kept[i]);
            }
            crossed += through * (weight * left[i]);
            psi += through * through.transpose() * *weight;
        }
        let g2 = process.psd::<f64>() * t;
        let own = match process {
            Process::Walk(_) => g2,
            Process::Markov(m) => m.renewed(t),
        };
        Share {
            carried: carried * t,
            kept: libm::exp(-decay),
            crossed: crossed * (g2 * t),
            psi: psi * (g2 * t * t),
            own,
        }
    }
}

/// What becomes of x in an interval without a measurement: x ← `transition` x + noise of root `u`.
///
/// At a position all blocks are in n. In a move all but ψ^n are along the axes of the platform.
#[derive(Debug, Clone)]
pub(crate) struct Passed<T: Real> {
    /// Φ_x, states × states.
    pub transition: DMatrix<T>,
    /// Upper triangular but for the block of ψ^n, which is lower triangular: U Uᵀ is the covariance of what
    /// comes anew.
    pub u: DMatrix<T>,
}

impl<T: Real> Passed<T> {
    /// `length_s` at a position; `q` the PSD of the white drift, arcsec²/s.
    pub fn held(layout: &Layout, dynamics: &ErrorDynamics, q: f64, length_s: f64) -> Self {
        let shares: Vec<Share<T>> = layout
            .processes()
            .map(|process| Share::held(process, dynamics, length_s))
            .collect();
        let [phi, _] = T::transition(dynamics, length_s);
        Self::of(layout, &phi, &shares, T::from(q) * T::from(length_s))
    }

    /// A part of a move.
    pub fn moved(
        layout: &Layout,
        (stand, dynamics): (&Stand, &ErrorDynamics),
        q: f64,
        m: &Move,
        (start_s, length_s): (f64, f64),
    ) -> Self {
        /// Turn of the gimbals (rad), time constants and seconds in a panel: sixteen nodes then leave
        /// less than 1e-14.
        const TURN: f64 = 2.0;
        const DECAYS: f64 = 1.0;
        const LONGEST_S: f64 = 5000.0;
        let rate = m.change.iter().map(|c| c.abs()).sum::<f64>() / m.duration_s;
        let fastest = layout
            .drift
            .iter()
            .map(|p| p.decay::<f64>())
            .fold(0.0, f64::max);
        let mut shares: Vec<Share<f64>> = Vec::new();
        for (start_s, length_s) in m.smooth_parts((start_s, length_s), m.duration_s) {
            let part = [start_s, length_s].map(|s| s / m.duration_s);
            let turn = rate * m.greatest_speed(part.into()) * length_s;
            let panels = (turn / TURN)
                .max(fastest * length_s / DECAYS)
                .max(length_s / LONGEST_S);
            let panels = panels.ceil().max(1.0) as usize;
            let width = length_s / panels as f64;
            let phi = dynamics.transition(width);
            for k in 0..panels {
                let panel = Panel::new((stand, dynamics), m, start_s + k as f64 * width, width);
                let of = layout.drift.iter().map(|process| panel.share(*process));
                shares = match shares.is_empty() {
                    true => of.collect(),
                    false => shares
                        .iter()
                        .zip(of)
                        .map(|(before, next)| before.then(&next, &phi))
                        .collect(),
                };
            }
        }
        let drift = shares.iter().map(|share| share.convert(T::from));
        // Biases do not drive ψ^n, and are what they are at a position.
        let biases = layout.biases.iter();
        let biases = biases.map(|process| Share::held(*process, dynamics, length_s));
        let all: Vec<Share<T>> = drift.chain(biases).collect();
        let [phi, _] = T::transition(dynamics, length_s);
        Self::of(layout, &phi, &all, T::from(q) * T::from(length_s))
    }

    /// Of the shares of all processes and the variance that the white drift adds.
    fn of(layout: &Layout, phi: &Matrix3<T>, shares: &[Share<T>], white: T) -> Self {
        let size = layout.states();
        let mut transition = DMatrix::zeros(size, size);
        let mut u = DMatrix::zeros(size, size);
        transition.view_mut((0, 0), (3, 3)).copy_from(phi);
        let mut left = Matrix3::identity() * white;
        for (k, share) in shares.iter().enumerate() {
            let at = 3 + 3 * k;
            let sigma = share.own.sqrt();
            for i in 0..3 {
                transition[(at + i, at + i)] = share.kept;
                u[(at + i, at + i)] = sigma;
            }
            if k < layout.drift.len() {
                transition
                    .view_mut((0, at), (3, 3))
                    .copy_from(&share.carried);
                let through = share.crossed / sigma;
                u.view_mut((0, at), (3, 3)).copy_from(&through);
                left += share.psi - through * through.transpose();
            }
        }
        u.view_mut((0, 0), (3, 3)).copy_from(&lower_root(&left));
        Self { transition, u }
    }
}

/// Cholesky's factor; zero where nothing is left.
fn lower_root<T: Real>(of: &Matrix3<T>) -> Matrix3<T> {
    let zero = T::from(0.0);
    let mut l = Matrix3::zeros();
    for j in 0..3 {
        for i in j..3 {
            let mut sum = of[(i, j)];
            for k in 0..j {
                sum -= l[(i, k)] * l[(j, k)];
            }
            l[(i, j)] = match i == j {
                true if sum > zero => sum.sqrt(),
                false if l[(j, j)] > zero => sum / l[(j, j)],
                _ => zero,
            };
        }
    }
    l
}

#[cfg(test)]
mod tests;
