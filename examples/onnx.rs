//! An ONNX model in your Rust program: photos and cameras as arrays in, a picture out.
//!
//! At the root of the repository, after `make runtime`:
//!
//! ```sh
//! export ORT_DYLIB_PATH=$(ls .venv/lib/python*/site-packages/onnxruntime/capi/libonnxruntime.*)
//! cargo run --release --example onnx
//! ```
//!
//! Writes out/onnx.png (or onnx.png in the folder that is given): a view that was held out of the photos.

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use liveview::geometry::Size;
use liveview::image::{ImageError, load};
use liveview::ndarray::Array4;
use liveview::network::{ExecutionProvider, NetworkError, OrtLibrary, OrtNetwork, PlaneNetwork};
use liveview::{Camera, ImageRgb, Layers, RenderRequest, Renderer, SourceView, Texture};

type Pose = [[f64; 4]; 4];

/// Size of the photos and of the picture, in pixels.
const SIZE: Size = Size::new(504, 352);
/// The matrix K of the camera that took them, in pixels.
const K: [[f64; 3]; 3] = [[484.087495997, 0.0, 252.0], [0.0, 484.087495997, 176.0], [0.0, 0.0, 1.0]];
/// Depth of the nearest and of the farthest thing, in the unit of the poses.
const NEAR: f64 = 1.2188;
const FAR: f64 = 7.721;
/// `cam_from_world` of the picture, axes as in OpenCV: x right, y down, z forward.
const TARGET: Pose = [
    [0.999877852, 0.010918523, 0.011183368, -0.049453747],
    [-0.008692801, 0.983138857, -0.182653832, -0.025238500],
    [-0.012989114, 0.182534307, 0.983113681, -0.002673452],
    [0.0, 0.0, 0.0, 1.0],
];
/// The photos and their `cam_from_world`, nearest to the target first; as many as the model takes.
const VIEWS: [(&str, Pose); 4] = [
    (
        "source_1.jpg",
        [
            [0.999971775, -0.000924787, -0.007456170, -0.097227607],
            [-0.000181549, 0.989132016, -0.147030006, -0.011090434],
            [0.007511108, 0.147027210, 0.989103929, -0.011867972],
            [0.0, 0.0, 0.0, 1.0],
        ],
    ),
    (
        "source_0.jpg",
        [
            [0.999572642, 0.003674366, -0.029000552, 0.010312864],
            [-0.008813002, 0.983788651, -0.179115104, 0.008285020],
            [0.027872279, 0.179294140, 0.983400604, -0.010441246],
            [0.0, 0.0, 0.0, 1.0],
        ],
    ),
    (
        "source_2.jpg",
        [
            [0.999877717, -0.008120279, -0.013364582, -0.028316852],
            [0.005208319, 0.978744136, -0.205019000, -0.093324809],
            [0.014745318, 0.204924323, 0.978666745, -0.029658015],
            [0.0, 0.0, 0.0, 1.0],
        ],
    ),
    (
        "source_6.jpg",
        [
            [0.999664776, -0.008699432, 0.024385544, -0.062860891],
            [0.012355126, 0.987989350, -0.154027255, 0.068291352],
            [-0.022752708, 0.154276908, 0.987765635, 0.003204236],
            [0.0, 0.0, 0.0, 1.0],
        ],
    ),
];

fn main() -> ExitCode {
    match new_view() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn new_view() -> Result<(), Box<dyn Error>> {
    let library = OrtLibrary::load(ExecutionProvider::Cpu, None)?;
    let mut network = OrtNetwork::open(&library, "models/liveview_v4_planes.onnx".as_ref(), 2)?;
    infer_alone(&mut network)?;
    let alpha = network.card().alpha(None);
    let mut renderer = Renderer::new(Box::new(network), alpha, 1);

    let (mut photos, mut cameras) = (Vec::new(), Vec::new());
    for (name, pose) in VIEWS {
        photos.push(Texture::new(&photo(name)?));
        cameras.push(Camera::from_opencv(K, pose, SIZE)?);
    }
    let views: Vec<_> = cameras.iter().zip(&photos).map(|(camera, texture)| SourceView { camera, texture }).collect();
    let target = Camera::from_opencv(K, TARGET, SIZE)?;
    let planes = Layers::uniform(NEAR, FAR, 64)?;
    let started = Instant::now();
    let picture = renderer.render(RenderRequest::new(&views, &target, &planes))?.picture();
    write(&picture, started.elapsed())
}

/// The network alone: warped photos `[n, 3V, h, w]` in [0, 1] and their coverage `[n, V, h, w]` in, logits `[n, V, h, w]` out.
fn infer_alone(network: &mut OrtNetwork) -> Result<(), NetworkError> {
    let (n, v, h, w) = (2, network.views(), 64, 96);
    let (warped, coverage) = (Array4::from_elem((n, 3 * v, h, w), 0.5), Array4::from_elem((n, v, h, w), 1.0));
    let mut logits = Array4::zeros((n, v, h, w));
    network.infer(warped.view(), coverage.view(), logits.view_mut())
}

fn photo(name: &str) -> Result<ImageRgb, ImageError> {
    load(&Path::new("tests/scenes/workshop/images").join(name))
}

/// Writes the picture and prints how similar it is to the photo that was held out.
fn write(picture: &ImageRgb, took: Duration) -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "out".to_owned());
    std::fs::create_dir_all(&folder)?;
    let file = Path::new(&folder).join("onnx.png");
    picture.save(&file)?;
    let score = psnr(picture, &photo("target_0.jpg")?);
    println!("{}: {score:.2} dB against the held-out photo, {:.2} s", file.display(), took.as_secs_f64());
    Ok(())
}

/// Peak signal-to-noise ratio, dB.
fn psnr(picture: &ImageRgb, truth: &ImageRgb) -> f64 {
    let squares = picture.data().iter().zip(truth.data()).map(|(a, b)| f64::from(a - b).powi(2));
    -10.0 * (squares.sum::<f64>() / truth.data().len() as f64).log10()
}
