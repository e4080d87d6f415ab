//! The images match their description in the header, and classifying them is a task.

use super::*;

const SIZES: [usize; 3] = [8, 16, 32];

#[test]
fn an_image_depends_on_its_seed_and_index_alone() {
    for size in SIZES {
        let ten = images(7, 0..10, size);
        let later = images(7, 6..9, size);
        assert_eq!(ten.image(6), later.image(0));
        assert_eq!(ten.image(6), image(7, 6, size));
        assert_eq!(later.labels(), Some(&[6, 7, 8][..]));
        assert_ne!(image(7, 6, size), image(8, 6, size));
    }
}

/// A change of any byte would change the data of every study with these images.
#[test]
fn the_bytes_stay() {
    let sums = SIZES.map(|size| {
        let bytes = images(1, 0..50, size);
        let weighed = bytes.pixels().iter().zip(1u64..);
        weighed.map(|(byte, place)| u64::from(*byte) * place).sum::<u64>()
    });
    assert_eq!(sums, [5_461_638_294, 87_294_590_826, 1_395_870_197_665]);
}

#[test]
fn classes_are_balanced() {
    let images = images(3, 5..1005, 8);
    for class in 0..10 {
        let labels = images.labels().unwrap();
        assert_eq!(labels.iter().filter(|label| **label == class).count(), 100);
    }
    assert_eq!(FIGURES.len(), CLASS_NAMES.len());
}

#[test]
fn images_of_one_class_differ_by_more_than_noise() {
    for class in 0..10 {
        let (one, other) = (image(1, class, 16), image(1, class + 10, 16));
        let apart = one
            .iter()
            .zip(&other)
            .map(|(one, other)| f64::from(one.abs_diff(*other)));
        assert!(
            apart.sum::<f64>() / one.len() as f64 > 6.0 * NOISE * 255.0,
            "class {class}"
        );
    }
}

#[test]
fn bytes_fill_their_range() {
    for size in SIZES {
        let images = images(2, 0..300, size);
        let mut seen = [0u32; 256];
        images
            .pixels()
            .iter()
            .for_each(|byte| seen[usize::from(*byte)] += 1);
        let all = images.pixels().len() as f64;
        assert!(seen.iter().all(|times| *times > 0));
        // Clamping is the exception.
        assert!(
            f64::from(seen[0] + seen[255]) < 0.1 * all,
            "{} of {all}",
            seen[0] + seen[255]
        );
    }
}

#[test]
fn a_scene_is_the_same_at_every_size() {
    // The mean of 16 pixels at 32 is a pixel at 8, except for noise, rounding and clamping.
    for index in 0..20 {
        let (large, small) = (image(4, index, 32), image(4, index, 8));
        let mut apart = 0.0;
        for (place, byte) in small.iter().enumerate() {
            let (row, column, channel) = (place / 24, place / 3 % 8, place % 3);
            let block = (0..16).map(|k| (4 * row + k / 4) * 32 + 4 * column + k % 4);
            let mean = block
                .map(|pixel| f64::from(large[pixel * 3 + channel]))
                .sum::<f64>()
                / 16.0;
            apart += (f64::from(*byte) - mean).abs() / small.len() as f64;
        }
        assert!(apart < NOISE * 255.0, "image {index}: {apart}");
    }
}

#[test]
fn figures_cover_as_much_as_their_formulas_say() {
    // Area within the square of side 4 about the origin.
    let area = |figure: Figure| {
        let at = |index: u32| (f64::from(index) + 0.5) / 250.0 - 2.0;
        let points = (0..1000).flat_map(|x| (0..1000).map(move |y| (at(x), at(y))));
        16.0 * points.filter(|(x, y)| figure.covers(*x, *y)).count() as f64 / 1e6
    };
    let side = 1.3 * 3f64.sqrt();
    let pi = std::f64::consts::PI;
    for (figure, expected) in [
        (Figure::Disc, pi),
        (Figure::Ring, 0.9 * pi),
        (Figure::Square, 1.7 * 1.7),
        (Figure::Triangle, 3f64.sqrt() / 4.0 * side * side),
        (Figure::Cross, 2.0 * 2.3 * 0.6 - 0.36),
        (Figure::Half, 8.0),
        (Figure::TwoDots, 0.5 * pi),
    ] {
        assert!(
            (area(figure) - expected).abs() < 0.02,
            "{figure:?}: {} {expected}",
            area(figure)
        );
    }
}

#[test]
fn noise_has_mean_0_and_variance_1() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let draws: Vec<f64> = (0..40_000).map(|_| about_normal(&mut rng)).collect();
    let mean = draws.iter().sum::<f64>() / draws.len() as f64;
    let variance = draws.iter().map(|draw| draw * draw).sum::<f64>() / draws.len() as f64;
    assert!(
        mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03,
        "{mean} {variance}"
    );
}

/// The fraction of other images whose class has the nearest mean.
fn nearest_mean_accuracy(size: usize, label_of: impl Fn(u64) -> u8) -> f64 {
    const TRAINING: u64 = 1500;
    let per_image = size * size * CHANNELS;
    let mut means = vec![vec![0.0; per_image]; 10];
    for index in 0..TRAINING {
        let mean = &mut means[usize::from(label_of(index))];
        let image = image(11, index, size);
        mean.iter_mut()
            .zip(image)
            .for_each(|(mean, byte)| *mean += f64::from(byte) * 10.0 / TRAINING as f64);
    }
    let nearest = |image: &[u8]| {
        let distance = |mean: &Vec<f64>| {
            let pairs = mean.iter().zip(image);
            pairs
                .map(|(mean, byte)| (mean - f64::from(*byte)).powi(2))
                .sum::<f64>()
        };
        let distances: Vec<f64> = means.iter().map(distance).collect();
        (0..10u8)
            .min_by(|a, b| distances[usize::from(*a)].total_cmp(&distances[usize::from(*b)]))
            .unwrap()
    };
    let test = images(12, 0..500, size);
    let right = (0..500).filter(|index| nearest(test.image(*index)) == label(*index as u64));
    right.count() as f64 / 500.0
}

#[test]
fn classes_can_be_told_apart_but_not_by_their_means_alone() {
    // 0.1 is chance, with a standard error of 0.013.
    for size in SIZES {
        let accuracy = nearest_mean_accuracy(size, label);
        assert!((0.16..0.6).contains(&accuracy), "{size} pixels: {accuracy}");
    }
    // Arbitrary labels: the same measure gives chance.
    let shuffled = nearest_mean_accuracy(8, |index| label(index / 10 * 7 + index / 3));
    assert!((0.05..0.15).contains(&shuffled), "{shuffled}");
}
