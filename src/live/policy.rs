//! When the layers of a video are found anew, and where those of a frame came from.

use std::fmt;
use std::str::FromStr;

use crate::layers::LayerSpec;

/// When a session finds the layers of its frames anew, where the scene decides on them ([`LayerSpec`]): fixed planes never.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Policy {
    /// Every so many frames (1: each). Guided layers move their surface with the target camera in between, without looking at
    /// the photos.
    Every(usize),
    /// On the first frame (the paper's video, with `select:16/64`: 64 planes first, the 16 fullest of their histogram from then
    /// on).
    Once,
    /// Guided layers: the surface of the last frame, moved with the target camera, stays where the photos agree with it as well
    /// as they did; elsewhere it is searched anew.
    Propagate,
}

impl Policy {
    /// What serves these layers best.
    pub fn default_for(layers: &LayerSpec) -> Self {
        match layers {
            LayerSpec::Guided { .. } => Self::Propagate,
            LayerSpec::KMeans { .. } => Self::Every(1),
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
    /// All of the planes that those of the next frames are selected from.
    Dense,
    /// The planes that an earlier frame selected.
    Selected,
    /// A guided search over the whole target.
    Searched,
    /// The surface or the planes of an earlier frame, but for this share of the target, which was searched anew: 0 for none.
    Propagated {
        /// Share of the target, 0 to 1.
        refreshed: f64,
    },
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
