//! Which layers to render on.

use std::path::PathBuf;

use anyhow::{Result, anyhow, bail};
use clap::Args;
use liveview::network::PlaneNetwork;
use liveview::{LayerSpec, PhotoCorrection};

/// Options that choose the layers of a render.
#[derive(Debug, Args)]
#[command(next_help_heading = "Layers (default: what the model recommends)")]
pub struct LayerArgs {
    /// Which layers: guided:L (L layers that follow the scene, each pixel's own range of depths; guided:L/D with D planes in
    /// the first search), surface:L (L layers along the surface that the photos' own depth gives; each photo counts only where it sees
    /// it), planes:D (evenly spaced in disparity from near to far), select:K/D (of D planes K: the paper's
    /// selection, those that most pixels choose, or where planes compete those nearest to every pixel's choice; a path keeps those
    /// of its first frame), list:… (disparities in 1/scene unit, separated by commas, near to far: descending)
    #[arg(long, value_name = "SPEC", group = "which_layers")]
    layers: Option<LayerSpec>,
    /// A choice of layers that was measured (README, "Error against run time")
    #[arg(long, value_enum, group = "which_layers")]
    quality: Option<Quality>,
    /// Surface layers: leave photos of different exposure or white balance as they are; by default they are balanced, by what their
    /// confirmed depths show to be the same point
    #[arg(long)]
    pub keep_exposure: bool,
    /// Surface layers: leave photos as sharp as they are; by default the softer ones are sharpened, as far as their confirmed depths
    /// show the same points sharper in other photos
    #[arg(long)]
    pub keep_sharpness: bool,
    /// Surface layers: keep the depth of photos in this folder, a .npz each (the library's `ScenePhotos::keep_depths_in` says what it
    /// holds), and take from there what an earlier run has kept; the picture is the same. Any file there may be deleted
    #[arg(long, value_name = "FOLDER")]
    pub cache: Option<PathBuf>,
}

/// Quality against run time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Quality {
    /// 1 guided layer: the fastest for a single picture
    Draft,
    /// 2 guided layers: a single picture in about a fifth of the time of `full`
    Balanced,
    /// 1 layer along the surface that the photos' own depth gives: the best of these; once that depth is known about as fast as `draft`
    Full,
    /// 16 planes selected from 64; with --alpha independent composited as in the paper
    Paper,
}

impl From<Quality> for LayerSpec {
    fn from(quality: Quality) -> Self {
        match quality {
            Quality::Draft => Self::guided(1),
            Quality::Balanced => Self::guided(2),
            Quality::Full => Self::Surface(1),
            Quality::Paper => Self::PAPER,
        }
    }
}

impl LayerArgs {
    /// In what the photos are made alike.
    pub fn photo_correction(&self) -> PhotoCorrection {
        PhotoCorrection { exposure: !self.keep_exposure, sharpness: !self.keep_sharpness }
    }

    /// Those of the options given that a rig's video has no use for.
    pub fn unused_for_video(&self) -> Vec<&'static str> {
        let given = [("--keep-sharpness", self.keep_sharpness), ("--cache", self.cache.is_some())];
        given.into_iter().filter_map(|(option, given)| given.then_some(option)).collect()
    }

    /// The layers of these options, if any are given.
    pub fn given(&self) -> Option<LayerSpec> {
        self.layers.clone().or_else(|| self.quality.map(Into::into))
    }
}

/// The layers given, or those of the quality, or else those that the model's card recommends.
pub fn given_or_recommended(
    layers: Option<&LayerSpec>,
    quality: Option<Quality>,
    network: &dyn PlaneNetwork,
) -> Result<LayerSpec> {
    let layers = match (layers, quality) {
        (Some(layers), _) => layers.clone(),
        (None, Some(quality)) => quality.into(),
        (None, None) => network.recommended_layers().map_err(|error| anyhow!("{error}; --layers decides instead"))?,
    };
    if matches!(layers, LayerSpec::Select { .. }) && !network.predicts_opacity() {
        bail!("--network none: {layers} needs the opacities of a network to select planes by; expected other layers");
    }
    Ok(layers)
}
