//! Several schedules side by side.

use pulp::Simd;

use super::{Alignment, Arithmetic, InArray, MOST_LANES, Register, Work, call_apart};
use crate::motion::integral::Panels;

/// Several schedules, one per lane of the registers of `S`; every lane has the bits of its schedule
/// alone.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lanes<S, L>(pub S, pub L);

impl<S: Simd, L: Alignment> Arithmetic for Lanes<S, L> {
    type Number = Register<S, L>;
    type Triple = InArray<Register<S, L>, 3>;
    type Quad = InArray<Register<S, L>, 4>;
    type Node = Register<S, L>;
    type Panels = [Panels; MOST_LANES];
    const PASSES: usize = 4;

    #[inline(always)]
    fn apart<W: Work>(self, work: W) -> W::Output {
        call_apart(self.0, work)
    }
    #[inline(always)]
    fn always_apart<W: Work>(self, work: W) -> W::Output {
        call_apart(self.0, work)
    }
    #[inline(always)]
    fn number(self, value: f64) -> Self::Number {
        Register::new(self.0, self.0.splat_f64s(value))
    }
    #[inline(always)]
    fn triple(self, entries: [Self::Number; 3]) -> Self::Triple {
        InArray(entries)
    }
    #[inline(always)]
    fn constants(self, padded: &[f64; 4]) -> Self::Triple {
        InArray(three!(|i| self.number(padded[i])))
    }
    #[inline(always)]
    fn quad(self, entries: [Self::Number; 4]) -> Self::Quad {
        InArray(entries)
    }
    #[inline(always)]
    fn at_nodes(self, value: Self::Number) -> Self::Node {
        value
    }
    #[inline(always)]
    fn steps(self, panels: &Self::Panels) -> usize {
        let mut most = 0;
        for of in &panels[..S::F64_LANES] {
            most = most.max(of.steps());
        }
        most
    }
    #[inline(always)]
    fn panel_share(self, panels: &Self::Panels) -> Self::Number {
        let mut share = [0.0; MOST_LANES];
        for lane in 0..S::F64_LANES {
            share[lane] = panels[lane].share();
        }
        Register::gather(self.0, &share)
    }
    #[inline(always)]
    fn nodes(self, panels: &Self::Panels, pass: usize, step: usize) -> [Self::Node; 2] {
        let (mut places, mut weights) = ([0.0; MOST_LANES], [0.0; MOST_LANES]);
        for lane in 0..S::F64_LANES {
            // A lane that is done waits at a node of no weight.
            if step < panels[lane].steps() {
                let (panel, group) = panels[lane].group(step);
                places[lane] = group.places[pass] + panel;
                weights[lane] = group.weights[pass];
            }
        }
        [places, weights].map(|values| Register::gather(self.0, &values))
    }
    #[inline(always)]
    fn sum_nodes(self, values: Self::Node) -> Self::Number {
        values
    }
}
