//! Renders requested views and files, from the photos of a scene or the video of a rig: in motion as large as the frame rate allows,
//! at rest at full quality.

mod photos;
mod video;

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
#[cfg(test)]
pub(crate) use fake::FakeSource;
use liveview::image::encode;
use liveview::ndarray::Array2;
use liveview::{Camera, Frame, ImageRgb};
use liveview_synthesizer::agreement;
use liveview_synthesizer::colormap::coloured;
use liveview_synthesizer::{FoundDepth, LayerSpec, Scene, Score};
use serde_json::{Value, json};

use crate::requests::{FileRequest, ViewRequest, Viewpoint};
pub(crate) use photos::Photos;
pub(crate) use video::Video;

/// Target time for one picture while the viewpoint or the time changes.
pub(super) const MOTION_BUDGET: Duration = Duration::from_millis(50);

/// A source of pictures. It renders at full quality at rest, and in motion as fast as it can.
pub(crate) trait Source {
    /// The photos with their cameras.
    fn scene(&self) -> &Scene;
    /// Scale of the target's sides, at most 1, for the next picture in motion; `pixels`: those of the full size.
    fn motion_scale(&self, pixels: usize) -> f64;
    /// A picture in motion.
    fn render_in_motion(&mut self, viewpoint: &Viewpoint) -> Result<Rendered>;
    /// Records the time that a picture in motion took, encoding included.
    fn record_motion_time(&mut self, rendered: &Rendered, took: Duration);
    /// A picture at full quality.
    fn render_at_rest(&mut self, viewpoint: &Viewpoint) -> Result<Rendered>;
    /// The photo of a camera at a time step.
    fn photo(&mut self, view: usize, step: usize) -> Result<ImageRgb>;
    /// The depth that a picture waits for; `None` if it waits for none.
    fn awaited(&mut self, _: &Viewpoint, _moving: bool) -> Option<AwaitedDepth> {
        None
    }
    /// A picture that does not need depth, in place of one that waits for it.
    fn render_draft(&mut self, viewpoint: &Viewpoint) -> Result<Rendered> {
        self.render_in_motion(viewpoint)
    }
    /// Whether a search for depth is running.
    fn is_searching(&self) -> bool {
        false
    }
    /// Starts the search for the depth of the first of the views' photos that can be searched,
    /// unless one is running. Returns whether any cannot be: no picture waits for these any more.
    fn start_search(&mut self, _views: &[usize]) -> bool {
        false
    }
    /// Takes what a search for the depth of a view's photo found; `None` if it failed.
    fn insert(&mut self, _view: usize, _found: Option<Box<FoundDepth>>) {}
    /// Number of calls of [`Self::prepare`] that still have something to do.
    fn unprepared(&self) -> usize;
    /// Number of these that the first picture needs.
    fn needed_first(&self) -> usize;
    /// Does a part of the work that pictures near a camera will need.
    fn prepare(&mut self, near: &Camera) -> Result<()>;
}

/// The depth that a picture waits for.
#[derive(Debug, Clone)]
pub(crate) struct AwaitedDepth {
    /// Views whose photos' depth is to be searched.
    pub(crate) views: Vec<usize>,
    /// Photos whose depth the picture needs.
    pub(crate) count: usize,
}

impl AwaitedDepth {
    /// How far the search is.
    pub(crate) fn to_json(&self) -> Value {
        json!({ "done": self.count - self.views.len(), "count": self.count })
    }
}

/// A picture, and what its header reports.
pub(crate) struct Rendered {
    pub(super) frame: Frame,
    /// Nearest and farthest depth, scene units.
    pub(super) range: (f64, f64),
    pub(super) layers: LayerSpec,
    /// Indices of the views that it was rendered from.
    pub(super) views: Vec<usize>,
    /// Indices of further views that its surface was found with.
    pub(super) helpers: Vec<usize>,
    /// Time to read photos, to search depth, and to select planes.
    pub(super) planning: [Duration; 3],
    /// Share of the pixels on which the photos agree, where it is known.
    pub(super) agreeing_share: Option<f64>,
    /// Cameras without a photo at the time step, and why.
    pub(super) left_out: Vec<String>,
}

