//! The time steps of a rig: which frames of its cameras belong together.
//!
//! Where the cameras' frames have the same numbers, each number is a step. Where they do not, as time stamps of clocks of their own, the
//! steps are the frames of one camera, and each other gives its nearest. Steps without any frame there are none.

use std::collections::BTreeSet;

use liveview_common::args::frame_rate::FrameRate;

use super::feed::Feed;
use super::frame_names::Photos;

/// Numbers of all cameras, in numbers of the one with the most, above which they do not have the same ones.
const SHARED: f64 = 1.5;
/// Distance between two frames, in the usual one, from which on there is a gap.
const GAP: f64 = 1.5;
/// Share of the slowest camera's distance between frames from which on another is as slow, and share of the longest recording that a
/// camera must have made for the steps to be its own.
const ALIKE: (f64, f64) = (0.9, 0.5);

/// Puts steps, from 0 on, in the place of the numbers of named cameras; what there is to tell.
pub(super) fn align(mut cameras: Vec<(&str, &mut Photos)>) -> Vec<String> {
    let numbers: BTreeSet<usize> = cameras.iter().flat_map(|(_, photos)| photos.keys().copied()).collect();
    let most = cameras.iter().map(|(_, photos)| photos.len()).max().unwrap_or(0);
    let clock = clock(&cameras).filter(|_| numbers.len() as f64 > SHARED * most as f64);
    let (steps, reach) =
        clock.map_or((numbers, 0), |(camera, gap)| (cameras[camera].1.keys().copied().collect(), gap / 2));
    let (steps, mut notes, mut unused) = (steps.into_iter().collect::<Vec<_>>(), Vec::new(), 0);
    for (_, photos) in &mut cameras {
        let own = std::mem::take(*photos);
        let nearest = |&step: &usize| {
            let (before, after) = (own.range(..=step).next_back(), own.range(step..).next());
            let found = before.into_iter().chain(after).min_by_key(|(number, _)| number.abs_diff(step))?;
            (found.0.abs_diff(step) <= reach).then_some(found)
        };
        let used: Vec<_> = steps.iter().map(nearest).collect();
        unused += own.len() - used.iter().flatten().map(|(number, _)| number).collect::<BTreeSet<_>>().len();
        **photos = used.into_iter().enumerate().filter_map(|(step, found)| Some((step, found?.1.clone()))).collect();
    }
    if let Some((camera, _)) = clock {
        notes.push(format!(
            "the cameras' frames have numbers of their own: matched by these as times; a step for each frame of {}, of the others the nearest within {reach}; {unused} frames lie between",
            cameras[camera].0
        ));
    }
    let usual = gap(&steps).unwrap_or(1) as f64;
    let mut gaps = steps.windows(2).filter(|pair| (pair[1] - pair[0]) as f64 > GAP * usual);
    if let Some(first) = gaps.next() {
        let more = match gaps.count() {
            0 => String::new(),
            more => format!(", nor in {more} more gaps"),
        };
        notes.push(format!("no camera has a frame between {} and {}{more}: there the video jumps", first[0], first[1]));
    }
    notes
}

/// Lets videos of different frame rates deliver their frames at the times of the lowest, so that every step has one of each; what there
/// is to tell.
pub(super) fn match_rates<'a>(
    feeds: impl Iterator<Item = &'a mut Feed>,
    rates: &[(String, FrameRate)],
) -> Option<String> {
    let lowest = rates.iter().map(|(_, rate)| *rate).min()?;
    if rates.iter().all(|(_, rate)| *rate == lowest) {
        return None;
    }
    feeds.for_each(|feed| feed.set_rate(lowest));
    let rates = rates.iter().map(|(name, rate)| format!("{name} {rate}")).collect::<Vec<_>>().join(", ");
    Some(format!("the cameras have different frame rates ({rates}): matched by time, {lowest} steps per second"))
}

