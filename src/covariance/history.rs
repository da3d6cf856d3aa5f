//! Convergence of the coefficients through a test, from the step-by-step filter.

use std::ops::Range;

use super::filter::Moment;
use crate::drift::{COEFFICIENTS, CoefficientVector};
use crate::motion::Timeline;

/// About how many moments a history keeps.
const SAMPLES: f64 = 240.0;

/// σ of every coefficient against time, and when each reached its specification.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvergenceHistory {
    /// Times since the start of the test, s.
    pub times_s: Vec<f64>,
    /// 1σ of each coefficient at those times, °/h.
    pub sigma_deg_per_h: Vec<CoefficientVector>,
    /// When each coefficient was within its specification for good, s; none: never, or no
    /// specification.
    pub time_to_spec_s: [Option<f64>; COEFFICIENTS],
    /// What each position did for the accuracy.
    pub positions: Vec<PositionConvergence>,
}

/// What one position, its move and settle included, did for the accuracy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionConvergence {
    /// Index of the position in the schedule. Positions that take no time are left out.
    pub position: usize,
    /// When the move to it started, s.
    pub start_s: f64,
    /// When it was left, s.
    pub end_s: f64,
    /// RMS σ when it was left, °/h.
    pub rms_sigma_deg_per_h: f64,
    /// Convergence rate: decades of RMS σ per hour.
    pub decades_per_h: f64,
    /// The coefficient whose σ shrank most, by ratio.
    pub most_improved: usize,
}

/// Collects a [`ConvergenceHistory`] moment by moment.
pub struct HistoryRecorder {
    spec: Option<CoefficientVector>,
    /// Which legs are positions of the schedule.
    held: Range<usize>,
    spacing_s: f64,
    history: ConvergenceHistory,
    last: Option<Moment>,
    /// The moment at which the current leg began.
    leg_start: Option<Moment>,
}

impl HistoryRecorder {
    /// For a test by `timeline` and a specification (1σ, °/h; infinite: none).
    pub fn new(timeline: &Timeline, spec_deg_per_h: Option<CoefficientVector>) -> Self {
        Self {
            spec: spec_deg_per_h,
            held: timeline.positions(),
            spacing_s: timeline.total_time_s() / SAMPLES,
            history: ConvergenceHistory {
                times_s: Vec::new(),
                sigma_deg_per_h: Vec::new(),
                time_to_spec_s: [None; COEFFICIENTS],
                positions: Vec::new(),
            },
            last: None,
            leg_start: None,
        }
    }

    /// Takes the next moment.
    pub fn observe(&mut self, moment: &Moment) {
        if let Some(last) = self.last
            && last.leg != moment.leg
        {
            self.close_leg(&last);
        }
        if self.leg_start.is_none() {
            self.leg_start = Some(*moment);
        }
        self.track_specification(moment);
        let due = self
            .history
            .times_s
            .last()
            .is_none_or(|t| moment.time_s >= t + self.spacing_s);
        if due {
            self.sample(moment);
        }
        self.last = Some(*moment);
    }

    /// The finished history; its last sample is the end of the test.
    pub fn finish(mut self) -> ConvergenceHistory {
        if let Some(last) = self.last {
            if self.history.times_s.last() != Some(&last.time_s) {
                self.sample(&last);
            }
            self.close_leg(&last);
        }
        self.history
    }

    fn sample(&mut self, moment: &Moment) {
        self.history.times_s.push(moment.time_s);
        self.history.sigma_deg_per_h.push(moment.sigma_deg_per_h);
    }

    fn track_specification(&mut self, moment: &Moment) {
        let Some(spec) = &self.spec else { return };
        for i in 0..COEFFICIENTS {
            let slot = &mut self.history.time_to_spec_s[i];
            if spec[i].is_finite() && moment.sigma_deg_per_h[i] <= spec[i] {
                slot.get_or_insert(moment.time_s);
            } else {
                *slot = None;
            }
        }
    }

    fn close_leg(&mut self, end: &Moment) {
        // The leg's first moment is its own; what it started from is the moment before.
        let Some(start) = self.leg_start.replace(*end) else {
            return;
        };
        if !self.held.contains(&end.leg) {
            return;
        }
        let rms = |m: &Moment| (m.sigma_deg_per_h.norm_squared() / COEFFICIENTS as f64).sqrt();
        let hours = (end.time_s - start.time_s) / 3600.0;
        let mut most_improved = 0;
        let mut smallest_ratio = f64::INFINITY;
        for i in 0..COEFFICIENTS {
            let ratio = end.sigma_deg_per_h[i] / start.sigma_deg_per_h[i];
            if ratio < smallest_ratio {
                (most_improved, smallest_ratio) = (i, ratio);
            }
        }
        self.history.positions.push(PositionConvergence {
            position: end.leg - self.held.start,
            start_s: start.time_s,
            end_s: end.time_s,
            rms_sigma_deg_per_h: rms(end),
            decades_per_h: match hours > 0.0 {
                true => libm::log10(rms(&start) / rms(end)) / hours,
                false => 0.0,
            },
            most_improved,
        });
    }
}
