//! Folders that people have: other programs' layouts, photos of other formats or damaged, several descriptions.

use std::fs;
use std::io::Write;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use liveview_files::npy;
use liveview_scene::{Format, Scene, SceneOptions};
use ndarray::Array2;
use tempfile::tempdir;

use crate::scene_common::{Colmap, LLFF_ROW, assert_says, notes, picture, poses_bounds, write};

/// The number of views and parts of the notes, or parts of the error.
type Expected = Result<(usize, &'static [&'static str]), &'static [&'static str]>;

const MODEL: Colmap<'_> = Colmap { camera: Colmap::PINHOLE, names: &["a.png", "b.png", "c.png"] };

/// A COLMAP scene of three photos, all of which see ten points.
fn colmap(root: &Path) {
    MODEL.write_text(&root.join("sparse/0"));
    MODEL.names.iter().for_each(|name| picture(&root.join("images").join(name), 64, 48));
}

/// The same with photos of other files.
fn photos(root: &Path, change: impl Fn(&Path)) {
    colmap(root);
    MODEL.names.iter().for_each(|name| change(&root.join("images").join(name)));
}

/// Saves a photo in another format.
fn saved_as(path: &Path, extension: &str) {
    image::open(path).unwrap().to_rgb8().save(path.with_extension(extension)).unwrap();
    fs::remove_file(path).unwrap();
}

/// A JPEG of 48×64 pixels whose EXIF orientation turns it by a quarter.
fn turned(path: &Path) {
    let jpeg = path.with_extension("jpg");
    picture(&jpeg, 48, 64);
    let bytes = fs::read(&jpeg).unwrap();
    let exif = b"\xFF\xE1\0\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    write(&jpeg, [&bytes[..2], &exif[..], &bytes[2..]].concat());
    fs::remove_file(path).unwrap();
}

fn text(path: &Path, change: impl Fn(String) -> String) {
    let before = fs::read_to_string(path).unwrap();
    fs::write(path, change(before)).unwrap();
}

fn llff(root: &Path, array: Vec<u8>) {
    write(&root.join("poses_bounds.npy"), array);
    ["a", "b", "c"].iter().for_each(|name| picture(&root.join(format!("images/{name}.png")), 64, 48));
}

fn rows(columns: usize) -> Array2<f64> {
    // Of a row of 17 numbers those that one of 14 has.
    let has = |column: &usize| columns == 17 || *column >= 15 || column % 5 != 4;
    let row: Vec<f64> = (0..17).filter(has).map(|column| LLFF_ROW[column]).collect();
    Array2::from_shape_fn((3, columns), |(_, column)| row[column])
}

fn realestate10k(root: &Path, file: &str, photo: impl Fn(usize) -> String) {
    let line = |i: usize| format!("{} 0.8 1 0.5 0.5 0 0 1 0 0 {i} 0 1 0 0 0 0 1 0\n", 1000 + i);
    write(&root.join(file), format!("https://video\n{}", (0..3).map(line).collect::<String>()));
    (0..3).for_each(|i| picture(&root.join(photo(i)), 64, 48));
}

fn zip(root: &Path, folder: &str) {
    let mut archive = zip::ZipWriter::new(fs::File::create(root.join("scene.zip")).unwrap());
    for name in ["sparse/0/cameras.txt", "sparse/0/images.txt", "images/a.png", "images/b.png", "images/c.png"] {
        archive.start_file(format!("{folder}{name}"), zip::write::SimpleFileOptions::default()).unwrap();
        archive.write_all(&fs::read(root.join(name)).unwrap()).unwrap();
    }
    archive.finish().unwrap();
}

/// What the folder is, how it is made, the path in it that is opened, and what becomes of it.
type Case = (&'static str, fn(&Path), &'static str, Expected);

