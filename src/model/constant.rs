//! Constant drift of the gyros, D_F.

use super::{Effect, Family, Feature, Group, Instrument, Mounting, Unit, on};

/// D_FX, D_FY, D_FZ.
pub(super) struct Constant;

static GROUPS: [Group; 1] = [Group {
    key: "constant_drift_deg_per_h",
    title: "constant drift",
    symbol: "D_F",
    unit: Unit::DegPerH,
    names: &["D_FX", "D_FY", "D_FZ"],
    per_instrument: 1,
}];

impl Family for Constant {
    fn groups(&self) -> &'static [Group] {
        &GROUPS
    }

    fn effects(&self, _: usize, index: usize, _: &Mounting) -> Vec<Effect> {
        on(Instrument::Gyro(index), vec![(Feature::One, 1.0)])
    }
}
