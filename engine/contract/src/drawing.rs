//! Drawings that trials leave: the graph of a design that was found, and samples of generated images.
//!
//! A protocol whose environment has something to draw calls [`leave_drawings`](crate::protocol::leave_drawings) after
//! an episode. `graph.json` holds a
//! [`Graph`]; `images.png` holds square images of one size, one below the other, in 8-bit RGB.

use crate::{
    ArtifactKind, Error,
    artifact::{GRAPH_FILE, IMAGES_FILE},
    error::DrawingError,
};
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, btree_map::Entry},
    fs,
    io::Cursor,
    path::{Path, PathBuf},
};

/// Largest number of bytes of pixels that are read; a file that declares more is refused before memory is allocated for
/// it.
const MOST_BYTES: u64 = 1 << 28;

/// A design as boxes and arrows along a flow.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Graph {
    /// Boxes of the graph, in any order.
    pub nodes: Vec<Node>,
    /// Arrows of the graph, in any order.
    pub edges: Vec<Edge>,
    /// The first words of all labels that designs of this kind may have; those that are most important to distinguish
    /// come first. Each has the same colour in every figure; if empty, the most frequent ones of a graph are coloured.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub operations: Vec<String>,
}

/// A box of a graph.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Node {
    /// Text in the box; a single character, such as `+`, is drawn in a circle.
    pub label: String,
    /// Place along the flow. Only the order matters, and the same holds for lanes.
    pub column: u32,
    /// Place across the flow.
    #[serde(default)]
    pub lane: i32,
    /// Name of the frame around the box, such as `cell 1`; empty for none.
    #[serde(default)]
    pub group: String,
}

/// An arrow of a graph, along the flow.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Edge {
    /// Number of the node where it begins, from 0.
    pub from: usize,
    /// Number of the node where it ends.
    pub to: usize,
    /// Text beside the arrow; empty for none.
    #[serde(default)]
    pub label: String,
    /// Whether the arrow is a skip or a shortcut, which is drawn dashed and around the boxes that it passes.
    #[serde(default)]
    pub bypass: bool,
}

/// A picture in 8-bit RGB.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Image {
    /// Pixels in a row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// Red, green and blue of each pixel, row by row, `[height, width, 3]`.
    pub pixels: Vec<u8>,
}

/// Drawings that a trial left.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Drawings {
    /// The graph of a design.
    pub graph: Option<Graph>,
    /// Samples, all of one size.
    pub images: Vec<Image>,
    /// Reason why a drawing that the trial left cannot be shown.
    pub problem: Option<String>,
}

impl Drawings {
    /// Reads the drawings of one kind from a trial's folder; other kinds of artifacts are no drawings.
    ///
    /// # Errors
    /// The errors of [`Graph::read`] and [`Image::read_all`].
    pub fn read(&mut self, kind: ArtifactKind, folder: &Path) -> Result<(), Error> {
        match kind {
            ArtifactKind::Graph => self.graph = Some(Graph::read(folder)?),
            ArtifactKind::Images => self.images = Image::read_all(folder)?,
            _ => {}
        }
        Ok(())
    }
}

impl Graph {
    /// Checks that the graph can be drawn.
    ///
    /// # Errors
    /// The first fault.
    pub fn check(&self) -> Result<(), DrawingError> {
        if self.nodes.is_empty() {
            return Err(DrawingError::NoNode);
        }
        let mut places = BTreeMap::new();
        for (other, node) in self.nodes.iter().enumerate() {
            let (column, lane) = (node.column, node.lane);
            match places.entry((column, lane)) {
                Entry::Vacant(free) => drop(free.insert(other)),
                Entry::Occupied(taken) => {
                    let one = *taken.get();
                    return Err(DrawingError::SamePlace {
                        one,
                        other,
                        column,
                        lane,
                    });
                }
            }
        }
        (0..self.edges.len()).try_for_each(|edge| self.check_edge(edge))
    }

    fn check_edge(&self, edge: usize) -> Result<(), DrawingError> {
        let Edge { from, to, .. } = self.edges[edge];
        let nodes = self.nodes.len();
        if let Some(node) = [from, to].into_iter().find(|node| *node >= nodes) {
            return Err(DrawingError::NoSuchNode { edge, node, nodes });
        }
        let (from, to) = (self.nodes[from].column, self.nodes[to].column);
        if from < to {
            Ok(())
        } else {
            Err(DrawingError::AgainstTheFlow { edge, from, to })
        }
    }

    /// Writes the graph into a trial's folder.
    ///
    /// # Errors
    /// [`Error::Drawing`] for a graph that cannot be drawn, [`Error::Store`] if the file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), Error> {
        self.check()?;
        let path = folder.join(GRAPH_FILE);
        let text = serde_json::to_vec_pretty(self).map_err(std::io::Error::from);
        text.and_then(|text| fs::write(&path, text))
            .map_err(Error::file("write", &path))
            .map_err(Error::of_store)
    }

    /// Reads the graph that a trial left.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read, [`Error::Damaged`] if it is no graph that can be drawn.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        let path = folder.join(GRAPH_FILE);
        let text = fs::read(&path).map_err(Error::file("read", &path))?;
        let graph: Self = serde_json::from_slice(&text).map_err(damaged(&path))?;
        graph.check().map_err(damaged(&path))?;
        Ok(graph)
    }
}

