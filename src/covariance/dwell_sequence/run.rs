//! The arithmetic per schedule, straight-line, in one schedule's numbers or in lanes.
//!
//! Of every leg the rows X, the six products of W's gyros and the products of the gravity factors
//! are put on a panel; after a few legs the panel goes into E block by block, each block in
//! registers, and the factorisation at the end goes by the same blocks. Written as one pass over E
//! per leg the same arithmetic takes twice the time, all of it loads and stores of E.

#![allow(
    clippy::needless_range_loop,
    reason = "indices are the formulas' own, and closures would not be compiled with the caller"
)]

use nalgebra::Matrix3;

use crate::attitude::{Attitude, NORTH, UP};
use crate::covariance::two_stage::numbers::{
    Arithmetic, MOST_LANES, Number, Row, Work, four, three,
};
use crate::covariance::two_stage::square::Entries;
use crate::covariance::two_stage::{Wide, square};
use crate::drift::COEFFICIENTS;

/// An upper triangular matrix, row by row.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Triangle([f64; 6]);

impl Triangle {
    fn new(m: &Matrix3<f64>) -> Self {
        let at = |i, j| m[(i, j)];
        Self([at(0, 0), at(0, 1), at(0, 2), at(1, 1), at(1, 2), at(2, 2)])
    }

    /// Row by row `self · v + to`, a column of each.
    #[inline(always)]
    fn times_add<A: Arithmetic>(&self, ar: A, v: &[A::Quad; 3], to: &[A::Quad; 3]) -> [A::Quad; 3] {
        let m = &self.0;
        let first = v[0].times_add(ar.number(m[0]), to[0]);
        let first = v[1].times_add(ar.number(m[1]), first);
        let second = v[1].times_add(ar.number(m[3]), to[1]);
        [
            v[2].times_add(ar.number(m[2]), first),
            v[2].times_add(ar.number(m[4]), second),
            v[2].times_add(ar.number(m[5]), to[2]),
        ]
    }
}

/// What a leg does, see the parent's text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Leg {
    y: Triangle,
    z: [[f64; 3]; 3],
    q: Triangle,
    m: Triangle,
    n: [[f64; 3]; 3],
}

impl Leg {
    /// From Y, Z, Q, M, N.
    pub fn new(
        y: &Matrix3<f64>,
        z: &Matrix3<f64>,
        q: &Matrix3<f64>,
        m: &Matrix3<f64>,
        n: &Matrix3<f64>,
    ) -> Self {
        let full = |m: &Matrix3<f64>| [0, 1, 2].map(|i| [0, 1, 2].map(|j| m[(i, j)]));
        Self {
            y: Triangle::new(y),
            z: full(z),
            q: Triangle::new(q),
            m: Triangle::new(m),
            n: full(n),
        }
    }
}

/// The North and Up rows of C_c^n, a schedule in each lane.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Places([[f64; MOST_LANES]; 6]);

impl Places {
    /// Before anything is put there.
    pub const NOWHERE: Self = Self([[0.0; MOST_LANES]; 6]);

    /// Puts an attitude into a lane.
    #[inline(always)]
    pub fn put(&mut self, lane: usize, attitude: &Attitude) {
        let m = attitude.matrix();
        for j in 0..3 {
            self.0[j][lane] = m[(NORTH, j)];
            self.0[3 + j][lane] = m[(UP, j)];
        }
    }

    /// C_c^n; East = North × Up.
    #[inline(always)]
    fn load<A: Arithmetic>(&self, ar: A) -> Entries<A::Number> {
        let north = three!(|j| ar.load(&self.0[j]));
        let up = three!(|j| ar.load(&self.0[3 + j]));
        let east = [
            north[1].mul_add(up[2], -(north[2] * up[1])),
            north[2].mul_add(up[0], -(north[0] * up[2])),
            north[0].mul_add(up[1], -(north[1] * up[0])),
        ];
        [north, up, east]
    }
}

/// Column `j` of `m c`.
#[inline(always)]
fn column<A: Arithmetic>(
    ar: A,
    m: &[[f64; 3]; 3],
    c: &Entries<A::Number>,
    j: usize,
) -> [A::Number; 3] {
    three!(|i| {
        let sum = ar.number(m[i][0]) * c[0][j];
        let sum = ar.number(m[i][1]).mul_add(c[1][j], sum);
        ar.number(m[i][2]).mul_add(c[2][j], sum)
    })
}

