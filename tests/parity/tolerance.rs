//! Bounds of the errors of a stage, from `parity/tolerances.json`.

use std::path::Path;

use serde_json::Value;

/// Bounds of the errors of a stage.
pub(crate) struct Tolerance {
    floor: f64,
    max_factor: f64,
    ceiling: f64,
    mean_floor: f64,
    mean_factor: f64,
    /// Largest share of doubtful elements, 0 to 1.
    pub(crate) doubtful: f64,
}

impl Tolerance {
    /// The entry of a stage; without `doubtful` no element may be doubtful.
    pub(crate) fn of(stage: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/tolerances.json");
        let all: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let optional = |key: &str| all[stage][key].as_f64();
        let number = |key: &str| optional(key).unwrap_or_else(|| panic!("tolerances.json: {stage}: {key} is missing"));
        Self {
            floor: number("floor"),
            max_factor: number("max_factor"),
            ceiling: number("ceiling"),
            mean_floor: number("mean_floor"),
            mean_factor: number("mean_factor"),
            doubtful: optional("doubtful").unwrap_or(0.0),
        }
    }

    /// Bound of the largest error, given torch's.
    pub(crate) fn max(&self, torch: f64) -> f64 {
        self.floor.max(self.max_factor * torch).min(self.ceiling)
    }

    /// Bound of the mean error, given torch's.
    pub(crate) fn mean(&self, torch: f64) -> f64 {
        // The means are sums in different orders: equal errors must count as equal.
        (self.mean_floor.max(self.mean_factor * torch) * (1.0 + 1e-9)).min(self.ceiling)
    }
}
