//! Reverse mode of the [`fast`](super) steps.
//!
//! E is only ever added to, so its adjoint Ē is the same through the whole chain. With V̄, P̄ the
//! adjoints after a dwell (P̄, Ē symmetric), and X, Y, Z, M, N those of the dwell, the adjoints
//! before it are
//!
//! ```text
//! X̄ = 2 X Ē,    V̄ ← Mᵀ V̄ + Yᵀ X̄,    Ā = Nᵀ V̄ + Zᵀ X̄ + 2 R22ᵀ R22 A Ē,
//! P̄ ← Mᵀ P̄ M − sym(Mᵀ V̄ Xᵀ Y) − Yᵀ X Ē Xᵀ Y
//! ```
//!
//! (from S^{-½} R11 = R11-part of Y, I − P₊J = (I + PJ)⁻¹ and R11 (I − P₊J) = S⁻¹ R11). A is
//! never formed: C̄ = Σ_e h_e Ā_e and h̄_e = ⟨C, Ā_e⟩ are, through the same 3×3 matrices. A
//! measurement is a dwell with two rows of weight w/D, so that nothing is singular at w = 0.

use super::arithmetic::{Arithmetic, Number, Row, four, three};
use super::earth::{Earth, Passed};
use super::information::Rows;
use super::moves::pull_to_angles;
use super::shape::{self, Array, Drift, FEATURES, Shape, every, quads};
use super::square::{
    Entries, Square, combine, difference, dot, entries, product, rows, sum, transpose,
    transposed_product,
};
use super::{
    AzimuthStep, DwellStep, MeasureStep, Place, Wide, entries_of, inner, row_dot, tilt_transposed,
    turn,
};
use crate::attitude::{EAST, NORTH, UP};

/// Adjoints of a place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlaceAdjoint<A: Arithmetic, S: Shape = Drift> {
    /// C̄, but for what goes through the features.
    pub c: Square<A::Triple>,
    /// h̄, block by block.
    pub h: S::Blocks<A::Quad>,
}

impl<A: Arithmetic, S: Shape> PlaceAdjoint<A, S> {
    /// Nothing depends on it.
    #[inline(always)]
    pub fn nothing(ar: A) -> Self {
        let zero = ar.number(0.0);
        Self {
            c: [ar.triple([zero; 3]); 3],
            h: Array::filled(ar.quad([zero; 4])),
        }
    }

    /// Adjoints of C and of the body's rate in n, all together.
    #[inline(always)]
    pub fn pull(
        &self,
        c: &Entries<A::Number>,
        rate: &[A::Number; 3],
    ) -> (Entries<A::Number>, [A::Number; 3]) {
        let mut c_adjoint = entries(&self.c);
        let zero = c[0][0].constant(0.0);
        if S::DRIFT_ONLY {
            // g = −(Up row of C)ᵀ.
            for e in 0..3 {
                c_adjoint[UP][e] = c_adjoint[UP][e] - self.h[0].get(1 + e);
            }
            return (c_adjoint, [zero; 3]);
        }
        let mut of = [zero; FEATURES];
        for b in 0..S::FEATURES.len() {
            for e in 0..4 {
                let feature = S::FEATURES[b][e] as usize;
                of[feature] = of[feature] + self.h[b].get(e);
            }
        }
        let rate = shape::basis_adjoint::<_, S>(c, rate, &of, &mut c_adjoint);
        (c_adjoint, rate)
    }

    /// C̄ += `by`.
    #[inline(always)]
    pub fn add(&mut self, by: &Square<A::Triple>) {
        self.c = sum(&self.c, by);
    }

    /// Adds to the Up row of C̄.
    #[inline(always)]
    pub fn add_to_up(&mut self, ar: A, row: &[A::Number; 3]) {
        self.c[UP] = self.c[UP].plus(ar.triple(*row));
    }

