use std::io::{Cursor, Write};
use std::path::Path;

use glam::{DMat3, DVec3};
use ndarray::{Array2, ShapeBuilder, array};
use super::*;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use crate::PhotoDisparity;
use liveview::geometry::{Camera, Intrinsics, Size};
use liveview::image::ImageRgb;
use liveview::warp::Texture;

const KEY: DepthKey = DepthKey { digest: [7; 32], size: Size::new(7, 5), near: 2.0, far: 8.0 };

fn depth() -> PhotoDisparity {
    let disparity = Array2::from_shape_fn((5, 7), |(y, x)| 0.125 + 0.375 * (7 * y + x) as f32 / 34.0);
    PhotoDisparity { disparity, disparity_per_pixel: 0.0125 }
}

/// A complete file of the depth of [`KEY`].
fn complete() -> Vec<u8> {
    write(&KEY, &depth()).unwrap()
}

/// A file with this array in place of the right one.
fn with<T: npy::Element, D: ndarray::Dimension>(name: &str, array: &ndarray::Array<T, D>) -> Vec<u8> {
    let PhotoDisparity { disparity, disparity_per_pixel } = depth();
    let right = [
        ("key", npy::bytes(&ndarray::Array1::from_elem(32, 7_u8))),
        ("pixel", npy::bytes(&ndarray::arr0(disparity_per_pixel))),
        ("disparity", npy::bytes(&disparity)),
    ];
    let others = right.into_iter().filter(|(other, _)| *other != name);
    npy::npz(std::iter::once((name, npy::bytes(array))).chain(others)).unwrap()
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

fn same(a: &PhotoDisparity, b: &PhotoDisparity) -> bool {
    let bits = |depth: &PhotoDisparity| depth.disparity.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    a.disparity_per_pixel.to_bits() == b.disparity_per_pixel.to_bits()
        && a.disparity.dim() == b.disparity.dim()
        && bits(a) == bits(b)
}

#[track_caller]
fn assert_refused(bytes: &[u8], words: &[&str]) {
    let message = read(bytes, &KEY).unwrap_err().to_string();
    words.iter().for_each(|word| assert!(message.contains(word), "\"{word}\" is missing in: {message}"));
    assert!(message.contains("; expected ") && !message.contains('\n'), "{message}");
}

#[test]
fn file_round_trip_gives_the_same_bits() {
    assert!(same(&read(&complete(), &KEY).unwrap(), &depth()));
    // In column order, as numpy may store it.
    let mut columns = Array2::zeros((5, 7).f());
    columns.assign(&depth().disparity);
    assert!(same(&read(&with("disparity", &columns), &KEY).unwrap(), &depth()));
}

#[test]
fn wrong_array_is_named_in_the_error() {
    let map = depth().disparity;
    assert_refused(&with("disparity", &map.mapv(f64::from)), &["disparity: ", "float32 of shape [5, 7]"]);
    assert_refused(&with("disparity", &map.t().to_owned()), &["disparity: of shape [7, 5]", "[5, 7]"]);
    assert_refused(&with("disparity", &map.row(0).to_owned()), &["disparity: ", "float32 of shape [5, 7]"]);
    assert_refused(&with("pixel", &array![0.5_f32, 0.5]), &["pixel: ", "float32 of shape []"]);
    assert_refused(&with("key", &ndarray::Array1::from_elem(32, 8_u8)), &["key: of another depth"]);
    assert_refused(&with("key", &ndarray::Array1::from_elem(31, 7_u8)), &["key: of another depth"]);
    assert_refused(&with("else", &ndarray::arr0(1.0_f32)), &["4 arrays", "key, pixel and disparity"]);
    let (key, pixel) = (npy::bytes(&ndarray::Array1::from_elem(32, 7_u8)), npy::bytes(&ndarray::arr0(0.5_f32)));
    let entries: [(&str, &[u8]); 3] = [("key.npy", &key), ("pixel.npy", &pixel), ("depth.npy", &pixel)];
    assert_refused(&archive(&entries, CompressionMethod::Stored), &["disparity: ", "not found"]);
}

#[test]
fn value_out_of_range_is_an_error() {
    for (value, word) in
        [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (-1.0, "-1 "), (-0.001, "-0.001"), (0.6, "0.6"), (0.1, "0.1")]
    {
        let mut map = depth().disparity;
        map[(2, 3)] = value;
        assert_refused(&with("disparity", &map), &["disparity: ", word, "row 2, column 3", "between far and near"]);
    }
    for value in [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e-38, 2e-8, 0.376, 1e38] {
        let words = ["pixel: ", &format!("{value:e}; expected "), " to 3.75e-1"];
        assert_refused(&with("pixel", &ndarray::arr0(value)), &words);
    }
    for value in [3e-8_f32, 0.375] {
        read(&with("pixel", &ndarray::arr0(value)), &KEY).unwrap();
    }
}

/// Pickled objects, a shape of terabytes, a header that takes years to parse, and a megabyte of
/// zeros in a thousand bytes.
#[test]
fn hostile_array_is_an_error() {
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

/// A truncated file is refused; one with a changed byte is refused or read unchanged. Never a
/// panic.
#[test]
fn damaged_file_never_changes_a_depth() {
    let (complete, depth) = (complete(), depth());
    (0..complete.len()).for_each(|length| drop(read(&complete[..length], &KEY).unwrap_err()));
    let mut refused = 0;
    for at in 0..complete.len() {
        for change in [1, 0x10, 0x80, 0xFF] {
            let mut damaged = complete.clone();
            damaged[at] ^= change;
            match read(&damaged, &KEY) {
                Ok(read) => assert!(same(&read, &depth), "byte {at} changed by {change:#x}"),
                Err(_) => refused += 1,
            }
        }
    }
    // The rest, such as dates, is not read.
    assert!(refused > 2 * complete.len(), "{refused} of {}", 4 * complete.len());
}

#[test]
fn key_depends_on_every_input_of_the_search() {
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
    let range = (2.0, 8.0);
    let key = |photos: &[(&Camera, PhotoDigest)], range| DepthKey::new(photos, range).digest;
    let pair = [(&here, own), (&there, own)];
    let mut keys = vec![key(&pair, range)];
    assert_eq!(keys[0], key(&pair, range), "the same twice");
    for range in [(2.0, 8.000_000_000_000_002), (1.999_999_999_999_999_8, 8.0), (2.0, f64::INFINITY)] {
        keys.push(key(&pair, range));
    }
    for at in [0, 52, 104] {
        keys.push(key(&[(&here, digest(Some(at))), (&there, own)], range));
        keys.push(key(&[(&here, own), (&there, digest(Some(at)))], range));
    }
    for entry in 0..5 {
        let mut k = K;
        k[entry] += 1e-12;
        keys.push(key(&[(&camera(k, 0.0, (7, 5)), own), (&there, own)], range));
    }
    for other in [camera(K, 1e-300, (7, 5)), camera(K, 0.0, (5, 7))] {
        keys.push(key(&[(&other, own), (&there, own)], range));
    }
    keys.push(key(&pair[..1], range));
    keys.push(key(&[pair[1], pair[0]], range));
    keys.push(key(&[pair[0], pair[1], pair[1]], range));
    let all = keys.len();
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys.len(), all, "two keys are the same");
}

#[test]
fn cache_creates_its_folder_and_replaces_damaged_files() {
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
        let message = cache.load(&KEY).unwrap_err();
        assert!(message.starts_with(names[0].to_str().unwrap()) && message.contains(word), "{message}");
        cache.store(&KEY, &depth()).unwrap();
        assert!(cache.load(&KEY).unwrap().is_some());
    }
    let mut poisoned = depth();
    poisoned.disparity[(0, 0)] = f32::NAN;
    let message = cache.store(&KEY, &poisoned).unwrap_err();
    assert!(message.contains("cannot be written: disparity: NaN"), "{message}");
    assert!(cache.load(&KEY).unwrap().is_some(), "the file from before");
    let taken = root.path().join("file");
    std::fs::write(&taken, "").unwrap();
    DepthCache::open(&taken).unwrap_err();
}

/// The seeds of the fuzz target were written by numpy, one of them compressed and in column order.
#[test]
fn file_written_by_numpy_is_read() {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fuzz/seeds/depth");
    for name in ["stored", "deflated_columns"] {
        let read = read(&std::fs::read(seeds.join(name)).unwrap(), &KEY).unwrap();
        assert!((&read.disparity - &depth().disparity).iter().all(|apart| apart.abs() < 1e-6), "{name}");
        assert_eq!(read.disparity_per_pixel, depth().disparity_per_pixel, "{name}");
    }
}
