//! ln separability for searches: value and gradient by the Gram matrix of the weighted rows, through
//! its structure.
//!
//! The rows of a position held (or of a moment of a measured move) are `w_i c_ia h_ap` over gyros a
//! and h_a = (1, g_I, g_O, g_S) along their axes, i the channel's axis in n, c = C_c^n, g = g^c; and in
//! the z row stands `w_z κ` for ω_N ψ_y(0). So each adds, for gyros a and b,
//!
//! ```text
//! M_ab h_a h_bᵀ,  M = Σ_i w_i² c_i c_iᵀ (3×3);   w_z² κ c_za h_a;   w_z² κ²
//! ```
//!
//! to the Gram matrix G, a fifth of the products that its rows would take one by one, and the
//! adjoint goes back the same way. With G = Rᵀ R and Q = G⁻¹, ln s_i = −½ ln(Q_ii G_ii).
//!
//! A column that the columns before it explain is left out: it and what explains it have
//! separability zero, and the others have what they have without it.

use nalgebra::Matrix3;

use super::regressor::{Change, Regressor, RowBlock, RowSource};
use crate::attitude::{EAST, Stand, UP};
use crate::covariance::CovarianceModel;
use crate::covariance::fast::arithmetic::Single;
use crate::covariance::fast::dispatch::{self, Task};
use crate::covariance::gradient::LegGradient;
use crate::drift::{CoefficientVector, DriftCoefficient, DriftKind};
use crate::motion::Timeline;

/// Factors of a gyro: 1 and the components of gravity along its axes.
const FACTORS: usize = 4;
/// Where ω_N ψ_y(0) stands, after three gyros of four factors.
const AZIMUTH: usize = 3 * FACTORS;
/// Unknowns: the coefficients, gyro by gyro, and ω_N ψ_y(0).
const UNKNOWNS: usize = AZIMUTH + 1;
/// Columns of a row in memory, a whole number of registers; the last are zero.
const WIDTH: usize = 16;
/// A matrix over the unknowns.
type Square = [[f64; WIDTH]; UNKNOWNS];

/// Share of a column's square that must be its own: the Gram matrix has half the digits of the
/// rows, so that below this there is rounding.
const OWN: f64 = 1e-12;
/// The least ln separability that is told from none: √[`OWN`].
pub(crate) const LEAST_LOG: f64 = -13.815_510_557_964_274;
/// A column takes part in explaining another when its share is longer than this.
const TAKES_PART: f64 = 1e-6;

/// ln separability of each coefficient and a way back to the gradient of any function of them.
pub(crate) struct LogSeparability {
    regressor: Regressor,
    solved: Solved,
    /// ln s_i; [`LEAST_LOG`] where a coefficient cannot be separated at all.
    pub log: CoefficientVector,
}

impl LogSeparability {
    /// Of all channels of `timeline`.
    pub fn new(model: &CovarianceModel, timeline: &Timeline) -> Self {
        let regressor = Regressor::new(model, timeline);
        let solved = dispatch::run(Solve(&regressor));
        let log = CoefficientVector::from_fn(|i, _| {
            let log = solved.log[place(DriftCoefficient::ALL[i])];
            log.max(LEAST_LOG)
        });
        Self {
            regressor,
            solved,
            log,
        }
    }

    /// Adds the gradient of a function with derivatives `slopes` with respect to each ln s_i.
    ///
    /// d ln s_i = ½ q_iᵀ dG q_i/Q_ii − ½ dG_ii/G_ii with q_i column i of Q.
    pub fn add_gradient(
        &self,
        timeline: &Timeline,
        slopes: &CoefficientVector,
        gradient: &mut [LegGradient],
    ) {
        let mut placed = [0.0; UNKNOWNS];
        for c in DriftCoefficient::ALL {
            let at = place(c);
            if self.solved.log[at] > LEAST_LOG {
                placed[at] = slopes[c.index()];
            }
        }
        let mut azimuth_adjoint = vec![0.0; timeline.legs().len()];
        let azimuth_slope = dispatch::run(Pull {
            of: self,
            timeline,
            slopes: &placed,
            gradient,
            azimuth_adjoint: &mut azimuth_adjoint,
        });
        self.add_changes(timeline, &azimuth_adjoint, azimuth_slope, gradient);
    }

