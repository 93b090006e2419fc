//! The time steps of a rig: the photos in a camera's folder, by the numbers in their names, and which frames of its cameras belong
//! together.
//!
//! If the cameras number their frames alike, each number is a step. If not, the numbers are taken as times: the steps are the frames of
//! one camera, and each other camera contributes its nearest frame. Numbers without any frame are no steps.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::feed::Feed;
use crate::ffmpeg::FrameRate;
use liveview_files::has_extension;

const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];
/// Largest number of a frame: nanoseconds of 290 years.
const MAX_NUMBER: usize = i64::MAX as usize;
/// Most decimals of a time stamp in seconds: nanoseconds.
const MAX_DECIMALS: usize = 9;

/// Photos of a camera, by the numbers in their names or by time step.
pub(super) type Photos = BTreeMap<usize, PathBuf>;

/// The photos of a folder: by the last number in their names if these all differ, else by their order.
///
/// # Errors
/// The folder cannot be read, or a number is too large.
pub(super) fn photos_in(folder: &Path) -> Result<Photos> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<_>>>()?;
    paths.retain(|path| {
        let hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        !hidden && has_extension(path, &EXTENSIONS) && !path.is_dir()
    });
    paths.sort();
    let mut numbered = BTreeMap::new();
    for path in &paths {
        let Some(digits) = last_number(path) else { break };
        let Some(number) = digits.parse().ok().filter(|&number: &usize| number <= MAX_NUMBER) else {
            bail!("{}: the number in its name is larger than {MAX_NUMBER}", path.display());
        };
        numbered.insert(number, path.clone());
    }
    Ok(if numbered.len() == paths.len() { numbered } else { paths.into_iter().enumerate().collect() })
}

/// The digits of the last number in a name; a time stamp in seconds, such as `1305031102.175304`, is converted to nanoseconds.
fn last_number(path: &Path) -> Option<String> {
    let stem = path.file_stem()?.to_str()?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    if let Some((seconds, decimals)) = stem.split_once('.')
        && (3..=MAX_DECIMALS).contains(&decimals.len())
        && digits(seconds)
        && digits(decimals)
    {
        return Some(format!("{seconds}{decimals:0<MAX_DECIMALS$}"));
    }
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |at| at + stem[at..].chars().next().map_or(1, char::len_utf8));
    Some(stem[start..end].to_owned())
}

/// Cameras do not number their frames alike if all of them together have more than this many times the numbers of the one with the most.
const MAX_DISTINCT_NUMBERS: f64 = 1.5;
/// Distance between two frames, relative to the median, from which on it counts as a gap.
const GAP_RATIO: f64 = 1.5;
/// Share of the slowest camera's frame distance from which on another camera counts as equally slow.
const EQUAL_RATE: f64 = 0.9;
/// Share of the longest recording that a camera must cover for its frames to be the steps.
const MIN_COVERAGE: f64 = 0.5;

/// Replaces the numbers of named cameras by steps, from 0 on; returns notes for the user.
pub(super) fn align(mut cameras: Vec<(&str, &mut Photos)>) -> Vec<String> {
    let numbers: BTreeSet<usize> = cameras.iter().flat_map(|(_, photos)| photos.keys().copied()).collect();
    let most = cameras.iter().map(|(_, photos)| photos.len()).max().unwrap_or(0);
    let reference = reference_camera(&cameras).filter(|_| numbers.len() as f64 > MAX_DISTINCT_NUMBERS * most as f64);
    let (steps, reach) =
        reference.map_or((numbers, 0), |(camera, gap)| (cameras[camera].1.keys().copied().collect(), gap / 2));
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
    if let Some((camera, _)) = reference {
        notes.push(format!(
            "the cameras number their frames differently: the numbers are taken as times, each frame of {} is a step, with the nearest frame of the others within {reach}; {unused} frames are not used",
            cameras[camera].0
        ));
    }
    let median = median_gap(&steps).unwrap_or(1) as f64;
    let mut gaps = steps.windows(2).filter(|pair| (pair[1] - pair[0]) as f64 > GAP_RATIO * median);
    if let Some(first) = gaps.next() {
        let more = match gaps.count() {
            0 => String::new(),
            more => format!(", nor in {more} more gaps"),
        };
        notes.push(format!("no camera has a frame between {} and {}{more}: the video jumps there", first[0], first[1]));
    }
    notes
}

