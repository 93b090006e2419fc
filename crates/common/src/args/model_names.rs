//! Values of the options for the model and the engine.

use std::str::FromStr;

use clap::ValueEnum;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use liveview::network::{AlphaKind, ExecutionProvider};

/// Values of `--network`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum NetworkName {
    None,
    Model,
}

/// Parses the value of `--alpha`.
pub(super) fn alpha_parser() -> impl TypedValueParser<Value = AlphaKind> {
    let names = [
        ("independent", "Each layer has its own opacity, as in the paper"),
        ("competing", "A softmax over all layers, so that faint false surfaces do not accumulate into haze"),
    ];
    let values = names.map(|(name, help)| PossibleValue::new(name).help(help));
    PossibleValuesParser::new(values).try_map(|name| name.parse())
}

/// Parses the value of `--engine`: the name of an execution provider.
pub(super) fn provider_parser() -> impl TypedValueParser<Value = ExecutionProvider> {
    let names = ExecutionProvider::ALL.map(ExecutionProvider::name);
    PossibleValuesParser::new(names).try_map(|name| provider(&name))
}

/// The provider of a name in lower or upper case.
fn provider(name: &str) -> Result<ExecutionProvider, String> {
    let named = |provider: &ExecutionProvider| provider.name().eq_ignore_ascii_case(name);
    ExecutionProvider::ALL.into_iter().find(named).ok_or_else(|| {
        let names = ExecutionProvider::ALL.map(ExecutionProvider::name).join(", ");
        format!("\"{name}\" is not an engine; expected one of {names}")
    })
}

/// Values of `--precision`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum PrecisionName {
    /// 32-bit floats
    F32,
    /// 16-bit floats, with --engine openvino on CPUs that support them
    Bf16,
    /// A quantised model: such as liveview_v4_int8.onnx, for planes liveview_v4_planes_int8.onnx
    Int8,
}

/// An engine and a precision, such as `openvino int8`.
#[derive(Debug, Clone, Copy)]
pub struct ProviderChoice {
    pub(super) engine: ExecutionProvider,
    pub(super) precision: Option<PrecisionName>,
}

impl FromStr for ProviderChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (engine, precision) = text.trim().split_once(' ').map_or((text.trim(), None), |(e, p)| (e, Some(p)));
        let precision = precision.map(|text| {
            PrecisionName::from_str(text, true)
                .map_err(|_| format!("\"{text}\" is not a precision; expected f32, bf16 or int8"))
        });
        let precision = precision.transpose()?;
        Ok(Self { engine: provider(engine)?, precision })
    }
}