/// Four rows of four.
type Block<Q> = [Q; 4];

/// The upper triangle of h hᵀ, h = (1, g_x, g_y, g_z): rows (00, 01, 02, 03), (11, 12, 13, 22),
/// and 23, 33.
#[derive(Debug, Clone, Copy)]
struct Gravity<A: Arithmetic> {
    quads: [A::Quad; 2],
    rest: [A::Number; 2],
}

impl<A: Arithmetic> Gravity<A> {
    #[inline(always)]
    fn zeros(ar: A) -> Self {
        let zero = ar.number(0.0);
        Self {
            quads: [ar.quad([zero; 4]); 2],
            rest: [zero; 2],
        }
    }

    #[inline(always)]
    fn of(ar: A, h: A::Quad) -> Self {
        let (x, y, z) = (h.get(1), h.get(2), h.get(3));
        Self {
            quads: [h, ar.quad([x * x, x * y, x * z, y * y])],
            rest: [y * z, z * z],
        }
    }

    #[inline(always)]
    fn times_add(&self, n: A::Number, to: &Self) -> Self {
        Self {
            quads: [
                self.quads[0].times_add(n, to.quads[0]),
                self.quads[1].times_add(n, to.quads[1]),
            ],
            rest: [
                self.rest[0].mul_add(n, to.rest[0]),
                self.rest[1].mul_add(n, to.rest[1]),
            ],
        }
    }

    /// All of it.
    #[inline(always)]
    fn block(&self, ar: A) -> Block<A::Quad> {
        let ([a, b], [yz, zz]) = (self.quads, self.rest);
        [
            a,
            ar.quad([a.get(1), b.get(0), b.get(1), b.get(2)]),
            ar.quad([a.get(2), b.get(1), b.get(3), yz]),
            ar.quad([a.get(3), b.get(2), yz, zz]),
        ]
    }
}

/// The blocks (j, k), j ≤ k, of a symmetric matrix over the gyros.
const BLOCKS: usize = 6;

/// What a leg puts on the panel.
#[derive(Debug, Clone, Copy)]
struct OnPanel<A: Arithmetic> {
    x: Wide<A::Quad>,
    /// The products of the columns of Q C, by blocks.
    n: [A::Number; BLOCKS],
    hh: Gravity<A>,
}

/// Legs on the panel: with the blocks no more than a level-one cache holds.
const PANEL: usize = 8;

/// The chain on its way through one schedule, or one per lane.
pub(super) struct Run<A: Arithmetic> {
    ar: A,
    v: Wide<A::Quad>,
    panel: [OnPanel<A>; PANEL],
    on_panel: usize,
    /// Σ XᵀX so far.
    e: [Block<A::Quad>; BLOCKS],
    /// Σ n hhᵀ so far.
    n_hh: [Gravity<A>; BLOCKS],
    /// Whether nothing has been collected so far, and no leg been run.
    fresh: bool,
    first: bool,
}

impl<A: Arithmetic> Run<A> {
    #[inline(always)]
    pub fn new(ar: A) -> Self {
        let zero = ar.number(0.0);
        let none = ar.quad([zero; 4]);
        let nothing = OnPanel {
            x: [[none; 3]; 3],
            n: [zero; BLOCKS],
            hh: Gravity::zeros(ar),
        };
        Self {
            ar,
            v: [[none; 3]; 3],
            panel: [nothing; PANEL],
            on_panel: 0,
            e: [[none; 4]; BLOCKS],
            n_hh: [Gravity::zeros(ar); BLOCKS],
            fresh: true,
            first: true,
        }
    }

    /// Begins with other schedules. V and E are not cleared: their first use overwrites them.
    #[inline(always)]
    pub fn start(&mut self) {
        self.on_panel = 0;
        self.fresh = true;
        self.first = true;
    }

    /// A leg; after the last one V is of no use.
    #[inline(always)]
    pub fn leg(&mut self, leg: &Leg, places: &Places, last: bool) {
        let ar = self.ar;
        ar.apart(OneLeg {
            run: self,
            leg,
            places,
            last,
        });
        self.on_panel += 1;
        self.first = false;
        if self.on_panel == PANEL || last {
            ar.apart(Collect(self));
            self.on_panel = 0;
            self.fresh = false;
        }
    }

