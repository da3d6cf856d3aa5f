use super::*;
use crate::attitude::{Position, earth_rate_n};
use crate::covariance::real::Extended;

const Q: f64 = 1e-3;

fn dynamics() -> ErrorDynamics {
    ErrorDynamics::new(earth_rate_n(0.49))
}

fn layout() -> Layout {
    let colour = |k: f64, sigma: f64, time_s: f64| Colour {
        random_walk: Some(k),
        markov: Some(Markov { sigma, time_s }),
    };
    Layout::new(&colour(2e-9, 0.003, 700.0), &colour(4e-6, 0.6, 900.0))
}

fn covariance(passed: &Passed<f64>) -> DMatrix<f64> {
    &passed.u * passed.u.transpose()
}

/// How far two covariances differ, each entry beside the root of its diagonals.
fn difference(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    let mut worst = 0.0_f64;
    for i in 0..a.nrows() {
        for j in 0..a.ncols() {
            let scale = (b[(i, i)] * b[(j, j)]).sqrt();
            worst = worst.max((a[(i, j)] - b[(i, j)]).abs() / scale);
        }
    }
    worst
}

fn then(first: &Passed<f64>, second: &Passed<f64>) -> (DMatrix<f64>, DMatrix<f64>) {
    let through = &second.transition * covariance(first) * second.transition.transpose();
    (
        &second.transition * &first.transition,
        through + covariance(second),
    )
}

/// Against the integrals themselves, by sums over a thousand short steps.
#[test]
fn at_a_position_it_is_the_integral() {
    let (layout, dynamics) = (layout(), dynamics());
    for length_s in [10.0, 640.0, 5000.0] {
        let steps = 1000;
        let h = length_s / f64::from(steps);
        for (k, process) in layout.drift.iter().enumerate() {
            let decay = process.decay::<f64>();
            // M(u) at the middle of each step, by the rule of the middle.
            let (mut m, mut crossed, mut psi) =
                (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
            for step in 0..steps {
                let u = (f64::from(step) + 0.5) * h;
                let here = |u: f64| {
                    let kept = (-decay * u).exp();
                    (kept, dynamics.transition(h))
                };
                let (kept, _) = here(u);
                // M(u + h/2) = Φ(h/2) M + …
                let half = dynamics.integral(0.5 * h) * (-decay * (u - 0.25 * h)).exp();
                let at = dynamics.transition(0.5 * h) * m + half;
                crossed += at * kept * h;
                psi += at * at.transpose() * h;
                let rest = dynamics.integral(0.5 * h) * (-decay * (u + 0.25 * h)).exp();
                m = dynamics.transition(0.5 * h) * at + rest;
            }
            let share = Share::<f64>::held(*process, &dynamics, length_s);
            let g2 = process.psd::<f64>();
            for (found, expected) in [
                (share.carried, m),
                (share.crossed, crossed * g2),
                (share.psi, psi * g2),
            ] {
                let error = (found - expected).amax() / expected.amax();
                assert!(error < 2e-5, "{k} {length_s}: {error:e}");
            }
        }
    }
}

#[test]
fn intervals_compose_at_a_position_and_in_a_move() {
    let (layout, dynamics) = (layout(), dynamics());
    let m = Move::new([0.3, -0.8, 2.0], [3.0, -2.5, 1.9], 1500.0, false);
    for cut_s in [10.0, 700.0, 1470.0] {
        let held = |s| Passed::<f64>::held(&layout, &dynamics, Q, s);
        let moved =
            |start, s| Passed::<f64>::moved(&layout, (&Stand::PAPER, &dynamics), Q, &m, (start, s));
        for (whole, parts) in [
            (held(1500.0), [held(cut_s), held(1500.0 - cut_s)]),
            (
                moved(0.0, 1500.0),
                [moved(0.0, cut_s), moved(cut_s, 1500.0 - cut_s)],
            ),
        ] {
            let (transition, noise) = then(&parts[0], &parts[1]);
            let scale = whole.transition.amax();
            assert!((transition - &whole.transition).amax() < 1e-12 * scale);
            let error = difference(&noise, &covariance(&whole));
            assert!(error < 1e-11, "{cut_s}: {error:e}");
        }
    }
}

/// What stands still in the platform stands still in n.
#[test]
fn a_move_that_does_not_move_is_a_position() {
    let (layout, dynamics) = (layout(), dynamics());
    let position = Position::from_deg(20.0, -50.0, 110.0);
    let m = Move::new(position.to_array(), [0.0; 3], 900.0, false);
    let moved = Passed::<f64>::moved(&layout, (&Stand::PAPER, &dynamics), Q, &m, (0.0, 900.0));
    let held = Passed::<f64>::held(&layout, &dynamics, Q, 900.0);
    let mut turn = DMatrix::identity(layout.states(), layout.states());
    for at in (3..layout.states()).step_by(3) {
        let c = position.attitude();
        turn.view_mut((at, at), (3, 3)).copy_from(c.matrix());
    }
    let in_n = &turn * covariance(&moved) * turn.transpose();
    assert!(difference(&in_n, &covariance(&held)) < 1e-12);
    let in_n = &turn * &moved.transition * turn.transpose();
    assert!((in_n - &held.transition).amax() < 1e-12 * held.transition.amax());
}

#[test]
fn in_32_digits_it_is_the_same() {
    let (layout, dynamics) = (layout(), dynamics());
    for length_s in [0.1, 10.0, 20_000.0] {
        let doubles = Passed::<f64>::held(&layout, &dynamics, Q, length_s);
        let extended = Passed::<Extended>::held(&layout, &dynamics, Q, length_s);
        let u = extended.u.map(Real::f64);
        let error = difference(&covariance(&doubles), &(&u * u.transpose()));
        assert!(error < 1e-13, "{length_s}: {error:e}");
        let twice = &extended.transition * &extended.transition;
        let whole = Passed::<Extended>::held(&layout, &dynamics, Q, 2.0 * length_s).transition;
        let scale = whole.iter().fold(0.0_f64, |max, v| max.max(v.f64().abs()));
        let error = (twice - whole)
            .iter()
            .fold(0.0_f64, |max, v| max.max(v.f64().abs()));
        assert!(error < 1e-29 * scale, "{length_s}: {error:e}");
    }
}

#[test]
fn the_rest_of_a_polynomial_is_its_integral() {
    let Nodes { nodes, rest } = &*NODES;
    for degree in 0..nodes.len() as i32 {
        for (i, (from, _)) in nodes.iter().enumerate() {
            let found: f64 = (0..nodes.len())
                .map(|k| rest[i][k] * nodes[k].0.powi(degree))
                .sum();
            let power = f64::from(degree) + 1.0;
            let expected = (1.0 - from.powf(power)) / power;
            assert!(
                (found - expected).abs() < 1e-14,
                "{degree} {i}: {found} {expected}"
            );
        }
    }
}
