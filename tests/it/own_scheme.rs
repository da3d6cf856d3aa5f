//! Searches that begin with the scheme one has.

use scheme_opt::documents::{EvaluationDocument, ResultDocument};
use scheme_opt::{Control, Freedom, Schedule, ScheduledPosition, StartingScheme, Study};

use crate::support::{Random, random_positions};

/// A stand where moves take time, one that is limited, an index table; small problems.
const STANDS: [&str; 3] = [
    "[motion]\nslew_rate_deg_per_s = 1\nsettle_s = 10\n",
    "[gimbals]\nbeta_deg = [-60, 60]\nalpha_deg = [-200, 200]\n[motion]\nreturn_to_start = true\n\
     slew_rate_deg_per_s = 2\n",
    "[gimbals]\nstep_deg = 45\n",
];
const SMALL: &str = "[objective]\ntotal_time_s = 3000\n[search]\nstarts = 1\nmax_positions = 5\n";

fn study(stand: usize) -> Study {
    Study::from_toml(&format!("{}{SMALL}", STANDS[stand])).unwrap()
}

/// A random scheme that the stand can run in the time.
fn scheme(random: &mut Random, stand: usize) -> Vec<ScheduledPosition> {
    let position = |p: scheme_opt::Position| {
        let [a, b, c] = p.to_deg();
        match stand {
            1 => scheme_opt::Position::from_deg(a, b / 3.0, c),
            2 => {
                let on = |deg: f64| (deg / 45.0).round() * 45.0;
                scheme_opt::Position::from_deg(on(a), on(b), on(c))
            }
            _ => p,
        }
    };
    let positions = random_positions(random, 4).into_iter().map(position);
    positions
        .map(|p| ScheduledPosition::new(p, random.between(80.0, 400.0)))
        .collect()
}

fn score(document: &EvaluationDocument) -> f64 {
    document.score.value.unwrap()
}

fn searched(study: Study, scheme: StartingScheme) -> (ResultDocument, Schedule) {
    let found = study.starting_from(scheme).unwrap();
    let found = found.search(&Control::default()).unwrap();
    (found.document().clone(), found.schedule().clone())
}

/// Every freedom in turn, with pinned positions and without.
#[test]
fn no_result_is_worse_than_the_scheme_it_began_with() {
    let freedoms = [
        Freedom::Everything,
        Freedom::Dwells,
        Freedom::Order,
        Freedom::DwellsAndOrder,
    ];
    for case in 0..20 {
        let mut random = Random::of_case(case as u64 + 1);
        let stand = case % STANDS.len();
        let freedom = freedoms[case % freedoms.len()];
        let mut positions = scheme(&mut random, stand);
        for p in &mut positions {
            p.pinned = random.unit() < 0.3;
        }
        let given = Schedule::new(positions.clone()).unwrap();
        let before = study(stand).evaluate(&given).unwrap();
        let begun = StartingScheme::new("mine", given.clone()).only(freedom);
        let (document, found) = searched(study(stand), begun);
        let what = format!("case {case}, {freedom}");
        assert!(
            score(&document.evaluation) <= score(before.document()),
            "{what}"
        );
        assert!(document.evaluation.total_time_s <= 3000.0 + 1e-6, "{what}");
        let from = document.from.unwrap();
        assert_eq!(from.criterion, Some(before.document().score.criterion));
        assert!(from.beyond.is_empty(), "{what}: {:?}", from.beyond);
        let names: Vec<&str> = from.only.iter().map(String::as_str).collect();
        assert_eq!(names, freedom.names());
        kept(&positions, &found, freedom, &what);
    }
}