    /// The part of the gradient that comes through the shares q_k of ψ_y(0) in frame-hold
    /// repositioning: `azimuth_adjoint` with respect to −q_k, leg by leg, and `azimuth_slope`
    /// with respect to the azimuth's own entry of the Gram matrix.
    fn add_changes(
        &self,
        timeline: &Timeline,
        azimuth_adjoint: &[f64],
        azimuth_slope: f64,
        gradient: &mut [LegGradient],
    ) {
        let legs = timeline.legs();
        // ∂f/∂q of the leg at hand, from the last to the first.
        let mut share_adjoint = 0.0;
        for change in self.regressor.changes.iter().rev() {
            let Change {
                leg,
                cosine,
                share,
                weight,
            } = *change;
            share_adjoint -= azimuth_adjoint[leg];
            // The row's square is w² q² (1 − c²); q₊ = c q.
            let slope = azimuth_slope * weight * weight;
            let cosine_adjoint = share * share_adjoint - 2.0 * slope * share * share * cosine;
            share_adjoint = cosine * share_adjoint + 2.0 * slope * share * (1.0 - cosine * cosine);
            let gravity = [leg - 1, leg].map(|k| legs[k].attitude.gravity_c());
            for (k, other) in [(leg - 1, gravity[1]), (leg, gravity[0])] {
                // c = g_k · g_{k−1}, and g is minus the Up row of C.
                let mut c_adjoint = Matrix3::zeros();
                c_adjoint.set_row(UP, &(-cosine_adjoint * other.transpose()));
                let (stand, leg) = (&self.regressor.stand, &legs[k]);
                let angles = stand.angle_adjoint(&leg.attitude, leg.position, &c_adjoint);
                for (sum, angle) in gradient[k].angles.iter_mut().zip(angles) {
                    *sum += angle;
                }
            }
        }
    }
}

/// Where a coefficient stands: by its gyro, and in that by its factor.
const fn place(c: DriftCoefficient) -> usize {
    let factor = match c.kind() {
        DriftKind::Constant => 0,
        DriftKind::Input => 1,
        DriftKind::Output => 2,
        DriftKind::Spin => 3,
    };
    FACTORS * c.gyro() + factor
}

/// What a block adds to the Gram matrix is made of.
struct Parts {
    /// C_c^n, rounding left out.
    c: [[f64; 3]; 3],
    /// Of each gyro: 1 and gravity along its axes.
    h: [[f64; FACTORS]; 3],
    /// w_i².
    squares: [f64; 3],
    /// M.
    m: [[f64; 3]; 3],
}

impl Parts {
    #[inline(always)]
    fn new(regressor: &Regressor, block: &RowBlock) -> Self {
        let c: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|a| block.entry(i, a)));
        let g = c[UP];
        let mut squares = block.weights.map(|w| w * w);
        if !regressor.vertical_channel {
            squares[UP] = 0.0;
        }
        let m = std::array::from_fn(|a| {
            std::array::from_fn(|b| {
                squares[0] * c[0][a] * c[0][b]
                    + squares[1] * c[1][a] * c[1][b]
                    + squares[2] * c[2][a] * c[2][b]
            })
        });
        // g is minus the Up row of C.
        let along = |axis: &[f64; 3]| -(axis[0] * g[0] + axis[1] * g[1] + axis[2] * g[2]);
        let h = regressor
            .mounting
            .axes()
            .map(|[input, output, spin]| [1.0, along(&input), along(&output), along(&spin)]);
        Self { c, h, squares, m }
    }
}