/// A source for tests, whose depth is found when the test says so.
#[cfg(test)]
pub(crate) mod fake {
    use std::cell::RefCell;
    use std::rc::Rc;

    use super::*;

    /// A picture of time step s needs the depth of views 2s and 2s + 1. It renders nothing.
    #[derive(Default)]
    pub(crate) struct FakeSource {
        /// The view that is being searched.
        pub(crate) running: Rc<RefCell<Option<usize>>>,
        /// A view whose search cannot be started.
        pub(crate) unsearchable: Option<usize>,
        /// Views whose search has ended.
        pub(crate) ended: Vec<usize>,
    }

    impl Source for FakeSource {
        fn awaited(&mut self, viewpoint: &Viewpoint, _: bool) -> Option<AwaitedDepth> {
            let mut views = vec![2 * viewpoint.step, 2 * viewpoint.step + 1];
            views.retain(|view| !self.ended.contains(view));
            (!views.is_empty()).then_some(AwaitedDepth { views, count: 2 })
        }

        fn is_searching(&self) -> bool {
            self.running.borrow().is_some()
        }

        fn start_search(&mut self, views: &[usize]) -> bool {
            let failed = self.unsearchable.take_if(|view| views.contains(view));
            self.ended.extend(failed);
            *self.running.borrow_mut() = views.iter().copied().find(|view| !self.ended.contains(view));
            failed.is_some()
        }

        fn insert(&mut self, view: usize, _: Option<Box<FoundDepth>>) {
            *self.running.borrow_mut() = None;
            self.ended.push(view);
        }

        fn scene(&self) -> &Scene {
            unimplemented!()
        }

        fn motion_scale(&self, _: usize) -> f64 {
            unimplemented!()
        }

        fn render_in_motion(&mut self, _: &Viewpoint) -> Result<Rendered> {
            unimplemented!()
        }

        fn record_motion_time(&mut self, _: &Rendered, _: Duration) {
            unimplemented!()
        }

        fn render_at_rest(&mut self, _: &Viewpoint) -> Result<Rendered> {
            unimplemented!()
        }

        fn photo(&mut self, _: usize, _: usize) -> Result<ImageRgb> {
            unimplemented!()
        }

        fn unprepared(&self) -> usize {
            unimplemented!()
        }

        fn needed_first(&self) -> usize {
            unimplemented!()
        }

        fn prepare(&mut self, _: &Camera) -> Result<()> {
            unimplemented!()
        }
    }
}

/// Scale of the target's sides, at most, and pixels, at most, of pictures that stand in for others, in
/// motion and at rest: a search for depth takes the processor beside them.
const MOVING_DRAFT: (f64, f64) = (0.5, 60_000.0);
const RESTING_DRAFT: (f64, f64) = (1.0, 200_000.0);

/// A source of pictures, and its last picture at rest.
pub(crate) struct ViewRenderer {
    pub(crate) source: Box<dyn Source>,
    held_out: Vec<usize>,
    /// The last requested camera: near it photos are prepared next.
    last_camera: Camera,
    last_at_rest: Option<AtRest>,
    /// The number of pictures rendered so far.
    pub(crate) pictures: u64,
}

/// A picture at full quality.
struct AtRest {
    viewpoint: Viewpoint,
    disparity: Array2<f32>,
    header: Value,
    png: Arc<[u8]>,
}

impl ViewRenderer {
    /// `start`: the camera at which clients start.
    pub(crate) fn new(source: Box<dyn Source>, held_out: Vec<usize>, start: Camera) -> Self {
        Self { source, held_out, last_camera: start, last_at_rest: None, pictures: 0 }
    }

    /// Prepares a photo near the last viewpoint.
    pub(crate) fn prepare(&mut self) -> Result<()> {
        self.source.prepare(&self.last_camera)
    }

