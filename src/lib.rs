//! New views of a scene from a few posed photos: dynamic target-centred multiplane images
//! ([LiveView, CVPR 2021]).
//!
//! The nearest photos are warped onto layers in front of the target camera, blended and composited. By
//! default the layers follow the scene's surface, and photos are weighted by how well they agree; on
//! planes and guided layers a small network predicts opacities and weights. ONNX Runtime runs the
//! network; all other stages are Rust.
//!
//! [LiveView, CVPR 2021]: https://openaccess.thecvf.com/content/CVPR2021/html/Ghosh_LiveView_Dynamic_Target-Centered_MPI_for_View_Synthesis_CVPR_2021_paper.html
//!
//! # Example
//!
//! ```no_run
//! # use liveview::{Options, Synthesizer, Target};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut synthesizer = Synthesizer::open("scene", &Options::default())?;
//! let frame = synthesizer.render(&Target::held_out("IMG_7.jpg"))?;
//! frame.inpainted().save("new.png")?;
//! # Ok(()) }
//! ```
//!
//! # Main types
//!
//! - [`Synthesizer`]: a scene, a choice of layers and, where needed, a model; renders a [`Target`] to a [`Frame`].
//! - [`Scene`]: posed photos, from a folder in one of five file formats, or from memory.
//! - [`LayerSpec`]: which layers to render on, as text such as `surface:3` or `planes:64`;
//!   [`Layers`]: the layers themselves.
//! - [`network::PlaneNetwork`]: the trait of a network; [`network::OrtNetwork`] runs the LiveView
//!   models, [`network::ViewAgreement`] takes their place where there is none.
//! - [`render::Renderer`]: views, target and layers → frame, for programs that choose these
//!   themselves.
//! - [`live::LiveSession`]: the time steps of a camera rig → frames; layers are reused from frame
//!   to frame.
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
//! Training, pose estimation, an interactive viewer (`liveview view`, a command of the program, is
//! one), downloading models or libraries at run time, and extrapolation far beyond the photos.
//! Gloss and reflections are those of the nearest photos. Pixels that no photo covers are black in
//! a [`Frame`]; [`Frame::inpainted`] fills them.
//!
//! # Features
//!
//! - `load-dynamic` (default): ONNX Runtime is loaded at run time ([`network::OrtLibrary`]); the
//!   library may have OpenVINO.
//! - `cuda`, `tensorrt`: these execution providers, for libraries that have them.
//! - `surface` (default): `surface:L` layers ([`surface`]), and [`live`], which needs them.
//! - `download-binaries`: ONNX Runtime is downloaded and linked at build time instead; needs
//!   `--no-default-features`.

pub mod fs;
#[cfg(fuzzing)]
pub mod fuzz;
pub mod geometry;
pub mod image;
#[cfg_attr(not(feature = "surface"), allow(unreachable_pub))]
mod kinds;
pub mod layers;
#[cfg(feature = "surface")]
pub mod live;
pub mod network;
pub mod render;
pub mod scene;
mod simd;
#[cfg(feature = "surface")]
pub mod surface;
mod synthesizer;
pub mod warp;

// Targets are cameras, and paths of them.
pub use geometry::{Camera, CameraPath, Intrinsics};
// Photos in, pictures out.
pub use image::ImageRgb;
// Options name layers as text; stages take the layers.
pub use layers::{LayerSpec, Layers};
// What rendering returns.
pub use render::Frame;
// What a synthesizer opens.
pub use scene::{Scene, SceneOptions};
// The high-level interface; its module is private.
pub use synthesizer::{
    DEFAULT_VIEWS, LoadedShot, Model, ModelOptions, Options, Plan, ScenePhotos, SceneViews, Shot, SynthesisError,
    Synthesizer, Target, TargetCamera, Targets,
};
#[cfg(feature = "surface")]
pub use synthesizer::{DepthProgress, DepthSearch, DepthSource, FoundDepth, PhotoCorrection, TargetSurface, ViewDepth};
// The interface uses types of these crates.
pub use {glam, ndarray};

/// The example of README.md compiles.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;
