//! From the end of a test back to its start: what the rest tells, leg by leg. In matrices of any size, so that
//! the compiler has it once.

use nalgebra::{Cholesky, DMatrix};

use super::Entries4;
use crate::attitude::{EAST, NORTH, UP};
use crate::covariance::fast::arithmetic::{Arithmetic, Plain, Row, four};
use crate::covariance::fast::coloured::algebra::{Matrix, transpose};
use crate::covariance::fast::coloured::course::{Wanders, on_the_way, part};
use crate::covariance::fast::coloured::integral::integral;
use crate::covariance::fast::coloured::measuring::seen;
use crate::covariance::fast::coloured::moving::Panel;
use crate::covariance::fast::coloured::place::Place;
use crate::covariance::fast::coloured::rows::add_squares;
use crate::covariance::fast::coloured::tape::Channel;
use crate::covariance::fast::coloured::wander::{Share, Transition, Wander, add_noise};
use crate::covariance::fast::coloured::{Coloured, Columns};
use crate::covariance::fast::course::Stretch;
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::moves::product;
use crate::covariance::fast::square::Entries;
use crate::covariance::{CovarianceModel, not_finite};
use crate::error::Result;
use crate::motion::integral::Panels;

type Quad = <Plain as Arithmetic>::Quad;

/// States of the largest size.
const MOST: usize = 15;

/// What the rest of a test tells, from the dwell of a leg on.
#[derive(Debug, Clone)]
pub(super) struct Rest {
    /// R, as many rows as x has components, and S.
    pub of_x: Vec<f64>,
    pub of_d: Vec<Entries4>,
    /// How many rows are of the parameters alone, and their sum of squares.
    pub alone: usize,
    pub gram: Vec<Entries4>,
}

/// On its way.
pub(super) struct Backward<'a, L> {
    columns: &'a Columns,
    wander: &'a Wander,
    legs: &'a L,
    earth: Earth<f64>,
    states: usize,
    inputs: usize,
    /// R and S.
    r: DMatrix<f64>,
    s: DMatrix<f64>,
    /// Λ.
    noise: Vec<f64>,
    /// Rows of the parameters alone.
    alone: Vec<Quad>,
    /// The sum of squares of the first `summed` of them.
    gram: Vec<Quad>,
    summed: usize,
}

impl<'a, L: Wanders<Plain>> Backward<'a, L> {
    pub fn new(model: &CovarianceModel, coloured: &'a Coloured, legs: &'a L) -> Self {
        let Coloured { columns, wander } = coloured;
        let states = 3 + 3 * wander.slots.len();
        let width = columns.width;
        let pinned = if columns.walked.is_empty() { 0 } else { 3 };
        Self {
            columns,
            wander,
            legs,
            earth: Earth::new(0.0, &model.dynamics, &model.stand, model.drift_psd),
            states,
            inputs: if states == MOST { 4 } else { 3 },
            // The walk is 0.
            r: DMatrix::from_fn(pinned, states, |i, j| f64::from(u8::from(j == 3 + i))),
            s: DMatrix::zeros(pinned, 4 * width),
            noise: vec![0.0; pinned],
            alone: Vec::new(),
            gram: vec![Plain.quad([0.0; 4]); 4 * width * width],
            summed: 0,
        }
    }

    /// Through all legs; gives the rest from the dwell of each on, and the rows of the parameters alone.
    pub fn run(mut self) -> Result<(Vec<Option<Rest>>, Vec<Entries4>)> {
        let count = self.legs.count();
        let places: Vec<Place<Plain>> = (0..count)
            .map(|leg| self.place(self.legs.attitude(leg)))
            .collect();
        let mut rests = vec![None; count];
        for leg in (0..count).rev() {
            let at = &places[leg];
            if self.legs.remains(leg) {
                let (length_s, weight) = self.legs.remainder(leg);
                if let Some(weight) = weight {
                    self.measure(weight, at);
                }
                self.pass(at, length_s, self.wander.rest_halves)?;
            }
            self.dwell(leg, at)?;
            rests[leg] = self.cut()?;
            if self.legs.settles(leg) {
                self.pass(at, self.legs.settle_s(leg), self.wander.settle_halves)?;
            }
            if let Some(from) = leg.checked_sub(1).map(|before| &places[before]) {
                self.arrive(leg, from, at)?;
            }
        }
        let alone = super::entries(&self.alone);
        Ok((rests, alone))
    }