    /// A frame for a client: the length of the header (4 bytes, little endian), the header (JSON) and the picture (JPEG or PNG).
    pub(crate) fn frame(&mut self, request: &ViewRequest) -> Result<Vec<u8>> {
        self.last_camera = request.viewpoint.camera.clone();
        let started = Instant::now();
        let awaited = self.awaited(&request.viewpoint, request.moving);
        let (mut header, picture) = match (&awaited, request.moving) {
            (Some(_), _) => self.draft(request)?,
            (None, true) => self.in_motion(request)?,
            (None, false) => self.at_rest(request)?,
        };
        header["search"] = awaited.as_ref().map_or(Value::Null, AwaitedDepth::to_json);
        header["id"] = request.id.into();
        header["moving"] = request.moving.into();
        header["depth"] = request.depth.into();
        header["step"] = request.viewpoint.step.into();
        header["milliseconds"] = milliseconds(started.elapsed()).into();
        let header = header.to_string();
        let length = u32::try_from(header.len())?.to_le_bytes();
        Ok([&length, header.as_bytes(), &picture].concat())
    }

    /// The depth that a picture waits for; `None` if it waits for none, as the last picture at
    /// rest.
    pub(crate) fn awaited(&mut self, viewpoint: &Viewpoint, moving: bool) -> Option<AwaitedDepth> {
        if !moving && self.last_at_rest.as_ref().is_some_and(|last| last.viewpoint == *viewpoint) {
            return None;
        }
        self.source.awaited(viewpoint, moving)
    }

    fn in_motion(&mut self, request: &ViewRequest) -> Result<(Value, Vec<u8>)> {
        let started = Instant::now();
        let scale = self.source.motion_scale(request.viewpoint.camera.size().pixels());
        let rendered = self.source.render_in_motion(&scaled(&request.viewpoint, scale)?)?;
        let picture = self.jpeg(&rendered, request.depth)?;
        self.source.record_motion_time(&rendered, started.elapsed());
        Ok((header(&rendered), picture))
    }

    /// A picture that stands in for one that waits for depth.
    fn draft(&mut self, request: &ViewRequest) -> Result<(Value, Vec<u8>)> {
        let pixels = request.viewpoint.camera.size().pixels() as f64;
        let (scale, most) = if request.moving { MOVING_DRAFT } else { RESTING_DRAFT };
        let scaled = scaled(&request.viewpoint, scale.min((most / pixels).sqrt()))?;
        let rendered = self.source.render_draft(&scaled)?;
        Ok((header(&rendered), self.jpeg(&rendered, request.depth)?))
    }

    fn jpeg(&mut self, rendered: &Rendered, depth: bool) -> Result<Vec<u8>> {
        self.pictures += 1;
        let shown = if depth { disparity_colours(&rendered.frame.disparity) } else { rendered.frame.picture() };
        Ok(encode(Path::new("frame.jpg"), &shown)?)
    }

    fn at_rest(&mut self, request: &ViewRequest) -> Result<(Value, Vec<u8>)> {
        let at_rest = self.rendered_at_rest(&request.viewpoint)?;
        let png = if request.depth {
            encode(Path::new("depth.png"), &disparity_colours(&at_rest.disparity))?
        } else {
            at_rest.png.to_vec()
        };
        Ok((at_rest.header.clone(), png))
    }

    /// A picture as PNG, the same bytes that `liveview render --pose`, or for a rig `liveview video --poses`, writes; or a photo as
    /// JPEG.
    pub(crate) fn file(&mut self, request: &FileRequest) -> Result<Arc<[u8]>> {
        match request {
            FileRequest::Picture(viewpoint) => Ok(Arc::clone(&self.rendered_at_rest(viewpoint)?.png)),
            &FileRequest::Photo { view, step } => {
                Ok(encode(Path::new("photo.jpg"), &self.source.photo(view, step)?)?.into())
            }
        }
    }

