//! Positions near axis-aligned ones, and odd platforms: whatever can be evaluated can be
//! analysed, with the ranks and orders of an independent decomposition.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use scheme_opt::internals::analysis::Analysis;
use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::covariance::CovarianceModel;
use scheme_opt::internals::drift::expansions::{epsilon_x, epsilon_y, epsilon_z};
use scheme_opt::internals::drift::{COEFFICIENTS, CoefficientVector, DriftCoefficient as D};
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::observability::nearly::Nearly;
use scheme_opt::internals::observability::solution::{NoSolution, RowsUsed, Solution};
use scheme_opt::internals::observability::{Combination, Observability, Order, RANK_TOLERANCE};
use scheme_opt::internals::platform::{PlatformConfig, Repositioning};
use scheme_opt::internals::results::{AnalysisDocument, Inputs};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

use crate::support::Random;

const UNKNOWNS: usize = COEFFICIENTS + 1;
const NONE: Option<Order> = None;
const FIRST: Option<Order> = Some(Order::First);
const SECOND: Option<Order> = Some(Order::Second);

fn schedule(positions: &[[f64; 3]], dwell_s: f64) -> Schedule {
    let held = positions
        .iter()
        .map(|[a, b, g]| ScheduledPosition::new(Position::from_deg(*a, *b, *g), dwell_s));
    Schedule::new(held.collect()).unwrap()
}

// ---------------------------------------------------------------- the oracle

/// RowsUsed (22), row 3 and (23) of moments, each with its length in the geometry, the column of
/// ω_N ψ_y(0) in row 3, entries of rounding size left out.
fn rows_of(moments: &[(Position, f64)]) -> [Vec<[f64; UNKNOWNS]>; 3] {
    let row = |p: Position, share: f64, axis: usize| {
        std::array::from_fn(|j| {
            if j == COEFFICIENTS {
                return if axis == 1 { -share } else { 0.0 };
            }
            let unit = CoefficientVector::from_fn(|i, _| if i == j { 1.0 } else { 0.0 });
            let entry = [epsilon_x, epsilon_z, epsilon_y][axis](p, &unit);
            if entry.abs() < 1e-12 {
                0.0
            } else {
                share * entry
            }
        })
    };
    [0, 1, 2].map(|axis| {
        moments
            .iter()
            .map(|(p, share)| row(*p, *share, axis))
            .collect()
    })
}

/// Singular values over the largest of all rows, and the distances of the coefficients from the
/// space of those that count.
struct OracleSpace {
    values: Vec<f64>,
    rank: usize,
    distances: [f64; COEFFICIENTS],
}

impl OracleSpace {
    fn of(rows: &[[f64; UNKNOWNS]], largest: f64) -> (Self, f64) {
        // RowsUsed of zeros make the null space part of the decomposition.
        let height = rows.len().max(UNKNOWNS);
        let matrix = DMatrix::from_fn(height, UNKNOWNS, |i, j| rows.get(i).map_or(0.0, |r| r[j]));
        let svd = matrix.svd(false, true);
        let vectors = svd.v_t.unwrap();
        let largest = largest.max(svd.singular_values[0]);
        let values: Vec<f64> = svd.singular_values.iter().map(|v| v / largest).collect();
        let lost: Vec<usize> = (0..UNKNOWNS)
            .filter(|&k| values[k] <= RANK_TOLERANCE)
            .collect();
        let distances = std::array::from_fn(|i| {
            let parts = DVector::from_iterator(lost.len(), lost.iter().map(|&k| vectors[(k, i)]));
            parts.norm()
        });
        let rank = UNKNOWNS - lost.len();
        (
            Self {
                values,
                rank,
                distances,
            },
            largest,
        )
    }

    /// Whether a singular value lies within a hundredth of the tolerance.
    fn on_the_line(&self) -> bool {
        self.values
            .iter()
            .any(|v| (v / RANK_TOLERANCE - 1.0).abs() < 0.01)
    }

    /// Whether a coefficient is in; none within a fifth of the tolerance, which is what rounding
    /// does to the vectors of singular values near it.
    fn contains(&self, i: usize) -> Option<bool> {
        let relative = self.distances[i] / RANK_TOLERANCE;
        ((relative - 1.0).abs() > 0.2).then_some(relative < 1.0)
    }
}

struct Oracle {
    x: OracleSpace,
    first: OracleSpace,
    all: OracleSpace,
}

