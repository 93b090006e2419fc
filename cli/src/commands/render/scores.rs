//! The table of scores, as CSV.

use std::fmt::Write;
use std::path::PathBuf;

use crate::args::output::{has_extension, write_atomically};
use crate::outputs::OutputPlan;
use anyhow::{Result, bail};
use clap::Args;

use super::rendered::Rendered;

/// Option for the table of scores.
#[derive(Debug, Args)]
pub(super) struct ScoreArgs {
    /// Also write a table of the scores, a line per picture
    ///
    /// Columns: name, psnr (dB), ssim, uncovered_share and occluded_share (0 to 1), seconds. Empty
    /// where it is unknown: the score of a picture that is too small, the time of one that --resume
    /// kept.
    #[arg(long, value_name = "CSV")]
    scores: Option<PathBuf>,
}

impl ScoreArgs {
    /// Checks the option, before anything is opened.
    pub(super) fn check(&self, have_truth: bool) -> Result<()> {
        let Some(file) = &self.scores else { return Ok(()) };
        let at = file.display();
        if !has_extension(file, &["csv"]) {
            bail!("--scores {at}: expected a name that ends in .csv");
        }
        if !have_truth {
            bail!("--scores {at}: there is no photo to compare with; expected --target or --heldout");
        }
        Ok(())
    }

    pub(super) fn plan_outputs(&self, output_plan: &mut OutputPlan) -> Result<()> {
        self.scores.as_ref().map_or(Ok(()), |file| output_plan.file("--scores", file))
    }

    /// Writes the table; returns its line for the summary.
    pub(super) fn write(&self, done: &[Rendered]) -> Result<String> {
        let Some(file) = &self.scores else { return Ok(String::new()) };
        write_atomically(file, table(done).as_bytes())?;
        Ok(format!("wrote   {}\n", file.display()))
    }
}

fn table(done: &[Rendered]) -> String {
    let mut text = "name,psnr,ssim,uncovered_share,occluded_share,seconds\n".to_owned();
    for one in done {
        let number = |number: Option<f64>| number.map(|number| number.to_string()).unwrap_or_default();
        let (psnr, ssim) = (one.score.as_ref().map(|score| score.psnr), one.score.as_ref().map(|score| score.ssim));
        let seconds = one.times.as_ref().map(|times| times.total().as_secs_f64());
        let (name, uncovered, occluded) = (field(&one.shot.name), one.uncovered_share, one.occluded_share);
        let (psnr, ssim, seconds) = (number(psnr), number(ssim), number(seconds));
        let _ = writeln!(text, "{name},{psnr},{ssim},{uncovered},{occluded},{seconds}");
    }
    text
}

/// A name as a field: quoted where it holds a comma, a quote or the end of a line (RFC 4180).
fn field(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) { format!("\"{}\"", name.replace('"', "\"\"")) } else { name.to_owned() }
}
