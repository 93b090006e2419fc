//! From the text of a choice of layers to the layers of a frame, and what the next frame reuses.
//!
//! | layers | a first frame | a next frame |
//! |---|---|---|
//! | `planes:D`, `list:…` | the planes | has the same |
//! | `select:K/D` | all planes | has those that a frame on all of them selected |
//! | `guided:L` | searches the target | moves the surface with the camera, and searches where it does not fit |
//! | `surface:L` | the depth of the photos | searches the depth of photos that have changed |
//!
//! The layers of a still picture are those of a first frame. Planes are selected by the
//! histogram of the best planes of all pixels.

use std::fmt;
use std::time::Duration;

use crate::LayerSpec;
use liveview::geometry::Camera;
use liveview::layers::{Layers, LayersError, select_planes as fullest_planes, uniform_disparities};
use liveview::network::Alpha;
use liveview::render::{Frame, ViewCorrection};
use liveview::warp::SourceView;
use liveview_surface::guided::{CarriedSurface, GuidedSearch, RangeMap, guided_range};
use liveview_surface::{DepthMaps, PhotoCorrection, Reuse, TargetSurface};

/// What the layers of a frame are found from: a target and photos, of a scene or of a rig's time step.
#[derive(Debug)]
pub struct FrameInput<'a> {
    /// The camera to render.
    pub target: &'a Camera,
    /// Nearest depth, scene units.
    pub near: f64,
    /// Farthest depth, scene units; may be infinite.
    pub far: f64,
    /// The V views that the frame is rendered from, nearest first.
    pub sources: &'a [SourceView<'a>],
    /// Whether a next frame follows, which reuses what it can.
    pub is_followed: bool,
    /// Which differences between photos are corrected, for surface layers.
    pub photo_correction: PhotoCorrection,
}

/// The photos that a frame is rendered from and some further ones near the target, with their depth.
#[derive(Debug)]
pub struct PhotosWithDepth<'a> {
    /// The depth of all photos of the scene or rig.
    pub maps: &'a mut DepthMaps,
    /// Indices among the maps, with camera and photo: those to render from first, nearest first.
    pub photos: Vec<(usize, SourceView<'a>)>,
    /// How many of them the frame is rendered from.
    pub rendered_from: usize,
    /// Mean share of a photo that was searched, 0 to 1.
    pub searched: f64,
}

/// The layers of a frame, and what was found with them.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Plan {
    /// The layers, near → far.
    pub layers: Layers,
    /// Where they came from.
    pub source: LayerSource,
    /// Wall time of the guided search, for guided layers; for others of the surface and the photos'
    /// correction, with the depth of photos that was unknown before.
    pub search: Duration,
    /// Wall time of the render that planes were selected from, for selected planes.
    pub selection: Duration,
    /// How planes are selected from these once a frame is rendered on them.
    pub selects: Option<Selection>,
    /// The range of disparities of each cell, for guided layers.
    pub range: Option<RangeMap>,
    /// Correction of the views' photos; empty: they are used as they are.
    pub corrections: Vec<ViewCorrection>,
    /// The surface and its per-view occlusion, for surface layers.
    pub surface: Option<TargetSurface>,
}

impl Plan {
    /// A plan of layers that are known already, with the photos as they are.
    pub fn known(layers: Layers) -> Self {
        Self {
            layers,
            source: LayerSource::Fixed,
            search: Duration::ZERO,
            selection: Duration::ZERO,
            selects: None,
            range: None,
            corrections: Vec::new(),
            surface: None,
        }
    }
}

/// What next frames reuse, by kind of layers; fixed planes leave nothing.
#[derive(Debug, Default)]
pub struct Carried {
    /// Planes that an earlier frame selected.
    pub selected: Option<Layers>,
    guided: Option<CarriedSurface>,
    /// Whether the depth of the photos is that of an earlier frame.
    has_depth: bool,
}

