//! `[stand]` and `gimbals.axes`: what a person writes of how the gimbals are hung and the base stands.

use serde::{Deserialize, Serialize};

use super::in_range;
use crate::attitude::{SignedAxis, Stand};
use crate::error::{Error, Result};

/// How the base of the stand is set up.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct StandConfig {
    /// Heading of the base's x axis, from North towards East, degrees, −360 to 360; none: north.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heading_deg: Option<f64>,
    /// Tilts of the base about its x axis and then its z axis, degrees, −180 to 180; none: level.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tilt_deg: Option<[f64; 2]>,
}

impl StandConfig {
    pub(super) fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// With the gimbals' axes, outer to inner; none: the paper's.
    pub(super) fn check(&self, axes: Option<&[String; 3]>) -> Result<Stand> {
        let (heading, tilt) = ("stand.heading_deg", "stand.tilt_deg");
        let heading_deg = in_range(
            heading,
            self.heading_deg.unwrap_or(0.0),
            -360.0,
            360.0,
            "-360 to 360",
        )?;
        let tilt_deg = self.tilt_deg.unwrap_or([0.0; 2]);
        for tilt_deg in tilt_deg {
            in_range(tilt, tilt_deg, -180.0, 180.0, "two angles from -180 to 180")?;
        }
        let axes = match axes {
            Some(names) => signed(names)?,
            None => Stand::PAPER.axes(),
        };
        Stand::new(axes, heading_deg, tilt_deg).ok_or_else(|| {
            let names = axes.map(SignedAxis::name);
            let [outer, middle, inner] = names;
            let parallel = match axes[0].index() == axes[1].index() {
                true => format!("{outer} and {middle}"),
                false => format!("{middle} and {inner}"),
            };
            Error::input("two neighbouring gimbals turn about one axis")
                .with_key(AXES)
                .with_value(format!("{names:?}"))
                .with_allowed(format!(
                    "outer, middle, inner with neighbours at right angles, which {parallel} are not"
                ))
        })
    }
}

/// The key.
const AXES: &str = "gimbals.axes";

fn signed(names: &[String; 3]) -> Result<[SignedAxis; 3]> {
    let mut axes = Stand::PAPER.axes();
    for (axis, name) in axes.iter_mut().zip(names) {
        *axis = SignedAxis::from_name(name).ok_or_else(|| {
            let all = SignedAxis::NAMES.map(|name| format!("\"{name}\""));
            Error::input("no axis of the platform")
                .with_key(AXES)
                .with_value(format!("\"{name}\""))
                .with_allowed(format!("three of {}", all.join(", ")))
        })?;
    }
    Ok(axes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;
    use crate::testing::assert_refused_by_key;

    fn config(text: &str) -> PlatformConfig {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn axes_heading_and_tilts_are_read() {
        let text = "[gimbals]\naxes = [\"+z\", \"x\", \"-z\"]\n\
            [stand]\nheading_deg = -30.5\ntilt_deg = [2, -180]\n";
        let stand = *config(text).check().unwrap().stand();
        assert_eq!(stand.axes().map(SignedAxis::name), ["+z", "+x", "-z"]);
        assert_eq!(stand.heading_deg(), -30.5);
        assert_eq!(stand.tilt_deg(), [2.0, -180.0]);
        assert!(stand.is_proper_euler());
        assert_eq!(*config("").check().unwrap().stand(), Stand::PAPER);
        let paper = "[gimbals]\naxes = [\"-x\", \"-y\", \"-z\"]\n[stand]\nheading_deg = 0\n";
        assert_eq!(*config(paper).check().unwrap().stand(), Stand::PAPER);
    }

    #[test]
    fn what_is_no_stand_is_refused_by_name() {
        for (text, key) in [
            ("[gimbals]\naxes = [\"-x\", \"-y\", \"down\"]", AXES),
            ("[gimbals]\naxes = [\"\", \"-y\", \"-z\"]", AXES),
            ("[gimbals]\naxes = [\"+x\", \"-x\", \"-z\"]", AXES),
            ("[gimbals]\naxes = [\"+x\", \"-z\", \"-z\"]", AXES),
            ("[stand]\nheading_deg = nan", "stand.heading_deg"),
            ("[stand]\nheading_deg = inf", "stand.heading_deg"),
            ("[stand]\nheading_deg = 361", "stand.heading_deg"),
            ("[stand]\ntilt_deg = [0, nan]", "stand.tilt_deg"),
            ("[stand]\ntilt_deg = [-181, 0]", "stand.tilt_deg"),
        ] {
            let error = config(text).check().unwrap_err();
            assert_refused_by_key(&error, key);
        }
    }
}