/// The Gram matrix and what comes of it.
struct Solved {
    /// G_ii.
    diagonal: [f64; UNKNOWNS],
    /// G⁻¹ over the columns that are kept.
    inverse: Square,
    /// ln s_i; minus infinity where a column is explained by others.
    log: [f64; UNKNOWNS],
}

/// Makes [`Solved`].
struct Solve<'a>(&'a Regressor);

impl Task for Solve<'_> {
    type Output = Solved;
    #[inline(always)]
    fn run<A: Single>(self, _: A) -> Solved {
        let mut gram = gram(self.0);
        let diagonal = std::array::from_fn(|i| gram[i][i]);
        let left_out = factor(&mut gram, &diagonal);
        solve(gram, diagonal, &left_out)
    }
}

/// The upper half of G.
#[inline(always)]
fn gram(regressor: &Regressor) -> Square {
    let mut gram = [[0.0; WIDTH]; UNKNOWNS];
    for block in &regressor.blocks {
        let Parts { c, h, squares, m } = Parts::new(regressor, block);
        for a in 0..3 {
            for p in 0..FACTORS {
                let row = &mut gram[FACTORS * a + p];
                for b in a..3 {
                    let factor = m[a][b] * h[a][p];
                    for q in 0..FACTORS {
                        row[FACTORS * b + q] += factor * h[b][q];
                    }
                }
            }
        }
        if regressor.azimuth_unknown {
            let weight = squares[EAST] * block.azimuth;
            for a in 0..3 {
                for p in 0..FACTORS {
                    gram[FACTORS * a + p][AZIMUTH] += weight * c[EAST][a] * h[a][p];
                }
            }
            gram[AZIMUTH][AZIMUTH] += weight * block.azimuth;
        }
    }
    for change in &regressor.changes {
        if let Some(coefficient) = change.told() {
            gram[AZIMUTH][AZIMUTH] += (change.weight * coefficient).powi(2);
        }
    }
    // It depends on nothing that a search changes: no part of the gradient.
    if let Some(measured) = regressor.measured_azimuth {
        gram[AZIMUTH][AZIMUTH] += measured.weight * measured.weight;
    }
    gram
}

/// R in place of the upper half of G. Columns that those before them explain get a row of the unit
/// matrix; in their column stands how, for [`solve`]. Returns which they are.
#[inline(always)]
fn factor(gram: &mut Square, diagonal: &[f64; UNKNOWNS]) -> [bool; UNKNOWNS] {
    let mut left_out = [false; UNKNOWNS];
    for k in 0..UNKNOWNS {
        let pivot = gram[k][k];
        // A pivot that is no number explains nothing either.
        if pivot.is_nan() || pivot <= OWN * diagonal[k] {
            left_out[k] = true;
            gram[k] = [0.0; WIDTH];
            gram[k][k] = 1.0;
            continue;
        }
        let scale = pivot.sqrt().recip();
        for value in &mut gram[k] {
            *value *= scale;
        }
        gram[k][..k].fill(0.0);
        let row = gram[k];
        for i in k + 1..UNKNOWNS {
            let factor = row[i];
            for (value, r) in gram[i].iter_mut().zip(&row) {
                *value -= factor * r;
            }
        }
    }
    left_out
}

/// Inverse and separabilities from R.
#[inline(always)]
fn solve(mut r: Square, diagonal: [f64; UNKNOWNS], left_out: &[bool; UNKNOWNS]) -> Solved {
    let mut explained = *left_out;
    let mut columns = [[0.0; UNKNOWNS]; UNKNOWNS];
    for k in (0..UNKNOWNS).filter(|&k| left_out[k]) {
        for i in 0..k {
            columns[k][i] = std::mem::take(&mut r[i][k]);
        }
    }
    let lower = transposed_inverse(&r);
    for k in (0..UNKNOWNS).filter(|&k| left_out[k]) {
        // What the columns before it make of it: R⁻¹ r.
        for i in 0..k {
            let share: f64 = (i..k).map(|j| lower[j][i] * columns[k][j]).sum();
            explained[i] |= share.abs() * diagonal[i].sqrt() > TAKES_PART * diagonal[k].sqrt();
        }
    }
    let mut inverse = [[0.0; WIDTH]; UNKNOWNS];
    for row in &lower {
        for i in 0..UNKNOWNS {
            let factor = row[i];
            for (value, v) in inverse[i].iter_mut().zip(row) {
                *value += factor * v;
            }
        }
    }
    let log = std::array::from_fn(|i| match explained[i] {
        true => f64::NEG_INFINITY,
        false => -0.5 * libm::log(inverse[i][i] * diagonal[i]),
    });
    Solved {
        diagonal,
        inverse,
        log,
    }
}

