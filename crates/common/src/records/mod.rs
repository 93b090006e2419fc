//! Files in which a command records what it has done, to be read by a later one.

pub mod done_list;
pub mod shard_record;
pub mod text;
