//! Layers: planes, or maps of disparity per cell.

use ndarray::Array2;
use rayon::prelude::*;

use super::{CELL, enlarge};

/// One layer of the target: its disparity at each pixel, in 1/scene unit.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Layer {
    /// A plane: the same disparity everywhere.
    Plane(f64),
    /// Disparity per cell of [`CELL`]×[`CELL`] pixels of the padded target, `[h, w]`, interpolated
    /// bilinearly.
    Map(Array2<f32>),
    /// Disparity per pixel of the padded target, `[h, w]`, in standard layout: sharp at edges.
    Pixels(Array2<f32>),
}

/// A validated list of layers, near → far. Never empty.
#[derive(Debug, Clone)]
pub struct Layers(Vec<Layer>);

impl Layers {
    /// Planes at these disparities (1/scene unit), in descending order; 0 is the plane at infinity.
    ///
    /// # Errors
    ///
    /// [`LayersError::Empty`] for none; [`LayersError::NotADisparity`] and
    /// [`LayersError::Unsorted`], with the index in the list.
    pub fn planes(disparities: &[f64]) -> Result<Self, LayersError> {
        if disparities.is_empty() {
            return Err(LayersError::Empty);
        }
        for (index, &value) in disparities.iter().enumerate() {
            // Checked as f32: the precision of the pixels' disparities.
            if !(value as f32).is_finite() || value < 0.0 {
                return Err(LayersError::NotADisparity { index, value });
            }
            if index > 0 && value > disparities[index - 1] {
                return Err(LayersError::Unsorted { index, value, before: disparities[index - 1] });
            }
        }
        Ok(Self(disparities.iter().map(|&d| Layer::Plane(d)).collect()))
    }

    /// `count` planes evenly spaced in disparity from 1/near to 1/far (the paper's choice); see
    /// [`uniform_disparities`].
    ///
    /// # Errors
    ///
    /// [`LayersError::Range`] unless 0 < near < far; [`LayersError::Empty`] for no planes.
    pub fn uniform(near: f64, far: f64, count: usize) -> Result<Self, LayersError> {
        Self::planes(&uniform_disparities(near, far, count)?)
    }

    /// Layers from maps of disparity (1/scene unit) on the cells of the padded target, `[h, w]`
    /// each, all of one shape, in descending order at every cell.
    ///
    /// # Errors
    ///
    /// [`LayersError::Empty`] for none; [`LayersError::Shape`], [`LayersError::NotADisparity`] and
    /// [`LayersError::Unsorted`].
    pub fn maps(maps: Vec<Array2<f32>>) -> Result<Self, LayersError> {
        check(&maps)?;
        Ok(Self(maps.into_iter().map(Layer::Map).collect()))
    }

    /// Layers from maps of disparity (1/scene unit) on the pixels of the padded target, `[h, w]`
    /// each, all of one shape, in descending order at every pixel. They are never interpolated.
    ///
    /// # Errors
    ///
    /// As [`Self::maps`].
    pub fn pixels(maps: Vec<Array2<f32>>) -> Result<Self, LayersError> {
        check(&maps)?;
        let layer = |map: Array2<f32>| {
            Layer::Pixels(if map.is_standard_layout() { map } else { map.as_standard_layout().into_owned() })
        };
        Ok(Self(maps.into_iter().map(layer).collect()))
    }

    /// The layers, near → far.
    pub fn as_slice(&self) -> &[Layer] {
        &self.0
    }

    /// The number of layers, at least one.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.0.len()
    }
}

/// Refuses maps that differ in shape, hold anything but disparities, or are not in descending
/// order.
fn check(maps: &[Array2<f32>]) -> Result<(), LayersError> {
    let expected = maps.first().ok_or(LayersError::Empty)?.dim();
    for (index, map) in maps.iter().enumerate() {
        if map.dim() != expected {
            return Err(LayersError::Shape { index, found: map.dim(), expected });
        }
        // Folds vectorise, searches do not: a wrong value is searched for only if there is one.
        let bad = |value: &&f32| !(**value >= 0.0 && **value < f32::INFINITY);
        if map.iter().fold(false, |any, value| any | bad(&value)) {
            let value = *map.iter().find(bad).expect("one of them");
            return Err(LayersError::NotADisparity { index, value: value.into() });
        }
        let Some(before) = index.checked_sub(1).map(|before| &maps[before]) else { continue };
        if ndarray::Zip::from(map).and(before).fold(false, |any, value, before| any | (value > before)) {
            let (value, before) = map.iter().zip(before).find(|(value, before)| value > before).expect("one of them");
            return Err(LayersError::Unsorted { index, value: (*value).into(), before: (*before).into() });
        }
    }
    Ok(())
}

