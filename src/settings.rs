//! The tables of a platform file as values: what a [`StudyConfig`](crate::StudyConfig) consists of.
//! Units are in the names; a [`Study`](crate::Study) checks every number.

pub use crate::config::{
    CriterionKind, DEFAULT_TOML, Mode, ObjectiveConfig, PerCoefficient, ScoreConfig, SearchConfig,
    TestConfig,
};
pub use crate::platform::{
    AccelerometerConfig, AxisValue, AzimuthConfig, ErrorTable, ErrorsConfig, FilterConfig,
    ForbiddenConfig, GSensitivePrior, GimbalsConfig, GyroConfig, MotionConfig, OutputAxes,
    OutputAxis, PlatformConfig, PriorConfig, Repositioning, SiteConfig, StandConfig,
};