    fn place(&self, c: Entries<f64>) -> Place<Plain> {
        Place::at_rest(Plain, self.columns, &self.earth, c)
    }

    /// Rows over the parameters.
    fn dense(&self, rows: &[Quad]) -> DMatrix<f64> {
        let width = self.columns.width;
        DMatrix::from_fn(rows.len() / width, 4 * width, |i, j| {
            rows[i * width + j / 4].get(j % 4)
        })
    }

    /// The rest as it is; none where it is nothing but that the walk is 0.
    fn cut(&mut self) -> Result<Option<Rest>> {
        let (rows, width) = (self.r.nrows(), self.columns.width);
        if self.noise.contains(&0.0) || rows == 0 {
            // No time has passed: then nothing can have been measured either.
            let nothing = self.noise.iter().all(|n| *n == 0.0) && self.alone.is_empty();
            return nothing.then_some(None).ok_or_else(not_finite);
        }
        let alone = self.alone.len() / width;
        let weights = vec![1.0; alone - self.summed];
        let new = &self.alone[self.summed * width..];
        add_squares(&mut self.gram, new, &weights, width);
        self.summed = alone;
        let row = |m: &DMatrix<f64>, i: usize, j: usize| match i < rows {
            true => m[(i, j)],
            false => 0.0,
        };
        let states = self.states;
        let (mut of_x, mut of_d) = (Vec::new(), Vec::new());
        for i in 0..states {
            of_x.extend((0..states).map(|j| row(&self.r, i, j)));
            of_d.extend((0..width).map(|q| four!(|e| row(&self.s, i, 4 * q + e))));
        }
        if of_x
            .iter()
            .chain(of_d.iter().flatten())
            .all(|v| v.is_finite())
        {
            return Ok(Some(Rest {
                of_x,
                of_d,
                alone,
                gram: super::entries(&self.gram),
            }));
        }
        Err(not_finite())
    }

    /// Back through x ← `t` x + `b` D + noise of covariance `q`, `b` the first rows.
    fn through(
        &mut self,
        t: &DMatrix<f64>,
        q: &DMatrix<f64>,
        b: Option<&DMatrix<f64>>,
    ) -> Result<()> {
        if self.r.nrows() == 0 {
            return Ok(());
        }
        let mut noise = &self.r * q * self.r.transpose();
        for (i, own) in self.noise.iter().enumerate() {
            noise[(i, i)] += own;
        }
        let root = Cholesky::new(noise).ok_or_else(not_finite)?.unpack();
        if let Some(b) = b {
            self.s += self.r.columns(0, b.nrows()) * b;
        }
        self.r *= t;
        let is_solved = root.solve_lower_triangular_mut(&mut self.r)
            && root.solve_lower_triangular_mut(&mut self.s);
        if !is_solved {
            return Err(not_finite());
        }
        self.noise.fill(1.0);
        self.reduce();
        Ok(())
    }

    /// With more rows of unit noise.
    fn stack(&mut self, of_x: &DMatrix<f64>, of_d: &DMatrix<f64>) {
        let (rows, more) = (self.r.nrows(), of_x.nrows());
        for (to, of) in [(&mut self.r, of_x), (&mut self.s, of_d)] {
            let mut both = DMatrix::zeros(rows + more, of.ncols());
            both.rows_mut(0, rows).copy_from(to);
            both.rows_mut(rows, more).copy_from(of);
            *to = both;
        }
        self.noise.resize(rows + more, 1.0);
        self.reduce();
    }

    /// As many rows as x has components, by Householder's reflections; what is left is of the parameters
    /// alone. Only of unit noise.
    fn reduce(&mut self) {
        let (rows, states) = (self.r.nrows(), self.states);
        if rows <= states || self.noise.contains(&0.0) {
            return;
        }
        let mut v = vec![0.0; rows];
        for column in 0..states {
            let below = self.r.view((column, column), (rows - column, 1));
            let norm2 = below.norm_squared();
            if norm2 == 0.0 {
                continue;
            }
            let pivot = self.r[(column, column)];
            for row in column..rows {
                v[row] = self.r[(row, column)];
            }
            v[column] += norm2.sqrt().copysign(pivot);
            let scale = 2.0 / (norm2 - pivot * pivot + v[column] * v[column]);
            let v = &v[column..];
            for (of, first) in [(&mut self.r, column), (&mut self.s, 0)] {
                for mut of in of.column_iter_mut().skip(first) {
                    let below = &mut of.as_mut_slice()[column..];
                    let dot: f64 = below.iter().zip(v).map(|(a, b)| a * b).sum();
                    below
                        .iter_mut()
                        .zip(v)
                        .for_each(|(a, b)| *a -= scale * dot * b);
                }
            }
            self.r
                .view_mut((column + 1, column), (rows - column - 1, 1))
                .fill(0.0);
        }
        for row in states..rows {
            self.push_alone(1.0, row);
        }
        self.r = self.r.rows(0, states).into_owned();
        self.s = self.s.rows(0, states).into_owned();
        self.noise.truncate(states);
    }