impl Layer {
    /// Writes the disparity (1/scene unit) of each pixel of a padded target, `width` pixels wide,
    /// to `out` `[height, width]`; in parallel.
    ///
    /// # Panics
    ///
    /// If the layer is a map without cells, or its pixels are not as many as those of `out`, or
    /// `width` is 0.
    pub fn fill(&self, width: usize, out: &mut [f32]) {
        match self {
            Self::Plane(disparity) => out.fill(*disparity as f32),
            Self::Map(map) => enlarge(map.view(), CELL, width, out),
            Self::Pixels(map) => {
                let rows = out.par_chunks_mut(width).zip_eq(map.as_slice().expect("standard layout").par_chunks(width));
                rows.for_each(|(out, row)| out.copy_from_slice(row));
            }
        }
    }
}

/// `count` disparities (1/scene unit) evenly spaced from 1/near to 1/far, near → far; a single one
/// lies in the middle. Depths in scene units; `far` may be infinite.
///
/// # Errors
///
/// [`LayersError::Range`] unless 0 < near < far; [`LayersError::Empty`] for a count of 0.
pub fn uniform_disparities(near: f64, far: f64, count: usize) -> Result<Vec<f64>, LayersError> {
    if !(near > 0.0 && near < far && near.is_finite() && ((1.0 / near) as f32).is_finite()) {
        return Err(LayersError::Range { near, far });
    }
    let (nearest, farthest) = (1.0 / near, 1.0 / far);
    Ok(match count {
        0 => return Err(LayersError::Empty),
        1 => vec![0.5 / near + 0.5 / far],
        _ => (0..count).map(|k| nearest + k as f64 / (count - 1) as f64 * (farthest - nearest)).collect(),
    })
}