const CASES: &[Case] = &[
    ("WebP", |root| photos(root, |photo| saved_as(photo, "webp")), "", Ok((3, &[]))),
    ("TIFF", |root| photos(root, |photo| saved_as(photo, "tif")), "", Ok((3, &[]))),
    ("BMP", |root| photos(root, |photo| saved_as(photo, "bmp")), "", Ok((3, &[]))),
    (
        "HEIC",
        |root| photos(root, |photo| write(photo, b"\0\0\0\x18ftypheic\0\0\0\0")),
        "",
        Err(&["a.png: ", "HEIC is not supported", "magick mogrify -format jpg *.heic"]),
    ),
    (
        "AVIF",
        |root| photos(root, |photo| write(photo, b"\0\0\0\x18ftypavif\0\0\0\0")),
        "",
        Err(&["AVIF is not supported", "*.avif"]),
    ),
    (
        "pointers of LFS",
        |root| photos(root, |photo| write(photo, "version https://git-lfs.github.com/spec/v1\n")),
        "",
        Err(&["a pointer of Git LFS", "git lfs pull"]),
    ),
    (
        "an empty photo",
        |root| {
            colmap(root);
            write(&root.join("images/b.png"), "");
        },
        "",
        Ok((2, &["images/b.png is left out: ", "the file is empty"])),
    ),
    (
        "a cut PNG",
        |root| {
            colmap(root);
            let bytes = fs::read(root.join("images/b.png")).unwrap();
            write(&root.join("images/b.png"), &bytes[..bytes.len() - 20]);
        },
        "",
        Ok((2, &["images/b.png is left out: ", "before its end marker"])),
    ),
    (
        "a cut JPEG",
        |root| {
            photos(root, |photo| saved_as(photo, "jpg"));
            let bytes = fs::read(root.join("images/b.jpg")).unwrap();
            write(&root.join("images/b.jpg"), &bytes[..bytes.len() - 20]);
        },
        "",
        Ok((2, &["images/b.png is left out: ", "images/b.jpg", "before its end marker"])),
    ),
    (
        "JPEG with a video at its end",
        |root| {
            photos(root, |photo| saved_as(photo, "jpg"));
            let bytes = fs::read(root.join("images/b.jpg")).unwrap();
            write(&root.join("images/b.jpg"), [&bytes[..], &[7; 5000]].concat());
        },
        "",
        Ok((3, &[])),
    ),
    (
        "a photo of another aspect",
        |root| {
            colmap(root);
            picture(&root.join("images/b.png"), 48, 48);
        },
        "",
        Ok((2, &["images/b.png is left out: ", "the image is 48x48"])),
    ),
    ("sideways by EXIF", |root| photos(root, turned), "", Err(&["a.jpg: the image is 48x64", "EXIF orientation"])),
    ("shrunk in place", |root| photos(root, |photo| picture(photo, 32, 24)), "", Ok((3, &["intrinsics scaled"]))),
    (
        "two models",
        |root| {
            colmap(root);
            fs::rename(root.join("sparse/0"), root.join("sparse/1")).unwrap();
            Colmap { camera: Colmap::PINHOLE, names: &["a.png"] }.write_text(&root.join("sparse/0"));
        },
        "",
        Ok((3, &["2 COLMAP models: sparse/1 has most photos"])),
    ),
    (
        "images.txt without second lines",
        |root| {
            colmap(root);
            let keep = |line: &&str| line.contains("png") || line.starts_with('#');
            text(&root.join("sparse/0/images.txt"), |before| {
                before.lines().filter(keep).map(|l| format!("{l}\n")).collect()
            });
        },
        "",
        Ok((3, &[])),
    ),
    (
        "TODO in the second lines",
        |root| {
            colmap(root);
            let line = |line: &str| if line.contains(".png") { format!("{line}\nTODO\n") } else { String::new() };
            text(&root.join("sparse/0/images.txt"), |before| before.lines().map(line).collect());
        },
        "",
        Ok((3, &[])),
    ),
    (
        "two spaces in names",
        |root| {
            colmap(root);
            text(&root.join("sparse/0/images.txt"), |before| before.replace("a.png", "a  b.png"));
            fs::rename(root.join("images/a.png"), root.join("images/a  b.png")).unwrap();
        },
        "",
        Ok((3, &[])),
    ),
    (
        "damaged points",
        |root| {
            colmap(root);
            text(&root.join("sparse/0/points3D.txt"), |before| before + "99 1 2 x\n");
        },
        "",
        Ok((3, &["its points are not used: ", "points3D.txt"])),
    ),
    (
        "names of a folder that is not there",
        |root| {
            colmap(root);
            text(&root.join("sparse/0/images.txt"), |before| before.replace("a.png", "input/a.png"));
        },
        "",
        Ok((3, &["found under another name"])),
    ),
    (
        "COLMAP beside LLFF",
        |root| {
            colmap(root);
            poses_bounds(&root.join("poses_bounds.npy"), &[LLFF_ROW; 3]);
        },
        "",
        Ok((3, &["the folder also holds LLFF poses_bounds.npy: its poses are not read, COLMAP takes precedence"])),
    ),
    (
        "COLMAP beside LLFF, photos renamed by number",
        |root| {
            colmap(root);
            poses_bounds(&root.join("poses_bounds.npy"), &[LLFF_ROW; 3]);
            (0..3).for_each(|i| picture(&root.join(format!("images_8/image00{i}.png")), 16, 12));
        },
        "",
        Ok((3, &["photos are read from images_8", "taken in the order of the names"])),
    ),
    (
        "damaged LLFF beside COLMAP without photos",
        |root| {
            colmap(root);
            text(&root.join("sparse/0/images.txt"), |before| before.replace(".png", "_other.png"));
            poses_bounds(&root.join("poses_bounds.npy"), &[LLFF_ROW; 3]);
        },
        "",
        Ok((3, &["COLMAP is not read: ", "missing image"])),
    ),
    ("LLFF, float32", |root| llff(root, npy::bytes(&rows(17).mapv(|value| value as f32))), "", Ok((3, &[]))),
    (
        "LLFF, 14 columns",
        |root| llff(root, npy::bytes(&rows(14))),
        "",
        Err(&["lack size and focal length", "hwf_cxcy.npy"]),
    ),
    (
        "NeX",
        |root| {
            llff(root, npy::bytes(&rows(14)));
            let common = ndarray::array![[48.0, 64.0, 50.0], [30.0, 25.0, 60.0]];
            write(&root.join("hwf_cxcy.npy"), npy::bytes(&common));
        },
        "",
        Ok((3, &[])),
    ),
    (
        "LLFF, sizes with fractions",
        |root| {
            let mut rows = rows(17);
            rows.column_mut(4).fill(47.75);
            llff(root, npy::bytes(&rows));
        },
        "",
        Ok((3, &[])),
    ),
    (
        "LLFF and a thumbnail",
        |root| {
            llff(root, npy::bytes(&rows(17)));
            picture(&root.join("images/thumb.png"), 10, 10);
        },
        "",
        Ok((3, &["of another size than the photos, left out: thumb.png"])),
    ),
    ("RealEstate10K", |root| realestate10k(root, "0a1b.txt", |i| format!("0a1b/{}.png", 1000 + i)), "", Ok((3, &[]))),
    (
        "RealEstate10K, us",
        |root| realestate10k(root, "cameras.txt", |i| format!("frames/{}us.png", 1000 + i)),
        "",
        Ok((3, &[])),
    ),
    (
        "a zip",
        |root| {
            colmap(root);
            zip(root, "");
        },
        "scene.zip",
        Ok((3, &[])),
    ),
    (
        "a folder in a zip",
        |root| {
            colmap(root);
            zip(root, "my scan/");
        },
        "scene.zip",
        Ok((3, &["the scene is in the folder "])),
    ),
    ("no zip", |root| write(&root.join("scene.zip"), "PK"), "scene.zip", Err(&["scene.zip: cannot be read"])),
    (
        "photos beside the folder",
        |root| {
            let camera = |(i, name): (usize, &&str)| {
                format!(
                    r#"{{"id": {i}, "img_name": "{name}", "width": 64, "height": 48, "position": [{i}, 0, 0],
                    "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 50, "fy": 60}}"#
                )
            };
            let cameras: Vec<String> = ["a", "b", "c"].iter().enumerate().map(camera).collect();
            write(&root.join("model/cameras.json"), format!("[{}]", cameras.join(",")));
            ["a", "b", "c"].iter().for_each(|name| picture(&root.join(format!("photos/{name}.jpg")), 64, 48));
        },
        "model",
        Ok((3, &["../photos/a.jpg for a"])),
    ),
    ("photos without poses", |root| picture(&root.join("a.jpg"), 64, 48), "", Err(&["1 photos, but no camera poses"])),
    (
        "Bundler",
        |root| write(&root.join("bundle.out"), "# Bundle file v0.3"),
        "",
        Err(&["a file .out is not supported", "Bundler"]),
    ),
    (
        "RealityCapture without a camera",
        |root| write(&root.join("a.csv"), "#name,x,y,alt,yaw,pitch,roll,f\n"),
        "",
        Err(&["a.csv: no views; expected at least one"]),
    ),
    (
        "NeuS",
        |root| write(&root.join("cameras_sphere.npz"), "PK"),
        "",
        Err(&["cameras_sphere.npz", "decomposeProjectionMatrix"]),
    ),
    ("Polycam", |root| picture(&root.join("keyframes/images/1.jpg"), 64, 48), "", Err(&["ns-process-data polycam"])),
    (
        "RealityCapture's table of positions",
        |root| write(&root.join("a.csv"), "#name,x,y,alt\na.png,1,2,3\n"),
        "",
        Err(&["a file .csv", "RealityCapture (RealityScan): export \"Internal/External camera parameters\""]),
    ),
];