/// R⁻ᵀ, row by row.
#[inline(always)]
fn transposed_inverse(r: &Square) -> Square {
    let mut lower = [[0.0; WIDTH]; UNKNOWNS];
    for k in 0..UNKNOWNS {
        let mut row = [0.0; WIDTH];
        row[k] = 1.0;
        for i in 0..k {
            let factor = r[i][k];
            for (value, l) in row.iter_mut().zip(&lower[i]) {
                *value -= factor * l;
            }
        }
        let scale = r[k][k].recip();
        lower[k] = row.map(|v| v * scale);
    }
    lower
}

/// Adds the gradient; gives the slope with respect to the azimuth's own entry of G.
struct Pull<'a> {
    of: &'a LogSeparability,
    timeline: &'a Timeline,
    slopes: &'a [f64; UNKNOWNS],
    gradient: &'a mut [LegGradient],
    azimuth_adjoint: &'a mut [f64],
}

impl Task for Pull<'_> {
    type Output = f64;
    #[inline(always)]
    fn run<A: Single>(self, _: A) -> f64 {
        let regressor = &self.of.regressor;
        let adjoint = gram_adjoint(&self.of.solved, self.slopes);
        for block in &regressor.blocks {
            let parts = Parts::new(regressor, block);
            let pulled = pulled(&adjoint, &parts, regressor, block.azimuth);
            self.azimuth_adjoint[block.leg] += pulled.azimuth;
            let slopes = pulled.weights;
            let duration = (0..3).fold(0.0, |sum, i| {
                sum + slopes[i] * block.weights[i] * block.weight_rates[i]
            });
            add_block(
                (&regressor.stand, self.timeline),
                block,
                &Matrix3::from_fn(|i, a| pulled.c[i][a]),
                duration,
                self.gradient,
            );
        }
        adjoint[AZIMUTH][AZIMUTH]
    }
}

/// ∂f/∂G from the slopes with respect to each ln s_i.
#[inline(always)]
fn gram_adjoint(solved: &Solved, slopes: &[f64; UNKNOWNS]) -> Square {
    let mut adjoint = [[0.0; WIDTH]; UNKNOWNS];
    for i in (0..UNKNOWNS).filter(|&i| slopes[i] != 0.0) {
        let q = solved.inverse[i];
        let scale = 0.5 * slopes[i] / q[i];
        for (row, value) in adjoint.iter_mut().zip(q) {
            let factor = scale * value;
            for (sum, v) in row.iter_mut().zip(&q) {
                *sum += factor * v;
            }
        }
        adjoint[i][i] -= 0.5 * slopes[i] / solved.diagonal[i];
    }
    adjoint
}

/// The adjoints of what a block is made of.
struct Pulled {
    /// ∂f/∂C.
    c: [[f64; 3]; 3],
    /// ∂f/∂w_i by w_i.
    weights: [f64; 3],
    /// ∂f/∂κ.
    azimuth: f64,
}

