//! The record of a shard: what is parsed, is parsed again from what is written, and from that text
//! with a further line that is incomplete.
#![no_main]

use libfuzzer_sys::fuzz_target;
use liveview_common::records::shard_record::ShardRecord;
use liveview_common::records::text::{END, document};
use serde_json::{Value, json};

fuzz_target!(|bytes: &[u8]| {
    let Ok(ShardRecord { shard, job, targets, done }) = ShardRecord::parse(bytes) else { return };
    assert!(shard.index < shard.count && !targets.is_empty() && done.len() <= targets.len());
    assert!(shard.of(targets.clone()).iter().filter(|target| done.contains_key(*target)).count() == done.len());
    let members = [
        ("job", Value::Object(job.clone())),
        ("shard", json!({ "index": shard.index + 1, "count": shard.count })),
        ("targets", json!(targets)),
    ];
    let written = document(&members, &done);
    let check = |text: &str| {
        let again = ShardRecord::parse(text.as_bytes()).unwrap_or_else(|error| panic!("{text}: {error}"));
        assert!(again.shard == shard && again.job == job && again.targets == targets && again.done == done, "{text}");
    };
    check(&written);
    if !done.is_empty() {
        check(&format!("{},\n\"incompl", written.strip_suffix(END).unwrap()));
    }
});
