use crate::attitude::Position;
use crate::covariance::fast::coloured::tests::{for_each_platform, log};
use crate::covariance::fast::wide::How;
use crate::covariance::fast::wide::tests::{Random, positions, timeline};
use crate::covariance::{CovarianceModel, TickRule};
use crate::motion::Timeline;

/// Of every platform and kind of step, every position exchanged for others: the same as the test with that
/// position in it, worked out whole.
#[test]
fn an_exchange_is_the_whole_test_with_it() {
    let mut random = Random(23);
    let mut worst = 0.0_f64;
    for_each_platform(|name, number, platform| {
        let model = CovarianceModel::new(platform);
        let mut all = positions(&mut random, platform, 4);
        // Moves of their own are not exchanged.
        for position in &mut all {
            (position.move_s, position.move_measured, position.change_deg) = (None, None, None);
        }
        let before = timeline(platform, &all);
        let rule = [TickRule::Relaxed, TickRule::Filter][number % 2];
        let cuts = model.coloured_cuts(&before, rule).unwrap().unwrap();
        let first = before.positions().start;
        // Where the test returns to its first position that is another one too.
        let from = usize::from(before.legs().len() > before.positions().end);
        for k in from..all.len() {
            let others = positions(&mut random, platform, 3);
            let others: Vec<Position> = others.iter().map(|p| p.position).collect();
            let parts: Vec<Timeline> = others
                .iter()
                .map(|p| before.exchange(platform, k, *p).0)
                .collect();
            let around = cuts.around(first + k..first + k + 1);
            let found = model.coloured_values_between(&parts, rule, &around, log);
            for (position, found) in others.iter().zip(found) {
                let mut exchanged = all.clone();
                exchanged[k].position = *position;
                let whole = timeline(platform, &exchanged);
                let expected = model.value(&whole, rule, log).unwrap();
                let error = (found.unwrap() - expected).abs();
                worst = worst.max(error);
                assert!(error < 1e-9, "{name}, {k}: {error:e}");
            }
        }
    });
    println!("worst {worst:e}");
}

/// By the rows where sums of squares lose digits.
#[test]
fn rows_and_sums_of_squares_agree() {
    let mut random = Random(29);
    for_each_platform(|name, _, platform| {
        let model = CovarianceModel::new(platform);
        let coloured = model.coloured.as_deref().unwrap();
        let all = positions(&mut random, platform, 4);
        let before = timeline(platform, &all);
        let cuts = model
            .coloured_cuts(&before, TickRule::Relaxed)
            .unwrap()
            .unwrap();
        let leg = before.positions().start + 1;
        let around = cuts.around(leg..leg + 1);
        let part = before.part(leg..leg + 1);
        let by_rows = How {
            by_rows: true,
            in_step: true,
        };
        let [a, b] = [by_rows, How::default()].map(|how| {
            model
                .coloured_value_of_part(
                    coloured,
                    (&part, &around),
                    TickRule::Relaxed,
                    how,
                    &mut log,
                )
                .unwrap()
        });
        assert!((a - b).abs() < 1e-9, "{name}: {:e}", a - b);
        // The part as it was.
        let whole = model.value(&before, TickRule::Relaxed, log).unwrap();
        assert!((b - whole).abs() < 1e-9, "{name}: {:e}", b - whole);
    });
}
