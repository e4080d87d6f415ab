//! Sizes of the tiles of products. They change the time of a product, and no bit.

use super::THREADS;
use std::fmt::Write;

const PRODUCT: &str = include_str!("product.c");

/// A tile `[rows, columns]`, cut among `tall` by `wide` threads.
struct Tile {
    name: &'static str,
    rows: usize,
    columns: usize,
    tall: usize,
    wide: usize,
    /// Time of an entry of the tile, by that of the largest tile: loads count for more in small ones.
    cost: f64,
}

const TILES: [Tile; 5] = [
    Tile {
        name: "product_large",
        rows: 128,
        columns: 128,
        tall: 16,
        wide: 16,
        cost: 1.0,
    },
    Tile {
        name: "product_middle",
        rows: 64,
        columns: 64,
        tall: 16,
        wide: 16,
        cost: 1.25,
    },
    Tile {
        name: "product_tall",
        rows: 64,
        columns: 16,
        tall: 16,
        wide: 16,
        cost: 2.0,
    },
    Tile {
        name: "product_wide",
        rows: 16,
        columns: 64,
        tall: 16,
        wide: 16,
        cost: 2.0,
    },
    Tile {
        name: "product_small",
        rows: 16,
        columns: 16,
        tall: 16,
        wide: 16,
        cost: 4.0,
    },
];

impl Tile {
    fn blocks(&self, [rows, columns]: [usize; 2]) -> usize {
        rows.div_ceil(self.rows) * columns.div_ceil(self.columns)
    }

    fn time(&self, shape: [usize; 2]) -> f64 {
        self.blocks(shape) as f64 * (self.rows * self.columns) as f64 * self.cost
    }
}

/// The function that computes a product of a shape, and its blocks.
pub(super) fn product_of(shape: [usize; 2]) -> (&'static str, usize) {
    let faster = |best, tile| {
        if Tile::time(tile, shape) < Tile::time(best, shape) {
            tile
        } else {
            best
        }
    };
    let tile = TILES.iter().fold(&TILES[0], faster);
    (tile.name, tile.blocks(shape))
}

/// The product of every size of tile.
pub(super) fn products() -> String {
    let mut text = String::new();
    for Tile {
        name,
        rows,
        columns,
        tall,
        wide,
        ..
    } in &TILES
    {
        debug_assert_eq!(tall * wide, THREADS);
        let words = [
            ("PRODUCT", (*name).to_owned()),
            ("TILE_ROWS", rows.to_string()),
            ("TILE_COLUMNS", columns.to_string()),
            ("TALL", tall.to_string()),
            ("WIDE", wide.to_string()),
        ];
        for (word, meaning) in &words {
            let _ = writeln!(text, "#define {word} {meaning}");
        }
        text += PRODUCT;
        for (word, _) in &words {
            let _ = writeln!(text, "#undef {word}");
        }
    }
    text
}