impl Image {
    /// Checks the number of pixels against the size.
    ///
    /// # Errors
    /// [`DrawingError::Pixels`] or [`DrawingError::NoPixel`].
    pub fn check(&self) -> Result<(), DrawingError> {
        let (width, height, found) = (self.width, self.height, self.pixels.len());
        let expected = 3 * u64::from(width) * u64::from(height);
        if expected != found as u64 {
            return Err(DrawingError::Pixels {
                width,
                height,
                expected,
                found,
            });
        }
        if found == 0 {
            Err(DrawingError::NoPixel)
        } else {
            Ok(())
        }
    }

    /// Writes square images of one size into a trial's folder.
    ///
    /// # Errors
    /// [`Error::Drawing`] if there is none or they do not fit together, [`Error::Store`] if the file cannot be written.
    pub fn write_all(images: &[Self], folder: &Path) -> Result<(), Error> {
        let stacked = stacked(images)?;
        let path = folder.join(IMAGES_FILE);
        fs::write(&path, stacked.png()?)
            .map_err(Error::file("write", &path))
            .map_err(Error::of_store)
    }

    /// Reads the images that a trial left.
    ///
    /// # Errors
    /// [`Error::File`] if the file cannot be read, [`Error::Damaged`] if it is no 8-bit RGB PNG whose height is a
    /// multiple of its width.
    pub fn read_all(folder: &Path) -> Result<Vec<Self>, Error> {
        let path = folder.join(IMAGES_FILE);
        let bytes = fs::read(&path).map_err(Error::file("read", &path))?;
        let stacked = decoded(&bytes).map_err(damaged(&path))?;
        let side = stacked.width;
        if stacked.height % side != 0 {
            let problem = format!(
                "{} rows are no whole number of squares of {side} pixels",
                stacked.height
            );
            return Err(Error::Damaged { path, problem });
        }
        let size = stacked.pixels.len() / (stacked.height / side) as usize;
        let one = |pixels: &[u8]| Self {
            width: side,
            height: side,
            pixels: pixels.to_vec(),
        };
        Ok(stacked.pixels.chunks(size).map(one).collect())
    }

    /// The image as a PNG file.
    ///
    /// # Errors
    /// Errors of [`check`](Self::check).
    pub fn png(&self) -> Result<Vec<u8>, DrawingError> {
        self.check()?;
        let refused = |error: png::EncodingError| DrawingError::Encoder {
            problem: error.to_string(),
        };
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Default);
        encoder.set_filter(png::FilterType::Sub);
        let mut writer = encoder.write_header().map_err(refused)?;
        writer.write_image_data(&self.pixels).map_err(refused)?;
        writer.finish().map_err(refused)?;
        Ok(bytes)
    }

    /// Mean of red, green and blue over all pixels, from 0 to 255.
    #[must_use]
    pub fn mean_color(&self) -> [f64; 3] {
        let mut sums = [0_u64; 3];
        for pixel in self.pixels.chunks_exact(3) {
            for (sum, value) in sums.iter_mut().zip(pixel) {
                *sum += u64::from(*value);
            }
        }
        let pixels = f64::from(self.width) * f64::from(self.height);
        #[allow(
            clippy::cast_precision_loss,
            reason = "a sum of bytes of a picture is far below 2^52"
        )]
        sums.map(|sum| sum as f64 / pixels)
    }
}

/// One image that contains all images, one below the other.
fn stacked(images: &[Image]) -> Result<Image, DrawingError> {
    let side = images.first().ok_or(DrawingError::NoPixel)?.width;
    for (number, image) in images.iter().enumerate() {
        let (width, height) = (image.width, image.height);
        if (width, height) != (side, side) {
            return Err(DrawingError::Size {
                number,
                width,
                height,
                side,
            });
        }
        image.check()?;
    }
    let too_many = DrawingError::TooMany {
        images: images.len(),
        side,
    };
    let rows = u32::try_from(images.len())
        .ok()
        .and_then(|count| count.checked_mul(side));
    let height = rows.filter(|rows| 3 * u64::from(*rows) * u64::from(side) <= MOST_BYTES);
    Ok(Image {
        width: side,
        height: height.ok_or(too_many)?,
        pixels: images.iter().flat_map(|image| &image.pixels).copied().collect(),
    })
}

/// The image in an 8-bit RGB PNG; the error is the kind of image that it is instead.
fn decoded(bytes: &[u8]) -> Result<Image, String> {
    let words = |error: png::DecodingError| error.to_string();
    let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().map_err(words)?;
    let (color, depth) = reader.output_color_type();
    if (color, depth) != (png::ColorType::Rgb, png::BitDepth::Eight) {
        return Err(format!(
            "its pixels are {color:?} of {depth:?} bits, not RGB of 8 bits"
        ));
    }
    let (width, height) = (reader.info().width, reader.info().height);
    let size = 3 * u64::from(width) * u64::from(height);
    if size > MOST_BYTES {
        return Err(format!("{width} x {height} pixels are more than are read"));
    }
    let mut pixels = vec![0; reader.output_buffer_size()];
    reader.next_frame(&mut pixels).map_err(words)?;
    Ok(Image {
        width,
        height,
        pixels,
    })
}

fn damaged<E: std::fmt::Display>(path: &Path) -> impl FnOnce(E) -> Error {
    let path: PathBuf = path.to_owned();
    move |error| Error::Damaged {
        path,
        problem: error.to_string(),
    }
}

#[cfg(test)]
mod tests;
