//! One machine's share of a job.

use std::fmt;
use std::str::FromStr;

/// Share `index` (0 to `count` - 1) of `count`, written `I/N` with I from 1 to N: every Nth target,
/// starting with the Ith.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Counted from 0.
    pub index: usize,
    /// From 1.
    pub count: usize,
}

/// Largest number of shares.
const MAX_COUNT: usize = 4096;
/// Environment variable with the number of shares.
const COUNT: &str = "LIVEVIEW_SHARDS";
/// Environment variables of Slurm's job arrays: index of the task, first index, number of tasks.
const SLURM: [&str; 3] = ["SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_MIN", "SLURM_ARRAY_TASK_COUNT"];
/// Environment variable of Kubernetes' indexed jobs: index of the pod.
const KUBERNETES: &str = "JOB_COMPLETION_INDEX";

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index + 1, self.count)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
        let parts = parts.filter(|&(index, count)| (1..=count).contains(&index) && count <= MAX_COUNT);
        let wrong = || format!("expected I/N with whole numbers, I from 1 to N, N up to {MAX_COUNT}; or auto");
        parts.map(|(index, count): (usize, usize)| Self { index: index - 1, count }).ok_or_else(wrong)
    }
}

impl Shard {
    /// Parses the value of the option: `I/N`, or `auto` for the variables of a cluster.
    pub fn parse(text: &str) -> Result<Self, String> {
        if text == "auto" { Self::from_environment(|name| std::env::var(name).ok()) } else { text.parse() }
    }

    /// The share of this process in Slurm's job array or Kubernetes' indexed job.
    fn from_environment(variable: impl Fn(&str) -> Option<String>) -> Result<Self, String> {
        let number = |name: &str| -> Result<Option<usize>, String> {
            let Some(text) = variable(name).filter(|text| !text.is_empty()) else { return Ok(None) };
            let wrong = || format!("auto: {name} is {text:?}; expected a whole number");
            text.parse().map(Some).map_err(|_| wrong())
        };
        let given = number(COUNT)?;
        let [slurm, first, tasks] = [number(SLURM[0])?, number(SLURM[1])?, number(SLURM[2])?];
        let (name, index, count) = match (slurm, number(KUBERNETES)?) {
            (Some(_), Some(_)) => {
                return Err(format!("auto: {} and {KUBERNETES} are both set; expected one, or I/N", SLURM[0]));
            }
            // With the number of shares given, a task that is resubmitted alone keeps its share.
            (Some(task), None) if given.is_some() => (SLURM[0], Some(task), given),
            (Some(task), None) => (SLURM[0], task.checked_sub(first.unwrap_or(0)), tasks),
            (None, Some(index)) => (KUBERNETES, Some(index), given),
            (None, None) => {
                return Err(format!("auto: neither {} nor {KUBERNETES} is set; expected one, or I/N", SLURM[0]));
            }
        };
        let Some(count) = count else {
            return Err(format!("auto: {name} is set, but not {COUNT}; expected the number of shards there"));
        };
        let valid = index.filter(|&index| index < count && count <= MAX_COUNT);
        let wrong = || {
            let index = index.map_or_else(|| format!("before {}", SLURM[1]), |index| index.to_string());
            format!(
                "auto: {name} gives shard {index} of {count}, counted from 0; expected one below {count}, without \
                 gaps, and at most {MAX_COUNT} shards"
            )
        };
        valid.map(|index| Self { index, count }).ok_or_else(wrong)
    }

    /// The elements of this share, in order.
    pub fn of<T>(self, all: Vec<T>) -> Vec<T> {
        all.into_iter().skip(self.index).step_by(self.count).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn auto(set: &[(&str, &str)]) -> Result<Shard, String> {
        Shard::from_environment(|name| set.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned()))
    }

    #[test]
    fn shares_are_interleaved_and_complete() {
        assert_eq!("2/3".parse::<Shard>().unwrap().of((0..8).collect()), [1, 4, 7]);
        assert_eq!("3/3".parse::<Shard>().unwrap().of(vec![0]), [0; 0]);
        for (targets, count) in [(64, 16), (7, 3), (2, 5)] {
            let shares = (0..count).flat_map(|index| Shard { index, count }.of((0..targets).collect()));
            let mut all: Vec<usize> = shares.collect();
            all.sort_unstable();
            assert_eq!(all, (0..targets).collect::<Vec<_>>());
        }
        for wrong in ["0/3", "4/3", "1/0", "1", "a/b", "-1/3", "1/4097", "1/2/3", ""] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn auto_takes_the_share_from_slurm_or_kubernetes() {
        let [id, min, count] = SLURM;
        let shard = |index, count| Ok(Shard { index, count });
        assert_eq!(auto(&[(id, "5"), (min, "1"), (count, "16")]), shard(4, 16));
        assert_eq!(auto(&[(id, "5"), (min, "0"), (count, "16")]), shard(5, 16));
        assert_eq!(auto(&[(id, "7"), (min, "7"), (count, "1"), (COUNT, "16")]), shard(7, 16), "a resubmitted task");
        assert_eq!(auto(&[(KUBERNETES, "0"), (COUNT, "4")]), shard(0, 4));
        for (set, word) in [
            (&[][..], "neither"),
            (&[(KUBERNETES, "0")][..], COUNT),
            (&[(KUBERNETES, "4"), (COUNT, "4")][..], "shard 4 of 4"),
            (&[(KUBERNETES, "x"), (COUNT, "4")][..], "expected a whole number"),
            (&[(KUBERNETES, "1"), (id, "1")][..], "both set"),
            (&[(id, "9"), (min, "1"), (count, "3")][..], "without gaps"),
            (&[(id, "0"), (min, "1"), (count, "3")][..], min),
        ] {
            let error = auto(set).unwrap_err();
            assert!(error.contains(word), "{error}");
        }
    }
}
