//! Kernels by duration: made once, then looked up.

use std::sync::OnceLock;

use super::fast::gains::DwellNumbers;
use super::kernel::{Element, Kernel};
use crate::dynamics::ErrorDynamics;

/// How many durations (in periods) are remembered.
const REMEMBERED: usize = 4096;
/// Doublings kept: up to 2^32 periods.
const DOUBLINGS: usize = 33;

/// Kernels by number of periods. Made on first use, then shared between threads; a kernel's
/// bits depend on the number of periods only, never on what was asked before.
#[derive(Debug)]
pub struct KernelTable {
    pub(super) one_period: Element,
    doublings: [OnceLock<Box<Element>>; DOUBLINGS],
    remembered: Box<[OnceLock<Box<Remembered>>]>,
}

/// A kernel in the table.
#[derive(Debug)]
struct Remembered {
    kernel: Kernel,
    numbers: DwellNumbers,
}

impl Remembered {
    fn new(kernel: Kernel) -> Self {
        Self {
            numbers: DwellNumbers::new(&kernel),
            kernel,
        }
    }
}

/// A kernel from the table, or made for a duration that is not remembered.
#[derive(Debug)]
pub(crate) enum LookedUp<'a> {
    Remembered(&'a DwellNumbers),
    Made(Box<DwellNumbers>),
}

impl LookedUp<'_> {
    /// The kernel.
    #[inline]
    pub fn get(&self) -> &DwellNumbers {
        match self {
            Self::Remembered(numbers) => numbers,
            Self::Made(numbers) => numbers,
        }
    }
}

impl KernelTable {
    /// The table for a period (s), drift PSD q (arcsec²/s) and measurement variance r² (arcsec²).
    pub(crate) fn new(dynamics: ErrorDynamics, period_s: f64, q: f64, r2: f64) -> Self {
        Self {
            one_period: Element::one_period(&dynamics, period_s, q, r2),
            doublings: std::array::from_fn(|_| OnceLock::new()),
            remembered: (0..REMEMBERED).map(|_| OnceLock::new()).collect(),
        }
    }

    /// The kernel of a dwell of `periods` filter periods.
    pub fn kernel(&self, periods: usize) -> Kernel {
        match self.remember(periods) {
            Some(remembered) => remembered.kernel,
            None => self.compose(periods),
        }
    }

    /// The same as the straight-line chain reads it.
    #[inline]
    pub(crate) fn numbers(&self, periods: usize) -> LookedUp<'_> {
        match self.remember(periods) {
            Some(remembered) => LookedUp::Remembered(&remembered.numbers),
            None => LookedUp::Made(Box::new(DwellNumbers::new(&self.compose(periods)))),
        }
    }

    #[inline]
    fn remember(&self, periods: usize) -> Option<&Remembered> {
        let cell = self.remembered.get(periods)?;
        Some(cell.get_or_init(|| Box::new(Remembered::new(self.compose(periods)))))
    }

    /// 2^k periods.
    fn doubling(&self, k: usize) -> &Element {
        self.doublings[k].get_or_init(|| {
            Box::new(match k {
                0 => self.one_period,
                _ => {
                    let half = self.doubling(k - 1);
                    half.then(half)
                }
            })
        })
    }

    fn compose(&self, periods: usize) -> Kernel {
        let mut element = Element::identity();
        for k in 0..DOUBLINGS {
            if periods >> k & 1 == 1 {
                element = element.then(self.doubling(k));
            }
        }
        element.split()
    }
}