impl Oracle {
    fn of(moments: &[(Position, f64)]) -> Self {
        let [x, z, y] = rows_of(moments);
        let first = [x.clone(), z].concat();
        let (all, largest) = OracleSpace::of(&[first.clone(), y].concat(), 0.0);
        Self {
            x: OracleSpace::of(&x, largest).0,
            first: OracleSpace::of(&first, largest).0,
            all,
        }
    }

    fn of_positions(positions: &[[f64; 3]]) -> Self {
        let held = positions
            .iter()
            .map(|[a, b, g]| (Position::from_deg(*a, *b, *g), 1.0));
        Self::of(&held.collect::<Vec<_>>())
    }

    fn on_the_line(&self) -> bool {
        [&self.x, &self.first, &self.all]
            .iter()
            .any(|space| space.on_the_line())
    }

    fn ranks(&self) -> (usize, usize, usize) {
        (self.all.rank, self.first.rank, self.x.rank)
    }

    /// The order of a coefficient; none: too near the tolerance to say.
    fn order(&self, i: usize) -> Option<Option<Order>> {
        match (self.first.contains(i)?, self.all.contains(i)?) {
            (true, _) => Some(FIRST),
            (false, true) => Some(SECOND),
            (false, false) => Some(NONE),
        }
    }
}

// ---------------------------------------------------------------- what must hold of every analysis

/// One notion of rank: everything says the same of what is seen.
fn check(model: &CovarianceModel, timeline: &Timeline, o: &Observability, case: &str) {
    assert!(
        o.rank_x <= o.rank_first_order && o.rank_first_order <= o.rank,
        "{case}"
    );
    assert_eq!(o.unobservable.len(), o.unknowns - o.rank, "{case}");
    assert_eq!(
        o.condition_number.is_finite(),
        o.rank == o.unknowns,
        "{case}"
    );
    for c in D::ALL {
        let i = c.index();
        let order = o.orders[i];
        assert_eq!(
            o.separability[i] > 0.0,
            order.is_some(),
            "{case}: {}",
            c.name()
        );
        let first = order.is_some_and(|o| o <= Order::First);
        assert_eq!(
            o.separability_first_order[i] > 0.0,
            first,
            "{case}: {}",
            c.name()
        );
        match Solution::find(model, timeline, o, &Combination::single(c)) {
            Ok(s) => {
                assert_eq!(Some(s.order), order, "{case}: {}", c.name());
                assert!(
                    s.residual <= 2.0 * RANK_TOLERANCE && !s.terms.is_empty(),
                    "{case}"
                );
            }
            Err(why) => {
                assert_eq!(why, NoSolution::NotObservable, "{case}: {}", c.name());
                assert_eq!(order, NONE, "{case}: {}", c.name());
            }
        }
    }
    for nearly in Nearly::find(model, timeline, o) {
        let tilt_deg = nearly.tilt_deg();
        assert!(tilt_deg > 0.0 && tilt_deg < 1.0, "{case}: {nearly}");
    }
}

/// Agreement with the oracle; the numbers of schedules and of orders that are too near to call.
fn compare(
    model: &CovarianceModel,
    timeline: &Timeline,
    oracle: &Oracle,
    case: &str,
) -> [usize; 2] {
    let o = Observability::analyze(model, timeline).unwrap();
    check(model, timeline, &o, case);
    if oracle.on_the_line() {
        return [1, 0];
    }
    assert_eq!(
        (o.rank, o.rank_first_order, o.rank_x),
        oracle.ranks(),
        "{case}"
    );
    let mut near = 0;
    for c in D::ALL {
        match oracle.order(c.index()) {
            Some(order) => assert_eq!(o.orders[c.index()], order, "{case}: {}", c.name()),
            None => near += 1,
        }
    }
    [0, near]
}

/// Two to twelve positions, each aligned or off by 1e-6° to 1e-2°.
fn near_aligned(random: &mut Random) -> Vec<[f64; 3]> {
    let count = random.between(2.0, 13.0) as usize;
    (0..count)
        .map(|_| {
            let off = random.unit() > 0.25;
            let size = if off {
                10_f64.powf(random.between(-6.0, -2.0))
            } else {
                0.0
            };
            std::array::from_fn(|_| {
                let quarters = random.between(-2.0, 3.0).floor();
                90.0 * quarters + size * random.between(-1.0, 1.0)
            })
        })
        .collect()
}

