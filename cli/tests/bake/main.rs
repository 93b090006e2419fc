//! `liveview bake`.

#[path = "../common/mod.rs"]
mod common;

use std::fs;

use common::Folders;
use common::viewer::described;
use serde_json::Value;

/// The page that `bake` writes with these arguments, its description, and what was printed.
fn baked(folders: &Folders, arguments: &[&str]) -> (String, Value, String) {
    let out = folders.out("page.html");
    let run = folders.liveview("bake", &["-o", &out]).args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&run.stderr).into_owned() + &String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{said}");
    let page = fs::read_to_string(&out).unwrap();
    let description = described(&page);
    (page, description, said)
}

#[test]
fn page_holds_photos_depth_and_nothing_that_loads() {
    let folders = Folders::new();
    let (page, description, said) = baked(&folders, &["--target", "1"]);
    assert!(said.contains("5 photos"), "{said}");
    let views = description["views"].as_array().unwrap();
    assert_eq!(views.len(), 5);
    for (index, view) in views.iter().enumerate() {
        assert_eq!((&view["held_out"], view["depth"].is_string()), (&(index == 1).into(), index != 1));
        assert!(view["photo"].as_str().unwrap().starts_with("/9j/"), "a JPEG");
        assert_eq!((&view["camera"]["w"], &view["camera"]["fl_x"]), (&64.into(), &60.0.into()));
    }
    assert_eq!(
        (&description["near"], &description["far"], &description["start"]),
        (&2.0.into(), &8.0.into(), &2.into())
    );
    assert!(
        page.contains("default-src 'none'; script-src 'sha256-")
            && page.contains("img-src blob: data: ; connect-src ; base-uri")
    );
    for loads in ["http:", "https:", " src=", "@import", "onclick=", "onload=", "onerror="] {
        assert!(!page.contains(loads), "{loads}");
    }
}

#[test]
fn names_cannot_end_the_description() {
    let folders = Folders::new();
    let name = "<!--<script>'\"&.png";
    fs::rename(folders.photo(1), folders.scene().join("images").join(name)).unwrap();
    folders.write_scene(5, "images/1.png", &format!("images/{}", name.replace('"', "\\\"")));
    let (page, description, _) = baked(&folders, &[]);
    assert!(description["views"].as_array().unwrap().iter().any(|view| view["name"] == name));
    assert!(!page.contains(name) && !page.contains("<!--<"));
}

#[test]
fn what_does_not_fit_is_left_out_and_said() {
    let folders = Folders::new();
    // Photos that hardly compress.
    let noise = |view: u32| {
        image::RgbImage::from_fn(640, 480, |x, y| {
            let mut value = (x * 7919 + y * 104_729 + view * 31) ^ 0x9E37;
            value = value.wrapping_mul(2_654_435_761);
            image::Rgb([(value >> 8) as u8, (value >> 16) as u8, (value >> 24) as u8])
        })
    };
    (0..5).for_each(|view| noise(view).save(folders.photo(view as usize)).unwrap());
    folders.write_scene(
        5,
        "\"fl_x\": 60, \"fl_y\": 60, \"cx\": 32, \"cy\": 24, \"w\": 64, \"h\": 48",
        "\"fl_x\": 600, \"w\": 640, \"h\": 480",
    );
    let (page, description, said) = baked(&folders, &["--max-mb", "2"]);
    let kept = description["views"].as_array().unwrap().len();
    assert!((2..5).contains(&kept) && page.len() <= 2_000_000, "{kept} {}", page.len());
    assert!(said.contains("JPEG of quality 68") && said.contains("left out") && said.contains("--max-mb"), "{said}");
    fs::remove_file(folders.out("page.html")).unwrap();
    let mut refused = folders.liveview("bake", &["--max-mb", "1", "-o", &folders.out("page.html")]);
    folders.assert_refused(&mut refused, &["--max-mb", "two photos take more", "--width"]);
}

#[test]
fn outputs_that_cannot_be_written_are_refused_before_any_work() {
    let folders = Folders::new();
    let photo = folders.photo(1).to_str().unwrap().to_owned();
    folders.assert_refused(&mut folders.liveview("bake", &["-o", &photo]), &["a photo of the scene"]);
    let out = folders.out("page.html");
    folders.assert_refused(&mut folders.liveview("bake", &["--target", "0,1,2,3,4", "-o", &out]), &["held out"]);
    folders.assert_refused(&mut folders.liveview("bake", &["--max-mb", "0", "-o", &out]), &["--max-mb"]);
}
