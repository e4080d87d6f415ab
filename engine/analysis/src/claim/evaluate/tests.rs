//! Claims decided by seeds.

use super::*;
use crate::claim::parse;
use proptest::prelude::*;
use statistics::{MeanEstimate, comparison::two_sample_permutation_test, statement::StatementOutcome};

/// Evaluates `text`; agent `a` has `left` and `b` has `right`, both with seeds counted from the given first one.
fn outcome(text: &str, (first_a, a): (u64, &[f64]), (first_b, b): (u64, &[f64])) -> ClaimVerdict {
    evaluate(
        &parse(text).unwrap(),
        None,
        &|operand, _| {
            let (first, values) = match operand.agent.as_str() {
                "a" => (first_a, a),
                "b" => (first_b, b),
                _ => return None,
            };
            Some((first..).zip(values.iter().copied()).collect())
        },
        &|_| NumberOrigin::Measured,
        &Seeds::default(),
    )
}

fn word(text: &str, a: &[f64], b: &[f64]) -> &'static str {
    outcome(text, (0, a), (0, b)).verdict.word()
}

/// Differences 1, 2, 3: mean 2, standard error 1/sqrt(3), t(0.975, 2) = 4.3027, interval 2 -+ 2.484.
#[test]
fn paired_by_hand() {
    let verdict = outcome("a.x > b.x", (0, &[11.0, 22.0, 33.0]), (0, &[10.0, 20.0, 30.0]));
    assert_eq!(
        (verdict.verdict, verdict.n, verdict.paired),
        (ClaimOutcome::Inconclusive, 3, true)
    );
    assert!((verdict.interval.unwrap().high - 4.484).abs() < 5e-4);
    // (t(0.975, n - 1) + 0.8416) / sqrt(n) is 2.012 with four seeds and 1.618 with five.
    assert_eq!((verdict.difference, verdict.more_seeds), (Some(2.0), Some(2)));
    assert_eq!(verdict.permutation.unwrap().smallest_p, 0.25);
    assert!(verdict.permutation.unwrap().note(0.05).unwrap().ends_with("0.25") && verdict.notes.is_empty());
}

#[test]
fn every_direction() {
    let (high, low) = ([10.0, 10.5, 11.0, 10.2], [5.0, 5.2, 5.4, 4.9]);
    for (claim, expected) in [
        ("a.x > b.x", "SUPPORTED"),
        ("a.x >= 1.5 * b.x", "SUPPORTED"),
        ("a.x >= 3 * b.x", "REFUTED"),
        ("a.x < b.x", "REFUTED"),
        ("b.x <= a.x", "SUPPORTED"),
        ("b.x > a.x", "REFUTED"),
        ("a.x > 9", "SUPPORTED"),
        ("9 > a.x", "REFUTED"),
        ("a.x > 10.4", "INCONCLUSIVE"),
        ("a.x > c.x", "NOT RUN"),
        ("a.x within 10 % of 10.2", "SUPPORTED"),
        ("a.x within 1 of b.x", "REFUTED"),
        ("a.x within 0.5 of 10", "INCONCLUSIVE"),
        ("a.x ~ 2 * b.x", "SUPPORTED"),
    ] {
        assert_eq!(word(claim, &high, &low), expected, "{claim}");
    }
}

