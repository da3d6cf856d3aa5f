//! The numbers the chain computes with: one schedule's, or several schedules' side by side.
//!
//! The chain is written once, over [`Arithmetic`], and runs in three forms:
//!
//! | form | `Number` | a row of three or four | used for |
//! |---|---|---|---|
//! | [`Plain`] | `f64` | array | one schedule, any machine |
//! | [`Packed`] | `f64` | one 256-bit register | one schedule, AVX2 or AVX-512 |
//! | [`Lanes`] | a register, one lane per schedule | array of registers | many schedules |
//!
//! All of them do the same operations in the same order and never fuse a product with a sum, so a
//! schedule has the same bits on every machine, alone and in a lane: a search makes the same
//! choices wherever it runs.
//!
//! Everything here is `inline(always)`, and there are no closures on the way: a function compiled
//! on its own would not know the instruction set that its caller was dispatched to.

/// `[f(0), f(1), f(2)]`, written out: a closure handed to `map` is compiled on its own.
macro_rules! three {
    (|$i:ident| $entry:expr) => {
        [
            {
                let $i = 0;
                $entry
            },
            {
                let $i = 1;
                $entry
            },
            {
                let $i = 2;
                $entry
            },
        ]
    };
}

/// `[f(0), f(1), f(2), f(3)]`, as [`three`].
macro_rules! four {
    (|$i:ident| $entry:expr) => {
        [
            {
                let $i = 0;
                $entry
            },
            {
                let $i = 1;
                $entry
            },
            {
                let $i = 2;
                $entry
            },
            {
                let $i = 3;
                $entry
            },
        ]
    };
}

pub(crate) use {four, three};

mod lanes;
mod packed;

pub(crate) use lanes::Lanes;
pub(crate) use packed::Packed;

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

use pulp::bytemuck::{cast, cast_slice};
use pulp::{NullaryFnOnce, Simd};

use crate::motion::integral::Panels;

/// A real number, or one per lane.
pub(crate) trait Number:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// `value`, in every lane.
    fn constant(self, value: f64) -> Self;
    /// `self · factor + term`.
    fn mul_add(self, factor: Self, term: Self) -> Self;
    /// √self.
    fn sqrt(self) -> Self;
    /// `self` where `left > right`, else `otherwise`.
    fn where_greater(self, left: Self, right: Self, otherwise: Self) -> Self;
}

/// Three or four numbers that are worked on together: a row of a 3×3 matrix, or the factors
/// (1, g_x, g_y, g_z) of one gyro's coefficients.
pub(crate) trait Row: Copy + Debug {
    /// What it is made of.
    type Number: Number;
    /// Entry `i`.
    fn get(self, i: usize) -> Self::Number;
    /// `self · factor`.
    fn times(self, factor: Self::Number) -> Self;
    /// `self · factor + term`.
    fn times_add(self, factor: Self::Number, term: Self) -> Self;
    /// As [`Row::times_add`]; entries before `first` may be left as they are in `term`.
    fn times_add_from(self, factor: Self::Number, term: Self, first: usize) -> Self;
    /// `self + other`.
    fn plus(self, other: Self) -> Self;
    /// `self − other`.
    fn minus(self, other: Self) -> Self;
    /// The product entry by entry.
    fn by(self, other: Self) -> Self;
    /// Σ self_i.
    fn total(self) -> Self::Number;
    /// Σ self_i other_i.
    #[inline(always)]
    fn dot(self, other: Self) -> Self::Number {
        self.by(other).total()
    }
}

/// A piece of the chain's work.
pub(crate) trait Work {
    /// What comes of it.
    type Output;
    /// Does it; always inlined.
    fn run(self) -> Self::Output;
}

/// Work that is compiled for an instruction set of its own.
struct Apart<W>(W);

impl<W: Work> NullaryFnOnce for Apart<W> {
    type Output = W::Output;
    #[inline(always)]
    fn call(self) -> W::Output {
        self.0.run()
    }
}

/// Never inlined: the whole chain in one function takes the compiler minutes.
#[inline(never)]
fn call_apart<S: Simd, W: Work>(simd: S, work: W) -> W::Output {
    simd.vectorize(Apart(work))
}

/// The same without registers of a kind.
#[inline(never)]
fn call_plainly<W: Work>(work: W) -> W::Output {
    work.run()
}

/// A choice of numbers and rows.
pub(crate) trait Arithmetic: Copy + Debug {
    /// Real numbers.
    type Number: Number;
    /// Rows of 3×3 matrices.
    type Triple: Row<Number = Self::Number>;
    /// The four coefficients of a gyro.
    type Quad: Row<Number = Self::Number>;
    /// Numbers at several nodes of a quadrature at once.
    type Node: Number;
    /// How an interval is integrated, in every lane.
    type Panels: Copy + Debug;
    /// How often a sum over the nodes goes over them: a pass visits every fourth of them or, where a
    /// [`Arithmetic::Node`] is four nodes, all.
    const PASSES: usize;

