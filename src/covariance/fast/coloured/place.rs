//! What the parameters do in an attitude, and the way back.

use super::Columns;
use super::columns::{Term, packed, unpacked};
use super::rows::add;
use crate::attitude::{EAST, NORTH, UP};
use crate::covariance::fast::arithmetic::{Arithmetic, Number, Work};
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::shape::{Basis, Catalogue, FEATURES, basis, basis_adjoint};
use crate::covariance::fast::square::Entries;

/// A position, or an instant of a move, as the chain sees it.
#[derive(Debug, Clone)]
pub(crate) struct Place<A: Arithmetic> {
    /// C_c^n.
    pub c: Entries<A::Number>,
    /// The features.
    of: Basis<A::Number>,
    /// A' = A + [ω_ie ×] U, three rows over the parameters: what drives ψ'.
    pub drift: Vec<A::Quad>,
    /// b^n, three rows: what the accelerometers show too much. Empty where they are perfect.
    pub output: Vec<A::Quad>,
}

/// A place to work out.
struct Find<'a, A: Arithmetic> {
    ar: A,
    columns: &'a Columns,
    earth: &'a Earth<A::Number>,
    c: Entries<A::Number>,
    rate: &'a [A::Number; 3],
}

impl<A: Arithmetic> Work for Find<'_, A> {
    type Output = Place<A>;
    #[inline(always)]
    fn run(self) -> Place<A> {
        Place::found(self.ar, self.columns, self.earth, self.c, self.rate)
    }
}

impl<A: Arithmetic> Place<A> {
    /// In the attitude C_c^n, the body turning at `rate` against inertial space, in n, rad/s.
    #[inline(always)]
    pub fn new(
        ar: A,
        columns: &Columns,
        earth: &Earth<A::Number>,
        c: Entries<A::Number>,
        rate: &[A::Number; 3],
    ) -> Self {
        ar.always_apart(Find {
            ar,
            columns,
            earth,
            c,
            rate,
        })
    }

    #[inline(always)]
    fn found(
        ar: A,
        columns: &Columns,
        earth: &Earth<A::Number>,
        c: Entries<A::Number>,
        rate: &[A::Number; 3],
    ) -> Self {
        let of = basis::<_, Catalogue>(&c, rate);
        let width = columns.width;
        let mut place = Self {
            c,
            of,
            drift: Vec::new(),
            output: Vec::new(),
        };
        place.drift = place.columns_of(ar, columns, &columns.gyros);
        if columns.has_accelerometers() {
            place.output = place.columns_of(ar, columns, &columns.accelerometers);
            // [ω_ie ×] U, U the rows (−b_z, 0, b_x).
            let [north, up, _] = earth.vector();
            let (drift, output) = (&mut place.drift, &place.output);
            let (b_x, b_z) = (NORTH * width, EAST * width);
            add(&mut drift[..width], up, &output[b_x..b_x + width]);
            add(
                &mut drift[width..2 * width],
                -north,
                &output[b_x..b_x + width],
            );
            add(&mut drift[2 * width..], up, &output[b_z..b_z + width]);
        }
        place
    }

    /// The columns of `terms` here, three rows.
    #[inline(always)]
    pub fn columns_of(&self, ar: A, columns: &Columns, terms: &[Term]) -> Vec<A::Quad> {
        let mut out = vec![ar.number(0.0); 12 * columns.width];
        columns.add_terms(&mut out, terms, &self.c, &self.of);
        packed(ar, &out)
    }

    /// The inputs of the chain: A' and, as a fourth, b_y.
    #[inline(always)]
    pub fn inputs<const I: usize>(&self, ar: A, columns: &Columns) -> Vec<A::Quad> {
        let mut inputs = self.drift.clone();
        if I > 3 {
            let up = UP * columns.width;
            match self.output.get(up..up + columns.width) {
                Some(row) => inputs.extend_from_slice(row),
                None => inputs.resize(4 * columns.width, ar.quad([ar.number(0.0); 4])),
            }
        }
        inputs
    }

    /// At rest.
    #[inline(always)]
    pub fn at_rest(
        ar: A,
        columns: &Columns,
        earth: &Earth<A::Number>,
        c: Entries<A::Number>,
    ) -> Self {
        Self::new(ar, columns, earth, c, &earth.vector())
    }
}

/// Adjoints of a [`Place`].
#[derive(Debug, Clone)]
pub(crate) struct PlaceAdjoint<A: Arithmetic> {
    /// C̄, but for what goes through the columns.
    pub c: Entries<A::Number>,
    pub drift: Vec<A::Quad>,
    pub output: Vec<A::Quad>,
}