    /// Of ⟨V̄, `by` U⟩, U the shift by the accelerometers at `at`.
    #[inline(always)]
    pub fn add_shift(&mut self, ar: A, at: &Place<A, S>, v: &Wide<A::Quad, S>, by: A::Number) {
        let mut c = entries(&self.c);
        for q in S::GYRO_QUADS..S::QUADS {
            let of = &S::LAYOUT[q];
            let (x, z) = (v[NORTH][q].times(by), v[EAST][q].times(by));
            let h = at.h[of.block];
            c[EAST][of.axis] = c[EAST][of.axis] - x.dot(h);
            c[NORTH][of.axis] = c[NORTH][of.axis] + z.dot(h);
            let sum = x.times_add(-at.c[EAST][of.axis], self.h[of.block]);
            self.h[of.block] = z.times_add(at.c[NORTH][of.axis], sum);
        }
        self.c = rows(ar, &c);
    }
}

/// Adjoints of V and P after the step at hand, and of the place where it happens.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sweep<'a, A: Arithmetic, S: Shape = Drift> {
    ar: A,
    earth: &'a Earth<A::Number>,
    /// V̄.
    pub v: Wide<A::Quad, S>,
    /// P̄, symmetric.
    pub p: Entries<A::Number>,
    /// Of the place.
    pub place: PlaceAdjoint<A, S>,
}

/// Ē = ∂f/∂E as the sweep sees it: by what it does to the rows that the chain has told.
pub(crate) trait InformationAdjoint<A: Arithmetic, S: Shape> {
    /// `x` Ē, `x` the rows that begin at `row` in the order in which they were told.
    fn times<const N: usize>(
        &self,
        row: usize,
        x: &[S::Quads<A::Quad>; N],
    ) -> [S::Quads<A::Quad>; N];

    /// Takes the rows (R22 C) ⊗ h of a dwell back, which begin at `row`, and `vertical` times what
    /// the vertical channel has told.
    fn take_back(
        &self,
        sweep: &mut Sweep<'_, A, S>,
        row: usize,
        step: &DwellStep<A, S>,
        at: &Place<A, S>,
        vertical: A::Number,
    );

    /// Takes `weight` times a measurement of the vertical channel, told in `row`, back. Returns the derivative
    /// with respect to the weight.
    fn take_vertical_back(
        &self,
        ar: A,
        place: &mut PlaceAdjoint<A, S>,
        row: usize,
        at: &Place<A, S>,
        weight: A::Number,
    ) -> A::Number;
}

/// Ē itself.
impl<A: Arithmetic> InformationAdjoint<A, Drift> for Rows<A::Quad> {
    #[inline(always)]
    fn times<const N: usize>(&self, _: usize, x: &[[A::Quad; 3]; N]) -> [[A::Quad; 3]; N] {
        let mut out = *x;
        for row in &mut out {
            *row = times_information(row, self);
        }
        out
    }

    #[inline(always)]
    fn take_back(
        &self,
        sweep: &mut Sweep<'_, A>,
        _: usize,
        step: &DwellStep<A>,
        at: &Place<A>,
        _: A::Number,
    ) {
        sweep.second_information(step, at.h[0], self, sweep.ar.number(2.0));
    }

    #[inline(always)]
    fn take_vertical_back(
        &self,
        _: A,
        _: &mut PlaceAdjoint<A>,
        _: usize,
        _: &Place<A>,
        weight: A::Number,
    ) -> A::Number {
        weight.constant(0.0)
    }
}

/// What Ē does to every row, worked out beforehand: where priors are weak, Ē is so large and what
/// it does to a row so little that their product would have no digits.
#[derive(Debug, Clone)]
pub(crate) struct ByRows<A: Arithmetic>(pub Vec<[A::Quad; 3]>);

impl<A: Arithmetic> InformationAdjoint<A, Drift> for ByRows<A> {
    #[inline(always)]
    fn times<const N: usize>(&self, row: usize, _: &[[A::Quad; 3]; N]) -> [[A::Quad; 3]; N] {
        std::array::from_fn(|i| self.0[row + i])
    }

    #[inline(always)]
    fn take_back(
        &self,
        sweep: &mut Sweep<'_, A>,
        row: usize,
        step: &DwellStep<A>,
        at: &Place<A>,
        _: A::Number,
    ) {
        let twice = three!(|i| three!(|j| self.0[row + i][j].plus(self.0[row + i][j])));
        sweep.add_c(&entries(&step.gain.r22), &along::<_, Drift>(&twice, &at.h));
        sweep.add_h(&entries_of::<A, Drift>(&step.q_c), &twice);
    }

