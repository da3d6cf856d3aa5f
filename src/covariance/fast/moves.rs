//! The drift integral of a move, see [`crate::motion::integral`], at several nodes at once.

use super::Wide;
use super::arithmetic::{Arithmetic, Number, Row, four, three};
use super::earth::Earth;
use super::shape::{Basis, FEATURES, Monomial, Shape, basis, basis_adjoint, every};
use super::square::{Entries, dot, transpose};
use super::trigonometry::sin_cos;
use super::turn::{OnTheWay, Turn, TurnAdjoint};
use crate::attitude::{Degrees, StandFrame, UP};

/// An interval of a move.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Interval<N> {
    /// From the start of the stretch, s.
    pub start_s: N,
    /// Its length, s.
    pub length_s: N,
}

/// What the integrand is made of at a node (or several).
pub(crate) struct AtNode<N> {
    /// How far the move is.
    pub way: OnTheWay<N>,
    /// The angles' rates, rad/s.
    pub rates: [N; 3],
    /// C_c^n.
    pub c: Entries<N>,
    /// (sin α, cos α).
    pub alpha: (N, N),
    /// Φ(t_end − t) times the node's weight.
    pub phi: Entries<N>,
    /// The node's weight.
    weight: N,
}

/// C_c^n = L Mx(α) My(β + β₀) Mz(s γ) R on a stand, and (sin α, cos α).
#[inline(always)]
pub(crate) fn attitude<N: Number>(
    stand: Option<&StandFrame>,
    angles: [N; 3],
) -> (Entries<N>, (N, N)) {
    match stand {
        None => papers_attitude(angles),
        Some(frame) => {
            let beta = angles[1] + angles[1].constant(Degrees::from(frame.beta).rad());
            let gamma = angles[2] * angles[2].constant(frame.gamma);
            let (c, alpha) = papers_attitude([angles[0], beta, gamma]);
            let left = three!(|i| three!(|j| alpha.0.constant(frame.left[(i, j)])));
            let right = three!(|i| three!(|j| alpha.0.constant(frame.right[(i, j)])));
            (product(&left, &product(&c, &right)), alpha)
        }
    }
}

/// C_c^n = Mx(α) My(β) Mz(γ), (19), and (sin α, cos α).
#[inline(always)]
fn papers_attitude<N: Number>(angles: [N; 3]) -> (Entries<N>, (N, N)) {
    let [(sa, ca), (sb, cb), (sg, cg)] = three!(|i| sin_cos(angles[i]));
    let (sa_sb, ca_sb) = (sa * sb, ca * sb);
    let c = [
        [cb * cg, cb * sg, -sb],
        [
            sa_sb.mul_add(cg, -(ca * sg)),
            sa_sb.mul_add(sg, ca * cg),
            sa * cb,
        ],
        [
            ca_sb.mul_add(cg, sa * sg),
            ca_sb.mul_add(sg, -(sa * cg)),
            ca * cb,
        ],
    ];
    (c, (sa, ca))
}

/// φ_α, φ_β, φ_γ of a stand and, in the last row, dφ_β/dα; see [`crate::attitude::Stand::rotation_axes`].
#[inline(always)]
fn axes_of<N: Number>(frame: &StandFrame, c: &Entries<N>, (sin, cos): (N, N)) -> [[N; 3]; 4] {
    let left = three!(|j| three!(|i| sin.constant(frame.left[(i, j)])));
    let inner = three!(|j| sin.constant(frame.right[(2, j)] * frame.gamma));
    [
        left[0],
        three!(|i| left[1][i] * cos - left[2][i] * sin),
        three!(|i| dot(&c[i], &inner)),
        three!(|i| -(left[1][i] * sin) - left[2][i] * cos),
    ]
}

