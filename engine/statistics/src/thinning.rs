//! Thinning of long lines to the resolution of a picture. Of consecutive points in one column of the picture, the
//! first, the lowest, the highest and the last are kept. No peak is lost, and the line looks the same.

/// Largest number of points of a line that is not thinned.
pub const MOST: usize = 5000;

/// The indices of the kept items. `column` gives the column of the picture in which an item lies, `height` its height
/// there.
#[must_use]
pub fn kept<T>(items: &[T], column: impl Fn(&T) -> i64, height: impl Fn(&T) -> f64) -> Vec<usize> {
    let mut kept = Vec::new();
    let mut start = 0;
    for group in items.chunk_by(|one, next| column(one) == column(next)) {
        let by_height = |one: &usize, other: &usize| height(&group[*one]).total_cmp(&height(&group[*other]));
        let ends = [0, group.len() - 1].map(Some);
        let extremes = [
            (0..group.len()).min_by(by_height),
            (0..group.len()).max_by(by_height),
        ];
        let mut of_group: Vec<usize> = ends.into_iter().chain(extremes).flatten().collect();
        of_group.sort_unstable();
        of_group.dedup();
        kept.extend(of_group.into_iter().map(|index| start + index));
        start += group.len();
    }
    kept
}

/// Like [`kept`], for values at steps; a column is a thousandth of their range.
#[must_use]
pub fn kept_steps(values: &[(u64, f64)]) -> Vec<usize> {
    const COLUMNS: u128 = 1000;
    let [Some(first), Some(last)] = [values.first(), values.last()].map(|it| it.map(|(step, _)| *step))
    else {
        return Vec::new();
    };
    let range = u128::from(last - first) + 1;
    let column = |(step, _): &(u64, f64)| {
        let part = u128::from(step - first) * COLUMNS / range;
        i64::try_from(part).unwrap_or(i64::MAX)
    };
    kept(values, column, |(_, value)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ends_and_extremes_of_a_column_stay() {
        let items = [(0, 5.0), (0, 1.0), (0, 2.0), (0, 9.0), (0, 3.0), (1, 7.0)];
        assert_eq!(kept(&items, |it| it.0, |it| it.1), [0, 1, 3, 4, 5]);
        assert!(kept(&[], |it: &(i64, f64)| it.0, |it| it.1).is_empty());
    }

    #[test]
    fn a_long_series_keeps_its_peaks() {
        let peak = 123_457;
        let values: Vec<(u64, f64)> = (0..300_000)
            .map(|step| (step, if step == peak { 9.0 } else { 0.0 }))
            .collect();
        let kept = kept_steps(&values);
        assert!(kept.len() <= 4000 && kept.contains(&123_457) && kept.contains(&299_999));
        assert!(kept_steps(&[]).is_empty());
    }

    proptest! {
        #[test]
        fn the_extremes_of_every_column_stay(heights in prop::collection::vec(-1e3f64..1e3, 1..300), wide in 1i64..50) {
            let items: Vec<(i64, f64)> = (0..).zip(heights).map(|(at, y): (i64, f64)| (at / wide, y)).collect();
            let kept: Vec<(i64, f64)> = kept(&items, |it| it.0, |it| it.1).into_iter().map(|at| items[at]).collect();
            for column in 0..=items.last().unwrap().0 {
                let of = |items: &[(i64, f64)]| -> Vec<f64> {
                    items.iter().filter(|it| it.0 == column).map(|it| it.1).collect()
                };
                let (all, few) = (of(&items), of(&kept));
                prop_assert!(few.len() <= 4);
                let most = |values: &[f64]| values.iter().copied().fold(f64::MIN, f64::max);
                let least = |values: &[f64]| values.iter().copied().fold(f64::MAX, f64::min);
                prop_assert_eq!((most(&few), least(&few)), (most(&all), least(&all)));
                prop_assert_eq!((few.first(), few.last()), (all.first(), all.last()));
            }
        }
    }
}
