//! Guided layers: a coarse-to-fine search finds a range of disparities for each pixel, which a few
//! layers divide.
//!
//! The first search, at 1/4 resolution, sweeps the views through planes that are one cell of
//! parallax apart. The matching cost is the variance of the colours of the views over a window
//! ([`layer_costs`]); it is aggregated along rows and columns ([`semi_global()`]), and the
//! disparity of least cost is taken ([`winner_takes_all()`]). The range of a neighbourhood is its
//! least to its largest disparity, half a plane step wider at both ends ([`range_of`]). The second
//! search, at 1/2 resolution, evaluates a few layers that divide this range cell by cell
//! ([`fine_layers`]), without aggregation. The extremes of the disparities that it finds are the
//! final range. Multi-view stereo knows this as adaptive thin volumes (UCS-Net, Cheng et al.,
//! 2020).
//!
//! Measured alternatives: docs/design-log/guided-layers.md.

mod carried_surface;
mod matching_cost;
mod range_map;
mod search;
mod semi_global;
mod target_views;
mod winner_takes_all;

pub use carried_surface::{CarriedSurface, guided_range};
pub use matching_cost::layer_costs;
pub(crate) use matching_cost::window_variance;
pub use range_map::{RangeMap, range_of};
pub use search::{COARSE, GuidedSearch, PENALTIES, SearchStages, WINDOWS, fine_layers};
pub use semi_global::{Penalties, semi_global};
pub use winner_takes_all::winner_takes_all;
