//! The chain of a schedule where drift or biases wander: as [`crate::covariance::chain`], with x for ψ^n.
//!
//! V (states × m) is the sensitivity of x to the parameters D, G a root of the covariance of x for known
//! D; what is told of D goes to the rows. In a move the processes are along the axes of the platform, which
//! they turn with.

use nalgebra::{DMatrix, Matrix3};

use super::Layout;
use super::kernel::{ColouredDoublings, Seen};
use super::passage::Passed;
use crate::covariance::chain::Effects;
use crate::covariance::real::Real;
use crate::covariance::rows::Rows;
use crate::covariance::selection::{Place, Selection};
use crate::covariance::triangle::{inverse_of, one_and_rows, root_of_sum};
use crate::covariance::{CovarianceModel, TickRule, split_periods};
use crate::motion::{Leg, Move, Timeline};

/// Where the chain has come to at the end of a test.
pub(crate) struct End<T: Real> {
    /// V.
    pub v: DMatrix<T>,
    /// G.
    pub g: DMatrix<T>,
    /// C_c^n at the end.
    pub attitude: Matrix3<T>,
    /// Where the block of the drift's random walk starts in x.
    pub walk: Option<usize>,
}

/// Runs `timeline` from its start: what is told of the parameters goes to `rows`.
pub(crate) fn run<T: Real>(
    selection: &Selection<'_, T>,
    timeline: &Timeline,
    rule: TickRule,
    rows: &mut Rows<T>,
) -> End<T> {
    let model = selection.of_model();
    let kernels = model.coloured_kernels.of::<T>(model);
    let layout = kernels.layout();
    let size = layout.states();
    let mut g = DMatrix::zeros(size, size);
    for i in 0..3 {
        g[(i, i)] = T::from(model.prior_psi[(i, i)]).sqrt();
    }
    for (k, process) in layout.processes().enumerate() {
        for i in 3 + 3 * k..6 + 3 * k {
            g[(i, i)] = T::from(process.start_sigma());
        }
    }
    let mut runner = Runner {
        selection,
        model,
        kernels: &kernels,
        layout,
        rule,
        v: DMatrix::zeros(size, selection.count()),
        g,
        rows,
    };
    let mut before: Option<Place<T>> = None;
    for leg in timeline.legs() {
        let here = selection.place(leg);
        match &before {
            Some(before) => runner.arrive(leg, &here, before),
            None => runner.enter(&here),
        }
        runner.dwell(leg, &here);
        before = Some(here);
    }
    if let Some(last) = &before {
        runner.leave(last);
    }
    End {
        v: runner.v,
        g: runner.g,
        attitude: before.map_or_else(Matrix3::identity, |place| place.c),
        walk: layout.walk(),
    }
}

struct Runner<'a, T: Real> {
    selection: &'a Selection<'a, T>,
    model: &'a CovarianceModel,
    kernels: &'a ColouredDoublings<T>,
    layout: &'a Layout,
    rule: TickRule,
    v: DMatrix<T>,
    g: DMatrix<T>,
    rows: &'a mut Rows<T>,
}

