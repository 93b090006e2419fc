//! A handful of posed photos becomes a new view: dynamic target-centred multiplane images (LiveView, CVPR 2021), the
//! network run by ONNX Runtime, everything else native.
//!
//! ```text
//! Scene ─► choose V views ─► Layers ─► [ warp ─► network ─► blend ─► composite ] per batch ─► Frame
//!                              ▲                                         │
//!                              └─────── select: what does it need? ◄─────┘
//! ```
//!
//! Start at [`scene::Scene`], [`views::choose_views`], [`layers::Layers`] and [`render::Renderer`]; the README below has a
//! whole program. For video: [`live::LiveSession`].
//!
//! **Conventions, everywhere.** OpenCV camera axes (x right, y down, z forward); `cam_from_world`: X_c = R X_w + t; K in
//! pixels; the centre of the pixel in column i, row j is (i + 0.5, j + 0.5). Disparity δ = 1/z in 1/scene unit. Matrices
//! are named result_from_input. Layers run from near to far. Colours are sRGB values in \[0, 1\]. Camera maths is f64.
//!
//! **Out of scope.** Training and pose estimation (the Python side and COLMAP do those), viewers, input views stored on a GPU.
//!
#![doc = include_str!("../README.md")]

pub mod blend;
pub mod camera;
pub mod composite;
pub mod cost;
pub mod engine;
mod exp;
pub mod file;
pub mod fill;
#[cfg(fuzzing)]
pub mod fuzz;
pub mod guide;
mod held;
pub mod image_io;
mod jpeg;
pub mod layers;
pub mod live;
pub mod metrics;
pub mod models;
pub mod network;
pub mod picture;
pub mod render;
pub mod runtime;
mod samples;
pub mod scene;
pub mod select;
pub mod semiglobal;
pub mod stops;
pub mod sweep;
mod taps;
pub mod views;
pub mod warp;
pub mod whole_file;
