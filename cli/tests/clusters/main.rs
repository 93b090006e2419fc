//! Many pictures: `render --shard`, `join` and `batch`.

#[path = "../common/mod.rs"]
mod common;

mod batch;
mod shards;
