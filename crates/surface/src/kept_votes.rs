//! Votes of the depth of photos on each other, from target to target: a viewpoint that comes back to
//! photos that it has left finds them.

use std::cmp::Reverse;
use std::collections::HashMap;

use super::fusion::ConsistencyVotes;

/// Votes of the map of one photo on another's, by `[voter, judged]`.
pub type Votes = HashMap<[usize; 2], ConsistencyVotes>;

/// Votes, with the number of the request that used them last.
#[derive(Debug, Clone, Default)]
pub(super) struct KeptVotes {
    votes: HashMap<[usize; 2], (u64, ConsistencyVotes)>,
    requests: u64,
}

impl KeptVotes {
    /// The votes of the maps of these photos on that of photo `judged`; missing ones are computed.
    pub(super) fn get_or_compute(
        &mut self,
        judged: usize,
        voters: &[usize],
        compute: impl Fn(usize) -> ConsistencyVotes,
    ) -> Vec<&ConsistencyVotes> {
        self.requests += 1;
        for &voter in voters {
            let votes = self.votes.entry([voter, judged]).or_insert_with(|| (0, compute(voter)));
            votes.0 = self.requests;
        }
        voters.iter().map(|&voter| &self.votes[&[voter, judged]].1).collect()
    }

    /// Takes votes that were computed elsewhere.
    pub(super) fn extend(&mut self, votes: Votes) {
        self.requests += 1;
        self.votes.extend(votes.into_iter().map(|(pair, votes)| (pair, (self.requests, votes))));
    }

    /// Drops the votes on a photo's map and those of it.
    pub(super) fn drop_photo(&mut self, photo: usize) {
        self.votes.retain(|pair, _| !pair.contains(&photo));
    }

    /// Drops the votes between photos that are not all in `keep`, and of those not all in `soon` the ones
    /// used longest ago, beyond `bytes`.
    pub(super) fn retain(&mut self, keep: &[usize], soon: &[usize], bytes: usize) {
        self.votes.retain(|pair, _| pair.iter().all(|photo| keep.contains(photo)));
        let later = self.votes.iter().filter(|(pair, _)| !pair.iter().all(|photo| soon.contains(photo)));
        let mut later: Vec<_> = later.map(|(&pair, (used, votes))| (Reverse(*used), pair, votes.bytes())).collect();
        later.sort_unstable();
        let mut left = bytes;
        for (_, pair, bytes) in later {
            match left.checked_sub(bytes) {
                Some(rest) => left = rest,
                None => drop(self.votes.remove(&pair)),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::search::PhotoDepth;
    use liveview::geometry::{Camera, Intrinsics};

    #[test]
    fn votes_used_last_stay() {
        let intrinsics = Intrinsics { fx: 4.0, fy: 4.0, cx: 4.0, cy: 2.0, skew: 0.0 };
        let camera = Camera::new(intrinsics, 8, 4, DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let depth = PhotoDepth::unknown(camera.size());
        let compute = |_| ConsistencyVotes::new((&camera, &depth), (&camera, &depth));
        let mut votes = KeptVotes::default();
        votes.get_or_compute(0, &[1, 2, 3], compute);
        votes.get_or_compute(4, &[1, 2], compute);
        votes.get_or_compute(0, &[1], compute);
        let bytes = compute(0).bytes();
        let known = |votes: &KeptVotes| {
            let mut pairs: Vec<_> = votes.votes.keys().copied().collect();
            pairs.sort_unstable();
            pairs
        };
        votes.retain(&[0, 1, 2, 4], &[2, 4], bytes);
        assert_eq!(known(&votes), [[1, 0], [2, 4]], "used last, and needed soon");
        votes.drop_photo(0);
        assert_eq!(known(&votes), [[2, 4]]);
    }
}