/// The camera whose frames are the steps where numbers are times, and the usual distance between these: the lowest rate, so that every step
/// has a frame of each; of those alike the camera with the most. `None` where frames are counted.
fn clock(cameras: &[(&str, &mut Photos)]) -> Option<(usize, usize)> {
    let span = |photos: &Photos| Some(photos.last_key_value()?.0 - photos.first_key_value()?.0);
    let longest = cameras.iter().filter_map(|(_, photos)| span(photos)).max()?;
    let long = |photos: &Photos| span(photos).is_some_and(|span| span as f64 >= ALIKE.1 * longest as f64);
    let timed = cameras.iter().enumerate().filter(|(_, (_, photos))| long(photos));
    let timed: Vec<(usize, usize, usize)> = timed
        .filter_map(|(camera, (_, photos))| {
            let gap = gap(&photos.keys().copied().collect::<Vec<_>>())?;
            Some((camera, gap, photos.len()))
        })
        .collect();
    let slowest = timed.iter().map(|&(_, gap, _)| gap).max().filter(|&gap| gap > 1)?;
    let alike = timed.into_iter().filter(|&(_, gap, _)| gap as f64 >= ALIKE.0 * slowest as f64);
    alike.rev().max_by_key(|&(.., frames)| frames).map(|(camera, gap, _)| (camera, gap))
}

/// The median of the distances between numbers in order, the lower of two.
fn gap(numbers: &[usize]) -> Option<usize> {
    let mut gaps: Vec<usize> = numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_unstable();
    gaps.get(gaps.len().saturating_sub(1) / 2).copied()
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    /// The steps that each camera has a frame for, by the number of that.
    fn aligned(cameras: &[&[usize]]) -> (Vec<Vec<(usize, usize)>>, Vec<String>) {
        let of =
            |numbers: &&[usize]| numbers.iter().map(|&number| (number, PathBuf::from(number.to_string()))).collect();
        let mut photos: Vec<Photos> = cameras.iter().map(of).collect();
        let notes = align(["a", "b", "c", "d"].into_iter().zip(photos.iter_mut()).collect());
        let number = |(step, path): (usize, PathBuf)| (step, path.to_str().unwrap().parse().unwrap());
        (photos.into_iter().map(|photos| photos.into_iter().map(number).collect()).collect(), notes)
    }

    #[test]
    fn numbers_that_the_cameras_share_are_the_steps() {
        let (steps, notes) = aligned(&[&[1, 2, 3, 4], &[1, 3, 4], &[2, 3, 4]]);
        assert_eq!(steps[1], [(0, 1), (2, 3), (3, 4)]);
        assert_eq!(steps[2][0], (1, 2));
        assert!(notes.is_empty(), "{notes:?}");
        let stamps = [1_000_000, 1_033_333, 1_066_667];
        let (steps, notes) = aligned(&[&stamps[..]; 3]);
        assert_eq!(steps[2], [0, 1, 2].map(|step| (step, stamps[step])));
        assert!(notes.is_empty(), "{notes:?}");
        // Counted, if from elsewhere: the frames of one are not those of the others.
        assert_eq!(aligned(&[&[0, 1, 2], &[0, 1, 2], &[100, 101, 102]]).0[2], [(3, 100), (4, 101), (5, 102)]);
    }

    #[test]
    fn gaps_are_told_and_no_steps() {
        let (steps, notes) = aligned(&[&[0, 1, 2, 99_999_999], &[0, 1, 2, 3, 7, 8]]);
        assert_eq!(steps[0], [(0, 0), (1, 1), (2, 2), (6, 99_999_999)]);
        assert_eq!(notes, ["no camera has a frame between 3 and 7, nor in 1 more gaps: there the video jumps"]);
    }

    #[test]
    fn time_stamps_of_several_clocks_are_matched_by_time() {
        let stamps = |start: usize, gap: usize, count: usize| (0..count).map(|k| start + k * gap).collect::<Vec<_>>();
        let (fast, slow, late) = (stamps(0, 33_333, 60), stamps(7, 40_000, 50), stamps(39_000, 40_001, 20));
        let (steps, notes) = aligned(&[&fast, &slow, &late, &stamps(5, 90_000, 3)]);
        assert_eq!(steps[1].len(), 50, "one that ended early, if slow, has no say");
        for camera in &steps[..3] {
            assert!(camera.iter().all(|&(step, number)| number.abs_diff(slow[step]) <= 20_000));
        }
        assert_eq!((steps[0].len(), steps[2].len(), steps[2][0]), (50, 20, (1, 39_000)));
        assert!(
            notes.len() == 1 && notes[0].contains("a step for each frame of b") && notes[0].contains("within 20000"),
            "{notes:?}"
        );
    }
}
