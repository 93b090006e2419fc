//! Depth maps of photos stored in a folder, so that a later run reads them instead of searching.
//!
//! Each depth map is a separate file ([`mod@file`]), named by a digest of everything that the
//! depth depends on ([`key`]): a file under the right name is never outdated, scenes share a
//! folder, and any file may be deleted at any time. A file gets its name only when it is complete,
//! so several processes may share a folder: where two find the same depth the last file wins, and
//! both are identical. A held-out photo is part of no key, as it is no photo's neighbour.

mod depth_cache;
mod file;
mod key;
#[cfg(test)]
mod tests;

pub use depth_cache::DepthCache;
#[cfg(fuzzing)]
pub use file::read_for_fuzzing;
pub use key::{DepthKey, PhotoDigest};
