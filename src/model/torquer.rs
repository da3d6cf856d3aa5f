//! Errors of the torquers: a gyro turns its axis at a rate that is not quite the commanded one.
//!
//! T_kk is the scale factor; T_kj says how far the input axis leans towards axis j.

use super::{Effect, Family, Feature, Group, Instrument, Mounting, Unit, on};

/// T_XX … T_ZY.
pub(super) struct Torquer;

static GROUPS: [Group; 2] = [
    Group {
        key: "torquer_scale_factor_ppm",
        title: "torquer scale factor",
        symbol: "T_kk",
        unit: Unit::Ppm,
        names: &["T_XX", "T_YY", "T_ZZ"],
        per_instrument: 1,
    },
    Group {
        key: "torquer_misalignment_arcsec",
        title: "torquer misalignment",
        symbol: "T_kj",
        unit: Unit::Arcsec,
        names: &["T_XY", "T_XZ", "T_YX", "T_YZ", "T_ZX", "T_ZY"],
        per_instrument: 2,
    },
];

impl Family for Torquer {
    fn groups(&self) -> &'static [Group] {
        &GROUPS
    }

    fn effects(&self, group: usize, index: usize, _: &Mounting) -> Vec<Effect> {
        const OTHERS: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];
        let [gyro, axis] = match group {
            0 => [index, index],
            _ => [index / 2, OTHERS[index / 2][index % 2]],
        };
        on(Instrument::Gyro(gyro), vec![(Feature::Rate(axis), 1.0)])
    }
}
