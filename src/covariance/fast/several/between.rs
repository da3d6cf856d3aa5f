//! A part of a test in many variants, between a start and a rest that they share.

use super::super::arithmetic::{Alignment, Arithmetic, Lanes, Work, three};
use super::super::course::{self, Tape};
use super::super::earth::Earth;
use super::super::gains::{Gains, Own};
use super::super::information::{Information, Rows, by_gyros, rows_by_gyros};
use super::super::square::Entries;
use super::super::{Carried, Place, Wide, attitude_entries};
use super::Group;
use crate::attitude::Attitude;
use crate::covariance::chain::{InformationSink, State};
use crate::covariance::rows::Rows as StackedRows;
use crate::covariance::small::{square_root, whitener};
use crate::covariance::{CovarianceModel, CovarianceRoot, TickRule};
use crate::drift::{CoefficientMatrix, DriftMatrix};
use crate::error::Result;
use crate::motion::Timeline;
use nalgebra::Matrix3;
use pulp::Simd;

/// What comes before and after a part of a test.
#[derive(Debug, Clone)]
pub(crate) struct Between {
    v: Wide<[f64; 4]>,
    p: Matrix3<f64>,
    /// All information that does not depend on the part.
    e: Rows<[f64; 4]>,
    /// Where the platform is at the start.
    from: Option<Attitude>,
    /// Rows R ψ^n + S D of unit noise at the end of the part: R and S.
    rest: Option<(Entries<f64>, Wide<[f64; 4]>)>,
    /// The same as the chain of rows takes it.
    by_rows: ByRows,
}

/// What comes before and after a part, where sums of squares lose digits.
#[derive(Debug, Clone)]
struct ByRows {
    state: State,
    /// The triangle of all information that does not depend on the part, in units of the prior σ.
    known: CoefficientMatrix,
    rest: Option<(Matrix3<f64>, DriftMatrix)>,
}

impl Between {
    /// From the state and the attitude before, the information that does not depend on the part
    /// as a sum of squares and as a triangle of rows in units of the prior σ, and the rows (R, S)
    /// of what comes after.
    pub fn new(
        state: &State,
        from: Option<Attitude>,
        (information, known): (&CoefficientMatrix, CoefficientMatrix),
        rest: Option<(&Matrix3<f64>, &DriftMatrix)>,
    ) -> Self {
        Self {
            v: rows_by_gyros(&state.v),
            p: state.p,
            e: by_gyros(information),
            from,
            rest: rest.map(|(r, s)| (three!(|i| three!(|j| r[(i, j)])), rows_by_gyros(s))),
            by_rows: ByRows {
                state: *state,
                known,
                rest: rest.map(|(r, s)| (*r, *s)),
            },
        }
    }

    /// A root of P_D at the end of a test with `part` in it, by the rows of the information.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when a row is not finite.
    pub(in crate::covariance) fn root(
        &self,
        model: &CovarianceModel,
        part: &Timeline,
        rule: TickRule,
    ) -> Result<CovarianceRoot> {
        let mut rows = StackedRows::new(&model.prior_sigma);
        rows.add_triangle(&self.by_rows.known);
        let (mut state, mut from) = (self.by_rows.state, self.from);
        for leg in part.legs() {
            if let Some(from) = &from {
                state = model.arrive(state, (from, leg), rule, &mut rows);
            }
            state = model.dwell(state, leg, rule, &mut rows);
            from = Some(leg.attitude);
        }
        if let Some((psi, drift)) = &self.by_rows.rest {
            let w = whitener(&(psi * square_root(&state.p)));
            rows.add(&(w * (psi * state.v + drift)));
        }
        rows.covariance_root()
    }
}

/// The rest of the test added to what the chain has collected.
struct Join<'a, A: Arithmetic> {
    ar: A,
    chain: &'a Carried<A>,
    p: Entries<A::Number>,
    rest: &'a (Entries<f64>, Wide<[f64; 4]>),
}

impl<A: Arithmetic> Work for Join<'_, A> {
    type Output = Information<A>;
    #[inline(always)]
    fn run(self) -> Information<A> {
        let (psi, drift) = self.rest;
        self.chain.joined(self.ar, &self.p, psi, drift)
    }
}

/// The information at the end of every lane's timeline, between what is given.
#[inline(always)]
pub(super) fn run<S: Simd, L: Alignment>(
    group: &Group<'_, S, L>,
    between: Option<&Between>,
    tape: &mut Tape<Lanes<S, L>>,
) -> Information<Lanes<S, L>> {
    let ar = group.ar;
    let model = group.timelines[0].model;
    let earth = Earth::new(
        ar.number(0.0),
        &model.dynamics,
        &model.stand,
        model.drift_psd,
    );
    let start_p = between.map_or(&model.prior_psi, |b| &b.p);
    let mut gains = Own::new(ar, group, &earth, start_p);
    let from = match between {
        None => (Carried::new(ar), None),
        Some(b) => (
            Carried::known(ar, &b.v, &b.e),
            b.from.as_ref().map(|a| place(ar, &earth, a)),
        ),
    };
    let chain = course::forward_from(ar, group, &earth, &mut gains, tape, from);
    match between.and_then(|b| b.rest.as_ref()) {
        None => chain.e,
        Some(rest) => ar.apart(Join {
            ar,
            chain: &chain,
            p: gains.p(),
            rest,
        }),
    }
}

#[inline(always)]
fn place<A: Arithmetic>(ar: A, earth: &Earth<A::Number>, attitude: &Attitude) -> Place<A> {
    let c = attitude_entries(attitude);
    Place::new(ar, earth, three!(|i| three!(|j| ar.number(c[i][j]))))
}
