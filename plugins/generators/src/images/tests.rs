//! Sets of images, their numbers and their sizes.

use super::*;
use serde::Deserialize;

const NAMES: &[&str] = &["one", "other"];

fn grey(size: usize, bytes: &[u8]) -> Vec<u8> {
    assert_eq!(bytes.len(), size * size);
    bytes.iter().flat_map(|byte| [*byte; CHANNELS]).collect()
}

#[test]
fn every_byte_comes_back_from_its_number() {
    for byte in 0..=u8::MAX {
        assert_eq!(to_byte(from_byte(byte)), byte);
    }
    assert_eq!(from_byte(0), -1.0);
    assert_eq!(from_byte(255), 1.0);
}

#[test]
fn numbers_outside_of_the_range_are_clamped() {
    assert_eq!(
        to_bytes(&[-1.5, -1.0, 0.0, 1.0, 7.0, f32::INFINITY]),
        [0, 0, 128, 255, 255, 255]
    );
    assert_eq!(to_byte(f32::NAN), 0);
}

#[test]
fn halving_is_the_mean_of_two_by_two_pixels_of_each_channel() {
    let mut image = grey(2, &[1, 2, 3, 4]);
    // Green: 0, 0, 0, 255; blue: 4, 4, 5, 5, whose mean is a half.
    for (pixel, (green, blue)) in image.chunks_exact_mut(3).zip([(0, 4), (0, 4), (0, 5), (255, 5)]) {
        pixel[1..].copy_from_slice(&[green, blue]);
    }
    assert_eq!(resized(&image, 2, 1), [3, 64, 5]);
}

#[test]
fn quartering_reads_the_middle_and_halving_twice_reads_all() {
    let mut bytes = [0; 16];
    for middle in [5, 6, 9, 10] {
        bytes[middle] = 200;
    }
    let image = grey(4, &bytes);
    assert_eq!(resized(&image, 4, 1), [200; 3]);
    assert_eq!(resized(&resized(&image, 4, 2), 2, 1), [50; 3]);
}

#[test]
fn an_image_of_its_own_size_stays() {
    let image: Vec<u8> = (0..75).collect();
    assert_eq!(resized(&image, 5, 5), image);
}

#[derive(Deserialize)]
struct Resizing {
    from: usize,
    to: usize,
    input: Vec<u8>,
    output: Vec<u8>,
}

#[test]
fn sizes_that_do_not_divide_are_those_of_scipy() {
    let text = include_str!("../../../../tests/fixtures/generators/resized.json");
    let cases: Vec<Resizing> = serde_json::from_str(text).unwrap();
    assert_eq!(cases.len(), 4);
    for case in cases {
        assert_eq!(
            resized(&case.input, case.from, case.to),
            case.output,
            "{} to {}",
            case.from,
            case.to
        );
    }
}

#[test]
fn a_set_of_images_gives_batches_in_the_order_asked_for() {
    let pixels = [grey(1, &[0]), grey(1, &[255]), grey(1, &[51])].concat();
    let images = Images::new(1, pixels, Some(vec![0, 1, 1]), NAMES);
    assert_eq!((images.count(), images.size()), (3, 1));
    assert_eq!(images.image(2), [51; 3]);
    assert_eq!(
        images.batch(&[1, 0, 1]),
        [1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0]
    );
}

#[test]
fn resizing_a_set_resizes_each_image_and_keeps_the_labels() {
    let pixels = [grey(2, &[0, 0, 0, 4]), grey(2, &[8, 8, 8, 8])].concat();
    let images = Images::new(2, pixels, Some(vec![1, 0]), NAMES).resized(1);
    assert_eq!(images.pixels(), [1, 1, 1, 8, 8, 8]);
    assert_eq!(images.labels(), Some(&[1, 0][..]));
}

#[test]
fn sets_are_joined_with_labels_only_if_both_have_them() {
    let labelled = Images::new(1, vec![1; 3], Some(vec![1]), NAMES);
    let unlabelled = Images::new(1, vec![2; 6], None, NAMES);
    let both = labelled.clone().followed_by(&labelled);
    assert_eq!((both.count(), both.labels()), (2, Some(&[1, 1][..])));
    let mixed = labelled.followed_by(&unlabelled);
    assert_eq!(
        (mixed.pixels(), mixed.labels()),
        (&[1, 1, 1, 2, 2, 2, 2, 2, 2][..], None)
    );
}

#[test]
#[should_panic(expected = "a label is an index")]
fn a_label_without_a_class_is_refused() {
    let _ = Images::new(1, vec![0; 3], Some(vec![2]), NAMES);
}
