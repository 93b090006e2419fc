//! Decodes the Huffman codes of one scan of a JPEG (ITU-T T.81, annexes F and G) to check them; no
//! pixels are reconstructed.

use super::jpeg_huffman::HuffmanTable;

const UNDEFINED_CODE: &str = "the JPEG's compressed data is damaged: undefined Huffman code";
const TOO_MANY_COEFFICIENTS: &str = "the JPEG's compressed data is damaged: too many coefficients in a block";
const TOO_SHORT: &str = "the JPEG's compressed data is damaged: too few blocks";
const TOO_LONG: &str = "the JPEG's compressed data is damaged: too much data";

/// A component (colour channel) of the picture.
pub(super) struct Component {
    pub(super) id: u8,
    /// Sampling factors: blocks across and down in an MCU of a scan of several components.
    pub(super) sampling: (usize, usize),
    /// Blocks across and down in a scan of this component alone.
    pub(super) blocks: (usize, usize),
    /// Blocks per row in `nonzero`.
    pub(super) stride: usize,
    /// In a progressive picture, one bit mask per block of the coefficients that are not 0, which
    /// later scans refine; otherwise empty.
    pub(super) nonzero: Vec<u64>,
}

/// The header of a scan.
pub(super) struct Scan {
    /// Index of each component, and the identifiers of its DC and AC tables.
    pub(super) components: Vec<(usize, usize, usize)>,
    /// MCUs across and down; in a scan of one component an MCU is a block.
    pub(super) mcus: (usize, usize),
    /// Spectral selection: first and last coefficient.
    pub(super) band: (usize, usize),
    pub(super) progressive: bool,
    /// Whether it is a refinement scan (successive approximation).
    pub(super) refines: bool,
    /// MCUs between restart markers; 0 for none.
    pub(super) restart_interval: usize,
}

/// The tables of a picture by class (DC, then AC) and destination identifier.
pub(super) type Tables = [[Option<HuffmanTable>; 4]; 2];

/// Reads a scan's data.
struct ScanReader<'a> {
    scan: &'a Scan,
    tables: &'a Tables,
    components: &'a mut [Component],
    data: &'a [u8],
    /// Offset of the next byte that is not yet in `bits`.
    at: usize,
    /// The next `count` bits, starting at the most significant; the others are 0.
    bits: u64,
    count: u32,
    /// End-of-band run: blocks that follow without a further coefficient in this band.
    eob_run: u32,
}

/// Reads all blocks of a scan; returns the length of its data in bytes, up to the next marker.
pub(super) fn read(
    scan: &Scan,
    tables: &Tables,
    components: &mut [Component],
    data: &[u8],
) -> Result<usize, &'static str> {
    let mut reader = ScanReader { scan, tables, components, data, at: 0, bits: 0, count: 0, eob_run: 0 };
    let (across, down) = scan.mcus;
    for mcu in 0..across * down {
        if scan.restart_interval > 0 && mcu > 0 && mcu.is_multiple_of(scan.restart_interval) {
            reader.restart()?;
        }
        let (x, y) = (mcu % across, mcu / across);
        for &(component, dc, ac) in &scan.components {
            let (h, v) = if scan.components.len() == 1 { (1, 1) } else { reader.components[component].sampling };
            for block in 0..h * v {
                reader.block(component, dc, ac, x * h + block % h, y * v + block / h)?;
            }
        }
    }
    reader.end()?;
    Ok(reader.at)
}