/// Opens what `make` writes in a new folder.
fn check(what: &str, make: impl Fn(&Path), path: &str, expected: Expected) {
    let root = tempdir().unwrap();
    make(root.path());
    match (Scene::open(&root.path().join(path), &SceneOptions::default()), expected) {
        (Ok(scene), Ok((count, says))) => {
            assert_eq!(scene.views.len(), count, "{what}: {:?}", scene.notes);
            assert_says(&format!("{what}: {}", notes(&scene)), says);
            for view in 0..count {
                assert_eq!(scene.load_image(view).unwrap().size(), scene.views[view].camera.size(), "{what}");
            }
        }
        (Err(error), Err(says)) => assert_says(&format!("{what}: {error}"), says),
        (found, expected) => panic!("{what}: {:?}, expected {expected:?}", found.map(|scene| scene.notes)),
    }
}

#[test]
fn folders_that_people_have_are_read_or_refused_in_words() {
    CASES.iter().for_each(|(what, make, path, expected)| check(what, make, path, *expected));
}

#[test]
fn options_choose_the_format_and_turn_photos() {
    let root = tempdir().unwrap();
    colmap(root.path());
    poses_bounds(&root.path().join("poses_bounds.npy"), &[LLFF_ROW; 3]);
    let options = SceneOptions { format: Some("llff".parse().unwrap()), ..SceneOptions::default() };
    assert_eq!(Scene::open(root.path(), &options).unwrap().format, Format::Llff);
    let options = SceneOptions { format: Some(Format::Spaces), ..SceneOptions::default() };
    assert_says(&Scene::open(root.path(), &options).unwrap_err().to_string(), &["holds no Spaces models.json"]);
    assert!("obj".parse::<Format>().unwrap_err().contains("transforms, colmap, llff"));

    let root = tempdir().unwrap();
    photos(root.path(), turned);
    let options = SceneOptions { exif_rotate: true, ..SceneOptions::default() };
    let scene = Scene::open(root.path(), &options).unwrap();
    let stored = liveview::image::load(scene.views[0].image_path()).unwrap();
    let upright = scene.load_image(0).unwrap();
    // A quarter turn to the right: the lower left corner becomes the upper left one.
    assert_eq!((upright.size(), upright.pixel(0, 0)), (scene.views[0].camera.size(), stored.pixel(0, 63)));
}

