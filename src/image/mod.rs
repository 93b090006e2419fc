//! Pictures: reading and writing, PSNR and SSIM, colour maps, and filling in what no view covers.

mod colormap;
mod decode;
mod encode;
mod error;
mod inpaint;
mod jpeg;
mod jpeg_huffman;
mod jpeg_scan;
mod metrics;
mod rgb;

pub use colormap::{bar_chart, coloured, difference, side_by_side};
pub use decode::{Header, load, read_header, read_size};
#[cfg(fuzzing)]
pub(crate) use decode::{decode, size_of};
pub use encode::{encode, encode_gray16_png, has_mark};
pub use error::ImageError;
pub use inpaint::inpaint_unseen;
pub use metrics::{Score, psnr, ssim};
pub use rgb::ImageRgb;
