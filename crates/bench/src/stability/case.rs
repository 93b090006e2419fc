//! Stiff and extreme cases: each stage of the library, and of the reference if there is one, compared with float64. Families of cases
//! vary one quantity over decades, which shows where an implementation fails.
//!
//! A *doubtful* pixel is one whose value depends on bits that float32 inputs do not have (see [`super::warp`]). Outside doubtful pixels
//! the bound of the case holds; of the doubtful ones, a limited share may exceed it.

use anyhow::Result;
use liveview_common::statistics::share;
use ndarray::Array1;

use crate::npz::Arrays;

/// A stage's outputs by name, each `[channels, pixels]`.
pub(crate) type Outputs<T> = Vec<(&'static str, Vec<T>)>;

/// The expected outputs, in float64.
pub(crate) struct Expected {
    pub(crate) outputs: Outputs<f64>,
    /// By pixel.
    pub(crate) doubtful: Vec<bool>,
    /// Whether errors are relative to the largest element of each output, instead of absolute errors of values in [0, 1].
    pub(crate) relative: bool,
}

impl Expected {
    /// The divisor of an output's errors.
    pub(crate) fn scale(&self, output: usize) -> f64 {
        let (name, values) = &self.outputs[output];
        let top = values.iter().fold(0.0, |top: f64, x| top.max(x.abs()));
        // Disparities have a unit: their errors are relative.
        if (self.relative || *name == "disparity") && top > 0.0 { top } else { 1.0 }
    }

    /// Share of the pixels that the source covers, if the outputs include coverage.
    pub(crate) fn covered(&self) -> Option<f64> {
        let (_, coverage) = self.outputs.iter().find(|(name, _)| *name == "coverage")?;
        Some(share(coverage, |&coverage| coverage > 0.0))
    }

    /// Writes the expected outputs for the reference.
    pub(crate) fn write(&self, arrays: &mut Arrays) -> Result<()> {
        for (index, (name, values)) in self.outputs.iter().enumerate() {
            arrays.add(&format!("truth.{name}"), Array1::from_vec(values.clone()))?;
            arrays.add(&format!("scale.{name}"), Array1::from_vec(vec![self.scale(index)]))?;
        }
        arrays.add("doubtful", Array1::from_vec(self.doubtful.clone()))
    }
}

/// A test of a stage: its inputs, and its outputs as the library computes them and in float64.
pub(crate) trait StageTest {
    /// The name of the stage in the reference.
    fn stage(&self) -> &'static str;

    /// The library's outputs, or the error with which it refuses the inputs.
    fn computed(&self) -> Result<Outputs<f32>, String>;

    /// Outputs of an equivalent case, which must equal [`StageTest::computed`] to the last bit.
    fn equivalent(&self) -> Option<Result<Outputs<f32>, String>> {
        None
    }

    /// The outputs in float64, by a simple implementation; `None` if only the reference has one (the network).
    fn expected(&self) -> Option<Expected>;

    /// Whether the source must cover some pixel: otherwise the case tests nothing.
    fn must_cover(&self) -> bool {
        false
    }

    /// Run time relative to that on ordinary inputs, for the network.
    fn relative_time(&self) -> Option<f64> {
        None
    }

    /// Writes the inputs for the reference.
    fn write(&self, arrays: &mut Arrays) -> Result<()>;
}

/// A case: one line of the table.
pub(crate) struct Case<'a> {
    /// The quantity that its family varies; each family has a panel in the plot.
    pub(crate) family: &'static str,
    /// The value of that quantity, at least 0; it may be infinite.
    pub(crate) extreme: f64,
    /// The value as text, or a description.
    pub(crate) name: String,
    pub(crate) test: Box<dyn StageTest + 'a>,
    /// Largest error allowed outside doubtful pixels: of values in [0, 1], or relative to the largest ([`Expected`]).
    pub(crate) bound: f64,
}

impl<'a> Case<'a> {
    pub(super) fn new(family: &'static str, extreme: f64, name: String, test: impl StageTest + 'a, bound: f64) -> Self {
        Self { family, extreme, name, test: Box::new(test), bound }
    }

    /// A family without a quantity: its cases are numbered from 1.
    pub(super) fn listed<Q: StageTest + 'a>(
        family: &'static str,
        bound: f64,
        named: impl IntoIterator<Item = (impl Into<String>, Q)>,
    ) -> Vec<Self> {
        let named = named.into_iter().enumerate();
        named.map(|(index, (name, test))| Self::new(family, (index + 1) as f64, name.into(), test, bound)).collect()
    }
}

/// Powers of ten.
pub(super) fn decades(exponents: impl IntoIterator<Item = i32>) -> impl Iterator<Item = f64> {
    exponents.into_iter().map(|exponent| 10f64.powi(exponent))
}

/// Pseudo-random numbers in [0, 1), the same each time (splitmix64).
pub(super) struct Seeded(pub(super) u64);

impl Seeded {
    pub(super) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn units(&mut self, count: usize) -> Vec<f32> {
        (0..count).map(|_| self.unit() as f32).collect()
    }
}
