//! Why a frame could not be rendered.

use crate::fs::memory::MemoryError;
use crate::network::NetworkError;

/// Why a frame could not be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The views are more or fewer than the network takes.
    #[error("the network takes {expected} views, but {found} were given")]
    Views {
        /// V of the network.
        expected: usize,
        /// The number of views given.
        found: usize,
    },
    /// Opacity is per pixel of parallax to the next plane, but some layer is not a plane.
    #[error("{network}: opacity is per pixel of parallax (metadata `alpha_spacing`), expected layers that are planes")]
    NotPlanes {
        /// The network's name.
        network: String,
    },
    /// The layers need more memory than is available.
    #[error("rendering {0}; expected a smaller target or fewer layers at once")]
    Memory(#[from] MemoryError),
    /// The network failed.
    #[error(transparent)]
    Network(#[from] NetworkError),
}
