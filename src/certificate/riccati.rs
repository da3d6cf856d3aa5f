//! Riccati's equation of a drift that wanders, measured all the time: in closed form.
//!
//! State (x, m): x = D_F + random walk, m the Gauss–Markov process; x + m is measured in white noise of
//! PSD 1/j. While j is constant, with F = diag(0, −1/τ), W = diag(K², 2σ²/τ), h = (1, 1),
//!
//! ```text
//! Ṗ = F P + P Fᵀ + W − j P h hᵀ P,     P(s) = B + Φ P(0) (I + G P(0))⁻¹ Φᵀ,
//! Φ = Θ₁₁⁻ᵀ,  B = Θ₂₁ Θ₁₁⁻¹,  G = Θ₁₁⁻¹ Θ₁₂,     Θ = exp(s [−Fᵀ, j h hᵀ; W, F]).
//! ```
//!
//! The exponential is a series over a short time; a longer one is that map joined to itself again and
//! again, in which nothing grows: no step is a discretisation.

use nalgebra::{Matrix2, Matrix4, Vector2};

use crate::model::Colour;

/// Longest time of the series, in time constants: with `TERMS` of them it leaves 1e-17.
const SHORT: f64 = 1.0 / 16.0;
const TERMS: u32 = 13;

/// How often the covariance is looked at within a stretch: the walk may not add more than this part of
/// its steady variance between two looks, as far as that many allow.
const PART: f64 = 1e-3;
const MOST_PARTS: u32 = 16;
/// How closely, and by how many doublings of a stretch, its steady covariance is approached.
const STEADY: f64 = 1e-6;
const TO_STEADY: usize = 40;

/// Prior variance relative to what the test leaves without wandering, beyond which it is cut: more
/// would cost digits, and a smaller prior only lowers the bound.
const LARGEST_PRIOR: f64 = 1e9;

/// A time of constant rate: its length, s, and j, (°/h)⁻² s⁻¹.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stretch {
    pub length_s: f64,
    pub rate: f64,
}

/// The least variance of x that is reached at the end of all the `stretches` or at any time before,
/// (°/h)²; `prior`: of x before. Without a random walk that is the end's.
pub(super) fn least_variance(
    colour: &Colour,
    prior: f64,
    stretches: impl Iterator<Item = Stretch> + Clone,
) -> f64 {
    let walk = colour.random_walk.unwrap_or(0.0);
    let told: f64 = stretches.clone().map(|s| s.length_s * s.rate).sum();
    let cut = |variance: f64| variance.min(LARGEST_PRIOR / told);
    let markov = colour.markov.map_or(0.0, |m| m.sigma * m.sigma);
    let mut p = Matrix2::from_diagonal(&Vector2::new(cut(prior), cut(markov)));
    let mut least = p[(0, 0)];
    for Stretch { length_s, rate } in stretches {
        let parts = parts(walk, length_s, rate);
        let step = length_s / f64::from(parts);
        let map = Map::over(colour, rate, step);
        let floor = match walk > 0.0 {
            true => map.floor(&p, colour.markov.is_some()),
            false => 0.0,
        };
        let mut within = f64::INFINITY;
        for _ in 0..parts {
            p = map.of(&p);
            if !(p[(0, 0)] > 0.0 && p[(0, 0)].is_finite()) {
                return 0.0;
            }
            // Between two looks x wins at most the walk's K² a second.
            within = within.min(p[(0, 0)] - walk * step);
        }
        least = least.min(within.max(floor));
    }
    least
}

fn parts(walk: f64, length_s: f64, rate: f64) -> u32 {
    let wanted = length_s * (walk * rate).sqrt() / PART;
    let mut parts = 1;
    while f64::from(parts) < wanted && parts < MOST_PARTS {
        parts *= 2;
    }
    parts
}

/// What a time of constant j makes of P.
#[derive(Debug, Clone, Copy)]
struct Map {
    phi: Matrix2<f64>,
    b: Matrix2<f64>,
    g: Matrix2<f64>,
}