    /// Row `row` of S is of the parameters alone.
    fn push_alone(&mut self, factor: f64, row: usize) {
        for q in 0..self.columns.width {
            let of = four!(|e| factor * self.s[(row, 4 * q + e)]);
            self.alone.push(Plain.quad(of));
        }
    }

    /// The transition and the noise of an interval.
    fn interval(
        &self,
        phi: &Entries<f64>,
        shares: &[Share<f64>],
        white: f64,
    ) -> (DMatrix<f64>, DMatrix<f64>) {
        let Transition { top, kept } =
            Transition::<f64, MOST>::new(&self.wander.slots, phi, shares);
        let mut noise: Matrix<f64, MOST, MOST> = [[0.0; MOST]; MOST];
        add_noise(&self.wander.slots, &mut noise, shares, white);
        let states = self.states;
        let t = DMatrix::from_fn(states, states, |i, j| match i < 3 {
            true => top[i][j],
            false if i == j => kept[i],
            false => 0.0,
        });
        (t, DMatrix::from_fn(states, states, |i, j| noise[i][j]))
    }

    /// Time at a place without a measurement.
    fn pass(&mut self, at: &Place<Plain>, length_s: f64, halves: u32) -> Result<()> {
        if length_s == 0.0 {
            return Ok(());
        }
        let passed = self.earth.pass::<Plain>(length_s);
        let shares = self.wander.held(&self.earth, length_s, halves);
        let (t, q) = self.interval(&passed.phi, &shares, passed.process);
        let gamma = DMatrix::from_fn(3, 3, |i, j| passed.gamma[i][j]);
        let b = gamma * self.dense(&at.drift);
        self.through(&t, &q, Some(&b))
    }

    /// Whole periods at a place.
    fn dwell(&mut self, leg: usize, at: &Place<Plain>) -> Result<()> {
        let Some(kernel) = self.legs.kernel(leg) else {
            return Ok(());
        };
        let (states, inputs) = (self.states, self.inputs);
        let mut from = &kernel[..];
        let mut take = |rows: usize, columns: usize| {
            let (of, rest) = from.split_at(rows * columns);
            from = rest;
            DMatrix::from_row_slice(rows, columns, of)
        };
        let (r11, r12) = (take(states, states), take(states, inputs));
        let (a_x, a_u, c) = (
            take(states, states),
            take(states, inputs),
            take(states, states),
        );
        let _gains = (take(states, states), take(states, inputs));
        let r22 = take(inputs, inputs);
        let u = match inputs {
            3 => at.inputs::<3>(Plain, self.columns),
            _ => at.inputs::<4>(Plain, self.columns),
        };
        let u = self.dense(&u);
        self.through(&a_x, &c, Some(&(a_u * &u)))?;
        self.stack(&r11, &(r12 * &u));
        let alone = r22 * u;
        for row in 0..inputs {
            for q in 0..self.columns.width {
                let of = four!(|e| alone[(row, 4 * q + e)]);
                self.alone.push(Plain.quad(of));
            }
        }
        if self.inputs == 3 {
            self.vertical(self.legs.vertical(leg), at);
        }
        Ok(())
    }

    /// What the vertical channel tells of the parameters alone.
    fn vertical(&mut self, weight: f64, at: &Place<Plain>) {
        let width = self.columns.width;
        if let Some(up) = at.output.get(UP * width..(UP + 1) * width) {
            let root = weight.sqrt();
            self.alone.extend(up.iter().map(|q| q.times(root)));
        }
    }