/// What had to stay is there to the bit.
fn kept(given: &[ScheduledPosition], found: &Schedule, freedom: Freedom, what: &str) {
    let found = found.positions();
    let angles = |p: &ScheduledPosition| p.position.degrees();
    let pinned = |all: &[ScheduledPosition]| -> Vec<[f64; 3]> {
        all.iter().filter(|p| p.pinned).map(angles).collect()
    };
    assert_eq!(pinned(given), pinned(found), "{what}");
    let (last, end) = (given.len() - 1, found.len() - 1);
    if given[0].pinned {
        assert_eq!(angles(&given[0]), angles(&found[0]), "{what}");
    }
    if given[last].pinned {
        assert_eq!(angles(&given[last]), angles(&found[end]), "{what}");
    }
    let of = |all: &[ScheduledPosition]| -> Vec<([f64; 3], f64)> {
        all.iter().map(|p| (angles(p), p.dwell_s)).collect()
    };
    let sorted = |mut all: Vec<([f64; 3], f64)>| {
        all.sort_by(|a, b| a.partial_cmp(b).unwrap());
        all
    };
    let angles_of = |all: Vec<([f64; 3], f64)>| -> Vec<[f64; 3]> {
        all.into_iter().map(|(angles, _)| angles).collect()
    };
    match freedom {
        Freedom::Everything => {}
        Freedom::Dwells => assert_eq!(angles_of(of(given)), angles_of(of(found)), "{what}"),
        Freedom::Order => assert_eq!(sorted(of(given)), sorted(of(found)), "{what}"),
        Freedom::DwellsAndOrder => assert_eq!(
            angles_of(sorted(of(given))),
            angles_of(sorted(of(found))),
            "{what}"
        ),
    }
}

/// Angles in another turn, ways that are not the short ones.
#[test]
fn dwells_alone_change_no_bit_of_the_rest() {
    let text = "alpha_deg,beta_deg,gamma_deg,dwell_s,alpha_change_deg,beta_change_deg,gamma_change_deg\n\
                270.125,20,30,300,,,\n-50.0000001,-40,400,250,39.8749999,-60,10\n\
                130,30,123.456789012,200,-179.9999999,70,-276.543210988\n17,10,-80,400,,,\n";
    let given = Schedule::from_csv(text).unwrap();
    let scheme = StartingScheme::new("mine", given.clone()).only(Freedom::Dwells);
    let (document, found) = searched(study(0), scheme);
    let from = document.from.unwrap();
    assert!(from.ratio.unwrap() > 1.0 && !from.is_the_result);
    for (a, b) in given.positions().iter().zip(found.positions()) {
        assert_eq!(a.position.degrees(), b.position.degrees());
        // The short way need not be said.
        assert!(b.change_deg.is_none() || a.change_deg == b.change_deg);
        assert!(b.dwell_s >= 60.0);
    }
    assert!(found.positions()[2].change_deg.is_some());
    let test =
        scheme_opt::internals::motion::Test::from(study(0).config().platform.check().unwrap());
    let moves = |schedule: &Schedule| -> Vec<[f64; 3]> {
        let timeline = scheme_opt::internals::motion::Timeline::new(&test, schedule).unwrap();
        let arrivals = timeline.legs().iter().filter_map(|leg| leg.arrival);
        arrivals.map(|m| m.change).collect()
    };
    assert_eq!(moves(&given), moves(&found));
}

#[test]
fn the_front_and_the_shortest_test_are_no_worse_either() {
    let spec = "[objective.spec_deg_per_h]\ndefault = 0.05\n";
    let mut random = Random::of_case(7);
    let given = Schedule::new(scheme(&mut random, 0)).unwrap();
    let toml = |mode: &str| {
        let objective = format!("[objective]\nmode = \"{mode}\"\n");
        let small = SMALL.replace("[objective]\n", &objective);
        Study::from_toml(&format!("{}{small}front_points = 3\n{spec}", STANDS[0])).unwrap()
    };
    for freedom in [Freedom::Everything, Freedom::Dwells] {
        let begun = || StartingScheme::new("mine", given.clone()).only(freedom);
        let before = toml("pareto").evaluate(&given).unwrap();
        let before = before.document();
        let (front, _) = searched(toml("pareto"), begun());
        let as_good = |p: &scheme_opt::documents::ParetoRecord| {
            p.total_time_s <= before.total_time_s && p.criterion <= before.score.criterion * 1.01
        };
        assert!(
            front.pareto.iter().any(as_good),
            "{freedom}: {:?}",
            front.pareto
        );
        let before = toml("time").evaluate(&given).unwrap();
        let before = before.document();
        let (shortest, _) = searched(toml("time"), begun());
        match before.score.criterion <= 1.0 {
            true => assert!(shortest.evaluation.total_time_s <= before.total_time_s),
            false => assert!(shortest.evaluation.score.criterion <= before.score.criterion),
        }
    }
    let order = StartingScheme::new("mine", given).only(Freedom::Order);
    let study = toml("time").starting_from(order).unwrap();
    let error = study.search(&Control::default()).unwrap_err();
    assert_eq!(error.key(), Some("objective.mode"));
}