impl Map {
    fn over(colour: &Colour, rate: f64, time_s: f64) -> Self {
        let walk = colour.random_walk.unwrap_or(0.0);
        let (decay, renewal) = colour.markov.map_or((0.0, 0.0), |m| {
            let decay = m.time_s.recip();
            (decay, 2.0 * m.sigma * m.sigma * decay)
        });
        let fastest = decay.max((rate * walk.max(renewal)).sqrt());
        let (mut short, mut doublings) = (time_s, 0);
        while short * fastest > SHORT {
            short *= 0.5;
            doublings += 1;
        }
        let mut hamiltonian = Matrix4::zeros();
        hamiltonian
            .fixed_view_mut::<2, 2>(0, 2)
            .copy_from(&Matrix2::repeat(rate));
        hamiltonian[(1, 1)] = decay;
        hamiltonian[(2, 0)] = walk;
        hamiltonian[(3, 1)] = renewal;
        hamiltonian[(3, 3)] = -decay;
        let theta = exponential(&(hamiltonian * short));
        let block = |i, j| theta.fixed_view::<2, 2>(i, j).into_owned();
        let inverse = inverse(&block(0, 0));
        let first = Self {
            phi: inverse.transpose(),
            b: symmetric(block(2, 0) * inverse),
            g: symmetric(inverse * block(0, 2)),
        };
        (0..doublings).fold(first, |map, _| map.twice())
    }

    /// Of twice the time.
    fn twice(&self) -> Self {
        let inverse = inverse(&(Matrix2::identity() + self.b * self.g));
        let turned = self.phi * inverse;
        Self {
            phi: turned * self.phi,
            b: symmetric(self.b + turned * self.b * self.phi.transpose()),
            g: symmetric(self.g + self.phi.transpose() * self.g * inverse * self.phi),
        }
    }

    /// What the variance of x does not fall below, from P on and as long as j is what it is. Where P ⪰ cS,
    /// c ≤ 1, with S = B(s) for any s, which grows from S on, so does what starts from cS: its
    /// derivative there is c Ṡ + (1 − c)(W + c j S h hᵀ S).
    fn floor(&self, p: &Matrix2<f64>, of_both: bool) -> f64 {
        let steady = self.steady();
        let (own, other) = (steady[(0, 0)], steady[(1, 1)]);
        let share = if of_both {
            // The smaller root of det(P − cS).
            let (square, fixed) = (steady.determinant(), p.determinant());
            let middle = p[(0, 0)] * other + p[(1, 1)] * own - 2.0 * p[(0, 1)] * steady[(0, 1)];
            let root = (middle * middle - 4.0 * square * fixed).max(0.0).sqrt();
            2.0 * fixed / (middle + root)
        } else {
            p[(0, 0)] / own
        };
        share.clamp(0.0, 1.0) * own
    }

    /// B(s) for a long s.
    fn steady(&self) -> Matrix2<f64> {
        let mut map = *self;
        for _ in 0..TO_STEADY {
            let next = map.twice();
            let settled = next.b[(0, 0)] <= map.b[(0, 0)] * (1.0 + STEADY);
            map = next;
            if settled {
                break;
            }
        }
        map.b
    }

    fn of(&self, p: &Matrix2<f64>) -> Matrix2<f64> {
        let left = p * inverse(&(Matrix2::identity() + self.g * p));
        symmetric(self.b + self.phi * left * self.phi.transpose())
    }
}

fn exponential(matrix: &Matrix4<f64>) -> Matrix4<f64> {
    let mut term = Matrix4::identity();
    let mut sum = term;
    for n in 1..=TERMS {
        term = term * matrix / f64::from(n);
        sum += term;
    }
    sum
}

/// Of a matrix whose determinant is 1 or more but for the last bits; not finite where it is none.
fn inverse(m: &Matrix2<f64>) -> Matrix2<f64> {
    let determinant = m[(0, 0)] * m[(1, 1)] - m[(0, 1)] * m[(1, 0)];
    Matrix2::new(m[(1, 1)], -m[(0, 1)], -m[(1, 0)], m[(0, 0)]) / determinant
}