    /// A measurement with information `weight` in every channel.
    fn measure(&mut self, weight: f64, at: &Place<Plain>) {
        if weight == 0.0 {
            return;
        }
        let (states, width) = (self.states, self.columns.width);
        for channel in [
            Channel::North,
            Channel::East,
            Channel::Vertical,
            Channel::Up,
        ] {
            let ratio = match channel {
                Channel::Vertical if self.inputs == 3 => continue,
                Channel::Up => match self.legs.azimuth() {
                    Some(ratio) => ratio,
                    None => continue,
                },
                _ => 1.0,
            };
            let root = (weight * ratio).sqrt();
            let h = seen::<Plain, MOST>(Plain, self.wander, channel);
            let of_x = DMatrix::from_fn(1, states, |_, j| root * h[j].unwrap_or(0.0));
            let of_d = match at.output.get(UP * width..(UP + 1) * width) {
                Some(up) if channel == Channel::Vertical => self.dense(up) * root,
                _ => DMatrix::zeros(1, 4 * width),
            };
            self.stack(&of_x, &of_d);
        }
        if self.inputs == 3 {
            self.vertical(weight, at);
        }
    }

    fn arrive(&mut self, leg: usize, from: &Place<Plain>, at: &Place<Plain>) -> Result<()> {
        for index in (0..self.legs.stretches(leg)).rev() {
            self.stretch(leg, index, from, at)?;
        }
        if self.legs.rotates(leg) {
            self.shift(at, 1.0);
            if self.legs.turns(leg) > 0.0 {
                self.turn(0, &product(&at.c, &transpose(&from.c)));
            }
            self.shift(from, -1.0);
        }
        Ok(())
    }

    /// Back through x ← x with its blocks from `first` on turned.
    fn turn(&mut self, first: usize, q: &Entries<f64>) {
        let q = DMatrix::from_fn(3, 3, |i, j| q[i][j]);
        for block in (first..self.states).step_by(3) {
            let turned = self.r.columns(block, 3) * &q;
            self.r.columns_mut(block, 3).copy_from(&turned);
        }
    }

    /// Back through ψ ← ψ + `by` U D.
    fn shift(&mut self, at: &Place<Plain>, by: f64) {
        if at.output.is_empty() {
            return;
        }
        let output = self.dense(&at.output);
        self.s += self.r.column(EAST) * output.row(NORTH) * by;
        self.s -= self.r.column(NORTH) * output.row(EAST) * by;
    }

    fn stretch(
        &mut self,
        leg: usize,
        index: usize,
        from: &Place<Plain>,
        at: &Place<Plain>,
    ) -> Result<()> {
        let s: Stretch<f64, Panels> = self.legs.stretch(leg, index);
        let there = |end: bool| on_the_way(Plain, self.columns, &self.earth, &s, end).0;
        let start = (index > 0).then(|| there(false));
        let end = (index + 1 < self.legs.stretches(leg)).then(|| there(true));
        let (start, end) = (start.as_ref().unwrap_or(from), end.as_ref().unwrap_or(at));
        if let Some((weight, _)) = s.measured {
            self.measure(weight, end);
        }
        self.shift(end, s.present);
        if !s.turn.instant || self.columns.has_torquers() {
            let (turn, interval) = (&s.turn, &s.interval);
            let of = integral(Plain, self.columns, &self.earth, turn, interval, &s.panels);
            let b = self.dense(&self.columns.spread(Plain, &of));
            self.s += self.r.columns(0, 3) * b;
        }
        let turns = self.legs.turns(leg) > 0.0;
        let (most, count) = self.legs.panels(leg, index);
        if most == 0 {
            if turns {
                self.turn(3, &product(&end.c, &transpose(&start.c)));
            }
        } else {
            if turns {
                self.turn(3, &end.c);
            }
            for panel in (0..most).rev() {
                let interval = part(&s, panel, count);
                let at = Panel::new(&self.earth, &s.turn, &interval);
                let slots = self.wander.slots.iter();
                let shares: Vec<Share<f64>> = slots.map(|slot| at.share(slot)).collect();
                let passed = self.earth.pass::<Plain>(interval.length_s);
                let (t, q) = self.interval(&passed.phi, &shares, passed.process);
                self.through(&t, &q, None)?;
            }
            if turns {
                self.turn(3, &transpose(&start.c));
            }
        }
        self.shift(start, -s.present);
        Ok(())
    }
}