impl<A: Arithmetic> PlaceAdjoint<A> {
    /// Nothing depends on it.
    #[inline(always)]
    pub fn nothing(ar: A, columns: &Columns) -> Self {
        let zero = ar.number(0.0);
        let nothing = ar.quad([zero; 4]);
        let width = 3 * columns.width;
        Self {
            c: [[zero; 3]; 3],
            drift: vec![nothing; width],
            output: match columns.has_accelerometers() {
                true => vec![nothing; width],
                false => Vec::new(),
            },
        }
    }

    /// Of nothing at all.
    #[inline(always)]
    pub fn none(ar: A) -> Self {
        Self {
            c: [[ar.number(0.0); 3]; 3],
            drift: Vec::new(),
            output: Vec::new(),
        }
    }

    /// Of the inputs of the chain, [`Place::inputs`].
    #[inline(always)]
    pub fn add_inputs(&mut self, of: &[A::Quad], width: usize) {
        let one = self.c[0][0].constant(1.0);
        add(&mut self.drift, one, &of[..3 * width]);
        if !self.output.is_empty() {
            add(
                &mut self.output[UP * width..(UP + 1) * width],
                one,
                &of[3 * width..],
            );
        }
    }

    /// Of columns of `terms` at a place; the features' are not wanted.
    #[inline(always)]
    pub fn add_columns(
        &mut self,
        columns: &Columns,
        terms: &[Term],
        of: &[A::Quad],
        at: &Place<A>,
    ) {
        let mut features = [at.c[0][0].constant(0.0); FEATURES];
        pull_terms(columns, terms, of, at, &mut self.c, &mut features);
    }

    /// Adjoints of C and of the body's rate in n, all together.
    #[inline(always)]
    pub fn pull(
        &mut self,
        columns: &Columns,
        earth: &Earth<A::Number>,
        at: &Place<A>,
        rate: &[A::Number; 3],
    ) -> (Entries<A::Number>, [A::Number; 3]) {
        let zero = at.c[0][0].constant(0.0);
        let width = columns.width;
        let (mut c, mut of) = (self.c, [zero; FEATURES]);
        pull_terms(columns, &columns.gyros, &self.drift, at, &mut c, &mut of);
        if columns.has_accelerometers() {
            let [north, up, _] = earth.vector();
            let (drift, output) = (&self.drift, &mut self.output);
            let (b_x, b_z) = (NORTH * width, EAST * width);
            add(&mut output[b_x..b_x + width], up, &drift[..width]);
            add(
                &mut output[b_x..b_x + width],
                -north,
                &drift[width..2 * width],
            );
            add(&mut output[b_z..b_z + width], up, &drift[2 * width..]);
            pull_terms(
                columns,
                &columns.accelerometers,
                output,
                at,
                &mut c,
                &mut of,
            );
        }
        let rate = basis_adjoint::<_, Catalogue>(&at.c, rate, &of, &mut c);
        (c, rate)
    }

    /// Of ⟨V̄, `by` U⟩ with U the shift by the accelerometers, V̄ the rows of ψ'.
    #[inline(always)]
    pub fn add_shift(&mut self, columns: &Columns, v: &[A::Quad], by: A::Number) {
        let width = columns.width;
        if self.output.is_empty() {
            return;
        }
        let (north, east) = (NORTH * width, EAST * width);
        add(
            &mut self.output[north..north + width],
            by,
            &v[east..east + width],
        );
        add(
            &mut self.output[east..east + width],
            -by,
            &v[north..north + width],
        );
    }
}

/// Adds the adjoints of C and of the features, given those of three rows of `terms`.
#[inline(always)]
pub(super) fn pull_terms<A: Arithmetic>(
    columns: &Columns,
    terms: &[Term],
    adjoint: &[A::Quad],
    at: &Place<A>,
    c: &mut Entries<A::Number>,
    of: &mut Basis<A::Number>,
) {
    let adjoint = unpacked(adjoint);
    let width = 4 * columns.width;
    for term in terms {
        let factor = at.c[0][0].constant(term.factor);
        let feature = term.feature as usize;
        let scaled = at.of[feature] * factor;
        let mut along = at.c[0][0].constant(0.0);
        for i in 0..3 {
            let adjoint = adjoint[i * width + term.column];
            c[i][term.axis] = adjoint.mul_add(scaled, c[i][term.axis]);
            along = at.c[i][term.axis].mul_add(adjoint, along);
        }
        of[feature] = along.mul_add(factor, of[feature]);
    }
}

/// V ← V + `by` U, U the rows (−b_z, 0, b_x) at a place.
#[inline(always)]
pub(super) fn shift<A: Arithmetic>(
    columns: &Columns,
    v: &mut [A::Quad],
    at: &Place<A>,
    by: A::Number,
) {
    let width = columns.width;
    if at.output.is_empty() {
        return;
    }
    let (north, east) = (NORTH * width, EAST * width);
    add(
        &mut v[north..north + width],
        -by,
        &at.output[east..east + width],
    );
    add(
        &mut v[east..east + width],
        by,
        &at.output[north..north + width],
    );
}
