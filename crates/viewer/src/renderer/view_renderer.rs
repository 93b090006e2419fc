//! Renders requested views and files from a source, and keeps the last picture at rest.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use liveview::image::encode;
use liveview::ndarray::Array2;
use liveview::{Camera, Frame, ImageRgb};
use liveview_synthesizer::agreement;
use liveview_synthesizer::Score;
use liveview_synthesizer::colormap::coloured;
use serde_json::{Value, json};

use super::source::{AwaitedDepth, Rendered, Source};
use crate::request::{FileRequest, ViewRequest, Viewpoint};

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
    pictures: u64,
}

/// A picture at full quality.
struct AtRest {
    viewpoint: Viewpoint,
    rendered: Rendered,
    header: Value,
    png: Arc<[u8]>,
}

impl ViewRenderer {
    /// `start`: the camera at which clients start.
    pub(crate) fn new(source: Box<dyn Source>, held_out: Vec<usize>, start: Camera) -> Self {
        Self { source, held_out, last_camera: start, last_at_rest: None, pictures: 0 }
    }

    /// The number of pictures rendered so far.
    pub(crate) fn pictures(&self) -> u64 {
        self.pictures
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
        let shown = if depth { disparity_colours(rendered) } else { inpainted(rendered) };
        Ok(encode(Path::new("frame.jpg"), &shown)?)
    }

    fn at_rest(&mut self, request: &ViewRequest) -> Result<(Value, Vec<u8>)> {
        let at_rest = self.rendered_at_rest(&request.viewpoint)?;
        let png = if request.depth {
            encode(Path::new("depth.png"), &disparity_colours(&at_rest.rendered))?
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
                let png = encode(Path::new("picture.png"), &inpainted(&rendered))?.into();
                AtRest { viewpoint: viewpoint.clone(), rendered, header, png }
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
    let full = viewpoint.camera.size();
    let side = |side: usize| ((side as f64 * scale).round() as usize).max(1);
    let camera = viewpoint.camera.with_size_scaled(side(full.width), side(full.height))?;
    Ok(Viewpoint { camera, step: viewpoint.step })
}

fn inpainted(rendered: &Rendered) -> ImageRgb {
    rendered.frame.picture()
}

/// Disparity as colours that span what the picture shows, but for a hundredth of its pixels at either end.
fn disparity_colours(rendered: &Rendered) -> ImageRgb {
    let disparity = &rendered.frame.disparity;
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
    use liveview::render::StageTimes;
    use liveview_synthesizer::LayerSpec;

    use super::super::source::fake::FakeSource;
    use super::*;

    #[test]
    fn last_picture_at_rest_waits_for_nothing() {
        let viewpoint = Viewpoint::sample(0);
        let mut renderer = ViewRenderer::new(Box::new(FakeSource::default()), Vec::new(), viewpoint.camera.clone());
        assert!(renderer.awaited(&viewpoint, false).is_some());
        let frame = Frame {
            picture: ImageRgb::new(1, 1, vec![0.0; 3]).unwrap(),
            disparity: Array2::zeros((1, 1)),
            transmittance: Array2::zeros((1, 1)),
            best_layer: Array2::from_elem((1, 1), None),
            uncovered_layers: 0,
            occluded_pixels: 0,
            logits_not_finite: 0,
            times: StageTimes::default(),
        };
        let rendered = Rendered {
            frame,
            range: (1.0, 2.0),
            layers: LayerSpec::Surface(1),
            views: Vec::new(),
            helpers: Vec::new(),
            planning: [Duration::ZERO; 3],
            agreeing_share: None,
            left_out: Vec::new(),
        };
        let png = Arc::from(&b"png"[..]);
        renderer.last_at_rest = Some(AtRest { viewpoint: viewpoint.clone(), rendered, header: Value::Null, png });
        assert!(renderer.awaited(&viewpoint, false).is_none());
        assert!(renderer.awaited(&viewpoint, true).is_some());
        assert!(renderer.awaited(&Viewpoint::sample(1), false).is_some());
        assert_eq!(*renderer.file(&FileRequest::Picture(viewpoint)).unwrap(), *b"png");
    }
}
