//! The error of the local gravity that is used, G: all accelerometers show as much more.
//!
//! It cannot be told from K_1X + K_1Y + K_1Z.

use super::{Effect, Family, Feature, Group, Instrument, Mounting, Unit, on};

/// G.
pub(super) struct Gravity;

static GROUPS: [Group; 1] = [Group {
    key: "local_gravity_ug",
    title: "local gravity",
    symbol: "G",
    unit: Unit::MicroG,
    names: &["G"],
    per_instrument: 1,
}];

impl Family for Gravity {
    fn groups(&self) -> &'static [Group] {
        &GROUPS
    }

    fn effects(&self, _: usize, _: usize, _: &Mounting) -> Vec<Effect> {
        let shown = |i| {
            on(
                Instrument::Accelerometer(i),
                vec![(Feature::Linear(i), 1.0)],
            )
        };
        (0..3).flat_map(shown).collect()
    }
}