/// Why a list of layers was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LayersError {
    /// The list has no layer.
    #[error("the list of disparities is empty: expected at least one")]
    Empty,
    /// A disparity that is negative or not finite.
    #[error("disparity {index} is {value}: expected 0 (infinity) or a larger number that f32 holds")]
    NotADisparity {
        /// Its index in the list.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// Not sorted near → far.
    #[error(
        "disparity {index} ({value}) is nearer than the one before it ({before}): expected descending disparities, near to far"
    )]
    Unsorted {
        /// Its index in the list.
        index: usize,
        /// Its value.
        value: f64,
        /// The one before it.
        before: f64,
    },
    /// Near and far are not a range of depths.
    #[error(
        "near is {near:?} and far is {far:?}: expected 0 < near < far, in scene units (if not given: the scene's), and a 1 / near that f32 holds"
    )]
    Range {
        /// The nearest depth given, scene units.
        near: f64,
        /// The farthest depth given, scene units.
        far: f64,
    },
    /// Maps of different shapes.
    #[error("the map of layer {index} has {found:?} cells: expected {expected:?}, like the first")]
    Shape {
        /// Index of the layer.
        index: usize,
        /// Its shape.
        found: (usize, usize),
        /// The shape of the first.
        expected: (usize, usize),
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_layers_are_refused_with_their_index() {
        assert_eq!(Layers::planes(&[]).unwrap_err(), LayersError::Empty);
        assert!(matches!(Layers::planes(&[0.1, 0.2]), Err(LayersError::Unsorted { index: 1, .. })));
        assert!(matches!(Layers::planes(&[f64::NAN]), Err(LayersError::NotADisparity { index: 0, .. })));
        assert!(matches!(Layers::uniform(2.0, 1.0, 4), Err(LayersError::Range { .. })));
        assert!(matches!(Layers::uniform(0.0, 1.0, 4), Err(LayersError::Range { .. })));
        assert!(matches!(Layers::uniform(f64::NAN, 1.0, 4), Err(LayersError::Range { .. })));
        let map = |last: f32| Array2::from_shape_vec((1, 3), vec![1.0, 0.0, last]).unwrap();
        for (maps, wrong) in [(vec![map(f32::INFINITY)], f64::INFINITY), (vec![map(1.0), map(-1.0)], -1.0)] {
            assert!(matches!(Layers::pixels(maps), Err(LayersError::NotADisparity { value, .. }) if value == wrong));
        }
        assert!(matches!(Layers::pixels(vec![map(f32::NAN)]), Err(LayersError::NotADisparity { index: 0, .. })));
        let unsorted = Layers::pixels(vec![map(0.5), map(0.5), map(0.75)]).unwrap_err();
        assert!(matches!(unsorted, LayersError::Unsorted { index: 2, value: 0.75, before: 0.5 }), "{unsorted}");
        assert!(Layers::pixels(vec![map(0.5), map(0.5), map(0.0)]).is_ok());
    }

    #[test]
    fn each_kind_of_layer_fills_a_target() {
        let filled = |layers: Layers| {
            assert_eq!((layers.len(), layers.as_slice().len()), (1, 1));
            let mut out = vec![-1.0; 4 * 2];
            layers.as_slice()[0].fill(4, &mut out);
            out
        };
        assert_eq!(filled(Layers::planes(&[0.25]).unwrap()), [0.25; 8]);
        let cells = Array2::from_shape_vec((1, 2), vec![1.0, 3.0]).unwrap();
        assert_eq!(filled(Layers::maps(vec![cells]).unwrap()), [1.0, 1.5, 2.5, 3.0, 1.0, 1.5, 2.5, 3.0]);
        // In the order of its columns in memory.
        let pixels = Array2::from_shape_fn((4, 2), |(x, y)| (4 * y + x) as f32).reversed_axes();
        assert_eq!(filled(Layers::pixels(vec![pixels]).unwrap()), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    }

    #[test]
    fn equal_planes_are_allowed_and_numbers_beyond_f32_and_other_shapes_are_not() {
        assert_eq!(Layers::planes(&[0.5, 0.5, 0.0]).unwrap().len(), 3);
        for value in [-1e-9, 1e39, f64::INFINITY] {
            assert_eq!(Layers::planes(&[value]).unwrap_err(), LayersError::NotADisparity { index: 0, value });
        }
        let unsorted = LayersError::Unsorted { index: 2, value: 0.4, before: 0.3 };
        assert_eq!(Layers::planes(&[0.5, 0.3, 0.4]).unwrap_err(), unsorted);
        let shape = LayersError::Shape { index: 1, found: (2, 1), expected: (1, 2) };
        assert_eq!(Layers::maps(vec![Array2::zeros((1, 2)), Array2::zeros((2, 1))]).unwrap_err(), shape);
        assert_eq!(Layers::maps(vec![]).unwrap_err(), LayersError::Empty);
    }

    #[test]
    fn two_wrong_values_are_no_less_wrong_than_one() {
        let map = |value: f32| Array2::from_elem((1, 2), value);
        assert!(matches!(Layers::maps(vec![map(f32::NAN)]), Err(LayersError::NotADisparity { index: 0, .. })));
        assert!(matches!(Layers::maps(vec![map(0.5), map(0.75)]), Err(LayersError::Unsorted { index: 1, .. })));
    }
}

#[cfg(test)]
mod uniform_tests {
    use super::*;

    #[test]
    fn uniform_planes_run_from_near_to_far_and_reach_infinity() {
        assert_eq!(uniform_disparities(0.5, f64::INFINITY, 3).unwrap(), [2.0, 1.0, 0.0]);
        assert_eq!(uniform_disparities(1.0, 2.0, 1).unwrap(), [0.75]);
    }

    #[test]
    fn uniform_planes_need_a_range_that_f32_holds() {
        assert_eq!(uniform_disparities(1.0, 4.0, 4).unwrap(), [1.0, 0.75, 0.5, 0.25]);
        assert_eq!(uniform_disparities(1.0, 4.0, 0), Err(LayersError::Empty));
        for (near, far) in [(1.0, 1.0), (2.0, 1.0), (-1.0, 1.0), (1e-39, 1.0), (f64::INFINITY, f64::INFINITY)] {
            assert_eq!(uniform_disparities(near, far, 2), Err(LayersError::Range { near, far }));
        }
        assert!(
            matches!(Layers::uniform(1.0, 4.0, 3).unwrap().as_slice(), [Layer::Plane(a), Layer::Plane(b), Layer::Plane(c)] if [*a, *b, *c] == [1.0, 0.625, 0.25])
        );
    }
}
