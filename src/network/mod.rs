//! The network: a homography warped volume in, logits out (paper, section "Neural Network").
//!
//! [`PlaneNetwork`] is the interface; [`OrtNetwork`] runs a LiveView model with ONNX Runtime, and
//! [`ViewAgreement`] needs no model.

mod alpha;
mod error;
mod execution_provider;
#[cfg(feature = "load-dynamic")]
mod library_length;
mod model_card;
mod model_file;
mod ort;
mod ort_library;
mod plane_network;
mod run_end;
mod threads;
mod view_agreement;

pub use self::ort::OrtNetwork;
#[cfg(fuzzing)]
pub(crate) use self::ort::check_outlets;
pub use alpha::{Alpha, AlphaKind};
pub use error::NetworkError;
pub use execution_provider::{ExecutionProvider, Precision, cpu_has_bf16};
pub use model_card::ModelCard;
#[cfg(fuzzing)]
pub(crate) use model_card::read_card;
pub use model_file::{ModelNotFound, find_model, model_folders};
pub use ort_library::{OrtLibrary, OrtLibraryError};
pub use plane_network::PlaneNetwork;
pub use run_end::RunEnd;
pub use threads::{MAX_THREADS, ThreadsError, check_threads};
pub use view_agreement::ViewAgreement;
