//! The information on the columns of a wide shape, and its adjoint: tiles of four by four.
//!
//! Columns are worked on in loops here. Written out, as those of [`super::information`] are, fifteen
//! quads would be a function that no instruction cache holds.

use super::adjoint::{InformationAdjoint, PlaceAdjoint, Sweep, along};
use super::arithmetic::{Arithmetic, Number, Row, four, three};
use super::shape::{Array, Catalogue, Instruments, Shape, every};
use super::square::{Entries, Square, dot, entries, transposed_product};
use super::{Collected, Collecting, DwellStep, Place, Wide, entries_of};
use crate::attitude::UP;

/// The triangle of tiles on and above the diagonal, row by row. A tile is four rows; those on the
/// diagonal are kept whole.
#[derive(Debug)]
pub(crate) struct Tiles<A: Arithmetic, S: Shape> {
    tiles: Vec<[A::Quad; 4]>,
    shape: std::marker::PhantomData<S>,
}

/// The products of the columns of R22 C and of the vertical channel, instrument by instrument: what
/// multiplies the features' products.
type Grams<N> = [[Entries<N>; 2]; 2];

/// (R22 C)ᵀ (R22 C) with `vertical` times what the vertical channel tells of the accelerometers.
#[inline(always)]
fn grams<A: Arithmetic, S: Shape>(
    q_c: &S::Groups<Square<A::Triple>>,
    at: &Place<A, S>,
    vertical: A::Number,
) -> Grams<A::Number> {
    let of = entries_of::<A, S>(q_c);
    let mut out = [[entries(&transposed_product(&of[0], &q_c[0])); 2]; 2];
    if S::GROUPS > 1 {
        out[0][1] = entries(&transposed_product(&of[0], &q_c[1]));
        out[1][0] = entries(&transposed_product(&of[1], &q_c[0]));
        out[1][1] = entries(&transposed_product(&of[1], &q_c[1]));
        for i in 0..3 {
            let weighted = vertical * at.c[UP][i];
            for j in 0..3 {
                out[1][1][i][j] = weighted.mul_add(at.c[UP][j], out[1][1][i][j]);
            }
        }
    }
    out
}

/// Where the entry of two columns stands among the numbers of all tiles of a shape of so many quads.
pub(crate) fn entry(quads: usize, a: usize, b: usize) -> usize {
    let (a, b) = if a / 4 <= b / 4 { (a, b) } else { (b, a) };
    let (q, r) = (a / 4, b / 4);
    let tile = q * quads - q * (q + 1) / 2 + r;
    16 * tile + 4 * (a % 4) + b % 4
}

impl<A: Arithmetic, S: Shape> Tiles<A, S> {
    /// The numbers of all tiles, see [`entry`].
    #[inline(always)]
    pub fn numbers(&self) -> Vec<A::Number> {
        let mut all = Vec::with_capacity(16 * self.tiles.len());
        for tile in &self.tiles {
            for e in 0..4 {
                all.extend_from_slice(&four!(|f| tile[e].get(f)));
            }
        }
        all
    }
}

impl Collecting for Instruments {
    type Information<A: Arithmetic> = Tiles<A, Self>;
}

impl Collecting for Catalogue {
    type Information<A: Arithmetic> = Tiles<A, Self>;
}

impl<A: Arithmetic, S: Shape> Collected<A, S> for Tiles<A, S> {
    #[inline(always)]
    fn nothing(ar: A) -> Self {
        let zero = ar.quad([ar.number(0.0); 4]);
        Self {
            tiles: vec![[zero; 4]; S::QUADS * (S::QUADS + 1) / 2],
            shape: std::marker::PhantomData,
        }
    }

    #[inline(always)]
    fn of_dwell(
        &mut self,
        x: &Wide<A::Quad, S>,
        q_c: &S::Groups<Square<A::Triple>>,
        at: &Place<A, S>,
        vertical: A::Number,
    ) {
        let n = grams::<A, S>(q_c, at, vertical);
        let mut tiles = self.tiles.iter_mut();
        for q in 0..S::QUADS {
            let of = &S::LAYOUT[q];
            let (left, h) = ([x[0][q], x[1][q], x[2][q]], at.h[of.block]);
            for (r, tile) in (q..S::QUADS).zip(tiles.by_ref()) {
                let with = &S::LAYOUT[r];
                let weight = n[of.group][with.group][of.axis][with.axis];
                let (right, features) = ([x[0][r], x[1][r], x[2][r]], at.h[with.block]);
                *tile = four!(|e| {
                    let sum = features.times_add(weight * h.get(e), tile[e]);
                    let sum = right[0].times_add(left[0].get(e), sum);
                    let sum = right[1].times_add(left[1].get(e), sum);
                    right[2].times_add(left[2].get(e), sum)
                });
            }
        }
    }