#[inline(always)]
fn pulled(adjoint: &Square, parts: &Parts, regressor: &Regressor, azimuth: f64) -> Pulled {
    let Parts { c, h, squares, m } = parts;
    let has_azimuth = regressor.azimuth_unknown;
    // N_ab = h_aᵀ Ḡ_ab h_b: the adjoint of M; and that of h_a.
    let mut n = [[0.0; 3]; 3];
    let mut h_adjoint = [[0.0; FACTORS]; 3];
    for a in 0..3 {
        for b in 0..3 {
            let mut sum = 0.0;
            for p in 0..FACTORS {
                let u = dot(&adjoint[FACTORS * a + p], b, &h[b]);
                sum += h[a][p] * u;
                h_adjoint[a][p] += 2.0 * m[a][b] * u;
            }
            n[a][b] = sum;
        }
    }
    // The azimuth's column: t_a = Ḡ_az,a h_a.
    let mut t = [0.0; 3];
    if has_azimuth {
        let weight = 2.0 * squares[EAST] * azimuth;
        for a in 0..3 {
            let row = &adjoint[AZIMUTH];
            t[a] = dot(row, a, &h[a]);
            for p in 0..FACTORS {
                h_adjoint[a][p] += weight * c[EAST][a] * row[FACTORS * a + p];
            }
        }
    }
    let along = c[EAST][0] * t[0] + c[EAST][1] * t[1] + c[EAST][2] * t[2];
    let own = match has_azimuth {
        true => adjoint[AZIMUTH][AZIMUTH],
        false => 0.0,
    };
    let mut out = Pulled {
        c: [[0.0; 3]; 3],
        weights: [0.0; 3],
        azimuth: 2.0 * squares[EAST] * (along + azimuth * own),
    };
    for i in 0..3 {
        let mut square = 0.0;
        for a in 0..3 {
            let nc = n[a][0] * c[i][0] + n[a][1] * c[i][1] + n[a][2] * c[i][2];
            square += c[i][a] * nc;
            let mut sum = nc;
            if i == EAST {
                sum += azimuth * t[a];
            }
            out.c[i][a] = 2.0 * squares[i] * sum;
        }
        if i == EAST {
            square += azimuth * (2.0 * along + azimuth * own);
        }
        // A channel that is not there has no weight to change.
        out.weights[i] = if squares[i] > 0.0 { 2.0 * square } else { 0.0 };
    }
    // g is minus the Up row of C.
    for (of_gyro, axes) in h_adjoint.iter().zip(regressor.mounting.axes()) {
        for (slope, axis) in of_gyro[1..].iter().zip(axes) {
            for (value, along) in out.c[UP].iter_mut().zip(axis) {
                *value -= slope * along;
            }
        }
    }
    out
}

/// The part of gyro `b` in a row, times its factors.
#[inline(always)]
fn dot(row: &[f64; WIDTH], b: usize, h: &[f64; FACTORS]) -> f64 {
    let at = FACTORS * b;
    (row[at] * h[0] + row[at + 1] * h[1]) + (row[at + 2] * h[2] + row[at + 3] * h[3])
}

fn add_block(
    (stand, timeline): (&Stand, &Timeline),
    block: &RowBlock,
    c_adjoint: &Matrix3<f64>,
    duration: f64,
    gradient: &mut [LegGradient],
) {
    let leg = block.leg;
    let l = &timeline.legs()[leg];
    match (block.source, &l.arrival) {
        (RowSource::Move { fraction }, Some(m)) => {
            let position = m.position_at(fraction);
            let angles = stand.angle_adjoint(&block.attitude, position, c_adjoint);
            for (i, angle) in angles.into_iter().enumerate() {
                gradient[leg].angles[i] += fraction * angle;
                gradient[leg - 1].angles[i] += (1.0 - fraction) * angle;
            }
            gradient[leg].move_s += duration;
        }
        _ => {
            let angles = stand.angle_adjoint(&block.attitude, l.position, c_adjoint);
            for (sum, angle) in gradient[leg].angles.iter_mut().zip(angles) {
                *sum += angle;
            }
            gradient[leg].dwell_s += duration;
        }
    }
}

#[cfg(test)]
mod tests;
