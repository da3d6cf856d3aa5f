//! Drift and biases that wander, as the filter carries them: states fixed in the platform.
//!
//! Beside ψ^n the state has, three by three and where they are: the random walk and the Gauss–Markov
//! process of the drift, and those of the accelerometers' biases, d and b along the axes of the platform.
//! Over an interval
//!
//! ```text
//! ψ ← Φ ψ + Σ M_j d_j + …,    d_j ← e^{−t/τ_j} d_j + …,    Ṁ_j = F M_j + C_c^n(t) e^{−t/τ_j},
//! ```
//!
//! and the covariance of what comes anew obeys Q̇ = A Q + Q Aᵀ + Q_c. At a position both are summed as
//! Taylor series over a short while and doubled; in a move Runge–Kutta steps follow them.

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::instrument::Instrument;
use super::transition::way_done;
use super::{ORDER, transition};
use crate::attitude::Position;
use crate::covariance::real::{Dense, Real};
use crate::model::{Colour, Markov};
use crate::motion::Move;
use crate::platform::Platform;
use crate::units::ARCSEC_PER_RAD;

/// A process, in arcsec and °/h.
#[derive(Debug, Clone, Copy)]
enum Process {
    /// Variance by which it grows in a second.
    Walk(f64),
    Markov(Markov),
}

impl Process {
    fn of(colour: &Colour) -> Vec<Self> {
        let walk = colour.random_walk.map(Self::Walk);
        walk.into_iter()
            .chain(colour.markov.map(Self::Markov))
            .collect()
    }

    /// 1/τ.
    fn decay(self) -> f64 {
        match self {
            Self::Walk(_) => 0.0,
            Self::Markov(m) => 1.0 / m.time_s,
        }
    }

    /// Variance of what comes anew in `t_s`.
    fn renewed(self, t_s: f64) -> f64 {
        match self {
            Self::Walk(k) => k * t_s,
            Self::Markov(m) => m.renewed(t_s),
        }
    }

    /// σ at the start; a walk that starts from nothing has that much of what a period adds to it.
    fn start<T: Real>(self, period_s: f64) -> f64 {
        match self {
            Self::Walk(k) => T::KNOWN * (k * period_s).sqrt(),
            Self::Markov(m) => m.sigma,
        }
    }
}

/// What wanders.
pub(super) struct Wandering {
    drift: Vec<Process>,
    accelerometers: Vec<Process>,
    /// PSD of the white drift, arcsec²/s.
    white: f64,
}

/// What happens to the states over an interval.
#[derive(Clone)]
pub(super) struct Wandered<T> {
    /// M_j of the drift's processes.
    pub carried: Vec<Dense<T, 3, 3>>,
    /// e^{−t/τ_j} of all processes.
    pub kept: Vec<T>,
    /// Row by row a root of the covariance of what comes anew, ψ^n in [`ORDER`].
    pub noise: Vec<Vec<T>>,
}

/// M_j, and the covariances of what comes anew: of ψ^n with each d_j, and of ψ^n.
struct Blocks<T: Real> {
    carried: Vec<Matrix3<T>>,
    crossed: Vec<Matrix3<T>>,
    psi: Matrix3<T>,
}

impl Wandering {
    /// Of a platform; none where noise is white.
    pub fn of(platform: &Platform) -> Option<Self> {
        let of = |colour: &Colour| Process::of(&colour.times(ARCSEC_PER_RAD));
        (!platform.is_white()).then(|| Self {
            drift: of(&platform.drift_colour),
            accelerometers: of(&platform.accelerometer_colour),
            white: platform.drift_psd * ARCSEC_PER_RAD.powi(2),
        })
    }

