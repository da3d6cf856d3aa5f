//! Which instruction set the work is compiled for, chosen when the program runs.

use pulp::{NullaryFnOnce, Scalar, Simd};

use super::numbers::{Align32, Align64, Alignment, Arithmetic, Lanes, MOST_LANES, Packed, Plain};

/// Work on one schedule, in whatever registers the machine has.
pub(crate) trait Task {
    /// What comes of it.
    type Output;
    /// Does it; always inlined.
    fn run<A: Arithmetic<Number = f64> + 'static>(self, ar: A) -> Self::Output;
}

/// Work on several schedules, one per lane.
pub(crate) trait LaneTask {
    /// What comes of it.
    type Output;
    /// Does it; always inlined.
    fn run<S: Simd, L: Alignment>(self, ar: Lanes<S, L>) -> Self::Output;
}

/// A task with the registers it is to use.
struct In<S, T, const FUSED: bool>(S, T);

impl<S: Simd, T: Task, const FUSED: bool> NullaryFnOnce for In<S, T, FUSED> {
    type Output = T::Output;
    #[inline(always)]
    fn call(self) -> T::Output {
        self.1.run(Packed::<S, FUSED>(self.0))
    }
}

/// A task in lanes with the registers it is to use.
struct InLanes<S, L, T>(S, L, T);

impl<S: Simd, L: Alignment, T: LaneTask> NullaryFnOnce for InLanes<S, L, T> {
    type Output = T::Output;
    #[inline(always)]
    fn call(self) -> T::Output {
        self.2.run(Lanes(self.0, self.1))
    }
}

/// Runs `task` with the instruction set of this machine. Unless `FUSED`, the results do not depend
/// on it.
pub(crate) fn run<T: Task, const FUSED: bool>(task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
    match pulp::x86::Arch::new() {
        pulp::x86::Arch::V4(simd) => return simd.vectorize(In::<_, _, FUSED>(*simd, task)),
        pulp::x86::Arch::V3(simd) => return simd.vectorize(In::<_, _, FUSED>(simd, task)),
        _ => {}
    }
    task.run(Plain)
}

/// Runs `task` in at most `most` lanes.
pub(crate) fn run_in_lanes<T: LaneTask>(most: usize, task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
    match pulp::x86::Arch::new() {
        pulp::x86::Arch::V4(simd) if most >= MOST_LANES => {
            return simd.vectorize(InLanes(simd, Align64, task));
        }
        pulp::x86::Arch::V4(simd) if most >= 4 => {
            return simd.vectorize(InLanes(*simd, Align32, task));
        }
        pulp::x86::Arch::V3(simd) if most >= 4 => {
            return simd.vectorize(InLanes(simd, Align32, task));
        }
        _ => {}
    }
    #[cfg(target_arch = "aarch64")]
    if most >= 2
        && let Some(simd) = pulp::aarch64::Neon::try_new()
    {
        return simd.vectorize(InLanes(simd, Align32, task));
    }
    let _ = most;
    InLanes(Scalar::new(), Align32, task).call()
}