#[test]
fn transparent_pixels_are_composited_on_the_background() {
    let root = tempdir().unwrap();
    photos(root.path(), |photo| {
        let mut pixels = image::open(photo).unwrap().to_rgba8();
        pixels.put_pixel(0, 0, image::Rgba([9, 9, 9, 0]));
        pixels.put_pixel(1, 0, image::Rgba([51, 51, 51, 102]));
        pixels.save(photo).unwrap();
    });
    for (background, colours) in [(None, [1.0, 0.68]), (Some([0.0, 0.5, 1.0]), [0.0, 0.08])] {
        let scene = Scene::open(root.path(), &SceneOptions { background, ..SceneOptions::default() }).unwrap();
        let photo = scene.load_image(0).unwrap();
        assert!((0..2).all(|x| (photo.pixel(x, 0)[0] - colours[x]).abs() < 1e-6), "{:?}", photo.pixel(1, 0));
        assert_eq!(scene.background(), Some(background.unwrap_or([1.0; 3])));
        assert_says(&notes(&scene), &["transparent pixels composited"]);
    }
}

#[test]
fn large_photos_are_reduced_by_default() {
    let root = tempdir().unwrap();
    let model = Colmap { camera: "PINHOLE 2400 1600 2000 2000 1200 800", names: &["a.png"] };
    model.write_text(&root.path().join("sparse/0"));
    picture(&root.path().join("images/a.png"), 2400, 1600);
    let scene = Scene::open(root.path(), &SceneOptions::default()).unwrap();
    assert_eq!(scene.views[0].camera.size().to_string(), "1897x1265");
    assert_says(&notes(&scene), &["large photos scaled down", "2400x1600 → 1897x1265", "width 2400 would take"]);
    let options = SceneOptions { width: Some(2400), ..SceneOptions::default() };
    assert_eq!(Scene::open(root.path(), &options).unwrap().views[0].camera.width(), 2400);
}

