//! Files: read whole up to a limit, and written whole or not at all.

pub mod atomic;
pub mod bounded;
pub(crate) mod npy;