    #[inline(always)]
    fn take_vertical_back(
        &self,
        _: A,
        _: &mut PlaceAdjoint<A>,
        _: usize,
        _: &Place<A>,
        weight: A::Number,
    ) -> A::Number {
        weight.constant(0.0)
    }
}

/// Rows that a measurement tells, but for its vertical channel.
pub(crate) const MEASURED_ROWS: usize = 2;

/// Rows that a dwell tells: with accelerometers one of the vertical channel too.
pub(crate) const fn dwell_rows<S: Shape>() -> usize {
    if S::GROUPS > 1 { 7 } else { 6 }
}

/// Row `x` times the symmetric matrix Ē.
#[inline(always)]
fn times_information<Q: Row>(x: &[Q; 3], e: &Rows<Q>) -> [Q; 3] {
    let mut out = three!(|k| e[0][k].times(x[0].get(0)));
    three!(|j| four!(|f| if (j, f) != (0, 0) {
        let factor = x[j].get(f);
        out = three!(|k| e[4 * j + f][k].times_add(factor, out[k]));
    }));
    out
}

/// Σ_e h_e w_e, instrument by instrument.
#[inline(always)]
pub(crate) fn along<Q: Row, S: Shape>(
    w: &Wide<Q, S>,
    h: &S::Blocks<Q>,
) -> S::Groups<Entries<Q::Number>> {
    let first = three!(|i| three!(|j| w[i][j].dot(h[0])));
    let mut out = S::Groups::filled(first);
    if S::DRIFT_ONLY {
        return out;
    }
    for group in 1..S::GROUPS {
        out[group] = [[first[0][0].constant(0.0); 3]; 3];
    }
    for q in 3..S::QUADS {
        let of = &S::LAYOUT[q];
        for i in 0..3 {
            let to = &mut out[of.group][i][of.axis];
            *to = *to + w[i][q].dot(h[of.block]);
        }
    }
    out
}

#[inline(always)]
fn symmetric<N: Number>(m: &Entries<N>) -> Entries<N> {
    let half = m[0][0].constant(0.5);
    let mean = three!(|i| three!(|j| (m[i][j] + m[j][i]) * half));
    super::square::mirrored(&mean)
}

impl<A: Arithmetic> Sweep<'_, A> {
    /// The adjoints of ⟨Ē, (CᵀR22ᵀR22 C) ⊗ hᵀh⟩.
    #[inline(always)]
    fn second_information(
        &mut self,
        step: &DwellStep<A>,
        h: A::Quad,
        information: &Rows<A::Quad>,
        two: A::Number,
    ) {
        let q_c = entries(&step.q_c[0]);
        let n = entries(&transposed_product(&q_c, &step.q_c[0]));
        let mut f = [[two; 3]; 3];
        three!(|j| three!(|k| {
            let u = information[4 * j][k].times(h.get(0));
            let u = information[4 * j + 1][k].times_add(h.get(1), u);
            let u = information[4 * j + 2][k].times_add(h.get(2), u);
            let u = information[4 * j + 3][k].times_add(h.get(3), u);
            f[j][k] = u.dot(h) * two;
            self.place.h[0] = u.times_add(n[j][k] * two, self.place.h[0]);
        }));
        let q_f = product(&q_c, &rows(self.ar, &f));
        self.add_c(&entries(&step.gain.r22), &[entries(&q_f)]);
    }
}

impl<'a, A: Arithmetic, S: Shape> Sweep<'a, A, S> {
    /// At the end of the schedule nothing depends on V and P but through E.
    #[inline(always)]
    pub fn new(ar: A, earth: &'a Earth<A::Number>) -> Self {
        let zero = ar.number(0.0);
        let nothing = every::<S, _>(ar.quad([zero; 4]));
        Self {
            ar,
            earth,
            v: [nothing; 3],
            p: [[zero; 3]; 3],
            place: PlaceAdjoint::nothing(ar),
        }
    }

    /// What it computes with.
    #[inline(always)]
    pub fn arithmetic(&self) -> A {
        self.ar
    }