/// The rate ω_ic of the body against inertial space, in n, where the angles change at `rates`:
/// ω_ie − Σ_i rate_i φ_i with φ the axes of the angles. On the paper's stand a positive angle turns the
/// frame, passively.
#[inline(always)]
pub(crate) fn body_rate<N: Number>(
    stand: Option<&StandFrame>,
    c: &Entries<N>,
    (sin_alpha, cos_alpha): (N, N),
    earth_rate: &[N; 3],
    rates: &[N; 3],
) -> [N; 3] {
    if let Some(frame) = stand {
        let [alpha, beta, gamma, _] = axes_of(frame, c, (sin_alpha, cos_alpha));
        return three!(|i| earth_rate[i] - dot(rates, &[alpha[i], beta[i], gamma[i]]));
    }
    [
        earth_rate[0] - rates[0] - rates[2] * c[0][2],
        earth_rate[1] - rates[1] * cos_alpha - rates[2] * c[1][2],
        earth_rate[2] + rates[1] * sin_alpha - rates[2] * c[2][2],
    ]
}

/// Reverse mode of [`body_rate`]: adds to C̄, and gives the adjoints of α and of the angles' rates.
#[inline(always)]
pub(crate) fn body_rate_adjoint<N: Number>(
    stand: Option<&StandFrame>,
    c: &Entries<N>,
    (sin_alpha, cos_alpha): (N, N),
    rates: &[N; 3],
    of: &[N; 3],
    c_adjoint: &mut Entries<N>,
) -> (N, [N; 3]) {
    if let Some(frame) = stand {
        let [alpha, beta, gamma, turned] = axes_of(frame, c, (sin_alpha, cos_alpha));
        for i in 0..3 {
            for j in 0..3 {
                let inner = of[i].constant(frame.right[(2, j)] * frame.gamma);
                c_adjoint[i][j] = c_adjoint[i][j] - rates[2] * of[i] * inner;
            }
        }
        let of_alpha = -(rates[1] * dot(&turned, of));
        return (
            of_alpha,
            [-dot(&alpha, of), -dot(&beta, of), -dot(&gamma, of)],
        );
    }
    for i in 0..3 {
        c_adjoint[i][2] = c_adjoint[i][2] - rates[2] * of[i];
    }
    let alpha = rates[1] * (of[1] * sin_alpha + of[2] * cos_alpha);
    let second = of[2] * sin_alpha - of[1] * cos_alpha;
    (
        alpha,
        [-of[0], second, -dot(&[c[0][2], c[1][2], c[2][2]], of)],
    )
}

#[inline(always)]
pub(crate) fn product<N: Number>(a: &Entries<N>, b: &Entries<N>) -> Entries<N> {
    three!(|i| three!(|j| a[i][2].mul_add(b[2][j], a[i][1].mul_add(b[1][j], a[i][0] * b[0][j]))))
}

/// An interval ready to be visited node by node.
pub(crate) struct Nodes<N> {
    pub earth: Earth<N>,
    /// ω_ie^n, or 0 where no time passes.
    earth_rate: [N; 3],
    from: [N; 3],
    change: [N; 3],
    /// The angles' mean rates, rad/s.
    rates: [N; 3],
    way: [N; 3],
    pub has_ramp: bool,
    start: N,
    length: N,
    width: N,
    /// Whether no time passes, and Φ is 1.
    pub instant: bool,
}

impl<N: Number> Nodes<N> {
    #[inline(always)]
    pub fn new<A: Arithmetic<Node = N>, S: Shape>(
        ar: A,
        earth: &Earth<A::Number>,
        turn: &Turn<A::Number>,
        interval: &Interval<A::Number>,
        panels: &A::Panels,
    ) -> Self {
        let width = interval.length_s * ar.panel_share(panels);
        let zero = ar.at_nodes(ar.number(0.0));
        let (mut earth_rate, mut rates) = ([zero; 3], [zero; 3]);
        let mut earth = *earth;
        if !S::DRIFT_ONLY {
            // In a move without duration the Earth does not turn.
            earth = earth.at_rate_times(turn.time);
            let vector = earth.vector();
            earth_rate = three!(|i| ar.at_nodes(vector[i]));
            rates = three!(|i| ar.at_nodes(turn.change[i] / turn.duration_s));
        }
        Self {
            earth: earth.at_nodes(ar),
            earth_rate,
            from: three!(|i| ar.at_nodes(turn.from[i])),
            change: three!(|i| ar.at_nodes(turn.change[i])),
            rates,
            way: three!(|k| ar.at_nodes(turn.way[k])),
            has_ramp: turn.ramp.is_some(),
            start: ar.at_nodes(interval.start_s),
            length: ar.at_nodes(interval.length_s),
            width: ar.at_nodes(width),
            instant: !S::DRIFT_ONLY && turn.instant,
        }
    }

