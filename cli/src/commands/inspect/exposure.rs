//! The exposure gains that balance the photos.

use std::fmt::Write;

use anyhow::Result;
use liveview::SceneViews;
use liveview::scene::View;
use liveview_common::agreement;
use liveview_common::console::escaped;

/// Exposure gains per channel of the `views` photos nearest to a target, nearest first, and a table
/// of them. Searches the depth of the photos.
pub(super) fn gains(scene_views: &SceneViews, target: usize, views: usize) -> Result<(String, Vec<[f32; 3]>)> {
    let View { name, camera, .. } = &scene_views.scene().views[target];
    let chosen = scene_views.choose(name, camera, &[target], views)?;
    let surface = agreement::surface_of_view(scene_views, target, views)?;
    let gains = surface.map_or_else(Vec::new, |surface| surface.corrections().iter().map(|view| view.gains).collect());
    let names: Vec<String> = scene_views.names(&chosen).iter().map(|name| escaped(name)).collect();
    let width = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(8);
    let mut text = format!("\nexposure   {:width$}   gain: red   green    blue\n", "view");
    for (name, [red, green, blue]) in names.iter().zip(&gains) {
        let _ = writeln!(text, "           {name:width$}  {red:9.3} {green:7.3} {blue:7.3}");
    }
    Ok((text, gains))
}
