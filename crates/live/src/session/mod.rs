//! Live video: the synchronised frames of a camera rig become the frames of a moving viewpoint.
//!
//! A [`LiveSession`] takes the photos of one time step and a target camera, and returns a
//! [`LiveFrame`]. Its [`Policy`] says what a frame reuses of earlier ones: the paper's planes,
//! selected once; the surface of the last frame, propagated to the next as long as the photos agree
//! with it; the depth of each camera's photo, where the photo stays the same. Memory does not grow
//! with the length of the video.

mod camera_depths;

use std::fmt;
use std::str::FromStr;
use std::time::{Duration, Instant};

use liveview::geometry::{Camera, TooFewViews};
use liveview::image::ImageRgb;
use liveview::layers::{LayersError, uniform_disparities};
use liveview::render::{Frame, RenderError, RenderRequest, Renderer, StageTimes};
use liveview_surface::{PhotoCorrection, Reuse, TargetSurface};
pub use liveview_synthesizer::LayerSource;
use liveview_synthesizer::{Carried, FrameInput, LayerSpec, ViewAgreement, find_layers};
use rayon::prelude::*;

pub use camera_depths::CameraDepths;
use camera_depths::Step;

/// When a session searches for the layers of its frames, where these depend on the scene
/// ([`LayerSpec`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Policy {
    /// On every frame.
    Each,
    /// On the first frame. From then on the surface of guided layers moves with the target camera, and the cameras keep
    /// their depth for surface layers, whatever the photos show. With `select:16/64` the paper's video, which renders 64 planes once and
    /// 16 of them from then on ([`liveview_synthesizer::select_planes`]).
    Once,
    /// Guided layers: the surface of the last frame moves with the target camera, and is searched
    /// again where it fits the photos less well than before. Surface layers: the depth of a camera's
    /// photo follows it ([`liveview_surface::FollowedDepth`]): a coarser search, where the photo has
    /// changed.
    Propagate,
}

impl Policy {
    /// The default for these layers: `once` for planes, `propagate` for layers that follow the
    /// scene.
    pub fn default_for(layers: &LayerSpec) -> Self {
        if matches!(layers.kind(), "guided" | "surface") { Self::Propagate } else { Self::Once }
    }

    /// The policy given, if it suits the layers, or the default for these.
    pub fn for_layers(given: Option<Self>, layers: &LayerSpec) -> Result<Self, String> {
        match given.unwrap_or(Self::default_for(layers)) {
            Self::Propagate if Self::default_for(layers) != Self::Propagate => Err(format!(
                "propagate: only guided and surface layers have depth to propagate; expected each or once for {layers}"
            )),
            policy => Ok(policy),
        }
    }

    /// The layers in place of those recommended, where none are given: along depth that follows, one layer
    /// without a network shows more than three (docs/design-log/video.md).
    pub fn layers_by_default(self, recommended: LayerSpec) -> LayerSpec {
        match self {
            Self::Propagate if recommended == ViewAgreement::LAYERS => LayerSpec::Surface(1),
            _ => recommended,
        }
    }
}

impl fmt::Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Each => "each",
            Self::Once => "once",
            Self::Propagate => "propagate",
        })
    }
}

impl FromStr for Policy {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "each" => Ok(Self::Each),
            "once" => Ok(Self::Once),
            "propagate" => Ok(Self::Propagate),
            _ => Err("expected propagate, each or once".to_owned()),
        }
    }
}

/// How a session renders.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveSettings {
    /// Nearest depth, scene units.
    pub near: f64,
    /// Farthest depth, scene units; may be infinite.
    pub far: f64,
    /// Which layers each frame is rendered on.
    pub layers: LayerSpec,
    /// When these are searched for.
    pub policy: Policy,
    /// Whether surface layers leave the exposure of the photos unchanged; by default it is
    /// balanced.
    pub keep_exposure: bool,
    /// Whether depth that follows is coarse: from fewer photos, and not decided at edges. Three quarters of the time
    /// (docs/design-log/video.md).
    pub coarse_depth: bool,
}

