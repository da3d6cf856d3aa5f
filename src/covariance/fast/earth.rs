//! Φ(t), Γ(t) of [`ErrorDynamics`] in the chain's arithmetic, and what they do to P.

use super::arithmetic::{Arithmetic, Number};
use super::square::{Entries, entries, mirrored, product, rows, transpose};
use super::trigonometry::sin_cos;
use crate::attitude::{Stand, StandFrame};
use crate::dynamics::ErrorDynamics;

/// The Earth's rotation, rate and axis (a_N, a_U, 0); and how the stand is set up on it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Earth<N> {
    rate: N,
    north: N,
    up: N,
    /// PSD q of the random drift, arcsec²/s.
    drift_psd: N,
    /// What the stand takes beside the paper's sequence, if anything.
    stand: Option<StandFrame>,
}

/// Φ = I − s K + v K² of a rotation by x about the axis, K its cross matrix: s = sin x and
/// v = 1 − cos x.
#[inline(always)]
fn rotation<N: Number>(north: N, up: N, diagonal: N, s: N, v: N) -> Entries<N> {
    let (sn, su) = (s * north, s * up);
    let across = v * north * up;
    [
        [diagonal - v * up * up, across, -su],
        [across, diagonal - v * north * north, sn],
        [su, -sn, diagonal - v],
    ]
}

impl<N: Number> Earth<N> {
    /// Of `dynamics` and a `stand`, in the kind of number of `like`.
    #[inline(always)]
    pub fn new(like: N, dynamics: &ErrorDynamics, stand: &Stand, drift_psd: f64) -> Self {
        let axis = dynamics.axis();
        Self {
            rate: like.constant(dynamics.rate()),
            north: like.constant(axis.x),
            up: like.constant(axis.y),
            drift_psd: like.constant(drift_psd),
            stand: stand.frame().copied(),
        }
    }

    /// The same at the nodes of a quadrature.
    #[inline(always)]
    pub fn at_nodes<A: Arithmetic<Number = N>>(&self, ar: A) -> Earth<A::Node> {
        Earth {
            rate: ar.at_nodes(self.rate),
            north: ar.at_nodes(self.north),
            up: ar.at_nodes(self.up),
            drift_psd: ar.at_nodes(self.drift_psd),
            stand: self.stand,
        }
    }

    /// Turning `factor` times as fast.
    #[inline(always)]
    pub fn at_rate_times(&self, factor: N) -> Self {
        Self {
            rate: self.rate * factor,
            ..*self
        }
    }

    /// What the stand takes beside the paper's sequence, if anything.
    #[inline(always)]
    pub fn stand(&self) -> Option<&StandFrame> {
        self.stand.as_ref()
    }

    /// The PSD q of the random drift, arcsec²/s.
    #[inline(always)]
    pub fn drift_psd(&self) -> N {
        self.drift_psd
    }

    /// ω_ie^n, rad/s.
    #[inline(always)]
    pub fn vector(&self) -> [N; 3] {
        let zero = self.rate.constant(0.0);
        [self.rate * self.north, self.rate * self.up, zero]
    }

    /// The non-zero entries of F = −ω K: F_02, F_12 (F_20 and F_21 are their negatives).
    #[inline(always)]
    pub fn system(&self) -> [N; 2] {
        [-(self.rate * self.up), self.rate * self.north]
    }

    /// a I + b K + c K², K the cross matrix of the axis.
    #[inline(always)]
    pub fn function(&self, [a, b, c]: [N; 3]) -> Entries<N> {
        rotation(self.north, self.up, a, -b, c)
    }

    /// Φ(t).
    #[inline(always)]
    pub fn transition(&self, t_s: N) -> Entries<N> {
        let one = t_s.constant(1.0);
        let (s, c) = sin_cos(self.rate * t_s * t_s.constant(0.5));
        let (sin, versine) = ((s * c) * t_s.constant(2.0), (s * s) * t_s.constant(2.0));
        rotation(self.north, self.up, one, sin, versine)
    }

    /// Φ(t), Γ(t) and q t.
    #[inline(always)]
    pub fn pass<A: Arithmetic<Number = N>>(&self, t_s: N) -> Passed<A> {
        let (one, two) = (t_s.constant(1.0), t_s.constant(2.0));
        let x = self.rate * t_s;
        let (s, c) = sin_cos(x * t_s.constant(0.5));
        let (sin, versine) = ((s * c) * two, (s * s) * two);
        // x − sin x by its series where it would cancel; the next term, x¹¹/11!, is below 3e-18 x.
        let x2 = x * x;
        let series = one - x2 * t_s.constant(1.0 / 72.0);
        let series = one - x2 * t_s.constant(1.0 / 42.0) * series;
        let series = one - x2 * t_s.constant(1.0 / 20.0) * series;
        let series = x * x2 * t_s.constant(1.0 / 6.0) * series;
        let lag = (x - sin).where_greater(x2, t_s.constant(0.01), series);
        let per_rate = one / self.rate;
        Passed {
            phi: rotation(self.north, self.up, one, sin, versine),
            gamma: rotation(self.north, self.up, t_s, versine * per_rate, lag * per_rate),
            process: self.drift_psd * t_s,
        }
    }
}

/// Time without a measurement: ψ(t) = Φ ψ(0) + Γ ε, process noise q t I.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Passed<A: Arithmetic> {
    pub phi: Entries<A::Number>,
    pub gamma: Entries<A::Number>,
    pub process: A::Number,
}

impl<A: Arithmetic> Passed<A> {
    /// Φ P Φᵀ + q t I.
    #[inline(always)]
    pub fn covariance(&self, ar: A, p: &Entries<A::Number>) -> Entries<A::Number> {
        let half = entries(&product(&self.phi, &rows(ar, &mirrored(p))));
        let mut end = entries(&product(&half, &rows(ar, &transpose(&self.phi))));
        for i in 0..3 {
            end[i][i] = end[i][i] + self.process;
        }
        end
    }
}
