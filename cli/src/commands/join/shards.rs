//! Reads the records of shards, and checks that they are of one job and complete.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use liveview::fs::bounded;
use liveview_common::args::output::stem;
use liveview_common::interrupt::{self, Interrupted};
use liveview_common::records::shard_record::ShardRecord;
use liveview_common::shard::Shard;
use serde_json::Value;

use crate::commands::render::record;

/// The field of a job that may differ between machines; photos and cameras are compared by their
/// contents.
const MAY_DIFFER: &str = "scene";
/// Fields that differ as a consequence of others, and so are compared last.
const DIGESTS: [&str; 2] = ["cameras", "photos"];

/// A record, and where it lies.
pub(super) struct RecordFile {
    pub(super) path: PathBuf,
    pub(super) record: ShardRecord,
}

impl RecordFile {
    /// The files of the pictures that it lists as done.
    pub(super) fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.record.done.keys().map(|name| self.file(name))
    }

    fn file(&self, name: &str) -> PathBuf {
        self.path.with_file_name(format!("{}.png", stem(name)))
    }
}

/// An existing picture, and its entry in the record.
pub(super) struct Picture {
    pub(super) name: String,
    pub(super) file: PathBuf,
    pub(super) entry: Value,
}

/// Reads the records in these folders.
pub(super) fn read(folders: &[PathBuf]) -> Result<Vec<RecordFile>> {
    let mut records = Vec::new();
    for folder in folders {
        let entries = std::fs::read_dir(folder).with_context(|| format!("{}: cannot be read", folder.display()))?;
        let mut files: Vec<PathBuf> = entries
            .map(|entry| entry.map(|entry| entry.path()))
            .collect::<std::io::Result<_>>()
            .with_context(|| format!("{}: cannot be read", folder.display()))?;
        files.retain(|file| is_name_of_shard(file));
        files.sort();
        if files.is_empty() {
            bail!(
                "{}: no record of a shard; expected liveview_I_of_N.json, which `liveview render --shard I/N -o {0}` writes",
                folder.display()
            );
        }
        for file in files {
            records.push(read_one(&file).map_err(|error| anyhow!("{}: {error:#}", file.display()))?);
        }
    }
    Ok(records)
}

/// Whether a file is named as the record of a shard.
fn is_name_of_shard(file: &Path) -> bool {
    let name = file.file_name().and_then(|name| name.to_str()?.strip_prefix("liveview_")?.strip_suffix(".json"));
    name.is_some_and(|name| name.replacen("_of_", "/", 1).parse::<Shard>().is_ok())
}

fn read_one(path: &Path) -> Result<RecordFile> {
    let record = ShardRecord::parse(&bounded::read_regular(path, bounded::MAX_JSON_BYTES).context("cannot be read")?)?;
    let name = record::name(Some(record.shard));
    if path.file_name() != Some(name.as_ref()) {
        bail!("is the record of shard {}; expected the name {name}", record.shard);
    }
    Ok(RecordFile { path: path.to_owned(), record })
}

/// The number of different shards. A shard that ran twice may have written to two folders.
pub(super) fn count(records: &[RecordFile]) -> usize {
    records.iter().map(|file| file.record.shard.index).collect::<HashSet<_>>().len()
}

/// Checks that the records are of one job with one number of shards.
pub(super) fn check_one_job(records: &[RecordFile]) -> Result<()> {
    let Some((first, others)) = records.split_first() else { return Ok(()) };
    let (text, first_path) =
        (|value: Option<&Value>| value.map_or("missing".to_owned(), Value::to_string), first.path.display());
    for other in others {
        let at = other.path.display();
        if other.record.shard.count != first.record.shard.count {
            bail!(
                "{at} is one of {} shards, {first_path} one of {}; expected the records of one job only",
                other.record.shard.count,
                first.record.shard.count
            );
        }
        let mut fields: Vec<&String> = first.record.job.keys().chain(other.record.job.keys()).collect();
        fields.retain(|field| *field != MAY_DIFFER);
        fields.sort_by_key(|field| DIGESTS.contains(&field.as_str()));
        for field in fields {
            let (a, b) = (first.record.job.get(field), other.record.job.get(field));
            if a != b {
                bail!("{at} is of another job than {first_path}: \"{field}\" is {}, expected {}", text(b), text(a));
            }
        }
        if other.record.targets != first.record.targets {
            bail!("{at} is of another job than {first_path}: \"targets\" differ; expected the same");
        }
    }
    Ok(())
}

/// Every picture of the job, in order; if one is missing or changed, an error that says which
/// shards to run again.
pub(super) fn pictures(records: &[RecordFile]) -> Result<Vec<Picture>> {
    let (targets, count) = (&records[0].record.targets, records[0].record.shard.count);
    let mut missing: Vec<Vec<&str>> = vec![Vec::new(); count];
    let mut found = Vec::with_capacity(targets.len());
    for (at, name) in targets.iter().enumerate() {
        if interrupt::requested() {
            return Err(Interrupted.into());
        }
        // A shard that ran twice may have written to two folders.
        let mut candidates = records.iter().filter_map(|record| picture(record, name));
        match candidates.next() {
            Some(picture) => found.push(picture),
            None => missing[at % count].push(name),
        }
    }
    let describe = |(index, names): (usize, &Vec<&str>)| {
        let shard = Shard { index, count };
        let has_record = records.iter().any(|file| file.record.shard == shard);
        let what = if has_record { "lacks" } else { "has no record and lacks" };
        let pictures = if names.len() == 1 { "picture" } else { "pictures" };
        (!names.is_empty()).then(|| format!("shard {shard} {what} {} {pictures} ({} first)", names.len(), names[0]))
    };
    let incomplete: Vec<String> = missing.iter().enumerate().filter_map(describe).collect();
    if !incomplete.is_empty() {
        const LISTED_SHARDS: usize = 4;
        let more = incomplete.len().saturating_sub(LISTED_SHARDS);
        let more = if more > 0 { format!(" and {more} more shards") } else { String::new() };
        bail!(
            "{} of {} pictures are missing or changed: {}{more}; expected all: run these shards again with --resume",
            targets.len() - found.len(),
            targets.len(),
            incomplete[..incomplete.len().min(LISTED_SHARDS)].join(", ")
        );
    }
    Ok(found)
}

/// A picture that a record lists, if it exists unchanged.
fn picture(record: &RecordFile, name: &str) -> Option<Picture> {
    let entry = record.record.done.get(name)?;
    let file = record.file(name);
    let bytes = bounded::read_regular(&file, bounded::MAX_BYTES).ok()?;
    (entry["files"][0] == record::digest(&bytes)).then(|| Picture { name: name.to_owned(), file, entry: entry.clone() })
}