/// Three cameras that are turned by 0.1 about y and shifted along x, as `cam_from_world`.
fn poses() -> [(DMat3, DVec3); 3] {
    [0.0, 1.0, 2.0].map(|i| (DMat3::from_rotation_y(0.1 * i), DVec3::new(0.2 * i, 0.1, -0.3)))
}

fn three_photos(root: &Path) {
    ["a", "b", "c"].iter().for_each(|name| picture(&root.join(format!("images/{name}.jpg")), 64, 48));
}

/// Opens a folder of another program, and compares its cameras with [`poses`] and fx, fy, cx, cy.
fn assert_same_cameras(what: &str, root: &Path, expected: [f64; 4]) {
    three_photos(root);
    let scene = Scene::open(root, &SceneOptions::default()).unwrap();
    assert_eq!(scene.views.len(), 3, "{what}");
    for (view, (rotation, translation)) in scene.views.iter().zip(poses()) {
        let camera = view.native_camera();
        let k = camera.intrinsics();
        let centre = -(rotation.transpose() * translation);
        let found = [k.fx, k.fy, k.cx, k.cy];
        assert!(found.iter().zip(expected).all(|(found, one)| (found - one).abs() < 1e-6), "{what}: {k:?}");
        assert!(camera.rotation().abs_diff_eq(rotation, 1e-6), "{what}: {}", camera.rotation());
        assert!(camera.centre().abs_diff_eq(centre, 1e-6), "{what}: {}", camera.centre());
    }
}