/// Differences of mean 0.1 with a standard error of 0.2 over five seeds: the 95 % interval is 0.1 -+ 0.555.
#[test]
fn what_differs_too_little_to_matter_is_equivalent() {
    let a = [9.534_314, 9.817_157, 10.1, 10.382_843, 10.665_686];
    let held = |text: &str, min_effect: Option<f64>| {
        let values = |_: &Operand, _| Some((0..).zip(a).collect());
        evaluate(
            &parse(text).unwrap(),
            min_effect,
            &values,
            &|_| NumberOrigin::Measured,
            &Seeds::default(),
        )
    };
    let word = |text: &str, min_effect| held(text, min_effect).verdict.word();
    for (text, min_effect, expected) in [
        ("a.x > 10", None, "INCONCLUSIVE"),
        ("a.x > 10", Some(0.65), "INCONCLUSIVE"),
        ("a.x > 10", Some(0.66), "EQUIVALENT"),
        ("a.x <= 10", Some(0.66), "EQUIVALENT"),
        ("10 > a.x", Some(0.66), "EQUIVALENT"),
        ("a.x > 9", Some(2.0), "EQUIVALENT"),
        ("a.x < 9", Some(2.0), "EQUIVALENT"),
        // The interval of the difference from 9 is 1.1 -+ 0.555.
        ("a.x > 9", Some(0.5), "SUPPORTED"),
        ("a.x > 9", Some(0.6), "DIRECTION ONLY"),
        ("a.x < 9", Some(0.6), "REFUTED"),
        ("9 < a.x", Some(0.6), "DIRECTION ONLY"),
    ] {
        assert_eq!(word(text, min_effect), expected, "{text} {min_effect:?}");
    }
    // Fewer seeds are needed to show that a difference does not matter than to show which side is ahead.
    let [direction, alike] = [None, Some(0.65)].map(|min_effect| held("a.x > 10", min_effect).more_seeds);
    assert!(alike.unwrap() < direction.unwrap(), "{alike:?} {direction:?}");
}

/// Pairing removes the common part of both seeds.
#[test]
fn common_seeds_are_paired_and_others_are_not() {
    let (a, b) = ([1.1, 10.2, 100.1, 1000.3], [1.0, 10.0, 100.0, 1000.0]);
    assert_eq!(word("a.x > b.x", &a, &b), "SUPPORTED");
    let apart = outcome("a.x > b.x", (0, &a), (50, &b));
    assert_eq!(
        (apart.verdict, apart.paired, apart.n),
        (ClaimOutcome::Inconclusive, false, 4)
    );
    assert!(apart.notes[0].contains("unrelated samples"));
    // Seeds 2 to 5 against 0 to 3: two in common are too few to pair.
    assert!(!outcome("a.x > b.x", (2, &a), (0, &b)).paired);
    assert_eq!(outcome("a.x > b.x", (1, &a), (0, &b)).n, 3);
}

#[test]
fn too_few_seeds_decide_nothing() {
    let two = outcome("a.x > b.x", (0, &[100.0, 100.1]), (0, &[1.0, 1.1]));
    assert_eq!(
        (two.verdict, two.n, two.paired, two.more_seeds),
        (ClaimOutcome::Inconclusive, 2, true, Some(1))
    );
    assert_eq!(two.notes[0], "too few seeds (2): at least 3 are needed");
    let one = outcome("a.x > 1", (0, &[100.0]), (0, &[]));
    assert_eq!(
        (one.verdict, one.interval, one.more_seeds),
        (ClaimOutcome::Inconclusive, None, None)
    );
    assert_eq!(word("a.x > b.x", &[1.0, 2.0, 3.0], &[]), "NOT RUN");
}

#[test]
fn seeds_that_make_no_difference_decide() {
    let verdict = outcome("a.x > b.x", (0, &[2.5, 2.5]), (0, &[1.5, 1.5]));
    assert_eq!(verdict.verdict, ClaimOutcome::Supported);
    assert_eq!(verdict.notes.last().unwrap(), "the seeds make no difference");
    assert_eq!(word("a.x > b.x", &[1.5, 1.5], &[1.5, 1.5]), "REFUTED");
    assert_eq!(word("a.x >= b.x", &[1.5, 1.5], &[1.5, 1.5]), "SUPPORTED");
    assert_eq!(word("a.x > b.x", &[2.5], &[1.5]), "INCONCLUSIVE");
}

/// Differences that are equal to the bit decide as those with noise of rounding do.
#[test]
fn pairs_with_the_same_fractional_difference_decide() {
    let (a, b) = ([1.5, 1.75, 2.25], [1.25, 1.5, 2.0]);
    let verdict = outcome("b.x < a.x", (0, &a), (0, &b));
    assert_eq!((verdict.verdict, verdict.n), (ClaimOutcome::Supported, 3));
    assert_eq!(verdict.notes, ["every seed gives the same difference"]);
    assert_eq!(word("a.x < b.x", &a, &b), "REFUTED");
    assert_eq!(word("a.x > b.x", &a[..2], &b[..2]), "INCONCLUSIVE");
}