    #[inline(always)]
    fn of_rows(&mut self, x: &[S::Quads<A::Quad>; 2], w: [A::Number; 2]) {
        let mut tiles = self.tiles.iter_mut();
        for q in 0..S::QUADS {
            let left = [x[0][q].times(w[0]), x[1][q].times(w[1])];
            for (r, tile) in (q..S::QUADS).zip(tiles.by_ref()) {
                let right = [x[0][r], x[1][r]];
                *tile = four!(|e| {
                    let sum = right[0].times_add(left[0].get(e), tile[e]);
                    right[1].times_add(left[1].get(e), sum)
                });
            }
        }
    }

    #[inline(always)]
    fn of_vertical(&mut self, at: &Place<A, S>, weight: A::Number) {
        let gyros = S::GYRO_QUADS * S::QUADS - S::GYRO_QUADS * (S::GYRO_QUADS - 1) / 2;
        let mut tiles = self.tiles[gyros..].iter_mut();
        for q in S::GYRO_QUADS..S::QUADS {
            let of = &S::LAYOUT[q];
            let h = at.h[of.block].times(weight * at.c[UP][of.axis]);
            for (r, tile) in (q..S::QUADS).zip(tiles.by_ref()) {
                let with = &S::LAYOUT[r];
                let features = at.h[with.block].times(at.c[UP][with.axis]);
                *tile = four!(|e| features.times_add(h.get(e), tile[e]));
            }
        }
    }
}

/// Ē over the columns.
#[derive(Debug)]
pub(crate) enum WideAdjoint<A: Arithmetic, S: Shape> {
    /// All tiles, row by row.
    Tiles(Vec<[A::Quad; 4]>),
    /// What it does to every row that was told, worked out beforehand.
    Told(Vec<S::Quads<A::Quad>>),
}

impl<A: Arithmetic, S: Shape> WideAdjoint<A, S> {
    /// From its entries, row by row over the columns.
    #[inline(always)]
    pub fn new(ar: A, entries: &[A::Number]) -> Self {
        let columns = 4 * S::QUADS;
        let mut tiles = Vec::with_capacity(S::QUADS * S::QUADS);
        for q in 0..S::QUADS {
            for r in 0..S::QUADS {
                tiles.push(four!(|e| {
                    let at = (4 * q + e) * columns + 4 * r;
                    ar.quad(four!(|f| entries[at + f]))
                }));
            }
        }
        Self::Tiles(tiles)
    }
}

/// Rows times Ē, given as tiles.
#[inline(always)]
fn times_tiles<A: Arithmetic, S: Shape, const N: usize>(
    tiles: &[[A::Quad; 4]],
    x: &[S::Quads<A::Quad>; N],
) -> [S::Quads<A::Quad>; N] {
    let mut out = *x;
    for r in 0..S::QUADS {
        let first = &tiles[r];
        let mut sums = [first[0]; N];
        for i in 0..N {
            let of = x[i][0];
            let sum = first[0].times(of.get(0));
            let sum = first[1].times_add(of.get(1), sum);
            let sum = first[2].times_add(of.get(2), sum);
            sums[i] = first[3].times_add(of.get(3), sum);
        }
        for q in 1..S::QUADS {
            let tile = &tiles[q * S::QUADS + r];
            for i in 0..N {
                let of = x[i][q];
                let sum = tile[0].times_add(of.get(0), sums[i]);
                let sum = tile[1].times_add(of.get(1), sum);
                let sum = tile[2].times_add(of.get(2), sum);
                sums[i] = tile[3].times_add(of.get(3), sum);
            }
        }
        for i in 0..N {
            out[i][r] = sums[i];
        }
    }
    out
}

/// The adjoints of ⟨Ē, n ⊗ hᵀh⟩, Ē given as tiles.
#[inline(always)]
fn take_tiles_back<A: Arithmetic, S: Shape>(
    tiles: &[[A::Quad; 4]],
    sweep: &mut Sweep<'_, A, S>,
    step: &DwellStep<A, S>,
    at: &Place<A, S>,
    vertical: A::Number,
) {
    let ar = sweep.arithmetic();
    let (zero, two) = (ar.number(0.0), ar.number(2.0));
    let n = grams::<A, S>(&step.q_c, at, vertical);
    // 2 ∂f/∂n: instrument by instrument.
    let mut f = [[[[zero; 3]; 3]; 2]; 2];
    for r in 0..S::QUADS {
        let with = &S::LAYOUT[r];
        let mut u = [[ar.quad([zero; 4]); 3]; 2];
        for q in 0..S::QUADS {
            let of = &S::LAYOUT[q];
            let (h, tile) = (at.h[of.block], &tiles[q * S::QUADS + r]);
            let sum = tile[0].times_add(h.get(0), u[of.group][of.axis]);
            let sum = tile[1].times_add(h.get(1), sum);
            let sum = tile[2].times_add(h.get(2), sum);
            u[of.group][of.axis] = tile[3].times_add(h.get(3), sum);
        }
        let features = at.h[with.block];
        for group in 0..S::GROUPS {
            for axis in 0..3 {
                let u = u[group][axis];
                let to = &mut f[group][with.group][axis][with.axis];
                *to = u.dot(features).mul_add(two, *to);
                let twice = n[group][with.group][axis][with.axis] * two;
                sweep.place.h[with.block] = u.times_add(twice, sweep.place.h[with.block]);
            }
        }
    }
    let q_c = entries_of::<A, S>(&step.q_c);
    let r22 = entries(&step.gain.r22);
    let mut pulled = <S::Groups<Entries<A::Number>>>::filled([[zero; 3]; 3]);
    for group in 0..S::GROUPS {
        let of_gyros = three!(|i| three!(|j| {
            let f = &f[0][group];
            dot(&q_c[0][i], &[f[0][j], f[1][j], f[2][j]])
        }));
        pulled[group] = of_gyros;
        if S::GROUPS > 1 {
            pulled[group] = three!(|i| three!(|j| {
                let f = &f[1][group];
                let more = dot(&q_c[1][i], &[f[0][j], f[1][j], f[2][j]]);
                of_gyros[i][j] + more
            }));
        }
    }
    sweep.add_c(&r22, &pulled);
    if S::GROUPS > 1 {
        let f = &f[1][1];
        let c = &at.c[UP];
        let row = three!(|i| vertical * dot(c, &[f[0][i], f[1][i], f[2][i]]));
        sweep.place.add_to_up(ar, &row);
    }
}

