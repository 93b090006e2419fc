//! What every command that renders starts from: an open scene, the views and the depth range of each target, its layers.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};
use clap::Args;
use indicatif::ProgressBar;
use liveview::geometry::Camera;
use liveview::layers::guided::{GuidedSearch, RangeMap, SearchStages};
use liveview::layers::{Layers, padded, uniform_disparities};
use liveview::render::{Frame, warp_sources};
use liveview::scene::{Scene, SceneOptions};
use liveview::layers::{kmeans_planes, plane_histogram, select_planes};
use liveview::render::Culling;
use liveview::geometry::{SourceView, choose_views};
use liveview::warp::Texture;

use super::engine::{LoadedModel, ModelArgs};
use super::layers::{LayerArgs, Recipe};
use super::targets::Targets;

/// Options that say what the scene is.
#[derive(Debug, Args)]
pub(super) struct SceneArgs {
    /// Folder of posed photos: transforms.json, COLMAP, LLFF, RealEstate10K or Spaces
    scene: PathBuf,
    /// Scale photos wider than this down on load, their intrinsics with them
    #[arg(long, value_name = "PIXELS", value_parser = super::count)]
    width: Option<usize>,
    /// Folder of the photos in an LLFF, RealEstate10K or COLMAP scene [default: the usual ones]
    #[arg(long, value_name = "NAME")]
    images: Option<String>,
    /// Rig position of a Spaces scene
    #[arg(long, value_name = "INDEX", default_value_t = 0)]
    rig_position: usize,
    /// Nearest depth, in scene units [default: the smallest of the views chosen]
    #[arg(long, value_name = "DEPTH", allow_negative_numbers = true)]
    near: Option<f64>,
    /// Farthest depth, in scene units; inf for infinity [default: the largest of the views chosen]
    #[arg(long, value_name = "DEPTH", allow_negative_numbers = true)]
    far: Option<f64>,
}

/// A scene and those of its photos that are in use.
pub(super) struct Photos {
    pub(super) scene: Scene,
    /// As given, or else unknown.
    pub(super) given: (Option<f64>, Option<f64>),
    textures: Vec<Option<Texture>>,
}

impl SceneArgs {
    /// The folder of the scene.
    pub(super) fn folder(&self) -> &Path {
        &self.scene
    }

    /// The same options on a command line.
    pub(super) fn to_args(&self) -> Vec<String> {
        let mut args = vec![super::shown(&self.scene), format!("--rig-position={}", self.rig_position)];
        args.extend(self.width.map(|width| format!("--width={width}")));
        args.extend(self.images.as_ref().map(|images| format!("--images={images}")));
        args.extend(self.near.map(|near| format!("--near={near}")));
        args.extend(self.far.map(|far| format!("--far={far}")));
        args
    }

    /// Opens the scene.
    pub(super) fn open(&self) -> Result<Photos> {
        self.open_scaled(&self.scene, self.width)
    }

    /// Opens the scene at this width, unless the options name another.
    pub(super) fn open_at(&self, width: usize) -> Result<Photos> {
        self.open_scaled(&self.scene, self.width.or(Some(width)))
    }

    /// Opens the scene where it was laid out in another folder.
    pub(super) fn open_in(&self, folder: &Path) -> Result<Photos> {
        self.open_scaled(folder, self.width)
    }

    fn open_scaled(&self, folder: &Path, width: Option<usize>) -> Result<Photos> {
        let options = SceneOptions { width, images: self.images.clone(), rig_position: self.rig_position };
        let scene = Scene::open(folder, &options)?;
        let textures = scene.views.iter().map(|_| None).collect();
        Ok(Photos { scene, given: (self.near, self.far), textures })
    }
}

impl Photos {
    /// What was skipped or assumed, on stderr.
    pub(super) fn tell_notes(&self) {
        self.scene.notes.iter().for_each(|note| super::tell("note", note));
    }

    /// The `count` views for a target, nearest first; never one that is held out.
    pub(super) fn choose(&self, name: &str, target: &Camera, held_out: &[usize], count: usize) -> Result<Vec<usize>> {
        let free: Vec<usize> = (0..self.scene.views.len()).filter(|view| !held_out.contains(view)).collect();
        let cameras: Vec<&Camera> = free.iter().map(|&view| &self.scene.views[view].camera).collect();
        let chosen = choose_views(&cameras, target, count).map_err(|error| anyhow!("{name}: {error}"))?;
        Ok(chosen.into_iter().map(|i| free[i]).collect())
    }