#[test]
fn orders_of_10000_nearly_aligned_schedules_are_those_of_an_independent_svd() {
    const CASES: u64 = 10_000;
    let platform = PlatformConfig::default().check().unwrap();
    let model = CovarianceModel::new(&platform);
    let near = (0..CASES)
        .into_par_iter()
        .map(|case| {
            let positions = near_aligned(&mut Random::of_case(case + 1));
            let timeline =
                Timeline::new(&platform.clone().into(), &schedule(&positions, 1000.0)).unwrap();
            let oracle = Oracle::of_positions(&positions);
            compare(
                &model,
                &timeline,
                &oracle,
                &format!("{case}: {positions:?}"),
            )
        })
        .reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    println!(
        "too near to call: {} schedules, {} orders",
        near[0], near[1]
    );
    assert!(near[0] < 150 && near[1] < 1200, "{near:?}");
}

#[test]
fn orders_of_400_random_schedules_are_those_of_an_independent_svd() {
    let mut random = Random(31);
    let platform = PlatformConfig::default().check().unwrap();
    let model = CovarianceModel::new(&platform);
    for case in 0..400 {
        let positions: Vec<[f64; 3]> = (0..1 + case % 14)
            .map(|_| random.position().to_deg())
            .collect();
        let timeline =
            Timeline::new(&platform.clone().into(), &schedule(&positions, 1000.0)).unwrap();
        let oracle = Oracle::of_positions(&positions);
        let near = compare(
            &model,
            &timeline,
            &oracle,
            &format!("{case}: {positions:?}"),
        );
        assert_eq!(near, [0, 0], "{case}");
    }
}

// ---------------------------------------------------------------- cases with known answers

fn analysed(config: &PlatformConfig, schedule: &Schedule) -> (Analysis, AnalysisDocument) {
    let evaluator = Evaluator::new(config.check().unwrap(), Objective::default());
    let evaluation = evaluator.evaluate(schedule).unwrap();
    let analysis = Analysis::new(&evaluator, schedule, &evaluation).unwrap();
    let inputs = Inputs {
        config: scheme_opt::internals::config::StudyConfig::default(),
        defaulted: Vec::new(),
        done: None,
    };
    let document = AnalysisDocument::new(
        &analysis,
        &evaluation,
        schedule,
        evaluator.objective(),
        &inputs,
    );
    // Every number of it is a number: null in place of one could not be read back.
    let json = document.to_json().unwrap();
    assert_eq!(
        serde_json::from_str::<AnalysisDocument>(&json).unwrap(),
        document
    );
    (analysis, document)
}

#[test]
fn a_hundredth_of_a_degree_at_the_third_position() {
    let positions = [[0.0, 0.0, 0.0], [180.01, 0.0, 0.0], [90.0, 0.0, 0.01]];
    let (analysis, _) = analysed(&PlatformConfig::default(), &schedule(&positions, 1000.0));
    let o = &analysis.observability;
    assert_eq!((o.rank, o.rank_first_order, o.rank_x), (9, 6, 3));
    // FX, FY, FZ, IX, IY, IZ, OX, OY, OZ, SX, SY, SZ: D_OX shows beside D_OY and D_SZ as their
    // 1.7e-4th part, which is too much to count as nothing.
    let expected = [
        FIRST, SECOND, SECOND, NONE, SECOND, SECOND, NONE, NONE, NONE, FIRST, NONE, NONE,
    ];
    assert_eq!(o.orders, expected);
    let names: Vec<String> = o.unobservable.iter().map(ToString::to_string).collect();
    for name in ["D_IX", "-1.7e-4 D_OX + D_OY + D_SZ - omega_N psi_y(0)"] {
        assert!(names.contains(&name.to_owned()), "{names:?}");
    }
    let fx = analysis.solutions[D::FX.index()].as_ref().unwrap();
    assert_eq!((fx.terms.len(), fx.rows), (3, RowsUsed::Few));
    assert!((fx.terms[0].weight - 0.5).abs() < 1e-4 && fx.terms[2].weight.abs() < 1e-4);
    assert!(analysis.nearly.is_empty(), "{:?}", analysis.nearly);
}