/// The same, given what it does to the rows (R22 C) ⊗ h and to that of the vertical channel.
#[inline(always)]
fn take_rows_back<A: Arithmetic, S: Shape>(
    rows: &[S::Quads<A::Quad>],
    sweep: &mut Sweep<'_, A, S>,
    step: &DwellStep<A, S>,
    at: &Place<A, S>,
    vertical: A::Number,
) {
    let ar = sweep.arithmetic();
    let two = ar.number(2.0);
    let mut twice = [rows[0], rows[1], rows[2]];
    for row in &mut twice {
        for q in 0..S::QUADS {
            row[q] = row[q].times(two);
        }
    }
    sweep.add_c(&entries(&step.gain.r22), &along::<_, S>(&twice, &at.h));
    sweep.add_h(&entries_of::<A, S>(&step.q_c), &twice);
    if S::GROUPS > 1 {
        pull_vertical(ar, &mut sweep.place, at, vertical, &rows[3]);
    }
}

impl<A: Arithmetic, S: Shape> InformationAdjoint<A, S> for WideAdjoint<A, S> {
    #[inline(always)]
    fn times<const N: usize>(
        &self,
        row: usize,
        x: &[S::Quads<A::Quad>; N],
    ) -> [S::Quads<A::Quad>; N] {
        match self {
            Self::Tiles(tiles) => times_tiles::<A, S, N>(tiles, x),
            Self::Told(rows) => {
                let mut out = *x;
                out.copy_from_slice(&rows[row..row + N]);
                out
            }
        }
    }

    #[inline(always)]
    fn take_back(
        &self,
        sweep: &mut Sweep<'_, A, S>,
        row: usize,
        step: &DwellStep<A, S>,
        at: &Place<A, S>,
        vertical: A::Number,
    ) {
        match self {
            Self::Tiles(tiles) => take_tiles_back(tiles, sweep, step, at, vertical),
            Self::Told(rows) => take_rows_back(&rows[row..], sweep, step, at, vertical),
        }
    }

    #[inline(always)]
    fn take_vertical_back(
        &self,
        ar: A,
        place: &mut PlaceAdjoint<A, S>,
        row: usize,
        at: &Place<A, S>,
        weight: A::Number,
    ) -> A::Number {
        let [pulled] = self.times(row, &[vertical_row(ar, at)]);
        pull_vertical(ar, place, at, weight, &pulled)
    }
}

/// What the vertical channel measures: b_y, of the accelerometers alone.
#[inline(always)]
pub(crate) fn vertical_row<A: Arithmetic, S: Shape>(ar: A, at: &Place<A, S>) -> S::Quads<A::Quad> {
    let mut row = every::<S, _>(ar.quad([ar.number(0.0); 4]));
    for q in S::GYRO_QUADS..S::QUADS {
        let of = &S::LAYOUT[q];
        row[q] = at.h[of.block].times(at.c[UP][of.axis]);
    }
    row
}

/// Takes `weight` times a measurement of the vertical channel back, `pulled` what Ē does to its row.
/// Returns the derivative with respect to the weight.
#[inline(always)]
pub(crate) fn pull_vertical<A: Arithmetic, S: Shape>(
    ar: A,
    place: &mut PlaceAdjoint<A, S>,
    at: &Place<A, S>,
    weight: A::Number,
    pulled: &S::Quads<A::Quad>,
) -> A::Number {
    let twice = weight * ar.number(2.0);
    let mut up = [ar.number(0.0); 3];
    for q in S::GYRO_QUADS..S::QUADS {
        let of = &S::LAYOUT[q];
        let adjoint = pulled[q].times(twice);
        place.h[of.block] = adjoint.times_add(at.c[UP][of.axis], place.h[of.block]);
        up[of.axis] = up[of.axis] + adjoint.dot(at.h[of.block]);
    }
    place.add_to_up(ar, &up);
    super::row_dot::<_, S>(pulled, &vertical_row(ar, at))
}
