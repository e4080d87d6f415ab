//! Sources of images in a config.

use crate::{
    cache::Cache,
    images::{CHANNELS, ImageFileError, Images, cifar10, shapes, stl10},
};
use contract::{DataFile, Error};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{fs, sync::Arc};

/// Source of the images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ImageSource {
    /// Figures of ten classes that the program draws.
    Shapes {
        /// Number of images.
        #[serde(default = "ten_thousand")]
        #[schemars(range(min = 20, max = 10_000_000))]
        count: u64,
        /// Names the random stream of the drawings.
        #[serde(default)]
        seed: u64,
    },
    /// Files of the binary version of CIFAR-10 (Krizhevsky 2009), one after the other.
    Cifar10 {
        /// `data_batch_1.bin` and so on.
        files: Vec<ImageFile>,
    },
    /// Files of STL-10 (Coates et al. 2011).
    Stl10 {
        /// `train_X.bin`.
        images: ImageFile,
        /// `train_y.bin`; absent for images without labels.
        #[serde(default)]
        labels: Option<ImageFile>,
        /// `unlabeled_X.bin`, whose images are added; labels are then not known.
        #[serde(default)]
        unlabelled: Option<ImageFile>,
    },
}

/// A file of images or labels.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageFile {
    /// Path of the file.
    pub file: DataFile,
}

fn ten_thousand() -> u64 {
    10_000
}

impl Default for ImageSource {
    fn default() -> Self {
        Self::Shapes {
            count: ten_thousand(),
            seed: 0,
        }
    }
}

impl ImageSource {
    /// The images with `size` pixels a side, from the cache if they are there.
    ///
    /// # Errors
    /// [`Error::Config`] for a size that these images cannot have, [`Error::File`] and [`Error::Damaged`] for a
    /// file that cannot be read or has the wrong content.
    pub fn load(&self, size: usize) -> Result<Arc<Images>, Error> {
        static KEPT: Cache<Images> = Cache::new();
        KEPT.get_or_make(format!("{size} {}", self.identity()?), || self.read(size))
    }

    /// Number of images, from the sizes of files without reading them.
    ///
    /// # Errors
    /// [`Error::File`] for a missing file.
    pub fn count(&self) -> Result<usize, Error> {
        let in_file = |of: &ImageFile, bytes_each: u64| {
            let path = of.file.path();
            let size = fs::metadata(path).map_err(Error::file("find", path))?.len();
            Ok(usize::try_from(size / bytes_each).unwrap_or(usize::MAX))
        };
        match self {
            Self::Shapes { count, .. } => Ok(usize::try_from(*count).unwrap_or(usize::MAX)),
            Self::Cifar10 { files } => files.iter().map(|it| in_file(it, 1 + 32 * 32 * 3)).sum(),
            Self::Stl10 {
                images, unlabelled, ..
            } => {
                let all = std::iter::once(images).chain(unlabelled);
                all.map(|it| in_file(it, 96 * 96 * 3)).sum()
            }
        }
    }

    /// Names of the classes.
    #[must_use]
    pub fn class_names(&self) -> &'static [&'static str] {
        match self {
            Self::Shapes { .. } => shapes::CLASS_NAMES,
            Self::Cifar10 { .. } => cifar10::CLASS_NAMES,
            Self::Stl10 { .. } => stl10::CLASS_NAMES,
        }
    }

    /// Whether the class of every image is known.
    #[must_use]
    pub fn has_labels(&self) -> bool {
        match self {
            Self::Shapes { .. } | Self::Cifar10 { .. } => true,
            Self::Stl10 {
                labels, unlabelled, ..
            } => labels.is_some() && unlabelled.is_none(),
        }
    }

    /// A text that identifies these images: the content of files, not their paths.
    ///
    /// # Errors
    /// [`Error::File`] where a file cannot be read.
    pub fn identity(&self) -> Result<String, Error> {
        let digests = |files: &[&ImageFile]| -> Result<Vec<String>, Error> {
            let digest = |it: &&ImageFile| it.file.digest().map(std::borrow::Cow::into_owned);
            files.iter().map(digest).collect()
        };
        match self {
            Self::Shapes { count, seed } => Ok(format!("shapes {count} {seed}")),
            Self::Cifar10 { files } => {
                let files: Vec<&ImageFile> = files.iter().collect();
                Ok(format!("cifar10 {:?}", digests(&files)?))
            }
            Self::Stl10 {
                images,
                labels,
                unlabelled,
            } => {
                let others = labels.iter().chain(unlabelled);
                let files: Vec<&ImageFile> = std::iter::once(images).chain(others).collect();
                Ok(format!("stl10 {} {:?}", labels.is_some(), digests(&files)?))
            }
        }
    }

    fn read(&self, size: usize) -> Result<Images, Error> {
        match self {
            Self::Shapes { count, seed } => {
                if ![4, 8, 16, 32, 64].contains(&size) {
                    let problem =
                        format!("shapes are drawn with 4, 8, 16, 32 or 64 pixels a side, not {size}");
                    return Err(Error::config("size", problem));
                }
                Ok(shapes::images(*seed, 0..*count, size))
            }
            Self::Cifar10 { files } => {
                let one =
                    |it: &ImageFile| cifar10::images(it.file.path(), &it.file.bytes()?).map_err(damaged);
                let mut all = files.iter().map(one);
                let Some(first) = all.next() else {
                    return Err(Error::config(
                        "images.cifar10.files",
                        "there is none; name data_batch_1.bin",
                    ));
                };
                let joined =
                    all.try_fold(first?, |joined, next| Ok::<_, Error>(joined.followed_by(&next?)))?;
                shrunk(joined, size)
            }
            Self::Stl10 {
                images,
                labels,
                unlabelled,
            } => {
                let (pixels, named) = (
                    images.file.bytes()?,
                    labels.as_ref().map(|it| it.file.bytes()).transpose()?,
                );
                let file = stl10::File {
                    path: images.file.path(),
                    bytes: &pixels,
                };
                let side = size.clamp(stl10::TRAINING_SIZE, stl10::SIZE);
                let first = match (labels, &named) {
                    (Some(labels), Some(named)) => {
                        let named = stl10::File {
                            path: labels.file.path(),
                            bytes: named,
                        };
                        stl10::labelled(file, named, side).map_err(damaged)?
                    }
                    _ => stl10::unlabelled(file, side).map_err(damaged)?,
                };
                let Some(others) = unlabelled else {
                    return shrunk(first, size);
                };
                let pixels = others.file.bytes()?;
                let file = stl10::File {
                    path: others.file.path(),
                    bytes: &pixels,
                };
                let others = stl10::unlabelled(file, side).map_err(damaged)?;
                shrunk(first.followed_by(&others), size)
            }
        }
    }
}

