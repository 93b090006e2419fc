//! Files: read up to a size limit, written completely or not at all. Memory: checked before
//! allocation.

pub mod atomic;
pub mod bounded;
pub mod memory;
pub(crate) mod npy;
pub mod unfinished;