    /// h̄ += Σ turned_ij w_ij.
    #[inline(always)]
    pub fn add_h(&mut self, turned: &S::Groups<Entries<A::Number>>, w: &Wide<A::Quad, S>) {
        for i in 0..3 {
            for q in 0..S::QUADS {
                let of = &S::LAYOUT[q];
                let factor = turned[of.group][i][of.axis];
                let sum = &mut self.place.h[of.block];
                *sum = w[i][q].times_add(factor, *sum);
            }
        }
    }

    /// C̄ += lᵀ w.
    #[inline(always)]
    pub fn add_c(&mut self, l: &Entries<A::Number>, w: &S::Groups<Entries<A::Number>>) {
        let pulled = transposed_product(l, &rows(self.ar, &w[0]));
        self.place.add(&pulled);
        if S::GROUPS > 1 {
            let pulled = entries(&transposed_product(l, &rows(self.ar, &w[1])));
            let pulled = tilt_transposed(self.earth, &pulled);
            self.place.add(&rows(self.ar, &pulled));
        }
    }

    /// Takes a dwell back, with the information of the vertical channel.
    #[inline(always)]
    pub fn dwell(
        &mut self,
        step: &DwellStep<A, S>,
        at: &Place<A, S>,
        vertical: A::Number,
        (information, row): (&impl InformationAdjoint<A, S>, usize),
    ) {
        let xe = information.times(row, &step.x);
        let twice: Wide<A::Quad, S> = three!(|i| quads!(S, |q| xe[i][q].plus(xe[i][q])));

        let (z, n) = (entries(&step.gain.z), entries(&step.gain.n));
        self.add_c(&n, &along::<_, S>(&self.v, &at.h));
        self.add_c(&z, &along::<_, S>(&twice, &at.h));
        self.add_h(&step.n_c, &self.v.clone());
        self.add_h(&step.z_c, &twice);
        information.take_back(self, row + 3, step, at, vertical);

        let (y, m) = (entries(&step.gain.y), entries(&step.gain.m));
        let d1 = three!(|i| three!(|r| inner::<_, S>(&self.v, &step.x, i, r)));
        let d2 = three!(|i| three!(|r| inner::<_, S>(&xe, &step.x, i, r)));
        let through_p = product(&self.p, &step.gain.m);
        let through_v = product(&d1, &step.gain.y);
        let first = transposed_product(&m, &difference(&through_p, &through_v));
        let second = transposed_product(&y, &product(&d2, &step.gain.y));
        self.p = symmetric(&entries(&difference(&first, &second)));

        let kept = turn::<_, S>(&transpose(&m), &self.v);
        let seen = turn::<_, S>(&transpose(&y), &twice);
        self.v = three!(|i| quads!(S, |q| kept[i][q].plus(seen[i][q])));
    }

    /// Takes time at a place back; `gamma_c` = Γ C.
    #[inline(always)]
    pub fn pass_at(
        &mut self,
        passed: &Passed<A>,
        gamma_c: &S::Groups<Entries<A::Number>>,
        at: &Place<A, S>,
    ) {
        self.add_c(&passed.gamma, &along::<_, S>(&self.v, &at.h));
        self.add_h(gamma_c, &self.v.clone());
        self.pass(passed);
    }

    /// Takes time without a measurement back, but for its drift.
    #[inline(always)]
    pub fn pass(&mut self, passed: &Passed<A>) {
        let phi = &passed.phi;
        self.v = turn::<_, S>(&transpose(phi), &self.v);
        let half = product(&self.p, &rows(self.ar, phi));
        self.p = symmetric(&entries(&transposed_product(phi, &half)));
    }

