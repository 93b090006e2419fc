//! Statistics of pairs of photos: relative exposure and missing sharpness. They do not depend on
//! the target, so along a path they are computed once for a set of photos
//! (docs/design-log/speed.md).

use std::collections::{BTreeSet, HashMap};
use std::hash::Hash;

use rayon::prelude::*;

use crate::fusion::SurfaceView;

/// Two photos, by their textures' ids.
pub(super) type Pair = [u64; 2];

/// Σ d (p − s), Σ d² and the number of correspondences ([`super::sharpness`]).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct DetailSums {
    pub(crate) product: f64,
    pub(crate) square: f64,
    pub(crate) count: usize,
}

/// Statistics of a set of photos whose confirmed depth stays the same.
#[derive(Debug, Clone, Default)]
pub(crate) struct PairStatistics {
    /// Ids of their textures.
    photos: BTreeSet<u64>,
    /// Gains of the first photo that give it the exposure of the second.
    pub(crate) gains: HashMap<Pair, [f32; 3]>,
    /// Missing detail of the first photo by the second, multiplied by gains of these bits.
    pub(crate) sharpness: HashMap<(Pair, [u32; 3]), DetailSums>,
}

impl PairStatistics {
    /// Clears all statistics if they are of another set of photos.
    pub(crate) fn reset_unless_of(&mut self, views: &[SurfaceView<'_>]) {
        let photos: BTreeSet<u64> = views.iter().map(|view| view.view.texture.id()).collect();
        if photos != self.photos {
            *self = Self { photos, ..Self::default() };
        }
    }
}

/// The values of all keys; missing ones are computed, in parallel, and stored.
pub(super) fn get_or_compute<K: Copy + Eq + Hash + Sync, T: Copy + Send>(
    stored: &mut HashMap<K, T>,
    keys: &[K],
    compute: impl Fn(usize) -> T + Sync,
) -> Vec<T> {
    let missing: Vec<usize> = (0..keys.len()).filter(|&index| !stored.contains_key(&keys[index])).collect();
    let computed: Vec<T> = missing.par_iter().map(|&index| compute(index)).collect();
    stored.extend(missing.iter().map(|&index| keys[index]).zip(computed));
    keys.iter().map(|key| stored[key]).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn get_or_compute_stored_key_is_not_computed_again() {
        let computed = AtomicUsize::new(0);
        let square = |keys: &[usize], stored: &mut HashMap<usize, usize>| {
            get_or_compute(stored, keys, |index| {
                computed.fetch_add(1, Ordering::Relaxed);
                keys[index] * keys[index]
            })
        };
        let mut stored = HashMap::new();
        assert_eq!(square(&[3, 1, 2], &mut stored), [9, 1, 4]);
        assert_eq!(square(&[2, 4, 3], &mut stored), [4, 16, 9]);
        assert_eq!(computed.into_inner(), 4);
    }
}
