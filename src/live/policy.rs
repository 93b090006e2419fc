//! When a session searches for layers, and where those of a frame came from.

use std::fmt;
use std::str::FromStr;

use crate::layers::LayerSpec;

/// When a session searches for the layers of its frames, where these depend on the scene ([`LayerSpec`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Policy {
    /// Every so many frames (1: each). In between, the surface of guided layers moves with the target camera, and the cameras keep
    /// their depth for surface layers, whatever the photos show.
    Every(usize),
    /// On the first frame: with `select:16/64` the paper's video, which renders 64 planes once and 16 of them from then on
    /// ([`crate::network::Alpha::select_planes`]).
    Once,
    /// Guided layers: the surface of the last frame moves with the target camera, and is searched anew where the photos agree with
    /// it less well than they did. Surface layers: the depth of a camera's photo is searched anew where it has changed.
    Propagate,
}

impl Policy {
    /// The default for these layers: `propagate` for guided and surface layers, `once` for all others.
    pub fn default_for(layers: &LayerSpec) -> Self {
        match layers {
            LayerSpec::Guided { .. } | LayerSpec::Surface(_) => Self::Propagate,
            _ => Self::Once,
        }
    }
}

impl fmt::Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Every(1) => write!(f, "each"),
            Self::Every(frames) => write!(f, "every:{frames}"),
            Self::Once => write!(f, "once"),
            Self::Propagate => write!(f, "propagate"),
        }
    }
}

impl FromStr for Policy {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let frames = |text: &str| text.parse().ok().filter(|frames| (1..=1_000_000).contains(frames));
        match text.split_once(':') {
            None if text == "each" => Ok(Self::Every(1)),
            None if text == "once" => Ok(Self::Once),
            None if text == "propagate" => Ok(Self::Propagate),
            Some(("every", number)) => {
                let wrong = || format!("{number} is no number of frames; expected a whole number from 1 to 1000000");
                frames(number).map(Self::Every).ok_or_else(wrong)
            }
            _ => Err("expected propagate, each, every:N or once".to_owned()),
        }
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
    /// The surface, the planes or the depth of an earlier frame, but for a share of the target (of the photos used, for surface layers)
    /// that was searched anew.
    Propagated {
        /// That share, 0 to 1.
        refreshed: f64,
    },
}

impl LayerSource {
    /// That of what was propagated but for this share, 0 to 1.
    pub(super) fn propagated(refreshed: f64) -> Self {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policies_are_read_as_they_are_written() {
        for text in ["propagate", "each", "every:5", "once"] {
            assert_eq!(text.parse::<Policy>().unwrap().to_string(), text);
        }
        assert!("every:0".parse::<Policy>().unwrap_err().contains("whole number"));
        assert!("sometimes".parse::<Policy>().is_err() && "some:3".parse::<Policy>().is_err());
    }
}
