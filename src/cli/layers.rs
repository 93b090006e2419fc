//! How to render: the options that choose the layers.

use std::fmt;
use std::str::FromStr;

use anyhow::{Result, bail};
use clap::Args;
use liveview::layers::Layers;
use liveview::network::OrtNetwork;

/// Options that choose the layers of a render; at most one of the first six.
#[derive(Debug, Args)]
#[command(next_help_heading = "Layers (default: what the model recommends)")]
pub(super) struct LayerArgs {
    /// A choice of layers that was measured (README, "Error against run time")
    #[arg(long, value_enum, group = "layers")]
    quality: Option<Quality>,
    /// L layers that follow the scene: each pixel's own range of depths, found by a coarse pass
    #[arg(long, value_name = "L", value_parser = super::count, group = "layers")]
    guided: Option<usize>,
    /// D planes, evenly spaced in disparity from near to far
    #[arg(long, value_name = "D", value_parser = super::count, group = "layers")]
    planes: Option<usize>,
    /// Planes at these disparities (1/scene unit), separated by commas, near to far: descending
    #[arg(long, value_name = "LIST", group = "layers", allow_hyphen_values = true, conflicts_with_all = ["near", "far"])]
    disparities: Option<Disparities>,
    /// The paper's selection: render --select-from planes, keep the K that most pixels choose, render those
    /// (a path keeps the planes of its first frame)
    #[arg(long, value_name = "K", value_parser = super::count, group = "layers")]
    select: Option<usize>,
    /// K planes where the scene is: 1-D k-means over the disparities that the coarse pass finds
    #[arg(long, value_name = "K", value_parser = super::count, group = "layers")]
    kmeans: Option<usize>,
    /// Planes to select from
    #[arg(long, value_name = "D", default_value = "64", value_parser = super::count)]
    pub(super) select_from: usize,
    /// Planes of the coarse pass of guided layers and of k-means [default: one per four pixels of parallax, 8 to 128]
    #[arg(long, value_name = "D", value_parser = super::two_or_more)]
    pub(super) coarse_planes: Option<usize>,
    /// Leave out layers behind which less than this part of the light is left at every pixel: the picture changes by at most
    /// as much (of 1) [default: 0, none]
    #[arg(long, value_name = "TAU", value_parser = part, default_value_t = 0.0, hide_default_value = true)]
    pub(super) opaque: f64,
}

/// Parses a number from 0 to 1.
fn part(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|part| (0.0..=1.0).contains(part))
        .ok_or_else(|| "expected a number from 0 to 1".to_owned())
}

/// What to give for what time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Quality {
    /// 1 guided layer, along the surface: the fastest
    Draft,
    /// 2 guided layers: nearly as good as any, at half the time of 4
    Balanced,
    /// 4 guided layers: more gain less than 0.1 dB in the mean
    Full,
    /// The paper's: 16 planes selected from 64
    Paper,
}

impl Quality {
    fn recipe(self, coarse_planes: Option<usize>) -> Recipe {
        let guided = |layers| Recipe::Guided { layers, coarse_planes };
        match self {
            Self::Draft => guided(1),
            Self::Balanced => guided(2),
            Self::Full => guided(4),
            Self::Paper => Recipe::Select { keep: 16, from: 64 },
        }
    }
}

/// A valid list of disparities, near → far.
#[derive(Debug, Clone)]
struct Disparities(Vec<f64>);

impl FromStr for Disparities {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |item: &str| item.trim().parse().map_err(|_| format!("\"{}\" is not a number", item.trim()));
        let items = text.split(',').filter(|_| !text.trim().is_empty());
        let list: Vec<f64> = items.map(number).collect::<Result<_, _>>()?;
        Layers::planes(&list).map_err(|error| error.to_string())?;
        Ok(Self(list))
    }
}

/// Which layers to render on.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Recipe {
    /// Layers that follow the scene.
    Guided { layers: usize, coarse_planes: Option<usize> },
    /// Evenly spaced planes.
    Planes(usize),
    /// Planes as given: valid, near → far.
    Disparities(Vec<f64>),
    /// The fullest `keep` of `from` planes.
    Select { keep: usize, from: usize },
    /// Planes where the coarse pass finds the scene.
    KMeans { planes: usize, coarse_planes: Option<usize> },
}

impl fmt::Display for Recipe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Guided { layers, coarse_planes } => write!(f, "guided {layers}{}", of_coarse(*coarse_planes)),
            Self::KMeans { planes, coarse_planes } => write!(f, "kmeans {planes}{}", of_coarse(*coarse_planes)),
            Self::Planes(planes) => write!(f, "planes {planes}"),
            Self::Disparities(list) => write!(f, "{} planes as given", list.len()),
            Self::Select { keep, from } => write!(f, "select {keep} of {from} planes"),
        }
    }
}

fn of_coarse(planes: Option<usize>) -> String {
    planes.map(|planes| format!(" (coarse pass of {planes} planes)")).unwrap_or_default()
}

impl Recipe {
    /// The fullest `keep` of `from` planes.
    pub(super) fn select(keep: usize, from: usize) -> Result<Self> {
        if keep > from {
            bail!("{keep} planes cannot be selected from {from}; expected at most that many");
        }
        Ok(Self::Select { keep, from })
    }
}

impl LayerArgs {
    /// What was asked for, or else what the model's card recommends.
    pub(super) fn recipe(&self, network: &OrtNetwork) -> Result<Recipe> {
        let guided = |layers| Recipe::Guided { layers, coarse_planes: self.coarse_planes };
        if let Some(layers) = self.guided {
            return Ok(guided(layers));
        }
        if let Some(quality) = self.quality {
            return Ok(quality.recipe(self.coarse_planes));
        }
        if let Some(planes) = self.kmeans {
            return Ok(Recipe::KMeans { planes, coarse_planes: self.coarse_planes });
        }
        if let Some(Disparities(list)) = &self.disparities {
            return Ok(Recipe::Disparities(list.clone()));
        }
        if let Some(keep) = self.select {
            return Recipe::select(keep, self.select_from);
        }
        if let Some(planes) = self.planes {
            return Ok(Recipe::Planes(planes));
        }
        let recommended = &network.card().recommended_layers;
        match recommended.split_once(' ').map(|(kind, number)| (kind, super::count(number))) {
            Some(("guided", Ok(layers))) => Ok(guided(layers)),
            Some(("planes", Ok(planes))) => Ok(Recipe::Planes(planes)),
            _ => bail!(
                "{}: metadata `recommended_layers` is \"{recommended}\", expected such as \"guided 4\" or \"planes 64\"; \
                 --guided or --planes decides instead",
                network.path().display()
            ),
        }
    }
}
