//! Faults of the photos in a scene folder.

use std::fs::{self, File};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use crate::scene::{Format, Random, random_photo};
use crate::scene_common::{crc32, picture};

/// Unusual names, which messages and lists must handle.
pub(crate) const NAMES: [&str; 7] =
    ["a,b.png", "a\nb.png", "\u{1b}[31mred.png", "-o.png", "2.PNG", " .png", "e\u{301}\u{202e}.png"];

/// Replaces a file or folder by something else; returns a description.
pub(crate) fn replace(path: &Path, random: &mut Random) -> String {
    if fs::remove_file(path).is_err() {
        let _ = fs::remove_dir_all(path);
    }
    let kind = *random.of(&["nothing", "folder", "pipe", "itself", "dangling", "/dev/zero", "empty", "sparse", "text"]);
    match kind {
        "nothing" => {}
        "folder" => fs::create_dir_all(path).unwrap(),
        "pipe" => assert!(Command::new("mkfifo").arg(path).status().unwrap().success()),
        "itself" => symlink(path.file_name().unwrap(), path).unwrap(),
        "dangling" => symlink("../nowhere/at all", path).unwrap(),
        "/dev/zero" => symlink(kind, path).unwrap(),
        "empty" => fs::write(path, "").unwrap(),
        "sparse" => File::create(path).unwrap().set_len(1 << 33).unwrap(),
        _ => fs::write(path, "\u{feff}this is not such a file\n".repeat(50)).unwrap(),
    }
    format!("{} is {kind}", path.file_name().unwrap().display())
}

/// Applies a random fault; returns a description.
pub(crate) fn apply(scene: &Path, _: Format, random: &mut Random) -> String {
    let path = random_photo(scene, random);
    let name = path.file_name().unwrap().display().to_string();
    // An earlier fault may have removed the file.
    let bytes = fs::symlink_metadata(&path).ok().filter(|metadata| metadata.is_file() && metadata.len() < 1 << 20);
    let Some(mut bytes) = bytes.map(|_| fs::read(&path).unwrap()) else { return "no further fault".to_owned() };
    // An earlier fault may have truncated the header.
    match if bytes.len() < 33 { 0 } else { random.below(9) } {
        0 | 1 => replace(&path, random),
        2 => {
            let new = *random.of(&NAMES);
            fs::rename(&path, path.with_file_name(new)).unwrap();
            format!("{name} is called {new:?}")
        }
        3 => {
            let kept = random.below(bytes.len());
            fs::write(&path, &bytes[..kept]).unwrap();
            format!("{name} has {kept} bytes")
        }
        4 => {
            let (width, height) = *random.of(&[(1, 1), (63, 48), (48, 64), (640, 480), (1, 4000)]);
            picture(&path, width, height);
            format!("{name} is {width}x{height}")
        }
        5 => {
            // A header that declares another width, with a valid checksum.
            let side = *random.of(&[0, 65535, 1 << 20, u32::MAX]);
            bytes[16..20].copy_from_slice(&side.to_be_bytes());
            let checksum = crc32(&bytes[12..29]);
            bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
            fs::write(&path, bytes).unwrap();
            format!("{name} declares a width of {side}")
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
        _ => match random.below(3) {
            0 => {
                fs::remove_dir_all(scene.join("images")).unwrap();
                picture(&path, 64, 48);
                format!("{name} is the only photo")
            }
            1 => replace(&scene.join("images"), random),
            _ => {
                fs::write(scene.join("images/more.png"), "not a photo").unwrap();
                fs::create_dir_all(scene.join("images_8")).unwrap();
                "an invalid more.png and an empty images_8".to_owned()
            }
        },
    }
}
