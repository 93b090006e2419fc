//! Adapts the work per frame of a live video to the machine's speed: first layers and depth, then the size of the target. It lowers the level
//! at once as far as the budget is expected to need, and raises it one level at a time.

use std::fmt;
use std::time::Duration;

use liveview_synthesizer::LayerSpec;

/// What frames may take together above their budgets, in budgets, before the level is lowered.
const MAX_BEHIND: f64 = 1.0;
/// Frames in a row that would fit at the next higher level, after which the level is raised; doubled each time it is lowered.
const FITTING_FRAMES: usize = 30;
/// The largest such number.
const MAX_FITTING_FRAMES: usize = 30 * 32;
/// Share of the budget that a frame of a higher level must be expected to fit into.
const RAISE_SHARE: f64 = 0.8;
/// Work of surface layers to find where photos change, in layers of the full size.
const DEPTH_WORK: f64 = 4.0;
/// The same where depth is coarse.
const COARSE_DEPTH_WORK: f64 = 2.8;

/// How a frame is rendered: a level of work.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Level {
    /// The layers of a frame.
    pub(super) layers: LayerSpec,
    /// Whether depth that follows is coarse.
    pub(super) coarse_depth: bool,
    /// Scale of the target's sides, at most 1.
    pub(super) scale: f64,
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let depth = if self.coarse_depth { ", coarse depth," } else { "" };
        write!(f, "{}{depth} at {:.0} % of the size", self.layers, 100.0 * self.scale)
    }
}

impl Level {
    /// Work in layers of the full size; a guided search takes about as long as one of them. For planes, whose number is the same on
    /// all levels, only the size counts.
    fn work(&self) -> f64 {
        let (layers, depth) = match self.layers {
            LayerSpec::Guided { layers, .. } => (layers + 1, 0.0),
            // The depth search is on photos: it does not depend on the target's size.
            LayerSpec::Surface(layers) => (layers, if self.coarse_depth { COARSE_DEPTH_WORK } else { DEPTH_WORK }),
            _ => (1, 0.0),
        };
        layers as f64 * self.scale * self.scale + depth
    }
}

/// Chooses the level by the times of frames.
#[derive(Debug)]
pub(super) struct Governor {
    budget: Duration,
    /// The most work first.
    levels: Vec<Level>,
    /// Index of the current level.
    current: usize,
    /// What frames took above their budgets, less what later ones took below, in budgets; at least 0.
    behind: f64,
    /// Frames in a row that would fit at the next higher level.
    fitting: usize,
    /// Number of these after which the level is raised.
    raise_after: usize,
}

impl Governor {
    /// The levels below `layers`: fewer guided layers; below surface layers coarse depth, then guided ones, of which a single one without opacities of a
    /// network; of planes only the size changes.
    pub(super) fn new(budget: Duration, layers: &LayerSpec, opacities: bool) -> Self {
        let level = |layers| Level { layers, coarse_depth: false, scale: 1.0 };
        let mut levels = vec![level(layers.clone())];
        match *layers {
            LayerSpec::Guided { layers, coarse_planes } => {
                let fewer = [4, 2, 1].into_iter().filter(|&fewer| fewer < layers);
                levels.extend(fewer.map(|layers| level(LayerSpec::Guided { layers, coarse_planes })));
            }
            LayerSpec::Surface(layers) => {
                levels.extend((layers > 1).then(|| level(LayerSpec::Surface(1))));
                levels.push(Level { coarse_depth: true, ..level(LayerSpec::Surface(1)) });
                levels.extend(opacities.then(|| level(LayerSpec::guided(2))));
                levels.push(level(LayerSpec::guided(1)));
            }
            _ => (),
        }
        let least = levels[levels.len() - 1].clone();
        levels.extend([0.75, 0.5].map(|scale| Level { scale, ..least.clone() }));
        Self { budget, levels, current: 0, behind: 0.0, fitting: 0, raise_after: FITTING_FRAMES }
    }

    /// The current level.
    pub(super) fn level(&self) -> &Level {
        &self.levels[self.current]
    }

