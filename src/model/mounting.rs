//! How the gyros are mounted: one output axis each.

use crate::attitude::Attitude;
use crate::drift::{CoefficientMatrix, DriftMatrix, drift_matrix};

/// Input, output and spin axis of a gyro in the platform, each a unit vector.
pub(crate) type GyroAxes = [[f64; 3]; 3];

/// The axes of the gyros X, Y, Z. Input axes are +x, +y, +z, spin axes input × output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mounting {
    axes: [GyroAxes; 3],
}

impl Mounting {
    /// The seed paper's, section 2: output axes −z, −z, +x.
    pub const PAPER: Self = Self {
        axes: [
            [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
            [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]],
            [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        ],
    };

    /// With these output axes, unit vectors perpendicular to the input axes.
    pub(crate) fn of_output_axes(output: [[f64; 3]; 3]) -> Self {
        let axes = std::array::from_fn(|gyro| {
            let mut input = [0.0; 3];
            input[gyro] = 1.0;
            let o = output[gyro];
            let cross = |i: usize, j: usize| input[i] * o[j] - input[j] * o[i];
            [input, o, [cross(1, 2), cross(2, 0), cross(0, 1)]]
        });
        Self { axes }
    }

    /// The axes of the gyros.
    pub(crate) fn axes(&self) -> &[GyroAxes; 3] {
        &self.axes
    }

    /// A of the twelve coefficients at an attitude.
    pub(crate) fn drift_matrix(&self, attitude: &Attitude) -> DriftMatrix {
        self.of_the_papers(drift_matrix(attitude))
    }

    /// Rows on the twelve coefficients in this mounting, of such in the paper's.
    pub(crate) fn of_the_papers(&self, papers: DriftMatrix) -> DriftMatrix {
        match *self == Self::PAPER {
            true => papers,
            false => papers * self.mixing_of_the_papers(),
        }
    }

    /// What turns A of the paper's mounting into that of this one: A · this.
    pub(crate) fn mixing_of_the_papers(&self) -> CoefficientMatrix {
        let mut mixing = CoefficientMatrix::identity();
        for gyro in 0..3 {
            for to in 1..3 {
                for from in 1..3 {
                    let [new, old] = [self.axes[gyro][to], Self::PAPER.axes[gyro][from]];
                    let along: f64 = new.iter().zip(old).map(|(a, b)| a * b).sum();
                    mixing[(3 * (1 + from) + gyro, 3 * (1 + to) + gyro)] = along;
                }
            }
        }
        mixing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_mounting_is_that_of_its_output_axes() {
        let output = [[0.0, 0.0, -1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]];
        assert_eq!(Mounting::of_output_axes(output), Mounting::PAPER);
        let same = Mounting::PAPER.mixing_of_the_papers();
        assert_eq!(same, CoefficientMatrix::identity());
    }

    #[test]
    fn axes_are_right_handed_and_mixing_is_a_rotation() {
        let output = [[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
        let mounting = Mounting::of_output_axes(output);
        for axes in mounting.axes() {
            let [i, o, s] = axes.map(nalgebra::Vector3::from);
            assert_eq!(i.cross(&o), s);
        }
        let mixing = mounting.mixing_of_the_papers();
        let square = mixing.transpose() * mixing;
        assert!((square - CoefficientMatrix::identity()).amax() < 1e-15);
    }
}
