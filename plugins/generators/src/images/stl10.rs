//! STL-10 in its binary version (A. Coates, H. Lee and A. Y. Ng 2011, "An analysis of single-layer networks in
//! unsupervised feature learning"): `train_X.bin` with `train_y.bin`, `test_X.bin` with `test_y.bin`, and
//! `unlabeled_X.bin`.
//!
//! An image is 27 648 bytes: 96 x 96 red values COLUMN by column from the left, each from the top, then green, then
//! blue. A label is one byte, 1 to 10. Images are resized as they are read, since the unlabelled file has 100 000.

use super::{CHANNELS, ImageFileError, Images, resized, whole_images};
use std::path::Path;

/// Height and width of an image in the files.
pub const SIZE: usize = 96;

/// The size that generators are trained at, in AutoGAN and E2GAN alike.
pub const TRAINING_SIZE: usize = 48;

/// The classes, in the order of their labels; the files count labels from 1, [`Images`] from 0.
pub const CLASS_NAMES: &[&str] = &[
    "airplane", "bird", "car", "cat", "deer", "dog", "horse", "monkey", "ship", "truck",
];

const PLANE: usize = SIZE * SIZE;
const RECORD: usize = CHANNELS * PLANE;

/// A file with its path, which is used in messages only.
#[derive(Debug, Clone, Copy)]
pub struct File<'a> {
    /// Path of the file.
    pub path: &'a Path,
    /// Content of the file.
    pub bytes: &'a [u8],
}

/// Images of `size x size` pixels with their labels.
///
/// # Errors
/// [`ImageFileError::Size`] where the images are none or cut off, [`ImageFileError::Labels`] where labels are not as
/// many, [`ImageFileError::Label`] for one that is not 1 to 10.
///
/// # Panics
/// Where `size` is 0 or above 96.
pub fn labelled(images: File<'_>, labels: File<'_>, size: usize) -> Result<Images, ImageFileError> {
    let count = count(images)?;
    if labels.bytes.len() != count {
        return Err(ImageFileError::Labels {
            path: labels.path.into(),
            found: labels.bytes.len(),
            images: images.path.into(),
            expected: count,
        });
    }
    let from_zero = labels.bytes.iter().enumerate();
    let classes = from_zero
        .map(|(image, label)| class(labels.path, image, *label))
        .collect::<Result<_, _>>()?;
    Ok(Images::new(
        size,
        pixels(images.bytes, size),
        Some(classes),
        CLASS_NAMES,
    ))
}

/// Images of `size x size` pixels without labels.
///
/// # Errors
/// [`ImageFileError::Size`] where they are none or cut off.
///
/// # Panics
/// Where `size` is 0 or above 96.
pub fn unlabelled(images: File<'_>, size: usize) -> Result<Images, ImageFileError> {
    count(images)?;
    Ok(Images::new(size, pixels(images.bytes, size), None, CLASS_NAMES))
}

fn count(images: File<'_>) -> Result<usize, ImageFileError> {
    let expected = "a multiple of 27648: of each image 3 x 9216 colours";
    whole_images(images.path, images.bytes, RECORD, expected)
}

fn class(path: &Path, image: usize, found: u8) -> Result<u8, ImageFileError> {
    if (1..=CLASS_NAMES.len()).contains(&usize::from(found)) {
        return Ok(found - 1);
    }
    Err(ImageFileError::Label {
        path: path.into(),
        image,
        found,
        expected: "1 to 10",
    })
}

fn pixels(bytes: &[u8], size: usize) -> Vec<u8> {
    let images = bytes.chunks_exact(RECORD);
    images
        .flat_map(|record| resized(&channels_last(record), SIZE, size))
        .collect()
}

