//! Arrays in numpy's formats: `.npy`, and `.npz`, a zip archive of them. Files that are read are not trusted.

use std::io::{Cursor, Write};

use ndarray::{Array, ArrayRef, Dimension, IxDyn, ShapeBuilder};
use zip::result::ZipResult;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// A number of an array.
pub trait Element: Copy {
    /// Its type in a header, little-endian.
    const DTYPE: &'static str;

    /// From its bytes.
    fn from_bytes(bytes: &[u8]) -> Self;

    /// Its bytes.
    fn bytes(self) -> impl IntoIterator<Item = u8>;
}

macro_rules! elements {
    ($($number:ty, $dtype:literal;)*) => {$(
        impl Element for $number {
            const DTYPE: &'static str = $dtype;

            fn from_bytes(bytes: &[u8]) -> Self {
                Self::from_le_bytes(bytes.try_into().expect("the bytes of one number"))
            }

            fn bytes(self) -> impl IntoIterator<Item = u8> {
                self.to_le_bytes()
            }
        }
    )*};
}

elements! { u8, "|u1"; i64, "<i8"; f32, "<f4"; f64, "<f8"; }

/// The array in the bytes of a `.npy` file, in standard layout. Its shape is compared with the length of the file
/// before memory is allocated.
///
/// # Errors
///
/// What is wrong with the header, the type, the number of sides or the length, in one line.
pub fn read<T: Element, D: Dimension>(bytes: &[u8]) -> Result<Array<T, D>, String> {
    let (start, length) = match *bytes {
        [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _, a, b, ..] => (10, usize::from(u16::from_le_bytes([a, b]))),
        [0x93, b'N', b'U', b'M', b'P', b'Y', _, _, a, b, c, d, ..] => (12, u32::from_le_bytes([a, b, c, d]) as usize),
        _ => return Err("no header of numpy".to_owned()),
    };
    let (header, data) = bytes[start..].split_at_checked(length).ok_or("an incomplete header")?;
    let header = std::str::from_utf8(header).map_err(|_| "a header that is not text")?;
    let field = |name: &str| Some(header.split_once(name)?.1.trim_start_matches([':', ' ']));
    let dtype = field("'descr'").and_then(|rest| rest.strip_prefix('\'')?.split('\'').next());
    if dtype != Some(T::DTYPE) {
        return Err(format!("elements of type {}", dtype.unwrap_or("unknown")));
    }
    let sides = field("'shape'").and_then(|rest| rest.strip_prefix('(')?.split_once(')')).map(|(sides, _)| sides);
    let sides = sides.unwrap_or("?").split(',').map(str::trim).filter(|side| !side.is_empty()).map(str::parse);
    let sides = sides.collect::<Result<Vec<usize>, _>>().map_err(|_| "a header without shape")?;
    let expected = sides.iter().try_fold(size_of::<T>(), |bytes, &side| bytes.checked_mul(side));
    if expected != Some(data.len()) {
        return Err(format!("{} bytes for shape {sides:?}", data.len()));
    }
    let values = data.chunks_exact(size_of::<T>()).map(T::from_bytes).collect();
    let in_columns = field("'fortran_order'").is_some_and(|rest| rest.starts_with("True"));
    let array = Array::from_shape_vec(IxDyn(&sides).set_f(in_columns), values).map_err(|error| error.to_string())?;
    let array = array.into_dimensionality::<D>().map_err(|_| format!("the array has shape {sides:?}"))?;
    Ok(array.as_standard_layout().into_owned())
}

/// The bytes of an array's `.npy` file.
pub fn bytes<T: Element, D: Dimension>(array: &ArrayRef<T, D>) -> Vec<u8> {
    let sides: String = array.shape().iter().map(|side| format!("{side}, ")).collect();
    let header = format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({sides}), }}", T::DTYPE);
    // The data begins at a multiple of 64 bytes.
    let length = (10 + header.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{header:<width$}\n", width = length - 1).bytes());
    bytes.extend(array.iter().flat_map(|&value| value.bytes()));
    bytes
}

/// The bytes of a `.npz` file of these arrays: their names, and the bytes of their `.npy` files.
///
/// # Errors
///
/// Those of writing the archive, such as one that is too large.
pub fn npz<N: AsRef<str>>(arrays: impl IntoIterator<Item = (N, Vec<u8>)>) -> ZipResult<Vec<u8>> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in arrays {
        let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        archive.start_file(format!("{}.npy", name.as_ref()), stored.large_file(bytes.len() > u32::MAX as usize))?;
        archive.write_all(&bytes)?;
    }
    Ok(archive.finish()?.into_inner())
}

#[cfg(test)]
mod tests {
    use ndarray::{Array0, Array1, Array2, aview0};

    use super::*;

    #[test]
    fn written_arrays_are_read_again_and_have_numpys_header() {
        let array = Array2::from_shape_fn((3, 2), |(i, j)| 2.0 * i as f64 + j as f64);
        let file = bytes(&array);
        assert_eq!(&file[8..61], b"v\0{'descr': '<f8', 'fortran_order': False, 'shape': (");
        assert_eq!((file.len(), file[127], read(&file)), (128 + 48, b'\n', Ok(array)));
        assert_eq!(read(&bytes(&aview0(&2.5_f32))), Ok(Array0::from_elem((), 2.5_f32)));
        let transposed =
            String::from_utf8_lossy(&file[..128]).replace("False, 'shape': (3, 2", "True,  'shape': (2, 3");
        let transposed = [&file[..10], &transposed.as_bytes()[transposed.len() - 118..], &file[128..]].concat();
        assert_eq!(read::<f64, _>(&transposed), Ok(ndarray::array![[0.0, 2.0, 4.0], [1.0, 3.0, 5.0]]));
    }

    #[test]
    fn damaged_file_is_an_error() {
        let file = bytes(&Array1::from_vec(vec![7_u8; 9]));
        assert!((0..file.len()).all(|end| read::<u8, ndarray::Ix1>(&file[..end]).is_err()));
        assert_eq!(read::<f32, ndarray::Ix1>(&file), Err("elements of type |u1".to_owned()));
        assert_eq!(read::<u8, ndarray::Ix2>(&file), Err("the array has shape [9]".to_owned()));
    }
}
