//! Layers: disparity per target pixel, near → far.
//!
//! A layer is a plane (constant disparity δ = 1/z, in 1/scene unit: the paper's case), or a map of
//! disparity: on cells of [`CELL`]×[`CELL`] target pixels, interpolated bilinearly, or on single
//! pixels. Layers are ordered near → far *at every pixel*, so that compositing along a target ray
//! is exact.

mod cells;
mod cover;
mod error;
pub mod guided;
mod histogram;
mod layer;
mod spec;
mod uniform;

#[cfg(feature = "surface")]
pub(crate) use cells::enlarge;
pub use cells::{CELL, STRIDE, padded};
pub use cover::cover_planes;
pub use error::LayersError;
pub use histogram::{plane_histogram, select_planes};
pub use layer::{Layer, Layers};
pub use spec::{LayerSpec, LayerSpecError, MAX_LAYERS};
pub use uniform::uniform_disparities;
