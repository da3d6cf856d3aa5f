//! Drift proportional to gravity along the axes of a gyro, D_I, D_O, D_S.

use super::{Effect, Family, Group, Instrument, Mounting, Unit, along, on};

/// D_IX … D_SZ.
pub(super) struct GSensitive;

static GROUPS: [Group; 1] = [Group {
    key: "g_sensitive_drift_deg_per_h_per_g",
    title: "g-sensitive drift",
    symbol: "D_I, D_O, D_S",
    unit: Unit::DegPerHPerG,
    names: &[
        "D_IX", "D_IY", "D_IZ", "D_OX", "D_OY", "D_OZ", "D_SX", "D_SY", "D_SZ",
    ],
    per_instrument: 1,
}];

impl Family for GSensitive {
    fn groups(&self) -> &'static [Group] {
        &GROUPS
    }

    fn effects(&self, _: usize, index: usize, mounting: &Mounting) -> Vec<Effect> {
        let (gyro, axis) = (index % 3, index / 3);
        on(Instrument::Gyro(gyro), along(&mounting.axes()[gyro][axis]))
    }
}
