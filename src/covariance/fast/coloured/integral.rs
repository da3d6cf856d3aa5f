//! The drift integral of a move over the features of the gyros' columns.
//!
//! As [`super::super::moves`] has it for the twelve coefficients: B = ∫ Φ(t_end − t) A(R(t)) dt, A the
//! columns C_j φ, at several nodes at once; of a move without duration what the torquers' turning leaves.

use super::Columns;
use crate::covariance::fast::arithmetic::{Arithmetic, Number};
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::moves::{
    AtNode, Interval, Nodes, PASSES, body_rate_adjoint, product, pull_to_angles,
};
use crate::covariance::fast::shape::{Catalogue, FEATURES, Monomial, basis, basis_adjoint};
use crate::covariance::fast::square::transpose;
use crate::covariance::fast::turn::{Turn, TurnAdjoint};

/// The features of `columns` that count in a move, by their places.
fn counting(columns: &Columns, instant: bool) -> impl Iterator<Item = (usize, Monomial)> + '_ {
    let all = columns.features.iter().copied().enumerate();
    all.filter(move |(_, feature)| !instant || feature.is_rate())
}

/// B over (row, axis, feature).
#[inline(always)]
pub(super) fn integral<A: Arithmetic>(
    ar: A,
    columns: &Columns,
    earth: &Earth<A::Number>,
    turn: &Turn<A::Number>,
    interval: &Interval<A::Number>,
    panels: &A::Panels,
) -> Vec<A::Number> {
    let (zero, nothing) = (ar.number(0.0), ar.at_nodes(ar.number(0.0)));
    let count = columns.features.len();
    if turn.instant && !columns.has_torquers() {
        return vec![zero; 9 * count];
    }
    let nodes = Nodes::new::<A, Catalogue>(ar, earth, turn, interval, panels);
    let mut halves = [vec![zero; 9 * count], vec![zero; 9 * count]];
    let mut sums = vec![nothing; 9 * count];
    for pass in PASSES {
        if pass >= A::PASSES {
            continue;
        }
        sums.fill(nothing);
        for step in 0..ar.steps(panels) {
            let node = nodes.at(ar.nodes(panels, pass, step));
            let turned = nodes.turned(&node);
            let of = basis::<_, Catalogue>(&node.c, &nodes.body_rate::<Catalogue>(&node));
            for (f, feature) in counting(columns, nodes.instant) {
                let of = of[feature as usize];
                for i in 0..3 {
                    for axis in 0..3 {
                        let to = &mut sums[(3 * i + axis) * count + f];
                        *to = turned[i][axis].mul_add(of, *to);
                    }
                }
            }
        }
        for (half, sum) in halves[pass % 2].iter_mut().zip(&sums) {
            *half = *half + ar.sum_nodes(*sum);
        }
    }
    let [mut b, other] = halves;
    for (at, (b, other)) in b.iter_mut().zip(&other).enumerate() {
        *b = *b + *other;
        if !columns.features[at % count].is_rate() {
            *b = *b * turn.time;
        }
    }
    b
}

/// Reverse mode of [`integral`].
#[inline(always)]
pub(super) fn integral_adjoint<A: Arithmetic>(
    ar: A,
    columns: &Columns,
    earth: &Earth<A::Number>,
    turn: &Turn<A::Number>,
    interval: &Interval<A::Number>,
    panels: &A::Panels,
    b: &[A::Number],
) -> TurnAdjoint<A::Number> {
    let zero = ar.at_nodes(ar.number(0.0));
    let count = columns.features.len();
    if turn.instant && !columns.has_torquers() {
        return TurnAdjoint::nothing(ar.number(0.0));
    }
    let mut at_nodes = Vec::with_capacity(b.len());
    for (at, b) in b.iter().enumerate() {
        at_nodes.push(match columns.features[at % count].is_rate() {
            true => ar.at_nodes(*b),
            false => ar.at_nodes(*b * turn.time),
        });
    }
    let mut halves = [TurnAdjoint::nothing(ar.number(0.0)); 2];
    let nodes = Nodes::new::<A, Catalogue>(ar, earth, turn, interval, panels);
    for pass in PASSES {
        if pass >= A::PASSES {
            continue;
        }
        let mut adjoint = TurnAdjoint::nothing(zero);
        for step in 0..ar.steps(panels) {
            let node = nodes.at(ar.nodes(panels, pass, step));
            let (angles, rates) = at_node(columns, &nodes, &node, &at_nodes);
            nodes.pull(&mut adjoint, &node, &angles, Some(&rates));
        }
        let half = &mut halves[pass % 2];
        *half = half.plus(&adjoint, nodes.has_ramp, |sum| ar.sum_nodes(sum));
    }
    let [first, second] = halves;
    first
        .plus(&second, nodes.has_ramp, |sum| sum)
        .gathered(turn)
}

/// The node's share of the adjoints of the angles and of their rates.
#[inline(always)]
fn at_node<N: Number>(
    columns: &Columns,
    nodes: &Nodes<N>,
    node: &AtNode<N>,
    b: &[N],
) -> ([N; 3], [N; 3]) {
    let c = &node.c;
    let zero = c[0][0].constant(0.0);
    let count = columns.features.len();
    let body_rate = nodes.body_rate::<Catalogue>(node);
    let of = basis::<_, Catalogue>(c, &body_rate);
    let turned = nodes.turned(node);
    let (mut pulled, mut features) = ([[zero; 3]; 3], [zero; FEATURES]);
    for (f, feature) in counting(columns, nodes.instant) {
        let feature = feature as usize;
        let (of, mut sum) = (of[feature], features[feature]);
        for i in 0..3 {
            for axis in 0..3 {
                let b = b[(3 * i + axis) * count + f];
                pulled[i][axis] = b.mul_add(of, pulled[i][axis]);
                sum = b.mul_add(turned[i][axis], sum);
            }
        }
        features[feature] = sum;
    }
    let mut c_adjoint = product(&transpose(&node.phi), &pulled);
    let rate = basis_adjoint::<_, Catalogue>(c, &body_rate, &features, &mut c_adjoint);
    let stand = nodes.earth.stand();
    let (alpha, rates) =
        body_rate_adjoint(stand, c, node.alpha, &node.rates, &rate, &mut c_adjoint);
    let mut angles = pull_to_angles(stand, c, node.alpha, &c_adjoint);
    angles[0] = angles[0] + alpha;
    (angles, rates)
}
