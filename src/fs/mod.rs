//! Files: read whole up to a limit, and written whole or not at all. Memory: refused before it is taken.

pub mod atomic;
pub mod bounded;
pub mod memory;
pub(crate) mod npy;