/// Three successes of three occur with probability 0.73 if one in ten fails.
#[test]
fn counts_that_are_alike_decide_nothing() {
    let verdict = outcome("a.x > 0.9", (0, &[1.0, 1.0, 1.0]), (0, &[]));
    assert_eq!(
        (verdict.verdict, verdict.more_seeds),
        (ClaimOutcome::Inconclusive, None)
    );
    assert_eq!(verdict.notes, [verdict::ALIKE]);
    assert_eq!(
        word("a.x > b.x", &[4.0, 5.0, 7.0], &[3.0, 4.0, 6.0]),
        "INCONCLUSIVE"
    );
    assert_eq!(word("a.x > 0.5 * b.x", &[1.0; 4], &[1.0; 4]), "INCONCLUSIVE");
    assert_eq!(word("a.x > b.x", &[2.0, 3.0, 2.0], &[0.0; 3]), "SUPPORTED");
}

/// Three runs each, imported and so not paired. The right side is uncertain too: its edge of 110 % is left with an
/// interval that reaches beyond 0, although the difference lies within a tenth of the right mean.
#[test]
fn a_margin_in_percent_of_seeds_has_edges_that_they_move() {
    let (a, b) = ([-19.1, -18.4, -18.63], [-17.5, -18.3, -18.2]);
    let text = "a.x within 10 % of b.x";
    let verdict = outcome(text, (0, &a), (50, &b));
    let Evidence::BetweenMeans {
        above_low,
        above_high,
        ..
    } = &verdict.statement.as_ref().unwrap().looks[0].evidence
    else {
        panic!("{verdict:?}")
    };
    let by_hand = |factor: f64| {
        let edge: Vec<f64> = b.iter().map(|value| factor * value).collect();
        MeanEstimate::difference(&a, &edge)
    };
    // A negative mean has its larger edge at 90 %.
    assert_eq!((above_low, above_high), (&by_hand(1.1), &by_hand(0.9)));
    let interval = above_low.interval(0.9).unwrap();
    assert_eq!(verdict.verdict == ClaimOutcome::Supported, interval.low >= 0.0);
    // A number on the right has fixed edges.
    assert_eq!(word("a.x within 10 % of -18.5", &a, &[]), "SUPPORTED");
    assert_eq!(word(text, &[1.0, 1.1, 1.2], &[9.0, 9.5, 9.1]), "REFUTED");
    assert_eq!(
        word(text, &[10.1, 10.2, 10.15], &[10.0, 10.1, 10.05]),
        "SUPPORTED"
    );
}

proptest! {
    /// The edges of a margin in percent are those of the two claims of a direction.
    #[test]
    fn within_percent_is_both_directions_at_once(
        a in prop::collection::vec(8.0..12.0, 5),
        b in prop::collection::vec(8.0..12.0, 5),
    ) {
        let within = outcome("a.x within 20 % of b.x", (0, &a), (0, &b)).statement.unwrap();
        let decided = |text: &str| {
            let statement = outcome(text, (0, &a), (0, &b)).statement.unwrap();
            statement.decide_at(verdict::ALPHA).outcome
        };
        let sides = [decided("a.x >= 0.8 * b.x"), decided("a.x <= 1.2 * b.x")];
        let expected = match sides {
            [StatementOutcome::Holds, StatementOutcome::Holds] => StatementOutcome::Holds,
            _ if sides.contains(&StatementOutcome::Fails) => StatementOutcome::Fails,
            _ => StatementOutcome::Open,
        };
        prop_assert_eq!(within.decide().outcome, expected);
    }
}

/// Further seeds of the study add nothing if the spread of three imported runs decides.
#[test]
fn no_seed_is_asked_for_that_cannot_be_added() {
    let own = [10.1, 10.3, 10.2, 10.0, 10.4];
    let others = [1.0, 5.0, 9.0];
    let claim = parse("a.x > b.x").unwrap();
    let held = |origin: &dyn Fn(&Operand) -> NumberOrigin| {
        let values = |operand: &Operand| -> Vec<(u64, f64)> {
            if operand.agent == "a" {
                (0..).zip(own).collect()
            } else {
                (50..).zip(others).collect()
            }
        };
        evaluate(&claim, None, &|it, _| Some(values(it)), origin, &Seeds::default())
    };
    let imported = |it: &Operand| match it.agent.as_str() {
        "b" => NumberOrigin::Imported,
        _ => NumberOrigin::Measured,
    };
    let (grown, fixed) = (held(&|_| NumberOrigin::Measured), held(&imported));
    assert_eq!((grown.interval, grown.n), (fixed.interval, fixed.n));
    assert_eq!(
        (grown.verdict, fixed.verdict),
        (ClaimOutcome::Inconclusive, ClaimOutcome::Inconclusive)
    );
    assert!(grown.more_seeds.is_some() && fixed.more_seeds.is_none());
}

