//! Adapts the work per frame of a live video to the machine's speed: first the layers, then the size of the target. Down at once to
//! the level that is expected to fit the budget, up again one level at a time.

use std::time::Duration;

use liveview::LayerSpec;
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

/// Time that surface layers take to find where photos change, in layers of the full size.
const DEPTH: f64 = 6.0;

/// A level: the work of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// The layers of a frame.
    pub layers: LayerSpec,
    /// Scale of the target's sides, at most 1.
    pub scale: f64,
}

impl Level {
    /// Work, in layers of the full size; a search at the target takes about as long as one of them. That of planes does not matter: their
    /// number is the same on all levels.
    fn work(&self) -> f64 {
        let (layers, depth) = match self.layers {
            LayerSpec::Guided { layers, .. } => (layers + 1, 0.0),
            // Of photos, whatever the target's size.
            LayerSpec::Surface(layers) => (layers, DEPTH),
            _ => (1, 0.0),
        };
        layers as f64 * self.scale * self.scale + depth
    }

    /// The level in the log and the summary.
    pub fn json(&self) -> Value {
        json!({ "layers": self.layers.to_string(), "scale": self.scale })
    }
}

/// Chooses the level from the frames' times.
#[derive(Debug)]
pub struct Governor {
    budget: Duration,
    /// The most work first.
    levels: Vec<Level>,
    at: usize,
    late: usize,
    room: usize,
    patience: usize,
}

impl Governor {
    /// Levels from these layers down: fewer guided ones, and below surface layers guided ones, a single one where there is no
    /// network; planes stay, and only the size changes.
    pub fn new(budget: Duration, layers: &LayerSpec, opacities: bool) -> Self {
        let fewer = match *layers {
            LayerSpec::Guided { layers, coarse_planes } => {
                let fewer = [4, 2, 1].into_iter().filter(|&fewer| fewer < layers);
                fewer.map(|layers| LayerSpec::Guided { layers, coarse_planes }).collect()
            }
            LayerSpec::Surface(layers) => {
                let one = (layers > 1).then_some(LayerSpec::Surface(1));
                let two = opacities.then_some(LayerSpec::guided(2));
                one.into_iter().chain(two).chain([LayerSpec::guided(1)]).collect()
            }
            _ => Vec::new(),
        };
        let level = |layers| Level { layers, scale: 1.0 };
        let mut levels: Vec<Level> = std::iter::once(layers.clone()).chain(fewer).map(level).collect();
        let least = levels[levels.len() - 1].clone();
        levels.extend([0.75, 0.5].map(|scale| Level { scale, ..least.clone() }));
        Self { budget, levels, at: 0, late: 0, room: 0, patience: ROOM }
    }

    /// The level now.
    pub fn level(&self) -> &Level {
        &self.levels[self.at]
    }

    /// The scales of all levels.
    pub fn scales(&self) -> Vec<f64> {
        let mut scales: Vec<f64> = self.levels.iter().map(|level| level.scale).collect();
        scales.dedup();
        scales
    }

    /// Records the time of a frame; the new level, if it changes.
    pub fn record(&mut self, took: Duration) -> Option<&Level> {
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
        (0..frames).filter_map(|_| governor.record(Duration::from_millis(milliseconds)).cloned()).collect()
    }

    fn guided(layers: usize) -> Governor {
        Governor::new(Duration::from_millis(33), &LayerSpec::guided(layers), true)
    }

    fn pairs(levels: &[Level]) -> Vec<(usize, f64)> {
        let layers = |layers: &LayerSpec| if let LayerSpec::Guided { layers, .. } = layers { *layers } else { 0 };
        levels.iter().map(|level| (layers(&level.layers), level.scale)).collect()
    }

    #[test]
    fn layers_go_first_then_size_and_nothing_below() {
        let mut governor = guided(4);
        assert_eq!(after(&mut governor, 2, 40), [], "two late frames are an accident");
        assert_eq!(pairs(&after(&mut governor, 40, 40)), [(2, 1.0), (1, 1.0), (1, 0.75), (1, 0.5)]);
        let planes = Governor::new(Duration::from_millis(33), &LayerSpec::Planes(8), true);
        assert_eq!(planes.levels.len(), 3);
    }

    #[test]
    fn it_goes_straight_to_the_most_that_fits() {
        // Work 5, 3, 2, 1.125 and 0.5: of 60 ms 36, 24, …, of 100 ms 60, 40, 22.5.
        let mut governor = guided(4);
        assert_eq!(pairs(&after(&mut governor, 3, 60)), [(1, 1.0)], "not past what fits");
        let mut governor = guided(4);
        assert_eq!(pairs(&after(&mut governor, 1, 100)), [(1, 0.75)], "far too much: at once");
        let mut governor = guided(4);
        assert_eq!(pairs(&after(&mut governor, 9, 1000)), [(1, 0.5)], "where nothing fits, the least, once");
    }

    #[test]
    fn it_comes_back_when_there_is_room_and_the_more_slowly_the_more_often_that_failed() {
        let mut governor = guided(2);
        after(&mut governor, 3, 45);
        assert_eq!(after(&mut governor, 300, 25), [], "two layers would not fit");
        let back = |governor: &mut Governor| (1..1000).find(|_| governor.record(Duration::from_millis(10)).is_some());
        assert_eq!(back(&mut governor), Some(2 * ROOM));
        assert_eq!(governor.level().layers, LayerSpec::guided(2));
        after(&mut governor, 3, 45);
        assert_eq!(back(&mut governor), Some(4 * ROOM));
    }

    #[test]
    fn surface_layers_are_the_best_level_and_guided_ones_stand_below() {
        let ladder = |layers, opacities| {
            let governor = Governor::new(Duration::from_millis(33), &LayerSpec::Surface(layers), opacities);
            governor.levels.iter().map(|level| format!("{} {}", level.layers, level.scale)).collect::<Vec<_>>()
        };
        let below = ["guided:2 1", "guided:1 1", "guided:1 0.75", "guided:1 0.5"];
        assert_eq!(ladder(2, true), [&["surface:2 1", "surface:1 1"], &below[..]].concat());
        assert_eq!(ladder(1, true), [&["surface:1 1"], &below[..]].concat());
        assert_eq!(ladder(1, false), [&["surface:1 1"], &below[1..]].concat());
        let mut governor = Governor::new(Duration::from_millis(33), &LayerSpec::Surface(1), true);
        let levels = after(&mut governor, 3, 60);
        assert_eq!(pairs(&levels), [(2, 1.0)], "work 7 and 3: of 60 ms 26");
        assert_eq!(after(&mut governor, 100, 12), [], "surface layers would take 28");
        let back = after(&mut governor, 100, 10);
        assert_eq!(back[0].layers, LayerSpec::Surface(1));
    }
}
