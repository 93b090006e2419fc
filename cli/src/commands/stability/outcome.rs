//! How far an answer is off, and whether that may be.

use serde_json::{Value, json};

use super::case::{Outputs, Truth};
use crate::statistics::share;

/// Of the doubtful pixels of a case, the share that may be off by more than the bound.
const DOUBTFUL_CAP: f64 = 0.01;

/// One unit in the last place of 1, in float32: the error of an answer that was rounded twice, where the reference happens to
/// be exact.
const FLOOR: f64 = 1.2e-7;

/// How many times longer than on noise the network may take on any other input: denormal arithmetic would cost 30.
const SLOWEST: f64 = 5.0;

/// How far one implementation's answer is off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Errors {
    /// The largest outside doubtful pixels; infinite where anything is not finite.
    pub(crate) largest: f64,
    /// Of the doubtful pixels, the share that is off by more than the bound.
    pub(crate) doubtful: f64,
}

impl Errors {
    /// Of an answer against the truth; both have the same outputs.
    pub(crate) fn between(found: &Outputs<f32>, truth: &Truth, bound: f64) -> Self {
        let pixels = truth.doubtful.len();
        let (mut largest, mut off) = (0.0_f64, vec![false; pixels]);
        assert_eq!(found.len(), truth.outputs.len(), "outputs");
        for (index, ((name, found), (known_as, expected))) in found.iter().zip(&truth.outputs).enumerate() {
            assert_eq!((name, found.len()), (known_as, expected.len()), "an output and its length");
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
        Self {
            largest,
            doubtful: share(&off, |&off| off) / share(&truth.doubtful, |&doubtful| doubtful).max(f64::MIN_POSITIVE),
        }
    }

    /// As the reference tells it; `null` is an implementation that does not have this stage.
    pub(crate) fn told(told: &Value) -> Option<Self> {
        let doubtful = told["doubtful"].as_f64()?;
        Some(Self { largest: told["largest"].as_f64().unwrap_or(f64::INFINITY), doubtful })
    }

    fn json(self) -> Value {
        json!({ "largest": self.largest.is_finite().then_some(self.largest), "doubtful": self.doubtful })
    }
}

/// What became of a case.
pub(crate) struct Outcome {
    pub(crate) family: &'static str,
    pub(crate) extreme: f64,
    pub(crate) name: String,
    pub(crate) stage: &'static str,
    pub(crate) bound: f64,
    /// Share of the pixels.
    pub(crate) doubtful: f64,
    /// Share of the pixels that see the source, where that is in question.
    pub(crate) seen: Option<f64>,
    /// Where this must not be 0.
    pub(crate) must_be_seen: bool,
    /// The binary's, or what it refuses the inputs with; `None` where the reference alone knows the truth, and there is none: all
    /// that is known then is that it is finite.
    pub(crate) ours: Result<Option<Errors>, String>,
    /// Whether a second answer that must equal it does.
    pub(crate) equal: Option<bool>,
    /// Of the reference: float32 torch, kornia as it comes, onnxruntime.
    pub(crate) torch: Option<Errors>,
    pub(crate) kornia: Option<Errors>,
    pub(crate) onnxruntime: Option<Errors>,
    /// How far the oracle is from 50 digits, at pixels all over.
    pub(crate) oracle: Option<f64>,
    /// How many times longer than on ordinary inputs it takes.
    pub(crate) slower: Option<f64>,
}

/// Whether a case holds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Verdict {
    Ok,
    /// Finite, which is all that is known without the reference.
    NotCompared,
    /// A named error in place of an answer. None of the cases is such that it may be.
    Refused(String),
    Failed(String),
}

impl Outcome {
    /// Whether it counts as holding.
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
        let ours = match &self.ours {
            Err(refusal) => return Verdict::Refused(refusal.clone()),
            Ok(None) => return Verdict::NotCompared,
            Ok(Some(ours)) => ours,
        };
        if self.must_be_seen && self.seen == Some(0.0) {
            return failed("no pixel sees the source: nothing is tested".into());
        }
        if let Some(slower) = self.slower.filter(|&slower| slower > SLOWEST) {
            return failed(format!("takes {slower:.1} times the time of noise"));
        }
        if ours.largest > self.bound {
            return failed(format!("off by {:.1e}, bound {:.0e}", ours.largest, self.bound));
        }
        if ours.doubtful > DOUBTFUL_CAP {
            return failed(format!("{:.0} % of the doubtful pixels are off", 100.0 * ours.doubtful));
        }
        match self.torch.map(|torch| 2.0 * torch.largest.max(FLOOR / 2.0)) {
            Some(most) if ours.largest > most => {
                failed(format!("off by {:.1e}, twice torch's is {most:.1e}", ours.largest))
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
            "rust": errors(self.ours.clone().ok().flatten()), "torch": errors(self.torch),
            "kornia": errors(self.kornia), "onnxruntime": errors(self.onnxruntime), "oracle": self.oracle,
            "slower": self.slower, "verdict": verdict, "why": why,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(ours: f64, torch: f64) -> Outcome {
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
            ours: Ok(errors(ours)),
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
        assert!(!Outcome { ours: Err("fx is 0".into()), ..outcome(0.0, 0.0) }.holds());
        assert!(matches!(Outcome { equal: Some(false), ..outcome(0.0, 0.0) }.verdict(), Verdict::Failed(_)));
    }

    #[test]
    fn doubtful_pixels_are_counted_apart_and_nan_is_infinitely_wrong() {
        let truth = Truth {
            outputs: vec![("coverage", vec![0.5, 0.5, 0.5, 0.5])],
            doubtful: vec![false, true, true, false],
            relative: false,
        };
        let found = |values: [f32; 4]| Errors::between(&vec![("coverage", values.to_vec())], &truth, 1e-3);
        assert_eq!(found([0.75, 0.9, 0.5, 0.5]), Errors { largest: 0.25, doubtful: 0.5 });
        assert_eq!(found([0.5, f32::NAN, 0.5, 0.5]).largest, f64::INFINITY);
    }
}
