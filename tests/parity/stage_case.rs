//! A golden file of the stages from photos to frame.

use std::ops::Deref;

use liveview::geometry::Size;
use liveview::layers::{Layers, padded};
use liveview::network::{Alpha, ExecutionProvider, OrtNetwork};

use crate::golden::{Case, assert_none, flat, folder};
use crate::wheel;

pub(crate) const CASES: [&str; 19] = [
    "random_v4",
    "random_v5",
    "random_v10",
    "rectified_v2",
    "one_plane",
    "infinity",
    "coincident",
    "unseen",
    "guided_v4",
    "guided_v5",
    "guided_v2",
    "guided_one",
    "competing_v4",
    "competing_unseen",
    "competing_guided",
    "spaced_v4",
    "spaced_uneven",
    "spaced_one",
    "spaced_unseen",
];

/// A golden file of the stages from photos to frame.
pub(crate) struct StageCase(Case);

impl Deref for StageCase {
    type Target = Case;

    fn deref(&self) -> &Case {
        &self.0
    }
}

impl StageCase {
    /// Size of the target, padded to what the network takes.
    pub(crate) fn padded(&self) -> Size {
        padded(self.target.size())
    }

    pub(crate) fn layers(&self) -> Layers {
        match self.find::<f64>("disparities") {
            Some(disparities) => Layers::planes(&flat(disparities)).unwrap(),
            None => {
                let maps = self.volume::<f32>("cell_maps");
                Layers::maps(maps.outer_iter().map(|m| m.to_owned()).collect()).unwrap()
            }
        }
    }

    pub(crate) fn alpha(&self) -> Alpha {
        let number = |name: &str| self.find::<f64>(name).map(|values| values[[0]]);
        let spaced = || number("alpha_spacing").map(|max_spacing| Alpha::PerPixel { max_spacing });
        number("alpha_scale").map(|scale| Alpha::Competing { scale }).or_else(spaced).unwrap_or_default()
    }

    pub(crate) fn network(&self) -> OrtNetwork {
        let path = folder().join(format!("network_v{}.onnx", self.cameras.len()));
        OrtNetwork::open(&wheel::load(ExecutionProvider::Cpu).unwrap(), &path, 1).unwrap()
    }
}

/// Runs `check` on all cases, and reports their failures together.
pub(crate) fn for_all(check: impl Fn(&StageCase)) {
    let failures = CASES.iter().flat_map(|name| {
        let case = StageCase(Case::open(None, name));
        check(&case);
        case.0.into_failures()
    });
    assert_none(&failures.collect::<Vec<_>>());
}
