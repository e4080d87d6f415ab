//! Verdicts on published values.

use super::*;
use crate::tests::{assert_close, numbers, reference};
use proptest::prelude::*;

fn with_failed(published: f64, margin: f64, values: &[f64], failed: usize) -> Judgement {
    let seeds: Vec<(u64, f64)> = (0..).zip(values.iter().copied()).collect();
    judge(
        Reference::within(published, margin),
        Sample::of(&seeds),
        failed,
        &Seeds::default(),
        false,
    )
}

fn judged(published: f64, margin: f64, values: &[f64]) -> Judgement {
    with_failed(published, margin, values, 0)
}

fn verdict(published: f64, margin: f64, values: &[f64]) -> Verdict {
    judged(published, margin, values).verdict
}

#[test]
fn equivalence_agrees_with_statsmodels() {
    let mut reproduced = 0;
    for case in reference()["equivalence"].as_array().unwrap() {
        let number = |key: &str| case[key].as_f64().unwrap();
        let values = numbers(&case["values"]);
        let judgement = judged(number("published"), number("margin"), &values);
        let expected = number("p") < 0.05 && (values.len() >= FEWEST_SEEDS);
        assert_eq!(
            judgement.verdict == Verdict::Reproduced,
            expected,
            "{judgement:?}"
        );
        reproduced += u32::from(judgement.verdict == Verdict::Reproduced);
    }
    assert!((1..9).contains(&reproduced));
}

#[test]
fn intervals_agree_with_scipy() {
    for case in reference()["one_sample"].as_array().unwrap() {
        let interval = judged(0.0, 1.0, &numbers(&case["values"])).interval.unwrap();
        let ends = numbers(&case["interval_90"]);
        assert_close(interval.low, ends[0], 1e-11);
        assert_close(interval.high, ends[1], 1e-11);
    }
}

#[test]
fn the_band_decides() {
    // Mean 100, standard deviation 1, five seeds: 90 % interval 100 -+ 0.953.
    let values = [
        98.735_088_936,
        99.367_544_468,
        100.0,
        100.632_455_532,
        101.264_911_064,
    ];
    assert_eq!(verdict(100.0, 1.0, &values), Verdict::Reproduced);
    assert_eq!(verdict(103.0, 2.0, &values), Verdict::Differs);
    // Half a unit inside the edge: (t(0.95, n - 1) + 0.8416) / sqrt(n) falls below 0.5 at n = 27 (2.547 /
    // 5.196 = 0.490).
    for published in [101.5, 102.5] {
        let judgement = judged(published, 2.0, &values);
        assert_eq!(
            (judgement.verdict, judgement.more_seeds),
            (Verdict::Inconclusive, Some(22))
        );
    }
    assert_eq!(judged(102.0, 2.0, &values).more_seeds, None);
}

#[test]
fn few_seeds_and_none() {
    let one = judged(5.0, 1.0, &[5.0]);
    assert_eq!(
        (one.verdict, one.interval, one.more_seeds),
        (Verdict::Inconclusive, None, None)
    );
    assert_eq!(one.note(), "too few seeds (1): at least 3 are needed");
    assert_eq!(verdict(5.0, 1.0, &[5.0, 5.001]), Verdict::Inconclusive);
    assert_eq!(verdict(5.0, 1.0, &[]), Verdict::NotRun);
    assert_eq!(with_failed(5.0, 1.0, &[], 3).verdict, Verdict::Failed);
    assert_eq!(verdict(5.0, 1.0, &[5.0, f64::NAN]), Verdict::Failed);
}

#[test]
fn no_spread() {
    assert_eq!(verdict(0.1, 0.0, &[0.1, 0.1, 0.1]), Verdict::Reproduced);
    assert_eq!(verdict(0.1, 0.01, &[0.105, 0.105]), Verdict::Reproduced);
    assert_eq!(verdict(0.1, 0.01, &[0.12, 0.12]), Verdict::Differs);
}

#[test]
fn an_uncertain_published_value_widens_the_interval() {
    let values = [99.0, 100.0, 101.0, 100.0, 100.0];
    let exact = judged(100.0, 1.0, &values);
    let seeds: Vec<(u64, f64)> = (0..).zip(values).collect();
    let uncertain = Reference {
        runs: Some((2.0, 5)),
        ..Reference::within(100.0, 1.0)
    };
    let judgement = judge(uncertain, Sample::of(&seeds), 0, &Seeds::default(), false);
    assert_eq!(
        (exact.verdict, judgement.verdict),
        (Verdict::Reproduced, Verdict::Inconclusive)
    );
    let (narrow, wide) = (exact.interval.unwrap(), judgement.interval.unwrap());
    assert!(wide.low < narrow.low && narrow.high < wide.high && wide.contains(100.0));
    assert_eq!(judgement.mean, Some(100.0));
}

