//! What a live video gives up when the machine is too slow: guided layers first, then the size of the target; and takes back
//! when there is room. Down at once to what is expected to fit, up one step at a time.

use std::time::Duration;

use serde_json::{Value, json};

/// Frames in a row over the budget before less is done …
const LATE: usize = 3;
/// … or one that takes more than this many times the budget.
const GROSS: f64 = 2.0;
/// Frames in a row that would have fitted with more before more is done; twice as many after each time that it was too much.
const ROOM: usize = 30;
/// The longest such wait.
const LONGEST: usize = 30 * 32;
/// Part of the budget that more work must fit into.
const COMFORT: f64 = 0.8;

/// How much work a frame is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rung {
    /// Guided layers; `None` of planes, which stay as many as they are.
    pub(super) layers: Option<usize>,
    /// Sides of the target, of what was asked for.
    pub(super) scale: f64,
}

impl Rung {
    /// Work, in layers of the full size; finding the layers is about as much as one.
    fn work(&self) -> f64 {
        (self.layers.unwrap_or(0) as f64 + 1.0) * self.scale * self.scale
    }

    pub(super) fn json(&self) -> Value {
        json!({ "layers": self.layers, "scale": self.scale })
    }
}

/// Watches the frames' times.
pub(super) struct Governor {
    budget: Duration,
    /// Most work first.
    rungs: Vec<Rung>,
    at: usize,
    late: usize,
    room: usize,
    patience: usize,
}

impl Governor {
    /// From as many guided layers; of planes (`None`) only the size is left to give.
    pub(super) fn new(budget: Duration, guided: Option<usize>) -> Self {
        let fewer = [4, 2, 1].into_iter().map(Some).filter(|&fewer| fewer < guided);
        let mut rungs: Vec<Rung> =
            std::iter::once(guided).chain(fewer).map(|layers| Rung { layers, scale: 1.0 }).collect();
        let least = rungs[rungs.len() - 1];
        rungs.extend([0.75, 0.5].map(|scale| Rung { scale, ..least }));
        Self { budget, rungs, at: 0, late: 0, room: 0, patience: ROOM }
    }

    pub(super) fn rung(&self) -> Rung {
        self.rungs[self.at]
    }

    /// The sizes it may come to.
    pub(super) fn scales(&self) -> Vec<f64> {
        let mut scales: Vec<f64> = self.rungs.iter().map(|rung| rung.scale).collect();
        scales.dedup();
        scales
    }

    /// Takes note of what a frame took; the new rung, if it changes.
    pub(super) fn note(&mut self, took: Duration) -> Option<Rung> {
        // Of the budget.
        let share = took.as_secs_f64() / self.budget.as_secs_f64();
        let now = self.rung().work();
        let expected = |rung: &Rung| share * rung.work() / now;
        if share > 1.0 {
            (self.late, self.room) = (self.late + 1, 0);
            if self.late < LATE && share <= GROSS {
                return None;
            }
            let less = &self.rungs[self.at + 1..];
            let steps = less.iter().position(|rung| expected(rung) <= 1.0).map_or(less.len(), |fits| fits + 1);
            if steps == 0 {
                return None;
            }
            (self.at, self.late) = (self.at + steps, 0);
            self.patience = (2 * self.patience).min(LONGEST);
            return Some(self.rung());
        }
        self.late = 0;
        let more = self.at.checked_sub(1)?;
        self.room = if expected(&self.rungs[more]) < COMFORT { self.room + 1 } else { 0 };
        if self.room < self.patience {
            return None;
        }
        (self.at, self.room) = (more, 0);
        Some(self.rung())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(governor: &mut Governor, frames: usize, milliseconds: u64) -> Vec<Rung> {
        (0..frames).filter_map(|_| governor.note(Duration::from_millis(milliseconds))).collect()
    }

    fn told(rungs: &[Rung]) -> Vec<(usize, f64)> {
        rungs.iter().map(|rung| (rung.layers.unwrap_or(0), rung.scale)).collect()
    }

    #[test]
    fn layers_go_first_then_size_and_nothing_below() {
        let mut governor = Governor::new(Duration::from_millis(33), Some(4));
        assert_eq!(after(&mut governor, 2, 40), [], "two late frames are an accident");
        assert_eq!(told(&after(&mut governor, 40, 40)), [(2, 1.0), (1, 1.0), (1, 0.75), (1, 0.5)]);
        let planes = Governor::new(Duration::from_millis(33), None);
        assert_eq!(planes.rungs.len(), 3);
    }

    #[test]
    fn it_goes_straight_to_the_most_that_fits() {
        // Work 5, 3, 2, 1.125 and 0.5: of 60 ms 36, 24, …, of 100 ms 60, 40, 22.5.
        let mut governor = Governor::new(Duration::from_millis(33), Some(4));
        assert_eq!(told(&after(&mut governor, 3, 60)), [(1, 1.0)], "not past what fits");
        let mut governor = Governor::new(Duration::from_millis(33), Some(4));
        assert_eq!(told(&after(&mut governor, 1, 100)), [(1, 0.75)], "far too much: at once");
        let mut governor = Governor::new(Duration::from_millis(33), Some(4));
        assert_eq!(told(&after(&mut governor, 9, 1000)), [(1, 0.5)], "where nothing fits, the least, once");
    }

    #[test]
    fn it_comes_back_when_there_is_room_and_the_more_slowly_the_more_often_that_failed() {
        let mut governor = Governor::new(Duration::from_millis(33), Some(2));
        after(&mut governor, 3, 45);
        assert_eq!(after(&mut governor, 300, 25), [], "two layers would not fit");
        let back = |governor: &mut Governor| (1..1000).find(|_| governor.note(Duration::from_millis(10)).is_some());
        assert_eq!(back(&mut governor), Some(2 * ROOM));
        assert_eq!(governor.rung().layers, Some(2));
        after(&mut governor, 3, 45);
        assert_eq!(back(&mut governor), Some(4 * ROOM));
    }
}
