//! Why a frame could not be rendered.

use crate::network::NetworkError;

/// Why a frame could not be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// Not as many views as the network takes.
    #[error("the network takes {expected} views, but {found} were given")]
    Views {
        /// V of the network.
        expected: usize,
        /// How many were given.
        found: usize,
    },
    /// The network failed.
    #[error(transparent)]
    Network(#[from] NetworkError),
}
