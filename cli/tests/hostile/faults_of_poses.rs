//! Faults of the poses of a scene.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::faults_of_photos::{NAMES, replace};
use crate::scene::{Format, Random, llff, transforms};
use crate::scene_common::poses_bounds;

/// Invalid or extreme values of poses, sizes and depths.
const NUMBERS: [f64; 10] =
    [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0, -1.0, 1e308, -1e308, 1e-310, 4_294_967_296.5];

/// Applies a random fault; returns a description.
pub(crate) fn apply(scene: &Path, format: Format, random: &mut Random) -> String {
    let file = *random.of(format.files());
    let path = scene.join(file);
    match random.below(8) {
        0 => replace(&path, random),
        1 => {
            let other = *random.of(&Format::ALL);
            other.write(scene);
            format!("{other:?} in addition")
        }
        2 => match fs::symlink_metadata(&path).ok().filter(|metadata| metadata.is_file() && metadata.len() < 1 << 20) {
            Some(metadata) => {
                let kept = random.below(metadata.len() as usize + 1);
                let bytes = fs::read(&path).unwrap();
                fs::write(&path, &bytes[..kept]).unwrap();
                format!("{file} has {kept} bytes")
            }
            None => "no further fault".to_owned(),
        },
        _ => {
            if path.is_dir() || fs::remove_file(&path).is_err() {
                return "no further fault".to_owned();
            }
            format.write(scene);
            match format {
                Format::Transforms => change_transforms(&path, random),
                Format::Text => change_text(&path, random),
                Format::Binary => change_number(&path, 8, random),
                Format::Llff if random.below(3) == 0 => {
                    let views = random.below(7);
                    poses_bounds(&path, &llff().into_iter().cycle().take(views).collect::<Vec<_>>());
                    format!("poses of {views} views")
                }
                // The header has 128 bytes.
                Format::Llff => change_number(&path, 128, random),
            }
        }
    }
}

/// A random JSON value.
fn json_value(random: &mut Random) -> Value {
    let number = *random.of(&NUMBERS);
    let values = [json!(number), json!("a"), json!([]), json!({}), json!(true), json!(-7), json!(1e30), Value::Null];
    random.of(&values).clone()
}

/// Changes a value of a `transforms.json`.
fn change_transforms(path: &Path, random: &mut Random) -> String {
    let mut scene = transforms();
    let view = random.below(5);
    let description = match random.below(8) {
        0 => {
            let (field, value) = (*random.of(&["fl_x", "cx", "w", "h", "near", "far", "frames"]), json_value(random));
            let description = format!("{field} is {value}");
            scene[field] = value;
            description
        }
        1 => {
            let (row, column, value) = (random.below(4), random.below(4), json_value(random));
            let description = format!("element {row}, {column} of pose {view} is {value}");
            scene["frames"][view]["transform_matrix"][row][column] = value;
            description
        }
        2 => {
            let names = ["", "images", "/dev/zero", "../../../etc/passwd", "images/\0.png", "images/3.png", "?", "~"];
            let long = "long/".repeat(2000);
            let name = *random.of(&[&names[..], &NAMES[..], &[long.as_str()]].concat());
            scene["frames"][view]["file_path"] = json!(name);
            format!("file_path {view} is {:.30}", name.escape_default())
        }
        3 => {
            let (near, far) = *random.of(&[(9.0, 2.0), (2.0, 2.0), (1e-300, 1e300), (-2.0, 8.0), (0.0, 1.0)]);
            (scene["near"], scene["far"]) = (json!(near), json!(far));
            format!("near is {near}, far {far}")
        }
        4 => {
            let frames = scene["frames"].as_array_mut().unwrap();
            let count = *random.of(&[0, 1, 2, 3, 300]);
            *frames = frames.iter().cycle().take(count).cloned().collect();
            format!("{count} frames")
        }
        5 => {
            let field = *random.of(&["file_path", "transform_matrix"]);
            scene["frames"][view][field] = json_value(random);
            format!("{field} {view} is {}", scene["frames"][view][field])
        }
        6 => {
            let shift = *random.of(&[0.0, 1e-12, 1e6, 1e30, 1e300]);
            for view in 0..5 {
                scene["frames"][view]["transform_matrix"][0][3] = json!(shift * view as f64);
            }
            format!("baseline {shift:e}")
        }
        _ => {
            let (times, width) = *random.of(&[(0.01, 64), (1.0, 6400), (1e9, 64), (1e-9, 64), (1.0, 1 << 30)]);
            (scene["fl_x"], scene["fl_y"], scene["w"]) = (json!(50.0 * times), json!(60.0 * times), json!(width));
            format!("focal length times {times}, {width} wide")
        }
    };
    let mut text = scene.to_string();
    // Not valid JSON, but written by some programs.
    if random.below(6) == 0 {
        text = text.replace("null", random.of::<&str>(&["NaN", "Infinity", "1e400"]));
    }
    fs::write(path, text).unwrap();
    description
}

/// Replaces a word of a text file, or duplicates or removes a line.
fn change_text(path: &Path, random: &mut Random) -> String {
    let text = fs::read_to_string(path).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let line = 1 + random.below(lines.len() - 1);
    let words = ["nan", "inf", "-inf", "1e308", "0", "-1", "99999999999999999999", "x", "", "1 1", "\u{feff}", "\0"];
    let mut parts: Vec<&str> = lines[line].split(' ').collect();
    let (at, new) = (random.below(parts.len()), *random.of(&words));
    parts[at] = new;
    let changed = parts.join(" ");
    match random.below(5) {
        0 => lines.insert(line, lines[line].clone()),
        1 => drop(lines.remove(line)),
        _ => lines[line] = changed,
    }
    fs::write(path, lines.join("\n")).unwrap();
    format!("word {at} of line {line} of {} is {new:?}", path.file_name().unwrap().display())
}

/// Replaces a number of eight bytes in a binary file, after the byte `from`.
fn change_number(path: &Path, from: usize, random: &mut Random) -> String {
    let mut bytes = fs::read(path).unwrap();
    let at = from + random.below((bytes.len() - from).saturating_sub(7).max(1));
    let at = if from == 128 { at - at % 8 } else { at };
    let new = if random.below(2) == 0 { random.of(&NUMBERS).to_le_bytes() } else { (-1_i64 << 40).to_le_bytes() };
    let end = (at + 8).min(bytes.len());
    bytes[at..end].copy_from_slice(&new[..end - at]);
    fs::write(path, bytes).unwrap();
    format!("bytes {at} to {end} of {} are {new:?}", path.file_name().unwrap().display())
}