    /// Records the time of a frame at the current level; the new level, if it changes.
    pub(super) fn record(&mut self, took: Duration) -> Option<&Level> {
        let share = took.as_secs_f64() / self.budget.as_secs_f64();
        let now = self.level().work();
        let expected = |level: &Level| share * level.work() / now;
        self.behind = (self.behind + share - 1.0).max(0.0);
        if share > 1.0 {
            self.fitting = 0;
            if self.behind <= MAX_BEHIND {
                return None;
            }
            let lower = &self.levels[self.current + 1..];
            let steps = lower.iter().position(|level| expected(level) <= 1.0).map_or(lower.len(), |fits| fits + 1);
            self.behind = 0.0;
            if steps == 0 {
                return None;
            }
            self.current += steps;
            self.raise_after = (2 * self.raise_after).min(MAX_FITTING_FRAMES);
            return Some(self.level());
        }
        let higher = self.current.checked_sub(1)?;
        self.fitting = if expected(&self.levels[higher]) < RAISE_SHARE { self.fitting + 1 } else { 0 };
        if self.fitting < self.raise_after {
            return None;
        }
        (self.current, self.fitting, self.behind) = (higher, 0, 0.0);
        Some(self.level())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The levels that a number of frames of equal time lead to.
    fn levels_after(governor: &mut Governor, frames: usize, milliseconds: u64) -> Vec<Level> {
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
    fn layers_are_reduced_first_then_the_size() {
        let mut governor = guided(4);
        assert_eq!(levels_after(&mut governor, 2, 40), [], "two late frames change nothing");
        assert_eq!(pairs(&levels_after(&mut governor, 40, 40)), [(2, 1.0), (1, 1.0), (1, 0.75), (1, 0.5)]);
        let planes = Governor::new(Duration::from_millis(33), &LayerSpec::Planes(8), true);
        assert_eq!(planes.levels.len(), 3);
    }

    #[test]
    fn late_frames_that_others_make_up_for_change_nothing() {
        let mut governor = guided(4);
        let took = |frame: usize| [40, 30, 29][frame % 3];
        assert!((0..100).all(|frame| governor.record(Duration::from_millis(took(frame))).is_none()));
        let took = |frame: usize| [40, 32, 29][frame % 3];
        let lowered = (0..100).find(|&frame| governor.record(Duration::from_millis(took(frame))).is_some());
        assert!(lowered.is_some_and(|frame| frame > 6), "{lowered:?}");
        // What was late at the lowest level is forgotten.
        levels_after(&mut governor, 50, 1000);
        while governor.record(Duration::from_millis(5)).is_none() {}
        assert!(governor.record(Duration::from_millis(34)).is_none());
    }

    #[test]
    fn level_falls_at_once_to_the_highest_that_fits() {
        // Work 5, 3, 2, 1.125 and 0.5: of 60 ms 36, 24, …, of 100 ms 60, 40, 22.5.
        let mut governor = guided(4);
        assert_eq!(pairs(&levels_after(&mut governor, 3, 60)), [(1, 1.0)], "the highest that fits");
        let mut governor = guided(4);
        assert_eq!(pairs(&levels_after(&mut governor, 1, 100)), [(1, 0.75)], "far too late: after one frame");
        let mut governor = guided(4);
        assert_eq!(pairs(&levels_after(&mut governor, 9, 1000)), [(1, 0.5)], "nothing fits: the lowest, once");
    }

    #[test]
    fn level_rises_later_each_time_it_was_lowered() {
        let mut governor = guided(2);
        levels_after(&mut governor, 3, 45);
        assert_eq!(levels_after(&mut governor, 300, 25), [], "two layers would not fit");
        let frames_until_raised =
            |governor: &mut Governor| (1..1000).find(|_| governor.record(Duration::from_millis(10)).is_some());
        assert_eq!(frames_until_raised(&mut governor), Some(2 * FITTING_FRAMES));
        assert_eq!(governor.level().layers, LayerSpec::guided(2));
        levels_after(&mut governor, 3, 45);
        assert_eq!(frames_until_raised(&mut governor), Some(4 * FITTING_FRAMES));
    }

    #[test]
    fn guided_layers_are_the_levels_below_surface_layers() {
        let ladder = |layers, opacities| {
            let governor = Governor::new(Duration::from_millis(33), &LayerSpec::Surface(layers), opacities);
            governor
                .levels
                .iter()
                .map(|Level { layers, coarse_depth, scale }| format!("{layers} {coarse_depth} {scale}"))
                .collect::<Vec<_>>()
        };
        let below = ["guided:2 false 1", "guided:1 false 1", "guided:1 false 0.75", "guided:1 false 0.5"];
        let surface = ["surface:1 false 1", "surface:1 true 1"];
        assert_eq!(ladder(2, true), [&["surface:2 false 1"], &surface[..], &below[..]].concat());
        assert_eq!(ladder(1, true), [&surface[..], &below[..]].concat());
        assert_eq!(ladder(1, false), [&surface[..], &below[1..]].concat());
        let mut governor = Governor::new(Duration::from_millis(33), &LayerSpec::Surface(1), true);
        assert!(levels_after(&mut governor, 5, 40)[0].coarse_depth, "work 5 and 3.8: of 40 ms 30");
        let levels = levels_after(&mut governor, 5, 40);
        assert_eq!(pairs(&levels), [(2, 1.0)], "work 3.8 and 3: of 40 ms 31.6");
        assert_eq!(levels_after(&mut governor, 100, 21), [], "surface layers would take 26.6 ms");
        let back = levels_after(&mut governor, 200, 10);
        assert_eq!(back[0].layers, LayerSpec::Surface(1));
    }
}
