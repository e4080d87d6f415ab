//! Tests of products, sums and steps.

use super::*;

/// Numbers whose products and sums need rounding.
#[allow(clippy::cast_possible_truncation, reason = "any number will do")]
fn numbers(seed: u64, n: usize) -> Vec<f32> {
    (0..n as u64)
        .map(|i| normal(mix(seed << 32 | i)) as f32)
        .collect()
}

/// One entry of a product, one chain at a time, compiled without wider vectors.
fn entry(n: usize, a: impl Fn(usize) -> f32, b: impl Fn(usize) -> f32) -> f32 {
    let chain = |from: usize| (from..n.min(from + 512)).fold(0.0f32, |c, k| a(k).mul_add(b(k), c));
    let further = (512..n).step_by(512).map(chain);
    further.fold(chain(0), |sum, chain| sum + chain)
}

#[test]
fn entries_are_chains_in_every_layout() {
    for (rows, k, columns) in [
        (3, 5, 7),
        (1, 512, 1),
        (4, 513, 33),
        (2, 1300, 65),
        (5, 1, 3),
        (2, 0, 2),
    ] {
        let (a, b) = (numbers(1, rows * k), numbers(2, k * columns));
        let (a, b) = (Matrix::new(&a, rows, k), Matrix::new(&b, k, columns));
        let turned = |matrix: Matrix, rows: usize| -> Vec<f32> {
            // The product with the unit matrix is exact.
            let unit: Vec<f32> = (0..rows * rows).map(|i| f32::from(i % (rows + 1) == 0)).collect();
            product(matrix.transposed(), Matrix::new(&unit, rows, rows))
        };
        let (a_turned, b_turned) = (turned(a, rows), turned(b, k));
        let nn = product(a, b);
        assert_eq!(product(Matrix::new(&a_turned, k, rows).transposed(), b), nn);
        assert_eq!(product(a, Matrix::new(&b_turned, columns, k).transposed()), nn);
        for row in 0..rows {
            for column in 0..columns {
                let want = entry(k, |at| a_turned[at * rows + row], |at| b_turned[column * k + at]);
                assert_eq!(nn[row * columns + column].to_bits(), want.to_bits());
            }
        }
    }
}

#[test]
fn row_sums_add_rows_in_their_order() {
    let values = numbers(3, 700 * 5);
    let sums = row_sums(Matrix::new(&values, 700, 5));
    for (column, sum) in sums.into_iter().enumerate() {
        let of = |rows: std::ops::Range<usize>| rows.fold(0.0f32, |sum, row| sum + values[row * 5 + column]);
        assert_eq!(sum, of(0..BLOCK) + of(BLOCK..700));
    }
}

#[test]
fn sums_follow_the_stated_tree() {
    assert_eq!(sum(&[]).to_bits(), 0);
    assert_eq!(sum(&[-0.0]).to_bits(), 0);
    let by_hand = |values: &[f32]| {
        let lane = |l: usize| {
            values
                .iter()
                .skip(l)
                .step_by(32)
                .fold(0.0f32, |sum, value| sum + value)
        };
        let mut lanes: Vec<f32> = (0..32).map(lane).collect();
        while lanes.len() > 1 {
            let half = lanes.len() / 2;
            lanes = (0..half).map(|l| lanes[l] + lanes[l + half]).collect();
        }
        lanes[0]
    };
    for n in [1, 31, 33, 1024] {
        let values = numbers(4, n);
        assert_eq!(sum(&values), by_hand(&values));
    }
    let values = numbers(5, 3 * SUM_BLOCK + 17);
    let blocks: Vec<f32> = values.chunks(SUM_BLOCK).map(by_hand).collect();
    assert_eq!(sum(&values), by_hand(&blocks));
}

#[test]
fn squares_are_exact() {
    let tiny = f32::from_bits(1);
    assert_eq!(sum_of_squares(&[tiny]), f64::from(tiny) * f64::from(tiny));
    assert_eq!(sum_of_squares(&[3.0, 4.0]), 25.0);
}

#[test]
fn clipping_scales_to_the_largest_norm() {
    let (mut one, mut two) = (vec![3.0], vec![0.0, 4.0]);
    assert_eq!(clip(&mut [&mut one, &mut two], 1.0), 5.0);
    assert_eq!([one[0], two[1]], [3.0 * 0.2f32, 4.0 * 0.2]);
    let before = (one.clone(), two.clone());
    assert!(clip(&mut [&mut one, &mut two], 2.0) < 1.1);
    assert_eq!((one, two), before);
}

#[test]
fn a_step_by_hand_and_moments_that_fade() {
    let (mut x, mut m, mut v) = ([1.0f32], [0.0], [0.0]);
    let rates = Rates::at(1, 0.1, [0.9, 0.999]);
    rates.descend(&mut x, &[2.0], &mut m, &mut v);
    assert!((x[0] - 0.9).abs() < 1e-6 && (m[0] - 0.2).abs() < 1e-7 && (v[0] - 0.004).abs() < 1e-7);
    let mut states = Vec::new();
    for t in 2..4000 {
        Rates::at(t, 0.1, [0.9, 0.999]).descend(&mut x, &[0.0], &mut m, &mut v);
        states.push(m[0]);
    }
    assert!(states.iter().all(|m| !m.is_subnormal()) && m[0] == 0.0);
}

#[test]
fn a_moving_average_by_hand() {
    let mut target = [1.0, -2.0];
    follow(&mut target, &[3.0, 2.0], 0.25);
    assert_eq!(target, [1.5, -1.0]);
}

proptest! {
    #[test]
    fn an_entry_depends_on_its_row_and_column_alone(rows in 1..6_usize, k in 1..600_usize, columns in 1..40_usize) {
        let (a, b) = (numbers(6, rows * k), numbers(7, k * columns));
        let all = product(Matrix::new(&a, rows, k), Matrix::new(&b, k, columns));
        let last = product(Matrix::new(&a[(rows - 1) * k..], 1, k), Matrix::new(&b, k, columns));
        prop_assert_eq!(&all[(rows - 1) * columns..], &last[..]);
    }

    #[test]
    fn a_step_of_one_entry_is_that_of_many(seed in 0..1000_u64, n in 1..70_usize) {
        let (x, g) = (numbers(seed, n), numbers(seed + 1000, n));
        let rates = Rates::at(3, 1e-3, [0.9, 0.999]);
        let (mut all, mut m, mut v) = (x.clone(), vec![0.1; n], vec![0.2; n]);
        rates.descend(&mut all, &g, &mut m, &mut v);
        for at in 0..n {
            let mut one = [x[at]];
            rates.descend(&mut one, &g[at..=at], &mut [0.1], &mut [0.2]);
            prop_assert_eq!(one[0].to_bits(), all[at].to_bits());
        }
    }
}