/// Equal seeds do not mean equal episodes if one side is reported by a program; two programs are paired.
#[test]
fn reported_numbers_are_not_paired_with_measurements() {
    let (a, b) = ([11.0, 22.0, 33.0], [10.0, 20.0, 30.0]);
    let claim = parse("a.own > b.x").unwrap();
    let held = |reported: &[&str]| {
        let values = |operand: &Operand| (0..).zip(if operand.agent == "a" { a } else { b }).collect();
        let origin = |operand: &Operand| match reported.contains(&operand.agent.as_str()) {
            true => NumberOrigin::Reported,
            false => NumberOrigin::Measured,
        };
        evaluate(
            &claim,
            None,
            &|it, _| Some(values(it)),
            &origin,
            &Seeds::default(),
        )
    };
    for reported in [&["a"], &["b"]] {
        let verdict = held(reported);
        let welch = MeanEstimate::difference(&a, &b).interval(0.95);
        assert_eq!(
            (verdict.paired, verdict.size()),
            (false, "n = 3 seeds".to_owned())
        );
        assert_eq!(verdict.interval, welch);
        assert_eq!(verdict.permutation, Some(two_sample_permutation_test(&a, &b)));
        assert!(
            verdict.notes[0].starts_with("one side is reported by a program"),
            "{:?}",
            verdict.notes
        );
    }
    assert!(held(&[]).paired && held(&["a", "b"]).paired);
}

#[test]
fn values_that_are_not_finite_decide_nothing() {
    assert_eq!(word("a.x > 1", &[2.0, f64::NAN, 3.0], &[]), "INCONCLUSIVE");
    assert_eq!(word("a.x > 1", &[2.0, f64::INFINITY, 3.0], &[]), "INCONCLUSIVE");
}
#[test]
fn the_order_and_the_episodes_of_seeds_do_not_matter() {
    let claim = parse("a.x > b.x").unwrap();
    let a = |operand: &Operand| operand.agent == "a";
    let one = evaluate(
        &claim,
        None,
        &|operand, _| {
            Some(if a(operand) {
                vec![(0, 3.0), (1, 4.0), (2, 6.0)]
            } else {
                vec![(0, 1.0), (1, 1.5), (2, 1.0)]
            })
        },
        &|_| NumberOrigin::Measured,
        &Seeds::default(),
    );
    let other = evaluate(
        &claim,
        None,
        &|operand, _| {
            Some(if a(operand) {
                vec![(2, 6.0), (0, 3.0), (1, 3.5), (1, 4.5)]
            } else {
                vec![(1, 1.5), (2, 1.0), (0, 1.0)]
            })
        },
        &|_| NumberOrigin::Measured,
        &Seeds::default(),
    );
    assert_eq!(one, other);
}

/// Nine successes of ten against none of ten, and against numbers.
#[test]
fn shares_of_successes_are_no_means() {
    let claim = |text: &str| {
        let share = |agent: &str| if agent == "a" { 9 } else { 0 };
        let seeds = |operand: &Operand| {
            (0..10)
                .map(|seed| (seed, f64::from(u8::from(seed < share(&operand.agent)))))
                .collect()
        };
        evaluate(
            &parse(text).unwrap(),
            None,
            &|operand, _| Some(seeds(operand)),
            &|_| NumberOrigin::Measured,
            &Seeds::default(),
        )
    };
    // The exact 95 % limits of 9 of 10 are 0.555 and 0.9975.
    assert_eq!(claim("a.success > 0.55").verdict, ClaimOutcome::Supported);
    assert_eq!(claim("0.55 < a.success").verdict, ClaimOutcome::Supported);
    assert_eq!(claim("a.success > 0.56").verdict, ClaimOutcome::Inconclusive);
    assert_eq!(claim("a.success < 0.5").verdict, ClaimOutcome::Refuted);
    let two = claim("a.success > b.success");
    assert_eq!(
        (two.verdict, two.paired, two.difference),
        (ClaimOutcome::Supported, false, Some(0.9))
    );
    // Ten seeds without any success do not prove that there never is one.
    assert_eq!(claim("b.success < 0.1").verdict, ClaimOutcome::Inconclusive);
}

