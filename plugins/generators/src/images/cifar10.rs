//! CIFAR-10 in its binary version (A. Krizhevsky 2009, "Learning multiple layers of features from tiny images"):
//! `data_batch_1.bin` to `data_batch_5.bin` and `test_batch.bin`, 10 000 images each.
//!
//! An image is 3073 bytes: its label, 0 to 9, then 32 x 32 red values, row by row from the top, then green, then
//! blue.

use super::{CHANNELS, ImageFileError, Images, whole_images};
use std::path::Path;

/// Height and width of an image.
pub const SIZE: usize = 32;

/// The classes, in the order of their labels.
pub const CLASS_NAMES: &[&str] = &[
    "airplane",
    "automobile",
    "bird",
    "cat",
    "deer",
    "dog",
    "frog",
    "horse",
    "ship",
    "truck",
];

const PLANE: usize = SIZE * SIZE;
const RECORD: usize = 1 + CHANNELS * PLANE;

/// The images of one file; [`Images::followed_by`] joins several files. `path` is used in messages only.
///
/// # Errors
/// [`ImageFileError::Size`] where the file is empty or cut off, [`ImageFileError::Label`] for a label above 9.
pub fn images(path: &Path, bytes: &[u8]) -> Result<Images, ImageFileError> {
    let expected = "a multiple of 3073: of each image a label and 3 x 1024 colours";
    let count = whole_images(path, bytes, RECORD, expected)?;
    let mut labels = Vec::with_capacity(count);
    let mut pixels = Vec::with_capacity(count * CHANNELS * PLANE);
    for (image, record) in bytes.chunks_exact(RECORD).enumerate() {
        labels.push(label(path, image, record[0])?);
        let planes = &record[1..];
        pixels.extend((0..PLANE).flat_map(|at| [planes[at], planes[PLANE + at], planes[2 * PLANE + at]]));
    }
    Ok(Images::new(SIZE, pixels, Some(labels), CLASS_NAMES))
}

fn label(path: &Path, image: usize, found: u8) -> Result<u8, ImageFileError> {
    if usize::from(found) < CLASS_NAMES.len() {
        return Ok(found);
    }
    Err(ImageFileError::Label {
        path: path.into(),
        image,
        found,
        expected: "0 to 9",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file whose image `i` has the label `labels[i]`, red = row, green = 100 + column, blue = 200 + i.
    fn file(labels: &[u8]) -> Vec<u8> {
        let record = |(image, label): (usize, &u8)| {
            let mut bytes = vec![*label];
            bytes.extend((0..PLANE).map(|at| (at / SIZE) as u8));
            bytes.extend((0..PLANE).map(|at| (100 + at % SIZE) as u8));
            bytes.extend([200 + image as u8; PLANE]);
            bytes
        };
        labels.iter().enumerate().flat_map(record).collect()
    }

    fn read(bytes: &[u8]) -> Result<Images, ImageFileError> {
        images(Path::new("data/data_batch_1.bin"), bytes)
    }

    #[test]
    fn planes_by_rows_become_pixels() {
        let images = read(&file(&[9, 0, 3])).unwrap();
        assert_eq!((images.count(), images.size()), (3, 32));
        assert_eq!(images.labels(), Some(&[9, 0, 3][..]));
        assert_eq!(images.class_names()[9], "truck");
        for (image, row, column) in [(0, 0, 0), (1, 0, 31), (2, 30, 1)] {
            let pixel = &images.image(image)[(row * SIZE + column) * CHANNELS..][..CHANNELS];
            assert_eq!(pixel, [row as u8, 100 + column as u8, 200 + image as u8]);
        }
    }

    #[test]
    fn a_file_that_is_cut_off_is_refused_with_its_size() {
        let error = read(&file(&[1, 2])[..6145]).unwrap_err();
        let message = "`data/data_batch_1.bin` has 6145 bytes; expected a multiple of 3073: of each image a label \
                       and 3 x 1024 colours";
        assert_eq!(error.to_string(), message);
    }

    #[test]
    fn an_empty_file_is_refused() {
        assert!(matches!(read(&[]), Err(ImageFileError::Size { found: 0, .. })));
    }

    #[test]
    fn a_wrong_label_is_refused_with_its_image() {
        let error = read(&file(&[1, 2, 10, 11])).unwrap_err();
        let message = "`data/data_batch_1.bin` has the label 10 at image 2 (the first is 0); expected 0 to 9";
        assert_eq!(error.to_string(), message);
    }
}