fn symmetric(m: Matrix2<f64>) -> Matrix2<f64> {
    0.5 * (m + m.transpose())
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::model::Markov;

    fn colour(walk: f64, markov: Option<(f64, f64)>) -> Colour {
        Colour {
            random_walk: (walk > 0.0).then_some(walk),
            markov: markov.map(|(sigma, time_s)| Markov { sigma, time_s }),
        }
    }

    fn constant(rate: f64, length_s: f64, count: usize) -> impl Iterator<Item = Stretch> + Clone {
        let length_s = length_s / count as f64;
        std::iter::repeat_n(Stretch { length_s, rate }, count)
    }

    /// ẋ² of a scalar equation: P = s tanh(s j t + artanh(P₀/s)), s = √(K²/j), or coth above s.
    #[test]
    fn a_random_walk_alone_is_a_hyperbolic_tangent() {
        let (walk, rate) = (2.5e-9, 700.0);
        let steady = f64::sqrt(walk / rate);
        for time_s in [3.0, 400.0, 5000.0, 1e6] {
            for ratio in [0.3_f64, 4.0, 1e5] {
                let map = Map::over(&colour(walk, None), rate, time_s);
                let p = map.of(&Matrix2::new(ratio * steady, 0.0, 0.0, 0.0));
                let phase = steady * rate * time_s;
                let exact = match ratio < 1.0 {
                    true => (phase + ratio.atanh()).tanh(),
                    false => (phase + ratio.recip().atanh()).tanh().recip(),
                };
                let found = p[(0, 0)] / steady;
                assert!((found / exact - 1.0).abs() < 1e-11, "{time_s} {ratio}");
                assert_eq!(p[(1, 1)], 0.0);
            }
        }
        // From above the least is what is left at the end; from below it is what was there before.
        let of = |prior: f64| {
            let least = least_variance(&colour(walk, None), prior, constant(rate, 3000.0, 50));
            least / steady
        };
        let end = (steady * rate * 3000.0).tanh().recip();
        assert!(of(225.0) < end && of(225.0) > 0.998 * end, "{}", of(225.0));
        assert!((of(0.25 * steady) - 0.25).abs() < 1e-12);
        assert_eq!(of(0.0), 0.0);
    }

    /// σ²(D_F) = 1/(Λ + ⟨1, (1/j + 𝒦)⁻¹ 1⟩), and with a walk e_Tᵀ((σ_F² 11ᵀ + 𝒦)⁻¹ + j)⁻¹ e_T: on
    /// finer and finer grids these tend to the closed form.
    #[test]
    fn the_closed_form_is_the_limit_of_dense_matrices() {
        let (end, prior) = (3000.0, 1e-4);
        for (walk, markov) in [
            (0.0, Some((0.003, 600.0))),
            (0.0, Some((0.01, 50.0))),
            (0.0, Some((0.002, 1e5))),
            (2.5e-9, None),
            (2.5e-9, Some((0.003, 600.0))),
            (1e-10, Some((0.002, 4e4))),
        ] {
            let colour = colour(walk, markov);
            let rate = |t: f64| 700.0 * (1.0 - 0.5 * t / end);
            let dense = |count: usize| {
                let h = end / count as f64;
                let time = |i: usize| (i as f64 + 0.5) * h;
                let covariance = |t: f64, u: f64| {
                    let kept = markov.map_or(0.0, |(sigma, tau)| {
                        sigma * sigma * (-(t - u).abs() / tau).exp()
                    });
                    prior + walk * t.min(u) + kept
                };
                let r = DMatrix::from_fn(count, count, |i, j| {
                    let noise = if i == j {
                        1.0 / (rate(time(i)) * h)
                    } else {
                        0.0
                    };
                    covariance(time(i), time(j)) + noise
                });
                // x at the end against what is measured.
                let c = DVector::from_fn(count, |i, _| prior + walk * time(i));
                let solved = r.cholesky().unwrap().solve(&c);
                prior + walk * end - c.dot(&solved)
            };
            let [coarse, fine] = [300, 600].map(dense);
            let limit = fine + (fine - coarse);
            let stretches = (0..600).map(|i| Stretch {
                length_s: end / 600.0,
                rate: rate((f64::from(i) + 0.5) * end / 600.0),
            });
            let mut p = Matrix2::zeros();
            p[(0, 0)] = prior;
            p[(1, 1)] = markov.map_or(0.0, |(sigma, _)| sigma * sigma);
            for s in stretches.clone() {
                p = Map::over(&colour, s.rate, s.length_s).of(&p);
            }
            let found = p[(0, 0)];
            assert!(
                (found / limit - 1.0).abs() < 2e-3,
                "{colour:?} {found} {limit}"
            );
            let least = least_variance(&colour, prior, stretches);
            assert!(least <= found * (1.0 + 1e-12), "{colour:?}");
            if walk == 0.0 {
                assert!((least / found - 1.0).abs() < 1e-12, "{colour:?}");
            }
        }
    }

    /// One map over a long time is many over short ones, from nearly nothing to years.
    #[test]
    fn a_long_time_is_many_short_ones() {
        for (walk, markov) in [
            (2.5e-9, Some((0.003, 600.0))),
            (1e-4, Some((5.0, 1.0))),
            (0.0, Some((0.003, 1e9))),
            (1e-16, None),
        ] {
            let colour = colour(walk, markov);
            for time_s in [1e-3, 10.0, 1e4, 1e8] {
                let start = Matrix2::new(0.3, 0.0, 0.0, 1e-5);
                let once = Map::over(&colour, 700.0, time_s).of(&start);
                let part = Map::over(&colour, 700.0, time_s / 37.0);
                let often = (0..37).fold(start, |p, _| part.of(&p));
                let scale = once.amax();
                assert!((once - often).amax() < 1e-9 * scale, "{colour:?} {time_s}");
                assert!(once[(0, 0)] > 0.0 && once.determinant() > -1e-12 * scale * scale);
            }
        }
    }
}