    /// tr(W P_D) and the smallest pivot.
    #[inline(always)]
    pub fn weighted_trace(
        &self,
        prior_information: &[f64; COEFFICIENTS],
        weights: &[f64; COEFFICIENTS],
    ) -> (A::Number, A::Number) {
        self.ar.apart(Trace {
            run: self,
            prior_information,
            weights,
        })
    }
}

/// A leg onto the panel.
struct OneLeg<'a, A: Arithmetic> {
    run: &'a mut Run<A>,
    leg: &'a Leg,
    places: &'a Places,
    last: bool,
}

impl<A: Arithmetic> Work for OneLeg<'_, A> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self {
            run, leg, places, ..
        } = self;
        let ar = run.ar;
        let c = places.load(ar);
        let h = ar.quad([ar.number(1.0), -c[UP][0], -c[UP][1], -c[UP][2]]);
        let Some(on) = run.panel.get_mut(run.on_panel) else {
            return;
        };
        on.n = products_of_columns(ar, &leg.q, &c);
        on.hh = Gravity::of(ar, h);
        // Gyro by gyro: all of them at once would not stay in registers.
        three!(|j| {
            let z = column(ar, &leg.z, &c, j);
            let n = column(ar, &leg.n, &c, j);
            let (mut x, mut v) = (three!(|i| h.times(z[i])), three!(|i| h.times(n[i])));
            if !run.first {
                let before = [run.v[0][j], run.v[1][j], run.v[2][j]];
                x = leg.y.times_add(ar, &before, &x);
                if !self.last {
                    v = leg.m.times_add(ar, &before, &v);
                }
            }
            three!(|i| on.x[i][j] = x[i]);
            three!(|i| run.v[i][j] = v[i]);
        });
    }
}

/// (Q C)ᵀ Q C by blocks.
#[inline(always)]
fn products_of_columns<A: Arithmetic>(
    ar: A,
    q: &Triangle,
    c: &Entries<A::Number>,
) -> [A::Number; BLOCKS] {
    let q = &q.0;
    let number = [
        ar.number(q[0]),
        ar.number(q[1]),
        ar.number(q[2]),
        ar.number(q[3]),
        ar.number(q[4]),
        ar.number(q[5]),
    ];
    // Row j: column j of Q C.
    let w = three!(|j| [
        number[2].mul_add(c[2][j], number[1].mul_add(c[1][j], number[0] * c[0][j])),
        number[4].mul_add(c[2][j], number[3] * c[1][j]),
        number[5] * c[2][j],
    ]);
    [
        square::dot(&w[0], &w[0]),
        square::dot(&w[0], &w[1]),
        square::dot(&w[0], &w[2]),
        square::dot(&w[1], &w[1]),
        square::dot(&w[1], &w[2]),
        square::dot(&w[2], &w[2]),
    ]
}

/// The panel into E.
struct Collect<'a, A: Arithmetic>(&'a mut Run<A>);

impl<A: Arithmetic> Work for Collect<'_, A> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let run = self.0;
        collect::<A, 0, 0, 0>(run);
        collect::<A, 0, 1, 1>(run);
        collect::<A, 0, 2, 2>(run);
        collect::<A, 1, 1, 3>(run);
        collect::<A, 1, 2, 4>(run);
        collect::<A, 2, 2, 5>(run);
    }
}

/// Block `B`, of gyros `J` and `K`; where registers are few, half of it at a time.
#[inline(always)]
fn collect<A: Arithmetic, const J: usize, const K: usize, const B: usize>(run: &mut Run<A>) {
    if A::MANY_REGISTERS {
        collect_rows::<A, J, K, B, 0, 4>(run);
    } else {
        collect_rows::<A, J, K, B, 0, 2>(run);
        collect_rows::<A, J, K, B, 2, 4>(run);
    }
    let mut n_hh = run.n_hh[B];
    if run.fresh {
        n_hh = Gravity::zeros(run.ar);
    }
    for leg in run.panel.get(..run.on_panel).unwrap_or(&[]) {
        n_hh = leg.hh.times_add(leg.n[B], &n_hh);
    }
    run.n_hh[B] = n_hh;
}

/// Rows `FIRST..END` of Σ XᵀX.
#[inline(always)]
fn collect_rows<
    A: Arithmetic,
    const J: usize,
    const K: usize,
    const B: usize,
    const FIRST: usize,
    const END: usize,
