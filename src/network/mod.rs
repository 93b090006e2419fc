//! The network: a homography warped volume in, logits out (paper, section "Neural Network").
//!
//! [`PlaneNetwork`] is all that the pipeline asks of a network; [`OrtNetwork`] runs a LiveView model with ONNX Runtime.

mod alpha;
mod error;
mod execution_provider;
#[cfg(feature = "load-dynamic")]
mod library_file;
mod model_card;
mod model_file;
mod none;
mod ort;
mod ort_library;
mod plane_network;
mod threads;

#[cfg(fuzzing)]
pub(crate) use self::ort::check_outlets;
pub use self::ort::{OrtNetwork, RunEnd};
pub use alpha::{Alpha, AlphaKind};
pub use error::NetworkError;
pub use execution_provider::{ExecutionProvider, Precision, cpu_has_bf16};
pub use model_card::ModelCard;
#[cfg(fuzzing)]
pub(crate) use model_card::read_card;
pub use model_file::{ModelNotFound, find_model, model_folders};
pub use none::NoNetwork;
pub use ort_library::{OrtLibrary, OrtLibraryError};
pub use plane_network::PlaneNetwork;
pub use threads::{MAX_THREADS, ThreadsError, check_threads};
