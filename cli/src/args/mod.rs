//! Options that several commands share.

mod layers;
mod model;
mod model_info;
pub(crate) mod numbers;
mod output;
mod scene;

pub(crate) use layers::{LayerArgs, LayerChoice};
pub(crate) use model::{ModelArgs, ProviderChoice, start_threads};
pub(crate) use model_info::ModelInfo;
pub(crate) use output::{OutputPath, Variant, expect_png, has_extension, refuse_stdout, stem, write_atomically};
pub(crate) use scene::{SceneArgs, TargetArgs, cameras_of, held_out, named, refuse_twice, source};

/// Help heading of the options that few people need; `-h` does not list them.
pub(crate) const ADVANCED: &str = "Advanced";
/// What `-h` ends with.
pub(crate) const MORE_HELP: &str = "--help also lists examples and the advanced options.";