    /// A constant.
    fn number(self, value: f64) -> Self::Number;
    /// Does `work`; in lanes, where it is bulky, as a function of its own.
    #[inline(always)]
    fn apart<W: Work>(self, work: W) -> W::Output {
        work.run()
    }
    /// Does `work` as a function of its own, in lanes or not: what is bulky for one schedule too.
    fn always_apart<W: Work>(self, work: W) -> W::Output;
    /// A row of three.
    fn triple(self, entries: [Self::Number; 3]) -> Self::Triple;
    /// A row of three constants; the fourth is padding, zero.
    fn constants(self, padded: &[f64; 4]) -> Self::Triple;
    /// A row of four.
    fn quad(self, entries: [Self::Number; 4]) -> Self::Quad;
    /// The same at every node.
    fn at_nodes(self, value: Self::Number) -> Self::Node;
    /// How many steps a pass over the nodes of `panels` takes.
    fn steps(self, panels: &Self::Panels) -> usize;
    /// 1 by the number of panels.
    fn panel_share(self, panels: &Self::Panels) -> Self::Number;
    /// The places, in widths of a panel, and weights of the nodes visited in a step of a pass.
    fn nodes(self, panels: &Self::Panels, pass: usize, step: usize) -> [Self::Node; 2];
    /// The sum over the nodes.
    fn sum_nodes(self, values: Self::Node) -> Self::Number;
}

/// The arithmetic of one schedule.
pub(crate) trait Single: Arithmetic<Number = f64, Panels = Panels> + 'static {}

impl<A: Arithmetic<Number = f64, Panels = Panels> + 'static> Single for A {}

impl Number for f64 {
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        // Not f64::mul_add: two roundings, the same on every machine.
        self * factor + term
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn where_greater(self, left: Self, right: Self, otherwise: Self) -> Self {
        if left > right { self } else { otherwise }
    }
}

/// A row as an array.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct InArray<L, const N: usize>(pub [L; N]);

impl<L: Number, const N: usize> Row for InArray<L, N> {
    type Number = L;
    #[inline(always)]
    fn get(self, i: usize) -> L {
        self.0[i]
    }
    #[inline(always)]
    fn times(mut self, factor: L) -> Self {
        for entry in &mut self.0 {
            *entry = *entry * factor;
        }
        self
    }
    #[inline(always)]
    fn times_add(self, factor: L, term: Self) -> Self {
        self.times_add_from(factor, term, 0)
    }
    #[inline(always)]
    fn times_add_from(self, factor: L, mut term: Self, first: usize) -> Self {
        // All indices constant, so that rows stay in registers.
        for i in 0..N {
            if i >= first {
                term.0[i] = self.0[i].mul_add(factor, term.0[i]);
            }
        }
        term
    }
    #[inline(always)]
    fn plus(mut self, other: Self) -> Self {
        for i in 0..N {
            self.0[i] = self.0[i] + other.0[i];
        }
        self
    }
    #[inline(always)]
    fn minus(mut self, other: Self) -> Self {
        for i in 0..N {
            self.0[i] = self.0[i] - other.0[i];
        }
        self
    }
    #[inline(always)]
    fn by(mut self, other: Self) -> Self {
        for i in 0..N {
            self.0[i] = self.0[i] * other.0[i];
        }
        self
    }
    #[inline(always)]
    fn total(self) -> L {
        // The order of `Packed`: opposite halves first.
        let p = self.0;
        match N {
            3 => (p[0] + p[2]) + p[1],
            _ => (p[0] + p[2]) + (p[1] + p[3]),
        }
    }
}

/// One schedule in plain numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plain;

impl Arithmetic for Plain {
    type Number = f64;
    type Triple = InArray<f64, 3>;
    type Quad = InArray<f64, 4>;
    type Node = Four;
    type Panels = Panels;
    const PASSES: usize = 1;

    /// Machines without better registers are not worth the compiler's time.
    #[inline(always)]
    fn apart<W: Work>(self, work: W) -> W::Output {
        call_plainly(work)
    }
    #[inline(always)]
    fn always_apart<W: Work>(self, work: W) -> W::Output {
        call_plainly(work)
    }

    #[inline(always)]
    fn number(self, value: f64) -> f64 {
        value
    }
    #[inline(always)]
    fn triple(self, entries: [f64; 3]) -> Self::Triple {
        InArray(entries)
    }
    #[inline(always)]
    fn constants(self, padded: &[f64; 4]) -> Self::Triple {
        InArray([padded[0], padded[1], padded[2]])
    }
    #[inline(always)]
    fn quad(self, entries: [f64; 4]) -> Self::Quad {
        InArray(entries)
    }
    #[inline(always)]
    fn at_nodes(self, value: f64) -> Four {
        Four([value; 4])
    }
    #[inline(always)]
    fn steps(self, panels: &Panels) -> usize {
        panels.steps()
    }
    #[inline(always)]
    fn panel_share(self, panels: &Panels) -> f64 {
        panels.share()
    }
    #[inline(always)]
    fn nodes(self, panels: &Panels, _: usize, step: usize) -> [Four; 2] {
        let (panel, group) = panels.group(step);
        [Four(group.places) + Four([panel; 4]), Four(group.weights)]
    }
    #[inline(always)]
    fn sum_nodes(self, values: Four) -> f64 {
        let v = values.0;
        (v[0] + v[2]) + (v[1] + v[3])
    }
}

