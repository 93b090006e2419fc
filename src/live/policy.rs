//! Which layers a frame is rendered on, and what it takes over from the frames before.

use std::fmt;

/// How a session finds the layers of its frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Policy {
    /// Evenly spaced planes, the same for every frame.
    Planes(usize),
    /// The paper's video: `first` evenly spaced planes on the first frame, the fullest `then` of their histogram on all
    /// that follow.
    Paper {
        /// Planes of the first frame.
        first: usize,
        /// Planes of every other.
        then: usize,
    },
    /// Guided layers: a coarse pass every so many frames (1: each), its surface moved with the target camera in between, unseen
    /// what the photos say.
    Every(usize),
    /// Guided layers: the surface of the last frame, moved with the target camera, replaces the coarse pass where the photos
    /// agree with it as well as they did; elsewhere it is searched anew.
    Carried,
}

impl Policy {
    /// The paper's figures.
    pub const PAPER: Self = Self::Paper { first: 64, then: 16 };
}

impl fmt::Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Planes(count) => write!(f, "planes:{count}"),
            Self::Paper { first, then } => write!(f, "paper ({then} of {first} planes)"),
            Self::Every(1) => write!(f, "each"),
            Self::Every(frames) => write!(f, "every:{frames}"),
            Self::Carried => write!(f, "carried"),
        }
    }
}

/// Where the layers of a frame came from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LayerSource {
    /// All of the evenly spaced planes.
    Planes,
    /// The planes that the first frame selected.
    Selected,
    /// A coarse pass over the whole target.
    Searched,
    /// The last frame's surface, but for this share of the target, which was searched anew: 0 for none of it.
    Carried {
        /// Share of the target, 0 to 1.
        refreshed: f64,
    },
}

impl fmt::Display for LayerSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Planes => write!(f, "planes"),
            Self::Selected => write!(f, "selected"),
            Self::Searched => write!(f, "searched"),
            Self::Carried { refreshed: 0.0 } => write!(f, "carried"),
            Self::Carried { .. } => write!(f, "refreshed"),
        }
    }
}
