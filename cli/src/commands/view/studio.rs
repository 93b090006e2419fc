//! Renders what clients wish to see: while the viewpoint moves as large as the frame rate allows, at rest as `liveview render` does.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use liveview::geometry::distance;
use liveview::image::{Score, coloured, encode, inpaint_unseen};
use liveview::{Camera, Frame, ImageRgb, LayerSpec, PhotoCache, Plan, Shot, TargetView, Targets};
use serde_json::{Value, json};

use super::desk::Wish;
use super::hello::hello;
use super::pace::Pace;
use crate::job::Job;

/// Of a photo and its depth in memory, at most.
const BYTES_PER_PIXEL: usize = 20;

/// A synthesizer, and what it has rendered last.
pub(super) struct Studio {
    job: Job,
    held_out: Vec<usize>,
    layers: LayerSpec,
    moving_layers: LayerSpec,
    /// A target at each view.
    around: Vec<Shot>,
    /// Of these, those whose photo and depth were not prepared.
    unprepared: Vec<usize>,
    /// Where clients look from, for what to prepare next.
    at: Camera,
    pace: Pace,
    /// The last picture at rest.
    last: Option<Rest>,
    pictures: u64,
}

/// A picture, and what there is to tell of it.
struct Rendered {
    shot: Shot,
    frame: Frame,
    header: Value,
    /// Time to find the layers.
    search: Duration,
}

/// A picture at full quality.
struct Rest {
    camera: Camera,
    shot: Shot,
    frame: Frame,
    header: Value,
    png: Arc<[u8]>,
}

impl Studio {
    /// `at`: where clients begin.
    pub(super) fn new(job: Job, held_out: Vec<usize>, at: Camera) -> Self {
        let layers = job.layers().clone();
        let moving_layers = match layers {
            LayerSpec::Guided { coarse_planes, .. } => LayerSpec::Guided { layers: 1, coarse_planes },
            // Planes take seconds.
            _ => LayerSpec::Surface(1),
        };
        let (around, unprepared, pace) = (Vec::new(), Vec::new(), Pace::default());
        let mut studio =
            Self { job, held_out, layers, moving_layers, around, unprepared, at, pace, last: None, pictures: 0 };
        studio.job.synthesizer.set_layers(studio.moving_layers.clone());
        let views = &studio.job.scene().views;
        let free = (0..views.len()).filter(|view| !studio.held_out.contains(view));
        studio.around = free.filter_map(|view| studio.shot(&views[view].camera).ok()).collect();
        let pixels = views.iter().map(|view| view.camera.size().pixels()).max().unwrap_or(1);
        let mut nearest: Vec<usize> = (0..studio.around.len()).collect();
        nearest.sort_by(|&a, &b| studio.distance_to(a).total_cmp(&studio.distance_to(b)));
        nearest.truncate(PhotoCache::KEPT_BYTES / (BYTES_PER_PIXEL * pixels));
        studio.unprepared = nearest;
        studio
    }

    /// What a client is told first; `middle`: the view that it begins near.
    pub(super) fn hello(&self, middle: usize) -> Value {
        let mut told = hello(&self.job, &self.held_out, middle);
        told["near"] = self.around.iter().map(|shot| shot.near).reduce(f64::min).into();
        told["layers"] = self.layers.to_string().into();
        told["moving_layers"] = self.moving_layers.to_string().into();
        told
    }

    /// Photos that a first picture takes.
    pub(super) fn needed_first(&self) -> usize {
        self.around.first().map_or(0, |shot| shot.views.len() + shot.helpers.len())
    }

    /// How many pictures were rendered.
    pub(super) fn pictures(&self) -> u64 {
        self.pictures
    }

    fn distance_to(&self, around: usize) -> f64 {
        distance(&self.around[around].target, &self.at)
    }

    fn shot(&self, camera: &Camera) -> Result<Shot> {
        let target = TargetView { name: "pose".to_owned(), camera: camera.clone(), truth: None };
        let targets = Targets { list: vec![target], held_out: self.held_out.clone(), moving: false };
        Ok(self.job.synthesizer.shots(targets)?.remove(0))
    }

    /// How many photos are not prepared.
    pub(super) fn unprepared(&self) -> usize {
        self.unprepared.len()
    }

    /// Reads the nearest photo that is not prepared, and finds its depth.
    pub(super) fn prepare(&mut self) -> Result<()> {
        let nearest = (0..self.unprepared.len())
            .min_by(|&a, &b| self.distance_to(self.unprepared[a]).total_cmp(&self.distance_to(self.unprepared[b])));
        let Some(nearest) = nearest else { return Ok(()) };
        let mut shot = self.around[self.unprepared.swap_remove(nearest)].clone();
        // Its own photo alone, so that who begins to move does not wait for long.
        shot.views.truncate(1);
        shot.helpers.clear();
        self.job.synthesizer.set_layers(self.moving_layers.clone());
        self.load(&shot)?;
        if matches!(self.moving_layers, LayerSpec::Surface(_)) {
            self.job.plan(&shot)?;
        }
        Ok(())
    }

    /// Loads the photos of a shot; others stay as far as there is room, those near it first.
    fn load(&mut self, shot: &Shot) -> Result<()> {
        let mut later = self.around.clone();
        later.sort_by(|a, b| distance(&a.target, &shot.target).total_cmp(&distance(&b.target, &shot.target)));
        Ok(self.job.synthesizer.photos_mut().load_for(shot, &later)?)
    }

