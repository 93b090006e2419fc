use std::io::{Cursor, Write};

use glam::{DMat3, DVec3};
use ndarray::{Array2, ShapeBuilder, array};
use ndarray_npy::{NpzWriter, WritableElement};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::*;
use crate::geometry::{Camera, Intrinsics, Size};
use crate::image::ImageRgb;
use crate::surface::Settings;
use crate::warp::Texture;

const KEY: DepthKey = DepthKey { digest: [7; 32], size: Size::new(7, 5), near: 2.0, far: 8.0 };

fn depth() -> PhotoDepth {
    let disparity = Array2::from_shape_fn((5, 7), |(y, x)| 0.125 + 0.375 * (7 * y + x) as f32 / 34.0);
    PhotoDepth { disparity, pixel: 0.0125 }
}

/// The file of a depth that [`KEY`] names.
fn whole() -> Vec<u8> {
    file::write(Cursor::new(Vec::new()), &KEY, &depth()).unwrap().into_inner()
}

/// A file of which two arrays are right, and this one is what it says.
fn with<T: WritableElement, D: ndarray::Dimension>(name: &str, array: &ndarray::Array<T, D>) -> Vec<u8> {
    let mut arrays = NpzWriter::new(Cursor::new(Vec::new()));
    arrays.add_array(name, array).unwrap();
    let PhotoDepth { disparity, pixel } = depth();
    if name != "key" {
        arrays.add_array("key", &ndarray::Array1::from_elem(32, 7_u8)).unwrap();
    }
    if name != "pixel" {
        arrays.add_array("pixel", &ndarray::arr0(pixel)).unwrap();
    }
    if name != "disparity" {
        arrays.add_array("disparity", &disparity).unwrap();
    }
    arrays.finish().unwrap().into_inner()
}

