//! The photos that a shot's surface is found from.

use anyhow::Result;
use liveview::surface::PhotoDepth;
use liveview::{Shot, Synthesizer};

use super::scene::photos;

/// The photos of a shot with the depth that was found for them, and the range that was searched.
pub(super) struct Photos {
    pub(super) views: Vec<usize>,
    pub(super) depths: Vec<PhotoDepth>,
    pub(super) range: (f64, f64),
}

impl Photos {
    /// As they were used for the layers of the shot.
    pub(super) fn of(job: &mut Synthesizer, shot: &Shot) -> Result<Self> {
        let views: Vec<usize> = photos(shot).collect();
        let (mut depths, mut range) = (Vec::new(), (shot.near, shot.far));
        for &view in &views {
            let depth = job.photos_mut().view_depth(view, &shot.held_out, &views)?;
            range = depth.range;
            depths.push((*depth.found).clone());
        }
        Ok(Self { views, depths, range })
    }
}
