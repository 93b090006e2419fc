//! The depth of a photo at its edges, moved to the nearer side where other photos show it.
//!
//! Beside an edge, a search gives some pixels of the near thing the depth behind it. Nothing then
//! hides their colour from what lies behind, and pictures show it there; a pixel of the background
//! with the near depth is left out, and other photos show the background. Depth that is too far
//! costs more than depth that is too near (docs/design-log/photo-depth-edges.md).
//!
//! The depths of the other photos are splatted to the photo ([`super::splat`]); only those count that
//! two of them have. Such a depth replaces the photo's own where it is nearer by more than 2 px and
//!
//! - the photo's own depth differs by more than 3 px within 5×5 pixels: there is an edge;
//! - other photos confirm more than half of the 31×31 pixels around: their depths are trusted;
//! - its colour cost is not higher. The cost is the mean of the lowest two differences from the other
//!   photos: means of the channels, at most 0.2, which is also the difference outside a photo.
//!
//! px is the photo's disparity per pixel.

use ndarray::Array2;
use rayon::prelude::*;

use super::confirmed_depth::ConfirmedDepth;
use super::project::project;
use super::splat::{Single, splat};
use super::surface::{AVERAGED_PX, SAME_SURFACE_PX};
use crate::surface::neighbourhood::share_of_known;
use crate::surface::search::PhotoDepth;
use crate::warp::{SourceView, Texture, WarpSource, warp_sources};

/// The photo's own depth differs by more than this at an edge, px, within [`EDGE_RADIUS`] pixels.
const EDGE_PX: f32 = 3.0;
const EDGE_RADIUS: usize = 2;
/// Share of the pixels within [`WINDOW_RADIUS`] that other photos confirm.
const MIN_CONFIRMED: f32 = 0.5;
const WINDOW_RADIUS: usize = 15;
/// Upper bound of a difference of colour.
const MAX_DIFFERENCE: f32 = 0.2;

/// The depth of photo `which` of a set, moved to the nearer side at edges; `confirmed` is what the
/// others of the set confirm of it.
pub fn nearer_edges(set: &[(SourceView<'_>, &PhotoDepth)], which: usize, confirmed: &ConfirmedDepth) -> PhotoDepth {
    let (view, depth) = set[which];
    let (size, px) = (view.camera.size(), depth.disparity_per_pixel);
    let others = || set.iter().enumerate().filter(|&(index, _)| index != which).map(|(_, other)| other);
    let maps: Vec<_> = others().map(|(other, depth)| (other.camera, &depth.disparity)).collect();
    let nearer = splat(&maps, view.camera, size, (SAME_SURFACE_PX * px, AVERAGED_PX * px), Single::LeftOut);
    let views: Vec<SourceView<'_>> = others().map(|&(other, _)| other).collect();
    let sources = warp_sources(&views, view.camera);
    let confirmed = share_of_known(&confirmed.disparity, WINDOW_RADIUS);
    let own = depth.disparity.as_slice().expect("standard order");
    let moves = |at: usize| {
        let (x, y) = (at % size.width, at / size.width);
        let cost = |disparity: f32| colour_cost(view.texture, &sources, (x, y), disparity);
        nearer[at] > own[at] + SAME_SURFACE_PX * px
            && confirmed((y, x)) > MIN_CONFIRMED
            && is_edge(own, size.width, (x, y), EDGE_PX * px)
            && cost(nearer[at]) <= cost(own[at])
    };
    let disparity = (0..own.len()).into_par_iter().map(|at| if moves(at) { nearer[at] } else { own[at] }).collect();
    let disparity = Array2::from_shape_vec(depth.disparity.dim(), disparity).expect("one per pixel");
    PhotoDepth { disparity, disparity_per_pixel: px }
}

/// Whether disparities of a map with rows `width` wide differ by more than `least` within
/// [`EDGE_RADIUS`] pixels of a (column, row).
fn is_edge(map: &[f32], width: usize, (x, y): (usize, usize), least: f32) -> bool {
    let around = |at: usize, side: usize| at.saturating_sub(EDGE_RADIUS)..(at + EDGE_RADIUS + 1).min(side);
    let (mut largest, mut smallest) = (f32::MIN, f32::MAX);
    for row in around(y, map.len() / width) {
        for &disparity in &map[row * width..][around(x, width)] {
            (largest, smallest) = (largest.max(disparity), smallest.min(disparity));
        }
    }
    largest - smallest > least
}

/// Mean of the two lowest differences of a pixel (column, row) of a photo, at that disparity, from
/// the other photos: two at least.
fn colour_cost(photo: &Texture, others: &[WarpSource<'_>], pixel: (usize, usize), disparity: f32) -> f32 {
    let own = photo.pixel(pixel.0, pixel.1);
    let mut lowest = [MAX_DIFFERENCE; 2];
    for other in others {
        let (x, y, _) = project(&other.sweep, pixel, disparity);
        let Some(colour) = bilinear(other.texture, x - 0.5, y - 0.5) else { continue };
        let difference = (0..3).map(|c| (colour[c] - own[c]).abs()).sum::<f32>() / 3.0;
        if difference < lowest[0] {
            lowest = [difference, lowest[0]];
        } else if difference < lowest[1] {
            lowest[1] = difference;
        }
    }
    (lowest[0] + lowest[1]) / 2.0
}

/// Sample of a photo at (x, y) in pixels, the centre of the first at 0; `None` outside.
fn bilinear(texture: &Texture, x: f32, y: f32) -> Option<[f32; 3]> {
    let (last_column, last_row) = ((texture.width() - 1) as f32, (texture.height() - 1) as f32);
    if !(x >= 0.0 && y >= 0.0 && x < last_column && y < last_row) {
        return None;
    }
    let (column, row) = (x as usize, y as usize);
    let (across, down) = (x - column as f32, y - row as f32);
    let lerp = |a: [f32; 3], b: [f32; 3], share: f32| std::array::from_fn(|c| a[c] + (b[c] - a[c]) * share);
    let in_row = |row: usize| lerp(texture.pixel(column, row), texture.pixel(column + 1, row), across);
    Some(lerp(in_row(row), in_row(row + 1), down))
}
