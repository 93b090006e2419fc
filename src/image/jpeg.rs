//! Detects damaged JPEG data that the decoder would accept or panic on. Compressed data has no
//! checksum, and the decoder turns any data into a picture; but the Huffman codes of damaged data
//! (`jpeg_scan.rs`) usually include an undefined one, or give too few or too many coefficients.

use super::jpeg_huffman::HuffmanTable;
use super::jpeg_scan::{self, Component, Scan, Tables};

const TRUNCATED: &str = "the JPEG data is truncated";
const DAMAGED_HEADER: &str = "the JPEG header is damaged";

/// The contents of the segments before a scan.
#[derive(Default)]
struct Header {
    progressive: bool,
    width: usize,
    height: usize,
    components: Vec<Component>,
    tables: Tables,
    /// MCUs between restart markers; 0 for none.
    restart_interval: usize,
}

/// Refuses truncated or damaged data, which the decoder would turn into a picture, and data with a
/// component sampled more finely than the first, on which the decoder panics.
pub(crate) fn check(bytes: &[u8]) -> Result<(), &'static str> {
    let mut header = Header::default();
    let mut at = 2; // past the start-of-image marker
    loop {
        let marker = match bytes.get(at..at + 2).ok_or(TRUNCATED)? {
            [0xFF, marker] => *marker,
            _ => {
                at += 1; // padding between segments
                continue;
            }
        };
        match marker {
            0xD9 => return Ok(()),
            // Fill bytes and restart markers have no length.
            0xFF => at += 1,
            0x00 | 0x01 | 0xD0..=0xD8 => at += 2,
            _ => {
                let length = bytes.get(at + 2..).and_then(be16).ok_or(TRUNCATED)?;
                let start = at + 4;
                at = start.max(at + 2 + length);
                let segment = bytes.get(start..at).ok_or(TRUNCATED)?;
                match marker {
                    0xC4 => header.read_tables(segment).ok_or(DAMAGED_HEADER)?,
                    0xC0..=0xC2 => {
                        header.progressive = marker == 0xC2;
                        header.read_frame(segment).ok_or(DAMAGED_HEADER)??;
                    }
                    0xDD => header.restart_interval = be16(segment).ok_or(DAMAGED_HEADER)?,
                    0xDA if !header.components.is_empty() => {
                        at += header.check_scan(segment, &bytes[at..]).ok_or(DAMAGED_HEADER)??;
                    }
                    _ => {}
                }
            }
        }
    }
}

fn be16(bytes: &[u8]) -> Option<usize> {
    Some(usize::from(u16::from_be_bytes([*bytes.first()?, *bytes.get(1)?])))
}

impl Header {
    fn read_tables(&mut self, mut segment: &[u8]) -> Option<()> {
        while let Some((&class_and_number, rest)) = segment.split_first() {
            let (counts, rest) = rest.split_first_chunk::<16>()?;
            let symbols = counts.iter().map(|&count| usize::from(count)).sum();
            let table = HuffmanTable::new(counts, rest.get(..symbols)?)?;
            let slot = self.tables.get_mut(usize::from(class_and_number >> 4))?;
            *slot.get_mut(usize::from(class_and_number & 15))? = Some(table);
            segment = &rest[symbols..];
        }
        Some(())
    }

    fn read_frame(&mut self, segment: &[u8]) -> Option<Result<(), &'static str>> {
        (self.height, self.width) = (be16(segment.get(1..)?)?, be16(segment.get(3..)?)?);
        let count = usize::from(*segment.get(5)?);
        // The memory was checked for the size in the first frame header; a second could declare a
        // larger one.
        if count > 4 || !self.components.is_empty() {
            return None;
        }
        let components = segment.get(6..6 + 3 * count)?.chunks_exact(3);
        let factors: Vec<_> = components.map(|c| (c[0], usize::from(c[1] >> 4), usize::from(c[1] & 15))).collect();
        let &(_, across, down) = factors.first()?;
        if factors.iter().any(|&(_, x, y)| x > across || y > down) {
            return Some(Err("a JPEG component is sampled more finely than the first one"));
        }
        if factors.iter().any(|&(_, x, y)| x == 0 || y == 0) {
            return None;
        }
        let (mcus_across, mcus_down) = (self.width.div_ceil(8 * across), self.height.div_ceil(8 * down));
        let component = |(id, x, y): (u8, usize, usize)| Component {
            id,
            sampling: (x, y),
            // Scans of one component hold the picture's blocks alone, others whole MCUs.
            blocks: ((self.width * x).div_ceil(8 * across), (self.height * y).div_ceil(8 * down)),
            stride: mcus_across * x,
            nonzero: if self.progressive { vec![0; mcus_across * x * mcus_down * y] } else { Vec::new() },
        };
        self.components = factors.into_iter().map(component).collect();
        Some(Ok(()))
    }

    /// Decodes the Huffman codes of a scan; returns the length of its data in bytes.
    fn check_scan(&mut self, segment: &[u8], data: &[u8]) -> Option<Result<usize, &'static str>> {
        let count = usize::from(*segment.first()?);
        let mut components = Vec::with_capacity(count);
        for selector in segment.get(1..1 + 2 * count)?.chunks_exact(2) {
            let index = self.components.iter().position(|component| component.id == selector[0])?;
            components.push((index, usize::from(selector[1] >> 4 & 3), usize::from(selector[1] & 3)));
        }
        let &[first, last, approximation] = segment.get(1 + 2 * count..4 + 2 * count)? else { return None };
        let (across, down) = self.components.first()?.sampling;
        let mcus = match components[..] {
            [] => return None,
            [(only, ..)] => self.components[only].blocks,
            _ => (self.width.div_ceil(8 * across), self.height.div_ceil(8 * down)),
        };
        let [first, last] = if self.progressive { [first, last] } else { [0, 63] };
        if last > 63 || first > last {
            return None;
        }
        let scan = Scan {
            components,
            mcus,
            band: (usize::from(first), usize::from(last)),
            progressive: self.progressive,
            refines: self.progressive && approximation >> 4 != 0,
            restart_interval: self.restart_interval,
        };
        Some(jpeg_scan::read(&scan, &self.tables, &mut self.components, data))
    }
}