/// Four nodes of a quadrature in plain numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Four([f64; 4]);

impl Add for Four {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(four!(|i| self.0[i] + other.0[i]))
    }
}
impl Sub for Four {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(four!(|i| self.0[i] - other.0[i]))
    }
}
impl Mul for Four {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(four!(|i| self.0[i] * other.0[i]))
    }
}
impl Div for Four {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(four!(|i| self.0[i] / other.0[i]))
    }
}
impl Neg for Four {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(four!(|i| -self.0[i]))
    }
}
impl Number for Four {
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self([value; 4])
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        self * factor + term
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(four!(|i| self.0[i].sqrt()))
    }
    #[inline(always)]
    fn where_greater(self, left: Self, right: Self, otherwise: Self) -> Self {
        Self(four!(|i| self.0[i].where_greater(
            left.0[i],
            right.0[i],
            otherwise.0[i]
        )))
    }
}

/// No register has more lanes.
pub(crate) const MOST_LANES: usize = 8;

/// Where a register lies in memory. `pulp`'s own types are aligned as one number; a register that
/// straddles two cache lines takes two accesses, and half of them would.
pub(crate) trait Alignment: Copy + Debug + 'static {}

/// Of registers of eight numbers.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Align64;
impl Alignment for Align64 {}

/// Of registers of four numbers or fewer.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
pub(crate) struct Align32;
impl Alignment for Align32 {}

/// A register of `S`, one number per lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Register<S: Simd, L: Alignment> {
    simd: S,
    lanes: S::f64s,
    _alignment: [L; 0],
}

impl<S: Simd, L: Alignment> Register<S, L> {
    /// From a register.
    #[inline(always)]
    pub fn new(simd: S, lanes: S::f64s) -> Self {
        Self {
            simd,
            lanes,
            _alignment: [],
        }
    }

    /// With `values` in its lanes.
    #[inline(always)]
    pub fn gather(simd: S, values: &[f64; MOST_LANES]) -> Self {
        Self::new(simd, cast_slice(&values[..S::F64_LANES])[0])
    }

    /// Lane `i`.
    #[inline(always)]
    pub fn lane(&self, i: usize) -> f64 {
        cast_slice::<S::f64s, f64>(std::slice::from_ref(&self.lanes))[i]
    }

    #[inline(always)]
    fn like(self, lanes: S::f64s) -> Self {
        Self { lanes, ..self }
    }
}

impl<S: Simd, L: Alignment> Add for Register<S, L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.like(self.simd.add_f64s(self.lanes, other.lanes))
    }
}
impl<S: Simd, L: Alignment> Sub for Register<S, L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.like(self.simd.sub_f64s(self.lanes, other.lanes))
    }
}
impl<S: Simd, L: Alignment> Mul for Register<S, L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.like(self.simd.mul_f64s(self.lanes, other.lanes))
    }
}
impl<S: Simd, L: Alignment> Div for Register<S, L> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.like(self.simd.div_f64s(self.lanes, other.lanes))
    }
}
impl<S: Simd, L: Alignment> Neg for Register<S, L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.like(self.simd.neg_f64s(self.lanes))
    }
}
impl<S: Simd, L: Alignment> Number for Register<S, L> {
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        self.like(self.simd.splat_f64s(value))
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        // Two roundings, as in plain numbers.
        self * factor + term
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.like(self.simd.sqrt_f64s(self.lanes))
    }
    #[inline(always)]
    fn where_greater(self, left: Self, right: Self, otherwise: Self) -> Self {
        let greater = self.simd.greater_than_f64s(left.lanes, right.lanes);
        self.like(self.simd.select_f64s(greater, self.lanes, otherwise.lanes))
    }
}

/// A row of three or four `f64` in one register of four.
impl<S: Simd, L: Alignment> Row for Register<S, L> {
    type Number = f64;
    #[inline(always)]
    fn get(self, i: usize) -> f64 {
        cast::<S::f64s, [f64; 4]>(self.lanes)[i]
    }
    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        self * self.constant(factor)
    }
    #[inline(always)]
    fn times_add(self, factor: f64, term: Self) -> Self {
        self.mul_add(self.constant(factor), term)
    }
    #[inline(always)]
    fn times_add_from(self, factor: f64, term: Self, _: usize) -> Self {
        self.times_add(factor, term)
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self + other
    }
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self - other
    }
    #[inline(always)]
    fn by(self, other: Self) -> Self {
        self * other
    }
    #[inline(always)]
    fn total(self) -> f64 {
        let p: [f64; 4] = cast(self.lanes);
        (p[0] + p[2]) + (p[1] + p[3])
    }
}
