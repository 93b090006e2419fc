//! Pictures: reading and writing, comparing, colouring, and filling in what no view sees.

mod colormap;
mod inpaint;
mod io;
mod jpeg;
mod metrics;

pub use colormap::{bar_chart, coloured, difference, side_by_side};
pub use inpaint::inpaint_unseen;
pub use io::*;
pub use metrics::{psnr, ssim};
