//! The Python package `liveview`: the library on numpy arrays.
//!
//! Thin: arguments become the library's types, results become arrays. What it adds is Python's: the
//! interpreter runs on while a picture is made, Ctrl-C ends it, and ONNX Runtime is that of the
//! installed package `onnxruntime`. `python/liveview/_liveview.pyi` documents every name.

#![allow(clippy::too_many_arguments, reason = "Python names arguments")]

mod arguments;
mod bake;
mod camera;
mod engine;
mod frame;
mod scene;
mod stages;
mod synthesizer;

#[pyo3::pymodule]
mod _liveview {
    use pyo3::pymodule;

    #[pymodule_export]
    use crate::{
        arguments::Error,
        bake::bake,
        camera::Camera,
        frame::{Frame, Frames},
        scene::{Scene, undistort},
        stages::layers::{
            cover_planes, guided_layers, guided_search, plane_histogram, select_planes, uniform_disparities,
        },
        stages::render::{Network, blend, composite, composite_competing},
        stages::surface::{anchored_depth, confirmed, exposure_gains, fill_holes, median3, photo_depth, sharpening},
        stages::surface::{surface, surface_layers, visible, visible_or_past},
        stages::warp::{agreement_logits, choose_views, psnr, sharpened, ssim, view_distances, warp_maps},
        synthesizer::{LiveSession, Synthesizer},
    };

    /// Stages inside the others, for the parity tests. Arrays are contiguous and fit together: they
    /// are not checked.
    #[pymodule]
    mod _stages {
        #[pymodule_export]
        use crate::stages::{
            inner::{aggregate, anchored_costs, anchors, bands, costs, depth_range, disparity, group_confirmed, hide},
            inner::{nearer_edges, neighbours, photo_variance, pixel_of, small_map, splat, target_search, tile_ranges},
            picture::{guided_search, logits, render, render_scene},
            warp::source_from_target,
        };
    }
}
