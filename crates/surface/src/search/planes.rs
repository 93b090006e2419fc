//! A photo by colour plane, as the plane sweep and the aggregation read it.

use liveview::warp::{RUN, Texture};

/// Colour planes of a photo. Rows are padded so that a run of [`RUN`] may begin in any column.
pub(crate) struct Planes {
    pub(crate) width: usize,
    pub(crate) height: usize,
    stride: usize,
    rgb: [Vec<f32>; 3],
}

impl Planes {
    pub(crate) fn new(texture: &Texture) -> Self {
        let (width, height) = (texture.width(), texture.height());
        let (stride, texels) = (width + RUN, texture.upper_and_lower().0);
        let mut rgb = [(); 3].map(|()| vec![0.0; stride * height]);
        for y in 0..height {
            let row = &texels[(y + 1) * texture.stride() as usize + 1..][..width];
            for (channel, plane) in rgb.iter_mut().enumerate() {
                plane[y * stride..].iter_mut().zip(row).for_each(|(value, texel)| *value = texel[channel]);
            }
        }
        Self { width, height, stride, rgb }
    }

    /// Row `y` of a channel, without its padding.
    pub(super) fn row(&self, channel: usize, y: usize) -> &[f32] {
        &self.rgb[channel][y * self.stride..][..self.width]
    }

    /// Run of row `y` of a channel, from column `x` on.
    #[inline(always)]
    pub(super) fn run(&self, channel: usize, y: usize, x: usize) -> &[f32; RUN] {
        self.rgb[channel][y * self.stride + x..][..RUN].try_into().expect("a run")
    }
}
