//! A dense Kalman filter in 320-bit arithmetic, the judge where double precision is none of
//! itself.
//!
//! It takes the platform and the schedule as they are given: sines and cosines of the angles, which
//! are decimals of degrees, to all its digits, so that what is the same combination at several
//! positions stays so. Moves take no time.

use dashu_float::FBig;
use dashu_float::round::mode::HalfEven;
use scheme_opt::internals::attitude::{EAST, NORTH, Position, UP};
use scheme_opt::internals::covariance::{CovarianceModel, split_periods};
use scheme_opt::internals::drift::{
    COEFFICIENTS, CoefficientMatrix, CoefficientVector, DriftCoefficient,
};
use scheme_opt::internals::platform::{Platform, Repositioning};
use scheme_opt::internals::schedule::Schedule;
use scheme_opt::internals::units::ARCSEC_PER_RAD;

type Float = FBig<HalfEven, 2>;
type Matrix = Vec<Vec<Float>>;

const BITS: usize = 320;
const STATES: usize = 3 + COEFFICIENTS;

/// What the filter knows at the end of a test.
pub struct Exact {
    /// 1σ of each coefficient, °/h.
    pub sigma_deg_per_h: Vec<f64>,
    /// 1σ of ψ^n about North, Up, East, arcsec.
    pub misalignment_sigma_arcsec: Vec<f64>,
    /// P_D, (°/h)², rounded.
    pub coefficients: CoefficientMatrix,
    /// ln det P_D, P_D in (°/h)², by its pivots.
    pub log_det: f64,
}

impl Exact {
    /// Criteria d, e, a of P_D, °/h.
    pub fn criteria(&self) -> [f64; 3] {
        let largest = self.coefficients.symmetric_eigenvalues().max();
        [
            (self.log_det / 24.0).exp(),
            largest.sqrt(),
            (self.coefficients.trace() / 12.0).sqrt(),
        ]
    }
}

fn float(v: f64) -> Float {
    Float::try_from(v).unwrap().with_precision(BITS).value()
}

fn zeros(rows: usize, columns: usize) -> Matrix {
    vec![vec![float(0.0); columns]; rows]
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let mut c = zeros(a.len(), b[0].len());
    for (row, target) in a.iter().zip(&mut c) {
        for (l, factor) in row.iter().enumerate() {
            for (j, value) in target.iter_mut().enumerate() {
                *value += factor * &b[l][j];
            }
        }
    }
    c
}

fn transposed(a: &Matrix) -> Matrix {
    (0..a[0].len())
        .map(|j| a.iter().map(|row| row[j].clone()).collect())
        .collect()
}

/// π by Machin's formula, 16 arccot 5 − 4 arccot 239.
fn pi() -> Float {
    let arccot = |n: f64| {
        let mut sum = float(0.0);
        let mut power = float(1.0) / float(n);
        for k in 0..150_u32 {
            let term = &power / float(f64::from(2 * k + 1));
            match k % 2 {
                0 => sum += term,
                _ => sum -= term,
            }
            power /= float(n * n);
        }
        sum
    };
    float(16.0) * arccot(5.0) - float(4.0) * arccot(239.0)
}

/// An angle of a position, rad: the decimal of nine places that it is next to, without whole
/// turns, and what is left, to all digits.
fn radians(deg: f64) -> Float {
    let nano = (deg * 1e9).round();
    let rest = float(deg - nano / 1e9);
    let decimal = float(nano % 360e9) / float(1e9);
    (decimal + rest) * pi() / float(180.0)
}

/// sin and cos by their series.
fn sin_cos(deg: f64) -> [Float; 2] {
    let x = radians(deg);
    let mut sums = [float(0.0), float(0.0)];
    let mut term = float(1.0);
    for k in 0..140_u32 {
        let sum = &mut sums[(k + 1) as usize % 2];
        match k % 4 {
            0 | 1 => *sum += &term,
            _ => *sum -= &term,
        }
        term = term * &x / float(f64::from(k + 1));
    }
    // A multiple of 90° is one: what is left of the series is rounding.
    if sums.iter().any(|v| v.to_f64().value().abs() < 1e-60) {
        return sums.map(|v| float(v.to_f64().value().round()));
    }
    sums
}

/// C_c^n = Mx(α) My(β) Mz(γ) (19).
fn attitude(position: Position) -> Matrix {
    let turn = |angle: f64, axis: usize| {
        let [s, c] = sin_cos(angle);
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut m = zeros(3, 3);
        m[axis][axis] = float(1.0);
        m[j][j] = c.clone();
        m[k][k] = c;
        m[k][j] = -s.clone();
        m[j][k] = s;
        m
    };
    let [alpha, beta, gamma] = position.degrees();
    product(&product(&turn(alpha, 0), &turn(beta, 1)), &turn(gamma, 2))
}

/// A (3×12): what each coefficient does to ε^n.
fn drift_matrix(attitude: &Matrix) -> Matrix {
    let mut a = zeros(3, COEFFICIENTS);
    for c in DriftCoefficient::ALL {
        let mut unit = CoefficientVector::zeros();
        unit[c.index()] = 1.0;
        // Its factor is linear in g^c, which is minus the Up row of C_c^n.
        let factor_at = |gravity: [f64; 3]| {
            scheme_opt::internals::drift::drift_c(&unit, &gravity.into())[c.gyro()]
        };
        let constant = factor_at([0.0; 3]);
        let mut factor = float(constant);
        for axis in 0..3 {
            let mut gravity = [0.0; 3];
            gravity[axis] = 1.0;
            factor -= float(factor_at(gravity) - constant) * &attitude[UP][axis];
        }
        for i in 0..3 {
            a[i][c.index()] = &attitude[i][c.gyro()] * &factor;
        }
    }
    a
}

