//! Options that choose the layers.

use std::path::PathBuf;

use clap::Args;
use liveview::network::AlphaKind;
use liveview_synthesizer::ViewAgreement;
use liveview_synthesizer::{LayerSpec, PhotoCorrection};

use super::ADVANCED;

/// Options that choose the layers.
#[derive(Debug, Args)]
pub(crate) struct LayerChoice {
    /// How to render [default: surface; with a network, the model's layers]
    #[arg(long, value_enum, group = "which_layers")]
    quality: Option<Quality>,
    /// surface:L, guided:L, planes:D, select:K/D or list:… [default: as --quality]
    ///
    /// surface:L: L layers along the surface that the depth of the photos gives; each photo counts
    /// only where its own depth says that it sees the surface. guided:L or guided:L/D: L layers
    /// within each pixel's own depth range, found by a search over D planes. planes:D: D planes
    /// evenly spaced in disparity, from near to far, or, in a single picture without --near and --far,
    /// over what it shows of that range. select:K/D: the K of D planes that most pixels
    /// choose (the paper's selection; of competing planes, those nearest to every pixel's choice);
    /// a path or a video keeps the planes of its first frame. list:A,B,…: planes at these
    /// disparities, in 1/scene unit, in descending order.
    #[arg(long, value_name = "SPEC", group = "which_layers", help_heading = ADVANCED, hide_short_help = true)]
    layers: Option<LayerSpec>,
}

/// Options that choose the layers and correct the photos.
#[derive(Debug, Args)]
pub(crate) struct LayerArgs {
    #[command(flatten)]
    pub(crate) choice: LayerChoice,
    /// Do not balance the exposure and white balance of the photos
    ///
    /// By default they are balanced, except for guided layers, so that points that several photos
    /// confirm have the same colour in all of them.
    #[arg(long, help_heading = ADVANCED, hide_short_help = true)]
    pub(crate) keep_exposure: bool,
    /// Do not sharpen the softer photos
    ///
    /// By default they are sharpened, except for guided layers, as far as other photos show the same
    /// points sharper. With --keep-exposure too, planes do without the photos' depth, and lie from
    /// near to far.
    #[arg(long, help_heading = ADVANCED, hide_short_help = true)]
    pub(crate) keep_sharpness: bool,
    /// Keep the depth of photos in this folder, and reuse it in later runs
    ///
    /// The pictures are the same with and without it. You may delete any of its files (.npz, one
    /// per photo).
    #[arg(long, value_name = "FOLDER", help_heading = ADVANCED, hide_short_help = true)]
    pub(crate) cache: Option<PathBuf>,
}

/// Layers by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Quality {
    /// 3 layers along the surface from the photos' depth; best quality (surface:3)
    Surface,
    /// 16 planes selected from 64 by the network, which compete (select:16/64)
    Planes,
    /// The same by the paper: its opacity, composite and selection, the photos unchanged, planes from near to far
    Paper,
    /// 1 guided layer with the network; fastest for a single picture (guided:1)
    Fast,
}

impl LayerChoice {
    /// The layers of `--layers` or `--quality`, if given.
    pub(crate) fn given(&self) -> Option<LayerSpec> {
        let of_quality = |quality| match quality {
            Quality::Surface => ViewAgreement::LAYERS,
            Quality::Planes | Quality::Paper => LayerSpec::PAPER,
            Quality::Fast => LayerSpec::guided(1),
        };
        self.layers.clone().or_else(|| self.quality.map(of_quality))
    }

    /// How layers share a pixel, if `--quality` says so.
    pub(crate) fn alpha(&self) -> Option<AlphaKind> {
        self.is_paper().then_some(AlphaKind::Independent)
    }

    fn is_paper(&self) -> bool {
        self.quality == Some(Quality::Paper)
    }
}

impl LayerArgs {
    /// Which properties of the photos are corrected to match each other.
    pub(crate) fn photo_correction(&self) -> PhotoCorrection {
        if self.choice.is_paper() {
            return PhotoCorrection::NONE;
        }
        PhotoCorrection { exposure: !self.keep_exposure, sharpness: !self.keep_sharpness }
    }

    /// The given options that have no effect on the video of a rig.
    #[cfg(feature = "viewer")]
    pub(crate) fn unused_for_video(&self) -> Vec<&'static str> {
        let given = [("--keep-sharpness", self.keep_sharpness), ("--cache", self.cache.is_some())];
        given.into_iter().filter_map(|(option, given)| given.then_some(option)).collect()
    }
}