/// Makes videos of different frame rates deliver the frames at the times of the lowest rate, so that each has one for every step;
/// returns a note for the user.
pub(super) fn match_rates<'a>(
    feeds: impl Iterator<Item = &'a mut Feed>,
    rates: &[(String, FrameRate)],
) -> Option<String> {
    let lowest = FrameRate::lowest(rates.iter().map(|(_, rate)| *rate))?;
    if rates.iter().all(|(_, rate)| *rate == lowest) {
        return None;
    }
    feeds.for_each(|feed| feed.set_rate(lowest));
    let rates = rates.iter().map(|(name, rate)| format!("{name} {rate}")).collect::<Vec<_>>().join(", ");
    Some(format!("the cameras have different frame rates ({rates}): matched by time, {lowest} steps per second"))
}

/// The camera whose frames are the steps if numbers are times, and the median distance between its frames: one with the lowest rate, so
/// that each step has a frame of every camera, and of these the one with the most frames. `None` if numbers count frames.
fn reference_camera(cameras: &[(&str, &mut Photos)]) -> Option<(usize, usize)> {
    let span = |photos: &Photos| Some(photos.last_key_value()?.0 - photos.first_key_value()?.0);
    let longest = cameras.iter().filter_map(|(_, photos)| span(photos)).max()?;
    let long = |photos: &Photos| span(photos).is_some_and(|span| span as f64 >= MIN_COVERAGE * longest as f64);
    let timed = cameras.iter().enumerate().filter(|(_, (_, photos))| long(photos));
    let timed: Vec<(usize, usize, usize)> = timed
        .filter_map(|(camera, (_, photos))| {
            let gap = median_gap(&photos.keys().copied().collect::<Vec<_>>())?;
            Some((camera, gap, photos.len()))
        })
        .collect();
    let slowest = timed.iter().map(|&(_, gap, _)| gap).max().filter(|&gap| gap > 1)?;
    let equally_slow = timed.into_iter().filter(|&(_, gap, _)| gap as f64 >= EQUAL_RATE * slowest as f64);
    equally_slow.rev().max_by_key(|&(.., frames)| frames).map(|(camera, gap, _)| (camera, gap))
}

/// The median distance between consecutive numbers, the lower of two.
fn median_gap(numbers: &[usize]) -> Option<usize> {
    let mut gaps: Vec<usize> = numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_unstable();
    gaps.get(gaps.len().saturating_sub(1) / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        names.iter().for_each(|name| std::fs::write(folder.path().join(name), "").unwrap());
        folder
    }

    fn names(folder: &tempfile::TempDir) -> Vec<(usize, String)> {
        let photos = photos_in(folder.path()).unwrap().into_iter();
        photos.map(|(number, path)| (number, path.file_name().unwrap().to_str().unwrap().into())).collect()
    }

    #[test]
    fn photos_are_keyed_by_number_or_by_order() {
        let numbered = ["f2_10.jpg", "f2_9.jpg", "f2_12.PNG", "notes.txt", ".f2_1.jpg"];
        let expected = [(9, "f2_9.jpg"), (10, "f2_10.jpg"), (12, "f2_12.PNG")].map(|(k, n)| (k, n.to_owned()));
        assert_eq!(names(&folder(&numbered)), expected);
        let by_order = names(&folder(&[&numbered[..], &["last.png"]].concat()));
        assert_eq!((by_order.len(), by_order[3].clone()), (4, (3, "last.png".to_owned())));
    }

    #[test]
    fn time_stamps_in_seconds_become_nanoseconds() {
        let found = names(&folder(&["1700000000.900000.png", "1700000001.000000.png"]));
        let numbers: Vec<usize> = found.iter().map(|(number, _)| *number).collect();
        assert_eq!(numbers, [1_700_000_000_900_000_000, 1_700_000_001_000_000_000]);
    }

    #[test]
    fn too_large_number_is_refused() {
        for name in ["18446744073709551615.png", "9223372036854775808.png", "99999999999999999999999.png"] {
            let error = photos_in(folder(&["1.png", name]).path()).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("larger than 9223372036854775807"), "{error}");
        }
        assert_eq!(names(&folder(&["9223372036854775807.png"])).len(), 1);
    }
}

