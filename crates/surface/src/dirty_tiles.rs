//! Dirty tiles: rectangles around the cells whose disparity no longer agrees with the photos.

use ndarray::{Array2, ArrayView2};

/// Cells per side of a tile.
const TILE: usize = 8;
/// A tile is dirty if more than this many of its cells are outliers.
const MAX_OUTLIERS: usize = 2;
/// Cells around a dirty region that are searched with it, so that its edges agree with their
/// surroundings.
const MARGIN: usize = TILE;

/// A rectangle of cells: first column and row, and those after the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// The column after the last.
    pub right: usize,
    /// The row after the last.
    pub bottom: usize,
}

impl Region {
    pub(crate) fn width(&self) -> usize {
        self.right - self.left
    }

    pub(crate) fn height(&self) -> usize {
        self.bottom - self.top
    }

    /// Number of its cells.
    pub fn area(&self) -> usize {
        self.width() * self.height()
    }

    /// The rectangle with its margin on each side, cut at the edges of a map of `(height, width)`
    /// cells.
    pub fn expanded(&self, (height, width): (usize, usize)) -> Self {
        Self {
            left: self.left.saturating_sub(MARGIN),
            top: self.top.saturating_sub(MARGIN),
            right: (self.right + MARGIN).min(width),
            bottom: (self.bottom + MARGIN).min(height),
        }
    }
}

/// The bounding rectangle of each group of adjoining dirty tiles: whole tiles, cut at the edges of
/// the map.
pub fn dirty_regions(outliers: ArrayView2<'_, bool>) -> Vec<Region> {
    let (height, width) = outliers.dim();
    let mut dirty = Array2::from_shape_fn((height.div_ceil(TILE), width.div_ceil(TILE)), |(y, x)| {
        let rows = y * TILE..(y * TILE + TILE).min(height);
        let cells = rows.flat_map(|y| (x * TILE..(x * TILE + TILE).min(width)).map(move |x| (y, x)));
        cells.filter(|&cell| outliers[cell]).count() > MAX_OUTLIERS
    });
    let (rows, columns) = dirty.dim();
    let mut found = Vec::new();
    for y in 0..rows {
        for x in 0..columns {
            if !std::mem::take(&mut dirty[(y, x)]) {
                continue;
            }
            let (mut left, mut right, mut bottom) = (x, x, y);
            let mut group = vec![(y, x)];
            while let Some((y, x)) = group.pop() {
                (left, right, bottom) = (left.min(x), right.max(x), bottom.max(y));
                for y in y.saturating_sub(1)..(y + 2).min(rows) {
                    for x in x.saturating_sub(1)..(x + 2).min(columns) {
                        if std::mem::take(&mut dirty[(y, x)]) {
                            group.push((y, x));
                        }
                    }
                }
            }
            found.push(Region {
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
    fn adjoining_dirty_tiles_become_one_rectangle_and_single_outliers_none() {
        let mut outliers = Array2::from_elem((30, 44), false);
        outliers[(20, 30)] = true;
        assert_eq!(dirty_regions(outliers.view()), []);
        // Two tiles that touch at a corner, and one at the lower right edge.
        for (y, x) in [(7, 15), (8, 16), (29, 43)] {
            (0..4).for_each(|i| outliers[(y / 8 * 8 + i, x)] = true);
        }
        let found = dirty_regions(outliers.view());
        assert_eq!(
            found,
            [Region { left: 8, top: 0, right: 24, bottom: 16 }, Region { left: 40, top: 24, right: 44, bottom: 30 }]
        );
        assert_eq!(found[0].expanded(outliers.dim()), Region { left: 0, top: 0, right: 32, bottom: 24 });
    }
}