impl LiveSettings {
    /// Two guided layers, the surface propagated from frame to frame.
    pub fn new(near: f64, far: f64) -> Self {
        let layers = LayerSpec::guided(2);
        Self { near, far, policy: Policy::default_for(&layers), layers, keep_exposure: false, coarse_depth: false }
    }
}

/// A rendered time step.
#[derive(Debug, Clone)]
pub struct LiveFrame {
    /// The picture, with its depth.
    pub frame: Frame,
    /// Where its layers came from.
    pub layer_source: LayerSource,
    /// Indices of the cameras it was rendered from, nearest first.
    pub views: Vec<usize>,
    /// Frames since the last search or selection.
    pub age: usize,
    /// Wall time per stage.
    pub times: LiveTimes,
}

/// Wall time per stage of one time step.
#[derive(Debug, Clone, Copy, Default)]
pub struct LiveTimes {
    /// Converting the photos to textures.
    pub photos: Duration,
    /// Finding the layers.
    pub layers: Duration,
    /// Rendering them.
    pub stages: StageTimes,
}

impl LiveTimes {
    /// The sum of all stages.
    pub fn total(&self) -> Duration {
        self.photos + self.layers + self.stages.warp + self.stages.network + self.stages.composite
    }
}

/// Why a session, or one of its time steps, failed. After a failed time step the session can go on
/// with the next.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LiveError {
    /// A session without a network.
    #[error("a session without a network; expected at least one")]
    NoNetwork,
    /// The number of photos differs from that of the cameras, or the size of one from its camera's.
    #[error("{0}")]
    Photos(String),
    /// Fewer photos face the target's direction than the smallest network takes.
    #[error(transparent)]
    Views(#[from] TooFewViews),
    /// Near and far span no range of depths.
    #[error(transparent)]
    Layers(#[from] LayersError),
    /// The network failed.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// Renders the time steps of a rig, one after the other.
#[derive(Debug)]
pub struct LiveSession {
    cameras: Vec<Camera>,
    /// Largest V first.
    renderers: Vec<Renderer>,
    settings: LiveSettings,
    /// The depth of the cameras' photos, for surface layers.
    depths: CameraDepths,
    /// What the layers of the next frame reuse.
    carried: Carried,
    /// Frames since the last search or selection.
    age: usize,
}

impl LiveSession {
    /// A session for the cameras of a rig. Of several networks the one with the most views renders;
    /// one with fewer only a time step for which too few photos were delivered.
    ///
    /// # Errors
    ///
    /// [`LiveError::NoNetwork`], or [`LiveError::Layers`] unless 0 < near < far.
    pub fn new(cameras: Vec<Camera>, mut renderers: Vec<Renderer>, settings: LiveSettings) -> Result<Self, LiveError> {
        uniform_disparities(settings.near, settings.far, 2)?;
        renderers.sort_by_key(|renderer| std::cmp::Reverse(renderer.network().views()));
        if renderers.is_empty() {
            return Err(LiveError::NoNetwork);
        }
        let depths = CameraDepths::new(cameras.clone(), (settings.near, settings.far));
        Ok(Self { cameras, renderers, settings, depths, carried: Carried::default(), age: 0 })
    }

    /// The cameras of the rig.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// Sets the layers of the next frames, and whether depth that follows is coarse.
    pub fn set_layers(&mut self, layers: LayerSpec, coarse_depth: bool) {
        (self.settings.layers, self.settings.coarse_depth) = (layers, coarse_depth);
    }

    /// Drops what is reused of earlier frames: the next is rendered like the first.
    pub fn restart(&mut self) {
        (self.carried, self.age) = (Carried::default(), 0);
    }

    /// Renders `target` from the photos of one time step: one per camera, in the cameras' order;
    /// `None` where a camera has delivered nothing. The nearest V of the others are used.
    ///
    /// # Errors
    ///
    /// [`LiveError::Photos`] for photos that do not match the cameras;
    /// [`LiveError::Views`] where too few face the target's direction (what to show instead is up
    /// to the caller); [`LiveError::Layers`] and [`LiveError::Render`].
    pub fn render(&mut self, photos: &[Option<&ImageRgb>], target: &Camera) -> Result<LiveFrame, LiveError> {
        self.check(photos)?;
        let step = Step::new(&self.cameras, photos);
        let (network, views) = self.choose(&step, target)?;
        let started = Instant::now();
        let sources: Vec<_> = views.par_iter().map(|&view| step.source(view)).collect();
        let ready = Instant::now();
        let reuse = match self.settings.policy {
            Policy::Each => Reuse::Nothing,
            Policy::Once => Reuse::All,
            Policy::Propagate => Reuse::Refreshed,
        };
        let input = FrameInput {
            target,
            near: self.settings.near,
            far: self.settings.far,
            sources: &sources,
            is_followed: true,
            photo_correction: PhotoCorrection { exposure: !self.settings.keep_exposure, ..PhotoCorrection::default() },
        };
        let plan = find_layers::<LiveError>(&self.settings.layers, &mut self.carried, &input, reuse, |reuse| {
            let LiveSettings { policy, coarse_depth, .. } = self.settings;
            Ok(self.depths.photos(&step, target, views.len(), reuse, policy == Policy::Propagate, coarse_depth))
        })?;
        self.age = if matches!(plan.source, LayerSource::Searched | LayerSource::Dense) { 0 } else { self.age + 1 };
        let found = Instant::now();
        let renderer = &mut self.renderers[network];
        let visibility = plan.surface.as_ref().map(TargetSurface::visibility);
        let request = RenderRequest {
            corrections: &plan.corrections,
            visibility: visibility.as_ref(),
            ..RenderRequest::new(&sources, target, &plan.layers)
        };
        let frame = renderer.render(request)?;
        if let Some(selection) = plan.selects {
            self.carried.selected = Some(selection.planes(&frame, renderer.alpha())?);
        }
        let times = LiveTimes { photos: ready - started, layers: found - ready, stages: frame.times };
        Ok(LiveFrame { frame, layer_source: plan.source, views, age: self.age, times })
    }

    fn check(&self, photos: &[Option<&ImageRgb>]) -> Result<(), LiveError> {
        if photos.len() != self.cameras.len() {
            let (found, expected) = (photos.len(), self.cameras.len());
            return Err(LiveError::Photos(format!(
                "{found} photos for {expected} cameras; expected one entry per camera, None where it delivered nothing"
            )));
        }
        for (index, (photo, camera)) in photos.iter().zip(&self.cameras).enumerate() {
            let expected = camera.size();
            let found = photo.map_or(expected, ImageRgb::size);
            if found != expected {
                return Err(LiveError::Photos(format!("the photo of camera {index} is {found}; expected {expected}")));
            }
        }
        Ok(())
    }

    /// Index of the network, and indices of the cameras that it renders from.
    fn choose(&self, step: &Step<'_>, target: &Camera) -> Result<(usize, Vec<usize>), LiveError> {
        let mut nearest = step.nearest(target);
        let views = |renderer: &Renderer| renderer.network().views();
        let fits = self.renderers.iter().position(|renderer| views(renderer) <= nearest.len());
        let Some(network) = fits else {
            let wanted = self.renderers.iter().map(views).min().unwrap_or(0);
            return Err(TooFewViews { wanted, found: nearest.len(), of: step.delivered() }.into());
        };
        nearest.truncate(views(&self.renderers[network]));
        Ok((network, nearest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policy_text_round_trips_and_unknown_text_is_an_error() {
        for text in ["propagate", "each", "once"] {
            assert_eq!(text.parse::<Policy>().unwrap().to_string(), text);
        }
        assert!("sometimes".parse::<Policy>().is_err());
    }
}