/// A scheme out of range and too long is a start by its nearest form, and it is said why no more is
/// promised.
#[test]
fn what_is_beyond_the_limits_is_said() {
    let at = |deg: [f64; 3], dwell_s| {
        ScheduledPosition::new(
            scheme_opt::Position::from_deg(deg[0], deg[1], deg[2]),
            dwell_s,
        )
    };
    let long = vec![
        at([10.0, 20.0, 30.0], 2000.0),
        at([-80.0, 40.0, 60.0], 2000.0),
    ];
    let mut short = long.clone();
    (short[0].dwell_s, short[1].dwell_s) = (30.0, 500.0);
    let mut out = short.clone();
    out[0].position = scheme_opt::Position::from_deg(10.0, 75.0, 30.0);
    for (stand, positions, says) in [
        (0, long, "more than objective.total_time_s = 3000 s"),
        (0, short.clone(), "the dwell of position 1"),
        (1, out.clone(), "positions[0].beta_deg"),
    ] {
        let schedule = Schedule::new(positions).unwrap();
        let (document, _) = searched(study(stand), StartingScheme::new("mine", schedule));
        let from = document.from.unwrap();
        assert!(from.beyond[0].contains(says), "{:?}", from.beyond);
        assert!(!from.is_the_result);
    }
    // What has to stay must be possible.
    out[0].pinned = true;
    let refused = |stand: usize, positions: Vec<ScheduledPosition>, freedom| {
        let scheme = StartingScheme::new("mine", Schedule::new(positions).unwrap());
        study(stand)
            .starting_from(scheme.only(freedom))
            .unwrap_err()
    };
    let error = refused(1, out.clone(), Freedom::Everything);
    assert_eq!(error.key(), Some("positions[0].beta_deg"));
    let mut moving = short.clone();
    moving[1].move_s = Some(500.0);
    let error = refused(0, moving, Freedom::Dwells);
    assert_eq!(error.key(), Some("positions[1].move_s"));
    let mut many = vec![at([10.0, 20.0, 30.0], 100.0); 6];
    many.iter_mut().for_each(|p| p.pinned = true);
    let error = refused(0, many.clone(), Freedom::Everything);
    assert_eq!(error.key(), Some("search.max_positions"));
    let many: Vec<_> = many.into_iter().cycle().take(60).collect();
    assert!(refused(0, many, Freedom::Dwells).is_infeasible());
    assert!(refused(0, vec![short[0]; 501], Freedom::Everything).is_input());
}

/// By the library, with a scheme for the rest too.
#[test]
fn the_rest_of_a_test_begins_with_a_scheme_too() {
    let mut random = Random::of_case(3);
    let mut all = scheme(&mut random, 0);
    let rest = Schedule::new(all.split_off(2)).unwrap();
    let done = Schedule::new(all).unwrap();
    let interrupted = || study(0).after(done.clone()).unwrap();
    let before = interrupted().evaluate(&rest).unwrap();
    let (document, _) = searched(interrupted(), StartingScheme::new("rest", rest));
    assert!(score(&document.evaluation) <= score(before.document()));
    let record = document.done.unwrap();
    let recorded = Schedule::try_from(&record.schedule).unwrap();
    assert_eq!(recorded.to_json(), done.to_json());
    assert!(record.total_time_s < document.evaluation.total_time_s);
}
