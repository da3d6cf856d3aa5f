//! A panel of a move, in the axes of the platform: what [`crate::covariance::coloured::passage`] has at
//! eight nodes of Gauss's rule, and the way back.
//!
//! With S_k = Φ(t_1 − t_k) C_c^n(t_k) at the nodes, κ_k = e^{−λ(t_k − t_0)}, T the panel's length and r_ik
//! what integrates the polynomial through the nodes from node i on,
//!
//! ```text
//! M = T Σ w_k κ_k S_k,   N_i = κ_i⁻¹ Σ_k r_ik κ_k S_k,
//! Q_ψd = g² T² Σ w_i e^{−λ(t_1 − t_i)} N_i,   Q_ψψ = g² T³ Σ w_i N_i N_iᵀ.
//! ```
//!
//! Back, from the adjoints of the transition and of P at the end of the panel,
//!
//! ```text
//! N̄_i = w_i (g² T² e^{−λ(t_1 − t_i)} Q̄_ψd + 2 g² T³ Q̄_ψψ N_i),
//! S̄_k = κ_k (T w_k M̄ + Σ_i r_ik κ_i⁻¹ N̄_i),   C̄_k = Φᵀ S̄_k.
//! ```

use super::algebra::Matrix;
use super::wander::{Share, Slot};
use crate::attitude::StandFrame;
use crate::covariance::coloured::passage::{NODES_IN_PANEL, panel_nodes};
use crate::covariance::fast::arithmetic::{Number, three};
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::moves::{Interval, product, pull_to_angles};
use crate::covariance::fast::square::{Entries, transpose};
use crate::covariance::fast::turn::{OnTheWay, Turn, TurnAdjoint};

const NODES: usize = NODES_IN_PANEL;

/// A panel at its nodes.
pub(super) struct Panel<N> {
    length_s: N,
    turn: Turn<N>,
    way: [OnTheWay<N>; NODES],
    c: [Entries<N>; NODES],
    /// (sin α, cos α).
    alpha: [(N, N); NODES],
    phi: [Entries<N>; NODES],
    /// Φ C.
    seen: [Entries<N>; NODES],
}

/// κ at the nodes, its inverse, and what is left at the end.
struct Faded<N> {
    kept: [N; NODES],
    inverse: [N; NODES],
    left: [N; NODES],
    to_end: N,
}

/// e^x by its series, for |x| up to 1.
#[inline(always)]
fn exponential<N: Number>(x: N) -> N {
    let one = x.constant(1.0);
    let mut sum = one;
    for k in (1..20).rev() {
        sum = (sum * x).mul_add(x.constant(1.0 / f64::from(k)), one);
    }
    sum
}

/// (1 − e^{−x})/x by its series, for x up to 2.
#[inline(always)]
fn mean_decay<N: Number>(x: N) -> N {
    let one = x.constant(1.0);
    let mut sum = one;
    for k in (1..26).rev() {
        sum = (sum * x).mul_add(x.constant(-1.0 / f64::from(k + 1)), one);
    }
    sum
}

impl<N: Number> Faded<N> {
    #[inline(always)]
    fn new(slot: &Slot, length_s: N) -> Self {
        let one = length_s.constant(1.0);
        let ones = [one; NODES];
        let mut faded = Self {
            kept: ones,
            inverse: ones,
            left: ones,
            to_end: one,
        };
        if slot.decay == 0.0 {
            return faded;
        }
        let decay = length_s * length_s.constant(slot.decay);
        faded.to_end = exponential(-decay);
        for (i, (place, _)) in panel_nodes().nodes.iter().enumerate() {
            let by = decay * decay.constant(*place);
            faded.kept[i] = exponential(-by);
            faded.inverse[i] = exponential(by);
            faded.left[i] = faded.to_end * faded.inverse[i];
        }
        faded
    }
}

#[inline(always)]
fn add<N: Number>(to: &mut Entries<N>, factor: N, of: &Entries<N>) {
    for i in 0..3 {
        for j in 0..3 {
            to[i][j] = of[i][j].mul_add(factor, to[i][j]);
        }
    }
}

impl<N: Number> Panel<N> {
    /// Of the move `turn`, an interval of it.
    #[inline(always)]
    pub fn new(earth: &Earth<N>, turn: &Turn<N>, interval: &Interval<N>) -> Self {
        let (zero, one) = (
            interval.length_s.constant(0.0),
            interval.length_s.constant(1.0),
        );
        let nothing = [[zero; 3]; 3];
        let Interval { start_s, length_s } = *interval;
        let mut panel = Self {
            length_s,
            turn: *turn,
            way: [OnTheWay::new((&[zero; 3], false), zero); NODES],
            c: [nothing; NODES],
            alpha: [(zero, zero); NODES],
            phi: [nothing; NODES],
            seen: [nothing; NODES],
        };
        for (k, (place, _)) in panel_nodes().nodes.iter().enumerate() {
            let t = length_s * length_s.constant(*place);
            let way = turn.at(start_s + t);
            let (c, alpha) = turn.attitude_at(earth.stand(), &way);
            let phi = earth.transition(length_s * (one - length_s.constant(*place)));
            panel.way[k] = way;
            panel.c[k] = c;
            panel.alpha[k] = alpha;
            panel.phi[k] = phi;
            panel.seen[k] = product(&phi, &c);
        }
        panel
    }

