//! Reads the records of shards, and checks that they are of one job and complete.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use liveview::fs::bounded;
use liveview_common::args::output::stem;
use liveview_common::interrupt::{self, Interrupted};
use serde_json::{Map, Value};

use crate::commands::render::{record, record_text};
use crate::shard::Shard;

/// The field of a job that may differ between machines; photos and cameras are compared by their
/// contents.
const MAY_DIFFER: &str = "scene";
/// Fields that differ as a consequence of others, and so are compared last.
const DIGESTS: [&str; 2] = ["cameras", "photos"];

/// The record of a shard.
pub(super) struct ShardRecord {
    pub(super) path: PathBuf,
    shard: Shard,
    pub(super) job: Map<String, Value>,
    /// All pictures of the job, in order.
    targets: Vec<String>,
    done: Map<String, Value>,
}

impl ShardRecord {
    /// The files of the pictures that it lists as done.
    pub(super) fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.done.keys().map(|name| self.file(name))
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
pub(super) fn read(folders: &[PathBuf]) -> Result<Vec<ShardRecord>> {
    let mut records = Vec::new();
    for folder in folders {
        let entries = std::fs::read_dir(folder).with_context(|| format!("{}: cannot be read", folder.display()))?;
        let mut files: Vec<PathBuf> = entries
            .map(|entry| entry.map(|entry| entry.path()))
            .collect::<std::io::Result<_>>()
            .with_context(|| format!("{}: cannot be read", folder.display()))?;
        files.retain(|file| shard_of_name(file).is_some());
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

/// The shard that the name of a record gives; `None` for another name.
fn shard_of_name(file: &Path) -> Option<Shard> {
    let name = file.file_name()?.to_str()?.strip_prefix("liveview_")?.strip_suffix(".json")?;
    name.replacen("_of_", "/", 1).parse::<Shard>().ok()
}

fn read_one(path: &Path) -> Result<ShardRecord> {
    let text = bounded::read_regular(path, bounded::MAX_JSON_BYTES).context("cannot be read")?;
    let mut found = record_text::parse(&text).context("not JSON")?;
    let shard = format!("{}/{}", found["shard"]["index"], found["shard"]["count"]).parse::<Shard>();
    let shard = shard.map_err(|_| anyhow!("shard is {}; expected an index and a count", found["shard"]))?;
    if shard_of_name(path) != Some(shard) {
        bail!("is the record of shard {shard}; expected the name {}", record::name(Some(shard)));
    }
    let names = found["targets"].as_array().into_iter().flatten();
    let targets: Option<Vec<String>> = names.map(|name| name.as_str().map(str::to_owned)).collect();
    let (Value::Object(job), Value::Object(done), Some(targets @ [_, ..])) =
        (found["job"].take(), found["done"].take(), targets.as_deref())
    else {
        bail!("expected \"job\", \"targets\" and \"done\", as `render --shard` writes them");
    };
    check_share(shard, targets, &done)?;
    Ok(ShardRecord { path: path.to_owned(), shard, job, targets: targets.to_vec(), done })
}

/// Checks that each picture is listed once, and that those that are done are of the shard's share.
fn check_share(shard: Shard, targets: &[String], done: &Map<String, Value>) -> Result<()> {
    let mut positions = HashMap::with_capacity(targets.len());
    for (at, name) in targets.iter().enumerate() {
        if positions.insert(name, at).is_some() {
            bail!("\"targets\" lists {name} twice; expected each picture once");
        }
    }
    let is_shared = |name: &&String| positions.get(name).is_some_and(|at| at % shard.count == shard.index);
    match done.keys().find(|name| !is_shared(name)) {
        Some(name) => bail!("\"done\" lists {name}; expected only pictures of shard {shard}"),
        None => Ok(()),
    }
}

/// The number of different shards. A shard that ran twice may have written to two folders.
pub(super) fn count(records: &[ShardRecord]) -> usize {
    records.iter().map(|record| record.shard.index).collect::<HashSet<_>>().len()
}

/// Checks that the records are of one job with one number of shards.
pub(super) fn check_one_job(records: &[ShardRecord]) -> Result<()> {
    let Some((first, others)) = records.split_first() else { return Ok(()) };
    let (text, first_path) =
        (|value: Option<&Value>| value.map_or("missing".to_owned(), Value::to_string), first.path.display());
    for other in others {
        let at = other.path.display();
        if other.shard.count != first.shard.count {
            bail!(
                "{at} is one of {} shards, {first_path} one of {}; expected the records of one job only",
                other.shard.count,
                first.shard.count
            );
        }
        let mut fields: Vec<&String> = first.job.keys().chain(other.job.keys()).collect();
        fields.retain(|field| *field != MAY_DIFFER);
        fields.sort_by_key(|field| DIGESTS.contains(&field.as_str()));
        for field in fields {
            let (a, b) = (first.job.get(field), other.job.get(field));
            if a != b {
                bail!("{at} is of another job than {first_path}: \"{field}\" is {}, expected {}", text(b), text(a));
            }
        }
        if other.targets != first.targets {
            bail!("{at} is of another job than {first_path}: \"targets\" differ; expected the same");
        }
    }
    Ok(())
}

/// Every picture of the job, in order; if one is missing or changed, an error that says which
/// shards to run again.
pub(super) fn pictures(records: &[ShardRecord]) -> Result<Vec<Picture>> {
    let (targets, count) = (&records[0].targets, records[0].shard.count);
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
        let has_record = records.iter().any(|record| record.shard == shard);
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
fn picture(record: &ShardRecord, name: &str) -> Option<Picture> {
    let entry = record.done.get(name)?;
    let file = record.file(name);
    let bytes = bounded::read_regular(&file, bounded::MAX_BYTES).ok()?;
    (entry["files"][0] == record::digest(&bytes)).then(|| Picture { name: name.to_owned(), file, entry: entry.clone() })
}
