//! Parameters of the search and the surface.

/// What the search and the surface are tuned by. Lengths in px are pixels of parallax.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Settings {
    /// Photos that one is matched with.
    pub neighbours: usize,
    /// Photos beyond the V of the picture that its surface is found with.
    pub extra: usize,
    /// Distance of the planes of the first search, px.
    pub spacing: f64,
    /// Planes of the second search for one of the first.
    pub parts: usize,
    /// Penalty of a step to the next plane.
    pub step: f32,
    /// Penalty of a jump to any other, where the photo has no edge.
    pub jump: f32,
    /// Difference of colour that halves the latter.
    pub edge: f32,
    /// Within how many px another map confirms a depth, and two depths carried to the target are one surface.
    pub agree: f32,
    /// From how many px on another map contradicts it.
    pub past: f32,
    /// How many px behind another depth one may lie that is averaged with it where both are carried to the target.
    pub fuse: f32,
    /// Share of the target's pixels without a confirmed depth from which on they are searched at the target as well.
    pub search_holes: f64,
    /// How much nearer a view's own depth must be to hide a point, px.
    pub hides: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            neighbours: 5,
            extra: 2,
            spacing: 1.0,
            parts: 2,
            step: 0.01,
            jump: 0.12,
            edge: 0.05,
            agree: 2.0,
            past: 4.0,
            fuse: 3.0,
            search_holes: 0.05,
            hides: 4.0,
        }
    }
}
