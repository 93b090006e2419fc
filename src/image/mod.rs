//! Pictures: decoding and encoding, PSNR and SSIM, colour maps, and inpainting of uncovered pixels.

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
pub(crate) use decode::{decode, header_of};
pub use encode::{JPEG_QUALITY, encode, encode_gray16_png, encode_with_quality, is_tagged};
pub use error::ImageError;
pub use inpaint::inpaint_uncovered;
pub use metrics::{Score, psnr, ssim};
pub use rgb::ImageRgb;
