//! Noise that wanders: what the drift of a gyro, or the bias of an accelerometer, does beside its
//! constant part and its white noise.
//!
//! ```text
//! random walk    ḋ = K w,                 d(0) = 0,               variance K² t
//! Gauss–Markov   ḋ = −d/τ + σ√(2/τ) w,    stationary from the start, variance σ²
//! ```
//!
//! with w white of unit PSD. Equal on the three instruments, independent, fixed in the body
//! (IEEE Std 952, annex C: rate random walk, and exponentially correlated (Markov) noise).

/// How an instrument's output wanders, in a unit u: rad/s or °/h of a gyro, g or arcsec of an
/// accelerometer.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Colour {
    /// K² of the random walk, u²/s: the variance by which it grows in a second; none: there is none.
    pub random_walk: Option<f64>,
    /// The Gauss–Markov process; none: there is none.
    pub markov: Option<Markov>,
}

/// A first-order Gauss–Markov process.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Markov {
    /// Stationary σ, u.
    pub sigma: f64,
    /// Time constant τ, s.
    pub time_s: f64,
}

impl Colour {
    /// No wandering at all.
    pub const WHITE: Self = Self {
        random_walk: None,
        markov: None,
    };

    /// Whether nothing wanders.
    pub const fn is_white(&self) -> bool {
        self.random_walk.is_none() && self.markov.is_none()
    }

    /// How many states each instrument has for it, the random walk first: 0, 1 or 2.
    pub fn states(&self) -> usize {
        usize::from(self.random_walk.is_some()) + usize::from(self.markov.is_some())
    }

    /// Allan variance of averages over `tau_s`, u² (IEEE Std 952, annex C):
    ///
    /// ```text
    /// random walk    K² τ/3
    /// Gauss–Markov   (2σ²/x) (1 − (3 − 4 e⁻ˣ + e⁻²ˣ)/2x),   x = τ/T
    /// ```
    ///
    /// its root has the slope +½ in a logarithmic plot, and a hump of 0.617 σ at τ = 1.89 T.
    ///
    /// ```
    /// use scheme_opt::internals::platform::PlatformConfig;
    /// let text = "[gyro]\nbias_instability_deg_per_h = 0.003\nbias_correlation_time_s = 600\n";
    /// let config: PlatformConfig = toml::from_str(text).unwrap();
    /// // rad/s; 1 rad/s is 206 265 °/h.
    /// let drift = config.check()?.drift_colour().times(206_264.806);
    /// let hump = drift.allan_variance(1134.0).sqrt();
    /// assert!((hump / (0.617 * 0.003) - 1.0).abs() < 1e-3);
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn allan_variance(&self, tau_s: f64) -> f64 {
        let walk = self.random_walk.map_or(0.0, |k2| k2 * tau_s / 3.0);
        walk + self.markov.map_or(0.0, |m| m.allan_variance(tau_s))
    }

    /// The same where the unit is `factor` times smaller.
    pub fn times(&self, factor: f64) -> Self {
        Self {
            random_walk: self.random_walk.map(|k| k * factor * factor),
            markov: self.markov.map(|m| Markov {
                sigma: m.sigma * factor,
                ..m
            }),
        }
    }
}

impl Markov {
    /// e^{−t/τ}: what is left of a value after `t_s`.
    pub fn kept(&self, t_s: f64) -> f64 {
        libm::exp(-t_s / self.time_s)
    }

    /// Allan variance of averages over `tau_s`, u².
    fn allan_variance(&self, tau_s: f64) -> f64 {
        let x = tau_s / self.time_s;
        let share = match x < 0.03 {
            // Where the terms cancel, their series.
            true => {
                let series = [
                    -1.0 / 320.0,
                    31.0 / 2520.0,
                    -1.0 / 24.0,
                    7.0 / 60.0,
                    -0.25,
                    1.0 / 3.0,
                ];
                x * series.into_iter().fold(0.0, |sum, c| sum * x + c)
            }
            false => {
                let [once, twice] = [1.0, 2.0].map(|n: f64| libm::exp(-n * x));
                (1.0 - (3.0 - 4.0 * once + twice) / (2.0 * x)) / x
            }
        };
        2.0 * self.sigma * self.sigma * share
    }

    /// σ² (1 − e^{−2t/τ}): the variance that comes anew in `t_s`, u².
    pub fn renewed(&self, t_s: f64) -> f64 {
        -libm::expm1(-2.0 * t_s / self.time_s) * self.sigma * self.sigma
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gauss_markov_process_is_stationary() {
        let markov = Markov {
            sigma: 0.3,
            time_s: 900.0,
        };
        for t_s in [1e-6, 10.0, 700.0, 1e5] {
            let kept = markov.kept(t_s);
            let variance = kept * kept * 0.09 + markov.renewed(t_s);
            assert!((variance - 0.09).abs() < 1e-16, "{t_s}");
            let twice = markov.kept(2.0 * t_s);
            assert!((kept * kept - twice).abs() < 1e-15, "{t_s}");
        }
        // What comes anew in a short time is 2 σ² t/τ.
        assert!((markov.renewed(1e-6) / (2.0 * 0.09 * 1e-6 / 900.0) - 1.0).abs() < 1e-8);
    }

    /// Half the mean square of the difference of neighbouring averages: their variance less their
    /// covariance.
    #[test]
    fn the_allan_variance_is_that_of_neighbouring_averages() {
        let markov = Markov {
            sigma: 0.3,
            time_s: 900.0,
        };
        for x in [2e-3, 0.02, 0.04, 0.7, 1.89, 5.0, 80.0] {
            let lost = -libm::expm1(-x);
            let expected = 0.09 * (2.0 * (x - lost) - lost * lost) / (x * x);
            let found = markov.allan_variance(x * 900.0);
            assert!((found / expected - 1.0).abs() < 1e-8, "{x}");
        }
        // Both forms meet where one takes over.
        let [below, above] = [0.03 * (1.0 - 1e-9), 0.03].map(|x| markov.allan_variance(x * 900.0));
        assert!((above / below - 1.0).abs() < 1e-8);
        let root = |x: f64| markov.allan_variance(x * 900.0).sqrt() / 0.3;
        let peak = (1..4000)
            .map(|i| root(1e-3 * f64::from(i)))
            .fold(0.0, f64::max);
        assert!((root(1.89) - 0.6174).abs() < 1e-4 && peak - root(1.89) < 1e-5);
    }

    #[test]
    fn units_enter_variances_squared() {
        let colour = Colour {
            random_walk: Some(4.0),
            markov: Some(Markov {
                sigma: 5.0,
                time_s: 7.0,
            }),
        };
        let in_tenths = colour.times(10.0);
        assert_eq!(in_tenths.random_walk, Some(400.0));
        assert_eq!(
            in_tenths.markov.map(|m| (m.sigma, m.time_s)),
            Some((50.0, 7.0))
        );
        assert_eq!((colour.states(), Colour::WHITE.states()), (2, 0));
        assert!(Colour::WHITE.is_white() && !colour.is_white());
    }
}
