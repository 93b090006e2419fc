//! The errors of a case, and whether it passes.

use serde_json::Value;

use super::case::{Expected, Outputs};

/// Largest share of the doubtful pixels whose error may exceed the bound.
const MAX_DOUBTFUL_OFF: f64 = 0.01;

/// One unit in the last place of 1 in float32, the error of a value rounded twice: allowed even if torch happens to be exact.
const ALWAYS_ALLOWED: f64 = 1.2e-7;

/// Longest time of the network on any input, relative to noise; denormal arithmetic takes ten times as long on some CPUs.
const MAX_RELATIVE_TIME: f64 = 5.0;

/// The errors of one implementation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Errors {
    /// The largest outside doubtful pixels; infinite if any value is not finite.
    pub(crate) largest: f64,
    /// The share of doubtful pixels whose error exceeds the bound; 0 if it is a single one, whose expected value may be wrong.
    pub(crate) doubtful: f64,
}

impl Errors {
    /// The errors of outputs against the expected ones, which have the same names and sizes.
    pub(crate) fn between(found: &Outputs<f32>, truth: &Expected, bound: f64) -> Self {
        let pixels = truth.doubtful.len();
        let (mut largest, mut off) = (0.0_f64, vec![false; pixels]);
        assert_eq!(found.len(), truth.outputs.len(), "outputs");
        for (index, ((name, found), (expected_name, expected))) in found.iter().zip(&truth.outputs).enumerate() {
            assert_eq!((name, found.len()), (expected_name, expected.len()), "an output and its length");
            let scale = truth.scale(index);
            for (i, (&found, expected)) in found.iter().zip(expected).enumerate() {
                let error = (f64::from(found) - expected).abs() / scale;
                let error = if error.is_finite() { error } else { f64::INFINITY };
                if !truth.doubtful[i % pixels] || error.is_infinite() {
                    largest = largest.max(error);
                } else {
                    off[i % pixels] |= error > bound;
                }
            }
        }
        let count = |flags: &[bool]| flags.iter().filter(|&&flag| flag).count();
        let doubtful = if count(&off) > 1 { count(&off) as f64 / count(&truth.doubtful) as f64 } else { 0.0 };
        Self { largest, doubtful }
    }

    /// The errors in the reference's answer; `None` for an implementation without this stage.
    pub(crate) fn from_json(json: &Value) -> Option<Self> {
        let doubtful = json["doubtful"].as_f64()?;
        Some(Self { largest: json["largest"].as_f64().unwrap_or(f64::INFINITY), doubtful })
    }
}

/// The result of a case.
pub(crate) struct Outcome {
    pub(crate) family: &'static str,
    pub(crate) name: String,
    pub(crate) stage: &'static str,
    pub(crate) bound: f64,
    /// Share of the pixels that are doubtful.
    pub(crate) doubtful: f64,
    /// Share of the pixels that the source covers, for a warp.
    pub(crate) covered: Option<f64>,
    /// Whether `covered` must not be 0.
    pub(crate) must_cover: bool,
    /// The library's errors, or the message with which it refuses the inputs; `None` if only a reference could
    /// compute the expected outputs and there is none: the outputs are then only known to be finite.
    pub(crate) rust: Result<Option<Errors>, String>,
    /// Whether the outputs of an equivalent case are equal to the last bit.
    pub(crate) equal: Option<bool>,
    /// Errors of float32 torch, unmodified kornia and onnxruntime.
    pub(crate) torch: Option<Errors>,
    pub(crate) kornia: Option<Errors>,
    pub(crate) onnxruntime: Option<Errors>,
    /// The error of the expected outputs against arithmetic with 50 digits, at some of the pixels.
    pub(crate) oracle: Option<f64>,
    /// Run time relative to that on ordinary inputs.
    pub(crate) relative_time: Option<f64>,
}

/// Whether a case passes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Verdict {
    Ok,
    /// Finite; there is no reference to compare with.
    NotCompared,
    /// The library refused the inputs, which no case allows.
    Refused(String),
    Failed(String),
}

impl Outcome {
    /// Whether the case passes.
    pub(crate) fn holds(&self) -> bool {
        matches!(self.verdict(), Verdict::Ok | Verdict::NotCompared)
    }