#[test]
fn cameras_of_other_programs_are_equal() {
    let named = || ["a", "b", "c"].into_iter().zip(poses());
    let numbers = |m: DMat3| m.transpose().to_cols_array().map(|value| value.to_string());

    let root = tempdir().unwrap();
    let cameras = named().map(|(name, (rotation, translation))| {
        let centre = -(rotation.transpose() * translation);
        let m = numbers(rotation.transpose());
        format!(
            r#"{{"img_name": "{name}", "width": 64, "height": 48, "position": [{}, {}, {}], "fx": 50, "fy": 60,
                "rotation": [[{}], [{}], [{}]]}}"#,
            centre.x,
            centre.y,
            centre.z,
            m[..3].join(","),
            m[3..6].join(","),
            m[6..].join(",")
        )
    });
    write(&root.path().join("cameras.json"), format!("[{}]", cameras.collect::<Vec<_>>().join(",")));
    assert_same_cameras("3D Gaussian Splatting", root.path(), [50.0, 60.0, 32.0, 24.0]);

    let root = tempdir().unwrap();
    let cameras = named().map(|(name, (rotation, translation))| {
        let (m, c) = (numbers(rotation.transpose()), -(rotation.transpose() * translation));
        let row = |i: usize| format!("{} {}", m[3 * i..3 * i + 3].join(" "), c[i]);
        let matrix = format!("{} {} {} 0 0 0 1", row(0), row(1), row(2));
        format!(r#"<camera id="0" sensor_id="7" label="{name}"><transform>{matrix}</transform></camera>"#)
    });
    let sensor = r#"<sensor id="7"><calibration type="frame"><resolution width="64" height="48"/><f>60</f><cx>-2</cx>
        <cy>1</cy><b1>-10</b1></calibration></sensor>"#;
    let cameras = cameras.collect::<String>();
    let text = format!(
        r#"<document><chunk><sensors>{sensor}</sensors><cameras>{cameras}<camera id="9" label="d"/></cameras></chunk></document>"#
    );
    write(&root.path().join("cameras.xml"), text);
    assert_same_cameras("Metashape", root.path(), [50.0, 60.0, 30.0, 25.0]);
}

