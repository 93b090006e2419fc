//! What pairs of photos tell of their exposure and sharpness. None of it depends on the target, so along a path it is computed once
//! for a set of photos (docs/experiments.md, "Along a path").

use std::collections::{BTreeSet, HashMap};
use std::hash::Hash;

use rayon::prelude::*;

use crate::surface::fusion::SurfaceView;

/// Two photos, by their textures' ids.
pub(crate) type Pair = [u64; 2];

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
    /// Gains of the first photo that make it like the second.
    pub(crate) gains: HashMap<Pair, [f32; 3]>,
    /// What the second photo, multiplied by gains of these bits, says of the first one's sharpness.
    pub(crate) sharpness: HashMap<(Pair, [u32; 3]), DetailSums>,
}

impl PairStatistics {
    /// Forgets everything unless it is of these very photos.
    pub(crate) fn keep_of(&mut self, views: &[SurfaceView<'_>]) {
        let photos: BTreeSet<u64> = views.iter().map(|view| view.view.texture.id()).collect();
        if photos != self.photos {
            *self = Self { photos, ..Self::default() };
        }
    }
}

/// The values of all keys; those that are not kept yet are computed, in parallel.
pub(crate) fn kept_or<K: Copy + Eq + Hash + Sync, T: Copy + Send>(
    kept: &mut HashMap<K, T>,
    keys: &[K],
    compute: impl Fn(usize) -> T + Sync,
) -> Vec<T> {
    let missing: Vec<usize> = (0..keys.len()).filter(|&index| !kept.contains_key(&keys[index])).collect();
    let computed: Vec<T> = missing.par_iter().map(|&index| compute(index)).collect();
    kept.extend(missing.iter().map(|&index| keys[index]).zip(computed));
    keys.iter().map(|key| kept[key]).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn what_is_kept_is_not_computed_again() {
        let computed = AtomicUsize::new(0);
        let square = |keys: &[usize], kept: &mut HashMap<usize, usize>| {
            kept_or(kept, keys, |index| {
                computed.fetch_add(1, Ordering::Relaxed);
                keys[index] * keys[index]
            })
        };
        let mut kept = HashMap::new();
        assert_eq!(square(&[3, 1, 2], &mut kept), [9, 1, 4]);
        assert_eq!(square(&[2, 4, 3], &mut kept), [4, 16, 9]);
        assert_eq!(computed.into_inner(), 4);
    }
}
