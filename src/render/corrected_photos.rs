//! Photos as they are warped: of the same exposure, and the softer ones sharpened. Sharpened photos
//! are kept from one target to the next: along a path most of them stay the same
//! (docs/design-log/speed.md).

use crate::warp::{Texture, WarpSource};

/// How the photo of a view is corrected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewCorrection {
    /// Factor of each colour channel.
    pub gains: [f32; 3],
    /// Share of its detail (4 times a pixel less its four neighbours) that is added to it.
    pub sharpening: f32,
}

/// Sets the gains of the views, and replaces the photos that are to be sharpened.
pub(crate) fn correct_photos<'a>(
    corrections: &[ViewCorrection],
    sources: &mut [WarpSource<'a>],
    sharpened: &'a mut SharpenedPhotos,
) {
    let photos = sources.iter().zip(corrections).map(|(source, view)| (source.texture, view.sharpening));
    sharpened.sharpen(photos.filter(|(_, amount)| *amount != 0.0));
    for (source, view) in sources.iter_mut().zip(corrections) {
        source.gains = view.gains;
        if view.sharpening != 0.0 {
            source.texture = sharpened.get(source.texture, view.sharpening);
        }
    }
}

/// The id of a photo, and the bits of the amount that it is sharpened by.
type Key = (u64, u32);

/// The photos sharpened for the last target.
#[derive(Debug, Default)]
pub(crate) struct SharpenedPhotos(Vec<(Key, Texture)>);

impl SharpenedPhotos {
    /// Sharpens these photos by these amounts, unless they are kept. Photos that are no longer
    /// needed are replaced: never more are kept than one call needed.
    fn sharpen<'a>(&mut self, photos: impl Iterator<Item = (&'a Texture, f32)> + Clone) {
        let needed: Vec<Key> = photos.clone().map(|(photo, amount)| key(photo, amount)).collect();
        for (photo, amount) in photos {
            let key = key(photo, amount);
            if self.0.iter().any(|(kept, _)| *kept == key) {
                continue;
            }
            let free = self.0.iter().position(|(kept, _)| !needed.contains(kept)).unwrap_or_else(|| {
                self.0.push(Default::default());
                self.0.len() - 1
            });
            photo.sharpen(amount, &mut self.0[free].1);
            self.0[free].0 = key;
        }
    }

    /// A photo that [`Self::sharpen`] sharpened.
    fn get(&self, photo: &Texture, amount: f32) -> &Texture {
        let key = key(photo, amount);
        &self.0.iter().find(|(kept, _)| *kept == key).expect("sharpened before").1
    }
}

fn key(photo: &Texture, amount: f32) -> Key {
    (photo.id(), amount.to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::ImageRgb;

    #[test]
    fn photos_are_sharpened_only_when_they_or_their_amounts_change() {
        let photo = |seed: usize| {
            let data = (0..3 * 12 * 9).map(|i| (i * seed % 31) as f32 / 30.0).collect();
            Texture::new(&ImageRgb::new(12, 9, data).unwrap())
        };
        let photos = [photo(7), photo(11), photo(7)];
        let mut sharpened = SharpenedPhotos::default();
        let mut ids = |requests: &[(usize, f32)]| {
            sharpened.sharpen(requests.iter().map(|&(index, amount)| (&photos[index], amount)));
            assert!(sharpened.0.len() <= 2);
            requests
                .iter()
                .map(|&(index, amount)| {
                    let (found, mut expected) = (sharpened.get(&photos[index], amount), Texture::default());
                    photos[index].sharpen(amount, &mut expected);
                    assert!((0..9).all(|y| (0..12).all(|x| found.pixel(x, y) == expected.pixel(x, y))), "{requests:?}");
                    found.id()
                })
                .collect::<Vec<_>>()
        };
        let first = ids(&[(0, 0.1), (1, 0.1)]);
        assert_eq!(ids(&[(1, 0.1), (0, 0.1)]), [first[1], first[0]]);
        let second = ids(&[(0, 0.2), (1, 0.1)]);
        assert!(second[0] != first[0] && second[1] == first[1]);
        let third = ids(&[(2, 0.2)]);
        assert!(!second.contains(&third[0]), "another photo of the same size");
        assert_eq!(ids(&[(2, 0.2), (1, 0.1)])[0], third[0]);
    }
}