    /// Φ C times the node's weight.
    #[inline(always)]
    pub fn turned(&self, node: &AtNode<N>) -> Entries<N> {
        match self.instant {
            true => three!(|i| three!(|j| node.c[i][j] * node.weight)),
            false => product(&node.phi, &node.c),
        }
    }

    /// Adds the adjoints of the angles at a node and, where the rates count, of them.
    #[inline(always)]
    pub fn pull(
        &self,
        to: &mut TurnAdjoint<N>,
        node: &AtNode<N>,
        angles: &[N; 3],
        rates: Option<&[N; 3]>,
    ) {
        let of = (&self.change, self.has_ramp);
        to.add(of, &node.way, angles, rates);
    }

    /// The body's rate at a node, in n.
    #[inline(always)]
    pub fn body_rate<S: Shape>(&self, node: &AtNode<N>) -> [N; 3] {
        match S::DRIFT_ONLY {
            true => self.earth_rate,
            false => body_rate(
                self.earth.stand(),
                &node.c,
                node.alpha,
                &self.earth_rate,
                &node.rates,
            ),
        }
    }

    /// At `places`, in widths of a panel from the start, with those `weights`.
    #[inline(always)]
    pub fn at(&self, [places, weights]: [N; 2]) -> AtNode<N> {
        let t = self.width * places;
        let way = OnTheWay::new((&self.way, self.has_ramp), self.start + t);
        let angles = three!(|i| way.done.mul_add(self.change[i], self.from[i]));
        let rates = match self.has_ramp {
            true => three!(|i| self.change[i] * way.rate),
            false => self.rates,
        };
        let (c, alpha) = attitude(self.earth.stand(), angles);
        let weight = self.width * weights;
        let phi = match self.instant {
            true => {
                let zero = weight.constant(0.0);
                [
                    [weight, zero, zero],
                    [zero, weight, zero],
                    [zero, zero, weight],
                ]
            }
            false => {
                let phi = self.earth.transition(self.length - t);
                three!(|i| three!(|j| phi[i][j] * weight))
            }
        };
        AtNode {
            way,
            rates,
            c,
            alpha,
            phi,
            weight,
        }
    }
}

/// The order of the passes. Four nodes in one register are summed as (0 + 2) + (1 + 3); one by one
/// they are summed in the same way, so that a lane has the bits of its schedule alone.
pub(crate) const PASSES: [usize; 4] = [0, 2, 1, 3];

/// 1 for rates, `time` for all other features: block by block.
#[inline(always)]
fn times_time<A: Arithmetic, S: Shape>(
    ar: A,
    turn: &Turn<A::Number>,
    b: &Wide<A::Quad, S>,
) -> Wide<A::Quad, S> {
    let mut out = *b;
    if S::DRIFT_ONLY {
        return out;
    }
    for q in 0..S::GYRO_QUADS {
        let features = &S::FEATURES[S::LAYOUT[q].block];
        let factors = ar.quad(four!(|e| match features[e].is_rate() {
            true => ar.number(1.0),
            false => turn.time,
        }));
        for i in 0..3 {
            out[i][q] = b[i][q].by(factors);
        }
    }
    out
}

