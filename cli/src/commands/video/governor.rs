//! Adapts the work per frame of a live video to the machine's speed: first the number of guided layers, then the size of the target.
//! Down at once to the level that is expected to fit the budget, up again one level at a time.

use std::time::Duration;

use serde_json::{Value, json};

/// Frames in a row over the budget after which the level falls …
const LATE: usize = 3;
/// … or one that takes more than this many times the budget.
const GROSS: f64 = 2.0;
/// Frames in a row that would have fitted at the next higher level, after which the level rises; twice as many after each fall.
const ROOM: usize = 30;
/// The largest such number.
const LONGEST: usize = 30 * 32;
/// Share of the budget that the work of a higher level must fit into.
const COMFORT: f64 = 0.8;

/// A level: the work of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Level {
    /// Number of guided layers; `None` for planes, whose number does not change.
    pub(super) layers: Option<usize>,
    /// Scale of the target's sides, at most 1.
    pub(super) scale: f64,
}

impl Level {
    /// Work, in layers of the full size; finding the layers takes about as long as one of them.
    fn work(&self) -> f64 {
        (self.layers.unwrap_or(0) as f64 + 1.0) * self.scale * self.scale
    }

    pub(super) fn json(&self) -> Value {
        json!({ "layers": self.layers, "scale": self.scale })
    }
}

/// Chooses the level from the frames' times.
pub(super) struct Governor {
    budget: Duration,
    /// The most work first.
    levels: Vec<Level>,
    at: usize,
    late: usize,
    room: usize,
    patience: usize,
}

impl Governor {
    /// Levels from that many guided layers down; with planes (`None`) only the size changes.
    pub(super) fn new(budget: Duration, guided: Option<usize>) -> Self {
        let fewer = [4, 2, 1].into_iter().map(Some).filter(|&fewer| fewer < guided);
        let mut levels: Vec<Level> =
            std::iter::once(guided).chain(fewer).map(|layers| Level { layers, scale: 1.0 }).collect();
        let least = levels[levels.len() - 1];
        levels.extend([0.75, 0.5].map(|scale| Level { scale, ..least }));
        Self { budget, levels, at: 0, late: 0, room: 0, patience: ROOM }
    }

    pub(super) fn level(&self) -> Level {
        self.levels[self.at]
    }

    /// The scales of all levels.
    pub(super) fn scales(&self) -> Vec<f64> {
        let mut scales: Vec<f64> = self.levels.iter().map(|level| level.scale).collect();
        scales.dedup();
        scales
    }

    /// Records the time of a frame; the new level, if it changes.
    pub(super) fn note(&mut self, took: Duration) -> Option<Level> {
        let share = took.as_secs_f64() / self.budget.as_secs_f64();
        let now = self.level().work();
        let expected = |level: &Level| share * level.work() / now;
        if share > 1.0 {
            (self.late, self.room) = (self.late + 1, 0);
            if self.late < LATE && share <= GROSS {
                return None;
            }
            let less = &self.levels[self.at + 1..];
            let steps = less.iter().position(|level| expected(level) <= 1.0).map_or(less.len(), |fits| fits + 1);
            if steps == 0 {
                return None;
            }
            (self.at, self.late) = (self.at + steps, 0);
            self.patience = (2 * self.patience).min(LONGEST);
            return Some(self.level());
        }
        self.late = 0;
        let more = self.at.checked_sub(1)?;
        self.room = if expected(&self.levels[more]) < COMFORT { self.room + 1 } else { 0 };
        if self.room < self.patience {
            return None;
        }
        (self.at, self.room) = (more, 0);
        Some(self.level())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(governor: &mut Governor, frames: usize, milliseconds: u64) -> Vec<Level> {
        (0..frames).filter_map(|_| governor.note(Duration::from_millis(milliseconds))).collect()
    }

    fn pairs(levels: &[Level]) -> Vec<(usize, f64)> {
        levels.iter().map(|level| (level.layers.unwrap_or(0), level.scale)).collect()
    }

    #[test]
    fn layers_go_first_then_size_and_nothing_below() {
        let mut governor = Governor::new(Duration::from_millis(33), Some(4));
        assert_eq!(after(&mut governor, 2, 40), [], "two late frames are an accident");
        assert_eq!(pairs(&after(&mut governor, 40, 40)), [(2, 1.0), (1, 1.0), (1, 0.75), (1, 0.5)]);
        let planes = Governor::new(Duration::from_millis(33), None);
        assert_eq!(planes.levels.len(), 3);
    }

    #[test]
    fn it_goes_straight_to_the_most_that_fits() {
        // Work 5, 3, 2, 1.125 and 0.5: of 60 ms 36, 24, …, of 100 ms 60, 40, 22.5.
        let mut governor = Governor::new(Duration::from_millis(33), Some(4));
        assert_eq!(pairs(&after(&mut governor, 3, 60)), [(1, 1.0)], "not past what fits");
        let mut governor = Governor::new(Duration::from_millis(33), Some(4));
        assert_eq!(pairs(&after(&mut governor, 1, 100)), [(1, 0.75)], "far too much: at once");
        let mut governor = Governor::new(Duration::from_millis(33), Some(4));
        assert_eq!(pairs(&after(&mut governor, 9, 1000)), [(1, 0.5)], "where nothing fits, the least, once");
    }

    #[test]
    fn it_comes_back_when_there_is_room_and_the_more_slowly_the_more_often_that_failed() {
        let mut governor = Governor::new(Duration::from_millis(33), Some(2));
        after(&mut governor, 3, 45);
        assert_eq!(after(&mut governor, 300, 25), [], "two layers would not fit");
        let back = |governor: &mut Governor| (1..1000).find(|_| governor.note(Duration::from_millis(10)).is_some());
        assert_eq!(back(&mut governor), Some(2 * ROOM));
        assert_eq!(governor.level().layers, Some(2));
        after(&mut governor, 3, 45);
        assert_eq!(back(&mut governor), Some(4 * ROOM));
    }
}