    fn all(&self) -> impl Iterator<Item = Process> + '_ {
        self.drift.iter().chain(&self.accelerometers).copied()
    }

    /// How many states there are beside ψ^n.
    pub fn states(&self) -> usize {
        3 * self.all().count()
    }

    /// Whether the drift has a random walk, which then is the first of the processes.
    pub fn has_walk(&self) -> bool {
        matches!(self.drift.first(), Some(Process::Walk(_)))
    }

    /// Whether the accelerometers' biases wander.
    pub fn has_accelerometers(&self) -> bool {
        !self.accelerometers.is_empty()
    }

    /// σ of every state at the start.
    pub fn start<T: Real>(&self, period_s: f64) -> Vec<f64> {
        let each = self.all().map(|p| p.start::<T>(period_s));
        each.flat_map(|sigma| [sigma; 3]).collect()
    }

    /// What a channel along `axis` of n sees of the states where the platform stands so.
    pub fn seen<T: Real>(&self, attitude: &Dense<T, 3, 3>, axis: usize) -> Vec<T> {
        let mut seen = vec![T::from(0.0); 3 * self.drift.len()];
        for _ in &self.accelerometers {
            seen.extend(attitude[axis]);
        }
        seen
    }

    /// In how many parts an interval is to be gone through, so that each keeps a share of every
    /// process: what it did before is found by dividing by that.
    pub fn parts(&self, length_s: f64) -> usize {
        /// e⁻⁸ is 1 in 3000.
        const DECAYS: f64 = 8.0;
        let fastest = self.all().map(Process::decay).fold(0.0, f64::max);
        (length_s * fastest / DECAYS).ceil().max(1.0) as usize
    }

    /// An interval at a position.
    pub fn held<T: Real>(
        &self,
        attitude: &Dense<T, 3, 3>,
        earth: &Vector3<f64>,
        length_s: f64,
    ) -> Wandered<T> {
        /// Longest interval of the series, s.
        const LONGEST_S: f64 = 1000.0;
        /// 2⁴⁵/45! is below 1e-42.
        const TERMS: u32 = 45;
        let size = 3 + 3 * self.drift.len();
        let mut system = DMatrix::<T>::zeros(size, size);
        let mut driven = DMatrix::<T>::zeros(size, size);
        let f = -earth.cross_matrix();
        for i in 0..3 {
            driven[(i, i)] = T::from(self.white);
            for j in 0..3 {
                system[(i, j)] = T::from(f[(i, j)]);
            }
            for (k, process) in self.drift.iter().enumerate() {
                let at = 3 + 3 * k;
                for j in 0..3 {
                    system[(i, at + j)] = attitude[i][j];
                }
                if let Process::Markov(m) = process {
                    system[(at + i, at + i)] = T::from(-1.0) / T::from(m.time_s);
                }
                driven[(at + i, at + i)] = psd(*process);
            }
        }
        let fastest = self.drift.iter().map(|p| p.decay()).fold(0.0, f64::max);
        let shares = (length_s * fastest).max(length_s / LONGEST_S);
        let doublings = libm::log2(shares).ceil().max(0.0) as i32;
        let t = T::from(length_s) / T::from(libm::pow(2.0, f64::from(doublings)));
        let (mut phi, mut q) = (DMatrix::<T>::zeros(size, size), DMatrix::zeros(size, size));
        let (mut term, mut noise) = (DMatrix::<T>::identity(size, size), driven * t);
        for k in 1..TERMS {
            phi += &term;
            q += &noise;
            term = &system * term * (t / T::from(f64::from(k)));
            let pulled = &system * noise;
            noise = (&pulled + pulled.transpose()) * (t / T::from(f64::from(k + 1)));
        }
        for _ in 0..doublings {
            q += &phi * &q * phi.transpose();
            phi = &phi * &phi;
        }
        let block = |m: &DMatrix<T>, at: usize| Matrix3::from_fn(|i, j| m[(i, at + j)]);
        let places = (0..self.drift.len()).map(|k| 3 + 3 * k);
        self.wandered(
            &Blocks {
                carried: places.clone().map(|at| block(&phi, at)).collect(),
                crossed: places.map(|at| block(&q, at)).collect(),
                psi: block(&q, 0),
            },
            length_s,
        )
    }

    /// A part of a move, in doubles.
    pub fn moved<T: Real>(
        &self,
        instrument: &Instrument,
        earth: &Vector3<f64>,
        m: &Move,
        (start_s, length_s): (f64, f64),
    ) -> Wandered<T> {
        /// Turn per step, rad (0.25°), and longest step, s, and in time constants.
        const STEP_RAD: f64 = 0.0044;
        const STEP_S: f64 = 50.0;
        const STEP_OF_TIME: f64 = 0.02;
        let speed = |at_s: f64| way_done(m, at_s / m.duration_s).1;
        let speed = speed(start_s).max(speed(start_s + length_s));
        let turn = m.change.iter().map(|c| c.abs()).sum::<f64>() * length_s / m.duration_s * speed;
        let fastest = self.drift.iter().map(|p| p.decay()).fold(0.0, f64::max);
        let steps = (turn / STEP_RAD)
            .max(length_s / STEP_S)
            .max(length_s * fastest / STEP_OF_TIME);
        let steps = steps.ceil().max(1.0) as usize;
        let h = length_s / steps as f64;
        let f = -earth.cross_matrix();
        let attitude = |t_s: f64| {
            let (done, _) = way_done(m, (start_s + t_s) / m.duration_s);
            let position: Position = m.position_after(done);
            let c = instrument.attitude::<f64>(position);
            Matrix3::from_fn(|i, j| c[i][j])
        };
        let mut blocks = Blocks {
            carried: vec![Matrix3::zeros(); self.drift.len()],
            crossed: vec![Matrix3::zeros(); self.drift.len()],
            psi: Matrix3::zeros(),
        };
        let mut c0 = attitude(0.0);
        for step in 0..steps {
            let t_s = step as f64 * h;
            let (middle, c1) = (attitude(t_s + 0.5 * h), attitude(t_s + h));
            let slope = |b: &Blocks<f64>, c: &Matrix3<f64>, t_s| self.slope(b, c, &f, t_s);
            let k1 = slope(&blocks, &c0, t_s);
            let k2 = slope(&blocks.plus(&k1, 0.5 * h), &middle, t_s + 0.5 * h);
            let k3 = slope(&blocks.plus(&k2, 0.5 * h), &middle, t_s + 0.5 * h);
            let k4 = slope(&blocks.plus(&k3, h), &c1, t_s + h);
            let ends = k1.plus(&k4, 1.0);
            let between = k2.plus(&k3, 1.0);
            blocks = blocks.plus(&ends.plus(&between, 2.0), h / 6.0);
            c0 = c1;
        }
        let convert = |m: &Matrix3<f64>| m.map(T::from);
        let converted = Blocks {
            carried: blocks.carried.iter().map(convert).collect(),
            crossed: blocks.crossed.iter().map(convert).collect(),
            psi: convert(&blocks.psi),
        };
        self.wandered(&converted, length_s)
    }

    /// d/dt of the blocks, `t_s` after the start of the interval.
    fn slope(&self, b: &Blocks<f64>, c: &Matrix3<f64>, f: &Matrix3<f64>, t_s: f64) -> Blocks<f64> {
        let mut psi = f * b.psi + Matrix3::identity() * (0.5 * self.white);
        let (mut carried, mut crossed) = (Vec::new(), Vec::new());
        for (k, process) in self.drift.iter().enumerate() {
            let kept = libm::exp(-process.decay() * t_s);
            carried.push(f * b.carried[k] + c * kept);
            psi += c * b.crossed[k].transpose();
            let renewed = c * process.renewed(t_s);
            crossed.push(f * b.crossed[k] + renewed - b.crossed[k] * process.decay());
        }
        Blocks {
            carried,
            crossed,
            psi: psi + psi.transpose(),
        }
    }

    fn wandered<T: Real>(&self, blocks: &Blocks<T>, length_s: f64) -> Wandered<T> {
        let kept = self.all().map(|p| transition::decay(p.decay(), length_s));
        Wandered {
            carried: blocks
                .carried
                .iter()
                .map(|m| std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)])))
                .collect(),
            kept: kept.collect(),
            noise: self.root(blocks, length_s),
        }
    }

    /// [L_ψ X; 0 L_d]: with the d_j first, whose own covariance is diagonal.
    fn root<T: Real>(&self, blocks: &Blocks<T>, length_s: f64) -> Vec<Vec<T>> {
        let size = 3 + self.states();
        let mut root = vec![vec![T::from(0.0); size]; size];
        let mut left = blocks.psi;
        for (k, process) in self.all().enumerate() {
            let sigma = renewed::<T>(process, length_s).sqrt();
            let at = 3 + 3 * k;
            for i in 0..3 {
                root[at + i][at + i] = sigma;
            }
            if let Some(crossed) = blocks.crossed.get(k) {
                let through = crossed.map(|v| v / sigma);
                left -= through * through.transpose();
                for (row, axis) in ORDER.into_iter().enumerate() {
                    for j in 0..3 {
                        root[row][at + j] = through[(axis, j)];
                    }
                }
            }
        }
        // Cholesky's factor of what is left.
        for j in 0..3 {
            for i in j..3 {
                let before = root[i].iter().zip(&root[j]).take(j);
                let sum = before.fold(left[(ORDER[i], ORDER[j])], |sum, (a, b)| sum - *a * *b);
                root[i][j] = match i == j {
                    true if sum > T::from(0.0) => sum.sqrt(),
                    false if root[j][j] > T::from(0.0) => sum / root[j][j],
                    _ => T::from(0.0),
                };
            }
        }
        root
    }
}

/// PSD of the noise that drives a process, to all digits.
fn psd<T: Real>(process: Process) -> T {
    match process {
        Process::Walk(k) => T::from(k),
        Process::Markov(m) => {
            T::from(2.0) * T::from(m.sigma) * T::from(m.sigma) / T::from(m.time_s)
        }
    }
}

/// Variance of what comes anew, to all digits.
fn renewed<T: Real>(process: Process, length_s: f64) -> T {
    match process {
        Process::Walk(k) => T::from(k) * T::from(length_s),
        Process::Markov(m) => {
            let lost = transition::decayed::<T>(2.0 / m.time_s, length_s);
            T::from(m.sigma) * T::from(m.sigma) * lost
        }
    }
}

impl Blocks<f64> {
    /// With `h` times others.
    fn plus(&self, more: &Self, h: f64) -> Self {
        let both = |a: &[Matrix3<f64>], b: &[Matrix3<f64>]| {
            a.iter().zip(b).map(|(a, b)| a + b * h).collect()
        };
        Self {
            carried: both(&self.carried, &more.carried),
            crossed: both(&self.crossed, &more.crossed),
            psi: self.psi + more.psi * h,
        }
    }
}
