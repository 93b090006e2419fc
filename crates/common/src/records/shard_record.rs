//! The contents of a shard's record.

use std::collections::HashMap;

use anyhow::{Context, Result, anyhow, bail};
use serde_json::{Map, Value};

use super::text;
use crate::args::output::stem;
use crate::shard::Shard;

/// What a shard has done of its job.
#[derive(Debug)]
pub struct ShardRecord {
    /// The share of the job.
    pub shard: Shard,
    /// The job's options, and digests of what it reads.
    pub job: Map<String, Value>,
    /// All pictures of the job, in order, each once and in a file of its own.
    pub targets: Vec<String>,
    /// The entries of the finished pictures, all of this share.
    pub done: Map<String, Value>,
}

impl ShardRecord {
    /// Parses a record; an incomplete last line is ignored.
    pub fn parse(text: &[u8]) -> Result<Self> {
        let mut found = text::parse(text).context("not JSON")?;
        let shard = format!("{}/{}", found["shard"]["index"], found["shard"]["count"]).parse::<Shard>();
        let shard = shard.map_err(|_| anyhow!("shard is {}; expected an index and a count", found["shard"]))?;
        let names = found["targets"].as_array().into_iter().flatten();
        let targets: Option<Vec<String>> = names.map(|name| name.as_str().map(str::to_owned)).collect();
        let (Value::Object(job), Value::Object(done), Some(targets)) =
            (found["job"].take(), found["done"].take(), targets.filter(|targets| !targets.is_empty()))
        else {
            bail!("expected \"job\", \"targets\" and \"done\", as `render --shard` writes them");
        };
        let record = Self { shard, job, targets, done };
        record.check_share()?;
        Ok(record)
    }

    /// Checks that each picture is listed once, and that those that are done are of the shard's
    /// share.
    fn check_share(&self) -> Result<()> {
        let Self { shard, targets, done, .. } = self;
        if let Some((name, other)) = pair_of_one_file(targets) {
            bail!("\"targets\" lists {name} and {other}, which are one picture; expected each picture once");
        }
        let positions: HashMap<_, _> = targets.iter().enumerate().map(|(at, name)| (name, at)).collect();
        let is_shared = |name: &&String| positions.get(name).is_some_and(|at| at % shard.count == shard.index);
        match done.keys().find(|name| !is_shared(name)) {
            Some(name) => bail!("\"done\" lists {name}; expected only pictures of shard {shard}"),
            None => Ok(()),
        }
    }
}

/// Two of these pictures that have one file name.
pub fn pair_of_one_file(names: &[String]) -> Option<(&str, &str)> {
    let mut files = HashMap::with_capacity(names.len());
    names.iter().find_map(|name| files.insert(stem(name), name).map(|other| (other.as_str(), name.as_str())))
}
