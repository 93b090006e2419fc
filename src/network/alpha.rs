//! What the network's first logit says of a layer.

use std::fmt;
use std::str::FromStr;

use crate::layers::{cover_planes, select_planes};

/// How the layers of a pixel share it, by their logits 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Alpha {
    /// The paper's: each layer's α is sigmoid(logit 0), whatever the others', and they are composited front to back.
    #[default]
    Independent,
    /// As [`Self::Independent`], of planes alone, but the network gives the odds α/(1 − α) of a plane that is followed by a pixel of
    /// parallax: a plane's odds are these times the pixels to the next one, so that it does not matter how densely planes lie. Not in
    /// the paper; docs/design-log/planes.md has figures.
    PerPixel {
        /// The most pixels that count: planes that lie farther apart are as opaque as at that distance. Positive, finite.
        most: f64,
    },
    /// A pixel's weights are the softmax of scale · logit 0 over the layers that cover it, so that faint false layers cannot add up to
    /// fog. Not in the paper; still an MPI, whose α are each weight over what the nearer ones leave.
    Competing {
        /// What the logits are multiplied by: positive, finite.
        scale: f64,
    },
}

impl Alpha {
    /// The scale of competing layers for a network that was not trained for it (measured:
    /// docs/design-log/planes.md).
    pub const UNTRAINED_SCALE: f64 = 2.0;

    /// Whether each layer has an opacity of its own, so that it may hide others.
    pub fn is_independent(self) -> bool {
        !matches!(self, Self::Competing { .. })
    }

    /// The `count` planes of a histogram of best planes ([`crate::layers::plane_histogram`]) that serve in place of all, near → far: the
    /// paper's ([`select_planes`]), or where planes compete [`cover_planes`].
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
            Self::PerPixel { most } => write!(f, "independent, per pixel of parallax up to {most}"),
            Self::Competing { scale } => write!(f, "competing, scale {scale}"),
        }
    }
}

/// An [`Alpha`] as options and model cards name it: without its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
