//! What a run tells, and what it leaves for the way back.

use std::any::Any;
use std::cell::RefCell;

use super::algebra::Matrix;
use super::wander::Transition;
use crate::attitude::{EAST, NORTH, UP};
use crate::covariance::fast::arithmetic::Arithmetic;
use crate::covariance::fast::course::Grows;
use crate::covariance::fast::square::Entries;

/// What the measurements tell: rows over the parameters, and their weights.
#[derive(Debug)]
pub(super) struct Told<A: Arithmetic> {
    pub rows: Vec<A::Quad>,
    pub weights: Vec<A::Number>,
}

impl<A: Arithmetic> Told<A> {
    /// How many rows.
    pub fn count(&self) -> usize {
        self.weights.len()
    }

    #[inline(always)]
    pub fn push(&mut self, row: &[A::Quad], weight: A::Number) {
        self.rows.extend_from_slice(row);
        self.weights.push(weight);
    }
}

/// A component of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Channel {
    /// ψ_x, by z_3 = −ψ_x + b_3.
    North,
    /// ψ_z, by z_1 = ψ_z + b_1.
    East,
    /// ψ_y, the azimuth.
    Up,
    /// z_2 = b_2, of biases that wander.
    Vertical,
}

impl Channel {
    /// The component of ψ, if it sees one, and that of every block of biases with its sign.
    #[inline(always)]
    pub fn sees(self) -> (Option<usize>, Option<(usize, f64)>) {
        match self {
            Self::North => (Some(NORTH), Some((EAST, -1.0))),
            Self::East => (Some(EAST), Some((NORTH, 1.0))),
            Self::Up => (Some(UP), None),
            Self::Vertical => (None, Some((UP, 1.0))),
        }
    }
}

/// How the blocks of x turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turning {
    /// From one attitude to another: C₂ C₁ᵀ.
    Across,
    /// From n into the platform: C₁ᵀ.
    Into,
    /// From the platform into n: C₂.
    OutOf,
}

/// Where in a move: at a stretch, or nowhere in it where changes of position are of frame-hold.
pub(super) type At = Option<usize>;

/// What the reverse mode has to remember of a step. Matrices are in the tape, by number; rows from
/// where `v` says.
#[derive(Debug, Clone, Copy)]
pub(super) enum Step<N> {
    /// ψ' becomes ψ.
    Leave(At),
    /// ψ becomes ψ'.
    Arrive(At),
    /// Blocks turn: V and P before it.
    Turn {
        at: At,
        kind: Turning,
        q: usize,
        v: usize,
        p: usize,
    },
    /// A panel of a stretch: its transition, V and P before it.
    Panel {
        index: usize,
        panel: usize,
        t: usize,
        v: usize,
        p: usize,
    },
    /// The end of a stretch: V and P there.
    Moved { index: usize, v: usize, p: usize },
    /// Time at a place without a measurement: its transition and Γ.
    Pass { t: usize, gamma: usize },
    /// The length of the time before counts: V and P after it.
    Length { v: usize, p: usize },
    /// Whole periods of a dwell: Y and M, Z and N, R22; its rows begin at `row`.
    Dwell {
        y: usize,
        z: usize,
        r22: usize,
        row: usize,
    },
    /// A component of a measurement with weight w: P hᵀ before it, and s = 1 + w h P hᵀ.
    Measure {
        channel: Channel,
        column: usize,
        weight: N,
        s: N,
        row: usize,
        grows: Grows<N>,
        /// What the weight is of the one that grows.
        ratio: f64,
        /// After which stretch of a move it is, if in one.
        index: At,
    },
    /// The vertical channel of a measurement that sees nothing of x, and after which stretch of a move it
    /// is, if in one; in a dwell it does not grow.
    Vertical {
        row: usize,
        grows: Option<Grows<N>>,
        index: At,
    },
    /// At the end the random walk has come to 0: the inverse of a root of its covariance.
    Pin { root: usize, row: usize },
}

/// What the forward run leaves behind.
#[derive(Debug)]
pub(super) struct Tape<A: Arithmetic, const S: usize, const I: usize> {
    /// Whether anything is kept.
    pub on: bool,
    /// Leg and step, in order.
    pub steps: Vec<(usize, Step<A::Number>)>,
    pub rows: Vec<A::Quad>,
    pub states: Vec<Matrix<A::Number, S, S>>,
    pub passed: Vec<Transition<A::Number, S>>,
    pub inputs: Vec<Matrix<A::Number, S, I>>,
    pub told: Vec<Matrix<A::Number, I, I>>,
    pub small: Vec<Entries<A::Number>>,
    pub columns: Vec<[A::Number; S]>,
}

/// Puts something down, and says where.
#[inline(always)]
pub(super) fn put<T>(to: &mut Vec<T>, of: T) -> usize {
    to.push(of);
    to.len() - 1
}

impl<A: Arithmetic, const S: usize, const I: usize> Tape<A, S, I> {
    /// Empty.
    fn new() -> Self {
        Self {
            on: false,
            steps: Vec::new(),
            rows: Vec::new(),
            states: Vec::new(),
            passed: Vec::new(),
            inputs: Vec::new(),
            told: Vec::new(),
            small: Vec::new(),
            columns: Vec::new(),
        }
    }

    fn clear(&mut self, on: bool) {
        self.on = on;
        self.steps.clear();
        self.rows.clear();
        self.states.clear();
        self.passed.clear();
        self.inputs.clear();
        self.told.clear();
        self.small.clear();
        self.columns.clear();
    }

    #[inline(always)]
    pub fn keep(&mut self, of: &[A::Quad]) -> usize {
        let at = self.rows.len();
        self.rows.extend_from_slice(of);
        at
    }
}

/// Tape and rows of a run: their memory is used again.
#[derive(Debug)]
pub(super) struct Memory<A: Arithmetic, const S: usize, const I: usize> {
    pub tape: Tape<A, S, I>,
    pub told: Told<A>,
}

thread_local! {
    /// That of the last run of this thread.
    static MEMORY: RefCell<Option<Box<dyn Any>>> = const { RefCell::new(None) };
}

impl<A: Arithmetic + 'static, const S: usize, const I: usize> Memory<A, S, I> {
    /// This thread's, empty. Taken out, not borrowed: a figure of merit may itself ask for a gradient.
    pub fn take(keeps_tape: bool) -> Box<Self> {
        let kept = MEMORY.with(RefCell::take);
        let kept: Option<Box<Self>> = kept.and_then(|m| m.downcast().ok());
        let mut memory = kept.unwrap_or_else(|| {
            Box::new(Self {
                tape: Tape::new(),
                told: Told {
                    rows: Vec::new(),
                    weights: Vec::new(),
                },
            })
        });
        memory.tape.clear(keeps_tape);
        memory.told.rows.clear();
        memory.told.weights.clear();
        memory
    }

    /// Puts it back.
    pub fn keep(self: Box<Self>) {
        MEMORY.with(|slot| slot.replace(Some(self)));
    }
}