>(
    run: &mut Run<A>,
) {
    let mut e = run.e[B];
    if run.fresh {
        e = [run.ar.quad([run.ar.number(0.0); 4]); 4];
    }
    for leg in run.panel.get(..run.on_panel).unwrap_or(&[]) {
        three!(|r| four!(|a| if a >= FIRST && a < END {
            let first = if J == K { a } else { 0 };
            e[a] = leg.x[r][K].times_add_from(leg.x[r][J].get(a), e[a], first);
        }));
    }
    four!(|a| if a >= FIRST && a < END {
        run.e[B][a] = e[a];
    });
}

/// tr(W P_D) with P_D = (E + prior information)⁻¹ = Σ_k d_k w_kᵀ w_k, w_k the rows of L⁻¹.
struct Trace<'a, A: Arithmetic> {
    run: &'a Run<A>,
    prior_information: &'a [f64; COEFFICIENTS],
    weights: &'a [f64; COEFFICIENTS],
}

impl<A: Arithmetic> Trace<'_, A> {
    /// Block `B` of E, without the prior; of a diagonal block the upper triangle.
    #[inline(always)]
    fn block<const B: usize>(&self, diagonal: bool) -> Block<A::Quad> {
        let ar = self.run.ar;
        let n_hh = self.run.n_hh[B].block(ar);
        let one = ar.number(1.0);
        four!(|a| {
            let first = if diagonal { a } else { 0 };
            n_hh[a].times_add_from(one, self.run.e[B][a], first)
        })
    }
}

/// The pivots of a diagonal block.
#[derive(Clone, Copy)]
struct Pivots<N> {
    /// Their inverses.
    d: [N; 4],
    /// −L below the diagonal.
    f: [[N; 4]; 4],
    least: N,
}

/// Eliminates a diagonal block, with the blocks to its right.
#[inline(always)]
fn eliminate<A: Arithmetic, const RIGHT: usize>(
    ar: A,
    s: &mut Block<A::Quad>,
    right: [&mut Block<A::Quad>; RIGHT],
    prior: [f64; 4],
) -> Pivots<A::Number> {
    let one = ar.number(1.0);
    let mut d = [one; 4];
    let mut f = [[ar.number(0.0); 4]; 4];
    let mut least = one.constant(f64::MAX);
    four!(|e| {
        let pivot = s[e].get(e) + ar.number(prior[e]);
        least = pivot.where_greater(least, pivot, least);
        d[e] = one / pivot;
        four!(|a| if a > e {
            f[a][e] = -(s[e].get(a) * d[e]);
            s[a] = s[e].times_add_from(f[a][e], s[a], a);
            for block in 0..RIGHT {
                right[block][a] = right[block][e].times_add(f[a][e], right[block][a]);
            }
        });
    });
    Pivots { d, f, least }
}

/// −D⁻¹ s, row by row.
#[inline(always)]
fn scaled<A: Arithmetic>(s: &Block<A::Quad>, pivots: &Pivots<A::Number>) -> Block<A::Quad> {
    four!(|e| s[e].times(-pivots.d[e]))
}

/// `to + lᵀ u`; of a diagonal block the upper triangle.
#[inline(always)]
fn product_add<Q: Row>(l: &Block<Q>, u: &Block<Q>, to: &mut Block<Q>, diagonal: bool) {
    let mut sum = *to;
    four!(|r| four!(|a| {
        let first = if diagonal { a } else { 0 };
        sum[a] = u[r].times_add_from(l[r].get(a), sum[a], first);
    }));
    *to = sum;
}

/// L⁻¹ of a diagonal block.
#[inline(always)]
fn unit_inverse<A: Arithmetic>(ar: A, pivots: &Pivots<A::Number>) -> Block<A::Quad> {
    let (one, zero, f) = (ar.number(1.0), ar.number(0.0), &pivots.f);
    let w20 = f[2][1].mul_add(f[1][0], f[2][0]);
    let w30 = f[3][2].mul_add(w20, f[3][1].mul_add(f[1][0], f[3][0]));
    let w31 = f[3][2].mul_add(f[2][1], f[3][1]);
    [
        ar.quad([one, zero, zero, zero]),
        ar.quad([f[1][0], one, zero, zero]),
        ar.quad([w20, f[2][1], one, zero]),
        ar.quad([w30, w31, f[3][2], one]),
    ]
}

