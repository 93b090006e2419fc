//! From the depth of photos to the target's surface: edges, confirmed by other photos,
//! splatted to the target, averaged, holes filled.

mod confirmed_depth;
mod consistency;
mod nearer_edges;
pub(super) mod photo_variance;
pub(super) mod project;
pub(super) mod splat;
pub(super) mod surface;
mod surface_view;
pub(super) mod target_search;
pub(super) mod visible;

pub use confirmed_depth::ConfirmedDepth;
pub(super) use consistency::confirmed_by;
pub use consistency::{ConsistencyVotes, confirmed};
pub use nearer_edges::nearer_edges;
pub(super) use surface::find_surface;
pub use surface::{Surface, surface};
pub use surface_view::SurfaceView;
