//! `liveview inspect`: how a scene is read, which planes a view needs, or what a model is.

mod args;
mod models;
mod planes;
mod scene;
mod spread;

use anyhow::{Result, bail};
pub(crate) use args::InspectArgs;

use crate::args::output::has_extension;
use crate::console::Output;

pub(crate) fn run(args: &InspectArgs) -> Result<Output> {
    let path = args.scene.folder();
    if has_extension(path, &["onnx"]) {
        return models::one(path, &args.model);
    }
    if args.planes {
        return planes::run(args);
    }
    if let Some(option) = args.model.option_of_run() {
        bail!("{option}: expected --planes with it");
    }
    match args.scene.open() {
        Err(_) if !models::files(path).is_empty() => models::all(path, &args.model),
        photos => scene::report(args, &photos?),
    }
}
