//! `shapes`: synthetic images of ten classes, so that a study needs no file.
//!
//! Image `i` of seed `s` is a pure function of `(s, i)`: it is drawn from stream `i` of the `ChaCha8` generator of
//! seed `s`. Its class is `i mod 10`, so any run of images is balanced within one. An image shows one figure on a
//! ground, and these vary within a class:
//!
//! | quantity | distribution, in units of the image's side |
//! |---|---|
//! | centre | uniform in 0.36 to 0.64 |
//! | radius | uniform in 0.22 to 0.36; the period of bars is 1.2 radii, the side of a check 0.8 |
//! | direction | uniform on the circle; bars and checks are tilted by a slope of at most 1/4 |
//! | colours | uniform in the cube, at least 0.3 of luma apart; the figure is the lighter one in 4 of 5 |
//! | shading | both colours times 1 in the middle, and up to 0.4 a side more in some direction |
//! | noise | about normal, of each colour of each pixel, standard deviation 0.02 of the range, which ends at 0 and 1 |
//!
//! Edges are smooth: of every image the same 128 x 128 points are tested and averaged over its pixels, so image `i` has
//! the same scene at every size, and only its noise differs. No function of a C library is called, so the bytes are
//! the same on every machine.

use super::{CHANNELS, Images};
use rand::{Rng, RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::ops::Range;

/// The classes, in the order of their labels.
pub const CLASS_NAMES: &[&str] = &[
    "disc",
    "ring",
    "square",
    "triangle",
    "cross",
    "horizontal bars",
    "vertical bars",
    "checks",
    "half",
    "two dots",
];

/// Points per side at which a scene is tested.
const POINTS: usize = 128;

/// Images `indices` of a seed at `size x size` pixels, with their labels.
///
/// # Panics
/// Where `size` does not divide 128; networks are trained at 8, 16 and 32.
#[must_use]
pub fn images(seed: u64, indices: Range<u64>, size: usize) -> Images {
    let labels = indices.clone().map(label).collect();
    let pixels = indices.flat_map(|index| image(seed, index, size)).collect();
    Images::new(size, pixels, Some(labels), CLASS_NAMES)
}

/// The class of image `index`, which does not depend on the seed.
#[must_use]
pub fn label(index: u64) -> u8 {
    // Smaller than the number of classes.
    (index % CLASS_NAMES.len() as u64) as u8
}

/// Image `index` of a seed, `[size, size, 3]`.
///
/// # Panics
/// Where `size` does not divide 128.
#[must_use]
pub fn image(seed: u64, index: u64, size: usize) -> Vec<u8> {
    assert!(
        size > 0 && POINTS.is_multiple_of(size),
        "{POINTS} is no multiple of {size} pixels"
    );
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    let scene = Scene::draw(FIGURES[usize::from(label(index))], &mut rng);
    let mut pixels = Vec::with_capacity(size * size * CHANNELS);
    for row in 0..size {
        for column in 0..size {
            let colour = scene.pixel(row, column, size);
            pixels.extend(colour.map(|value| byte(value + NOISE * about_normal(&mut rng))));
        }
    }
    pixels
}

const NOISE: f64 = 0.02;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Figure {
    Disc,
    Ring,
    Square,
    Triangle,
    Cross,
    HorizontalBars,
    VerticalBars,
    Checks,
    Half,
    TwoDots,
}

/// The figures in the order of their labels.
const FIGURES: [Figure; 10] = [
    Figure::Disc,
    Figure::Ring,
    Figure::Square,
    Figure::Triangle,
    Figure::Cross,
    Figure::HorizontalBars,
    Figure::VerticalBars,
    Figure::Checks,
    Figure::Half,
    Figure::TwoDots,
];

impl Figure {
    /// Whether the figure covers a point in its own coordinates, in which its radius is about 1.
    fn covers(self, x: f64, y: f64) -> bool {
        let (across, along) = (x.abs(), y.abs());
        match self {
            Figure::Disc => x * x + y * y < 1.0,
            Figure::Ring => (0.3..1.2).contains(&(x * x + y * y)),
            Figure::Square => across.max(along) < 0.85,
            // Equal sides about the origin: corners at 1.3, sides at 0.65.
            Figure::Triangle => y > -0.65 && 3f64.sqrt() * across + y < 1.3,
            Figure::Cross => across.min(along) < 0.3 && across.max(along) < 1.15,
            Figure::HorizontalBars => first_half(y / 1.2),
            Figure::VerticalBars => first_half(x / 1.2),
            Figure::Checks => first_half(x / 1.6) == first_half(y / 1.6),
            Figure::Half => y > 0.0,
            Figure::TwoDots => (across - 0.75) * (across - 0.75) + y * y < 0.25,
        }
    }

    fn is_periodic(self) -> bool {
        matches!(
            self,
            Figure::HorizontalBars | Figure::VerticalBars | Figure::Checks
        )
    }
}

fn first_half(turns: f64) -> bool {
    turns - turns.floor() < 0.5
}

/// Figure and ground of an image. Lengths are in units of its side, colours from 0 to 1.
struct Scene {
    figure: Figure,
    centre: [f64; 2],
    radius: f64,
    /// The figure's first axis, of length 1.
    direction: [f64; 2],
    colour: [f64; CHANNELS],
    ground: [f64; CHANNELS],
    /// Increase in brightness per side, to the right and down.
    shading: [f64; 2],
}

impl Scene {
    fn draw(figure: Figure, rng: &mut ChaCha8Rng) -> Self {
        let centre = [between(0.36, 0.64, rng), between(0.36, 0.64, rng)];
        let radius = between(0.22, 0.36, rng);
        let direction = if figure.is_periodic() {
            tilt(rng)
        } else {
            direction(rng)
        };
        let [darker, lighter] = two_colours(rng);
        let is_lighter = rng.random::<f64>() < 0.8;
        let shading = shading(rng);
        Self {
            figure,
            centre,
            radius,
            direction,
            colour: if is_lighter { lighter } else { darker },
            ground: if is_lighter { darker } else { lighter },
            shading,
        }
    }

    /// The colour of a pixel before its noise.
    fn pixel(&self, row: usize, column: usize, size: usize) -> [f64; CHANNELS] {
        let covered = self.covered(row, column, size);
        let middle = |index: usize| (index as f64 + 0.5) / size as f64 - 0.5;
        let light = 1.0 + self.shading[0] * middle(column) + self.shading[1] * middle(row);
        std::array::from_fn(|channel| {
            let ground = self.ground[channel];
            (ground + (self.colour[channel] - ground) * covered) * light
        })
    }

    /// Fraction of a pixel that the figure covers.
    fn covered(&self, row: usize, column: usize, size: usize) -> f64 {
        let per_pixel = POINTS / size;
        let points = |index: usize| index * per_pixel..(index + 1) * per_pixel;
        let at = |index: usize| (index as f64 + 0.5) / POINTS as f64;
        let rows = points(row).flat_map(|y| points(column).map(move |x| (at(x), at(y))));
        let covered = rows.filter(|(x, y)| self.covers(*x, *y)).count();
        covered as f64 / (per_pixel * per_pixel) as f64
    }

    fn covers(&self, x: f64, y: f64) -> bool {
        let [from_x, from_y] = [
            (x - self.centre[0]) / self.radius,
            (y - self.centre[1]) / self.radius,
        ];
        let [cos, sin] = self.direction;
        self.figure
            .covers(from_x * cos + from_y * sin, from_y * cos - from_x * sin)
    }
}

fn between(low: f64, high: f64, rng: &mut ChaCha8Rng) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// Uniform on the circle: a point of the disc, whose length is then made 1. No sine is needed.
fn direction(rng: &mut ChaCha8Rng) -> [f64; 2] {
    loop {
        let [x, y] = [between(-1.0, 1.0, rng), between(-1.0, 1.0, rng)];
        let square = x * x + y * y;
        if (1e-4..1.0).contains(&square) {
            return [x / square.sqrt(), y / square.sqrt()];
        }
    }
}

/// Nearly along the first axis: a slope of at most 1/4.
fn tilt(rng: &mut ChaCha8Rng) -> [f64; 2] {
    let slope = between(-0.25, 0.25, rng);
    let length = (1.0 + slope * slope).sqrt();
    [1.0 / length, slope / length]
}

fn shading(rng: &mut ChaCha8Rng) -> [f64; 2] {
    let strength = between(0.0, 0.4, rng);
    direction(rng).map(|part| strength * part)
}

/// Two colours that can be told apart in grey, the darker first.
fn two_colours(rng: &mut ChaCha8Rng) -> [[f64; CHANNELS]; 2] {
    loop {
        let one: [f64; CHANNELS] = rng.random();
        let other: [f64; CHANNELS] = rng.random();
        let apart = luma(one) - luma(other);
        if apart.abs() > 0.3 {
            return if apart < 0.0 { [one, other] } else { [other, one] };
        }
    }
}

/// Brightness as the eye weighs colours (ITU-R BT.601).
fn luma([red, green, blue]: [f64; CHANNELS]) -> f64 {
    0.299 * red + 0.587 * green + 0.114 * blue
}

/// Mean 0 and variance 1: the sum of four uniform numbers of 16 bits, whose density is a cubic spline.
fn about_normal(rng: &mut ChaCha8Rng) -> f64 {
    let bits = rng.next_u64();
    let sum: u64 = (0..4).map(|part| (bits >> (16 * part)) & 0xffff).sum();
    (sum as f64 / 65536.0 - 2.0) * 3f64.sqrt()
}

/// The nearest byte; the cast clamps.
fn byte(value: f64) -> u8 {
    (value * 255.0).round() as u8
}

#[cfg(test)]
mod tests;
