//! Which layers to render on, as text: the same on the command line, in model cards, tables and
//! JSON.
//!
//! | text | layers |
//! |---|---|
//! | `planes:64` | planes evenly spaced in disparity from near to far (the paper's) |
//! | `guided:2` | layers that divide a range of disparities of each pixel, found by a search at the target; `guided:2/32`: 32 planes in the first search |
//! | `surface:2` | layers along the surface that the depth of the photos gives, with per-view occlusion |
//! | `select:16/64` | 16 of 64 planes: the paper's selection, those that are the best of most pixels; of competing planes, those nearest to the best planes of all pixels; `select:16` is `select:16/64` |
//! | `list:0.5,0.25,0` | planes at these disparities (1/scene unit), near to far: descending |

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use liveview::layers::Layers;

/// Most layers of one render.
pub const MAX_LAYERS: usize = 4096;

/// Planes that `select:K` selects from.
const SELECT_FROM: usize = 64;

/// Which layers to render on.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum LayerSpec {
    /// Planes evenly spaced in disparity.
    Planes(usize),
    /// Layers that divide a range of disparities of each pixel ([`liveview_surface::guided`]).
    Guided {
        /// The number of layers.
        layers: usize,
        /// Planes of the first search; `None`: chosen by the parallax
        /// ([`liveview_surface::guided::GuidedSearch`]).
        coarse_planes: Option<usize>,
    },
    /// Layers along the surface that the depth of the photos gives ([`liveview_surface`]).
    Surface(usize),
    /// The paper's selection.
    Select {
        /// Planes kept.
        keep: usize,
        /// Planes that they are selected from.
        from: usize,
    },
    /// Planes at these disparities, 1/scene unit, near → far; checked by [`Layers::planes`].
    List(Vec<f64>),
}

impl LayerSpec {
    /// The paper's layers: 16 planes selected from 64.
    pub const PAPER: Self = Self::Select { keep: 16, from: SELECT_FROM };

    /// Its kind, the text before the colon: `planes`, `guided`, `surface`, `select` or `list`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Planes(_) => "planes",
            Self::Guided { .. } => "guided",
            Self::Surface(_) => "surface",
            Self::Select { .. } => "select",
            Self::List(_) => "list",
        }
    }

    /// The most layers that one render needs: for [`LayerSpec::Select`] the planes that it selects
    /// from.
    pub fn count(&self) -> usize {
        match self {
            Self::Planes(count) | Self::Surface(count) => *count,
            Self::Guided { layers, .. } => *layers,
            Self::Select { from, .. } => *from,
            Self::List(list) => list.len(),
        }
    }

    /// That many guided layers, with the planes of the first search chosen by the parallax.
    pub fn guided(layers: usize) -> Self {
        Self::Guided { layers, coarse_planes: None }
    }
}

impl FromStr for LayerSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        parse(text).map_err(|reason| format!("{text:?} is not a choice of layers: {reason}"))
    }
}

fn parse(text: &str) -> Result<LayerSpec, String> {
    let kinds = || "expected planes:D, guided:L, surface:L, select:K/D or list:DISPARITIES".to_owned();
    let (kind, rest) = text.trim().split_once(':').ok_or_else(kinds)?;
    let (count, of) = rest.split_once('/').map_or((rest, None), |(count, of)| (count, Some(of)));
    let layers = || whole(count, 1..=MAX_LAYERS);
    let coarse_planes = || of.map(|of| whole(of, 2..=MAX_LAYERS)).transpose();
    Ok(match kind {
        "planes" => LayerSpec::Planes(whole(rest, 1..=MAX_LAYERS)?),
        "guided" => LayerSpec::Guided { layers: layers()?, coarse_planes: coarse_planes()? },
        "surface" => LayerSpec::Surface(whole(rest, 1..=MAX_LAYERS)?),
        "select" => {
            let (keep, from) = (layers()?, of.map_or(Ok(SELECT_FROM), |of| whole(of, 1..=MAX_LAYERS))?);
            if keep > from {
                return Err(format!("{keep} planes cannot be selected from {from}; expected at most that many"));
            }
            LayerSpec::Select { keep, from }
        }
        "list" => {
            let number = |item: &str| item.trim().parse().map_err(|_| format!("\"{}\" is not a number", item.trim()));
            let list: Vec<f64> =
                rest.split(',').filter(|_| !rest.trim().is_empty()).map(number).collect::<Result<_, _>>()?;
            Layers::planes(&list).map_err(|error| error.to_string())?;
            LayerSpec::List(list)
        }
        _ => return Err(kinds()),
    })
}

fn whole(text: &str, range: RangeInclusive<usize>) -> Result<usize, String> {
    let number = text.trim().parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| {
        format!("\"{text}\" is not a count: expected a whole number from {} to {}", range.start(), range.end())
    })
}

impl fmt::Display for LayerSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.kind())?;
        let of = |planes: &Option<usize>| planes.map(|planes| format!("/{planes}")).unwrap_or_default();
        match self {
            Self::Guided { layers, coarse_planes } => write!(f, "{layers}{}", of(coarse_planes)),
            Self::Planes(layers) | Self::Surface(layers) => write!(f, "{layers}"),
            Self::Select { keep, from } => write!(f, "{keep}/{from}"),
            Self::List(list) => {
                let list: Vec<String> = list.iter().map(f64::to_string).collect();
                write!(f, "{}", list.join(","))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displayed_spec_parses_to_itself() {
        let texts = ["planes:64", "guided:2", "guided:2/32", "surface:2", "select:16/64", "list:0.5,0.25,0"];
        for text in texts {
            assert_eq!(text.parse::<LayerSpec>().unwrap().to_string(), text);
        }
        assert_eq!("select:16".parse(), Ok(LayerSpec::PAPER));
        assert_eq!("guided:3".parse(), Ok(LayerSpec::guided(3)));
    }

    #[test]
    fn errors_name_the_text_and_what_was_expected() {
        let cases = [
            ("guided", "expected planes:D"),
            ("tiles:3", "expected planes:D"),
            ("planes:0", "whole number from 1 to 4096"),
            ("planes:8/2", "\"8/2\" is not a count"),
            ("guided:2/1", "whole number from 2 to 4096"),
            ("select:9/8", "9 planes cannot be selected from 8"),
            ("list:", "expected at least one"),
            ("list:1,x", "\"x\" is not a number"),
            ("list:0.1,0.2", "nearer than the one before it"),
        ];
        for (text, expected) in cases {
            let message = text.parse::<LayerSpec>().unwrap_err();
            assert!(message.contains(expected) && message.contains(text), "{message}");
        }
    }
}