/// Finds the layers of a frame, and keeps what the next one reuses. `with_depth` returns the photos for
/// surface layers: their depth is searched where there is none yet and where `reuse` says (all of it,
/// none, or where a photo has changed since).
///
/// # Errors
///
/// Of the layers, and of the photos' depth.
pub fn find_layers<'a, E: From<LayersError>>(
    spec: &LayerSpec,
    carried: &mut Carried,
    frame: &FrameInput<'a>,
    reuse: Reuse,
    with_depth: impl FnOnce(Reuse) -> Result<PhotosWithDepth<'a>, E>,
) -> Result<Plan, E> {
    let (near, far) = (frame.near, frame.far);
    Ok(match *spec {
        LayerSpec::Planes(count) => Plan::known(Layers::uniform(near, far, count)?),
        LayerSpec::List(ref list) => Plan::known(Layers::planes(list)?),
        LayerSpec::Select { keep, from } => {
            carried.selected = carried.selected.take().filter(|_| reuse != Reuse::Nothing);
            if let Some(planes) = &carried.selected {
                Plan { source: LayerSource::Selected, ..Plan::known(planes.clone()) }
            } else {
                let disparities = uniform_disparities(near, far, from)?;
                let all = Plan::known(Layers::planes(&disparities)?);
                Plan { source: LayerSource::Dense, selects: Some(Selection { keep, disparities }), ..all }
            }
        }
        LayerSpec::Guided { layers, coarse_planes } => {
            let search = GuidedSearch { near, far, planes: coarse_planes };
            let carried = &mut carried.guided;
            let (range, searched) =
                guided_range(&search, carried, frame.sources, frame.target, reuse, frame.is_followed)?;
            let found = Plan::known(range.layers(layers)?);
            Plan { source: LayerSource::propagated(searched), range: Some(range), ..found }
        }
        LayerSpec::Surface(count) => {
            let photos = with_depth(if carried.has_depth { reuse } else { Reuse::Nothing })?;
            carried.has_depth = true;
            let PhotosWithDepth { maps, photos, rendered_from, searched } = photos;
            let surface = TargetSurface::find(maps, &photos, rendered_from, frame.target, frame.photo_correction);
            let layers = surface.surface.layers(count)?;
            let (source, corrections) = (LayerSource::propagated(searched), surface.corrections.clone());
            Plan { source, corrections, surface: Some(surface), ..Plan::known(layers) }
        }
    })
}

/// A selection of planes, made once a frame has been rendered on all of them.
#[derive(Debug, Clone)]
pub struct Selection {
    /// Planes kept.
    keep: usize,
    /// Of all planes, 1/scene unit, near → far.
    disparities: Vec<f64>,
}

impl Selection {
    /// The planes that a frame rendered on all of them selects, given how its layers share a pixel.
    ///
    /// # Errors
    ///
    /// [`LayersError::Empty`] if no plane is kept.
    pub fn planes(&self, frame: &Frame, alpha: Alpha) -> Result<Layers, LayersError> {
        let kept = select_planes(alpha, &frame.plane_histogram(self.disparities.len()), self.keep);
        let kept: Vec<f64> = kept.into_iter().map(|plane| self.disparities[plane]).collect();
        Layers::planes(&kept)
    }
}

/// Where the layers of a frame came from.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum LayerSource {
    /// The same planes for every frame.
    Fixed,
    /// All planes, from which those of the next frames are selected.
    Dense,
    /// The planes that an earlier frame selected.
    Selected,
    /// A search over the whole target, or, for surface layers, over all photos used.
    Searched,
    /// The surface or the depth of an earlier frame, but for a share of the target (of the photos
    /// used, for surface layers) that was searched again.
    Propagated {
        /// That share, 0 to 1.
        refreshed: f64,
    },
}

impl LayerSource {
    /// Propagated but for this share, 0 to 1.
    fn propagated(refreshed: f64) -> Self {
        if refreshed < 1.0 { Self::Propagated { refreshed } } else { Self::Searched }
    }
}

impl fmt::Display for LayerSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fixed => "fixed",
            Self::Dense => "dense",
            Self::Selected => "selected",
            Self::Searched => "searched",
            Self::Propagated { refreshed: 0.0 } => "propagated",
            Self::Propagated { .. } => "refreshed",
        })
    }
}

/// Indices, near → far, of the `count` planes to keep, given the histogram of best planes
/// ([`liveview::layers::plane_histogram`]): the paper's choice ([`liveview::layers::select_planes`]), or where
/// planes compete [`cover_planes`].
pub fn select_planes(alpha: Alpha, histogram: &[u64], count: usize) -> Vec<usize> {
    match alpha {
        Alpha::Competing { .. } => cover_planes(histogram, count),
        _ => fullest_planes(histogram, count),
    }
}

