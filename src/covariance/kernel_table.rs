//! Kernels by duration: made once, then looked up.

use std::sync::OnceLock;

use super::fast::gains::DwellNumbers;
use super::kernel::{Element, Kernel};
use super::real::Real;
use crate::dynamics::ErrorDynamics;

/// How many durations (in periods) are remembered.
const REMEMBERED: usize = 4096;
/// Doublings kept: up to 2^32 periods.
const DOUBLINGS: usize = 33;

/// Elements of 2^k periods, made when they are asked for.
#[derive(Debug)]
pub(super) struct Doublings<T: Real = f64> {
    pub(super) one_period: Element<T>,
    further: [OnceLock<Box<Element<T>>>; DOUBLINGS],
}

impl<T: Real> Doublings<T> {
    /// For a period (s), drift PSD q (arcsec²/s) and the variance (arcsec²) of each component of
    /// ψ^n that is measured.
    pub(super) fn new(
        dynamics: &ErrorDynamics,
        period_s: f64,
        q: f64,
        measured: [Option<f64>; 3],
    ) -> Self {
        Self {
            one_period: Element::one_period(dynamics, period_s, q, measured),
            further: std::array::from_fn(|_| OnceLock::new()),
        }
    }

    /// 2^k periods.
    fn element(&self, k: usize) -> &Element<T> {
        self.further[k].get_or_init(|| {
            Box::new(match k {
                0 => self.one_period,
                _ => {
                    let half = self.element(k - 1);
                    half.then(half)
                }
            })
        })
    }

    /// The kernel of a dwell of `periods` filter periods.
    pub(super) fn kernel(&self, periods: usize) -> Kernel<T> {
        let mut element = Element::identity();
        for k in 0..DOUBLINGS {
            if periods >> k & 1 == 1 {
                element = element.then(self.element(k));
            }
        }
        element.split()
    }
}

/// Kernels by number of periods. Made on first use, then shared between threads; a kernel's
/// bits depend on the number of periods only, never on what was asked before.
#[derive(Debug)]
pub struct KernelTable {
    pub(super) doublings: Doublings,
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
        Self::measuring(dynamics, period_s, q, [Some(r2), None, Some(r2)])
    }

    /// The same with the variance (arcsec²) of each component of ψ^n that is measured.
    pub(super) fn measuring(
        dynamics: ErrorDynamics,
        period_s: f64,
        q: f64,
        measured: [Option<f64>; 3],
    ) -> Self {
        Self {
            doublings: Doublings::new(&dynamics, period_s, q, measured),
            remembered: (0..REMEMBERED).map(|_| OnceLock::new()).collect(),
        }
    }

    /// The kernel of a dwell of `periods` filter periods.
    pub fn kernel(&self, periods: usize) -> Kernel {
        match self.remember(periods) {
            Some(remembered) => remembered.kernel,
            None => self.doublings.kernel(periods),
        }
    }

    /// The same as the straight-line chain reads it.
    #[inline]
    pub(crate) fn numbers(&self, periods: usize) -> LookedUp<'_> {
        match self.remember(periods) {
            Some(remembered) => LookedUp::Remembered(&remembered.numbers),
            None => LookedUp::Made(Box::new(DwellNumbers::new(&self.doublings.kernel(periods)))),
        }
    }

    #[inline]
    fn remember(&self, periods: usize) -> Option<&Remembered> {
        let cell = self.remembered.get(periods)?;
        Some(cell.get_or_init(|| Box::new(Remembered::new(self.doublings.kernel(periods)))))
    }
}