impl<T: Real> Runner<'_, T> {
    fn arrive(&mut self, leg: &Leg, here: &Place<T>, before: &Place<T>) {
        let Some(arrival) = &leg.arrival else {
            return;
        };
        self.leave(before);
        let turn = here.c * before.c.transpose();
        if self.model.frame_hold {
            self.turn(&turn, 0);
        } else if arrival.duration_s <= 0.0 {
            self.turn(&turn, 1);
            if let Some(jump) = self.selection.jump(arrival) {
                let mut psi = self.v.rows_mut(0, 3);
                psi += jump;
            }
        } else {
            self.turn(&before.c.transpose(), 1);
            match arrival.measured {
                true => self.measured_move(arrival),
                false => self.moving(arrival, 0.0, arrival.duration_s),
            }
            self.turn(&here.c, 1);
        }
        self.enter(here);
        if leg.settle_s > 0.0 {
            self.pass_at(here, leg.settle_s);
        }
    }

    /// From ψ^n to ψ^n + U D.
    fn enter(&mut self, place: &Place<T>) {
        if let Some(shift) = &place.shift {
            let mut psi = self.v.rows_mut(0, 3);
            psi += shift;
        }
    }

    /// And back.
    fn leave(&mut self, place: &Place<T>) {
        if let Some(shift) = &place.shift {
            let mut psi = self.v.rows_mut(0, 3);
            psi -= shift;
        }
    }

    /// Turns the blocks from `first` on.
    fn turn(&mut self, q: &Matrix3<T>, first: usize) {
        for at in (3 * first..self.layout.states()).step_by(3) {
            for m in [&mut self.v, &mut self.g] {
                let turned = q * m.rows(at, 3);
                m.rows_mut(at, 3).copy_from(&turned);
            }
        }
    }

    /// A measured move: the filter's ticks run through it.
    fn measured_move(&mut self, arrival: &Move) {
        let period = self.model.period_s;
        let (ticks, remainder) = split_periods(arrival.duration_s, period);
        for tick in 0..ticks {
            self.moving(arrival, tick as f64 * period, period);
            self.measure_in_move(arrival, (tick + 1) as f64 * period, 1.0);
        }
        if remainder > 0.0 {
            self.moving(arrival, ticks as f64 * period, remainder);
            if self.rule == TickRule::Relaxed {
                self.measure_in_move(arrival, arrival.duration_s, remainder / period);
            }
        }
    }

    /// A measurement so long after the start of a move.
    fn measure_in_move(&mut self, m: &Move, time_s: f64, share: f64) {
        let place = self.selection.place_at(T::attitude(
            &self.model.stand,
            m.position_at(time_s / m.duration_s),
        ));
        self.enter(&place);
        self.measure(share, &place, &place.c);
        self.leave(&place);
    }

    fn dwell(&mut self, leg: &Leg, here: &Place<T>) {
        let (periods, remainder) = split_periods(leg.dwell_s, self.model.period_s);
        if periods > 0 {
            self.dwell_periods(here, periods);
        }
        if remainder > 0.0 {
            self.pass_at(here, remainder);
            if self.rule == TickRule::Relaxed {
                let share = remainder / self.model.period_s;
                self.measure(share, here, &Matrix3::identity());
            }
        }
    }

    fn dwell_periods(&mut self, here: &Place<T>, periods: usize) {
        let k = self.kernels.kernel(periods);
        let inputs = self.inputs(here);
        let t = &k.r11 * &self.v + &k.r12 * &inputs;
        self.condition(&k.r11, &t);
        self.rows.add_rows(&(&k.r22 * &inputs));
        if !self.layout.has_biases() {
            self.look_up(here, periods as f64);
        }
        self.v = &k.a_x * &self.v + &k.a_u * &inputs;
        self.g = root_of_sum(&(&k.a_x * &self.g), &k.u);
    }

    /// The inputs of each parameter: A', and b_y where it is one.
    fn inputs(&self, here: &Place<T>) -> DMatrix<T> {
        let mut inputs = DMatrix::zeros(self.layout.inputs(), self.v.ncols());
        inputs.rows_mut(0, 3).copy_from(&here.a);
        if self.layout.has_biases()
            && let Some(upward) = &here.upward
        {
            let noise = T::from(self.model.noise_variance).sqrt();
            inputs.row_mut(3).copy_from(&(upward.row(0) * noise));
        }
        inputs
    }

    /// Takes the measurement of `h` x, of which D is `t`, with unit noise.
    fn condition(&mut self, h: &DMatrix<T>, t: &DMatrix<T>) {
        let through = h * &self.g;
        let whitener = inverse_of(&one_and_rows(&through.transpose())).transpose();
        self.rows.add_rows(&(whitener * t));
        self.g = &self.g * inverse_of(&one_and_rows(&through));
        // V₊ = V − P₊ Hᵀ T.
        let gain = &self.g * (self.g.transpose() * h.transpose());
        self.v -= gain * t;
    }

    /// Time at a position without a measurement.
    fn pass_at(&mut self, here: &Place<T>, length_s: f64) {
        let CovarianceModel {
            dynamics,
            drift_psd,
            ..
        } = self.model;
        let passed = Passed::held(self.layout, dynamics, *drift_psd, length_s);
        let [_, gamma] = T::transition(dynamics, length_s);
        self.pass(&passed);
        let mut psi = self.v.rows_mut(0, 3);
        psi += gamma * &here.a;
    }

    /// An interval of a move.
    fn moving(&mut self, m: &Move, start_s: f64, length_s: f64) {
        let CovarianceModel {
            stand,
            dynamics,
            drift_psd,
            ..
        } = self.model;
        let part = (start_s, length_s);
        let passed = Passed::moved(self.layout, (stand, dynamics), *drift_psd, m, part);
        self.pass(&passed);
        let mut psi = self.v.rows_mut(0, 3);
        psi += self.selection.moved(m, start_s, length_s);
    }

    fn pass(&mut self, passed: &Passed<T>) {
        self.v = &passed.transition * &self.v;
        self.g = root_of_sum(&(&passed.transition * &self.g), &passed.u);
    }

    /// A measurement with the information of a `share` of a period, the biases' blocks as `biases` says.
    fn measure(&mut self, share: f64, at: &Place<T>, biases: &Matrix3<T>) {
        let Seen { of_x, of_bias } = Seen::new(self.layout, self.model.measured_variance(), biases);
        let root = T::from(share).sqrt();
        let h = of_x * root;
        let mut t = &h * &self.v;
        match &at.upward {
            Some(upward) if self.layout.has_biases() => {
                let noise = T::from(self.model.noise_variance).sqrt();
                for (row, weight) in of_bias.iter().enumerate() {
                    let mut row = t.row_mut(row);
                    row += upward.row(0) * (noise * *weight * root);
                }
            }
            Some(_) => self.look_up(at, share),
            None => {}
        }
        self.condition(&h, &t);
    }

    /// What the vertical channel tells of D alone in so many periods.
    fn look_up(&mut self, at: &Place<T>, periods: f64) {
        if let Some(upward) = &at.upward {
            let root = T::from(periods).sqrt();
            let row = upward.row(0) * root;
            let told = DMatrix::from_fn(1, row.ncols(), |_, j| row[j]);
            self.rows.add_rows(&told);
        }
    }
}
