//! Whether the photos agree with their poses.

use std::fmt::Write;

use anyhow::Result;
use liveview_common::agreement::{of_view, warning};
use liveview_common::args::scene::SceneArgs;
use liveview_common::console::{escaped, full_text};

/// Width of the copies of the photos that are compared, pixels.
const SMALL_WIDTH: usize = 200;

/// The share of the photos' depth that other photos confirm, and the share of the pixels on which they agree.
type Shares = [Option<f64>; 2];

/// Whether the photos agree around a target that is rendered from so many views, as text, and the shares.
pub(super) fn section(scene: &SceneArgs, target: usize, views: usize) -> (String, Shares) {
    known(scene, target, views).unwrap_or_else(|error| {
        (format!("warning    cannot check whether the photos agree: {}\n", escaped(&full_text(&error))), [None; 2])
    })
}

fn known(scene: &SceneArgs, target: usize, views: usize) -> Result<(String, Shares)> {
    let (surface, agreeing) = of_view(&scene.open_at(SMALL_WIDTH)?, target, views)?;
    let confirmed = surface.map(|surface| surface.confirmed_share());
    let percent = |share: Option<f64>| share.map_or_else(|| "-".to_owned(), |share| format!("{:.0} %", 100.0 * share));
    let mut text = format!(
        "agreement  the photos agree on {} of the pixels, and confirm {} of each other's depth\n",
        percent(agreeing),
        percent(confirmed)
    );
    if let Some(warning) = agreeing.and_then(warning) {
        let _ = writeln!(text, "warning    {warning}");
    }
    Ok((text, [confirmed, agreeing]))
}
