//! Which instruction set the work is compiled for, chosen when the program runs.

use pulp::{NullaryFnOnce, Scalar, Simd};

use super::arithmetic::{Align32, Align64, Alignment, Lanes, MOST_LANES, Packed, Plain, Single};

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
    fn run<S: Simd, L: Alignment>(self, ar: Lanes<S, L>) -> Self::Output;
}

/// A task with the registers it is to use.
struct In<S, T>(S, T);

impl<S: Simd, T: Task> NullaryFnOnce for In<S, T> {
    type Output = T::Output;
    #[inline(always)]
    fn call(self) -> T::Output {
        self.1.run(Packed::<S>(self.0))
    }
}

/// A task in lanes with the registers it is to use.
struct InLanes<S, L, T>(S, L, T);

impl<S: Simd, L: Alignment, T: LaneTask> NullaryFnOnce for InLanes<S, L, T> {
    type Output = T::Output;
    #[inline(always)]
    fn call(self) -> T::Output {
        self.2.run(Lanes::<S, L>(self.0, self.1))
    }
}

/// Runs `task` with the instruction set of this machine; the results do not depend on it.
pub(crate) fn run<T: Task>(task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
    match pulp::x86::Arch::new() {
        pulp::x86::Arch::V4(simd) => return simd.vectorize(In::<_, _>(*simd, task)),
        pulp::x86::Arch::V3(simd) => return simd.vectorize(In::<_, _>(simd, task)),
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
        fn run<S: Simd, L: Alignment>(self, _: Lanes<S, L>) -> usize {
            S::F64_LANES
        }
    }
    run_in_lanes(most, Count)
}

/// Runs `task` in at most `most` lanes; the results do not depend on how many there are, nor on the
/// instruction set.
pub(crate) fn run_in_lanes<T: LaneTask>(most: usize, task: T) -> T::Output {
    run_in_registers(most, task)
        .unwrap_or_else(|task| InLanes::<_, _, _>(Scalar::new(), Align32, task).call())
}

/// The same, but gives the task back where there would be one lane only.
pub(crate) fn run_in_registers<T: LaneTask>(
    most: usize,
    task: T,
) -> std::result::Result<T::Output, T> {
    #[cfg(target_arch = "x86_64")]
    match pulp::x86::Arch::new() {
        pulp::x86::Arch::V4(simd) if most >= MOST_LANES => {
            return Ok(simd.vectorize(InLanes::<_, _, _>(simd, Align64, task)));
        }
        pulp::x86::Arch::V4(simd) if most >= 4 => {
            return Ok(simd.vectorize(InLanes::<_, _, _>(*simd, Align32, task)));
        }
        pulp::x86::Arch::V3(simd) if most >= 4 => {
            return Ok(simd.vectorize(InLanes::<_, _, _>(simd, Align32, task)));
        }
        _ => {}
    }
    #[cfg(target_arch = "aarch64")]
    if most >= 2
        && let Some(simd) = pulp::aarch64::Neon::try_new()
    {
        return Ok(simd.vectorize(InLanes::<_, _, _>(simd, Align32, task)));
    }
    let _ = most;
    Err(task)
}
