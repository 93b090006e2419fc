//! A frame is the composite of what an observer of its batches is shown.

use glam::{DMat3, DVec3};
use liveview::layers::Layers;
use liveview::network::Alpha;
use liveview::render::{Accumulated, Batch, Blended, Competing, LayerSamples, RenderRequest, Renderer};
use liveview::warp::SourceView;

use crate::synthetic::{PseudorandomNetwork, camera, photo};

/// Two runs wide; the views end at different columns and rows of it.
const SIZE: (usize, usize) = (150, 20);

#[test]
fn a_frame_is_the_composite_of_its_batches() {
    let cameras = [-0.9, 0.7].map(|x| camera((140, 18), DMat3::IDENTITY, DVec3::new(x, 0.2 * x, 0.0)));
    let photos = [photo((140, 18), 3), photo((140, 18), 5)];
    let views: Vec<_> = cameras.iter().zip(&photos).map(|(camera, texture)| SourceView { camera, texture }).collect();
    let target = camera(SIZE, DMat3::IDENTITY, DVec3::ZERO);
    let layers = Layers::planes(&[1.0, 0.7, 0.5, 0.3, 0.1]).unwrap();
    for alpha in [Alpha::Independent, Alpha::Competing { scale: 1.5 }] {
        let mut rows: Vec<_> = (0..SIZE.1).map(|_| (Accumulated::new(SIZE.0), Competing::new(SIZE.0, 1.5))).collect();
        let mut index = 0;
        let mut observe = |batch: &Batch<'_>| {
            let (n, _, _, width) = batch.logits.dim();
            for k in 0..n {
                let [hwv, coverage, logits] =
                    [batch.hwv, batch.coverage, batch.logits].map(|values| values.index_axis_move(ndarray::Axis(0), k));
                let [hwv, coverage, logits] = [hwv, coverage, logits].map(|values| values.to_slice().unwrap());
                let samples = LayerSamples { logits, colour: hwv, coverage };
                for (y, (independent, competing)) in rows.iter_mut().enumerate() {
                    let mut blended = Blended::new(SIZE.0);
                    samples.blend(batch.weights, y * width, &mut blended);
                    let disparity = batch.disparity.index_axis(ndarray::Axis(0), k);
                    let disparity = disparity.row(y).to_vec();
                    independent.add(index, &blended, &disparity, index == 4);
                    competing.add(index, &logits[y * width..], &blended, &disparity);
                }
                index += 1;
            }
        };
        let mut renderer = Renderer::new(Box::new(PseudorandomNetwork::new(0.0)), alpha, 2);
        renderer.set_skip_uncovered(false);
        let mut request = RenderRequest::new(&views, &target, &layers);
        request.observer = Some(&mut observe);
        let frame = renderer.render(request).unwrap();
        assert_eq!(index, 5);
        for (y, (independent, competing)) in rows.into_iter().enumerate() {
            let row = if alpha == Alpha::Independent { independent } else { competing.finish() };
            for x in 0..SIZE.0 {
                let expected = [0, 1, 2].map(|c| row.rgb[c][x] as f32);
                assert_eq!(frame.raw().pixel(x, y), expected, "{alpha:?}: row {y}, column {x}");
                assert_eq!(frame.transmittance[(y, x)], row.transmittance[x] as f32);
                assert_eq!(frame.disparity[(y, x)], row.disparity[x] as f32);
            }
        }
        assert!(frame.transmittance.iter().any(|&t| t == 1.0) && frame.transmittance.iter().any(|&t| t < 1.0));
    }
}