impl<'a> ScanReader<'a> {
    fn block(&mut self, component: usize, dc: usize, ac: usize, x: usize, y: usize) -> Result<(), &'static str> {
        if !self.scan.progressive {
            self.dc(dc)?;
            return self.ac_first(ac, None);
        }
        let at = y * self.components[component].stride + x;
        match (self.scan.band, self.scan.refines) {
            ((0, _), true) => self.take(1).map(drop),
            ((0, _), false) => self.dc(dc),
            (_, false) => self.ac_first(ac, Some((component, at))),
            (_, true) => self.ac_refine(ac, (component, at)),
        }
    }

    fn dc(&mut self, table: usize) -> Result<(), &'static str> {
        let size = self.symbol(self.table(0, table)?, 0x1F)?;
        if size > 16 { Err(UNDEFINED_CODE) } else { Ok(()) }
    }

    /// Reads the band's AC coefficients of a block, up to an end-of-band code; records the nonzero
    /// ones of `block` (component, index of the block).
    fn ac_first(&mut self, table: usize, block: Option<(usize, usize)>) -> Result<(), &'static str> {
        if self.eob_run > 0 {
            self.eob_run -= 1;
            return Ok(());
        }
        let table = self.table(1, table)?;
        let (first, last) = self.scan.band;
        let mut k = first.max(1);
        while k <= last {
            let symbol = self.symbol(table, 0x0F)?;
            let (run, size) = (symbol >> 4, symbol & 15);
            match (run, size) {
                (15, 0) => k += 16,
                (_, 0) if run > 0 && !self.scan.progressive => return Err(UNDEFINED_CODE),
                (_, 0) => {
                    self.eob_run = (1 << run) + self.take(run.into())? - 1;
                    return Ok(());
                }
                _ => {
                    k += usize::from(run);
                    if k > last {
                        return Err(TOO_MANY_COEFFICIENTS);
                    }
                    if let Some((component, at)) = block {
                        let nonzero = self.components[component].nonzero.get_mut(at);
                        *nonzero.ok_or(TOO_MANY_COEFFICIENTS)? |= 1 << k;
                    }
                    k += 1;
                }
            }
        }
        if k > last + 1 { Err(TOO_MANY_COEFFICIENTS) } else { Ok(()) }
    }

    /// Reads one more bit of each coefficient that is not 0, and new nonzero coefficients.
    fn ac_refine(&mut self, table: usize, (component, at): (usize, usize)) -> Result<(), &'static str> {
        let known = *self.components[component].nonzero.get(at).ok_or(TOO_MANY_COEFFICIENTS)?;
        let table = self.table(1, table)?;
        let (first, last) = self.scan.band;
        let (mut new, mut k) = (0, first);
        while self.eob_run == 0 && k <= last {
            let symbol = self.symbol(table, 0)?;
            let (mut run, size) = (symbol >> 4, symbol & 15);
            match size {
                0 if run < 15 => {
                    self.eob_run = (1 << run) + self.take(run.into())?;
                    break;
                }
                0 => {}
                1 => drop(self.take(1)?),
                _ => return Err(UNDEFINED_CODE),
            }
            // Skip `run` zeros; the new coefficient replaces the zero after them.
            loop {
                if k > last {
                    return Err(TOO_MANY_COEFFICIENTS);
                }
                if known >> k & 1 == 1 {
                    self.take(1)?;
                } else if run > 0 {
                    run -= 1;
                } else {
                    break;
                }
                k += 1;
            }
            new |= u64::from(size == 1) << k;
            k += 1;
        }
        if self.eob_run > 0 {
            for k in k..=last {
                self.take((known >> k & 1) as u32)?;
            }
            self.eob_run -= 1;
        }
        self.components[component].nonzero[at] |= new;
        Ok(())
    }

    /// A table of a class (0: DC, 1: AC).
    fn table(&self, class: usize, number: usize) -> Result<&'a HuffmanTable, &'static str> {
        self.tables[class][number].as_ref().ok_or(UNDEFINED_CODE)
    }

    /// Reads the symbol of the next code and skips the value after it, whose length in bits is
    /// `symbol & size`.
    fn symbol(&mut self, table: &HuffmanTable, size: u8) -> Result<u8, &'static str> {
        if self.count < 32 {
            self.fill();
        }
        let found = table.find((self.bits >> 48) as u16);
        let (length, symbol) = found.ok_or(if self.count < 16 { TOO_SHORT } else { UNDEFINED_CODE })?;
        let consumed = u32::from(length + (symbol & size));
        self.count = self.count.checked_sub(consumed).ok_or(TOO_SHORT)?;
        self.bits <<= consumed;
        Ok(symbol)
    }

    /// Reads `count` bits.
    fn take(&mut self, count: u32) -> Result<u32, &'static str> {
        if self.count < count {
            self.fill();
        }
        self.count = self.count.checked_sub(count).ok_or(TOO_SHORT)?;
        let taken = (self.bits >> 1 >> (63 - count)) as u32;
        self.bits <<= count;
        Ok(taken)
    }

    /// Fills `bits` with at least 32 bits, unless the data ends.
    fn fill(&mut self) {
        while self.count <= 32 {
            let next = self.data.get(self.at..).and_then(<[u8]>::first_chunk::<4>);
            if let Some(next) = next.filter(|next| !next.contains(&0xFF)) {
                self.bits |= u64::from(u32::from_be_bytes(*next)) << (32 - self.count);
                (self.at, self.count) = (self.at + 4, self.count + 32);
                return;
            }
            let byte = match self.data.get(self.at..) {
                Some([0xFF, 0x00, ..]) => {
                    self.at += 2;
                    0xFF
                }
                None | Some([] | [0xFF, ..]) => return,
                Some([byte, ..]) => {
                    self.at += 1;
                    *byte
                }
            };
            self.bits |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    /// Checks that only padding bits are left before the next marker.
    fn end(&mut self) -> Result<(), &'static str> {
        self.fill();
        if self.count >= 8 || self.eob_run > 0 {
            return Err(TOO_LONG);
        }
        while self.data.get(self.at..self.at + 2) == Some(&[0xFF, 0xFF]) {
            self.at += 1;
        }
        if self.at + 1 < self.data.len() { Ok(()) } else { Err("the JPEG data is truncated") }
    }

    fn restart(&mut self) -> Result<(), &'static str> {
        self.end()?;
        match self.data[self.at + 1] {
            0xD0..=0xD7 => self.at += 2,
            _ => return Err(TOO_SHORT),
        }
        (self.bits, self.count, self.eob_run) = (0, 0, 0);
        Ok(())
    }
}