/// B = ∫ Φ(t_end − t) A(R(t)) dt over the interval; of a move without duration what the torquers'
/// turning leaves of it.
#[inline(always)]
pub(crate) fn drift_integral<A: Arithmetic, S: Shape>(
    ar: A,
    earth: &Earth<A::Number>,
    turn: &Turn<A::Number>,
    interval: &Interval<A::Number>,
    panels: &A::Panels,
) -> Wide<A::Quad, S> {
    let nothing = every::<S, _>(ar.quad([ar.number(0.0); 4]));
    let mut halves = [[nothing; 3]; 2];
    let nodes = Nodes::new::<A, S>(ar, earth, turn, interval, panels);
    for pass in PASSES {
        if pass >= A::PASSES {
            continue;
        }
        let nothing = ar.at_nodes(ar.number(0.0));
        let mut sums = [every::<S, _>([nothing; 4]); 3];
        for step in 0..ar.steps(panels) {
            let node = nodes.at(ar.nodes(panels, pass, step));
            let turned = nodes.turned(&node);
            let of = basis::<_, S>(&node.c, &nodes.body_rate::<S>(&node));
            for i in 0..3 {
                for q in 0..S::GYRO_QUADS {
                    if nodes.instant && !has_rates::<S>(q) {
                        continue;
                    }
                    add_features::<_, S>(&mut sums[i][q], turned[i][S::LAYOUT[q].axis], q, &of);
                }
            }
        }
        let half = &mut halves[pass % 2];
        for i in 0..3 {
            for q in 0..S::GYRO_QUADS {
                let sum = ar.quad(four!(|e| ar.sum_nodes(sums[i][q][e])));
                half[i][q] = half[i][q].plus(sum);
            }
        }
    }
    let mut b = halves[0];
    for i in 0..3 {
        for q in 0..S::GYRO_QUADS {
            b[i][q] = halves[0][i][q].plus(halves[1][i][q]);
        }
    }
    times_time::<A, S>(ar, turn, &b)
}

/// Whether a quad is of the body's rates, at least in part.
#[inline(always)]
const fn has_rates<S: Shape>(q: usize) -> bool {
    let features = &S::FEATURES[S::LAYOUT[q].block];
    features[0].is_rate() || features[1].is_rate() || features[2].is_rate() || features[3].is_rate()
}

/// `turned` times the features of quad `q`, added to `sum`.
#[inline(always)]
fn add_features<N: Number, S: Shape>(sum: &mut [N; 4], turned: N, q: usize, of: &Basis<N>) {
    let features = &S::FEATURES[S::LAYOUT[q].block];
    for e in 0..4 {
        sum[e] = match features[e] {
            Monomial::One => sum[e] + turned,
            feature => turned.mul_add(of[feature as usize], sum[e]),
        };
    }
}

/// Reverse mode of [`drift_integral`]: adjoints of angles and duration, given the adjoint of B.
/// The interval's own length is the chain's affair.
#[inline(always)]
pub(crate) fn drift_integral_adjoint<A: Arithmetic, S: Shape>(
    ar: A,
    earth: &Earth<A::Number>,
    turn: &Turn<A::Number>,
    interval: &Interval<A::Number>,
    panels: &A::Panels,
    b: &Wide<A::Quad, S>,
) -> TurnAdjoint<A::Number> {
    let zero = ar.at_nodes(ar.number(0.0));
    let scaled = times_time::<A, S>(ar, turn, b);
    let mut b = [every::<S, _>([zero; 4]); 3];
    for i in 0..3 {
        for q in 0..S::GYRO_QUADS {
            b[i][q] = four!(|e| ar.at_nodes(scaled[i][q].get(e)));
        }
    }
    let mut halves = [TurnAdjoint::nothing(ar.number(0.0)); 2];
    let nodes = Nodes::new::<A, S>(ar, earth, turn, interval, panels);
    for pass in PASSES {
        if pass >= A::PASSES {
            continue;
        }
        let mut adjoint = TurnAdjoint::nothing(zero);
        for step in 0..ar.steps(panels) {
            let node = nodes.at(ar.nodes(panels, pass, step));
            if S::DRIFT_ONLY {
                let angles = angle_adjoint::<_, S>(&nodes, &node, &b);
                nodes.pull(&mut adjoint, &node, &angles, None);
            } else {
                let (angles, rates) = wide_angle_adjoint::<_, S>(&nodes, &node, &b);
                nodes.pull(&mut adjoint, &node, &angles, Some(&rates));
            }
        }
        let half = &mut halves[pass % 2];
        *half = half.plus(&adjoint, nodes.has_ramp, |sum| ar.sum_nodes(sum));
    }
    let [first, second] = halves;
    first
        .plus(&second, nodes.has_ramp, |sum| sum)
        .gathered(turn)
}