    /// The derivative with respect to the length of a time without a measurement, at its end:
    /// d/dt (V, P) = (F V + A, F P + P Fᵀ + q I). `v`, `p` are the state at its end.
    #[inline(always)]
    pub fn length_adjoint(
        &self,
        earth: &Earth<A::Number>,
        v: &Wide<A::Quad, S>,
        p: &Entries<A::Number>,
        at: &Place<A, S>,
    ) -> A::Number {
        let [f02, f12] = earth.system();
        let two = self.ar.number(2.0);
        let of_v = three!(|i| inner::<_, S>(&self.v, v, i, 2) - inner::<_, S>(&self.v, v, 2, i));
        let of_p = three!(|i| (dot(&self.p[i], &p[2]) - dot(&self.p[2], &p[i])) * two);
        let along = along::<_, S>(&self.v, &at.h);
        let of_gyros = &along[0];
        let mut drift = (dot(&at.c[0], &of_gyros[0]) + dot(&at.c[1], &of_gyros[1]))
            + dot(&at.c[2], &of_gyros[2]);
        if S::GROUPS > 1 {
            let (rows, along) = (entries(&at.rows[1]), &along[1]);
            for i in 0..3 {
                drift = drift + dot(&rows[i], &along[i]);
            }
        }
        let process = (self.p[0][0] + self.p[1][1] + self.p[2][2]) * earth.drift_psd();
        f02.mul_add(
            of_v[0] + of_p[0],
            f12.mul_add(of_v[1] + of_p[1], drift + process),
        )
    }

    /// Takes a measurement back; `v` is V after it. Returns the derivative with
    /// respect to its weight: with T = H V, M = (I + w H P Hᵀ)⁻¹,
    /// dE/dw = (M T)ᵀ(M T), dP₊/dw = −P₊HᵀH P₊ and dV₊/dw = −P₊HᵀH V₊.
    #[inline(always)]
    pub fn measure(
        &mut self,
        step: &MeasureStep<A, S>,
        v: &Wide<A::Quad, S>,
        (information, row): (&impl InformationAdjoint<A, S>, usize),
    ) -> A::Number {
        let ar = self.ar;
        let two = ar.number(2.0);
        let (l, [d0, d1]) = (step.seen.l, step.seen.d);
        let (w, p) = (step.seen.weight, &step.seen.p);
        let (w0, w1) = (w * d0, w * d1);
        let xe = information.times(row, &step.rows);
        let t00 = row_dot::<_, S>(&xe[0], &step.rows[0]);
        let t01 = row_dot::<_, S>(&xe[0], &step.rows[1]);
        let t11 = row_dot::<_, S>(&xe[1], &step.rows[1]);

        // tr(M T Ē Tᵀ M) from the rows L⁻¹ T.
        let ld1 = l * d1;
        let through_e = (d0 * d0).mul_add(t00, (d1 * d1 + ld1 * ld1) * t11) - two * ld1 * d0 * t01;
        let weight_adjoint = through_e - self.seen(NORTH, v, p) - self.seen(EAST, v, p);

        // M = I − w P₊ HᵀH; the rows of Y are e_x and e_z − l e_x.
        let (zero, one) = (ar.number(0.0), ar.number(1.0));
        let m = [
            [one - w * p[0][0], zero, -(w * p[0][2])],
            [-(w * p[1][0]), one, -(w * p[1][2])],
            [-(w * p[2][0]), zero, one - w * p[2][2]],
        ];
        // V̄ Xᵀ Y with weights, columns x and z.
        let pull = three!(|i| {
            let a0 = row_dot::<_, S>(&self.v[i], &step.rows[0]) * w0;
            let a1 = row_dot::<_, S>(&self.v[i], &step.rows[1]) * w1;
            [a0 - l * a1, zero, a1]
        });
        let through_p = entries(&product(&self.p, &rows(ar, &m)));
        let inside = three!(|i| three!(|j| through_p[i][j] - pull[i][j]));
        let mut back = entries(&transposed_product(&m, &rows(ar, &inside)));
        let (e00, e01, e11) = (t00 * w0 * w0, t01 * w0 * w1, t11 * w1 * w1);
        back[0][0] = back[0][0] - (e00 - two * l * e01 + l * l * e11);
        back[2][0] = back[2][0] - (e01 - l * e11);
        back[0][2] = back[0][2] - (e01 - l * e11);
        back[2][2] = back[2][2] - e11;
        self.p = symmetric(&back);

        let v_bar = self.v;
        let (twice0, twice1) = (w0 * two, w1 * two);
        for j in 0..S::QUADS {
            let column = [v_bar[0][j], v_bar[1][j], v_bar[2][j]];
            let (x0, x1) = (xe[0][j].times(twice0), xe[1][j].times(twice1));
            let kept_x = combine(&[m[0][0], m[1][0], m[2][0]], &column);
            let kept_z = combine(&[m[0][2], m[1][2], m[2][2]], &column);
            self.v[0][j] = x1.times_add(-l, kept_x.plus(x0));
            self.v[2][j] = kept_z.plus(x1);
        }
        weight_adjoint
    }

