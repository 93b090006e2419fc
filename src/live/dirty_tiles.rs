//! Which parts of a target to search anew: rectangles around the cells that no longer fit.

use ndarray::{Array2, ArrayView2};

/// Cells of a side of a tile, the unit of what is searched anew.
const TILE: usize = 8;
/// Cells of a tile that may be out of place before it is searched.
const STRAY: usize = 2;

/// A rectangle of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Window {
    pub(super) left: usize,
    pub(super) top: usize,
    pub(super) right: usize,
    pub(super) bottom: usize,
}

impl Window {
    pub(super) fn width(&self) -> usize {
        self.right - self.left
    }

    pub(super) fn height(&self) -> usize {
        self.bottom - self.top
    }

    pub(super) fn area(&self) -> usize {
        self.width() * self.height()
    }

    /// Wider by as many tiles on each side, where the map of `(height, width)` cells has them: whole tiles again.
    pub(super) fn grown(&self, tiles: usize, (height, width): (usize, usize)) -> Self {
        Self {
            left: self.left.saturating_sub(tiles * TILE),
            top: self.top.saturating_sub(tiles * TILE),
            right: (self.right + tiles * TILE).min(width),
            bottom: (self.bottom + tiles * TILE).min(height),
        }
    }
}

/// The rectangles around each group of adjoining tiles that hold more than a stray cell out of place; whole tiles, cut at
/// the edges of the map.
pub(super) fn dirty_windows(misfits: ArrayView2<'_, bool>) -> Vec<Window> {
    let (height, width) = misfits.dim();
    let mut open = Array2::from_shape_fn((height.div_ceil(TILE), width.div_ceil(TILE)), |(y, x)| {
        let rows = y * TILE..(y * TILE + TILE).min(height);
        let cells = rows.flat_map(|y| (x * TILE..(x * TILE + TILE).min(width)).map(move |x| (y, x)));
        cells.filter(|&cell| misfits[cell]).count() > STRAY
    });
    let (rows, columns) = open.dim();
    let mut found = Vec::new();
    for y in 0..rows {
        for x in 0..columns {
            if !std::mem::take(&mut open[(y, x)]) {
                continue;
            }
            let (mut left, mut right, mut bottom) = (x, x, y);
            let mut group = vec![(y, x)];
            while let Some((y, x)) = group.pop() {
                (left, right, bottom) = (left.min(x), right.max(x), bottom.max(y));
                for y in y.saturating_sub(1)..(y + 2).min(rows) {
                    for x in x.saturating_sub(1)..(x + 2).min(columns) {
                        if std::mem::take(&mut open[(y, x)]) {
                            group.push((y, x));
                        }
                    }
                }
            }
            found.push(Window {
                left: left * TILE,
                top: y * TILE,
                right: ((right + 1) * TILE).min(width),
                bottom: ((bottom + 1) * TILE).min(height),
            });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_of_tiles_become_rectangles_and_strays_none() {
        let mut misfits = Array2::from_elem((30, 44), false);
        misfits[(20, 30)] = true;
        assert_eq!(dirty_windows(misfits.view()), []);
        // Two tiles that touch at a corner, and one at the lower right edge.
        for (y, x) in [(7, 15), (8, 16), (29, 43)] {
            (0..4).for_each(|i| misfits[(y / 8 * 8 + i, x)] = true);
        }
        let found = dirty_windows(misfits.view());
        assert_eq!(
            found,
            [Window { left: 8, top: 0, right: 24, bottom: 16 }, Window { left: 40, top: 24, right: 44, bottom: 30 }]
        );
        assert_eq!(found[0].grown(1, misfits.dim()), Window { left: 0, top: 0, right: 32, bottom: 24 });
    }
}
