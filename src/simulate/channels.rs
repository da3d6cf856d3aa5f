//! What a filter measures at the end of a period, one number after the other.

use nalgebra::Matrix3;

use crate::attitude::{EAST, NORTH, UP};

use super::states::Drive;

/// One scalar measurement: what it sees of the states.
#[derive(Debug, Clone)]
pub(super) struct Channel {
    /// Of ψ^n.
    pub psi: [f64; 3],
    /// Of the parameters, estimated and considered, arcsec per unit of each: those that it sees.
    parameters: Vec<(usize, f64)>,
    /// 1σ of its noise, arcsec.
    pub noise: f64,
}

impl Channel {
    /// That sees so much of ψ^n and of the parameters listed, with noise of that 1σ.
    pub fn new(psi: [f64; 3], parameters: Vec<(usize, f64)>, noise: f64) -> Self {
        Self {
            psi,
            parameters,
            noise,
        }
    }

    /// What it sees of (D, ψ^n), D the estimated parameters, those before `first` being zero.
    pub fn seen_of(&self, state: &[f64], first: usize) -> f64 {
        let known = state.len() - 3;
        let within = |k: &usize| (first..known).contains(k);
        let parameters = self.parameters.iter().filter(|(k, _)| within(k));
        let of_parameters: f64 = parameters.map(|(k, h)| h * state[*k]).sum();
        let psi = self.psi.iter().zip(&state[known..]);
        psi.fold(of_parameters, |sum, (h, v)| sum + h * v)
    }

    /// What it sees of one parameter.
    pub fn of_parameter(&self, index: usize) -> f64 {
        let seen = self.parameters.iter().find(|(k, _)| *k == index);
        seen.map_or(0.0, |(_, h)| *h)
    }
}

/// 1σ of the noises of a filter's measurements, arcsec, and whether it has use for the vertical one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sensors {
    /// Of an accelerometer.
    pub noise: f64,
    /// Of the azimuth; none: it is not measured.
    pub azimuth_noise: Option<f64>,
    /// Whether an error of the accelerometers is estimated: only of those does the vertical channel
    /// tell, to first order.
    pub has_vertical: bool,
}

impl Sensors {
    /// How many numbers are measured at the end of a period.
    pub fn count(&self) -> usize {
        2 + usize::from(self.has_vertical) + usize::from(self.azimuth_noise.is_some())
    }

    /// The rows of Z^n that are measured, in order.
    pub fn rows(&self) -> &'static [usize] {
        match self.has_vertical {
            true => &[NORTH, EAST, UP],
            false => &[NORTH, EAST],
        }
    }

    /// The accelerometers' channels, where Z^n sees `seen` of ψ^n and `output` of the parameters.
    pub fn channels(&self, seen: &Matrix3<f64>, output: &Drive) -> Vec<Channel> {
        let channel = |row: &usize| {
            let of_parameters = output.row(*row);
            let parameters = of_parameters.iter().copied().enumerate();
            let seen = [0, 1, 2].map(|i| seen[(*row, i)]);
            let parameters = parameters.filter(|(_, h)| *h != 0.0).collect();
            Channel::new(seen, parameters, self.noise)
        };
        self.rows().iter().map(channel).collect()
    }

    /// The azimuth's channel, which sees `seen` of ψ^n.
    pub fn azimuth(&self, seen: [f64; 3]) -> Option<Channel> {
        self.azimuth_noise
            .map(|noise| Channel::new(seen, Vec::new(), noise))
    }
}

/// −[g^n ×]: what Z^n sees of ψ^n, (9).
pub(super) const SEEN_OF_PSI: Matrix3<f64> =
    Matrix3::new(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0);
