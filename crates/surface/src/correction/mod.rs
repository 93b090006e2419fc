//! Photos brought to the same exposure and sharpness, by what their correspondences show.

mod correspondences;
mod exposure;
mod pair_statistics;
mod sharpness;

pub use exposure::exposure_gains;
pub(super) use exposure::{balanced, gains_to_first};
pub(super) use pair_statistics::PairStatistics;
pub use sharpness::sharpening;
pub(super) use sharpness::sharpening_with;