    /// Near and far: as given, else the extremes of these views.
    pub(super) fn depth_range(&self, views: &[usize]) -> Result<(f64, f64)> {
        let known = || views.iter().filter_map(|&view| self.scene.views[view].depth_range);
        let near = self.given.0.or_else(|| known().map(|range| range.0).reduce(f64::min));
        let far = self.given.1.or_else(|| known().map(|range| range.1).reduce(f64::max));
        let missing = match (near, far) {
            (Some(near), Some(far)) => {
                uniform_disparities(near, far, 2)?;
                return Ok((near, far));
            }
            (None, None) => "--near and --far",
            (None, _) => "--near",
            (_, None) => "--far",
        };
        Err(anyhow!(
            "{}: the scene does not tell how near and far things are; expected {missing}, in scene units (`liveview inspect` \
             shows the size of the rig)",
            self.scene.root.display()
        ))
    }

    /// Loads the photos of these views, and forgets those that no `later` shot needs.
    pub(super) fn load(&mut self, views: &[usize], later: &[Shot]) -> Result<()> {
        for (view, texture) in self.textures.iter_mut().enumerate() {
            if views.contains(&view) {
                if texture.is_none() {
                    *texture = Some(Texture::new(&self.scene.load_image(view)?));
                }
            } else if !later.iter().any(|shot| shot.views.contains(&view)) {
                *texture = None;
            }
        }
        Ok(())
    }

    /// The views as the renderer takes them; loaded before.
    pub(super) fn sources(&self, views: &[usize]) -> Vec<SourceView<'_>> {
        let texture = |view: usize| self.textures[view].as_ref().expect("loaded before");
        views
            .iter()
            .map(|&view| SourceView { camera: &self.scene.views[view].camera, texture: texture(view) })
            .collect()
    }

    /// The coarse pass: each pixel's range of disparities, for guided layers.
    pub(super) fn search(&self, shot: &Shot, planes: Option<usize>) -> Result<SearchStages> {
        let sources = self.sources(&shot.views);
        let size = (padded(shot.target.height()), padded(shot.target.width()));
        let pass = GuidedSearch { near: shot.near, far: shot.far, planes };
        Ok(pass.search(&warp_sources(&sources, &shot.target), size)?)
    }

    /// The one target, with its views and depth range, where no model is needed.
    pub(super) fn shot(&self, mut targets: Targets, count: usize) -> Result<Shot> {
        let target = targets.list.remove(0);
        let views = self.choose(&target.name, &target.camera, &targets.held_out, count)?;
        let (near, far) = self.depth_range(&views)?;
        Ok(Shot { name: target.name, target: target.camera, truth: target.truth, views, near, far })
    }

    pub(super) fn cameras(&self, views: &[usize]) -> impl Iterator<Item = &Camera> {
        views.iter().map(|&view| &self.scene.views[view].camera)
    }

    pub(super) fn names(&self, views: &[usize]) -> Vec<&str> {
        views.iter().map(|&view| self.scene.views[view].name.as_str()).collect()
    }
}

/// One picture to render.
#[derive(Clone)]
pub(super) struct Shot {
    pub(super) name: String,
    pub(super) target: Camera,
    /// The view that shows the truth.
    pub(super) truth: Option<usize>,
    /// Views to render from, nearest first.
    pub(super) views: Vec<usize>,
    pub(super) near: f64,
    pub(super) far: f64,
}

/// The layers of a shot, and what finding them took.
pub(super) struct Planned {
    pub(super) layers: Layers,
    /// The coarse pass of guided layers or k-means planes.
    pub(super) coarse: Duration,
    /// The render that planes were selected from.
    pub(super) select: Duration,
    /// What guided layers divide.
    pub(super) range: Option<RangeMap>,
}

/// A scene, a model, and which layers to use.
pub(super) struct Job {
    pub(super) photos: Photos,
    pub(super) engine: LoadedModel,
    pub(super) recipe: Recipe,
    /// Counts layers.
    pub(super) progress: ProgressBar,
}

