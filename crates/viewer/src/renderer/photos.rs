//! The photos of a scene: at rest as `liveview render` renders them.

use std::time::{Duration, Instant};

use anyhow::Result;
use liveview::geometry::distance;
use liveview::{Camera, ImageRgb, LayerSpec, PhotoCache, Scene, Shot, TargetView, Targets};
use liveview_common::job::Job;

use super::pace::Pace;
use super::source::{Rendered, Source};
use crate::wish::Moment;

/// Of a photo and its depth in memory, at most.
const BYTES_PER_PIXEL: usize = 20;

/// A synthesizer, and what it is going to need.
pub(crate) struct Photos {
    job: Job,
    held_out: Vec<usize>,
    layers: LayerSpec,
    moving_layers: LayerSpec,
    /// A target at each view, those nearest to the last target first.
    around: Vec<Shot>,
    /// Of these, those whose own photo and depth were not prepared.
    unprepared: Vec<Shot>,
    pace: Pace,
}

impl Photos {
    /// `at`: where clients begin.
    pub(crate) fn new(mut job: Job, held_out: Vec<usize>, at: &Camera) -> Self {
        let layers = job.layers().clone();
        let moving_layers = match layers {
            LayerSpec::Guided { coarse_planes, .. } => LayerSpec::Guided { layers: 1, coarse_planes },
            // Planes take seconds.
            _ => LayerSpec::Surface(1),
        };
        job.synthesizer.set_layers(moving_layers.clone());
        let (around, unprepared, pace) = (Vec::new(), Vec::new(), Pace::default());
        let mut photos = Self { job, held_out, layers, moving_layers, around, unprepared, pace };
        let views = &photos.job.scene().views;
        let free = (0..views.len()).filter(|view| !photos.held_out.contains(view));
        let mut around: Vec<Shot> = free.filter_map(|view| photos.shot(&views[view].camera).ok()).collect();
        around.sort_by(|a, b| distance(&a.target, at).total_cmp(&distance(&b.target, at)));
        let pixels = views.iter().map(|view| view.camera.size().pixels()).max().unwrap_or(1);
        let room = PhotoCache::KEPT_BYTES / (BYTES_PER_PIXEL * pixels);
        photos.unprepared = around.iter().take(room).cloned().collect();
        photos.around = around;
        photos
    }

    /// The nearest depth around any photo, scene units.
    pub(crate) fn near(&self) -> Option<f64> {
        self.around.iter().map(|shot| shot.near).reduce(f64::min)
    }

    fn shot(&self, camera: &Camera) -> Result<Shot> {
        let target = TargetView { name: "pose".to_owned(), camera: camera.clone(), truth: None };
        let targets = Targets { list: vec![target], held_out: self.held_out.clone(), moving: false };
        Ok(self.job.synthesizer.shots(targets)?.remove(0))
    }

    /// Loads the photos of a shot; others stay as far as there is room, those near it first.
    fn load(&mut self, shot: &Shot) -> Result<()> {
        // All but in order already where the viewpoint has moved little.
        self.around.sort_by(|a, b| distance(&a.target, &shot.target).total_cmp(&distance(&b.target, &shot.target)));
        Ok(self.job.synthesizer.photos_mut().load_for(shot, &self.around)?)
    }

    fn render(&mut self, camera: &Camera, layers: LayerSpec) -> Result<Rendered> {
        self.job.synthesizer.set_layers(layers.clone());
        let shot = self.shot(camera)?;
        let started = Instant::now();
        self.load(&shot)?;
        let photos = started.elapsed();
        let plan = self.job.plan(&shot)?;
        let frame = self.job.render(&shot, &plan)?;
        Ok(Rendered {
            frame,
            range: (shot.near, shot.far),
            layers,
            views: shot.views,
            helpers: shot.helpers,
            before: [photos, plan.search, plan.selection],
            left_out: Vec::new(),
        })
    }
}

impl Source for Photos {
    fn scene(&self) -> &Scene {
        self.job.scene()
    }

    fn scale(&self, pixels: usize) -> f64 {
        self.pace.scale(pixels)
    }

    fn in_motion(&mut self, at: &Moment) -> Result<Rendered> {
        self.render(&at.camera, self.moving_layers.clone())
    }

    fn note(&mut self, rendered: &Rendered, took: Duration) {
        let [_, search, _] = rendered.before;
        self.pace.note(rendered.frame.transmittance.len(), took, search);
    }

    fn at_rest(&mut self, at: &Moment) -> Result<Rendered> {
        self.render(&at.camera, self.layers.clone())
    }

    fn photo(&mut self, view: usize, _: usize) -> Result<ImageRgb> {
        Ok(self.job.scene().load_image(view)?)
    }

    fn unprepared(&self) -> usize {
        self.unprepared.len()
    }

    fn needed_first(&self) -> usize {
        self.around.first().map_or(0, |shot| shot.views.len() + shot.helpers.len())
    }

    /// Reads the nearest photo that is not prepared, and finds its depth.
    fn prepare(&mut self, at: &Camera) -> Result<()> {
        let far = |&i: &usize| distance(&self.unprepared[i].target, at);
        let nearest = (0..self.unprepared.len()).min_by(|a, b| far(a).total_cmp(&far(b)));
        let Some(nearest) = nearest else { return Ok(()) };
        let mut shot = self.unprepared.swap_remove(nearest);
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
}
