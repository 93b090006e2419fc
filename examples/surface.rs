//! Scores of pictures from the photos' own depth, on held-out photos (`make evaluate`'s protocol):
//! `cargo run --release --example surface -- DATA [scene ...] [key=value ...]`.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use liveview::geometry::distance;
use liveview::image::{ImageRgb, psnr, ssim};
use liveview::mvs::{self, DepthMaps, Settings, SurfaceView};
use liveview::network::{ExecutionProvider, NoNetwork, OrtLibrary, OrtNetwork};
use liveview::render::Renderer;
use liveview::scene::{Scene, SceneOptions};
use liveview::warp::{SourceView, Texture};

const V: usize = 4;

fn main() -> Result<(), Box<dyn Error>> {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let data = words.remove(0);
    let (mut settings, mut save) = (Settings::default(), None);
    let mut wanted: Vec<String> = Vec::new();
    let mut exposure = true;
    let mut only: Option<usize> = None;
    for word in &words {
        let Some((key, value)) = word.split_once('=') else {
            wanted.push(word.clone());
            continue;
        };
        match key {
            "save" => save = Some(value.to_owned()),
            "exposure" => exposure = value.parse()?,
            "only" => only = Some(value.parse()?),
            _ => set(&mut settings, key, value)?,
        }
    }
    let specs: serde_json::Value = serde_json::from_slice(&std::fs::read("python/configs/evaluation.json")?)?;
    let library = OrtLibrary::load(ExecutionProvider::Cpu, None)?;
    let mut renderer = Renderer::new(OrtNetwork::open(&library, "models/liveview_v4.onnx".as_ref(), 2)?, 1);
    let mut free_of = Renderer::new(NoNetwork { views: V }, 1);
    let mut means: Vec<[f64; 6]> = Vec::new();
    let mut times = [0.0; 3];
    let mut counts = [0.0; 2];
    for spec in specs.as_array().ok_or("a list")? {
        let name = spec["name"].as_str().unwrap_or_default();
        if !wanted.is_empty() && !wanted.iter().any(|w| name.contains(w.as_str())) {
            continue;
        }
        let path = spec["path"].as_str().unwrap_or_default();
        let root = if name == "workshop" { Path::new(path).to_owned() } else { Path::new(&data).join(path) };
        let scene = Scene::open(&root, &SceneOptions::default())?;
        let list = |value: &serde_json::Value| -> Option<Vec<usize>> {
            Some(value.as_array()?.iter().filter_map(|v| v.as_u64().map(|v| v as usize)).collect())
        };
        let every = match spec["heldout"].as_u64() {
            Some(step) => (0..scene.views.len()).step_by(step as usize).collect(),
            None => list(&spec["targets"]).ok_or("targets")?,
        };
        let free: Vec<usize> = list(&spec["pool"])
            .unwrap_or_else(|| (0..scene.views.len()).collect())
            .into_iter()
            .filter(|i| !every.contains(i))
            .collect();
        let photos: Vec<ImageRgb> = (0..scene.views.len()).map(|i| scene.load_image(i)).collect::<Result<_, _>>()?;
        let textures: Vec<Texture> = photos.iter().map(Texture::new).collect();
        let view = |i: usize| SourceView { camera: &scene.views[i].camera, texture: &textures[i] };
        let ranges: Vec<(f64, f64)> = free.iter().filter_map(|&i| scene.views[i].depth_range).collect();
        let near = spec["near"].as_f64().unwrap_or_else(|| ranges.iter().map(|r| r.0).fold(f64::INFINITY, f64::min));
        let far = spec["far"].as_f64().unwrap_or_else(|| ranges.iter().map(|r| r.1).fold(0.0, f64::max));
        let cameras = free.iter().map(|&i| scene.views[i].camera.clone()).collect();
        let mut maps = DepthMaps::new(cameras, near, far, settings.clone());
        let mut rows: Vec<[f64; 6]> = Vec::new();
        for (number, &t) in every.iter().enumerate() {
            if only.is_some_and(|only| only != number) {
                continue;
            }
            let target = &scene.views[t].camera;
            let set = maps.photos_for(target, V);
            let started = Instant::now();
            for &k in &set {
                counts[0] += maps.missing(&[k]).len() as f64;
                maps.depth(k, |k| view(free[k]));
            }
            times[0] += started.elapsed().as_secs_f64();
            let started = Instant::now();
            let known = maps.known(&set);
            times[1] += started.elapsed().as_secs_f64();
            let started = Instant::now();
            let views: Vec<_> =
                known.iter().map(|(k, all, known)| SurfaceView { view: view(free[*k]), all, known }).collect();
            let distances: Vec<f64> = views.iter().map(|v| distance(v.view.camera, target)).collect();
            let gains = if exposure { mvs::exposure_gains(&views, &distances) } else { vec![[1.0; 3]; views.len()] };
            let adjusted: Vec<Texture> = views.iter().zip(&gains).map(|(v, &g)| v.view.texture.with_gains(g)).collect();
            let views: Vec<_> = views
                .iter()
                .zip(&adjusted)
                .map(|(v, texture)| SurfaceView { view: SourceView { texture, ..v.view }, ..*v })
                .collect();
            let surface = mvs::surface(&views, V + settings.extra, target, near, far, &settings);
            times[2] += started.elapsed().as_secs_f64();
            counts[1] += 1.0;
            let visibility = surface.visibility(&views, V, &settings);
            let sources: Vec<_> = views[..V].iter().map(|v| v.view).collect();
            let frames = [
                free_of.render_visible(&sources, Some(&visibility), target, &surface.layers(1)?, |_| ())?,
                renderer.render_visible(&sources, Some(&visibility), target, &surface.layers(1)?, |_| ())?,
                renderer.render_visible(&sources, Some(&visibility), target, &surface.layers(2)?, |_| ())?,
            ];
            let mut scores = [0.0; 6];
            for (index, frame) in frames.iter().enumerate() {
                scores[2 * index] = psnr(&frame.picture, &photos[t], 16);
                scores[2 * index + 1] = ssim(&frame.picture, &photos[t], 16);
                if let Some(folder) = &save {
                    std::fs::create_dir_all(folder)?;
                    let file = format!("{}_{t}_{index}.png", name.replace(' ', "_"));
                    frame.picture.save(Path::new(folder).join(file))?;
                }
            }
            let [_, _, two] = &frames;
            let (warp, network, composite) = (two.times.warp, two.times.network, two.times.composite);
            println!(
                "{name}:{t} none {:.2} {:.4} | surface:1 {:.2} {:.4} | surface:2 {:.2} {:.4} | holes {:.1} %, unseen {} | \
                 {warp:.0?} {network:.0?} {composite:.0?}",
                scores[0],
                scores[1],
                scores[2],
                scores[3],
                scores[4],
                scores[5],
                100.0 * surface.holes,
                two.unseen
            );
            rows.push(scores);
        }
        let mean = mean(&rows);
        println!(
            "  {name} mean: none {:.2} | s1 {:.2} {:.4} | s2 {:.2} {:.4}",
            mean[0], mean[2], mean[3], mean[4], mean[5]
        );
        means.push(mean);
    }
    let m = mean(&means);
    println!("MEAN none {:.2} {:.4} | s1 {:.2} {:.4} | s2 {:.2} {:.4}", m[0], m[1], m[2], m[3], m[4], m[5]);
    println!(
        "ms: depth {:.0} a photo, confirming {:.0} and surface {:.0} a target",
        1e3 * times[0] / counts[0],
        1e3 * times[1] / counts[1],
        1e3 * times[2] / counts[1]
    );
    Ok(())
}