impl Planned {
    /// Layers that are known already.
    pub(super) fn known(layers: Layers) -> Self {
        Self { layers, coarse: Duration::ZERO, select: Duration::ZERO, range: None }
    }
}

impl Job {
    pub(super) fn open(photos: Photos, layers: &LayerArgs, engine: &ModelArgs) -> Result<Self> {
        let mut engine = engine.open()?;
        let recipe = layers.recipe(engine.network())?;
        engine.renderer.set_culling(Culling { transmittance: layers.opaque, ..Culling::default() });
        Ok(Self { photos, engine, recipe, progress: ProgressBar::hidden() })
    }

    /// The views and the depth range of each target. The frames of a path share one range, lest their planes jump.
    pub(super) fn shots(&self, targets: Targets) -> Result<Vec<Shot>> {
        let count = self.engine.network().card().views;
        let choose = |name: &str, target: &Camera| self.photos.choose(name, target, &targets.held_out, count);
        let views = targets.list.iter().map(|t| choose(&t.name, &t.camera)).collect::<Result<Vec<_>>>()?;
        let shared = if targets.moving { Some(self.range(&views.concat())?) } else { None };
        let shots = targets.list.into_iter().zip(views).map(|(target, views)| {
            let (near, far) = shared.map_or_else(|| self.range(&views), Ok)?;
            Ok(Shot { name: target.name, target: target.camera, truth: target.truth, views, near, far })
        });
        shots.collect()
    }

    /// Near and far of the layers.
    fn range(&self, views: &[usize]) -> Result<(f64, f64)> {
        match &self.recipe {
            Recipe::Disparities(list) => Ok((1.0 / list[0], 1.0 / list[list.len() - 1])),
            _ => self.photos.depth_range(views),
        }
    }

    /// The layers of a shot whose photos are loaded.
    pub(super) fn layers(&mut self, shot: &Shot) -> Result<Planned> {
        let started = Instant::now();
        let planned = Planned::known;
        match self.recipe {
            Recipe::Guided { layers, coarse_planes } => {
                let found = self.photos.search(shot, coarse_planes)?;
                let layers = found.range.layers(layers)?;
                Ok(Planned { coarse: started.elapsed(), range: Some(found.range), ..planned(layers) })
            }
            Recipe::KMeans { planes, coarse_planes } => {
                let found = self.photos.search(shot, coarse_planes)?;
                let chosen = kmeans_planes(found.fine.as_slice().expect("standard order"), planes);
                Ok(Planned { coarse: started.elapsed(), ..planned(Layers::planes(&chosen)?) })
            }
            Recipe::Planes(count) => Ok(planned(Layers::uniform(shot.near, shot.far, count)?)),
            Recipe::Disparities(ref list) => Ok(planned(Layers::planes(list)?)),
            Recipe::Select { keep, from } => {
                let disparities = uniform_disparities(shot.near, shot.far, from)?;
                let histogram = self.histogram(shot, &disparities)?;
                let chosen: Vec<f64> = select_planes(&histogram, keep).into_iter().map(|k| disparities[k]).collect();
                Ok(Planned { select: started.elapsed(), ..planned(Layers::planes(&chosen)?) })
            }
        }
    }

    /// How many pixels choose each of these planes.
    pub(super) fn histogram(&mut self, shot: &Shot, disparities: &[f64]) -> Result<Vec<u64>> {
        let frame = self.render(shot, &Layers::planes(disparities)?)?;
        let best = frame.best_layer.iter().map(|best| best.map(|plane| plane as usize));
        Ok(plane_histogram(best, disparities.len()))
    }

    /// Renders a shot whose photos are loaded.
    pub(super) fn render(&mut self, shot: &Shot, layers: &Layers) -> Result<Frame> {
        let sources = self.photos.sources(&shot.views);
        self.progress.inc_length(layers.len() as u64);
        let count =
            |batch: &liveview::render::Batch<'_>| self.progress.inc(batch.disparity.len_of(ndarray::Axis(0)) as u64);
        Ok(self.engine.renderer.render_observed(&sources, &shot.target, layers, count)?)
    }
}
