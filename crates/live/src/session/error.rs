//! Why a session, or one of its time steps, failed.

use liveview::geometry::{Size, TooFewViews};
use liveview::layers::LayersError;
use liveview::render::RenderError;

/// Why a session, or one of its time steps, failed. After a failed time step the session can go on
/// with the next.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LiveError {
    /// A session without a network.
    #[error("a session without a network; expected at least one")]
    NoNetwork,
    /// The number of photos differs from that of the cameras.
    #[error("{found} photos for {expected} cameras; expected one entry per camera, None where it delivered nothing")]
    Photos {
        /// Cameras of the rig.
        expected: usize,
        /// Entries given.
        found: usize,
    },
    /// A photo's size differs from its camera's.
    #[error("the photo of camera {camera} is {found}; expected {expected}")]
    Size {
        /// Index of the camera.
        camera: usize,
        /// The photo's size, pixels.
        found: Size,
        /// The camera's size, pixels.
        expected: Size,
    },
    /// Fewer photos face the target's direction than the smallest network takes.
    #[error(transparent)]
    Views(#[from] TooFewViews),
    /// Near and far span no range of depths.
    #[error(transparent)]
    Layers(#[from] LayersError),
    /// The network failed.
    #[error(transparent)]
    Render(#[from] RenderError),
}