#[test]
fn a_published_share_of_few_runs_is_uncertain_too() {
    let judged = |successes: u64, share: Option<Share>| {
        let seeds: Vec<(u64, f64)> = (0..20)
            .map(|seed| (seed, f64::from(u8::from(seed < successes))))
            .collect();
        let reference = Reference {
            share,
            ..Reference::within(0.667, 0.3)
        };
        judge(reference, Sample::of(&seeds), 0, &Seeds::default(), true)
    };
    let (of_3, of_300) = (
        Share { successes: 2, n: 3 },
        Share {
            successes: 200,
            n: 300,
        },
    );
    // Against an exact 0.667 a third of the seeds is too few; against two of three runs it is inconclusive.
    assert_eq!(judged(3, None).verdict, Verdict::Differs);
    assert_eq!(judged(3, Some(of_3)).verdict, Verdict::Inconclusive);
    assert_eq!(judged(3, Some(of_300)).verdict, Verdict::Differs);
    assert_eq!(judged(13, None).verdict, Verdict::Reproduced);
    assert_eq!(judged(13, Some(of_3)).verdict, Verdict::Inconclusive);
    assert_eq!(judged(13, Some(of_300)).verdict, Verdict::Reproduced);
    // Mean and interval still belong to the reproduced share, and the number of seeds is that of the study.
    let [exact, uncertain] = [None, Some(of_3)].map(|share| judged(13, share));
    assert_close(uncertain.mean.unwrap(), 0.65, 1e-12);
    assert_eq!((uncertain.n, exact.mean), (20, Some(0.65)));
    let [narrow, wide] = [exact, uncertain].map(|it| it.interval.unwrap());
    assert!(wide.low < narrow.low && narrow.high < wide.high && wide.contains(0.65));
}

#[test]
fn planned_looks_are_taken_one_by_one() {
    let design = Some(SequentialDesign::new(vec![3, 6, 9]));
    let seeds: Vec<(u64, f64)> = (0..).zip([100.0, 104.0, 96.0, 100.0, 100.2, 99.8]).collect();
    let at = |complete: usize, values: &[(u64, f64)]| {
        judge(
            Reference::within(100.0, 3.0),
            Sample::of(values),
            0,
            &Seeds {
                design: design.clone(),
                limits: [3, 6, 9][..complete].to_vec(),
                rounds: 0,
            },
            false,
        )
    };
    let (none, first, second) = (at(0, &seeds[..2]), at(1, &seeds), at(2, &seeds));
    assert_eq!(
        (none.verdict, none.note().as_str()),
        (Verdict::Inconclusive, "the first of 3 looks is not complete")
    );
    assert_eq!((first.verdict, first.n), (Verdict::Inconclusive, 3));
    assert_eq!(
        first.note(),
        "open at look 1 of 3, with 3 seeds; `run` adds seeds"
    );
    assert_eq!((second.verdict, second.n), (Verdict::Reproduced, 6));
    assert_eq!(second.note(), "decided at look 2 of 3, with 6 seeds");
}

/// One success of three published as a share of 0.33.
#[test]
fn shares_have_exact_intervals() {
    let seeds: Vec<(u64, f64)> = (0..20)
        .map(|seed| (seed, f64::from(u8::from(seed % 4 != 0))))
        .collect();
    let judgement = judge(
        Reference::within(0.0, 0.4),
        Sample::of(&seeds),
        0,
        &Seeds::default(),
        true,
    );
    assert_eq!(
        (judgement.verdict, judgement.mean),
        (Verdict::Differs, Some(0.75))
    );
}

#[test]
fn words_and_margin() {
    assert_eq!(Verdict::NotRun.to_string(), "NOT RUN");
    assert_eq!(format!("{:>8}", Verdict::Failed), "  FAILED");
    assert_eq!((default_margin(-40.0), default_margin(0.0)), (2.0, 0.0));
}

/// `n` values with exactly this mean and sample standard deviation: pairs at equal distance, the mean itself
/// if odd.
fn sample(mean: f64, sd: f64, n: u32) -> Vec<f64> {
    let distance = sd * (f64::from(n - 1) / f64::from(n - n % 2)).sqrt();
    (0..n)
        .map(|i| {
            if i == n - n % 2 {
                mean
            } else if i % 2 == 0 {
                mean - distance
            } else {
                mean + distance
            }
        })
        .collect()
}

proptest! {
    #[test]
    fn the_advised_number_of_seeds_decides_where_mean_and_spread_stay(mean in 95.0..105.0,
        margin in 0.5..4.0) {
        let judgement = judged(100.0, margin, &sample(mean, 1.0, 4));
        if let (Verdict::Inconclusive, Some(more)) = (judgement.verdict, judgement.more_seeds) {
            prop_assert_ne!(verdict(100.0, margin, &sample(mean, 1.0, 4 + more)), Verdict::Inconclusive);
        }
    }

    #[test]
    fn a_wider_margin_never_unmakes_a_reproduction(values in prop::collection::vec(90.0..110.0, 2..12),
        margin in 0.0..20.0) {
        if verdict(100.0, margin, &values) == Verdict::Reproduced {
            prop_assert_eq!(verdict(100.0, margin + 1.0, &values), Verdict::Reproduced);
        }
    }
}