/// An archive of these files.
fn archive(entries: &[(&str, &[u8])], method: CompressionMethod) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in entries {
        zip.start_file(*name, SimpleFileOptions::default().compression_method(method)).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn npy<T: WritableElement, D: ndarray::Dimension>(array: &ndarray::Array<T, D>) -> Vec<u8> {
    let mut bytes = Vec::new();
    ndarray_npy::WriteNpyExt::write_npy(array, &mut bytes).unwrap();
    bytes
}

fn same(a: &PhotoDepth, b: &PhotoDepth) -> bool {
    let bits = |depth: &PhotoDepth| depth.disparity.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    a.pixel.to_bits() == b.pixel.to_bits() && a.disparity.dim() == b.disparity.dim() && bits(a) == bits(b)
}

#[track_caller]
fn assert_refused(bytes: &[u8], words: &[&str]) {
    let told = file::read(bytes, &KEY).unwrap_err().to_string();
    words.iter().for_each(|word| assert!(told.contains(word), "\"{word}\" is missing in: {told}"));
    assert!(told.contains("; expected ") && !told.contains('\n'), "{told}");
}

#[test]
fn what_is_written_comes_back() {
    assert!(same(&file::read(&whole(), &KEY).unwrap(), &depth()));
    // By columns, as numpy may store it.
    let mut columns = Array2::zeros((5, 7).f());
    columns.assign(&depth().disparity);
    assert!(same(&file::read(&with("disparity", &columns), &KEY).unwrap(), &depth()));
}

#[test]
fn wrong_arrays_are_named() {
    let map = depth().disparity;
    assert_refused(&with("disparity", &map.mapv(f64::from)), &["disparity: ", "float32 of shape [5, 7]"]);
    assert_refused(&with("disparity", &map.t().to_owned()), &["disparity: of shape [7, 5]", "[5, 7]"]);
    assert_refused(&with("disparity", &map.row(0).to_owned()), &["disparity: ", "float32 of shape [5, 7]"]);
    assert_refused(&with("pixel", &array![0.5_f32, 0.5]), &["pixel: ", "float32 of shape []"]);
    assert_refused(&with("key", &ndarray::Array1::from_elem(32, 8_u8)), &["key: of another depth"]);
    assert_refused(&with("key", &ndarray::Array1::from_elem(31, 7_u8)), &["key: of another depth"]);
    assert_refused(&with("else", &ndarray::arr0(1.0_f32)), &["4 arrays", "key, pixel and disparity"]);
    let (key, pixel) = (npy(&ndarray::Array1::from_elem(32, 7_u8)), npy(&ndarray::arr0(0.5_f32)));
    let entries: [(&str, &[u8]); 3] = [("key.npy", &key), ("pixel.npy", &pixel), ("depth.npy", &pixel)];
    assert_refused(&archive(&entries, CompressionMethod::Stored), &["disparity: ", "not found"]);
}

#[test]
fn poison_is_refused() {
    for (value, word) in
        [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (-1.0, "-1 "), (-0.001, "-0.001"), (0.6, "0.6"), (0.1, "0.1")]
    {
        let mut map = depth().disparity;
        map[(2, 3)] = value;
        assert_refused(&with("disparity", &map), &["disparity: ", word, "row 2, column 3", "between far and near"]);
    }
    for value in [f32::NAN, f32::INFINITY, -1.0, 0.0] {
        assert_refused(&with("pixel", &ndarray::arr0(value)), &["pixel: ", "a finite number above 0"]);
    }
}

/// Pickled objects, a shape of terabytes, a header that takes years to parse, and a megabyte of zeros in a thousand bytes.
#[test]
fn what_would_run_or_take_memory_is_refused() {
    let header = |text: &str| {
        let length = (text.len() as u16).to_le_bytes();
        [b"\x93NUMPY\x01\x00", &length[..], text.as_bytes()].concat()
    };
    let key = npy(&ndarray::Array1::from_elem(32, 7_u8));
    let pixel = npy(&ndarray::arr0(0.5_f32));
    let disparity = |bytes: &[u8], method| {
        archive(&[("key.npy", key.as_slice()), ("pixel.npy", pixel.as_slice()), ("disparity.npy", bytes)], method)
    };
    let stored = CompressionMethod::Stored;
    let pickled = header("{'descr': '|O', 'fortran_order': False, 'shape': (5, 7), }\n");
    assert_refused(&disparity(&[pickled, b"cos\nsystem\n".to_vec()].concat(), stored), &["disparity: ", "|O"]);
    let huge = header("{'descr': '<f4', 'fortran_order': False, 'shape': (1048576, 1048576), }\n");
    assert_refused(&disparity(&huge, stored), &["disparity: ", "float32 of shape [5, 7]"]);
    let nested = header(&format!("{}{}", "(".repeat(100), ")".repeat(100)));
    assert_refused(&disparity(&nested, stored), &["disparity: ", "100 brackets open"]);
    let bomb = disparity(&vec![0; 1 << 20], CompressionMethod::Deflated);
    assert!(bomb.len() < 4096, "{} bytes", bomb.len());
    assert_refused(&bomb, &["disparity: more than 4236 bytes"]);
}

/// A file that is cut short anywhere is refused; one of which a byte changed is refused or read as it was. Never a panic.
#[test]
fn damaged_files_never_change_a_depth() {
    let (whole, depth) = (whole(), depth());
    (0..whole.len()).for_each(|length| drop(file::read(&whole[..length], &KEY).unwrap_err()));
    let mut refused = 0;
    for at in 0..whole.len() {
        for change in [1, 0x10, 0x80, 0xFF] {
            let mut damaged = whole.clone();
            damaged[at] ^= change;
            match file::read(&damaged, &KEY) {
                Ok(read) => assert!(same(&read, &depth), "byte {at} changed by {change:#x}"),
                Err(_) => refused += 1,
            }
        }
    }
    // What else there is, such as dates, is not read.
    assert!(refused > 2 * whole.len(), "{refused} of {}", 4 * whole.len());
}

#[test]
fn everything_that_a_depth_depends_on_is_in_its_key() {
    let camera = |k: [f64; 5], x: f64, size: (usize, usize)| {
        let intrinsics = Intrinsics { fx: k[0], fy: k[1], cx: k[2], cy: k[3], skew: k[4] };
        Camera::new(intrinsics, size.0, size.1, DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0)).unwrap()
    };
    let digest = |changed: Option<usize>| {
        let mut values = vec![0.5; 3 * 35];
        changed.iter().for_each(|&at| values[at] = 0.500_000_06);
        PhotoDigest::new(&Texture::new(&ImageRgb::new(7, 5, values).unwrap()))
    };
    const K: [f64; 5] = [9.0, 9.0, 3.5, 2.5, 0.0];
    let (here, there, own) = (camera(K, 0.0, (7, 5)), camera(K, 0.1, (7, 5)), digest(None));
    let (settings, range) = (Settings::default(), (2.0, 8.0));
    let key =
        |photos: &[(&Camera, PhotoDigest)], range, settings: &Settings| DepthKey::new(photos, range, settings).digest;
    let pair = [(&here, own), (&there, own)];
    let mut keys = vec![key(&pair, range, &settings)];
    assert_eq!(keys[0], key(&pair, range, &settings), "the same twice");
    for range in [(2.0, 8.000_000_000_000_002), (1.999_999_999_999_999_8, 8.0), (2.0, f64::INFINITY)] {
        keys.push(key(&pair, range, &settings));
    }
    for at in [0, 52, 104] {
        keys.push(key(&[(&here, digest(Some(at))), (&there, own)], range, &settings));
        keys.push(key(&[(&here, own), (&there, digest(Some(at)))], range, &settings));
    }
    for entry in 0..5 {
        let mut k = K;
        k[entry] += 1e-12;
        keys.push(key(&[(&camera(k, 0.0, (7, 5)), own), (&there, own)], range, &settings));
    }
    for other in [camera(K, 1e-300, (7, 5)), camera(K, 0.0, (5, 7))] {
        keys.push(key(&[(&other, own), (&there, own)], range, &settings));
    }
    keys.push(key(&pair[..1], range, &settings));
    keys.push(key(&[pair[1], pair[0]], range, &settings));
    keys.push(key(&[pair[0], pair[1], pair[1]], range, &settings));
    let changes: [fn(&mut Settings); 4] = [
        |settings| settings.neighbours += 1,
        |settings| settings.spacing = 1.000_000_000_000_000_2,
        |settings| settings.jump = f32::from_bits(settings.jump.to_bits() + 1),
        |settings| settings.parts = 3,
    ];
    for change in changes {
        let mut settings = settings.clone();
        change(&mut settings);
        keys.push(key(&pair, range, &settings));
    }
    let all = keys.len();
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys.len(), all, "two keys are the same");
}

