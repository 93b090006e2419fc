//! Extreme inputs of the network: constant, saturated, denormal, tiny and very long pictures.
//!
//! Textures hold no denormal values, since arithmetic with these is ten times as slow on some CPUs.

use std::cell::RefCell;
use std::time::Instant;

use anyhow::Result;
use liveview::geometry::MAX_SIDE;
use liveview::image::ImageRgb;
use liveview::network::{OrtNetwork, PlaneNetwork};
use liveview::warp::Texture;
use liveview_common::statistics::quantile;
use ndarray::{Array4, Axis};

use super::case::{Case, Expected, Outputs, Seeded, StageTest};
use crate::npz::Arrays;

/// Error bound relative to the largest logit: up to 1,728 products are summed, in any order.
const BOUND: f64 = 2e-6;

/// Height and width of most cases, pixels.
const SIZE: (usize, usize) = (64, 96);

/// Timed runs.
const REPETITIONS: usize = 9;
/// Runs before these, to warm up.
const WARM_UP: usize = 3;

struct NetworkCase<'a> {
    network: &'a RefCell<OrtNetwork>,
    /// `[1, 3V, h, w]`.
    hwv: Array4<f32>,
}

impl NetworkCase<'_> {
    fn infer(&self, hwv: &Array4<f32>) -> Result<Array4<f32>, String> {
        let mut network = self.network.borrow_mut();
        let (n, channels, height, width) = hwv.dim();
        let mut logits = Array4::zeros((n, channels / 3, height, width));
        network.infer(hwv.view(), logits.view_mut()).map_err(|error| error.to_string())?;
        Ok(logits)
    }

    fn seconds(&self, hwv: &Array4<f32>) -> Result<f64, String> {
        let started = Instant::now();
        self.infer(hwv)?;
        Ok(started.elapsed().as_secs_f64())
    }
}

impl StageTest for NetworkCase<'_> {
    fn stage(&self) -> &'static str {
        "network"
    }

    fn computed(&self) -> Result<Outputs<f32>, String> {
        Ok(vec![("logits", self.infer(&self.hwv)?.into_raw_vec_and_offset().0)])
    }

    fn expected(&self) -> Option<Expected> {
        None
    }

    /// The ratio of median times, interleaved with runs on noise of the same size.
    fn relative_time(&self) -> Option<f64> {
        let ordinary = noise(self.hwv.dim());
        let times = (0..WARM_UP + REPETITIONS).map(|_| Ok([self.seconds(&self.hwv)?, self.seconds(&ordinary)?]));
        let times: Vec<[f64; 2]> = times.collect::<Result<_, String>>().ok()?;
        let median = |which: usize| {
            let mut times: Vec<f64> = times[WARM_UP..].iter().map(|pair| pair[which]).collect();
            quantile(&mut times, 0.5)
        };
        Some(median(0) / median(1))
    }

    fn write(&self, arrays: &mut Arrays) -> Result<()> {
        arrays.add("colour", self.hwv.clone())
    }
}

fn noise((n, channels, height, width): (usize, usize, usize, usize)) -> Array4<f32> {
    let values = Seeded(3).units(n * channels * height * width);
    Array4::from_shape_vec((n, channels, height, width), values).expect("one value per element")
}

pub(super) fn families<'a>(network: &'a RefCell<OrtNetwork>) -> Vec<Vec<Case<'a>>> {
    let views = network.borrow().views();
    let shape = |(height, width): (usize, usize)| (1, 3 * views, height, width);
    let all = |value: f32| Array4::from_elem(shape(SIZE), value);
    let in_photo = |value: f32| Texture::new(&ImageRgb::new(1, 1, vec![value; 3]).expect("3 values")).pixel(0, 0)[0];
    let saturated = Array4::from_shape_fn(shape(SIZE), |(_, c, y, x)| f32::from(u8::from((c / 3 + y + x) % 2 == 0)));
    let mut one_view = noise(shape(SIZE));
    one_view.slice_axis_mut(Axis(1), (3..).into()).fill(0.0);
    let named = [
        ("noise", noise(shape(SIZE))),
        ("all 0", all(0.0)),
        ("all 0.5", all(0.5)),
        ("all 1", all(1.0)),
        ("0 and 1 side by side", saturated),
        ("one view alone", one_view),
        ("denormal (1e-40), in a photo", all(in_photo(1e-40))),
        ("2⁻¹²⁶, in a photo", all(in_photo(f32::MIN_POSITIVE))),
        ("2⁻⁶⁴, in a photo", all(in_photo((-64.0_f32).exp2()))),
        ("smallest picture, 8x8", noise(shape((8, 8)))),
        ("longest picture, 16384x8", noise(shape((8, MAX_SIDE)))),
    ];
    let named = named.map(|(name, hwv)| (name, NetworkCase { network, hwv }));
    vec![Case::listed("network", BOUND, named)]
}
