//! Errors of the accelerometers: bias, scale factor, misalignment, second and third order, cross
//! coupling.

use super::{Effect, Family, Feature, Group, Instrument, Mounting, Unit, on};

/// K_0X … K_IOZ, M_YX, M_ZX, M_ZY.
pub(super) struct Accelerometer;

static GROUPS: [Group; 6] = [
    Group {
        key: "accelerometer_bias_ug",
        title: "accelerometer bias",
        symbol: "K_0",
        unit: Unit::MicroG,
        names: &["K_0X", "K_0Y", "K_0Z"],
        per_instrument: 1,
    },
    Group {
        key: "accelerometer_scale_factor_ppm",
        title: "accelerometer scale factor",
        symbol: "K_1",
        unit: Unit::Ppm,
        names: &["K_1X", "K_1Y", "K_1Z"],
        per_instrument: 1,
    },
    // X of the frame is the X accelerometer's axis, Y in the plane of X and Y.
    Group {
        key: "accelerometer_misalignment_arcsec",
        title: "accelerometer misalignment",
        symbol: "M",
        unit: Unit::Arcsec,
        names: &["M_YX", "M_ZX", "M_ZY"],
        per_instrument: 1,
    },
    Group {
        key: "accelerometer_second_order_ug_per_g2",
        title: "accelerometer second order",
        symbol: "K_2",
        unit: Unit::MicroGPerG2,
        names: &["K_2X", "K_2Y", "K_2Z"],
        per_instrument: 1,
    },
    Group {
        key: "accelerometer_third_order_ug_per_g3",
        title: "accelerometer third order",
        symbol: "K_3",
        unit: Unit::MicroGPerG3,
        names: &["K_3X", "K_3Y", "K_3Z"],
        per_instrument: 1,
    },
    Group {
        key: "accelerometer_cross_coupling_ug_per_g2",
        title: "accelerometer cross coupling",
        symbol: "K_IP, K_IO",
        unit: Unit::MicroGPerG2,
        names: &["K_IPX", "K_IPY", "K_IPZ", "K_IOX", "K_IOY", "K_IOZ"],
        per_instrument: 1,
    },
];

impl Family for Accelerometer {
    fn groups(&self) -> &'static [Group] {
        &GROUPS
    }

    fn effects(&self, group: usize, index: usize, _: &Mounting) -> Vec<Effect> {
        // (I, P, O) of X, Y, Z: (x, y, z), (y, z, x), (z, x, y).
        let input = index % 3;
        let (pendulous, output) = ((input + 1) % 3, (input + 2) % 3);
        let both = |other: usize| Feature::Product(input.min(other), input.max(other));
        const LEANS: [[usize; 2]; 3] = [[1, 0], [2, 0], [2, 1]];
        let (of, feature) = match group {
            0 => (input, Feature::One),
            1 => (input, Feature::Linear(input)),
            2 => (LEANS[index][0], Feature::Linear(LEANS[index][1])),
            3 => (input, Feature::Product(input, input)),
            4 => (input, Feature::Cube(input)),
            _ if index < 3 => (input, both(pendulous)),
            _ => (input, both(output)),
        };
        on(Instrument::Accelerometer(of), vec![(feature, 1.0)])
    }
}