fn mean(rows: &[[f64; 6]]) -> [f64; 6] {
    std::array::from_fn(|k| rows.iter().map(|r| r[k]).sum::<f64>() / rows.len() as f64)
}

fn set(s: &mut Settings, key: &str, value: &str) -> Result<(), Box<dyn Error>> {
    match key {
        "further" => s.further = value.parse()?,
        "judges" => s.judges = value.parse()?,
        "extra" => s.extra = value.parse()?,
        "neighbours" => s.neighbours = value.parse()?,
        "spacing" => s.spacing = value.parse()?,
        "radius" => s.radius = value.parse()?,
        "fine_radius" => s.fine_radius = value.parse()?,
        "full" => s.full = value.parse()?,
        "parts" => s.parts = value.parse()?,
        "step" => s.step = value.parse()?,
        "jump" => s.jump = value.parse()?,
        "edge" => s.edge = value.parse()?,
        "agree" => s.agree = value.parse()?,
        "past" => s.past = value.parse()?,
        "hides" => s.hides = value.parse()?,
        "second" => s.second = value.parse()?,
        "searched" => s.searched = value.parse()?,
        "fuse" => s.fuse = value.parse()?,
        "votes" => s.votes = value.parse()?,
        "refine" => s.refine = value.parse()?,
        "refine_radius" => s.refine_radius = value.parse()?,
        "stay" => s.stay = value.parse()?,
        _ => return Err(format!("no setting {key}").into()),
    }
    Ok(())
}
