//! All cases.

use liveview::network::OrtNetwork;

use super::case::Case;
use super::rigs::TestRig;
use super::{blend, composite, composite_competing, network, rigs, sampling, select};

/// All cases of a rig and a model; in the short form, three of each family.
pub(crate) fn cases<'a>(rig: &'a TestRig, network: &'a std::cell::RefCell<OrtNetwork>, short: bool) -> Vec<Case<'a>> {
    let families = [
        rigs::families(rig),
        sampling::families(),
        blend::families(&rig.distances),
        composite::families(),
        composite_competing::families(),
        select::families(),
        network::families(network),
    ];
    let families = families.into_iter().flatten();
    if short { families.flat_map(ends_and_middle).collect() } else { families.flatten().collect() }
}

/// The first, the middle and the last of a family.
fn ends_and_middle<T>(family: Vec<T>) -> impl Iterator<Item = T> {
    let kept = [0, family.len() / 2, family.len().saturating_sub(1)];
    family.into_iter().enumerate().filter(move |(index, _)| kept.contains(index)).map(|(_, case)| case)
}
