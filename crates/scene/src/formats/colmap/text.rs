//! COLMAP's text files: `#` starts a comment line. In `images.txt` each photo has two lines; the
//! second, its keypoints, may be empty.

use std::path::Path;

use glam::DVec3;

use crate::SceneError;
use crate::formats::colmap::{Model, ModelFormat, Registered, lens, rotation};
use crate::scene_file::text;
use liveview::geometry::Size;

pub(in crate::formats) const FORMAT: ModelFormat =
    ModelFormat { extension: "txt", cameras: read_cameras, images: read_images, points: read_points };

fn read_cameras(path: &Path, bytes: &[u8], model: &mut Model) -> Result<(), SceneError> {
    for line in records(&text(path, bytes)?) {
        let words = Words::new(path, line, "CAMERA_ID MODEL WIDTH HEIGHT PARAMS");
        let parameters = (4..words.len()).map(|i| words.parse(i)).collect::<Result<Vec<f64>, _>>()?;
        let lens = lens(path, words.get(1)?, Size::new(words.parse(2)?, words.parse(3)?), &parameters)?;
        if model.lenses.insert(words.parse(0)?, lens).is_some() {
            return Err(words.wrong(format!("camera {} is listed twice", words.get(0)?)));
        }
    }
    Ok(())
}

fn read_images(path: &Path, bytes: &[u8], model: &mut Model) -> Result<(), SceneError> {
    let text = text(path, bytes)?;
    let mut lines = text.lines().enumerate().peekable();
    while let Some((number, line)) = lines.next() {
        if is_blank(line) {
            continue;
        }
        let words = Words::new(path, (number, line), "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME");
        let quaternion = [words.parse(1)?, words.parse(2)?, words.parse(3)?, words.parse(4)?];
        let translation = DVec3::new(words.parse(5)?, words.parse(6)?, words.parse(7)?);
        words.get(9)?;
        // Names may contain spaces, several in a row too.
        let next = |rest: &'_ str| rest.trim_start().split_once(char::is_whitespace).map_or(0, |(_, rest)| rest.len());
        let start = (0..9).fold(0, |at, _| line.len() - next(&line[at..]));
        let name = line[start..].trim().to_owned();
        // Some programs leave the second lines out.
        let tracked = match lines.next_if(|(_, next)| !is_image(next)) {
            Some(line) => keypoints(path, line)?,
            None => Vec::new(),
        };
        let camera = words.parse(8)?;
        model.images.push(Registered { name, camera, rotation: rotation(quaternion), translation, tracked });
    }
    Ok(())
}

/// Whether a line is the first of a photo: a name after nine numbers.
fn is_image(line: &str) -> bool {
    let numbers = line.split_whitespace().take_while(|word| word.parse::<f64>().is_ok()).count();
    let words = line.split_whitespace().count();
    words > 9 && (numbers == 9 || numbers == words && !words.is_multiple_of(3))
}

fn keypoints(path: &Path, line: (usize, &str)) -> Result<Vec<(f64, f64, u64)>, SceneError> {
    // Some programs write a word there.
    if !line.1.contains(|c: char| c.is_ascii_digit()) {
        return Ok(Vec::new());
    }
    let words = Words::new(path, line, "X Y POINT3D_ID for each keypoint");
    if !words.len().is_multiple_of(3) {
        return Err(words.wrong(format!("{} words", words.len())));
    }
    let mut tracked = Vec::new();
    for i in (0..words.len()).step_by(3) {
        // -1: a keypoint without a 3D point.
        if words.get(i + 2)? != "-1" {
            tracked.push((words.parse(i)?, words.parse(i + 1)?, words.parse(i + 2)?));
        }
    }
    Ok(tracked)
}

fn read_points(path: &Path, bytes: &[u8], model: &mut Model) -> Result<(), SceneError> {
    for line in records(&text(path, bytes)?) {
        let words = Words::new(path, line, "POINT3D_ID X Y Z R G B ERROR TRACK");
        let position = DVec3::new(words.parse(1)?, words.parse(2)?, words.parse(3)?);
        if model.points.insert(words.parse(0)?, position).is_some() {
            return Err(words.wrong(format!("point {} is listed twice", words.get(0)?)));
        }
    }
    Ok(())
}

fn is_blank(line: &str) -> bool {
    line.trim().is_empty() || line.trim_start().starts_with('#')
}

fn records(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().filter(|(_, line)| !is_blank(line))
}

/// The words of one line.
struct Words<'a> {
    path: &'a Path,
    number: usize,
    words: Vec<&'a str>,
    expected: &'static str,
}

impl<'a> Words<'a> {
    fn new(path: &'a Path, (number, line): (usize, &'a str), expected: &'static str) -> Self {
        Self { path, number: number + 1, words: line.split_whitespace().collect(), expected }
    }

    fn len(&self) -> usize {
        self.words.len()
    }

    fn wrong(&self, what: String) -> SceneError {
        SceneError::malformed(self.path, format!("line {}: {what}", self.number), self.expected)
    }

    fn get(&self, index: usize) -> Result<&'a str, SceneError> {
        let short = || self.wrong(format!("{} words", self.words.len()));
        self.words.get(index).copied().ok_or_else(short)
    }

    fn parse<T: std::str::FromStr>(&self, index: usize) -> Result<T, SceneError> {
        let word = self.get(index)?;
        word.parse().map_err(|_| self.wrong(format!("word {} is \"{word}\"", index + 1)))
    }
}
