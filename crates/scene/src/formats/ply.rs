//! Points of a PLY file, text or binary: x, y and z of its first element, `vertex`.

use glam::DVec3;

/// The header of a file: how many points, and where their coordinates are.
struct Header<'a> {
    encoding: &'a str,
    count: usize,
    /// Name, type and size in bytes of each number of a point.
    numbers: Vec<(&'a str, &'a str, usize)>,
}

/// The points; an error says what is wrong and what was expected.
pub(super) fn points(bytes: &[u8]) -> Result<Vec<DVec3>, String> {
    let mut rest = bytes;
    let mut header: Option<Header<'_>> = None;
    let mut encoding = None;
    let mut is_vertex = false;
    loop {
        let line = next_line(&mut rest).ok_or("no end_header; expected a PLY file")?;
        match line.split_ascii_whitespace().collect::<Vec<_>>()[..] {
            ["end_header"] => break,
            ["format", name, _] => encoding = Some(name),
            ["element", "vertex", count] if header.is_none() => {
                let count = count.parse().map_err(|_| format!("{count} vertices; expected a number"))?;
                let encoding = encoding.ok_or("element before format; expected format first")?;
                header = Some(Header { encoding, count, numbers: Vec::new() });
                is_vertex = true;
            }
            ["element", name, _] if header.is_none() => return Err(format!("element {name}; expected vertex first")),
            ["element", ..] => is_vertex = false,
            ["property", kind, name] if is_vertex => {
                let size = match kind {
                    "char" | "int8" | "uchar" | "uint8" => 1,
                    "short" | "int16" | "ushort" | "uint16" => 2,
                    "int" | "int32" | "uint" | "uint32" | "float" | "float32" => 4,
                    "double" | "float64" => 8,
                    _ => return Err(format!("property {kind} {name}; expected a number")),
                };
                header.iter_mut().for_each(|header| header.numbers.push((name, kind, size)));
            }
            ["property", ..] if is_vertex => return Err(format!("{line}; expected a number")),
            _ => {}
        }
    }
    header.ok_or("no element vertex; expected points")?.points(rest)
}

/// The next line of a header, without its end.
fn next_line<'a>(rest: &mut &'a [u8]) -> Option<&'a str> {
    let end = rest.iter().position(|&byte| byte == b'\n')?;
    let line = &rest[..end];
    *rest = &rest[end + 1..];
    std::str::from_utf8(line).ok()
}

impl Header<'_> {
    /// The points of the file's bytes after its header.
    fn points(&self, body: &[u8]) -> Result<Vec<DVec3>, String> {
        let place = |name| {
            let real = |kind: &str| kind.starts_with("float") || kind.starts_with("double");
            self.numbers.iter().position(|&(known, kind, _)| known == name && real(kind))
        };
        let (Some(x), Some(y), Some(z)) = (place("x"), place("y"), place("z")) else {
            return Err("no x, y and z; expected float or double".to_owned());
        };
        let few = |found: usize| format!("{found} of {} points; expected all", self.count);
        if self.encoding == "ascii" {
            let text = std::str::from_utf8(body).map_err(|_| "not text; expected numbers".to_owned())?;
            let mut points = Vec::new();
            for line in text.lines().take(self.count) {
                let words: Vec<&str> = line.split_ascii_whitespace().collect();
                let number = |at: usize| words.get(at).and_then(|word| word.parse().ok());
                let [Some(x), Some(y), Some(z)] = [x, y, z].map(number) else { return Err(few(points.len())) };
                points.push(DVec3::new(x, y, z));
            }
            return if points.len() == self.count { Ok(points) } else { Err(few(points.len())) };
        }
        let little = match self.encoding {
            "binary_little_endian" => true,
            "binary_big_endian" => false,
            other => return Err(format!("format {other}; expected ascii or binary")),
        };
        let bytes = |numbers: &[(_, _, usize)]| numbers.iter().map(|(_, _, size)| size).sum::<usize>();
        let stride = bytes(&self.numbers);
        let found = body.len() / stride;
        if found < self.count {
            return Err(few(found));
        }
        let offset = |at: usize| (bytes(&self.numbers[..at]), self.numbers[at].2);
        let offsets = [x, y, z].map(offset);
        let point = |record: &[u8]| offsets.map(|(start, size)| number(&record[start..start + size], little));
        Ok(body.chunks_exact(stride).take(self.count).map(|record| DVec3::from_array(point(record))).collect())
    }
}

/// A number of 4 or 8 bytes.
fn number(bytes: &[u8], little: bool) -> f64 {
    let float = |bytes| f64::from(if little { f32::from_le_bytes(bytes) } else { f32::from_be_bytes(bytes) });
    let double = |bytes| if little { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) };
    bytes.try_into().map(float).or_else(|_| bytes.try_into().map(double)).expect("4 or 8 bytes")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(format: &str, body: &[u8]) -> Vec<u8> {
        let head = format!(
            "ply\r\nformat {format} 1.0\ncomment 2 points\nelement vertex 2\nproperty uchar red\nproperty double x\n\
             property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_index\nend_header\n"
        );
        [head.as_bytes(), body].concat()
    }

    fn binary(little: bool) -> Vec<u8> {
        let point = |x: f64, y: f32, z: f32| match little {
            true => [&[255][..], &x.to_le_bytes(), &y.to_le_bytes(), &z.to_le_bytes()].concat(),
            false => [&[255][..], &x.to_be_bytes(), &y.to_be_bytes(), &z.to_be_bytes()].concat(),
        };
        [point(1.0, 2.0, 3.5), point(-4.0, 5.0, 6.0), vec![3, 0, 0]].concat()
    }

    #[test]
    fn text_and_binary_files_hold_equal_points() {
        let expected = vec![DVec3::new(1.0, 2.0, 3.5), DVec3::new(-4.0, 5.0, 6.0)];
        assert_eq!(points(&file("ascii", b"255 1 2 3.5\n255 -4 5 6\n3 0 1 2\n")).unwrap(), expected);
        assert_eq!(points(&file("binary_little_endian", &binary(true))).unwrap(), expected);
        assert_eq!(points(&file("binary_big_endian", &binary(false))).unwrap(), expected);
    }

    #[test]
    fn damaged_file_is_an_error() {
        let whole = file("binary_little_endian", &binary(true));
        for keep in 0..whole.len() - 3 {
            let message = points(&whole[..keep]).unwrap_err();
            assert!(message.contains("; expected "), "{message}");
        }
        for (from, to) in [("x", "u"), ("float y", "int y"), ("vertex", "face"), ("2\n", "two\n"), ("ascii", "zip")] {
            let text = String::from_utf8(file("ascii", b"255 1 2 3\n255 1 2 3\n")).unwrap().replacen(from, to, 1);
            let message = points(text.as_bytes()).unwrap_err();
            assert!(message.contains("; expected "), "{from}: {message}");
        }
        assert!(points(&file("ascii", b"255 1 2 3\n255 1 2\n")).unwrap_err().starts_with("1 of 2 points"));
    }
}