/// Φ and Γ of an interval by their Taylor series.
fn transition(earth_rate: [f64; 3], length_s: f64) -> [Matrix; 2] {
    let [x, y, z] = earth_rate;
    // F = −[ω ×].
    let f: Matrix = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        .map(|row| row.map(float).to_vec())
        .to_vec();
    let (mut phi, mut gamma) = (zeros(3, 3), zeros(3, 3));
    let mut term = zeros(3, 3);
    for (i, row) in term.iter_mut().enumerate() {
        row[i] = float(1.0);
    }
    let t = float(length_s);
    for k in 1..90 {
        let step = &t / float(f64::from(k));
        let next = product(&f, &term);
        for i in 0..3 {
            for j in 0..3 {
                phi[i][j] += &term[i][j];
                gamma[i][j] += &term[i][j] * &step;
                term[i][j] = &next[i][j] * &step;
            }
        }
    }
    [phi, gamma]
}

struct Filter {
    p: Matrix,
    /// r², arcsec².
    noise: Float,
    /// q, arcsec²/s.
    drift_psd: Float,
}

impl Filter {
    fn new(platform: &Platform) -> Self {
        let model = CovarianceModel::new(platform);
        let noise = float(platform.noise_g()) * float(ARCSEC_PER_RAD);
        let mut p = zeros(STATES, STATES);
        for i in 0..STATES {
            let sigma = match i {
                0..3 => float(platform.prior_misalignment_rad()[i]) * float(ARCSEC_PER_RAD),
                _ => float(model.prior_sigma_deg_per_h()[i - 3]),
            };
            p[i][i] = &sigma * &sigma;
        }
        Self {
            p,
            noise: &noise * &noise,
            drift_psd: float(platform.drift_psd_rad2_per_s() * ARCSEC_PER_RAD.powi(2)),
        }
    }

    /// ψ^n ← M (ψ^n, D), M of 3×15.
    fn drive(&mut self, m: &Matrix) {
        let driven = product(m, &self.p);
        let own = product(&driven, &transposed(m));
        for i in 0..3 {
            for j in 0..3 {
                self.p[i][j] = own[i][j].clone();
            }
            for j in 3..STATES {
                self.p[i][j] = driven[i][j].clone();
                self.p[j][i] = driven[i][j].clone();
            }
        }
    }

    /// Measures ψ_x (North) and ψ_z (East), one after the other.
    fn measure(&mut self) {
        for axis in [NORTH, EAST] {
            let row = self.p[axis].clone();
            let innovation = &row[axis] + &self.noise;
            for i in 0..STATES {
                let gain = &row[i] / &innovation;
                for j in 0..STATES {
                    self.p[i][j] -= &gain * &row[j];
                }
            }
        }
    }

    fn coefficients(&self) -> CoefficientMatrix {
        CoefficientMatrix::from_fn(|i, j| self.p[3 + i][3 + j].to_f64().value())
    }

    /// ln det P_D by elimination.
    fn log_det(&self) -> f64 {
        let mut p: Matrix = self.p[3..].iter().map(|row| row[3..].to_vec()).collect();
        let mut log = 0.0;
        // Over the coefficients that are not known exactly.
        let open: Vec<usize> = (0..COEFFICIENTS)
            .filter(|&k| p[k][k] != float(0.0))
            .collect();
        for (at, &k) in open.iter().enumerate() {
            log += p[k][k].to_f64().value().ln();
            for &i in &open[at + 1..] {
                let factor = &p[i][k] / &p[k][k];
                for &j in &open[at..] {
                    let less = &factor * &p[k][j];
                    p[i][j] -= less;
                }
            }
        }
        log
    }

    fn sigma(&self, states: std::ops::Range<usize>) -> Vec<f64> {
        states
            .map(|i| self.p[i][i].to_f64().value().sqrt())
            .collect()
    }
}

/// Runs the filter through `schedule`.
pub fn run(platform: &Platform, schedule: &Schedule) -> Exact {
    assert!(platform.motion().slew.is_none() || schedule.positions().len() == 1);
    assert!(platform.motion().settle_s == 0.0);
    let mut filter = Filter::new(platform);
    let rate = platform.earth_rate_n();
    let mut before: Option<Matrix> = None;
    for scheduled in schedule.positions() {
        let attitude = attitude(scheduled.position);
        if let Some(before) = before
            && platform.motion().repositioning == Repositioning::FrameHold
        {
            let mut turn = product(&attitude, &transposed(&before));
            turn.iter_mut()
                .for_each(|row| row.resize(STATES, float(0.0)));
            filter.drive(&turn);
        }
        let a = drift_matrix(&attitude);
        let period_s = platform.period_s();
        let (ticks, remainder_s) = split_periods(scheduled.dwell_s, period_s);
        for (length_s, times, measured) in [(period_s, ticks, true), (remainder_s, 1, false)] {
            let [phi, gamma] = transition([rate.x, rate.y, rate.z], length_s);
            let mut m = phi;
            for (row, b) in m.iter_mut().zip(product(&gamma, &a)) {
                row.extend(b);
            }
            let process = &filter.drift_psd * float(length_s);
            for _ in 0..times {
                filter.drive(&m);
                for i in 0..3 {
                    filter.p[i][i] += &process;
                }
                if measured {
                    filter.measure();
                }
            }
        }
        before = Some(attitude);
    }
    Exact {
        sigma_deg_per_h: filter.sigma(3..STATES),
        misalignment_sigma_arcsec: filter.sigma(0..3),
        coefficients: filter.coefficients(),
        log_det: filter.log_det(),
    }
}
