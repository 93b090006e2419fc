//! How the network's first logit becomes the opacity of a layer.

use std::fmt;
use std::str::FromStr;

use crate::layers::{cover_planes, select_planes};

/// How the layers of a pixel share it, given their logits 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Alpha {
    /// The paper's: the α of a layer is sigmoid(logit 0), independent of the other layers, and
    /// layers are composited front to back.
    #[default]
    Independent,
    /// As [`Self::Independent`], for planes only, but sigmoid(logit 0) is the α of a plane that is
    /// one pixel of parallax in front of the next. The odds α/(1 − α) of a plane are multiplied by
    /// the pixels of parallax to the next one, so that the opacity of a surface does not depend on
    /// how densely planes lie. Not in the paper; measured in docs/design-log/planes.md.
    PerPixel {
        /// Upper limit of the factor, pixels: planes farther apart than this are as opaque as at
        /// this distance. Positive, finite.
        max_spacing: f64,
    },
    /// The weights of a pixel are the softmax of scale · logit 0 over the layers that cover it, so
    /// that faint false surfaces cannot accumulate into haze. Not in the paper. Still an MPI: the α
    /// of a layer is its weight divided by what the nearer layers leave.
    Competing {
        /// What the logits are multiplied by: positive, finite.
        scale: f64,
    },
}

impl Alpha {
    /// The scale of competing layers for a network that was not trained for them; measured in
    /// docs/design-log/planes.md.
    pub const UNTRAINED_SCALE: f64 = 2.0;

    /// Whether each layer has its own opacity, independent of the other layers.
    pub fn is_independent(self) -> bool {
        !matches!(self, Self::Competing { .. })
    }

    /// Indices, near → far, of the `count` planes to keep, given the histogram of best planes
    /// ([`crate::layers::plane_histogram`]): the paper's choice ([`select_planes`]), or where
    /// planes compete [`cover_planes`].
    pub fn select_planes(self, histogram: &[u64], count: usize) -> Vec<usize> {
        match self {
            Self::Independent | Self::PerPixel { .. } => select_planes(histogram, count),
            Self::Competing { .. } => cover_planes(histogram, count),
        }
    }
}

impl fmt::Display for Alpha {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Independent => write!(f, "independent"),
            Self::PerPixel { max_spacing } => write!(f, "independent, per pixel of parallax up to {max_spacing}"),
            Self::Competing { scale } => write!(f, "competing, scale {scale}"),
        }
    }
}

/// The name of an [`Alpha`] in options and model cards: without its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum AlphaKind {
    /// [`Alpha::Independent`], or [`Alpha::PerPixel`] for a model that was trained for it.
    Independent,
    /// [`Alpha::Competing`].
    Competing,
}

impl FromStr for AlphaKind {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "independent" => Ok(Self::Independent),
            "competing" => Ok(Self::Competing),
            _ => Err("\"independent\" or \"competing\""),
        }
    }
}