    fn rendered_at_rest(&mut self, viewpoint: &Viewpoint) -> Result<&AtRest> {
        let last = match self.last_at_rest.take() {
            Some(last) if last.viewpoint == *viewpoint => last,
            _ => {
                let rendered = self.source.render_at_rest(viewpoint)?;
                self.pictures += 1;
                let mut header = header(&rendered);
                if let Some((view, score)) = self.score(viewpoint, &rendered.frame)? {
                    header["truth"] = view.into();
                    header["psnr"] = score.psnr.into();
                    header["ssim"] = score.ssim.into();
                }
                let png = encode(Path::new("picture.png"), &rendered.frame.picture())?.into();
                AtRest { viewpoint: viewpoint.clone(), disparity: rendered.frame.disparity, header, png }
            }
        };
        Ok(self.last_at_rest.insert(last))
    }

    /// The held-out view at this viewpoint and the score against it, if there is one: before uncovered pixels are inpainted.
    fn score(&mut self, viewpoint: &Viewpoint, frame: &Frame) -> Result<Option<(usize, Score)>> {
        let views = &self.source.scene().views;
        let Some(&view) = self.held_out.iter().find(|&&view| views[view].camera == viewpoint.camera) else {
            return Ok(None);
        };
        Ok(Score::of(frame.raw(), &self.source.photo(view, viewpoint.step)?).map(|score| (view, score)))
    }
}

/// A viewpoint whose picture has its sides scaled.
fn scaled(viewpoint: &Viewpoint, scale: f64) -> Result<Viewpoint> {
    Ok(Viewpoint { camera: liveview_live::video::scaled(&viewpoint.camera, scale)?, step: viewpoint.step })
}

/// Disparity as colours that span what the picture shows, but for a hundredth of its pixels at either end.
fn disparity_colours(disparity: &Array2<f32>) -> ImageRgb {
    // One pixel of 16 is enough.
    let mut values: Vec<f32> = disparity.iter().step_by(16).copied().collect();
    values.sort_unstable_by(f32::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share) as usize];
    coloured(disparity.view(), at(0.01), at(0.99))
}

fn header(rendered: &Rendered) -> Value {
    let Rendered { frame, range: (near, far), layers, views, helpers, planning, agreeing_share, left_out } = rendered;
    let pixels = frame.transmittance.len() as f64;
    let mean = |map: &Array2<f32>| map.iter().map(|&value| f64::from(value)).sum::<f64>() / pixels;
    let [photos, search, select] = planning.map(milliseconds);
    json!({
        "width": frame.raw().width(), "height": frame.raw().height(),
        "layers": layers.to_string(), "views": views, "helpers": helpers, "left_out": left_out,
        "warning": agreeing_share.and_then(agreement::warning),
        "uncovered": frame.uncovered_share(), "occluded": frame.occluded_pixels as f64 / pixels,
        // JSON has no infinity.
        "disparity": mean(&frame.disparity), "near": near, "far": far.is_finite().then_some(far),
        "stages": {
            "photos": photos, "depth": search, "select": select, "warp": milliseconds(frame.times.warp),
            "network": milliseconds(frame.times.network), "composite": milliseconds(frame.times.composite),
        },
    })
}

fn milliseconds(time: Duration) -> f64 {
    (1e5 * time.as_secs_f64()).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_picture_at_rest_waits_for_nothing() {
        let viewpoint = Viewpoint::sample(0);
        let mut renderer = ViewRenderer::new(Box::new(FakeSource::default()), Vec::new(), viewpoint.camera.clone());
        assert!(renderer.awaited(&viewpoint, false).is_some());
        let disparity = Array2::zeros((1, 1));
        let png = Arc::from(&b"png"[..]);
        renderer.last_at_rest = Some(AtRest { viewpoint: viewpoint.clone(), disparity, header: Value::Null, png });
        assert!(renderer.awaited(&viewpoint, false).is_none());
        assert!(renderer.awaited(&viewpoint, true).is_some());
        assert!(renderer.awaited(&Viewpoint::sample(1), false).is_some());
        assert_eq!(*renderer.file(&FileRequest::Picture(viewpoint)).unwrap(), *b"png");
    }
}
