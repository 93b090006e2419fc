//! The errors of a case, and whether it passes.

use serde_json::{Value, json};

use super::case::{Outputs, Truth};

/// Largest share of the doubtful pixels that may be off by more than the bound.
const DOUBTFUL_CAP: f64 = 0.01;

/// One unit in the last place of 1, in float32: the error of a value that was rounded twice, allowed where torch happens to be exact.
const FLOOR: f64 = 1.2e-7;

/// How many times as long as on noise the network may take on any other input; with denormal arithmetic it takes some CPUs ten times.
const SLOWEST: f64 = 5.0;

/// The errors of one implementation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Errors {
    /// The largest outside doubtful pixels; infinite where anything is not finite.
    pub(crate) largest: f64,
    /// Of the doubtful pixels, the share that is off by more than the bound; 0 where one alone is, for there the truth may be off.
    pub(crate) doubtful: f64,
}

impl Errors {
    /// The errors of outputs against the truth; both have the same outputs.
    pub(crate) fn between(found: &Outputs<f32>, truth: &Truth, bound: f64) -> Self {
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

    /// From the reference's answer; `null` for an implementation that does not have this stage.
    pub(crate) fn from_json(json: &Value) -> Option<Self> {
        let doubtful = json["doubtful"].as_f64()?;
        Some(Self { largest: json["largest"].as_f64().unwrap_or(f64::INFINITY), doubtful })
    }

    fn json(self) -> Value {
        json!({ "largest": self.largest.is_finite().then_some(self.largest), "doubtful": self.doubtful })
    }
}

/// The result of a case.
pub(crate) struct Outcome {
    pub(crate) family: &'static str,
    pub(crate) extreme: f64,
    pub(crate) name: String,
    pub(crate) stage: &'static str,
    pub(crate) bound: f64,
    /// Share of the pixels that are doubtful.
    pub(crate) doubtful: f64,
    /// Share of the pixels that the source covers, where that matters.
    pub(crate) seen: Option<f64>,
    /// Whether `seen` must not be 0.
    pub(crate) must_be_seen: bool,
    /// The library's errors, or the message with which it refuses the inputs; `None` where only a reference has the truth, and there
    /// is no reference: then the outputs are only known to be finite.
    pub(crate) rust: Result<Option<Errors>, String>,
    /// Whether the outputs of an equivalent case are equal to the last bit.
    pub(crate) equal: Option<bool>,
    /// The reference's: float32 torch, unmodified kornia, onnxruntime.
    pub(crate) torch: Option<Errors>,
    pub(crate) kornia: Option<Errors>,
    pub(crate) onnxruntime: Option<Errors>,
    /// The oracle's own error against arithmetic with 50 digits, at a sample of the pixels.
    pub(crate) oracle: Option<f64>,
    /// Run time as a multiple of that on ordinary inputs.
    pub(crate) slower: Option<f64>,
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
            return failed("two answers that must be the same to the bit differ".into());
        }
        if let Some(off) = self.oracle.filter(|&off| off.is_nan() || off > self.bound / 4.0) {
            return failed(format!("the oracle itself is off by {off:.1e}"));
        }
        let rust = match &self.rust {
            Err(refusal) => return Verdict::Refused(refusal.clone()),
            Ok(None) => return Verdict::NotCompared,
            Ok(Some(rust)) => rust,
        };
        if self.must_be_seen && self.seen == Some(0.0) {
            return failed("no pixel sees the source: nothing is tested".into());
        }
        if let Some(slower) = self.slower.filter(|&slower| slower > SLOWEST) {
            return failed(format!("takes {slower:.1} times the time of noise"));
        }
        if rust.largest > self.bound {
            return failed(format!("off by {:.1e}, bound {:.0e}", rust.largest, self.bound));
        }
        if rust.doubtful > DOUBTFUL_CAP {
            return failed(format!("{:.0} % of the doubtful pixels are off", 100.0 * rust.doubtful));
        }
        match self.torch.map(|torch| 2.0 * torch.largest.max(FLOOR / 2.0)) {
            Some(most) if rust.largest > most => {
                failed(format!("off by {:.1e}, twice torch's is {most:.1e}", rust.largest))
            }
            _ => Verdict::Ok,
        }
    }

    pub(crate) fn json(&self) -> Value {
        let (verdict, why) = match self.verdict() {
            Verdict::Ok => ("ok", None),
            Verdict::NotCompared => ("not compared", None),
            Verdict::Refused(why) => ("refused", Some(why)),
            Verdict::Failed(why) => ("failed", Some(why)),
        };
        let errors = |errors: Option<Errors>| errors.map(Errors::json);
        json!({
            "family": self.family, "extreme": self.extreme.is_finite().then_some(self.extreme), "name": self.name,
            "stage": self.stage, "bound": self.bound, "doubtful": self.doubtful, "seen": self.seen,
            "rust": errors(self.rust.clone().ok().flatten()), "torch": errors(self.torch),
            "kornia": errors(self.kornia), "onnxruntime": errors(self.onnxruntime), "oracle": self.oracle,
            "slower": self.slower, "verdict": verdict, "why": why,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(rust: f64, torch: f64) -> Outcome {
        let errors = |largest| Some(Errors { largest, doubtful: 0.0 });
        Outcome {
            family: "depth",
            extreme: 1.0,
            name: String::new(),
            stage: "warp",
            bound: 1e-5,
            doubtful: 0.0,
            seen: None,
            must_be_seen: true,
            rust: Ok(errors(rust)),
            equal: None,
            torch: errors(torch),
            kornia: None,
            onnxruntime: None,
            oracle: None,
            slower: None,
        }
    }

    #[test]
    fn beyond_the_bound_or_twice_torchs_error_is_a_failure() {
        assert_eq!(outcome(9e-6, 5e-6).verdict(), Verdict::Ok);
        assert_eq!(outcome(1e-7, 0.0).verdict(), Verdict::Ok);
        for bad in [outcome(2e-5, 1.0), outcome(9e-6, 4e-6), outcome(f64::INFINITY, f64::INFINITY)] {
            assert!(matches!(bad.verdict(), Verdict::Failed(_)));
        }
        assert!(matches!(Outcome { oracle: Some(1e-4), ..outcome(0.0, 0.0) }.verdict(), Verdict::Failed(_)));
        assert!(matches!(Outcome { seen: Some(0.0), ..outcome(0.0, 0.0) }.verdict(), Verdict::Failed(_)));
        assert!(matches!(Outcome { slower: Some(30.0), ..outcome(0.0, 0.0) }.verdict(), Verdict::Failed(_)));
        assert!(!Outcome { rust: Err("fx is 0".into()), ..outcome(0.0, 0.0) }.holds());
        assert!(matches!(Outcome { equal: Some(false), ..outcome(0.0, 0.0) }.verdict(), Verdict::Failed(_)));
    }

    #[test]
    fn doubtful_pixels_are_counted_apart_and_nan_is_infinitely_wrong() {
        let truth = Truth {
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
