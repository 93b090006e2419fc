//! The exposure gains by which surface layers balance the photos.

use std::fmt::Write;

use anyhow::Result;
use liveview::network::ViewAgreement;
use liveview::render::Renderer;
use liveview::{LayerSpec, SceneViews, Synthesizer, Targets};
use liveview_common::console::escaped;

/// Exposure gains per channel of the `views` photos nearest to a target, nearest first, and a table
/// of them. Searches the depth of the photos.
pub(super) fn gains(scene_views: &SceneViews, target: usize, views: usize) -> Result<(String, Vec<[f32; 3]>)> {
    let targets = Targets::held_out(scene_views.scene(), vec![target]);
    let renderer = Renderer::new(Box::new(ViewAgreement { views }), 1);
    let mut synthesizer = Synthesizer::new(scene_views.clone(), renderer, LayerSpec::Surface(1));
    let shot = synthesizer.shots(targets)?.remove(0);
    let loaded = synthesizer.load(&shot, &[])?;
    let surface = synthesizer.plan(&loaded)?.surface;
    let gains = surface.map_or_else(Vec::new, |surface| surface.gains().to_vec());
    let names: Vec<String> = scene_views.names(&shot.views).iter().map(|name| escaped(name)).collect();
    let width = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(8);
    let mut text = format!("\nexposure   {:width$}   gain: red   green    blue, for surface layers\n", "view");
    for (name, [red, green, blue]) in names.iter().zip(&gains) {
        let _ = writeln!(text, "           {name:width$}  {red:9.3} {green:7.3} {blue:7.3}");
    }
    Ok((text, gains))
}