/// The node's share of the angles' adjoint: of Φ C ⊗ h through C and through h, then of C through
/// the angles ([`crate::attitude::Attitude::angle_adjoint`]).
#[inline(always)]
fn angle_adjoint<N: Number, S: Shape>(
    nodes: &Nodes<N>,
    node: &AtNode<N>,
    b: &[S::Quads<[N; 4]>; 3],
) -> [N; 3] {
    let c = &node.c;
    let gravity = three!(|e| -c[UP][e]);
    let turned = product(&node.phi, c);
    // Σ_e h_e B̄_e, then Φᵀ of it: C̄ through the columns.
    let pulled = three!(|i| three!(|j| {
        let q = &b[i][j];
        let first = q[1].mul_add(gravity[0], q[0]);
        q[3].mul_add(gravity[2], q[2].mul_add(gravity[1], first))
    }));
    let mut c_adjoint = product(&transpose(&node.phi), &pulled);
    for e in 0..3 {
        let column = three!(|i| dot(
            &turned[i],
            &[b[i][0][1 + e], b[i][1][1 + e], b[i][2][1 + e]]
        ));
        // g = −(Up row of C)ᵀ.
        c_adjoint[UP][e] = c_adjoint[UP][e] - (column[0] + column[1] + column[2]);
    }
    pull_to_angles(nodes.earth.stand(), c, node.alpha, &c_adjoint)
}

/// The same with all features; of the angles' rates too.
#[inline(always)]
fn wide_angle_adjoint<N: Number, S: Shape>(
    nodes: &Nodes<N>,
    node: &AtNode<N>,
    b: &[S::Quads<[N; 4]>; 3],
) -> ([N; 3], [N; 3]) {
    let c = &node.c;
    let zero = c[0][0].constant(0.0);
    let body_rate = nodes.body_rate::<S>(node);
    let of = basis::<_, S>(c, &body_rate);
    let turned = nodes.turned(node);
    let (mut pulled, mut features) = ([[zero; 3]; 3], [zero; FEATURES]);
    for q in 0..S::GYRO_QUADS {
        if nodes.instant && !has_rates::<S>(q) {
            // Its adjoint is 0.
            continue;
        }
        let layout = &S::LAYOUT[q];
        let axis = layout.axis;
        for e in 0..4 {
            let feature = S::FEATURES[layout.block][e] as usize;
            for i in 0..3 {
                let b = b[i][q][e];
                pulled[i][axis] = b.mul_add(of[feature], pulled[i][axis]);
                features[feature] = b.mul_add(turned[i][axis], features[feature]);
            }
        }
    }
    let mut c_adjoint = product(&transpose(&node.phi), &pulled);
    let rate = basis_adjoint::<_, S>(c, &body_rate, &features, &mut c_adjoint);
    let stand = nodes.earth.stand();
    let (alpha, rates) =
        body_rate_adjoint(stand, c, node.alpha, &node.rates, &rate, &mut c_adjoint);
    let mut angles = pull_to_angles(stand, c, node.alpha, &c_adjoint);
    angles[0] = angles[0] + alpha;
    (angles, rates)
}

/// ∂f/∂(α, β, γ) from ∂f/∂C: −φ_i · Σ_j C_j × C̄_j with the axes φ of the three angles.
#[inline(always)]
pub(crate) fn pull_to_angles<N: Number>(
    stand: Option<&StandFrame>,
    c: &Entries<N>,
    (sin_alpha, cos_alpha): (N, N),
    c_adjoint: &Entries<N>,
) -> [N; 3] {
    let mut torque = [sin_alpha.constant(0.0); 3];
    for j in 0..3 {
        for (axis, (a, b)) in [(1, 2), (2, 0), (0, 1)].into_iter().enumerate() {
            let cross = c[a][j].mul_add(c_adjoint[b][j], -(c[b][j] * c_adjoint[a][j]));
            torque[axis] = torque[axis] + cross;
        }
    }
    if let Some(frame) = stand {
        let [alpha, beta, gamma, _] = axes_of(frame, c, (sin_alpha, cos_alpha));
        return [
            -dot(&alpha, &torque),
            -dot(&beta, &torque),
            -dot(&gamma, &torque),
        ];
    }
    [
        -torque[0],
        sin_alpha * torque[2] - cos_alpha * torque[1],
        -dot(&[c[0][2], c[1][2], c[2][2]], &torque),
    ]
}