/// `[3, width, height]` to `[height, width, 3]`.
fn channels_last(record: &[u8]) -> Vec<u8> {
    let places = (0..SIZE).flat_map(|row| (0..SIZE).map(move |column| column * SIZE + row));
    places
        .flat_map(|at| [record[at], record[PLANE + at], record[2 * PLANE + at]])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file whose image `i` has red = row, green = 100 + column, blue = 200 + i.
    fn images_of(count: u8) -> Vec<u8> {
        let record = |image: u8| {
            let rows = (0..PLANE).map(|at| (at % SIZE) as u8);
            let columns = (0..PLANE).map(|at| (100 + at / SIZE) as u8);
            rows.chain(columns).chain(std::iter::repeat_n(200 + image, PLANE))
        };
        (0..count).flat_map(record).collect()
    }

    fn read(images: &[u8], labels: &[u8], size: usize) -> Result<Images, ImageFileError> {
        let [images_at, labels_at] = ["train_X.bin", "train_y.bin"].map(Path::new);
        let images = File {
            path: images_at,
            bytes: images,
        };
        let labels = File {
            path: labels_at,
            bytes: labels,
        };
        labelled(images, labels, size)
    }

    #[test]
    fn planes_by_columns_become_pixels_and_labels_count_from_zero() {
        let images = read(&images_of(2), &[10, 1], SIZE).unwrap();
        assert_eq!((images.count(), images.size()), (2, 96));
        assert_eq!(images.labels(), Some(&[9, 0][..]));
        for (image, row, column) in [(0, 0, 0), (0, 0, 95), (1, 95, 0), (1, 3, 70)] {
            let pixel = &images.image(image)[(row * SIZE + column) * CHANNELS..][..CHANNELS];
            assert_eq!(pixel, [row as u8, 100 + column as u8, 200 + image as u8]);
        }
    }

    #[test]
    fn images_are_halved_as_they_are_read() {
        let bytes = images_of(2);
        let small = read(&bytes, &[1, 2], TRAINING_SIZE).unwrap();
        assert_eq!(small, read(&bytes, &[1, 2], SIZE).unwrap().resized(48));
        // Rows 6 and 7 and columns 20 and 21: their means end on a half, which goes up.
        assert_eq!(
            small.image(1)[(3 * 48 + 10) * CHANNELS..][..CHANNELS],
            [7, 121, 201]
        );
    }

    #[test]
    fn the_unlabelled_file_has_no_labels() {
        let bytes = images_of(1);
        let file = |bytes| File {
            path: Path::new("unlabeled_X.bin"),
            bytes,
        };
        let images = unlabelled(file(&bytes), SIZE).unwrap();
        assert_eq!((images.count(), images.labels()), (1, None));
        assert!(matches!(
            unlabelled(file(&[]), SIZE),
            Err(ImageFileError::Size { found: 0, .. })
        ));
    }

    #[test]
    fn a_file_that_is_cut_off_is_refused_with_its_size() {
        let error = read(&images_of(1)[1..], &[1], SIZE).unwrap_err();
        let message =
            "`train_X.bin` has 27647 bytes; expected a multiple of 27648: of each image 3 x 9216 colours";
        assert_eq!(error.to_string(), message);
    }

    #[test]
    fn labels_that_are_too_few_are_refused() {
        let message = |labels: &[u8]| read(&images_of(2), labels, SIZE).unwrap_err().to_string();
        let expected = "labels in `train_y.bin`: 1; expected 2, one for each image of `train_X.bin`";
        assert_eq!(message(&[1]), expected);
        assert_eq!(message(&[]), expected.replace(": 1", ": 0"));
    }

    #[test]
    fn a_label_of_zero_is_refused_with_its_image() {
        for wrong in [0, 11] {
            let error = read(&images_of(3), &[1, wrong, wrong], SIZE).unwrap_err();
            let message = "`train_y.bin` has the label 11 at image 1 (the first is 0); expected 1 to 10";
            assert_eq!(error.to_string(), message.replace("11", &wrong.to_string()));
        }
    }
}