/// The number of fresh seeds that would decide is useful once the plan has none left.
#[test]
fn a_design_says_how_many_seeds_would_decide_after_its_last_look() {
    let design = Some(statistics::spending::SequentialDesign::new(vec![3, 6]));
    let values = [1.0, 2.0, 9.0, -3.0, 4.0, 5.0];
    let at = |complete: usize| {
        let seeds = Seeds {
            design: design.clone(),
            limits: [3, 6][..complete].to_vec(),
            rounds: 0,
        };
        let of = |_: &Operand, _| Some((0..).zip(values).collect());
        evaluate(
            &parse("a.x > 0").unwrap(),
            None,
            &of,
            &|_| NumberOrigin::Measured,
            &seeds,
        )
    };
    let [first, last] = [1, 2].map(at);
    assert_eq!([first.verdict, last.verdict], [ClaimOutcome::Inconclusive; 2]);
    assert_eq!(first.more_seeds, None);
    assert!(last.more_seeds.is_some_and(|more| more > 0), "{last:?}");
}

#[test]
fn planned_looks_stop_at_the_first_decision() {
    let design = Some(statistics::spending::SequentialDesign::new(vec![3, 6, 9]));
    let values = [5.0, 5.5, 4.5, -20.0, -30.0, -40.0];
    let from = |first: u64, complete: usize| {
        let seeds = Seeds {
            design: design.clone(),
            limits: [3, 6, 9][..complete].iter().map(|most| first + most).collect(),
            rounds: 0,
        };
        evaluate(
            &parse("a.x > 0").unwrap(),
            None,
            &|_, _| Some((first..).zip(values).collect()),
            &|_| NumberOrigin::Measured,
            &seeds,
        )
    };
    let at = |complete| from(0, complete);
    assert_eq!(
        (at(0).verdict, at(0).statement),
        (ClaimOutcome::Inconclusive, None)
    );
    assert_eq!((at(1).verdict, at(1).n), (ClaimOutcome::Supported, 3));
    assert_eq!(
        (at(2).verdict, at(2).n, at(2).stage.unwrap().look),
        (ClaimOutcome::Supported, 3, 1)
    );
    assert_eq!(
        (from(100, 2).n, from(100, 2).stage),
        (3, at(2).stage),
        "the first seed is no matter"
    );
}

proptest! {
    #[test]
    fn a_mirrored_claim_has_the_same_outcome(pairs in prop::collection::vec((0.0..2.0, 0.5..2.5), 1..9),
        factor in 0.5..2.0) {
        let (a, b): (Vec<f64>, Vec<f64>) = pairs.into_iter().unzip();
        let claims = [format!("a.x > {factor} * b.x"), format!("{factor} * b.x < a.x")];
        let [one, other] = claims.map(|claim| outcome(&claim, (0, &a), (0, &b)));
        prop_assert_eq!((one.verdict, one.n, one.more_seeds), (other.verdict, other.n, other.more_seeds));
        prop_assert_eq!(one.permutation.map(|test| test.p), other.permutation.map(|test| test.p));
    }

    #[test]
    fn a_claim_and_its_contrary_are_never_both_supported(a in prop::collection::vec(0.0..9.0, 3..9),
        limit in 0.0..9.0) {
        let [above, below] = [">", "<="].map(|relation| outcome(&format!("a.x {relation} \
                                                                          {limit}"), (0, &a), (0,
                                                                              &[])).verdict);
        prop_assert_eq!(above == ClaimOutcome::Supported, below == ClaimOutcome::Refuted);
        prop_assert_eq!(above == ClaimOutcome::Refuted, below == ClaimOutcome::Supported);
    }
}