#[test]
fn a_folder_is_made_and_a_damaged_file_is_replaced() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("a/b");
    let cache = DepthCache::open(&folder).unwrap();
    assert!(cache.load(&KEY).unwrap().is_none());
    cache.store(&KEY, &depth()).unwrap();
    assert!(same(&cache.load(&KEY).unwrap().unwrap(), &depth()));
    let names: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(names, [folder.join(format!("{}.npz", "07".repeat(32)))]);
    for (bytes, word) in [(&b""[..], "no archive"), (&[0; 1 << 16], "more than 4236 bytes")] {
        std::fs::write(&names[0], bytes).unwrap();
        let told = cache.load(&KEY).unwrap_err();
        assert!(told.starts_with(names[0].to_str().unwrap()) && told.contains(word), "{told}");
        cache.store(&KEY, &depth()).unwrap();
        assert!(cache.load(&KEY).unwrap().is_some());
    }
    let mut poisoned = depth();
    poisoned.disparity[(0, 0)] = f32::NAN;
    let told = cache.store(&KEY, &poisoned).unwrap_err();
    assert!(told.contains("cannot be written: disparity: NaN"), "{told}");
    assert!(cache.load(&KEY).unwrap().is_some(), "the file that was there");
    let taken = root.path().join("file");
    std::fs::write(&taken, "").unwrap();
    DepthCache::open(&taken).unwrap_err();
}

/// The seeds of the fuzz target are files that numpy has written, one of them compressed and by columns.
#[test]
fn what_numpy_writes_is_read() {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/seeds/depth");
    for name in ["stored", "deflated_columns"] {
        let read = file::read(&std::fs::read(seeds.join(name)).unwrap(), &KEY).unwrap();
        assert!((&read.disparity - &depth().disparity).iter().all(|apart| apart.abs() < 1e-6), "{name}");
        assert_eq!(read.pixel, depth().pixel, "{name}");
    }
}
