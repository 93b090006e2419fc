//! Renders what clients ask for, from a source, and keeps the last picture at rest.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use liveview::image::{Score, coloured, encode, inpaint_unseen};
use liveview::ndarray::Array2;
use liveview::{Camera, Frame, ImageRgb};
use serde_json::{Value, json};

use super::source::{Rendered, Source};
use crate::wish::{Asked, Moment, Wish};

/// A source, and its last picture at rest.
pub(crate) struct Studio {
    source: Box<dyn Source>,
    held_out: Vec<usize>,
    /// Where clients look from, for what to prepare next.
    at: Camera,
    last: Option<Rest>,
    pictures: u64,
}

/// A picture at full quality.
struct Rest {
    at: Moment,
    rendered: Rendered,
    header: Value,
    png: Arc<[u8]>,
}

impl Studio {
    /// `at`: where clients begin.
    pub(crate) fn new(source: Box<dyn Source>, held_out: Vec<usize>, at: Camera) -> Self {
        Self { source, held_out, at, last: None, pictures: 0 }
    }

    /// How many pictures were rendered.
    pub(crate) fn pictures(&self) -> u64 {
        self.pictures
    }

    pub(crate) fn needed_first(&self) -> usize {
        self.source.needed_first()
    }

    pub(crate) fn unprepared(&self) -> usize {
        self.source.unprepared()
    }

    pub(crate) fn prepare(&mut self) -> Result<()> {
        self.source.prepare(&self.at)
    }

    /// A header and a picture for a client.
    pub(crate) fn frame(&mut self, wish: &Wish) -> Result<Vec<u8>> {
        self.at = wish.at.camera.clone();
        let started = Instant::now();
        let (mut header, picture) = if wish.moving { self.in_motion(wish)? } else { self.at_rest(wish)? };
        header["id"] = wish.id.into();
        header["moving"] = wish.moving.into();
        header["depth"] = wish.depth.into();
        header["step"] = wish.at.step.into();
        header["milliseconds"] = milliseconds(started.elapsed()).into();
        let header = header.to_string();
        let length = u32::try_from(header.len())?.to_le_bytes();
        Ok([&length, header.as_bytes(), &picture].concat())
    }

    fn in_motion(&mut self, wish: &Wish) -> Result<(Value, Vec<u8>)> {
        let started = Instant::now();
        let full = wish.at.camera.size();
        let scale = self.source.scale(full.pixels());
        let side = |side: usize| ((side as f64 * scale).round() as usize).max(1);
        let camera = wish.at.camera.with_size_scaled(side(full.width), side(full.height))?;
        let rendered = self.source.in_motion(&Moment { camera, step: wish.at.step })?;
        self.pictures += 1;
        let shown = if wish.depth { depth(&rendered) } else { picture(&rendered) };
        let picture = encode(Path::new("frame.jpg"), &shown)?;
        self.source.note(&rendered, started.elapsed());
        Ok((header(&rendered), picture))
    }

    fn at_rest(&mut self, wish: &Wish) -> Result<(Value, Vec<u8>)> {
        let rest = self.rest(&wish.at)?;
        let png = if wish.depth { encode(Path::new("depth.png"), &depth(&rest.rendered))? } else { rest.png.to_vec() };
        Ok((rest.header.clone(), png))
    }

    /// A picture as PNG, the same bytes that `liveview render --pose`, or of a rig `liveview video --poses`, writes; or a photo as JPEG.
    pub(crate) fn file(&mut self, asked: &Asked) -> Result<Arc<[u8]>> {
        match asked {
            Asked::Picture(at) => Ok(Arc::clone(&self.rest(at)?.png)),
            &Asked::Photo { view, step } => Ok(encode(Path::new("photo.jpg"), &self.source.photo(view, step)?)?.into()),
        }
    }

    fn rest(&mut self, at: &Moment) -> Result<&Rest> {
        let last = match self.last.take() {
            Some(last) if last.at == *at => last,
            _ => {
                let rendered = self.source.at_rest(at)?;
                self.pictures += 1;
                let mut header = header(&rendered);
                if let Some((view, score)) = self.score(at, &rendered.frame)? {
                    header["truth"] = view.into();
                    header["psnr"] = score.psnr.into();
                    header["ssim"] = score.ssim.into();
                }
                let png = encode(Path::new("picture.png"), &picture(&rendered))?.into();
                Rest { at: at.clone(), rendered, header, png }
            }
        };
        Ok(self.last.insert(last))
    }

    /// The score of a picture that a held-out photo shows: as rendered, before pixels that no view covers are filled.
    fn score(&mut self, at: &Moment, frame: &Frame) -> Result<Option<(usize, Score)>> {
        let views = &self.source.scene().views;
        let Some(&view) = self.held_out.iter().find(|&&view| views[view].camera == at.camera) else {
            return Ok(None);
        };
        Ok(Score::of(&frame.picture, &self.source.photo(view, at.step)?).map(|score| (view, score)))
    }
}

fn picture(rendered: &Rendered) -> ImageRgb {
    inpaint_unseen(&rendered.frame.picture, &rendered.frame.transmittance)
}

/// Disparity in colour, as `liveview render --depth` writes it.
fn depth(rendered: &Rendered) -> ImageRgb {
    let (near, far) = rendered.range;
    coloured(rendered.frame.disparity.view(), (1.0 / far) as f32, (1.0 / near) as f32)
}

fn header(rendered: &Rendered) -> Value {
    let Rendered { frame, range: (near, far), layers, views, helpers, before, left_out } = rendered;
    let pixels = frame.transmittance.len() as f64;
    let mean = |map: &Array2<f32>| map.iter().map(|&value| f64::from(value)).sum::<f64>() / pixels;
    let [photos, search, select] = before.map(milliseconds);
    json!({
        "width": frame.picture.width(), "height": frame.picture.height(),
        "layers": layers.to_string(), "views": views, "helpers": helpers, "left_out": left_out,
        "uncovered": mean(&frame.transmittance), "hidden": frame.unseen as f64 / pixels,
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
