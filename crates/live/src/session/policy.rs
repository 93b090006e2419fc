//! When a session searches for layers.

use std::fmt;
use std::str::FromStr;

use liveview_synthesizer::LayerSpec;

/// When a session searches for the layers of its frames, where these depend on the scene
/// ([`LayerSpec`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Policy {
    /// Every so many frames (1: each). In between, the surface of guided layers moves with the
    /// target camera, and the cameras keep their depth for surface layers, whatever the photos
    /// show.
    Every(usize),
    /// On the first frame: with `select:16/64` the paper's video, which renders 64 planes once and
    /// 16 of them from then on ([`liveview::network::Alpha::select_planes`]).
    Once,
    /// Guided layers: the surface of the last frame moves with the target camera, and is searched
    /// again where it fits the photos less well than before. Surface layers: the depth of a
    /// camera's photo is searched again where the photo has changed.
    Propagate,
}

impl Policy {
    /// The default for these layers: `once` for planes, `propagate` for layers that follow the
    /// scene.
    pub fn default_for(layers: &LayerSpec) -> Self {
        if matches!(layers.kind(), "guided" | "surface") { Self::Propagate } else { Self::Once }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policy_text_round_trips_and_unknown_text_is_an_error() {
        for text in ["propagate", "each", "every:5", "once"] {
            assert_eq!(text.parse::<Policy>().unwrap().to_string(), text);
        }
        assert!("every:0".parse::<Policy>().unwrap_err().contains("whole number"));
        assert!("sometimes".parse::<Policy>().is_err() && "some:3".parse::<Policy>().is_err());
    }
}
