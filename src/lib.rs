//! New views of a scene from a few posed photos, by an exported network and the small runtime around it:
//! dynamic target-centred multiplane images ([LiveView, CVPR 2021]).
//!
//! Photos are warped onto planes in front of the target camera, a network gives each plane its opacity and
//! each photo its weight, and the planes are blended and composited. ONNX Runtime runs the network; all
//! other stages are Rust.
//!
//! [LiveView, CVPR 2021]: https://openaccess.thecvf.com/content/CVPR2021/html/Ghosh_LiveView_Dynamic_Target-Centered_MPI_for_View_Synthesis_CVPR_2021_paper.html
//!
//! # Example
//!
//! V photos, nearest first ([`geometry::choose_views`]), and their cameras in, a picture out. `examples/onnx.rs` is
//! a whole program; the environment variable `ORT_DYLIB_PATH` names ONNX Runtime's library.
//!
//! ```no_run
//! use liveview::network::{ExecutionProvider, OrtLibrary, OrtNetwork};
//! use liveview::{Camera, Frame, ImageRgb, Layers, RenderRequest, Renderer, SourceView, Texture};
//!
//! fn new_view(photos: &[ImageRgb], cameras: &[Camera], target: &Camera) -> Result<Frame, Box<dyn std::error::Error>> {
//!     let library = OrtLibrary::load(ExecutionProvider::Cpu, None)?;
//!     let network = OrtNetwork::open(&library, "models/liveview_v4_planes.onnx".as_ref(), 2)?; // 2 threads
//!     let alpha = network.card().alpha(None);
//!     let mut renderer = Renderer::new(Box::new(network), alpha, 1); // one plane at a time
//!     let textures: Vec<Texture> = photos.iter().map(Texture::new).collect();
//!     let views: Vec<SourceView> =
//!         cameras.iter().zip(&textures).map(|(camera, texture)| SourceView { camera, texture }).collect();
//!     let planes = Layers::uniform(1.0, 100.0, 64)?; // from near to far, in scene units
//!     Ok(renderer.render(RenderRequest::new(&views, target, &planes))?)
//! }
//! ```
//!
//! # Modules
//!
//! - [`geometry`]: cameras, the plane sweep, the choice of views.
//! - [`warp`]: views sampled along a layer.
//! - [`network`]: the trait of a network; LiveView models run by ONNX Runtime.
//! - [`layers`]: planes, and their selection; other layers are maps of disparity.
//! - [`render`]: blend, the two composites, and [`Renderer`], which does all of it.
//! - [`image`]: pictures in memory, PNG and JPEG, inpainting of uncovered pixels.
//!
//! # Conventions
//!
//! - Camera axes are OpenCV's: x right, y down, z forward. Poses are `cam_from_world`: X_cam = R
//!   X_world + t, in scene units.
//! - Intrinsics are in pixels. The centre of the pixel in column i, row j is (i + 0.5, j + 0.5).
//! - Disparity is 1/z in 1/scene unit, 0 at infinity; layers are ordered near → far.
//! - Matrices are named result_from_input: `source_from_target`, `cam_from_world`.
//! - Colours are sRGB values in [0, 1], as stored in the photos. Array shapes are `[…, height,
//!   width]`.
//! - Cameras and depths are f64; values per pixel are f32.
//!
//! # Out of scope
//!
//! Files of scenes and the depth of photos (`liveview-scene`, `liveview-surface`, `liveview-synthesizer`),
//! training, pose estimation, downloads at run time, and extrapolation far beyond the photos.
//!
//! # Features
//!
//! - `load-dynamic` (default): ONNX Runtime is loaded at run time ([`network::OrtLibrary`]); the
//!   library may have OpenVINO.
//! - `cuda`, `tensorrt`: these execution providers, for libraries that have them.
//! - `download-binaries`: ONNX Runtime is downloaded and linked at build time instead; needs
//!   `--no-default-features`.

#[cfg(feature = "fuzzing")]
pub mod fuzz;
pub mod geometry;
pub mod image;
pub mod layers;
pub mod network;
pub mod render;
#[doc(hidden)] // for the packages on top of this one
pub mod simd;
pub mod warp;

// Cameras and photos in.
pub use geometry::{Camera, Intrinsics};
pub use image::ImageRgb;
pub use warp::{SourceView, Texture};
// What a picture is rendered on, and by.
pub use layers::Layers;
pub use render::{Frame, RenderRequest, Renderer};
// The interface uses types of these crates.
pub use {glam, ndarray};