/// `lᵀ w` for the w of [`unit_inverse`].
#[inline(always)]
fn times_unit<A: Arithmetic>(ar: A, l: &Block<A::Quad>, w: &Block<A::Quad>) -> Block<A::Quad> {
    four!(|a| {
        let (l0, l1, l2, l3) = (l[0].get(a), l[1].get(a), l[2].get(a), l[3].get(a));
        let first = l3.mul_add(
            w[3].get(0),
            l2.mul_add(w[2].get(0), l1.mul_add(w[1].get(0), l0)),
        );
        let second = l3.mul_add(w[3].get(1), l2.mul_add(w[2].get(1), l1));
        ar.quad([first, second, l3.mul_add(w[3].get(2), l2), l3])
    })
}

/// Forward substitution within the rows of a diagonal block.
#[inline(always)]
fn substitute<A: Arithmetic>(w: &mut Block<A::Quad>, pivots: &Pivots<A::Number>) {
    four!(|e| four!(|a| if a > e {
        w[a] = w[e].times_add(pivots.f[a][e], w[a]);
    }));
}

/// `to + Σ_e d_e w_e²`.
#[inline(always)]
fn squares_add<A: Arithmetic>(w: &Block<A::Quad>, p: &Pivots<A::Number>, to: A::Quad) -> A::Quad {
    let to = w[0].by(w[0]).times_add(p.d[0], to);
    let to = w[1].by(w[1]).times_add(p.d[1], to);
    let to = w[2].by(w[2]).times_add(p.d[2], to);
    w[3].by(w[3]).times_add(p.d[3], to)
}

impl<A: Arithmetic> Work for Trace<'_, A> {
    type Output = (A::Number, A::Number);
    #[inline(always)]
    fn run(self) -> Self::Output {
        let ar = self.run.ar;
        let prior = |j: usize| four!(|e| self.prior_information[4 * j + e]);
        let zero = ar.quad([ar.number(0.0); 4]);
        let (mut s00, mut s01, mut s02) = (
            self.block::<0>(true),
            self.block::<1>(false),
            self.block::<2>(false),
        );
        let (mut s11, mut s12, mut s22) = (
            self.block::<3>(true),
            self.block::<4>(false),
            self.block::<5>(true),
        );
        // Pivots wait for one another; the rows of L⁻¹ that are not needed for the next pivot
        // come after it, to be worked on in the meantime.
        let p0 = eliminate(ar, &mut s00, [&mut s01, &mut s02], prior(0));
        let (l01, l02) = (scaled::<A>(&s01, &p0), scaled::<A>(&s02, &p0));
        product_add(&l01, &s01, &mut s11, true);
        product_add(&l01, &s02, &mut s12, false);
        product_add(&l02, &s02, &mut s22, true);
        let p1 = eliminate(ar, &mut s11, [&mut s12], prior(1));
        let w00 = unit_inverse(ar, &p0);
        let (mut w01, mut w02) = (times_unit(ar, &l01, &w00), times_unit(ar, &l02, &w00));
        let sum0 = squares_add::<A>(&w00, &p0, zero);
        let l12 = scaled::<A>(&s12, &p1);
        product_add(&l12, &s12, &mut s22, true);
        let p2 = eliminate(ar, &mut s22, [], prior(2));
        let w11 = unit_inverse(ar, &p1);
        let mut w12 = times_unit(ar, &l12, &w11);
        let sum1 = squares_add::<A>(&w11, &p1, zero);
        substitute::<A>(&mut w01, &p1);
        product_add(&l12, &w01, &mut w02, false);
        let sum0 = squares_add::<A>(&w01, &p1, sum0);
        substitute::<A>(&mut w02, &p2);
        substitute::<A>(&mut w12, &p2);
        let sum0 = squares_add::<A>(&w02, &p2, sum0);
        let sum1 = squares_add::<A>(&w12, &p2, sum1);
        let sum2 = squares_add::<A>(&unit_inverse(ar, &p2), &p2, zero);
        let weights = three!(|j| ar.quad(four!(|e| ar.number(self.weights[4 * j + e]))));
        let trace = sum0
            .by(weights[0])
            .plus(sum1.by(weights[1]))
            .plus(sum2.by(weights[2]));
        let least = p0.least.where_greater(p1.least, p0.least, p1.least);
        let least = least.where_greater(p2.least, least, p2.least);
        (trace.total(), least)
    }
}
