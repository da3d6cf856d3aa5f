//! One schedule, its rows in registers.

use pulp::Simd;
use pulp::bytemuck::cast;

use super::{Align32, Arithmetic, Register, Work, call_apart};
use crate::motion::integral::Panels;

/// One schedule with rows in the 256-bit registers of `S`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Packed<S>(pub S);

impl<S: Simd> Arithmetic for Packed<S> {
    type Number = f64;
    type Triple = Register<S, Align32>;
    type Quad = Register<S, Align32>;
    type Node = Register<S, Align32>;
    type Panels = Panels;
    const PASSES: usize = 1;

    #[inline(always)]
    fn always_apart<W: Work>(self, work: W) -> W::Output {
        call_apart(self.0, work)
    }

    #[inline(always)]
    fn number(self, value: f64) -> f64 {
        value
    }
    #[inline(always)]
    fn triple(self, entries: [f64; 3]) -> Self::Triple {
        self.quad([entries[0], entries[1], entries[2], 0.0])
    }
    #[inline(always)]
    fn constants(self, padded: &[f64; 4]) -> Self::Triple {
        self.quad(*padded)
    }
    #[inline(always)]
    fn quad(self, entries: [f64; 4]) -> Self::Quad {
        Register::new(self.0, cast(entries))
    }
    #[inline(always)]
    fn at_nodes(self, value: f64) -> Self::Node {
        Register::new(self.0, self.0.splat_f64s(value))
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
    fn nodes(self, panels: &Panels, _: usize, step: usize) -> [Self::Node; 2] {
        let (panel, group) = panels.group(step);
        [
            self.quad(group.places) + self.at_nodes(panel),
            self.quad(group.weights),
        ]
    }
    #[inline(always)]
    fn sum_nodes(self, values: Self::Node) -> f64 {
        let v: [f64; 4] = cast(values.lanes);
        (v[0] + v[2]) + (v[1] + v[3])
    }
}