/// Selection among competing planes, not in the paper: the `count` planes that minimise the sum, over all pixels, of the distance from the best plane
/// of the pixel to the nearest selected plane; distances are counted in planes. Returns indices,
/// near → far.
///
/// Weighted k-medians of the histogram, exact by dynamic programming over the filled bins (ties:
/// the nearer). Selecting the fullest bins instead crowds planes at the most frequent depth and
/// leaves other depths without one. If no more than `count` bins are filled, as [`liveview::layers::select_planes`].
pub fn cover_planes(histogram: &[u64], count: usize) -> Vec<usize> {
    let bins: Vec<usize> = (0..histogram.len()).filter(|&k| histogram[k] > 0).collect();
    if bins.len() <= count || count == 0 {
        return fullest_planes(histogram, count);
    }
    let place = |b: usize| bins[b] as u64;
    let (mut total, mut moment) = (vec![0], vec![0]); // Σ pixels and Σ pixels · place of the bins before
    for b in 0..bins.len() {
        total.push(total[b] + histogram[bins[b]]);
        moment.push(moment[b] + histogram[bins[b]] * place(b));
    }
    // Sums of distances: of the bins from `start` up to a selected one, of those after it, and of
    // those between two selected ones.
    let before =
        |start: usize, kept: usize| place(kept) * (total[kept] - total[start]) - (moment[kept] - moment[start]);
    let after = |kept: usize, end: usize| moment[end] - moment[kept] - place(kept) * (total[end] - total[kept]);
    let between = |a: usize, b: usize| {
        let middle = bins.partition_point(|&bin| bin <= usize::midpoint(bins[a], bins[b]));
        after(a, middle) + before(middle, b)
    };
    // least[b]: the least sum over the bins up to b if b is selected, with one more bin selected
    // than there are rows in `last`; a row holds for each b the bin that was selected before it.
    let mut least: Vec<u64> = (0..bins.len()).map(|b| before(0, b)).collect();
    let mut last: Vec<Vec<usize>> = Vec::new();
    for selected in 1..count {
        let best = |b: usize| (selected - 1..b).map(|a| (least[a] + between(a, b), a)).min().unwrap_or((0, 0)); // never used
        let row: Vec<(u64, usize)> = (0..bins.len()).map(best).collect();
        last.push(row.iter().map(|&(_, a)| a).collect());
        least = row.into_iter().map(|(cost, _)| cost).collect();
    }
    let ends = (count - 1..bins.len()).min_by_key(|&b| least[b] + after(b, bins.len()));
    let mut chosen: Vec<usize> = ends.into_iter().collect();
    for row in last.iter().rev() {
        chosen.push(row[chosen[chosen.len() - 1]]);
    }
    chosen.into_iter().rev().map(|b| bins[b]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loss(histogram: &[u64], selected: &[usize]) -> u64 {
        let nearest = |k: usize| selected.iter().map(|&plane| plane.abs_diff(k)).min().unwrap() as u64;
        (0..histogram.len()).map(|k| histogram[k] * nearest(k)).sum()
    }

    #[test]
    fn selected_planes_cover_depths_that_the_fullest_bins_miss() {
        let histogram = [40, 50, 45, 0, 0, 0, 0, 9, 8, 0];
        assert_eq!(fullest_planes(&histogram, 2), [1, 2]);
        assert_eq!(cover_planes(&histogram, 2), [1, 7]);
        assert_eq!(cover_planes(&histogram, 5), [0, 1, 2, 7, 8]);
        assert_eq!(cover_planes(&histogram, 6), fullest_planes(&histogram, 6));
        assert_eq!(cover_planes(&[0; 4], 2), [0, 1]);
        assert_eq!(cover_planes(&histogram, 0), [0; 0]);
    }

    #[test]
    fn selected_planes_are_an_optimum_of_all_choices() {
        let mut state = 1u64;
        for case in 0..60 {
            let planes = 3 + case % 8;
            let histogram: Vec<u64> = (0..planes)
                .map(|_| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    (state >> 60).saturating_sub(4)
                })
                .collect();
            for count in 1..planes {
                let found = cover_planes(&histogram, count);
                assert!(found.len() == count && found.is_sorted_by(|a, b| a < b), "{found:?}");
                let choices = (0u32..1 << planes).filter(|bits| bits.count_ones() as usize == count);
                let kept = |bits: u32| (0..planes).filter(|k| bits >> k & 1 == 1).collect::<Vec<_>>();
                let least = choices.map(|bits| loss(&histogram, &kept(bits))).min().unwrap();
                assert_eq!(loss(&histogram, &found), least, "{histogram:?}, {count}: {found:?}");
            }
        }
    }
}
