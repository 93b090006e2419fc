//! Stiff and extreme cases: each stage of the binary, and of the reference if there is one, against a float64 oracle, in
//! families that are swept over decades, so that one sees where an implementation stops holding.
//!
//! A *doubtful* pixel is one whose answer hangs on bits that float32 inputs do not have ([`warp`] says which). Outside of
//! these the bound of the case holds; inside, a capped share may differ by more.

use anyhow::Result;
use ndarray::Array1;

use crate::npz::Arrays;
use crate::statistics::share;

/// A stage's outputs by name, each `[channels, pixels]`.
pub(crate) type Outputs<T> = Vec<(&'static str, Vec<T>)>;

/// What the answer should be.
pub(crate) struct Truth {
    pub(crate) outputs: Outputs<f64>,
    /// Per pixel.
    pub(crate) doubtful: Vec<bool>,
    /// Whether errors are relative to the largest element of each output, and not of values in [0, 1].
    pub(crate) relative: bool,
}

impl Truth {
    /// What errors of an output are divided by.
    pub(crate) fn scale(&self, output: usize) -> f64 {
        let (name, values) = &self.outputs[output];
        let top = values.iter().fold(0.0, |top: f64, x| top.max(x.abs()));
        // Disparities have a unit.
        if (self.relative || *name == "disparity") && top > 0.0 { top } else { 1.0 }
    }

    /// Share of the pixels that see the source, where there is one.
    pub(crate) fn seen(&self) -> Option<f64> {
        let (_, coverage) = self.outputs.iter().find(|(name, _)| *name == "coverage")?;
        Some(share(coverage, |&coverage| coverage > 0.0))
    }

    /// For the reference.
    pub(crate) fn write(&self, arrays: &mut Arrays) -> Result<()> {
        for (index, (name, values)) in self.outputs.iter().enumerate() {
            arrays.add(&format!("truth.{name}"), Array1::from_vec(values.clone()))?;
            arrays.add(&format!("scale.{name}"), Array1::from_vec(vec![self.scale(index)]))?;
        }
        arrays.add("doubtful", Array1::from_vec(self.doubtful.clone()))
    }
}

/// The inputs of a stage, and its answer in the binary's own arithmetic and in float64.
pub(crate) trait Question {
    /// The stage, as the reference knows it.
    fn stage(&self) -> &'static str;

    /// What the library says, or the error that it refuses the inputs with.
    fn answer(&self) -> Result<Outputs<f32>, String>;

    /// Another answer, which must equal [`Question::answer`] to the last bit.
    fn equal(&self) -> Option<Result<Outputs<f32>, String>> {
        None
    }

    /// The same in float64, written plainly; `None` where the reference alone knows (the network).
    fn truth(&self) -> Option<Truth>;

    /// Whether some pixel must see the source, lest nothing be tested.
    fn must_be_seen(&self) -> bool {
        false
    }

    /// How many times longer than on ordinary inputs it takes, where that is in question.
    fn slower(&self) -> Option<f64> {
        None
    }

    /// The inputs, for the reference.
    fn write(&self, arrays: &mut Arrays) -> Result<()>;
}

/// One line of the table.
pub(crate) struct Case<'a> {
    /// What is swept; one panel of the plot.
    pub(crate) family: &'static str,
    /// How extreme it is, as the family measures it; not negative, may be infinite.
    pub(crate) extreme: f64,
    /// In words, where a number does not say it.
    pub(crate) name: String,
    pub(crate) question: Box<dyn Question + 'a>,
    /// Largest error allowed outside doubtful pixels: of values in [0, 1], else relative to the largest.
    pub(crate) bound: f64,
}

impl<'a> Case<'a> {
    pub(super) fn new(
        family: &'static str,
        extreme: f64,
        name: String,
        question: impl Question + 'a,
        bound: f64,
    ) -> Self {
        Self { family, extreme, name, question: Box::new(question), bound }
    }

    /// A family that no number orders: its cases count from 1.
    pub(super) fn listed<Q: Question + 'a>(
        family: &'static str,
        bound: f64,
        named: impl IntoIterator<Item = (impl Into<String>, Q)>,
    ) -> Vec<Self> {
        let named = named.into_iter().enumerate();
        named
            .map(|(index, (name, question))| Self::new(family, (index + 1) as f64, name.into(), question, bound))
            .collect()
    }
}

/// Whole powers of ten.
pub(super) fn decades(exponents: impl IntoIterator<Item = i32>) -> impl Iterator<Item = f64> {
    exponents.into_iter().map(|exponent| 10f64.powi(exponent))
}

/// Numbers that look random and are the same each time (splitmix64), in [0, 1).
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