    fn render(&mut self, camera: &Camera, layers: LayerSpec) -> Result<Rendered> {
        self.job.synthesizer.set_layers(layers);
        let shot = self.shot(camera)?;
        let started = Instant::now();
        self.load(&shot)?;
        let photos = started.elapsed();
        let plan = self.job.plan(&shot)?;
        let frame = self.job.render(&shot, &plan)?;
        self.pictures += 1;
        let header = self.header(&shot, &plan, &frame, photos);
        Ok(Rendered { shot, frame, header, search: plan.search })
    }

    /// A header and a picture for a client.
    pub(super) fn frame(&mut self, wish: &Wish) -> Result<Vec<u8>> {
        self.at = wish.camera.clone();
        let started = Instant::now();
        let (mut header, picture) = if wish.moving { self.in_motion(wish)? } else { self.at_rest(wish)? };
        header["id"] = wish.id.into();
        header["moving"] = wish.moving.into();
        header["depth"] = wish.depth.into();
        header["milliseconds"] = milliseconds(started.elapsed()).into();
        let header = header.to_string();
        let length = u32::try_from(header.len())?.to_le_bytes();
        Ok([&length, header.as_bytes(), &picture].concat())
    }

    fn in_motion(&mut self, wish: &Wish) -> Result<(Value, Vec<u8>)> {
        let started = Instant::now();
        let full = wish.camera.size();
        let scale = self.pace.scale(full.pixels());
        let side = |side: usize| ((side as f64 * scale).round() as usize).max(1);
        let camera = wish.camera.with_size_scaled(side(full.width), side(full.height))?;
        let Rendered { shot, frame, header, search } = self.render(&camera, self.moving_layers.clone())?;
        let shown =
            if wish.depth { depth(&shot, &frame) } else { inpaint_unseen(&frame.picture, &frame.transmittance) };
        let picture = encode(Path::new("frame.jpg"), &shown)?;
        self.pace.note(camera.size().pixels(), started.elapsed(), search);
        Ok((header, picture))
    }

    fn at_rest(&mut self, wish: &Wish) -> Result<(Value, Vec<u8>)> {
        let rest = self.rest(&wish.camera)?;
        let png = if wish.depth {
            encode(Path::new("depth.png"), &depth(&rest.shot, &rest.frame))?
        } else {
            rest.png.to_vec()
        };
        Ok((rest.header.clone(), png))
    }

    /// The picture of a camera as PNG: the same bytes that `liveview render --pose` writes.
    pub(super) fn still(&mut self, camera: &Camera) -> Result<Arc<[u8]>> {
        Ok(Arc::clone(&self.rest(camera)?.png))
    }

    fn rest(&mut self, camera: &Camera) -> Result<&Rest> {
        let last = match self.last.take() {
            Some(last) if last.camera == *camera => last,
            _ => {
                let Rendered { shot, frame, mut header, .. } = self.render(camera, self.layers.clone())?;
                if let Some((view, score)) = self.score(camera, &frame)? {
                    header["truth"] = view.into();
                    header["psnr"] = score.psnr.into();
                    header["ssim"] = score.ssim.into();
                }
                let picture = inpaint_unseen(&frame.picture, &frame.transmittance);
                let png = encode(Path::new("picture.png"), &picture)?.into();
                Rest { camera: camera.clone(), shot, frame, header, png }
            }
        };
        Ok(self.last.insert(last))
    }

    /// The score of a picture that a held-out photo shows: as rendered, before pixels that no view covers are filled.
    fn score(&self, camera: &Camera, frame: &Frame) -> Result<Option<(usize, Score)>> {
        let scene = self.job.scene();
        let Some(&view) = self.held_out.iter().find(|&&view| scene.views[view].camera == *camera) else {
            return Ok(None);
        };
        Ok(Score::of(&frame.picture, &scene.load_image(view)?).map(|score| (view, score)))
    }

    fn header(&self, shot: &Shot, plan: &Plan, frame: &Frame, photos: Duration) -> Value {
        let pixels = frame.transmittance.len() as f64;
        let mean =
            |map: &liveview::ndarray::Array2<f32>| map.iter().map(|&value| f64::from(value)).sum::<f64>() / pixels;
        json!({
            "width": frame.picture.width(), "height": frame.picture.height(),
            "layers": self.job.layers().to_string(), "layer_count": plan.layers.len(),
            "views": shot.views, "helpers": shot.helpers,
            "uncovered": mean(&frame.transmittance), "hidden": frame.unseen as f64 / pixels,
            "disparity": mean(&frame.disparity), "near": shot.near, "far": finite(shot.far),
            "stages": {
                "photos": milliseconds(photos), "depth": milliseconds(plan.search), "select": milliseconds(plan.selection),
                "warp": milliseconds(frame.times.warp), "network": milliseconds(frame.times.network),
                "composite": milliseconds(frame.times.composite),
            },
        })
    }
}

/// Disparity in colour, as `liveview render --depth` writes it.
fn depth(shot: &Shot, frame: &Frame) -> ImageRgb {
    coloured(frame.disparity.view(), (1.0 / shot.far) as f32, (1.0 / shot.near) as f32)
}

fn milliseconds(time: Duration) -> f64 {
    (1e5 * time.as_secs_f64()).round() / 100.0
}

/// JSON has no infinity.
fn finite(depth: f64) -> Option<f64> {
    depth.is_finite().then_some(depth)
}
