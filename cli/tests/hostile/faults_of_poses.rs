//! What can be wrong with the poses of a scene.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::faults_of_photos::{NAMES, replace};
use crate::scene::{Chance, Format, llff, transforms};
use crate::scene_common::poses_bounds;

/// Numbers that no pose, size or depth may be.
const NUMBERS: [f64; 10] =
    [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0, -1.0, 1e308, -1e308, 1e-310, 4_294_967_296.5];

/// Applies one fault; what it is.
pub(crate) fn apply(scene: &Path, format: Format, chance: &mut Chance) -> String {
    let file = *chance.of(format.files());
    let path = scene.join(file);
    match chance.below(8) {
        0 => replace(&path, chance),
        1 => {
            let other = *chance.of(&Format::ALL);
            other.write(scene);
            format!("{other:?} as well")
        }
        2 => match fs::symlink_metadata(&path).ok().filter(|about| about.is_file() && about.len() < 1 << 20) {
            Some(about) => {
                let kept = chance.below(about.len() as usize + 1);
                let bytes = fs::read(&path).unwrap();
                fs::write(&path, &bytes[..kept]).unwrap();
                format!("{file} has {kept} bytes")
            }
            None => "nothing more".to_owned(),
        },
        _ => {
            if path.is_dir() || fs::remove_file(&path).is_err() {
                return "nothing more".to_owned();
            }
            format.write(scene);
            match format {
                Format::Transforms => of_transforms(&path, chance),
                Format::Text => of_text(&path, chance),
                Format::Binary => of_numbers(&path, 8, chance),
                Format::Llff if chance.below(3) == 0 => {
                    let views = chance.below(7);
                    poses_bounds(&path, &llff().into_iter().cycle().take(views).collect::<Vec<_>>());
                    format!("poses of {views} views")
                }
                // The header takes 128 bytes.
                Format::Llff => of_numbers(&path, 128, chance),
            }
        }
    }
}

/// Numbers, and what is none, in words that JSON and text have.
fn word(chance: &mut Chance) -> Value {
    let number = *chance.of(&NUMBERS);
    let words = [json!(number), json!("a"), json!([]), json!({}), json!(true), json!(-7), json!(1e30), Value::Null];
    chance.of(&words).clone()
}

fn of_transforms(path: &Path, chance: &mut Chance) -> String {
    let mut scene = transforms();
    let view = chance.below(5);
    let description = match chance.below(8) {
        0 => {
            let (field, value) = (*chance.of(&["fl_x", "cx", "w", "h", "near", "far", "frames"]), word(chance));
            let description = format!("{field} is {value}");
            scene[field] = value;
            description
        }
        1 => {
            let (row, column, value) = (chance.below(4), chance.below(4), word(chance));
            let description = format!("element {row}, {column} of pose {view} is {value}");
            scene["frames"][view]["transform_matrix"][row][column] = value;
            description
        }
        2 => {
            let names = ["", "images", "/dev/zero", "../../../etc/passwd", "images/\0.png", "images/3.png", "?", "~"];
            let long = "long/".repeat(2000);
            let name = *chance.of(&[&names[..], &NAMES[..], &[long.as_str()]].concat());
            scene["frames"][view]["file_path"] = json!(name);
            format!("file_path {view} is {:.30}", name.escape_default())
        }
        3 => {
            let (near, far) = *chance.of(&[(9.0, 2.0), (2.0, 2.0), (1e-300, 1e300), (-2.0, 8.0), (0.0, 1.0)]);
            (scene["near"], scene["far"]) = (json!(near), json!(far));
            format!("near is {near}, far {far}")
        }
        4 => {
            let frames = scene["frames"].as_array_mut().unwrap();
            let count = *chance.of(&[0, 1, 2, 3, 300]);
            *frames = frames.iter().cycle().take(count).cloned().collect();
            format!("{count} frames")
        }
        5 => {
            let field = *chance.of(&["file_path", "transform_matrix"]);
            scene["frames"][view][field] = word(chance);
            format!("{field} {view} is {}", scene["frames"][view][field])
        }
        6 => {
            let shift = *chance.of(&[0.0, 1e-12, 1e6, 1e30, 1e300]);
            for view in 0..5 {
                scene["frames"][view]["transform_matrix"][0][3] = json!(shift * view as f64);
            }
            format!("{shift:e} from camera to camera")
        }
        _ => {
            let (times, width) = *chance.of(&[(0.01, 64), (1.0, 6400), (1e9, 64), (1e-9, 64), (1.0, 1 << 30)]);
            (scene["fl_x"], scene["fl_y"], scene["w"]) = (json!(50.0 * times), json!(60.0 * times), json!(width));
            format!("focal length times {times}, {width} wide")
        }
    };
    let mut text = scene.to_string();
    // What JSON does not have, some programs write.
    if chance.below(6) == 0 {
        text = text.replace("null", chance.of::<&str>(&["NaN", "Infinity", "1e400"]));
    }
    fs::write(path, text).unwrap();
    description
}

/// One word of one line is another, or there twice, or gone.
fn of_text(path: &Path, chance: &mut Chance) -> String {
    let text = fs::read_to_string(path).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let line = 1 + chance.below(lines.len() - 1);
    let words = ["nan", "inf", "-inf", "1e308", "0", "-1", "99999999999999999999", "x", "", "1 1", "\u{feff}", "\0"];
    let mut parts: Vec<&str> = lines[line].split(' ').collect();
    let (at, new) = (chance.below(parts.len()), *chance.of(&words));
    parts[at] = new;
    let changed = parts.join(" ");
    match chance.below(5) {
        0 => lines.insert(line, lines[line].clone()),
        1 => drop(lines.remove(line)),
        _ => lines[line] = changed,
    }
    fs::write(path, lines.join("\n")).unwrap();
    format!("word {at} of line {line} of {} is {new:?}", path.file_name().unwrap().display())
}

/// One number of eight bytes is another.
fn of_numbers(path: &Path, from: usize, chance: &mut Chance) -> String {
    let mut bytes = fs::read(path).unwrap();
    let at = from + chance.below((bytes.len() - from).saturating_sub(7).max(1));
    let at = if from == 128 { at - at % 8 } else { at };
    let new = if chance.below(2) == 0 { chance.of(&NUMBERS).to_le_bytes() } else { (-1_i64 << 40).to_le_bytes() };
    let end = (at + 8).min(bytes.len());
    bytes[at..end].copy_from_slice(&new[..end - at]);
    fs::write(path, bytes).unwrap();
    format!("bytes {at} to {end} of {} are {new:?}", path.file_name().unwrap().display())
}
