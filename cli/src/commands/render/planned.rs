//! What a command reads and writes, before it runs.

use anyhow::{Result, bail};
use liveview::Shot;
use liveview::geometry::Size;
use liveview_common::outputs::OutputPlan;
use liveview_common::records::shard_record::pair_of_one_file;
use liveview_common::shard::Shard;

use super::args::RenderArgs;
use super::outputs::Outputs;

/// The outputs of a command that has not run.
pub(crate) struct Planned<'a> {
    args: &'a RenderArgs,
    outputs: Outputs,
    /// Names and sizes.
    pictures: Vec<(String, Size)>,
}

impl<'a> Planned<'a> {
    /// Opens the scene without its photos, and protects what the command reads.
    pub(crate) fn new(args: &'a RenderArgs, output_plan: &mut OutputPlan) -> Result<Self> {
        let outputs = Outputs::new(&args.output, args.targets.have_truth(), args.shard)?;
        let views = args.scene.open()?;
        let targets = args.targets.resolve_silently(&views)?.list;
        output_plan.add_scene(views.scene());
        let (option, file) = args.targets.camera_file();
        output_plan.protect(option, file);
        args.model.protect(output_plan, None);
        let pictures = targets.into_iter().map(|target| (target.name, target.camera.size())).collect();
        let pictures = match args.shard {
            Some(shard) => shard.of(pictures),
            None => pictures,
        };
        Ok(Self { args, outputs, pictures })
    }

    /// Adds the output files.
    pub(crate) fn add_outputs(&mut self, output_plan: &mut OutputPlan) -> Result<()> {
        let pictures: Vec<_> = self.pictures.iter().map(|(name, size)| (name.as_str(), *size)).collect();
        self.outputs.plan_outputs(&pictures, output_plan)?;
        self.args.scores.plan_outputs(output_plan)?;
        self.args.explain.plan_outputs(pictures.len(), output_plan)
    }
}

/// Checks that no two pictures of a shared job are one file: [`Outputs::plan_outputs`] only holds
/// those of this share against each other.
pub(super) fn check_names(shard: Shard, all: &[Shot]) -> Result<()> {
    let names: Vec<String> = all.iter().map(|shot| shot.name.clone()).collect();
    match pair_of_one_file(&names) {
        Some((name, other)) => bail!("--shard {shard}: {name} and {other} would be one file; expected different names"),
        None => Ok(()),
    }
}
