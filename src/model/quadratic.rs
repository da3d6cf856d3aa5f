//! Drift by products of two components of gravity (compliance of the gyro's float and rotor).
//!
//! D_OO is a group of its own: at 1 g, D_II = D_OO = D_SS of a gyro cannot be told from its D_F.

use super::{Effect, Family, Group, Instrument, Mounting, Unit, on, product};

/// D_IIX … D_OOZ.
pub(super) struct Quadratic;

static GROUPS: [Group; 2] = [
    Group {
        key: "quadratic_drift_deg_per_h_per_g2",
        title: "quadratic drift",
        symbol: "D_II … D_OS",
        unit: Unit::DegPerHPerG2,
        names: &[
            "D_IIX", "D_IIY", "D_IIZ", "D_SSX", "D_SSY", "D_SSZ", "D_IOX", "D_IOY", "D_IOZ",
            "D_ISX", "D_ISY", "D_ISZ", "D_OSX", "D_OSY", "D_OSZ",
        ],
        per_instrument: 1,
    },
    Group {
        key: "quadratic_output_drift_deg_per_h_per_g2",
        title: "quadratic drift along the output axes",
        symbol: "D_OO",
        unit: Unit::DegPerHPerG2,
        names: &["D_OOX", "D_OOY", "D_OOZ"],
        per_instrument: 1,
    },
];

/// Input, output, spin.
const I: usize = 0;
const O: usize = 1;
const S: usize = 2;

impl Family for Quadratic {
    fn groups(&self) -> &'static [Group] {
        &GROUPS
    }

    fn effects(&self, group: usize, index: usize, mounting: &Mounting) -> Vec<Effect> {
        const PAIRS: [[usize; 2]; 5] = [[I, I], [S, S], [I, O], [I, S], [O, S]];
        let gyro = index % 3;
        let [u, v] = match group {
            0 => PAIRS[index / 3],
            _ => [O, O],
        };
        let axes = &mounting.axes()[gyro];
        on(Instrument::Gyro(gyro), product(&axes[u], &axes[v]))
    }
}