fn damaged(error: ImageFileError) -> Error {
    let path = match &error {
        ImageFileError::Size { path, .. }
        | ImageFileError::Label { path, .. }
        | ImageFileError::Labels { path, .. } => path.clone(),
    };
    Error::Damaged {
        path,
        problem: error.to_string(),
    }
}

/// The images at a smaller size: halved as often as possible, each pixel the mean of four, and then
/// interpolated.
///
/// # Errors
/// [`Error::Config`] for a larger size.
pub fn shrunk(images: Images, size: usize) -> Result<Images, Error> {
    if size > images.size() {
        let problem = format!(
            "the images have {} pixels a side, which is less than {size}",
            images.size()
        );
        return Err(Error::config("size", problem));
    }
    let mut images = images;
    while images.size() >= 2 * size && images.size().is_multiple_of(2) {
        let half = images.size() / 2;
        images = images.resized(half);
    }
    Ok(if images.size() == size {
        images
    } else {
        images.resized(size)
    })
}

/// Count of the numbers of an image of this size.
#[must_use]
pub fn n_numbers(size: usize) -> usize {
    size * size * CHANNELS
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn source(text: serde_json::Value) -> ImageSource {
        serde_json::from_value(text).unwrap()
    }

    fn file_in(folder: &std::path::Path, name: &str, bytes: &[u8]) -> String {
        let path = folder.join(name);
        fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_owned()
    }

    #[test]
    fn shapes_have_the_sizes_that_they_are_drawn_in() {
        let shapes = source(json!({ "shapes": { "count": 20 } }));
        assert_eq!(
            (shapes.load(16).unwrap().count(), shapes.load(16).unwrap().size()),
            (20, 16)
        );
        assert!(Arc::ptr_eq(&shapes.load(8).unwrap(), &shapes.load(8).unwrap()));
        let text = shapes.load(12).unwrap_err().to_string();
        assert!(text.contains("4, 8, 16, 32 or 64 pixels"), "{text}");
        assert_eq!(source(json!({ "shapes": {} })), ImageSource::default());
    }

    #[test]
    fn files_of_cifar10_are_joined_and_halved() {
        let folder = tempfile::tempdir().unwrap();
        let image = |label: u8, value: u8| [vec![label], vec![value; 3072]].concat();
        let one = file_in(folder.path(), "one.bin", &[image(3, 10), image(9, 20)].concat());
        let two = file_in(folder.path(), "two.bin", &image(0, 30));
        let both = source(json!({ "cifar10": { "files": [{ "file": one }, { "file": two }] } }));
        let images = both.load(16).unwrap();
        assert_eq!((images.count(), images.size()), (3, 16));
        assert_eq!(images.labels().unwrap(), [3, 9, 0]);
        assert!(images.image(2).iter().all(|byte| *byte == 30));
        assert_eq!((both.count().unwrap(), both.has_labels()), (3, true));
        assert_eq!(both.class_names(), images.class_names());
        let text = both.load(64).unwrap_err().to_string();
        assert!(text.contains("32 pixels a side, which is less than 64"), "{text}");
        assert!(source(json!({ "cifar10": { "files": [] } })).load(32).is_err());
    }

    #[test]
    fn a_file_that_is_something_else_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let cut = file_in(folder.path(), "cut.bin", &[1; 3000]);
        let text = source(json!({ "cifar10": { "files": [{ "file": cut }] } }))
            .load(32)
            .unwrap_err()
            .to_string();
        assert!(text.contains("cut.bin") && text.contains("3000 bytes"), "{text}");
        let none = json!({ "stl10": { "images": { "file": "none.bin" } } });
        assert!(matches!(source(none).load(48), Err(Error::File { .. })));
    }

    #[test]
    fn images_of_stl10_lose_their_labels_where_others_have_none() {
        let folder = tempfile::tempdir().unwrap();
        let pixels = vec![7; 2 * 96 * 96 * 3];
        let images = file_in(folder.path(), "train_X.bin", &pixels);
        let labels = file_in(folder.path(), "train_y.bin", &[1, 10]);
        let named = json!({ "images": { "file": images }, "labels": { "file": labels } });
        let loaded = source(json!({ "stl10": named.clone() })).load(48).unwrap();
        assert_eq!((loaded.count(), loaded.labels().unwrap()), (2, [0, 9].as_slice()));
        let mut more = named;
        more["unlabelled"] = json!({ "file": images });
        let both = source(json!({ "stl10": more }));
        let loaded = both.load(24).unwrap();
        assert_eq!((loaded.count(), loaded.labels(), loaded.size()), (4, None, 24));
        assert_eq!((both.count().unwrap(), both.has_labels()), (4, false));
    }
}