#[cfg(test)]
mod steps_tests {
    use std::path::PathBuf;

    use super::*;

    /// For each camera its steps with the number of the frame.
    fn aligned(cameras: &[&[usize]]) -> (Vec<Vec<(usize, usize)>>, Vec<String>) {
        let of =
            |numbers: &&[usize]| numbers.iter().map(|&number| (number, PathBuf::from(number.to_string()))).collect();
        let mut photos: Vec<Photos> = cameras.iter().map(of).collect();
        let notes = align(["a", "b", "c", "d"].into_iter().zip(photos.iter_mut()).collect());
        let number = |(step, path): (usize, PathBuf)| (step, path.to_str().unwrap().parse().unwrap());
        (photos.into_iter().map(|photos| photos.into_iter().map(number).collect()).collect(), notes)
    }

    #[test]
    fn shared_numbers_are_the_steps() {
        let (steps, notes) = aligned(&[&[1, 2, 3, 4], &[1, 3, 4], &[2, 3, 4]]);
        assert_eq!(steps[1], [(0, 1), (2, 3), (3, 4)]);
        assert_eq!(steps[2][0], (1, 2));
        assert!(notes.is_empty(), "{notes:?}");
        let stamps = [1_000_000, 1_033_333, 1_066_667];
        let (steps, notes) = aligned(&[&stamps[..]; 3]);
        assert_eq!(steps[2], [0, 1, 2].map(|step| (step, stamps[step])));
        assert!(notes.is_empty(), "{notes:?}");
        // Numbers that count frames: those of the third camera are later steps.
        assert_eq!(aligned(&[&[0, 1, 2], &[0, 1, 2], &[100, 101, 102]]).0[2], [(3, 100), (4, 101), (5, 102)]);
    }

    #[test]
    fn gaps_are_noted_and_are_no_steps() {
        let (steps, notes) = aligned(&[&[0, 1, 2, 99_999_999], &[0, 1, 2, 3, 7, 8]]);
        assert_eq!(steps[0], [(0, 0), (1, 1), (2, 2), (6, 99_999_999)]);
        assert_eq!(notes, ["no camera has a frame between 3 and 7, nor in 1 more gaps: the video jumps there"]);
    }

    #[test]
    fn time_stamps_are_matched_by_time() {
        let stamps = |start: usize, gap: usize, count: usize| (0..count).map(|k| start + k * gap).collect::<Vec<_>>();
        let (fast, slow, late) = (stamps(0, 33_333, 60), stamps(7, 40_000, 50), stamps(39_000, 40_001, 20));
        let (steps, notes) = aligned(&[&fast, &slow, &late, &stamps(5, 90_000, 3)]);
        assert_eq!(steps[1].len(), 50, "a slow camera that ended early is not the reference");
        for camera in &steps[..3] {
            assert!(camera.iter().all(|&(step, number)| number.abs_diff(slow[step]) <= 20_000));
        }
        assert_eq!((steps[0].len(), steps[2].len(), steps[2][0]), (50, 20, (1, 39_000)));
        assert!(
            notes.len() == 1 && notes[0].contains("each frame of b is a step") && notes[0].contains("within 20000"),
            "{notes:?}"
        );
    }
}
