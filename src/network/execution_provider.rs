//! Execution providers of ONNX Runtime, and the precision of their arithmetic.

use std::fmt;

use ort::ep::ExecutionProviderDispatch;
#[cfg(any(feature = "load-dynamic", feature = "cuda", feature = "tensorrt"))]
use ort::ep::{self, ExecutionProvider as _};

/// An execution provider of ONNX Runtime.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum ExecutionProvider {
    /// ONNX Runtime's CPU provider, which every build of it has.
    #[default]
    Cpu,
    /// Intel's OpenVINO on the CPU (any x86-64), from the wheel `onnxruntime-openvino`.
    OpenVino,
    /// NVIDIA GPUs, from the wheel `onnxruntime-gpu`; needs the cargo feature `cuda`.
    Cuda,
    /// NVIDIA GPUs through TensorRT, from the same wheel; needs the cargo feature `tensorrt`.
    TensorRt,
}

/// Precision of the arithmetic on a model whose weights are float32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Precision {
    /// float32.
    #[default]
    F32,
    /// bfloat16, where the provider supports it and the CPU has instructions for it.
    Bf16,
}

impl ExecutionProvider {
    /// Every provider.
    pub const ALL: [Self; 4] = [Self::Cpu, Self::OpenVino, Self::Cuda, Self::TensorRt];

    /// Its name, as in the names of its library files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::OpenVino => "openvino",
            Self::Cuda => "cuda",
            Self::TensorRt => "tensorrt",
        }
    }

    /// Whether it can compute float32 weights in bfloat16.
    pub fn supports_bf16(self) -> bool {
        self == Self::OpenVino
    }

    /// The cargo feature that it needs, if this build lacks it.
    pub(super) fn missing_feature(self) -> Option<&'static str> {
        match self {
            Self::OpenVino if cfg!(not(feature = "load-dynamic")) => Some("load-dynamic"),
            Self::Cuda if cfg!(not(feature = "cuda")) => Some("cuda"),
            Self::TensorRt if cfg!(not(feature = "tensorrt")) => Some("tensorrt"),
            _ => None,
        }
    }

    /// Whether the loaded library was built with it.
    pub(super) fn is_available(self) -> ort::Result<bool> {
        match self {
            Self::Cpu => Ok(true),
            #[cfg(feature = "load-dynamic")]
            Self::OpenVino => ep::OpenVINO::is_available(),
            #[cfg(feature = "cuda")]
            Self::Cuda => ep::CUDA::is_available(),
            #[cfg(feature = "tensorrt")]
            Self::TensorRt => ep::TensorRT::is_available(),
            #[allow(unreachable_patterns, reason = "which providers are left depends on the cargo features")]
            _ => Ok(false),
        }
    }

    /// How a session is configured to use it; `None` for ONNX Runtime's CPU provider, which needs
    /// no configuration.
    pub(super) fn dispatch(self, threads: usize, precision: Precision) -> Option<ExecutionProviderDispatch> {
        // Used only if a cargo feature adds a provider that takes them.
        let _ = (threads, precision);
        match self {
            Self::Cpu => None,
            #[cfg(feature = "load-dynamic")]
            Self::OpenVino => Some(openvino(threads, precision)),
            #[cfg(feature = "cuda")]
            Self::Cuda => Some(ep::CUDA::default().build().error_on_failure()),
            #[cfg(feature = "tensorrt")]
            Self::TensorRt => Some(ep::TensorRT::default().build().error_on_failure()),
            #[allow(unreachable_patterns, reason = "which providers are left depends on the cargo features")]
            _ => None,
        }
    }
}

impl fmt::Display for ExecutionProvider {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// OpenVINO's own options go through the provider's `load_config`; its older `num_of_threads` and
/// `precision` cover fewer cases.
#[cfg(feature = "load-dynamic")]
fn openvino(threads: usize, precision: Precision) -> ExecutionProviderDispatch {
    use ep::ArbitrarilyConfigurableExecutionProvider;
    let precision = match precision {
        Precision::F32 => "f32",
        Precision::Bf16 => "bf16",
    };
    let config =
        format!(r#"{{"CPU": {{"INFERENCE_NUM_THREADS": "{threads}", "INFERENCE_PRECISION_HINT": "{precision}"}}}}"#);
    let provider = ep::OpenVINO::default().with_device_type("CPU").with_arbitrary_config("load_config", config);
    provider.build().error_on_failure()
}

/// Whether this CPU has the instructions that OpenVINO needs for bfloat16; without them it computes
/// in float32.
pub fn cpu_has_bf16() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        std::arch::is_x86_feature_detected!("avx512bw") || std::arch::is_x86_feature_detected!("avxneconvert")
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        false
    }
}