#[cfg(test)]
mod tests {
    use super::super::arithmetic::Plain;
    use super::super::information::PLACES;
    use super::super::shape::Drift;
    use super::*;
    use crate::attitude::{Stand, earth_rate_n};
    use crate::drift::{COEFFICIENTS, DriftMatrix};
    use crate::dynamics::ErrorDynamics;
    use crate::motion::Move;
    use crate::motion::integral::{Panels, half_phase};

    fn parts(m: &Move, start_s: f64, length_s: f64) -> (Turn<f64>, Interval<f64>, Panels) {
        // What a test shifts by hand, a move has to be made of anew: it keeps its start without turns.
        let m = &Move::new(m.from, m.change, m.duration_s, m.measured);
        let turn = Turn::of_a_move(m, None, [start_s, start_s + length_s]);
        let interval = Interval {
            start_s: 0.0,
            length_s,
        };
        let panels = Panels::of_half_phase(half_phase(m, (start_s, length_s)));
        (turn, interval, panels)
    }

    fn integral(m: &Move, dynamics: &ErrorDynamics, start_s: f64, length_s: f64) -> DriftMatrix {
        let (turn, interval, panels) = parts(m, start_s, length_s);
        let earth = Earth::new(0.0, dynamics, &Stand::PAPER, 0.0);
        let b = drift_integral::<_, Drift>(Plain, &earth, &turn, &interval, &panels);
        DriftMatrix::from_fn(|i, c| {
            let (at, sign) = PLACES[c];
            sign * b[i][at / 4].get(at % 4)
        })
    }

    #[test]
    fn it_is_the_drift_integral_of_the_move() {
        let dynamics = ErrorDynamics::new(earth_rate_n(0.49));
        for change in [
            [0.0; 3],
            [0.2, -0.1, 0.1],
            [-1.5, 1.0, 1.9],
            [6.0, 2.0, -12.0],
        ] {
            let m = Move::new([0.3, -0.8, 2.0], change, 360.0, false);
            for (start, length) in [(0.0, 360.0), (120.0, 10.0), (357.0, 3.0)] {
                let expected = m.drift_integral(&Stand::PAPER, &dynamics, start, length);
                let error = (integral(&m, &dynamics, start, length) - expected).amax();
                assert!(error < 1e-13 * length, "{change:?}: {error:e}");
            }
        }
    }

    #[test]
    fn adjoint_is_the_derivative() {
        let dynamics = ErrorDynamics::new(earth_rate_n(0.49));
        let weight = DriftMatrix::from_fn(|i, j| ((2 * i + 3 * j) as f64).cos());
        let base = Move::new([0.3, -0.8, 2.0], [1.1, -0.6, 0.4], 200.0, false);
        let (start, length) = (30.0, 90.0);
        let f = |m: &Move| integral(m, &dynamics, start, length).dot(&weight);
        let mut wide = three!(|_i| three!(|_j| Plain.quad([0.0; 4])));
        for c in 0..COEFFICIENTS {
            let (at, sign) = PLACES[c];
            for (i, row) in wide.iter_mut().enumerate() {
                row[at / 4].0[at % 4] = sign * weight[(i, c)];
            }
        }
        let (turn, interval, panels) = parts(&base, start, length);
        let earth = Earth::new(0.0, &dynamics, &Stand::PAPER, 0.0);
        let adjoint =
            drift_integral_adjoint::<_, Drift>(Plain, &earth, &turn, &interval, &panels, &wide);
        let slope = |h: f64, shift: &dyn Fn(&mut Move, f64)| {
            let at = |by: f64| {
                let mut m = base;
                shift(&mut m, by);
                f(&m)
            };
            (at(h) - at(-h)) / (2.0 * h)
        };
        for i in 0..3 {
            let from = slope(1e-5, &|m, by| m.from[i] += by);
            let change = slope(1e-5, &|m, by| m.change[i] += by);
            assert!((from - adjoint.from[i]).abs() < 1e-6);
            assert!((change - adjoint.change[i]).abs() < 1e-6);
        }
        let longer = slope(1e-3, &|m, by| m.duration_s += by);
        assert!((longer - adjoint.duration).abs() < 1e-6);
    }
}
