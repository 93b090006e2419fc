//! Renders requested views and files from a source, and keeps the last picture at rest.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use liveview::image::{Score, coloured, encode};
use liveview::ndarray::Array2;
use liveview::{Camera, Frame, ImageRgb};
use serde_json::{Value, json};

use super::source::{Rendered, Source};
use crate::request::{FileRequest, ViewRequest, Viewpoint};

/// A source of pictures, and its last picture at rest.
pub(crate) struct ViewRenderer {
    source: Box<dyn Source>,
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

    /// Number of calls of [`Self::prepare`] that the first picture needs.
    pub(crate) fn needed_first(&self) -> usize {
        self.source.needed_first()
    }

    /// Number of calls of [`Self::prepare`] that still have something to do.
    pub(crate) fn unprepared(&self) -> usize {
        self.source.unprepared()
    }

    /// Prepares a photo near the last viewpoint.
    pub(crate) fn prepare(&mut self) -> Result<()> {
        self.source.prepare(&self.last_camera)
    }

    /// A frame for a client: the length of the header (4 bytes, little endian), the header (JSON) and the picture (JPEG or PNG).
    pub(crate) fn frame(&mut self, request: &ViewRequest) -> Result<Vec<u8>> {
        self.last_camera = request.viewpoint.camera.clone();
        let started = Instant::now();
        let (mut header, picture) = if request.moving { self.in_motion(request)? } else { self.at_rest(request)? };
        header["id"] = request.id.into();
        header["moving"] = request.moving.into();
        header["depth"] = request.depth.into();
        header["step"] = request.viewpoint.step.into();
        header["milliseconds"] = milliseconds(started.elapsed()).into();
        let header = header.to_string();
        let length = u32::try_from(header.len())?.to_le_bytes();
        Ok([&length, header.as_bytes(), &picture].concat())
    }

    fn in_motion(&mut self, request: &ViewRequest) -> Result<(Value, Vec<u8>)> {
        let started = Instant::now();
        let Viewpoint { camera, step } = &request.viewpoint;
        let full = camera.size();
        let scale = self.source.motion_scale(full.pixels());
        let side = |side: usize| ((side as f64 * scale).round() as usize).max(1);
        let camera = camera.with_size_scaled(side(full.width), side(full.height))?;
        let rendered = self.source.render_in_motion(&Viewpoint { camera, step: *step })?;
        self.pictures += 1;
        let shown = if request.depth { disparity_colours(&rendered) } else { inpainted(&rendered) };
        let picture = encode(Path::new("frame.jpg"), &shown)?;
        self.source.record_motion_time(&rendered, started.elapsed());
        Ok((header(&rendered), picture))
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
        Ok(Score::of(&frame.picture, &self.source.photo(view, viewpoint.step)?).map(|score| (view, score)))
    }
}

fn inpainted(rendered: &Rendered) -> ImageRgb {
    rendered.frame.inpainted()
}

/// Disparity as colours, as `liveview render --depth` writes it.
fn disparity_colours(rendered: &Rendered) -> ImageRgb {
    let (near, far) = rendered.range;
    coloured(rendered.frame.disparity.view(), (1.0 / far) as f32, (1.0 / near) as f32)
}

fn header(rendered: &Rendered) -> Value {
    let Rendered { frame, range: (near, far), layers, views, helpers, planning, left_out } = rendered;
    let pixels = frame.transmittance.len() as f64;
    let mean = |map: &Array2<f32>| map.iter().map(|&value| f64::from(value)).sum::<f64>() / pixels;
    let [photos, search, select] = planning.map(milliseconds);
    json!({
        "width": frame.picture.width(), "height": frame.picture.height(),
        "layers": layers.to_string(), "views": views, "helpers": helpers, "left_out": left_out,
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
