//! The rooms of the house, for benches, tests and examples of this package. Not part of the public
//! face: anything here may change with any version.

/// Makes the public items of a private module reachable.
macro_rules! open {
    ($($room:ident),+ $(,)?) => {
        $(
            #[doc = concat!("See `", stringify!($room), "`.")]
            pub mod $room {
                pub use crate::$room::*;
            }
        )+
    };
}

open!(
    analysis,
    attitude,
    baseline,
    certificate,
    commands,
    compare,
    config,
    covariance,
    criterion,
    drift,
    dynamics,
    evaluate,
    mission,
    model,
    motion,
    observability,
    platform,
    report,
    results,
    schedule,
    search,
    sheet,
    simulate,
    study,
    suspicion,
    units,
);

#[cfg(feature = "cli")]
open!(cli);
