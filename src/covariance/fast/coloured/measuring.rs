//! Measurements that end a part of a period, component by component.

use super::Place;
use super::algebra::Matrix;
use super::course::{Forward, Piece, Wanders};
use super::rows::add;
use super::tape::{At, Channel, Step, put};
use super::wander::Wander;
use crate::attitude::UP;
use crate::covariance::fast::arithmetic::{Arithmetic, Number, Row};
use crate::covariance::fast::course::Grows;

impl<A: Arithmetic, L: Wanders<A>, const S: usize, const I: usize> Forward<'_, A, L, S, I> {
    #[inline(always)]
    pub(super) fn vertical(
        &mut self,
        leg: usize,
        weight: A::Number,
        grows: Option<Grows<A::Number>>,
        index: At,
        at: &Place<A>,
    ) {
        let width = self.columns.width;
        let row = self.told.count();
        self.told
            .push(&at.output[UP * width..(UP + 1) * width], weight);
        if self.tape.on {
            self.step(leg, Step::Vertical { row, grows, index });
        }
    }

    /// All channels, with information `weight` each.
    #[inline(always)]
    pub(super) fn measure(
        &mut self,
        leg: usize,
        weight: A::Number,
        grows: Grows<A::Number>,
        index: At,
        at: &Place<A>,
    ) {
        for channel in [
            Channel::North,
            Channel::East,
            Channel::Vertical,
            Channel::Up,
        ] {
            let ratio = match channel {
                Channel::Vertical if I == 3 => continue,
                Channel::Up => match self.legs.azimuth() {
                    Some(ratio) => ratio,
                    None => continue,
                },
                _ => 1.0,
            };
            let weight = weight * self.ar.number(ratio);
            self.apart(
                leg,
                Piece::Measure(index, channel, weight, ratio, grows, at),
            );
        }
        if I == 3 && !at.output.is_empty() {
            self.vertical(leg, weight, Some(grows), index, at);
        }
    }

    /// A component h x: E += w/s yᵀy, V ← V − (w/s) p y, P ← P − (w/s) p pᵀ with y = h V and p = P hᵀ,
    /// s = 1 + w h p. h x itself shrinks by s: where it is of ψ, that component follows from the others
    /// without a difference.
    #[inline(always)]
    pub(super) fn measure_one(
        &mut self,
        (leg, index): (usize, At),
        channel: Channel,
        weight: A::Number,
        ratio: f64,
        grows: Grows<A::Number>,
        at: &Place<A>,
    ) {
        let (zero, one) = (self.ar.number(0.0), self.ar.number(1.0));
        let width = self.columns.width;
        let h = seen::<A, S>(self.ar, self.wander, channel);
        let mut column = [zero; S];
        for i in 0..S {
            for j in 0..S {
                if let Some(h) = h[j] {
                    column[i] = self.p[i][j].mul_add(h, column[i]);
                }
            }
        }
        let mut s = one;
        for j in 0..S {
            if let Some(h) = h[j] {
                s = (weight * h).mul_add(column[j], s);
            }
        }
        let (share, left) = (weight / s, one / s);
        let row = self.told.count();
        let from = self.told.rows.len();
        let nothing = self.ar.quad([zero; 4]);
        match at.output.get(UP * width..(UP + 1) * width) {
            Some(up) if channel == Channel::Vertical => self.told.rows.extend_from_slice(up),
            _ => self.told.rows.resize(from + width, nothing),
        }
        self.told.weights.push(share);
        let y = &mut self.told.rows[from..];
        for j in 0..S {
            if let Some(h) = h[j] {
                add(y, h, &self.v[j * width..(j + 1) * width]);
            }
        }
        let y = &self.told.rows[from..];
        let own = channel.sees().0;
        for i in 0..S {
            if Some(i) != own {
                add(
                    &mut self.v[i * width..(i + 1) * width],
                    -(share * column[i]),
                    y,
                );
            }
            for j in 0..=i {
                // Symmetric to the bit.
                let p = self.p[i][j] - share * column[i] * column[j];
                self.p[i][j] = p;
                self.p[j][i] = p;
            }
        }
        if let Some(own) = own {
            if I > 3 {
                shrink_among(
                    (&mut self.v, &mut self.p),
                    own,
                    &h,
                    &column,
                    (weight, left),
                    y,
                );
            } else {
                shrink((&mut self.v, &mut self.p), own, &column, left, y);
            }
        }
        if self.tape.on {
            let step = Step::Measure {
                channel,
                column: put(&mut self.tape.columns, column),
                weight,
                s,
                row,
                grows,
                ratio,
                index,
            };
            self.step(leg, step);
        }
    }
}

/// V = y/s and P hᵀ = p/s, for the component `own` of x that is seen alone.
#[inline(always)]
fn shrink<Q: Row, const S: usize>(
    (v, p): (&mut [Q], &mut Matrix<Q::Number, S, S>),
    own: usize,
    column: &[Q::Number; S],
    left: Q::Number,
    y: &[Q],
) {
    let width = y.len();
    for q in 0..width {
        v[own * width + q] = y[q].times(left);
    }
    for i in 0..S {
        let of = column[i] * left;
        p[i][own] = of;
        p[own][i] = of;
    }
}

/// h V = y/s and P hᵀ = p/s, for the component `own` of x among others that are seen.
#[inline(always)]
fn shrink_among<Q: Row, const S: usize>(
    (v, p): (&mut [Q], &mut Matrix<Q::Number, S, S>),
    own: usize,
    h: &[Option<Q::Number>; S],
    column: &[Q::Number; S],
    (weight, left): (Q::Number, Q::Number),
    y: &[Q],
) {
    let (zero, one) = (left.constant(0.0), left.constant(1.0));
    // A lane that waits keeps everything to the bit.
    let counts = one.where_greater(weight, zero, zero);
    let waits = one - counts;
    let width = y.len();
    for q in 0..width {
        let mut sum = y[q].times(left);
        for j in 0..S {
            if let Some(h) = h[j]
                && j != own
            {
                sum = v[j * width + q].times_add(-h, sum);
            }
        }
        let to = &mut v[own * width + q];
        *to = sum.times(counts).plus(to.times(waits));
    }
    // `own` last: of the others its own entry is made.
    for k in 0..S {
        let i = (own + 1 + k) % S;
        let mut sum = column[i] * left;
        for j in 0..S {
            if let Some(h) = h[j]
                && j != own
            {
                sum = sum - h * p[i][j];
            }
        }
        let sum = sum.where_greater(weight, zero, p[i][own]);
        p[i][own] = sum;
        p[own][i] = sum;
    }
}

/// h of a channel, component by component.
#[inline(always)]
pub(super) fn seen<A: Arithmetic, const S: usize>(
    ar: A,
    wander: &Wander,
    channel: Channel,
) -> [Option<A::Number>; S] {
    let mut h = [None; S];
    let (psi, bias) = channel.sees();
    if let Some(psi) = psi {
        h[psi] = Some(ar.number(1.0));
    }
    if let Some((axis, sign)) = bias {
        for (at, slot) in wander.slots.iter().enumerate() {
            if !slot.drives {
                h[3 + 3 * at + axis] = Some(ar.number(sign));
            }
        }
    }
    h
}
