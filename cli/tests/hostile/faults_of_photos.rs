//! What can be wrong with the photos of a folder.

use std::fs::{self, File};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use crate::scene::{Chance, Format, a_photo};
use crate::scene_common::{crc32, picture};

/// Names that no message and no list may stumble over.
pub(crate) const NAMES: [&str; 7] =
    ["a,b.png", "a\nb.png", "\u{1b}[31mred.png", "-o.png", "2.PNG", " .png", "e\u{301}\u{202e}.png"];

/// Puts something else in a path's place; what it is.
pub(crate) fn replace(path: &Path, chance: &mut Chance) -> String {
    if fs::remove_file(path).is_err() {
        let _ = fs::remove_dir_all(path);
    }
    let kind = *chance.of(&["nothing", "folder", "pipe", "itself", "dangling", "/dev/zero", "empty", "sparse", "text"]);
    match kind {
        "nothing" => {}
        "folder" => fs::create_dir_all(path).unwrap(),
        "pipe" => assert!(Command::new("mkfifo").arg(path).status().unwrap().success()),
        "itself" => symlink(path.file_name().unwrap(), path).unwrap(),
        "dangling" => symlink("../nowhere/at all", path).unwrap(),
        "/dev/zero" => symlink(kind, path).unwrap(),
        "empty" => fs::write(path, "").unwrap(),
        "sparse" => File::create(path).unwrap().set_len(1 << 33).unwrap(),
        _ => fs::write(path, "\u{feff}this is no such file\n".repeat(50)).unwrap(),
    }
    format!("{} is {kind}", path.file_name().unwrap().display())
}

/// Applies one fault; what it is.
pub(crate) fn apply(scene: &Path, _: Format, chance: &mut Chance) -> String {
    let path = a_photo(scene, chance);
    let name = path.file_name().unwrap().display().to_string();
    // An earlier fault may have taken what this one needs.
    let bytes = fs::symlink_metadata(&path).ok().filter(|about| about.is_file() && about.len() < 1 << 20);
    let Some(mut bytes) = bytes.map(|_| fs::read(&path).unwrap()) else { return "nothing more".to_owned() };
    // What an earlier fault left of a photo may hold no header.
    match if bytes.len() < 33 { 0 } else { chance.below(9) } {
        0 | 1 => replace(&path, chance),
        2 => {
            let new = *chance.of(&NAMES);
            fs::rename(&path, path.with_file_name(new)).unwrap();
            format!("{name} is called {new:?}")
        }
        3 => {
            let kept = chance.below(bytes.len());
            fs::write(&path, &bytes[..kept]).unwrap();
            format!("{name} has {kept} bytes")
        }
        4 => {
            let (width, height) = *chance.of(&[(1, 1), (63, 48), (48, 64), (640, 480), (1, 4000)]);
            picture(&path, width, height);
            format!("{name} is {width}x{height}")
        }
        5 => {
            // A header that claims more, or nothing, with a checksum that is right.
            let side = *chance.of(&[0, 65535, 1 << 20, u32::MAX]);
            bytes[16..20].copy_from_slice(&side.to_be_bytes());
            let checksum = crc32(&bytes[12..29]);
            bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
            fs::write(&path, bytes).unwrap();
            format!("{name} claims to be {side} wide")
        }
        6 => {
            let other = path.with_extension("jpg");
            picture(&other, 64, 48);
            fs::rename(other, &path).unwrap();
            format!("{name} is a JPEG")
        }
        7 => {
            let moved = scene.join("elsewhere.png");
            fs::rename(&path, &moved).unwrap();
            symlink(&moved, &path).unwrap();
            format!("{name} is a link to a photo")
        }
        _ => match chance.below(3) {
            0 => {
                fs::remove_dir_all(scene.join("images")).unwrap();
                picture(&path, 64, 48);
                format!("only {name}")
            }
            1 => replace(&scene.join("images"), chance),
            _ => {
                fs::write(scene.join("images/more.png"), "no photo").unwrap();
                fs::create_dir_all(scene.join("images_8")).unwrap();
                "more.png and an empty images_8 beside".to_owned()
            }
        },
    }
}
