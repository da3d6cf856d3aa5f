//! The linear filter, its gains computed beforehand. Derivation: see [`crate::simulate`].

use nalgebra::Vector3;

use crate::units::ARCSEC_PER_RAD;

use super::belief::{AZIMUTH, Belief, State, Taken};
use super::channels::{Channel, SEEN_OF_PSI};
use super::program::{DriftInterval, Program};
use super::square_root::{Knowledge, ScalarGain};
use super::states::Shape;
use super::truth::Measured;

/// The gains of the linear filter: the same for every run of a test.
#[derive(Debug)]
pub(super) struct LinearGains {
    /// For each of [`Program::outputs`].
    channels: Vec<Vec<Channel>>,
    /// Rows of Z^n that are measured; what is measured beyond them is the azimuth.
    rows: &'static [usize],
    ticks: Vec<Vec<ScalarGain>>,
    /// What is known at the end of every position.
    pub leg_ends: Vec<Knowledge>,
}

impl LinearGains {
    /// Runs the covariance through `program`; `keeps_gains` where a linear filter is to run by them.
    pub fn new(program: &Program, belief: &Belief, keeps_gains: bool) -> Self {
        let sensors = &belief.sensors;
        let channels = program.outputs.iter().map(|output| {
            let of_accelerometers = sensors.channels(&SEEN_OF_PSI, output).into_iter();
            of_accelerometers.chain(sensors.azimuth(AZIMUTH)).collect()
        });
        let mut knowledge = belief.knowledge();
        let mut gains = Self {
            channels: channels.collect(),
            rows: sensors.rows(),
            ticks: Vec::new(),
            leg_ends: Vec::with_capacity(program.leg_ends.len()),
        };
        for (index, interval) in program.intervals.iter().enumerate() {
            let tick = gains.follow(&mut knowledge, program, belief, interval);
            if interval.measured && keeps_gains {
                gains.ticks.push(tick);
            }
            if program.leg_ends[gains.leg_ends.len()] == index {
                gains.leg_ends.push(knowledge.clone());
            }
        }
        gains
    }

    /// Takes what is known through `interval`; gives the gains at its end.
    pub fn follow(
        &self,
        knowledge: &mut Knowledge,
        program: &Program,
        belief: &Belief,
        interval: &DriftInterval,
    ) -> Vec<ScalarGain> {
        if let Some(q) = &interval.turn {
            knowledge.turn(q);
        }
        let step = &program.transitions[interval.transition];
        knowledge.predict(step, belief.drift_psd * interval.length_s);
        match interval.measured {
            true => {
                let channels = self.channels[interval.output].iter();
                channels.map(|channel| knowledge.update(channel)).collect()
            }
            false => Vec::new(),
        }
    }
}

/// The Kalman filter on the first-order model, with gains from beforehand.
#[derive(Debug)]
pub(super) struct LinearFilter<'a> {
    gains: &'a LinearGains,
    tick: usize,
    pub state: State,
}

impl<'a> LinearFilter<'a> {
    /// A filter that starts from zero.
    pub fn new(gains: &'a LinearGains, shape: &Shape) -> Self {
        Self {
            gains,
            tick: 0,
            state: State::zero(shape),
        }
    }

    /// Predicts through `interval`.
    pub fn advance(&mut self, program: &Program, interval: &DriftInterval) {
        let State { parameters, psi } = &mut self.state;
        if let Some(q) = &interval.turn {
            *psi = q * *psi;
        }
        let step = &program.transitions[interval.transition];
        let driven = parameters.iter().zip(step.b.column_iter());
        *psi = step.phi * *psi + driven.fold(Vector3::zeros(), |sum, (d, b)| sum + b * *d);
        if let Some(fading) = &step.fading {
            let first = parameters.len() - fading.kept.len();
            fading.fade(&mut parameters[first..]);
        }
    }

    /// Takes what is measured at the end of `interval`.
    pub fn measure(&mut self, interval: &DriftInterval, measured: &Measured, taken: Taken<'_>) {
        let z_n = interval.end_attitude().matrix() * measured.z * ARCSEC_PER_RAD;
        let values = self.gains.rows.iter().map(|row| z_n[*row]);
        let values = values.chain([measured.azimuth * ARCSEC_PER_RAD]);
        let channels = &self.gains.channels[interval.output];
        let tick = &self.gains.ticks[self.tick];
        self.tick += 1;
        for ((channel, gain), value) in channels.iter().zip(tick).zip(values) {
            let innovation = value - channel.seen_of(&self.state.numbers(), 0);
            taken(innovation / gain.innovation_sigma, gain);
            self.state.correct(gain, innovation);
        }
    }
}
