//! Guided layers: a coarse-to-fine search gives each pixel its own range of disparities, which few layers divide.
//!
//! The first search, at 1/4 resolution, sweeps the views through planes a cell of parallax apart, takes the variance of their colours
//! over a window ([`layer_costs`]), aggregates it along rows and columns ([`semi_global()`]) and keeps the disparity of least cost
//! ([`winner_takes_all()`]). The least and the largest disparity of each neighbourhood, half a plane step wider ([`range_of`]), are
//! searched again at 1/2 resolution: a few layers that divide that range cell by cell ([`fine_layers`]), without aggregation. The
//! extremes of the disparities that this finds are the range. Known in multi-view stereo as adaptive thin volumes (UCS-Net, Cheng et
//! al., 2020).
//!
//! Measured alternatives: docs/design-log/guided-layers.md.

mod matching_cost;
mod range_map;
mod search;
mod semi_global;
mod winner_takes_all;

pub use matching_cost::layer_costs;
pub(crate) use range_map::neighbourhood;
pub use range_map::{RangeMap, range_of};
pub(crate) use search::Levels;
pub use search::{COARSE, GuidedSearch, SearchStages, WINDOWS, fine_layers};
pub use semi_global::semi_global;
pub use winner_takes_all::winner_takes_all;
