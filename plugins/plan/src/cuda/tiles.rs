//! Sizes of the tiles of products. They affect the time of a product, but no bit of it.

/// A tile `[rows, columns]`.
struct Tile {
    rows: usize,
    columns: usize,
    /// Estimated time of an entry relative to the largest tile: loads count more in small ones.
    cost: f64,
}

const fn tile(rows: usize, columns: usize, cost: f64) -> Tile {
    Tile { rows, columns, cost }
}

const TILES: [Tile; 5] = [
    tile(128, 128, 1.0),
    tile(64, 64, 1.25),
    tile(64, 16, 2.0),
    tile(16, 64, 2.0),
    tile(16, 16, 4.0),
];

impl Tile {
    fn blocks(&self, [rows, columns]: [usize; 2]) -> usize {
        rows.div_ceil(self.rows) * columns.div_ceil(self.columns)
    }

    fn time(&self, shape: [usize; 2]) -> f64 {
        self.blocks(shape) as f64 * (self.rows * self.columns) as f64 * self.cost
    }
}

/// The function that computes a product `[rows, columns]`, and its blocks.
pub(super) fn product_of(shape: [usize; 2]) -> (String, usize) {
    let faster = |best, tile| {
        if Tile::time(tile, shape) < Tile::time(best, shape) {
            tile
        } else {
            best
        }
    };
    let tile = TILES.iter().fold(&TILES[0], faster);
    let function = format!("product<{}, {}>", tile.rows, tile.columns);
    (function, tile.blocks(shape))
}