    /// N_i.
    #[inline(always)]
    fn through(&self, faded: &Faded<N>, i: usize) -> Entries<N> {
        let zero = self.length_s.constant(0.0);
        let mut sum = [[zero; 3]; 3];
        let rest = &panel_nodes().rest[i];
        for k in 0..NODES {
            let rest = zero.constant(rest[k]);
            add(&mut sum, rest * faded.kept[k], &self.seen[k]);
        }
        three!(|a| three!(|b| sum[a][b] * faded.inverse[i]))
    }

    /// What a process does in it.
    #[inline(always)]
    pub fn share(&self, slot: &Slot) -> Share<N> {
        let zero = self.length_s.constant(0.0);
        let nothing = [[zero; 3]; 3];
        let faded = Faded::new(slot, self.length_s);
        let length_s = self.length_s;
        let own = length_s * zero.constant(slot.psd);
        let twice = length_s * zero.constant(2.0 * slot.decay);
        let mut share = Share {
            carried: nothing,
            kept: faded.to_end,
            crossed: nothing,
            psi: nothing,
            own: match slot.decay == 0.0 {
                true => own,
                false => own * mean_decay(twice),
            },
        };
        if !slot.drives {
            return share;
        }
        let crossed = own * length_s;
        let psi = crossed * length_s;
        for (i, (_, weight)) in panel_nodes().nodes.iter().enumerate() {
            let weight = zero.constant(*weight);
            add(
                &mut share.carried,
                length_s * weight * faded.kept[i],
                &self.seen[i],
            );
            let through = self.through(&faded, i);
            add(
                &mut share.crossed,
                crossed * weight * faded.left[i],
                &through,
            );
            let square = super::algebra::square(&through);
            add(&mut share.psi, psi * weight, &square);
        }
        share
    }

    /// Reverse mode: the adjoints of the move from those of ψ's rows of the transition and of P at the
    /// end, symmetric.
    #[inline(always)]
    pub fn pull<const S: usize>(
        &self,
        stand: Option<&StandFrame>,
        slots: &[Slot],
        of_transition: &Matrix<N, 3, S>,
        of_p: &Matrix<N, S, S>,
    ) -> TurnAdjoint<N> {
        let zero = self.length_s.constant(0.0);
        let two = zero.constant(2.0);
        let mut of_seen = [[[zero; 3]; 3]; NODES];
        let of_psi = three!(|i| three!(|j| of_p[i][j]));
        for (at, slot) in slots.iter().enumerate() {
            if !slot.drives {
                continue;
            }
            let at = 3 + 3 * at;
            let of_carried = three!(|i| three!(|j| of_transition[i][at + j]));
            let of_crossed = three!(|i| three!(|j| of_p[i][at + j] * two));
            self.pull_process(slot, &of_carried, &of_crossed, &of_psi, &mut of_seen);
        }
        let mut adjoint = TurnAdjoint::nothing(zero);
        let of = (&self.turn.change, self.turn.ramp.is_some());
        for k in 0..NODES {
            let c_adjoint = product(&transpose(&self.phi[k]), &of_seen[k]);
            let angles = pull_to_angles(stand, &self.c[k], self.alpha[k], &c_adjoint);
            adjoint.add(of, &self.way[k], &angles, None);
        }
        adjoint.gathered(&self.turn)
    }

    #[inline(always)]
    fn pull_process(
        &self,
        slot: &Slot,
        of_carried: &Entries<N>,
        of_crossed: &Entries<N>,
        of_psi: &Entries<N>,
        of_seen: &mut [Entries<N>; NODES],
    ) {
        let zero = self.length_s.constant(0.0);
        let faded = Faded::new(slot, self.length_s);
        let length_s = self.length_s;
        let crossed = length_s * length_s * zero.constant(slot.psd);
        let psi = crossed * length_s * zero.constant(2.0);
        for (i, (_, weight)) in panel_nodes().nodes.iter().enumerate() {
            let weight = zero.constant(*weight);
            add(
                &mut of_seen[i],
                length_s * weight * faded.kept[i],
                of_carried,
            );
            let mut of_through = product(of_psi, &self.through(&faded, i));
            for a in 0..3 {
                for b in 0..3 {
                    let of = of_crossed[a][b] * (crossed * faded.left[i]);
                    of_through[a][b] = of_through[a][b].mul_add(psi, of) * weight;
                }
            }
            let rest = &panel_nodes().rest[i];
            for k in 0..NODES {
                let rest = zero.constant(rest[k]);
                let by = rest * faded.kept[k] * faded.inverse[i];
                add(&mut of_seen[k], by, &of_through);
            }
        }
    }
}
