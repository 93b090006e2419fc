//! Words of the options of the model and the engine.

use std::str::FromStr;

use clap::ValueEnum;
use liveview::network::{AlphaKind, ExecutionProvider};

/// `--network`: where it is not given, a model.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum NetworkName {
    None,
}

/// `--alpha`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum AlphaName {
    Independent,
    Competing,
}

impl From<AlphaName> for AlphaKind {
    fn from(name: AlphaName) -> Self {
        match name {
            AlphaName::Independent => Self::Independent,
            AlphaName::Competing => Self::Competing,
        }
    }
}

/// `--engine`.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum ProviderName {
    Cpu,
    Openvino,
    Cuda,
    Tensorrt,
}

impl From<ProviderName> for ExecutionProvider {
    fn from(name: ProviderName) -> Self {
        match name {
            ProviderName::Cpu => Self::Cpu,
            ProviderName::Openvino => Self::OpenVino,
            ProviderName::Cuda => Self::Cuda,
            ProviderName::Tensorrt => Self::TensorRt,
        }
    }
}

/// `--precision`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum PrecisionName {
    F32,
    Bf16,
    Int8,
}

/// `--name=value`
pub(super) fn flag(name: &str, value: &impl ValueEnum) -> Option<String> {
    Some(format!("--{name}={}", value.to_possible_value()?.get_name()))
}

/// An engine and a precision, such as `openvino int8`.
#[derive(Debug, Clone, Copy)]
pub struct ProviderChoice {
    pub(super) engine: ProviderName,
    pub(super) precision: Option<PrecisionName>,
}

impl FromStr for ProviderChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (engine, precision) = text.trim().split_once(' ').map_or((text.trim(), None), |(e, p)| (e, Some(p)));
        let precision = precision.map(|precision| PrecisionName::from_str(precision, true)).transpose()?;
        Ok(Self { engine: ProviderName::from_str(engine, true)?, precision })
    }
}