#[test]
fn what_only_a_hundredth_of_a_degree_tells_is_said() {
    let positions = [[0.0, 0.0, 0.0], [180.0, 0.0, 0.0], [0.01, 0.0, 0.0]];
    let (analysis, document) = analysed(&PlatformConfig::default(), &schedule(&positions, 1000.0));
    let words: Vec<&str> = document.nearly.iter().map(|n| n.words.as_str()).collect();
    let expected = [
        "D_IZ shows only by 0.010 deg of tilt, at order 2.",
        "D_OX shows only by 0.010 deg of tilt, at order 1.",
    ];
    assert_eq!(words[..2], expected, "{words:?}");
    let ox = &document.nearly[1];
    assert_eq!((ox.coefficient, ox.order), (Some(D::OX), Order::First));
    assert!((ox.tilt_deg - 0.01).abs() < 1e-5 && ox.from.is_empty());
    // The reconstruction takes the difference of the two positions by 0.01°.
    let solution = analysis.solutions[D::OX.index()].as_ref().unwrap();
    let gain = 1.0 / 0.01_f64.to_radians();
    let largest = solution
        .terms
        .iter()
        .map(|t| t.weight.abs())
        .fold(0.0, f64::max);
    assert!((largest / gain - 1.0).abs() < 1e-3, "{largest}");
    // A thousandth of an arc second is nothing.
    let positions = [[0.0, 0.0, 0.0], [180.0, 0.0, 0.0], [3e-7, 0.0, 0.0]];
    let (analysis, _) = analysed(&PlatformConfig::default(), &schedule(&positions, 1000.0));
    assert_eq!(analysis.observability.orders[D::OX.index()], NONE);
    assert!(analysis.nearly.is_empty());
}

#[test]
fn a_measured_move_between_two_positions_shows_everything_hardly() {
    let mut config = PlatformConfig::default();
    config.motion.slew_rate_deg_per_s = Some(0.5.into());
    config.motion.measure_moves = true;
    let (analysis, document) = analysed(
        &config,
        &schedule(&[[1.0, 2.0, 3.0], [40.0, 5.0, 6.0]], 500.0),
    );
    // 39° take 78 s: seven periods of measurement on the way.
    let passing = (0..7).map(|k| {
        let f = (f64::from(k) + 0.5) / 7.0;
        let position = Position::from_deg(1.0 + 39.0 * f, 2.0 + 3.0 * f, 3.0 + 3.0 * f);
        (position, 7_f64.sqrt().recip())
    });
    let held =
        [[1.0, 2.0, 3.0], [40.0, 5.0, 6.0]].map(|[a, b, g]| (Position::from_deg(a, b, g), 1.0));
    let oracle = Oracle::of(&passing.chain(held).collect::<Vec<_>>());
    let o = &analysis.observability;
    assert!(!oracle.on_the_line());
    assert_eq!((o.rank, o.rank_first_order, o.rank_x), oracle.ranks());
    assert_eq!((o.rank, o.rank_first_order), (13, 11));
    for c in D::ALL {
        assert_eq!(
            Some(o.orders[c.index()]),
            oracle.order(c.index()),
            "{}",
            c.name()
        );
        let proof = analysis.solutions[c.index()].as_ref().unwrap();
        assert!(proof.residual <= 2.0 * RANK_TOLERANCE);
        let said = document
            .nearly
            .iter()
            .find(|n| n.coefficient == Some(c))
            .unwrap();
        assert!(!said.from.is_empty(), "{}", said.words);
    }
}