/// A `reconstruction.json` of the three photos with this lens, before it a model of one photo.
fn opensfm(root: &Path, lens: &str) {
    three_photos(root);
    let shots = ["a", "b", "c"].into_iter().zip(poses()).map(|(name, (rotation, translation))| {
        let turn = DQuat::from_mat3(&rotation).to_scaled_axis().to_array();
        let translation = translation.to_array();
        format!(r#""{name}.jpg": {{"rotation": {turn:?}, "translation": {translation:?}, "camera": "v2 64 48"}}"#)
    });
    let shots = shots.collect::<Vec<_>>().join(",");
    let camera = format!(r#""v2 64 48": {{"width": 64, "height": 48, {lens}}}"#);
    let small = r#"{"cameras": {}, "shots": {"a.jpg": {}}}"#;
    let text = format!(r#"[{small}, {{"cameras": {{{camera}}}, "shots": {{{shots}}}, "points": {{}}}}]"#);
    write(&root.join("opensfm/reconstruction.json"), text);
}

/// RealityCapture's table of the three photos; `lens` from f on. The angles are those of the vendor's matrix, whose
/// second row is −cos p sin h, −cos p cos h, −sin p and whose third column −cos p sin r, −sin p, −cos p cos r.
fn realitycapture(root: &Path, header: &str, lens: &str) {
    three_photos(root);
    let rows = ["a", "b", "c"].into_iter().zip(poses()).map(|(name, (rotation, translation))| {
        let (row, column) = (rotation.row(1), rotation.z_axis);
        let angles = [(-row.x).atan2(-row.y), (-row.z).asin(), (-column.x).atan2(-column.z)].map(f64::to_degrees);
        let [centre, angles] = [(-(rotation.transpose() * translation)).to_array(), angles]
            .map(|numbers| numbers.map(|number| number.to_string()).join(","));
        format!("{name}.jpg,{centre},{angles},{lens}\n")
    });
    write(&root.join("scan.csv"), format!("#cameras 3\n{header}\n{}", rows.collect::<String>()));
}

const COLUMNS: &str = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2";
/// f of 50 pixels for a side of 64 that stands for 36; the principal point 2 to the left and 1 down.
const PINHOLE: &str = "28.125,-0.03125,0.015625";

#[test]
fn cameras_and_lenses_of_opensfm_and_realitycapture_are_equal() {
    let brown = r#""projection_type": "brown", "focal_x": 0.78125, "focal_y": 0.9375, "c_x": -0.03125, "c_y": 0.015625,
        "k1": 0.1, "k2": 0.2, "k3": 0.3, "p1": 0.01, "p2": 0.02"#;
    let root = tempdir().unwrap();
    opensfm(root.path(), brown);
    assert_same_cameras("OpenSfM", root.path(), [50.0, 60.0, 30.0, 25.0]);
    let expected = |k3| {
        let of =
            [("k1", 0.1), ("k2", 0.2), ("k3", k3), ("k4", 0.0), ("k5", 0.0), ("k6", 0.0), ("p1", 0.01), ("p2", 0.02)];
        ("FULL_OPENCV", of)
    };
    let scene = Scene::open(root.path(), &SceneOptions::default()).unwrap();
    assert_eq!(scene.views[0].distortion(), expected(0.3));
    assert_says(&notes(&scene), &["of 2 models the largest is read, of 3 photos"]);

    for (header, columns) in [("heading", "f,px,py"), ("yaw", "f_35mm,px_norm,py_norm")] {
        let root = tempdir().unwrap();
        let header = COLUMNS.replace("heading", header).replace("f,px,py", columns);
        realitycapture(root.path(), &header, &format!("{PINHOLE},0.1,0.2,0.3,0,0.02,0.01"));
        assert_same_cameras("RealityCapture", root.path(), [50.0, 50.0, 30.0, 25.0]);
        let scene = Scene::open(root.path(), &SceneOptions::default()).unwrap();
        assert_eq!(scene.views[0].distortion(), expected(0.3));
    }
}

#[test]
fn lenses_and_tables_that_are_not_read_are_refused_in_words() {
    let lens = |of: &str| format!(r#""projection_type": "{of}", "focal": 0.78125, "k1": 0.1"#);
    for (of, expected) in [
        ("perspective", Ok((3, &["undistorted on load"][..]))),
        ("fisheye", Ok((3, &["undistorted on load"][..]))),
        ("spherical", Err(&["the lens spherical of v2 64 48 is not supported", "opensfm undistort"][..])),
        ("fisheye62", Err(&["the lens fisheye62 of v2 64 48 is not supported"][..])),
    ] {
        check(of, |root| opensfm(root, &lens(of)), "", expected);
    }
    let focal = &["v2 64 48: focal is missing; expected a number"];
    check("no focal length", |root| opensfm(root, r#""k1": 0"#), "", Err(focal));
    let file = |text: &'static str| {
        move |root: &Path| {
            three_photos(root);
            write(&root.join("reconstruction.json"), text);
        }
    };
    check(
        "no model",
        file("[]"),
        "",
        Err(&["reconstruction.json: the file holds no model; expected a list of models"]),
    );
    check("no shots", file(r#"[{"cameras": {}}]"#), "", Err(&["the model: shots is missing; expected an object"]));
    let nameless = r#"[{"cameras": {}, "shots": {"a.jpg": {"camera": "x"}}}]"#;
    check("no camera", file(nameless), "", Err(&["a.jpg: camera is \"x\"; expected the name of one of cameras"]));

    for (lens, expected) in [
        ("0,0,0,0,0,0", Ok((3, &[][..]))),
        ("0.1,0.2,0.3,0,0,0", Ok((3, &["undistorted on load"][..]))),
        ("0.1,0.2,0.3,0.4,0,0", Err(&["the lens of images/a.jpg, of Brown4", "align with the model Brown3"][..])),
        ("0.1,0,0,0,0,0", Err(&["perhaps a division model", "export undistorted photos"][..])),
        ("0.1,x,0,0,0,0", Err(&["line 3: k2 is \"x\"; expected a number"][..])),
    ] {
        check(lens, |root| realitycapture(root, COLUMNS, &format!("{PINHOLE},{lens}")), "", expected);
    }
    let no_centre = COLUMNS.replace(",x,", ",u,");
    let expected: Expected = Err(&["line 3: x is missing; expected a number"]);
    check("no x", |root| realitycapture(root, &no_centre, PINHOLE), "", expected);
}
