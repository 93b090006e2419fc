//! Why a list of layers was refused.

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