#[test]
fn odd_platforms_are_analysed_like_any_other() {
    type Change = fn(&mut PlatformConfig);
    let platforms: [(&str, Change); 10] = [
        ("a pole", |c| c.site.latitude_deg = 90.0),
        ("the other pole", |c| c.site.latitude_deg = -90.0),
        ("a metre from a pole", |c| c.site.latitude_deg = 89.99999),
        ("a millimetre from a pole", |c| {
            c.site.latitude_deg = 89.999_999_99
        }),
        ("the equator", |c| c.site.latitude_deg = 0.0),
        ("measured moves", |c| {
            c.motion.slew_rate_deg_per_s = Some(0.5.into());
            c.motion.measure_moves = true;
        }),
        ("measured moves at a pole", |c| {
            c.site.latitude_deg = 90.0;
            c.motion.slew_rate_deg_per_s = Some(0.05.into());
            c.motion.measure_moves = true;
        }),
        ("frame hold", |c| {
            c.motion.repositioning = Repositioning::FrameHold
        }),
        ("frame hold at a pole", |c| {
            c.site.latitude_deg = 90.0;
            c.motion.repositioning = Repositioning::FrameHold;
        }),
        ("a start and a return", |c| {
            c.motion.slew_rate_deg_per_s = Some(1.0.into());
            c.motion.settle_s = 30.0;
            c.motion.start_deg = Some([10.0, 20.0, 30.0]);
            c.motion.return_to_start = true;
        }),
    ];
    let aligned: Vec<[f64; 3]> = (0..4).map(|k| [90.0 * f64::from(k), 0.0, 0.0]).collect();
    let mut random = Random(37);
    let off = near_aligned(&mut random);
    let oblique: Vec<[f64; 3]> = (0..7).map(|_| random.position().to_deg()).collect();
    let schedules: [(&[[f64; 3]], f64); 7] = [
        (&[[0.0, 0.0, 0.0]], 1000.0),
        (&[[12.0, 34.0, 56.0]], 10.0),
        (&[[1.0, 2.0, 3.0], [40.0, 5.0, 6.0]], 500.0),
        (
            &[[0.0, 0.0, 0.0], [180.01, 0.0, 0.0], [90.0, 0.0, 0.01]],
            1000.0,
        ),
        (&aligned, 20.0),
        (&off, 700.0),
        (&oblique, 700.0),
    ];
    for (name, change) in platforms {
        let mut config = PlatformConfig::default();
        change(&mut config);
        let platform = config.check().unwrap();
        let model = CovarianceModel::new(&platform);
        for (positions, dwell_s) in &schedules {
            let case = format!("{name}: {positions:?}");
            let schedule = schedule(positions, *dwell_s);
            let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
            let (analysis, document) = analysed(&config, &schedule);
            let o = &analysis.observability;
            check(&model, &timeline, o, &case);
            // What is weak is what is seen, less the azimuth where that takes a part of it.
            let weak = document.weak.len();
            assert!(
                weak == o.rank || weak + 1 == o.rank,
                "{case}: {weak} of {}",
                o.rank
            );
            let zeros = document
                .singular_values_h_per_deg
                .iter()
                .filter(|v| **v == 0.0);
            assert_eq!(zeros.count(), COEFFICIENTS - weak, "{case}");
            assert!(document.suggestion.is_some() != document.suggestion_absent.is_some());
            // At a pole, or where nothing tells it from one, the trace is lost.
            if config.site.latitude_deg.abs() > 89.999_999 {
                assert_eq!(o.unknowns, COEFFICIENTS, "{case}");
                assert_eq!(o.order_of(&Combination::input_trace()), None, "{case}");
            }
        }
    }
}

#[cfg(all(feature = "cli", feature = "report"))]
#[test]
fn the_commands_give_their_results_at_a_pole_and_near_an_axis() {
    let desk = tempfile::tempdir().unwrap();
    let run = |args: &[&str]| {
        let output = std::process::Command::new(assert_cmd::cargo::cargo_bin!("scheme-opt"))
            .args(args)
            .current_dir(desk.path())
            .output()
            .unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{args:?}: {stderr}");
        String::from_utf8(output.stdout).unwrap()
    };
    let write = |name: &str, text: &str| std::fs::write(desk.path().join(name), text).unwrap();
    let read = |name: &str| std::fs::read_to_string(desk.path().join(name)).unwrap();
    write(
        "pole.toml",
        "[site]\nlatitude_deg = 90\n[objective]\n\
         accept_unobservable = [\"D_IX\", \"D_IY\", \"D_IZ\"]\n\
         total_time_s = 3000\n[search]\nstarts = 2\nmax_positions = 4\nallow_tumbling = true\n",
    );
    write(
        "near.csv",
        "alpha_deg,beta_deg,gamma_deg,dwell_s\n0,0,0,1000\n180,0,0,1000\n0.01,0,0,1000\n",
    );
    run(&["search", "pole.toml", "-q", "-o", "out"]);
    assert!(read("out/report.html").contains("D_IX + D_IY + D_IZ"));
    let at_pole = ["-s", "out/schedule.csv", "-p", "pole.toml"];
    run(&[&["evaluate"], &at_pole[..]].concat());
    assert!(run(&[&["analyze"], &at_pole[..]].concat()).contains("At a pole"));
    // Terminal and page say the same words.
    let text = run(&["analyze", "-s", "near.csv"]);
    run(&["evaluate", "-s", "near.csv", "--report", "near.html"]);
    let words = "D_OX shows only by 0.010 deg of tilt, at order 1.";
    assert!(text.contains(words), "{text}");
    assert!(read("near.html").contains(&words.replace("deg/h", "°/h")));
    assert!(text.contains("1~"), "{text}");
}
