//! Published rotation sequences: positions that follow from each other by rotations about the
//! platform's own axes.
//!
//! All start level, at (0, 0, 0): x North, y Up, z East. A rotation of θ about the platform's
//! axis e takes `C_c^n` to `C_c^n R(e, θ)`.

use nalgebra::{Rotation3, Vector3};

use super::axis_aligned;
use crate::attitude::{Attitude, Position};

/// One of the platform's axes.
#[derive(Debug, Clone, Copy)]
enum Axis {
    X,
    Y,
    Z,
}

use Axis::{X, Y, Z};

/// A rotation about one of the platform's axes, degrees.
type Turn = (Axis, f64);

/// Xie Bo et al., JCIT 2011: y+90 ×3, y−90 ×3, z+90, x+90 ×3, x−90 ×3, z+90 ×2, z−90 ×3.
const NINETEEN: [Turn; 18] = [
    (Y, 90.0),
    (Y, 90.0),
    (Y, 90.0),
    (Y, -90.0),
    (Y, -90.0),
    (Y, -90.0),
    (Z, 90.0),
    (X, 90.0),
    (X, 90.0),
    (X, 90.0),
    (X, -90.0),
    (X, -90.0),
    (X, -90.0),
    (Z, 90.0),
    (Z, 90.0),
    (Z, -90.0),
    (Z, -90.0),
    (Z, -90.0),
];

/// Jia et al., JCIT 2014.
const NINE: [Turn; 8] = [
    (X, 90.0),
    (Z, 90.0),
    (Y, -90.0),
    (X, -90.0),
    (Z, -90.0),
    (Y, 90.0),
    (X, 90.0),
    (Z, -90.0),
];

/// The two-axis sequence of nine steps. Its turns of 540° end where a half turn ends.
const TWO_AXIS: [Turn; 9] = [
    (Y, 540.0),
    (Z, 90.0),
    (X, 540.0),
    (Z, 180.0),
    (X, -90.0),
    (Z, 540.0),
    (Z, -90.0),
    (Z, 180.0),
    (Y, 90.0),
];

pub(super) fn nineteen() -> Vec<Position> {
    positions(&NINETEEN)
}

pub(super) fn nine() -> Vec<Position> {
    positions(&NINE)
}

pub(super) fn two_axis() -> Vec<Position> {
    positions(&TWO_AXIS)
}

/// The start, and where each turn ends.
fn positions(turns: &[Turn]) -> Vec<Position> {
    let mut rotation = Rotation3::identity();
    let mut all = vec![axis_aligned(Attitude::from_rotation(rotation))];
    for (axis, deg) in turns {
        let axis = match axis {
            X => Vector3::x_axis(),
            Y => Vector3::y_axis(),
            Z => Vector3::z_axis(),
        };
        rotation *= Rotation3::from_axis_angle(&axis, deg.to_radians());
        all.push(axis_aligned(Attitude::from_rotation(rotation)));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_are_about_the_platforms_own_axes() {
        let all = nine();
        assert_eq!(all.len(), 9);
        for (pair, (axis, deg)) in all.windows(2).zip(NINE) {
            let turn = pair[0].attitude().matrix().transpose() * pair[1].attitude().matrix();
            // The axis of the turn stays where it is, and the turn is to the right for +.
            let k = axis as usize;
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            assert!((turn[(k, k)] - 1.0).abs() < 1e-9);
            assert!((turn[(j, i)] - f64::sin(f64::to_radians(deg))).abs() < 1e-9);
        }
    }

    #[test]
    fn what_is_turned_forth_and_back_ends_where_it_began() {
        let same = |a: Position, b: Position| {
            (a.attitude().matrix() - b.attitude().matrix()).amax() < 1e-9
        };
        let all = nineteen();
        assert_eq!(all.len(), 19);
        assert!(same(all[0], all[6]), "y three forth, three back");
        assert!(same(all[7], all[13]), "x three forth, three back");
        assert!(same(all[0], all[18]), "z one and two forth, three back");
        // 540° ends like 180°.
        let all = two_axis();
        assert_eq!(all.len(), 10);
        let half_turn = nalgebra::Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, -1.0));
        assert!((all[1].attitude().matrix() - half_turn).amax() < 1e-9);
    }
}