    /// Takes a measurement of the azimuth back, as [`Sweep::measure`].
    #[inline(always)]
    pub fn azimuth(
        &mut self,
        step: &AzimuthStep<A, S>,
        v: &Wide<A::Quad, S>,
        (information, row): (&impl InformationAdjoint<A, S>, usize),
    ) -> A::Number {
        let ar = self.ar;
        let (zero, one, two) = (ar.number(0.0), ar.number(1.0), ar.number(2.0));
        let (w, d, p) = (step.azimuth.weight, step.azimuth.d, &step.azimuth.p);
        let wd = w * d;
        let [xe] = information.times(row, &[step.row]);
        let told = row_dot::<_, S>(&xe, &step.row);
        let weight_adjoint = d * d * told - self.seen(UP, v, p);

        // M = I − w P₊ HᵀH.
        let m = [
            [one, -(w * p[NORTH][UP]), zero],
            [zero, one - w * p[UP][UP], zero],
            [zero, -(w * p[EAST][UP]), one],
        ];
        let pull = three!(|i| row_dot::<_, S>(&self.v[i], &step.row) * wd);
        let mut inside = entries(&product(&self.p, &rows(ar, &m)));
        for i in 0..3 {
            inside[i][UP] = inside[i][UP] - pull[i];
        }
        let mut back = entries(&transposed_product(&m, &rows(ar, &inside)));
        back[UP][UP] = back[UP][UP] - told * wd * wd;
        self.p = symmetric(&back);

        let v_bar = self.v;
        for j in 0..S::QUADS {
            let column = [v_bar[0][j], v_bar[1][j], v_bar[2][j]];
            let kept = combine(&[m[0][UP], m[1][UP], m[2][UP]], &column);
            self.v[UP][j] = xe[j].times_add(wd * two, kept);
        }
        weight_adjoint
    }

    /// p · P̄ p + p · V̄ vᵀ with p the column of P and v the row of V of an axis.
    #[inline(always)]
    fn seen(&self, axis: usize, v: &Wide<A::Quad, S>, p: &Entries<A::Number>) -> A::Number {
        let column = [p[0][axis], p[1][axis], p[2][axis]];
        let through_p = three!(|i| dot(&self.p[i], &column));
        let through_v = three!(|i| row_dot::<_, S>(&self.v[i], &v[axis]));
        dot(&column, &through_p) + dot(&column, &through_v)
    }

    /// Takes a change of position in frame-hold repositioning back, q = C C₀ᵀ; `v`, `p` are the
    /// state before it. Returns q̄.
    #[inline(always)]
    pub fn rotate(
        &mut self,
        q: &Entries<A::Number>,
        v: &Wide<A::Quad, S>,
        p: &Entries<A::Number>,
    ) -> Entries<A::Number> {
        let ar = self.ar;
        let two = ar.number(2.0);
        let q_p = entries(&product(q, &rows(ar, &super::square::mirrored(p))));
        let through_p = entries(&product(&self.p, &rows(ar, &q_p)));
        let q_bar =
            three!(|i| three!(|j| through_p[i][j].mul_add(two, inner::<_, S>(&self.v, v, i, j))));
        self.v = turn::<_, S>(&transpose(q), &self.v);
        let half = product(&self.p, &rows(ar, q));
        self.p = symmetric(&entries(&transposed_product(q, &half)));
        q_bar
    }

    /// The place's adjoints as angles, ∂f/∂(α, β, γ); the next place starts from nothing.
    #[inline(always)]
    pub fn leave_place(
        &mut self,
        at: &Place<A, S>,
        alpha: (A::Number, A::Number),
    ) -> [A::Number; 3] {
        let rate = match S::DRIFT_ONLY {
            true => [self.ar.number(0.0); 3],
            false => self.earth.vector(),
        };
        let (c, _) = self.place.pull(&at.c, &rate);
        self.place = PlaceAdjoint::nothing(self.ar);
        pull_to_angles(self.earth.stand(), &at.c, alpha, &c)
    }
}