    pub(crate) fn verdict(&self) -> Verdict {
        let failed = |why: String| Verdict::Failed(why);
        if self.equal == Some(false) {
            return failed("two results that must be equal to the last bit differ".into());
        }
        if let Some(off) = self.oracle.filter(|&off| off.is_nan() || off > self.bound / 4.0) {
            return failed(format!("the expected outputs are themselves off by {off:.1e}"));
        }
        let rust = match &self.rust {
            Err(refusal) => return Verdict::Refused(refusal.clone()),
            Ok(None) => return Verdict::NotCompared,
            Ok(Some(rust)) => rust,
        };
        if self.must_cover && self.covered == Some(0.0) {
            return failed("the source covers no pixel: nothing is tested".into());
        }
        if let Some(slower) = self.relative_time.filter(|&slower| slower > MAX_RELATIVE_TIME) {
            return failed(format!("takes {slower:.1} times as long as noise"));
        }
        if rust.largest > self.bound {
            return failed(format!("off by {:.1e}, bound {:.0e}", rust.largest, self.bound));
        }
        if rust.doubtful > MAX_DOUBTFUL_OFF {
            return failed(format!("{:.0} % of the doubtful pixels are off", 100.0 * rust.doubtful));
        }
        match self.torch.map(|torch| 2.0 * torch.largest.max(ALWAYS_ALLOWED / 2.0)) {
            Some(most) if rust.largest > most => {
                failed(format!("off by {:.1e}, twice torch's is {most:.1e}", rust.largest))
            }
            _ => Verdict::Ok,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(rust: f64, torch: f64) -> Outcome {
        let errors = |largest| Some(Errors { largest, doubtful: 0.0 });
        Outcome {
            family: "depth",
            name: String::new(),
            stage: "warp",
            bound: 1e-5,
            doubtful: 0.0,
            covered: None,
            must_cover: true,
            rust: Ok(errors(rust)),
            equal: None,
            torch: errors(torch),
            kornia: None,
            onnxruntime: None,
            oracle: None,
            relative_time: None,
        }
    }

    #[test]
    fn error_beyond_the_bound_or_twice_that_of_torch_fails() {
        assert_eq!(outcome(9e-6, 5e-6).verdict(), Verdict::Ok);
        assert_eq!(outcome(1e-7, 0.0).verdict(), Verdict::Ok);
        for bad in [outcome(2e-5, 1.0), outcome(9e-6, 4e-6), outcome(f64::INFINITY, f64::INFINITY)] {
            assert!(matches!(bad.verdict(), Verdict::Failed(_)));
        }
        assert!(matches!(Outcome { oracle: Some(1e-4), ..outcome(0.0, 0.0) }.verdict(), Verdict::Failed(_)));
        assert!(matches!(Outcome { covered: Some(0.0), ..outcome(0.0, 0.0) }.verdict(), Verdict::Failed(_)));
        assert!(matches!(Outcome { relative_time: Some(30.0), ..outcome(0.0, 0.0) }.verdict(), Verdict::Failed(_)));
        assert!(!Outcome { rust: Err("fx is 0".into()), ..outcome(0.0, 0.0) }.holds());
        assert!(matches!(Outcome { equal: Some(false), ..outcome(0.0, 0.0) }.verdict(), Verdict::Failed(_)));
    }

    #[test]
    fn doubtful_pixels_are_counted_separately_and_nan_is_infinite() {
        let truth = Expected {
            outputs: vec![("coverage", vec![0.5; 6])],
            doubtful: vec![false, true, true, true, true, false],
            relative: false,
        };
        let found = |values: [f32; 6]| Errors::between(&vec![("coverage", values.to_vec())], &truth, 1e-3);
        assert_eq!(found([0.75, 0.9, 0.5, 0.1, 0.5, 0.5]), Errors { largest: 0.25, doubtful: 0.5 });
        assert_eq!(found([0.5, 0.9, 0.5, 0.5, 0.5, 0.5]), Errors { largest: 0.0, doubtful: 0.0 });
        assert_eq!(found([0.5, f32::NAN, 0.5, 0.5, 0.5, 0.5]).largest, f64::INFINITY);
    }
}
