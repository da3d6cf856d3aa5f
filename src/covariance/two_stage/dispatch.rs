//! Which instruction set the work is compiled for, chosen when the program runs.

use pulp::{NullaryFnOnce, Scalar, Simd};

use super::numbers::{Align32, Align64, Alignment, Lanes, MOST_LANES, Packed, Plain, Single};

/// Work on one schedule, in whatever registers the machine has.
pub(crate) trait Task {
    /// What comes of it.
    type Output;
    /// Does it; always inlined.
    fn run<A: Single>(self, ar: A) -> Self::Output;
}

/// Work on several schedules, one per lane.
pub(crate) trait LaneTask {
    /// What comes of it.
    type Output;
    /// Does it; always inlined.
    fn run<S: Simd, L: Alignment, const FUSED: bool>(self, ar: Lanes<S, L, FUSED>) -> Self::Output;
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
struct InLanes<S, L, T, const FUSED: bool>(S, L, T);

impl<S: Simd, L: Alignment, T: LaneTask, const FUSED: bool> NullaryFnOnce
    for InLanes<S, L, T, FUSED>
{
    type Output = T::Output;
    #[inline(always)]
    fn call(self) -> T::Output {
        self.2.run(Lanes::<S, L, FUSED>(self.0, self.1))
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

/// How many lanes [`run_in_lanes`] uses.
pub(crate) fn lanes(most: usize) -> usize {
    /// Counts them.
    struct Count;
    impl LaneTask for Count {
        type Output = usize;
        #[inline(always)]
        fn run<S: Simd, L: Alignment, const FUSED: bool>(self, _: Lanes<S, L, FUSED>) -> usize {
            S::F64_LANES
        }
    }
    run_in_lanes::<_, false>(most, Count)
}

/// Runs `task` in at most `most` lanes. Unless `FUSED`, the results do not depend on how many there
/// are, nor on the instruction set.
pub(crate) fn run_in_lanes<T: LaneTask, const FUSED: bool>(most: usize, task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
    match pulp::x86::Arch::new() {
        pulp::x86::Arch::V4(simd) if most >= MOST_LANES => {
            return simd.vectorize(InLanes::<_, _, _, FUSED>(simd, Align64, task));
        }
        pulp::x86::Arch::V4(simd) if most >= 4 => {
            return simd.vectorize(InLanes::<_, _, _, FUSED>(*simd, Align32, task));
        }
        pulp::x86::Arch::V3(simd) if most >= 4 => {
            return simd.vectorize(InLanes::<_, _, _, FUSED>(simd, Align32, task));
        }
        _ => {}
    }
    #[cfg(target_arch = "aarch64")]
    if most >= 2
        && let Some(simd) = pulp::aarch64::Neon::try_new()
    {
        return simd.vectorize(InLanes::<_, _, _, FUSED>(simd, Align32, task));
    }
    let _ = most;
    InLanes::<_, _, _, FUSED>(Scalar::new(), Align32, task).call()
}
